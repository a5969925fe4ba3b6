"""Bootstrap uncertainty of a distribution, from solutions for resampled curves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.inversion.albedo_area import nnls
from lcbayes.inversion.albedo_area.distribution import Distribution, Rows, linearised
from lcbayes.inversion.albedo_area.facets import Facets, held, linear
from lcbayes.inversion.albedo_area.kernel import Material
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski

Floats = NDArray[np.float64]

MIN_CURVES = 10  # with fewer, blocks within curves are resampled instead
CHUNK_BYTES = 2**28


def weights(seen: Observed, n: int, seed: int) -> Floats:
    """Number of times each point occurs in each of n resampled data sets, (n, T).

    With at least ten curves, whole curves are drawn with replacement, so that errors common to the
    points of a curve are taken into account. With fewer curves, blocks of about T_c^(1/3)
    consecutive points of each curve are drawn.

    References
    ----------
    Efron & Tibshirani 1993, *An Introduction to the Bootstrap*; Künsch 1989, Ann. Stat. 17, 1217
    (blocks; their length: Hall, Horowitz & Jing 1995, Biometrika 82, 561).
    """
    rng = np.random.default_rng(seed)
    count = len(seen.free)
    if count >= MIN_CURVES:
        drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=n)
        return drawn[:, seen.curve].astype(float)
    out = np.zeros((n, len(seen.flux)))
    for c in range(count):
        here = np.flatnonzero(seen.curve == c)
        blocks = max(1, round(len(here) / len(here) ** (1 / 3)))
        block = np.arange(len(here)) * blocks // len(here)
        drawn = rng.multinomial(blocks, np.full(blocks, 1.0 / blocks), size=n)
        out[:, here] = drawn[:, block]
    return out


def distributions(
    seen: Observed,
    best: Distribution,
    matrix: Floats,
    weight: Floats,
    penalties: Sequence[Rows] = (),
) -> Floats:
    """Areas (B, n) of a distribution on given normals, one set for each set of weights (B, T).

    Free scales are fitted together with the areas, linearised about the solution. An area that the
    data set to zero remains zero in most draws. Its spread shows how far noise raises it and is not
    a confidence interval.
    """
    extra = Rows(
        np.concatenate([p.matrix for p in penalties] or [np.zeros((0, len(best.areas)))]),
        np.concatenate([p.target for p in penalties] or [np.zeros(0)]),
    )
    rows, target = linearised(seen, matrix, best, extra)
    always = np.ones((len(weight), len(target) - len(seen.flux)))
    chunk = max(1, int(CHUNK_BYTES // (8 * rows.shape[1] ** 2)))
    draws = nnls.weighted(
        jnp.asarray(rows), jnp.asarray(target), jnp.asarray(np.hstack([weight, always])), chunk
    )
    return np.asarray(draws)[:, : len(best.areas)]


@dataclass(frozen=True)
class FacetDraws:
    """Resampled facets and the corresponding bodies.

    Attributes
    ----------
    vectors : (B, n, 3) m²
        Area vectors αn.
    volumes : (B',) m³
    dimensions : (B', 3) m
        Longest, middle and shortest, for those of the B draws that form a body.
    """

    vectors: Floats
    volumes: Floats
    dimensions: Floats


def facets(
    seen: Observed,
    best: Facets,
    materials: Sequence[Material],
    weight: Floats,
    albedo: float = 1.0,
) -> FacetDraws:
    """Refit of the few facets for each set of weights (B, T), by one Gauss-Newton step.

    The number of facets is fixed, as is the ``albedo`` by which areas are divided to form bodies.
    """
    n = len(best.areas)
    vectors = best.areas[:, None] * best.normals
    _, jacobian, residual = linear(seen, vectors, best.which, best.scale, materials)
    row = held(seen, jacobian.shape[1])
    draws = np.empty((len(weight), n, 3))
    for b, w in enumerate(weight):
        normal = (jacobian * w[:, None]).T @ jacobian
        normal += np.outer(row, row) * np.trace(normal) / len(row)
        step = np.linalg.pinv(normal, rcond=1e-12, hermitian=True) @ (jacobian.T @ (w * residual))
        draws[b] = vectors + step[: 3 * n].reshape(n, 3)
    volumes, dimensions = [], []
    for draw in draws:
        areas = np.linalg.norm(draw, axis=1)
        normals = draw / areas[:, None]
        try:
            body = minkowski(normals, close(normals, areas) / albedo)
        except InputError:
            continue
        volumes.append(body.volume)
        dimensions.append(np.sort(body.dimensions)[::-1])
    return FacetDraws(draws, np.array(volumes), np.array(dimensions).reshape(-1, 3))
