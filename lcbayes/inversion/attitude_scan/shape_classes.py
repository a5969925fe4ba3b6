"""Prior of shapes for sparse points: classes of bodies with normal coefficients.

`benchmarks/shapes.py` simulates the bodies of each class and writes `shapes.json`. The order in
longitude tells a period from its half and its double: a smooth body has next to nothing of odd
orders, one with varied albedo has no more of the fourth order than a smooth one, and the fourth
order of an angular body comes with some of the second.
"""

from __future__ import annotations

import json
from functools import cache
from importlib import resources
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.inversion.attitude_scan.harmonics import fixed_prior

Floats = NDArray[np.float64]

FILE = "shapes.json"
LEAST_SD = 0.01  # added to every coefficient: what no class describes


class Normal(NamedTuple):
    """Normal densities of coefficients: means (…, Q), precisions (…, Q, Q), and ln of their
    determinants (…)."""

    mean: Any
    precision: Any
    log_det: Any

    @classmethod
    def of(cls, mean: Floats, covariance: Floats) -> Normal:
        return cls(mean, np.linalg.inv(covariance), -np.linalg.slogdet(covariance)[1])


@cache
def classes() -> tuple[tuple[str, ...], Floats, Floats]:
    """Names (K), means (K, 31) and covariances (K, 31, 31) of the columns of `shape_columns`.

    All classes have the same probability.
    """
    text = resources.files(__package__).joinpath(FILE).read_text(encoding="utf-8")
    every = json.loads(text)
    means = np.array([of["mean"] for of in every.values()])
    covariances = np.array([of["covariance"] for of in every.values()])
    return tuple(every), means, covariances + LEAST_SD**2 * np.eye(means.shape[1])


def shape_prior() -> tuple[Floats, Floats]:
    """Mean (31,) and covariance (31, 31) over all classes."""
    _, means, covariances = classes()
    mean = means.mean(axis=0)
    apart = means - mean
    return mean, covariances.mean(axis=0) + apart.T @ apart / len(apart)


def prior(n_curves: int) -> Normal:
    """The prior of offsets, phase law and shape, over all classes as one normal density."""
    return Normal.of(*_with_fixed(n_curves, *shape_prior()))


def class_priors(n_curves: int) -> Normal:
    """The same for each class, stacked."""
    _, means, covariances = classes()
    rows = [
        Normal.of(*_with_fixed(n_curves, m, c)) for m, c in zip(means, covariances, strict=True)
    ]
    return Normal(*(np.array(x) for x in zip(*rows, strict=True)))


def _with_fixed(n_curves: int, mean: Floats, covariance: Floats) -> tuple[Floats, Floats]:
    first, sd = fixed_prior(n_curves)
    size = len(first) + len(mean)
    both = np.zeros((size, size))
    both[: len(first), : len(first)] = np.diag(sd**2)
    both[len(first) :, len(first) :] = covariance
    return np.concatenate([first, mean]), both
