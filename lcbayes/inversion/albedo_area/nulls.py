"""Null distributions for cues: solutions for bodies without the feature under test.

Non-negative least squares produces spikes for any body. Spikes, arcs and uniform regions can
therefore only be identified by comparison. Bodies of known shape are simulated at the same epochs
with the same errors, and their light curves are inverted with the same method.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.progress import Track
from lcbayes.inversion.albedo_area.distribution import Distribution, solve, typical
from lcbayes.inversion.albedo_area.kernel import Material, columns
from lcbayes.inversion.albedo_area.observed import Observed

Floats = NDArray[np.float64]


def ellipsoid(seen: Observed, distribution: Distribution, matrix: Floats) -> Floats:
    """Albedo-areas (n,) of the best-fitting ellipsoid of uniform albedo, on the same normals.

    An ellipsoid {x: |D⁻¹x| = 1} has the area (det D)² |D n|⁻⁴ per solid angle of normals. Hence
    α ∝ (nᵀ Q n)⁻² with Q = L Lᵀ positive definite. The six parameters are fitted by
    Levenberg-Marquardt. Each material of the distribution keeps its share. Scales are those of
    ``distribution``.

    References
    ----------
    Schneider, *Convex Bodies*, sec. 2.5 (surface area measure and curvature).
    """
    from scipy.optimize import least_squares

    total = distribution.areas.sum() or 1.0
    share = np.bincount(distribution.which, distribution.areas / total)[distribution.which]
    rows = distribution.scale[seen.curve][:, None] * matrix * share / seen.error[:, None]
    target = seen.flux / seen.error
    n, lower = distribution.normals, np.tril_indices(3)

    def factors(parameters: Floats) -> tuple[Floats, Floats]:
        half = np.zeros((3, 3))
        half[lower] = parameters
        across = n @ half
        return across, np.sum(across**2, axis=1) ** -2.0

    def residual(parameters: Floats) -> Floats:
        return rows @ factors(parameters)[1] - target

    def jacobian(parameters: Floats) -> Floats:
        across, areas = factors(parameters)
        by = -4.0 * areas**1.5  # derivative of (|Lᵀn|²)⁻² with respect to half of |Lᵀn|²
        return rows @ np.stack(
            [by * across[:, j] * n[:, i] for i, j in zip(*lower, strict=True)], axis=1
        )

    unit = typical(seen, matrix) * len(np.unique(distribution.which))
    start = unit**-0.25 * np.eye(3)[lower]
    best = least_squares(residual, start, jac=jacobian, x_scale=unit**-0.25, max_nfev=200)  # pyright: ignore[reportArgumentType]
    return share * factors(best.x)[1]


def smooth_bodies(
    seen: Observed, distribution: Distribution, matrix: Floats, n: int, seed: int, track: Track
) -> Floats:
    """Areas (n, N) inverted from n noisy light curves of the best-fitting ellipsoid."""
    areas = ellipsoid(seen, distribution, matrix)
    flux = matrix @ areas
    rng = np.random.default_rng(seed)
    return np.array([_again(seen, distribution, matrix, flux, rng, track) for _ in range(n)])


def scattered_facets(
    seen: Observed,
    distribution: Distribution,
    matrix: Floats,
    facets: Distribution,
    materials: Sequence[Material],
    n: int,
    seed: int,
    track: Track,
) -> Floats:
    """Areas (n, N) inverted from n noisy light curves of the same facets with random normals."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(n):
        normals = rng.normal(size=facets.normals.shape)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        flux = columns(seen, normals, facets.which, materials) @ facets.areas
        out.append(_again(seen, distribution, matrix, flux, rng, track))
    return np.array(out)


def _again(
    seen: Observed,
    distribution: Distribution,
    matrix: Floats,
    model: Floats,
    rng: np.random.Generator,
    track: Track,
) -> Floats:
    """Areas inverted from a light curve with this unscaled flux and new noise."""
    flux = distribution.scale[seen.curve] * model
    simulated = seen.with_flux(flux + seen.error * rng.normal(size=len(flux)))
    about = Distribution(
        distribution.normals,
        distribution.which,
        distribution.areas,
        distribution.scale,
        flux,
        np.inf,
    )
    again = solve(simulated, distribution.normals, distribution.which, matrix, start=about)
    track.advance(1)
    return again.areas
