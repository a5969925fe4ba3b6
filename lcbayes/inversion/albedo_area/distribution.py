"""The albedo-area distribution on a set of normals, with curve scales and penalties."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.inversion.albedo_area import nnls
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, Material
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.bodies import facets

Floats = NDArray[np.float64]

MAX_STEPS = 30
SETTLED = 1e-9  # relative change of the objective between steps
GAUGE = 1e2  # weight of the row that fixes the mean of the free scales, which is degenerate
NEIGHBOURS = 6


@dataclass(frozen=True)
class Distribution:
    """Best-fitting albedo-areas αⱼ ≥ 0 and curve scales of a light curve.

    Attributes
    ----------
    normals : (n, 3)
        Unit vectors, body frame.
    which : (n,) int
        Index of the material.
    areas : (n,) m²
        Albedo-areas; known up to a common factor if no curve is calibrated.
    scale : (C,)
        1 for calibrated curves. If there are none, the mean of the scales is 1.
    flux : (T,)
        Fitted flux, including the scale.
    chi2 : float
        Σ ((f − model)/σ)², Hall's eq. (15), without penalties.
    """

    normals: Floats
    which: NDArray[np.integer]
    areas: Floats
    scale: Floats
    flux: Floats
    chi2: float


@dataclass(frozen=True)
class Rows:
    """Penalty rows Σ (Pα − p)², in addition to the data rows."""

    matrix: Floats
    target: Floats


def grid(n: int, materials: Sequence[Material] = (LAMBERTIAN,)) -> tuple[Floats, NDArray]:
    """Normals (n·M, 3) of an equal-area grid, once per material, and the material of each."""
    normals = facets.grid(n)
    which = np.repeat(np.arange(len(materials)), n)
    return np.tile(normals, (len(materials), 1)), which


def typical(seen: Observed, matrix: Floats) -> float:
    """The best-fitting albedo-area if it is the same for all normals and all scales are 1."""
    sphere = matrix.sum(axis=1) / seen.error
    if not np.any(sphere > 0):
        raise InputError("the body is dark at every epoch: Sun behind it as seen by the observer")
    return float(max(sphere @ (seen.flux / seen.error) / (sphere @ sphere), 1e-300))


def smooth(normals: Floats, which: NDArray[np.integer], weight: float, unit: float) -> Rows:
    """λ Σ (αᵢ − mean of its six neighbours of the same material)²/ᾱ².

    Parameters
    ----------
    weight : float
        λ: the penalty for each normal whose area differs from its neighbours' mean by ᾱ.
    unit : float
        ᾱ, see `typical`.
    """
    from scipy.spatial import KDTree

    matrix = np.eye(len(normals))
    for m in np.unique(which):
        here = np.flatnonzero(which == m)
        near = np.asarray(KDTree(normals[here]).query(normals[here], NEIGHBOURS + 1)[1])
        for i in range(len(here)):
            matrix[here[i], here[near[i][near[i] != i]]] -= 1.0 / NEIGHBOURS
    return Rows(np.sqrt(weight) / unit * matrix, np.zeros(len(normals)))


def solve(
    seen: Observed,
    normals: Floats,
    which: NDArray[np.integer],
    matrix: Floats,
    penalties: Sequence[Rows] = (),
    start: Distribution | None = None,
) -> Distribution:
    """Non-negative areas and curve scales that minimise χ² plus penalties.

    χ² = Σ (f_t − s_c (Kα)_t)²/σ_t². If all scales are known, this is one non-negative least-squares
    problem. Otherwise the Gauss-Newton method applies. Linearised in (α, s) about the last
    solution, each step is again a non-negative least-squares problem with a column for each free
    scale. A step that does not reduce the objective is halved. The scales are always the exact
    optimum for the areas, s_c = Σ f Kα/σ² / Σ (Kα)²/σ² (variable projection).

    Parameters
    ----------
    seen : Observed
    normals, which : (n, 3), (n,)
        Copied into the result.
    matrix : (T, n)
        K, from `kernel.columns`.
    penalties : sequence of Rows
    start : Distribution, optional
        Initial point of the linearisation; its normals may differ.

    References
    ----------
    Hall et al. 2007, eqs. (13)-(15); Golub & Pereyra 1973 (variable projection).
    """
    flux, error, free = seen.flux, seen.error, seen.free
    extra = Rows(
        np.concatenate([p.matrix for p in penalties] or [np.zeros((0, len(normals)))]),
        np.concatenate([p.target for p in penalties] or [np.zeros(0)]),
    )

    def evaluated(areas: Floats) -> tuple[Distribution, float]:
        model = matrix @ areas
        scale = np.where(free, _best_scale(seen, model), 1.0)
        if np.all(free):
            areas, scale = areas * scale.mean(), scale / scale.mean()
            model = matrix @ areas
        fitted = scale[seen.curve] * model
        chi2 = float(np.sum(((flux - fitted) / error) ** 2))
        distribution = Distribution(normals, which, areas, scale, fitted, chi2)
        return distribution, chi2 + float(np.sum((extra.matrix @ areas - extra.target) ** 2))

    if not np.any(free):
        rows = np.vstack([matrix / error[:, None], extra.matrix])
        return evaluated(nnls.exact(rows, np.concatenate([flux / error, extra.target])))[0]
    best, value = evaluated(np.full(len(normals), typical(seen, matrix)))
    if start is not None:
        best, value = start, np.inf
    for _ in range(MAX_STEPS):
        areas = nnls.exact(*linearised(seen, matrix, best, extra))[: len(normals)]
        size, (new, lower) = 1.0, evaluated(areas)
        while not lower < value and size > 1e-3:
            size *= 0.5
            new, lower = evaluated((1.0 - size) * best.areas + size * areas)
        if not lower < value:
            break
        settled = value - lower < SETTLED * value
        best, value = new, lower
        if settled:
            break
    return best


def linearised(
    seen: Observed, matrix: Floats, about: Distribution, extra: Rows
) -> tuple[Floats, Floats]:
    """Rows and target of the least-squares problem in (α, free scales), linearised at a solution.

    s Kα ≈ s₀ Kα + s Kα₀ − s₀ Kα₀ for curves of free scale. If all scales are free, one row fixes
    their mean, which the data do not determine.
    """
    free = np.flatnonzero(seen.free)
    scale = about.scale[seen.curve]
    model = about.flux / scale
    is_free = seen.free[seen.curve]
    by_scale = np.where(seen.curve[:, None] == free, model[:, None], 0.0)
    data = np.hstack([scale[:, None] * matrix, by_scale]) / seen.error[:, None]
    target = (seen.flux + np.where(is_free, about.flux, 0.0)) / seen.error
    rows = [data, np.hstack([extra.matrix, np.zeros((len(extra.matrix), len(free)))])]
    targets = [target, extra.target]
    if len(free) == len(seen.free):
        mean = np.concatenate([np.zeros(matrix.shape[1]), np.ones(len(free)) / len(free)])
        rows.append(GAUGE * mean[None])
        targets.append(np.array([GAUGE]))
    return np.vstack(rows), np.concatenate(targets)


def _best_scale(seen: Observed, model: Floats) -> Floats:
    """Best-fitting factor of each curve."""
    weight = seen.error**-2.0
    count = len(seen.free)
    over = np.bincount(seen.curve, weight * seen.flux * model, count)
    under = np.bincount(seen.curve, weight * model**2, count)
    return np.maximum(over, 0.0) / np.where(under > 0, under, 1.0)
