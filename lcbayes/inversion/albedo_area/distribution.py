"""The albedo-area distribution on a set of normals, with scales of curves and penalties."""

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
GAUGE = 1e2  # weight of the row that holds the mean of free scales, which the data leave open
NEIGHBOURS = 6


@dataclass(frozen=True)
class Distribution:
    """Albedo-areas αⱼ ≥ 0 and the scales of curves that fit a light curve best.

    Attributes
    ----------
    normals : (n, 3)
        Unit vectors, body frame.
    which : (n,) int
        Index of the material.
    areas : (n,) m²
        Albedo-areas; up to one common factor where no curve is calibrated.
    scale : (C,)
        1 for calibrated curves. Where there is none, their mean is 1.
    flux : (T,)
        Fitted, scale included.
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
    """Rows of penalties Σ (Pα − p)², beside the data's."""

    matrix: Floats
    target: Floats


def grid(n: int, materials: Sequence[Material] = (LAMBERTIAN,)) -> tuple[Floats, NDArray]:
    """Normals (n·M, 3) of an equal-area grid, once per material, and the material of each."""
    normals = facets.grid(n)
    which = np.repeat(np.arange(len(materials)), n)
    return np.tile(normals, (len(materials), 1)), which


def typical(seen: Observed, matrix: Floats) -> float:
    """The one albedo-area that, the same for all normals, fits best, scales taken for 1."""
    sphere = matrix.sum(axis=1) / seen.error
    if not np.any(sphere > 0):
        raise InputError("the body is dark at every epoch: Sun behind it as seen by the observer")
    return float(max(sphere @ (seen.flux / seen.error) / (sphere @ sphere), 1e-300))


def smooth(normals: Floats, which: NDArray[np.integer], weight: float, unit: float) -> Rows:
    """λ Σ (αᵢ − mean of its six neighbours of the same material)²/ᾱ².

    Parameters
    ----------
    weight : float
        λ: χ² may rise by this for every normal whose area is off its neighbours' mean by ᾱ.
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
    """Areas that are not negative, and scales of curves, that minimise χ² plus penalties.

    χ² = Σ (f_t − s_c (Kα)_t)²/σ_t². With all scales known it is one non-negative least-squares
    problem. Otherwise Gauss-Newton: linearised in (α, s) about the last solution it is again one,
    with a column for each free scale; a step that does not help is halved, and scales always follow
    from the areas exactly, s_c = Σ f Kα/σ² / Σ (Kα)²/σ² (variable projection).

    Parameters
    ----------
    seen : Observed
    normals, which : (n, 3), (n,)
        Carried into the result.
    matrix : (T, n)
        K, from `kernel.columns`.
    penalties : sequence of Rows
    start : Distribution, optional
        Linearise about it first; its normals may be others.

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
        found = Distribution(normals, which, areas, scale, fitted, chi2)
        return found, chi2 + float(np.sum((extra.matrix @ areas - extra.target) ** 2))

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
    """Rows and target of the least-squares problem in (α, free scales) about a solution.

    s Kα ≈ s₀ Kα + s Kα₀ − s₀ Kα₀ for curves of free scale. One row holds the mean of the scales
    where all are free, which nothing else decides.
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
    """Factor of each curve for which the model fits it best."""
    weight = seen.error**-2.0
    count = len(seen.free)
    over = np.bincount(seen.curve, weight * seen.flux * model, count)
    under = np.bincount(seen.curve, weight * model**2, count)
    return np.maximum(over, 0.0) / np.where(under > 0, under, 1.0)
