"""A curve without which the points have another period.

A curve whose clock is an hour late, or whose days begin at noon, makes a wrong period the most
probable, and its residuals need not show it: a body seen in a few nights may fit them all at
another period. Therefore the posterior of the periods is compared with that without each curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.inversion.attitude_scan import evidence
from lcbayes.inversion.attitude_scan.evidence import Cells
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.inversion.attitude_scan.sparse import SAME_PERIOD, UNIQUE

Floats = NDArray[np.float64]

PERIODS, POLES = 64, 2  # the best periods, and cells of each, that are compared
PHASES = 24  # of a turn by which a curve is moved
BETTER = 10.0  # nats by which a moved curve must raise the evidence to be called wrong in time


@dataclass(frozen=True)
class Contradiction:
    """A curve, and the period of all others.

    curve : counted from 0
    frequency : Hz
    probability : of that period without the curve
    late : whether the curve fits that period once it is moved in time
    """

    curve: int
    frequency: float
    probability: float
    late: bool


def contradiction(points: SparsePoints, found: Cells) -> Contradiction | None:
    """The curve without which another period has a probability of at least 0.99.

    Parameters
    ----------
    points : SparsePoints
    found : Cells
        Those that hold the posterior of all points.

    Returns
    -------
    Contradiction or None
        Of the curve with the greatest such probability; None if there is no such curve.
    """
    n_curves, most = points.group.shape[1], UNIQUE
    if n_curves == 1:
        return None
    best = evidence.best_of_periods(found, points.span, PERIODS, POLES)
    spins = found.rows(np.concatenate(best))
    every = evidence.all_shapes(points, spins.pole, spins.frequency)
    first = spins.frequency[np.argmax(every)]
    worst: tuple[int, Cells] | None = None
    for k in range(n_curves):
        others = points._replace(used=points.used * (1.0 - points.group[:, k]))
        value = evidence.all_shapes(others, spins.pole, spins.frequency)
        same = _same(spins.frequency, spins.frequency[np.argmax(value)], points)
        share = np.exp(value - np.logaddexp.reduce(value))
        if share[same].sum() >= most and not _same(first, spins.frequency[same], points).any():
            most, worst = float(share[same].sum()), (k, spins.rows(same))
    if worst is None:
        return None
    curve, other = worst
    late = _late(points, curve, other, float(every.max()))
    return Contradiction(curve, float(other.frequency[0]), most, late)


def _same(frequency: Floats, other: Floats, points: SparsePoints) -> NDArray[np.bool_]:
    return np.abs(frequency - other) * points.span < SAME_PERIOD


def _late(points: SparsePoints, curve: int, spins: Cells, best: float) -> bool:
    """Whether a curve that is moved in time fits the spins of the others."""
    period, moved = 1.0 / spins.frequency[0], points.group[:, curve]
    values = [
        evidence.all_shapes(
            points._replace(t=points.t - moved * (k * period / PHASES)), spins.pole, spins.frequency
        ).max()
        for k in range(1, PHASES)
    ]
    return bool(max(values) >= best + BETTER)
