"""Goodness of fit: tests of whether the facets explain a light curve within its errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial import KDTree

from lcbayes.inversion.albedo_area.facets import Facets, worth
from lcbayes.inversion.albedo_area.observed import Observed

Floats = NDArray[np.float64]

LEVEL = 1e-3  # p-value of χ² below which a misfit is reported
GEOMETRY_LEVEL = 5e-3  # p-value below which residuals depend on the geometry
NEIGHBOURS = 4
PERMUTATIONS = 1999


def chi2_p_value(chi2: float, dof: int) -> float:
    """Probability of a χ² at least as large if the model and the errors are correct."""
    return float(stats.chi2.sf(chi2, dof))


def geometry_p_value(seen: Observed, model: Floats, seed: int = 0) -> float:
    """p-value for residuals that are independent of the directions to Sun and observer.

    The statistic is Σᵢ rᵢ Σ_j r_j over the four points j whose directions in the body frame are
    nearest to those of i. Here r is the residual over its error, minus the mean. The statistic is
    ranked among permutations of r. Errors need not be known.

    References
    ----------
    Moran 1950, Biometrika 37, 17.
    """
    middle = len(seen.weight) // 2
    place = np.hstack([seen.sun[middle], seen.obs[middle]])
    if len(place) < 5 * NEIGHBOURS:
        return 1.0
    nearest = np.asarray(KDTree(place).query(place, NEIGHBOURS + 1)[1])
    near = nearest[:, 1:]
    residual = (seen.flux - model) / seen.error
    residual = residual - residual.mean()
    rng = np.random.default_rng(seed)
    own = float(residual @ residual[near].sum(axis=1))
    null = np.empty(PERMUTATIONS)
    for k in range(PERMUTATIONS):
        shuffled = rng.permutation(residual)
        null[k] = shuffled @ shuffled[near].sum(axis=1)
    return float((1 + np.sum(null >= own)) / (1 + PERMUTATIONS))


def doubtful(facets: Facets, dof: int, cost: float) -> NDArray[np.intp]:
    """Facets that are insignificant once errors are scaled to the misfit.

    These facets lower χ² by less than ``cost`` × max(1, χ²/dof).
    """
    return np.flatnonzero(worth(facets) < cost * max(1.0, facets.chi2 / dof))
