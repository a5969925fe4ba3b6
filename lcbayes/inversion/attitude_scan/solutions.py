"""Identification of distinct solutions of a scan, and their relation to the best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.data.segments import Gap, split
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.spin import Ends

Floats = NDArray[np.float64]

SAME_POLE, MIRRORED = 10.0, 25.0  # degrees
SAME_TURNS = 0.25  # turns over the data; largest difference of equal frequencies
FLAT = 0.25  # largest ratio of thickness to width of the directions for a mirror solution
GAP = 0.05  # of the span; a longer gap divides the data into sets
OFF_ALIAS = 0.15  # half turns between two sets; tolerance of an alias

SAME, MIRROR, REVERSED, POLE = "best", "mirror", "reversed", "pole"
HALF, TWICE, ALIAS, PERIOD = "half-period", "double-period", "period-alias", "period"


@dataclass(frozen=True)
class Geometry:
    """Properties of the geometry that make spins nearly indistinguishable.

    Attributes
    ----------
    normal : (3,) or None
        Normal of the plane near which Sun and observer remain, if any. A half turn of the pole and
        of the body's mirror image about it leaves the brightness almost unchanged.
    span : s
    separations : (S,) s
        Times between the sets of data, over which the number of turns is unknown.
    """

    normal: Floats | None
    span: float
    separations: Floats

    @classmethod
    def of(cls, points: Points) -> Geometry:
        sun, obs = np.asarray(points.sun), np.asarray(points.obs)
        values, vectors = np.linalg.eigh(sun.T @ sun + obs.T @ obs)
        flat = values[0] <= FLAT**2 * values[1]
        t, span = np.sort(np.asarray(points.t).mean(axis=0)), float(points.span)
        parts = split(t, np.zeros(t.size, int), Gap(GAP * span))
        middle = np.array([t[rows].mean() for rows in parts])
        apart = np.abs(middle[:, None] - middle)[np.triu_indices(len(middle), 1)]
        return cls(vectors[:, 0] if flat else None, span, np.append(apart, span))

    def mirrored(self, pole: Floats) -> Floats | None:
        """The pole rotated by half a turn about the normal of the plane."""
        return None if self.normal is None else 2.0 * (pole @ self.normal) * self.normal - pole

    def relation(self, pole: Floats, frequency: float, to: Floats, at: float) -> tuple[str, str]:
        """Relation of a spin to the spin with pole ``to`` and frequency ``at``: name and
        description."""
        more = frequency - at
        if abs(more) * self.span < SAME_TURNS:
            mirror = self.mirrored(to)
            if angle(pole, to) < SAME_POLE:
                return SAME, "the same spin"
            if mirror is not None and angle(pole, mirror) < MIRRORED:
                return MIRROR, "mirror pole: Sun and observer keep near one plane"
            if angle(pole, -to) < MIRRORED:
                return REVERSED, "the opposite sense of rotation"
            return POLE, "another pole"
        for factor, name, words in (
            (2.0, HALF, "half the period"),
            (0.5, TWICE, "twice the period"),
        ):
            if abs(frequency - factor * at) * self.span < max(1.0, 1e-3 * at * self.span):
                return name, words
        turns = 2.0 * abs(more) * self.separations
        for k in (1, 2):
            off = np.abs(turns - k)
            if off.min() < OFF_ALIAS:
                days = self.separations[np.argmin(off)] / DAY_S
                length = f"{days:.4g} days" if days >= 1 else f"{days * DAY_S:.4g} s"
                how = "half a turn" if k == 1 else "a turn"
                return ALIAS, f"period alias: {how} {'more' if more > 0 else 'less'} in {length}"
        return PERIOD, "another period"


def angle(a: Floats, b: Floats) -> float:
    """Angle between two unit vectors, degrees."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


def distinct(ends: Ends, span: float, most: int) -> tuple[Ends, NDArray[np.integer]]:
    """The distinct solutions among the end points of searches, best first, with their hits.

    Two solutions are the same if their poles differ by less than 10° and their frequencies by less
    than a quarter of a turn over the data.
    """
    order = np.argsort(ends.value, kind="stable")
    kept: list[int] = []
    for i in order[np.isfinite(ends.value[order])]:
        if len(kept) < most and not np.any(_same(ends.rows(kept), ends, int(i), span)):
            kept.append(int(i))
    unique = ends.rows(np.array(kept, int))
    return unique, counted(ends, unique, span)


def counted(
    ends: Ends, solutions: Ends, span: float, weight: NDArray[np.integer] | None = None
) -> NDArray[np.integer]:
    """Number of end points at each solution; each end point counts for the first that matches."""
    hits = np.zeros(len(solutions.value), int)
    for i in np.flatnonzero(np.isfinite(ends.value)):
        same = _same(solutions, ends, int(i), span)
        if np.any(same):
            hits[np.argmax(same)] += 1 if weight is None else weight[i]
    return hits


def _same(solutions: Ends, ends: Ends, i: int, span: float) -> NDArray[np.bool_]:
    """Whether each solution is the same as the i-th end point."""
    near = np.abs(solutions.frequency - ends.frequency[i]) * span < SAME_TURNS
    return near & (solutions.pole @ ends.pole[i] > np.cos(np.radians(SAME_POLE)))
