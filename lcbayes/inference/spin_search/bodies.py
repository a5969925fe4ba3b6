"""Bodies at given motions of each arc: non-negative albedo-areas on a grid of normals.

Brightness is linear in the areas, so that they are eliminated (variable projection). What remains
to be improved is the pole, the rate within the arcs, and the phase of each arc. Leaving the phases
free relaxes a constant spin: spins that differ by whole turns between arcs are one state, and the
χ² of a state is a lower bound for all of them. The number of states does not grow with the time
between arcs.
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.threads import threads
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.series import frame
from lcbayes.physics.brightness import DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

NNLS_STEPS = 120
LAMBERT_C = 0.1
BATCH = 8
LLOYD_STEPS = 3


class States(NamedTuple):
    """Motions of each arc, with a free body on a grid of normals.

    Attributes
    ----------
    pole : (n, 3)
    rate : (n,) rad/s
        Within the arcs.
    phase : (n, A) rad
        Of the body at the middle of each arc, about the pole.
    areas : (n, M) m²
        Of facets whose normals are given in the axes of `series.frame` of the pole, turned by the
        phase.
    chi2 : (n,)
    information : (n, 1 + A, 1 + A)
        Of rate (rad/s) and phases, with pole and areas eliminated.
    """

    pole: Floats
    rate: Floats
    phase: Floats
    areas: Floats
    chi2: Floats
    information: Floats

    def at(self, rows: NDArray[np.int64]) -> States:
        """Some of the states."""
        return States(*(x[rows] for x in self))


def improved(
    arcs: Arcs,
    motion: tuple[Floats, Floats, Floats],
    law: DiffuseLaw,
    normals: Floats,
    *,
    area_sd: float,
    steps: int,
    workers: int,
) -> States:
    """The best free body of each state, with the state improved by Gauss-Newton steps.

    Minimises Σ (F − Σ α K)²/σ² over albedo-areas α ≥ 0 of facets of the given normals (M, 3), the
    pole (n, 3), rate (n,) and phases (n, A) of ``motion``. Areas follow each step, with a weak
    penalty (α/``area_sd``)²: without it, facets that hardly receive light grow without limit.
    """
    grid = jnp.asarray(normals)

    def some(rows: NDArray[np.int64]) -> States:
        padded = np.resize(rows, BATCH)
        at = (jnp.asarray(x[padded]) for x in motion)
        found = _improved(law, grid, arcs, *at, area_sd, steps)
        return States(*(np.asarray(x)[: rows.size] for x in found))

    rows = np.arange(len(motion[1]))
    with threads(workers) as pool:
        parts = list(pool.map(some, (rows[i : i + BATCH] for i in range(0, rows.size, BATCH))))
    return States(*(np.concatenate(x) for x in zip(*parts, strict=True)))


@partial(jax.jit, static_argnums=0)
def _improved(law: DiffuseLaw, grid, arcs: Arcs, pole, rate, phase, area_sd, steps):
    n_arcs, n_points = arcs.dt.shape
    weight, white = arcs.weight.ravel(), arcs.white.ravel()
    sun, obs = arcs.sun.reshape(-1, 3), arcs.obs.reshape(-1, 3)
    unit = 1.0 / jnp.maximum(jnp.max(jnp.abs(arcs.dt)), 1e-9)  # of the rate
    weak = jnp.eye(len(grid)) / area_sd**2
    member = jnp.repeat(jnp.eye(n_arcs), n_points, axis=0)  # (T, A)

    def design(pole, angle):
        axes = frame(pole)
        c, s = jnp.cos(angle), jnp.sin(angle)

        def turned(v):
            x, y, z = (v @ axes).T
            return jnp.stack([c * x + s * y, c * y - s * x, z], axis=1)

        kernel = diffuse_kernel(law, turned(sun) @ grid.T, turned(obs) @ grid.T, LAMBERT_C)[0]
        return kernel * weight[:, None]

    def angles(rate, phase):
        return (rate * arcs.dt + phase[:, None]).ravel()

    def solved(pole, rate, phase, start):
        matrix = design(pole, angles(rate, phase))
        area = _nonnegative(matrix.T @ matrix + weak, matrix.T @ white, start)
        misfit = white - matrix @ area
        return area, misfit, matrix, misfit @ misfit + area @ weak @ area

    def moved(pole, tilt):
        new = pole + frame(pole)[:, :2] @ tilt
        return new / jnp.linalg.norm(new)

    def slopes(pole, rate, phase, area, matrix, misfit):
        """Derivatives (T, 3 + A) by tilt, rate and phases, and the misfit, free of the areas."""

        def brightness(tilt, turn):
            return design(moved(pole, tilt), angles(rate, phase) + turn) @ area

        zero = jnp.zeros(2)
        flat = jnp.zeros(weight.size)
        by_tilt = [jax.jvp(lambda x: brightness(x, flat), (zero,), (e,))[1] for e in jnp.eye(2)]
        by_angle = jax.jvp(lambda x: brightness(zero, x), (flat,), (jnp.ones_like(flat),))[1]
        columns = [*by_tilt, by_angle * arcs.dt.ravel() * unit]
        columns += [by_angle * member[:, k] for k in range(n_arcs)]
        every = jnp.stack([*columns, misfit], axis=1)
        active = jnp.where(area > 0.0, matrix, 0.0)
        small = 1e-9 * jnp.max(jnp.sum(active**2, axis=0)) * jnp.eye(len(grid))
        factor = jax.scipy.linalg.cho_factor(active.T @ active + weak + small)
        return every - active @ jax.scipy.linalg.cho_solve(factor, active.T @ every), every

    def one(cell):
        pole, rate, phase = cell
        area, _, _, value = solved(pole, rate, phase, jnp.zeros(len(grid)))

        def body(_, carry):
            pole, rate, phase, area, value, damping = carry
            area, misfit, matrix, _ = solved(pole, rate, phase, area)
            free, every = slopes(pole, rate, phase, area, matrix, misfit)
            slope, rest = free[:, :-1], free[:, -1]
            scale = jnp.sum(every[:, :-1] ** 2, axis=0)
            normal = slope.T @ slope + jnp.diag(damping * scale + 1e-9 * jnp.max(scale))
            step = jnp.linalg.solve(normal, slope.T @ rest)
            trial = moved(pole, step[:2]), rate + step[2] * unit, phase + step[3:]
            new_area, _, _, new = solved(*trial, area)
            better = new < value

            def choose(a, b):
                return jnp.where(better, a, b)

            return (
                *(choose(a, b) for a, b in zip(trial, (pole, rate, phase), strict=True)),
                choose(new_area, area),
                choose(new, value),
                choose(damping * 0.2, damping * 5.0),
            )

        start = (pole, rate, phase, area, value, jnp.asarray(1e-2))
        pole, rate, phase, area, value, _ = jax.lax.fori_loop(0, steps, body, start)
        area, misfit, matrix, _ = solved(pole, rate, phase, area)
        slope = slopes(pole, rate, phase, area, matrix, misfit)[0][:, :-1]
        q = slope.T @ slope
        tilt = q[:2, :2] + 1e-9 * jnp.trace(q[:2, :2]) * jnp.eye(2) + 1e-300 * jnp.eye(2)
        reduced = q[2:, 2:] - q[2:, :2] @ jnp.linalg.solve(tilt, q[:2, 2:])
        units = jnp.ones(1 + n_arcs).at[0].set(1.0 / unit)
        return pole, rate, phase, area, value, reduced * units * units[:, None]

    return jax.lax.map(one, (pole, rate, phase))


def _nonnegative(matrix: jax.Array, vector: jax.Array, start: jax.Array) -> jax.Array:
    """x ≥ 0 that minimises ½ xᵀ M x − vᵀ x, by accelerated projected gradient with restarts.

    References
    ----------
    Beck & Teboulle 2009, SIAM J. Imaging Sci. 2, 183; O'Donoghue & Candès 2015 (restarts).
    """
    scale = 1.0 / jnp.sqrt(jnp.diagonal(matrix) + 1e-300)  # unit columns converge faster
    matrix, vector = matrix * scale * scale[:, None], vector * scale
    step = 1.0 / jnp.max(jnp.sum(jnp.abs(matrix), axis=1))

    def body(_, carry):
        x, y, momentum = carry
        slope = matrix @ y - vector
        new = jnp.maximum(y - step * slope, 0.0)
        again = slope @ (new - x) > 0.0
        momentum = jnp.where(again, 1.0, momentum)
        following = 0.5 * (1.0 + jnp.sqrt(1.0 + 4.0 * momentum**2))
        beyond = jnp.where(again, new, new + (momentum - 1.0) / following * (new - x))
        return new, beyond, following

    x = start / scale
    return scale * jax.lax.fori_loop(0, NNLS_STEPS, body, (x, x, jnp.ones(())))[0]


def clustered(
    normals: Floats, areas: Floats, n_facets: int, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """N facets, normals (N, 3) and areas (N,), from normals (M, 3) and areas (M,) of a free body.

    Spherical k-means of the normals, weighted by area, from seeds drawn as in k-means++. Different
    draws give different facets.

    References
    ----------
    Arthur & Vassilvitskii 2007, Proc. SODA, 1027.
    """
    inside = areas > 1e-3 * areas.max()
    weight, points = areas[inside], normals[inside]
    centres = points[[rng.choice(len(weight), p=weight / weight.sum())]]
    while len(centres) < n_facets:
        far = weight * (1.0 - (points @ centres.T).max(axis=1)).clip(1e-9)
        centres = np.vstack([centres, points[rng.choice(len(weight), p=far / far.sum())]])
    for _ in range(LLOYD_STEPS):
        nearest = np.argmax(points @ centres.T, axis=1)
        total = np.zeros((n_facets, 3))
        np.add.at(total, nearest, weight[:, None] * points)
        length = np.linalg.norm(total, axis=1, keepdims=True)
        centres = np.where(length > 1e-12, total / np.maximum(length, 1e-12), centres)
    sizes = np.bincount(nearest, weight, n_facets)
    return centres, np.maximum(sizes, 0.02 * sizes.max())
