"""Stretches of a light curve without long gaps: passes, nights."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcbayes.data.lightcurve import LightCurve

Rows = NDArray[np.integer]

GAP_S, GAP_STEPS = 600.0, 50.0  # a longer silence, in seconds and in steps, ends a stretch
LONGEST_GAP_S = 6 * 3600.0  # and this one always does: nights of observation, not a survey
MIN_POINTS = 30


def labels(curve: LightCurve) -> Rows:
    """A number for each group, site and band, (T,)."""
    kinds = np.stack([curve.curve.astype(str), curve.site, curve.band])
    return np.unique(kinds, axis=1, return_inverse=True)[1].ravel()


def stretches(t: NDArray[np.float64], label: Rows) -> list[Rows]:
    """Rows between long gaps, each of one label, in order of time; those with few points left out.

    A gap is long above 600 s and 50 median steps, or above six hours.
    """
    found = []
    for one in np.unique(label):
        rows = np.flatnonzero(label == one)
        rows = rows[np.argsort(t[rows], kind="stable")]
        steps = np.diff(t[rows])
        moved = steps[steps > 0]
        if moved.size == 0:
            continue
        limit = min(max(GAP_S, GAP_STEPS * float(np.median(moved))), LONGEST_GAP_S)
        parts = np.split(rows, np.flatnonzero(steps > limit) + 1)
        found += [r for r in parts if r.size >= MIN_POINTS and t[r[-1]] > t[r[0]]]
    return sorted(found, key=lambda rows: t[rows[0]])


def numbers(curve: LightCurve) -> NDArray[np.int64]:
    """Which pass each point belongs to, (T,), from 0: points of one group and site that follow each
    other within ten minutes."""
    site = np.unique(curve.site, return_inverse=True)[1]
    order = np.lexsort((curve.t, site, curve.curve))
    new = np.ones(curve.n_obs, dtype=bool)
    new[1:] = (
        (np.diff(curve.curve[order]) != 0)
        | (np.diff(site[order]) != 0)
        | (np.diff(curve.t[order]) > GAP_S)
    )
    found = np.empty(curve.n_obs, np.int64)
    found[order] = np.cumsum(new) - 1
    return found
