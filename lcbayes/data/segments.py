"""Segments of a light curve between gaps: passes, nights, panels of a figure.

A segment is a sequence of points of one series without a time step longer than a `Gap` allows. A
series is a group observed from one site, and in one band if bands are distinguished. Every
definition of a pass in the package is `split` with one of the gaps below.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.data.lightcurve import LightCurve

Rows = NDArray[np.integer]


@dataclass(frozen=True)
class Gap:
    """The longest time step within a segment: min(max(seconds, steps * median), longest_s).

    Attributes
    ----------
    seconds : s
    steps : float
        In units of the median step of the series, without repeated times, so that sparse sampling
        is not mistaken for gaps.
    longest_s : s
    """

    seconds: float
    steps: float = 0.0
    longest_s: float = np.inf

    def limit(self, steps: NDArray[np.float64]) -> float:
        """The longest step (s) for a series with these steps (s)."""
        positive = steps[steps > 0]
        typical = float(np.median(positive)) if self.steps and positive.size else 0.0
        return min(max(self.seconds, self.steps * typical), self.longest_s)


PASS = Gap(600.0)  # a pass in a low orbit, independent of the sampling
NIGHT = Gap(600.0, 50.0, 6 * 3600.0)  # densely sampled data for the search for periods and glints
APPARITION = Gap(60.0 * DAY_S)  # of an asteroid, which the Sun hides for longer
MIN_POINTS = 30  # of a segment for the search for periods and glints


def labels(curve: LightCurve, *, bands: bool = True) -> Rows:
    """The series of each point, (T,), counted from 0 by group, then site, then band.

    Parameters
    ----------
    curve : LightCurve
    bands : bool
        Whether the bands of one group and site are separate series.
    """
    keys = [curve.curve, np.unique(curve.site, return_inverse=True)[1]]
    if bands:
        keys.append(np.unique(curve.band, return_inverse=True)[1])
    return np.unique(np.stack(keys), axis=1, return_inverse=True)[1].ravel()


def split(t: NDArray[np.float64], label: Rows, gap: Gap = PASS, min_points: int = 1) -> list[Rows]:
    """Rows of each segment, ordered by label, then time.

    Parameters
    ----------
    t : (T,) s
    label : (T,) int
        The series of each point, e.g. from `labels`.
    gap : Gap
    min_points : int
        Segments with fewer points are left out; if above 1, also those at a single time.
    """
    order = np.lexsort((t, label))
    parts: list[Rows] = []
    for rows in np.split(order, np.flatnonzero(np.diff(label[order])) + 1):
        steps = np.diff(t[rows])
        parts += np.split(rows, np.flatnonzero(steps > gap.limit(steps)) + 1)
    if min_points <= 1:
        return parts
    return [rows for rows in parts if rows.size >= min_points and t[rows[-1]] > t[rows[0]]]


def nights(t: NDArray[np.float64], label: Rows) -> list[Rows]:
    """Rows of each segment with at least `MIN_POINTS` points between gaps of `NIGHT`, by time."""
    return sorted(split(t, label, NIGHT, MIN_POINTS), key=lambda rows: t[rows[0]])


def pass_numbers(curve: LightCurve) -> NDArray[np.int64]:
    """Pass of each point, (T,), from 0: one group and site, no time step above ten minutes."""
    number = np.empty(curve.n_obs, np.int64)
    for i, rows in enumerate(split(curve.t, labels(curve, bands=False), PASS)):
        number[rows] = i
    return number
