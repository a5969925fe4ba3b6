"""Averages of points with equal times, which occur in catalogues with rounded times."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.integer]


def instants(t: Floats, label: Rows, value: Floats, error: Floats) -> tuple[Rows, Floats, Floats]:
    """Means over the points of each label and time, weighted by 1/error², and their errors.

    Returns
    -------
    (U,) int, ascending
        First point of each instant.
    (U,), (U,)
        Its mean and the standard deviation of the mean.
    """
    keys = np.stack([label, t], axis=1)
    first, instant = np.unique(keys, axis=0, return_index=True, return_inverse=True)[1:]
    weight = np.bincount(instant.ravel(), error**-2)
    mean = np.bincount(instant.ravel(), value * error**-2) / weight
    order = np.argsort(first)
    return first[order], mean[order], weight[order] ** -0.5


def rounding(t: Floats) -> float:
    """Rounding of the times, s: their smallest step if some are equal, otherwise 0.

    Unequal times that are multiples of a unit differ by at least the unit, so the result is no
    smaller than the unit.
    """
    steps = np.diff(np.sort(t))
    equal = steps == 0
    return float(steps[~equal].min()) if equal.any() and not equal.all() else 0.0
