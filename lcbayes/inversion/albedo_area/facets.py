"""Reduction of a grid to the few facets that explain a light curve: refine, merge, remove."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.levenberg_marquardt import (
    Controls,
    Quadratic,
    gauss_newton,
    levenberg_marquardt,
)
from lcbayes.inversion.albedo_area.distribution import GAUGE, Distribution, solve
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, Material, columns, slopes
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.bodies.facets import across

Floats = NDArray[np.float64]

LEVELS = 6  # halvings of the grid spacing about non-zero areas: 10 degrees to 0.15
RADII = (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 11.0, 15.0, 20.0, 25.0)  # degrees; merging radii
NEIGHBOURS = 6
MAX_STEPS = 60
CONTROLS = Controls(largest_damping=1e6, patience=2)
SETTLED = 1e-3  # gain in χ² of two successive steps that ends a descent; negligible change in χ²
ROUGHLY = 0.02  # the same relative to the cost of a facet, while facets are being selected
LEAST = 1e-14  # rounding level relative to the largest eigenvalue
TRIED = 5  # number of weakest facets tested for removal


@dataclass(frozen=True)
class Facets(Distribution):
    """A distribution of few facets, with its covariance.

    Attributes
    ----------
    covariance : (n, 3, n, 3) m⁴
        Covariance of the area vectors αᵢ nᵢ, from the curvature of χ²; scales are marginalised.
    """

    covariance: Floats

    @property
    def area_sd(self) -> Floats:
        """Standard deviation of each albedo-area, (n,) m²."""
        own = np.einsum("iaib->iab", self.covariance)
        return np.sqrt(np.einsum("ia,iab,ib->i", self.normals, own, self.normals))

    @property
    def direction_sd(self) -> Floats:
        """Standard deviation of each normal along one of its two tangent directions, (n,) rad."""
        own = np.einsum("iaia->i", self.covariance)
        return np.sqrt(np.maximum(own - self.area_sd**2, 0.0) / 2.0) / self.areas


def explain(
    seen: Observed,
    coarse: Distribution,
    matrix: Floats,
    materials: Sequence[Material],
    cost: float | None = None,
) -> tuple[Distribution, Facets]:
    """The refined distribution and the few facets of a light curve, from a distribution on a grid.

    With several materials, each is also tried alone, and the solution of lowest cost is kept. If
    the columns of two materials are nearly degenerate, removing facets one by one does not reach
    that solution.

    Returns
    -------
    fine : Distribution
        From `refine`.
    few : Facets
        From `select_facets`.
    """
    cost = 3.0 * float(np.log(len(seen.flux))) if cost is None else cost
    pairs = []
    alone = range(len(materials)) if len(materials) > 1 else ()
    for only in (None, *alone):
        start, part = coarse, matrix
        if only is not None:
            here = coarse.which == only
            part = matrix[:, here]
            if not np.any(part):
                continue
            start = solve(seen, coarse.normals[here], coarse.which[here], part)
            if not np.any(start.areas > 0):
                continue
        fine = refine(seen, start, part, materials)
        pairs.append((fine, select_facets(seen, fine, materials, cost)))
    return min(pairs, key=lambda pair: pair[1].chi2 + cost * len(pair[1].areas))


def refine(
    seen: Observed,
    coarse: Distribution,
    matrix: Floats,
    materials: Sequence[Material],
    still: int = 0,
) -> Distribution:
    """The distribution on adaptively refined normals.

    Six candidates at 0.6 of the grid spacing are added about each normal of non-zero area, and the
    problem is solved again. The distance is then halved, and the step repeated about the normals of
    non-zero area. Each step is the same convex problem with more columns. χ² therefore decreases,
    and the result does not depend on an initial guess.

    Parameters
    ----------
    coarse : Distribution
        On the grid, with kernel columns ``matrix`` (T, n).
    still : int
        The number of final columns that do not belong to the grid and are not refined.
    """
    spacing = float(np.sqrt(4.0 * np.pi / np.bincount(coarse.which).max()))
    solution = coarse
    for level in range(LEVELS):
        kept = solution.areas > 0
        kept[len(coarse.areas) - still : len(coarse.areas)] = False
        around = _around(solution.normals[kept], 0.6 * spacing / 2**level)
        normals = np.concatenate([solution.normals[kept], around])
        which = np.concatenate([solution.which[kept], np.repeat(solution.which[kept], NEIGHBOURS)])
        more = columns(seen, normals, which, materials)
        solution = solve(
            seen,
            np.concatenate([coarse.normals, normals]),
            np.concatenate([coarse.which, which]),
            np.hstack([matrix, more]),
            start=solution,
        )
    light = solution.scale[seen.curve, None] * np.hstack([matrix, more]) * solution.areas
    worth = np.sum((light / seen.error[:, None]) ** 2, axis=0)
    kept = worth > min(SETTLED, 0.5 * worth.max())
    kept[len(coarse.areas) - still : len(coarse.areas)] = still > 0
    return Distribution(
        solution.normals[kept],
        solution.which[kept],
        solution.areas[kept],
        solution.scale,
        solution.flux,
        solution.chi2,
    )


def _around(normals: Floats, angle: float) -> Floats:
    """Six directions about each normal, (6n, 3), grouped by normal."""
    u, v = across(normals)
    turn = 2.0 * np.pi * np.arange(NEIGHBOURS)[:, None] / NEIGHBOURS
    ring = np.cos(turn) * u[:, None] + np.sin(turn) * v[:, None]
    return (np.cos(angle) * normals[:, None] + np.sin(angle) * ring).reshape(-1, 3)


def select_facets(
    seen: Observed,
    fine: Distribution,
    materials: Sequence[Material] = (LAMBERTIAN,),
    cost: float | None = None,
) -> Facets:
    """Selection of facets: close facets are merged and insignificant ones are removed.

    The function minimises χ² + cost × number of facets. All facets of one material within each of
    `RADII` are merged (average linkage), and normals and areas are optimised each time for the
    least χ² (Levenberg-Marquardt in the area vectors αn). Facets whose removal raises χ² little are
    then removed, as long as the sum decreases.

    Parameters
    ----------
    fine : Distribution
        From `refine`, or on a grid.
    cost : float
        The least reduction of χ² per facet. Default: 3 ln T, for three parameters in the Bayesian
        information criterion (Schwarz 1978).

    Returns
    -------
    Facets
    """
    cost = 3.0 * float(np.log(len(seen.flux))) if cost is None else cost
    roughly = max(SETTLED, ROUGHLY * cost)
    merged = [_optimised(seen, *_merged(fine, r), fine.scale, materials, roughly) for r in RADII]
    best = min(merged, key=lambda solution: solution.chi2 + cost * len(solution.areas))
    for tolerance in (roughly, SETTLED):
        vectors = best.areas[:, None] * best.normals
        best = _optimised(seen, vectors, best.which, best.scale, materials, tolerance)
        while (solution := _without_one(seen, best, cost, materials, tolerance)) is not None:
            best = solution
    return best


def _without_one(
    seen: Observed, best: Facets, cost: float, materials: Sequence[Material], tolerance: float
) -> Facets | None:
    """The solution with one facet fewer, if removing one of the weakest lowers the total cost."""
    value = best.chi2 + cost * len(best.areas)
    vectors = best.areas[:, None] * best.normals
    for weakest in np.argsort(worth(best))[:TRIED]:
        kept = np.arange(len(vectors)) != weakest
        if not np.any(kept):
            break
        solution = _optimised(
            seen, vectors[kept], best.which[kept], best.scale, materials, tolerance
        )
        if solution.chi2 + cost * len(solution.areas) < value:
            return solution
    return None


def _merged(fine: Distribution, degrees: float) -> tuple[Floats, NDArray[np.integer]]:
    """Area vectors of facets merged within an angle, and their materials."""
    from scipy.cluster.hierarchy import fcluster, linkage

    vectors, which = [], []
    for m in np.unique(fine.which):
        here = fine.which == m
        normals, areas = fine.normals[here], fine.areas[here]
        group = np.ones(len(areas), int)
        if len(areas) > 1:
            reach = 2.0 * np.sin(np.radians(degrees) / 2.0)
            group = fcluster(linkage(normals, "average"), reach, "distance")
        for g in np.unique(group):
            total = areas[group == g] @ normals[group == g]
            vectors.append(areas[group == g].sum() * total / np.linalg.norm(total))
            which.append(m)
    return np.array(vectors), np.array(which)


def worth(solution: Facets) -> Floats:
    """Increase of χ² on removal of each facet, to second order: wᵢᵀ Cᵢᵢ⁻¹ wᵢ."""
    vectors = solution.areas[:, None] * solution.normals
    own = np.einsum("iaib->iab", solution.covariance)
    return np.einsum("ia,iab,ib->i", vectors, np.linalg.pinv(own, hermitian=True), vectors)


def _optimised(
    seen: Observed,
    vectors: Floats,
    which: NDArray[np.integer],
    scale: Floats,
    materials: Sequence[Material],
    tolerance: float,
) -> Facets:
    """The least χ² near these area vectors, by Levenberg-Marquardt, until two successive steps gain
    less than ``tolerance`` in χ²."""
    n = len(vectors)

    def model(parameters: Floats) -> Quadratic:
        every = np.ones(len(seen.free))
        every[seen.free] = parameters[3 * n :]
        solution, jacobian, residual = linear(
            seen, parameters[: 3 * n].reshape(n, 3), which, every, materials
        )
        return gauss_newton(-residual, jacobian, (solution, jacobian))

    end = levenberg_marquardt(
        model,
        np.concatenate([vectors.ravel(), scale[seen.free]]),
        num_steps=MAX_STEPS,
        tolerance=0.5 * tolerance,  # of χ²/2
        damping=1e-3,
        controls=CONTROLS,
    )
    solution, jacobian = end.model.aux
    vectors = solution.areas[:, None] * solution.normals
    # a step may move a facet to where it is never lit and seen, and the gradient vanishes
    light = np.einsum("tia,ia->ti", jacobian[:, : 3 * n].reshape(-1, n, 3), vectors)
    kept = np.sum(light**2, axis=0) > SETTLED
    if np.any(kept) and not np.all(kept):
        return _optimised(seen, vectors[kept], which[kept], solution.scale, materials, tolerance)
    return _with_covariance(seen, solution, jacobian)


def _sizes(normal: Floats) -> Floats:
    """Units in which all parameters of a normal matrix have similar scales."""
    own = np.diag(normal)
    return np.sqrt(np.maximum(own, max(1e-12 * own.mean(), 1e-300)))


def linear(
    seen: Observed,
    vectors: Floats,
    which: NDArray[np.integer],
    scale: Floats,
    materials: Sequence[Material],
) -> tuple[Distribution, Floats, Floats]:
    """Model, Jacobian and residual, in units of the errors, at area vectors w = αn (n, 3).

    f = s Σ |w| K(n); ∂f/∂w = s [K n + (1 − n nᵀ) ∂K/∂n]. The parametrisation is smooth and
    unbounded, because an area that shrinks to zero has no direction. In the parameter vector, free
    scales come after the area vectors.

    Returns
    -------
    Distribution
    jacobian : (T, 3n + free scales)
    residual : (T,)
        (f − model)/σ.
    """
    areas = np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)
    normals = vectors / areas[:, None]
    value, slope = slopes(seen, normals, which, materials)
    by = value[:, :, None] * normals + slope
    by -= np.sum(slope * normals, axis=2, keepdims=True) * normals
    of, model = scale[seen.curve], value @ areas
    by_scale = np.where(seen.curve[:, None] == np.flatnonzero(seen.free), model[:, None], 0.0)
    jacobian = np.hstack([of[:, None] * by.reshape(len(model), -1), by_scale])
    residual = (seen.flux - of * model) / seen.error
    chi2 = float(residual @ residual)
    solution = Distribution(normals, which, areas, scale, of * model, chi2)
    return solution, jacobian / seen.error[:, None], residual


def held(seen: Observed, count: int) -> Floats:
    """Row (count,) that fixes the mean scale if all are free, because only αs is determined."""
    row = np.zeros(count)
    if np.all(seen.free):
        row[-len(seen.free) :] = GAUGE / len(seen.free)
    return row


def _with_covariance(seen: Observed, solution: Distribution, jacobian: Floats) -> Facets:
    n, count = len(solution.areas), jacobian.shape[1]
    areas, scale = solution.areas, solution.scale
    normal = jacobian.T @ jacobian
    row = held(seen, count)
    normal += np.outer(row, row) * np.trace(normal) / count
    if np.all(seen.free):
        areas, scale = areas * scale.mean(), scale / scale.mean()
    size = _sizes(normal)
    value, vector = np.linalg.eigh(normal / np.outer(size, size))
    vector /= size[:, None]  # undetermined directions have a large variance, not zero
    covariance = (vector / np.maximum(value, LEAST * value[-1])) @ vector.T
    covariance = covariance[: 3 * n, : 3 * n].reshape(n, 3, n, 3)
    return Facets(
        solution.normals, solution.which, areas, scale, solution.flux, solution.chi2, covariance
    )
