"""Bodies at given motions of each arc: non-negative albedo-areas on a grid of normals.

Brightness is linear in the areas, so that they are eliminated (variable projection). What remains
to be improved is the pole, the rate within the arcs, and the phase of each arc. Leaving the phases
free relaxes a constant spin: spins that differ by whole turns between arcs are one state, and the
χ² of a state is a lower bound for all of them. The number of states does not grow with the time
between arcs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import each, together
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import Controls, Quadratic, levenberg_marquardt
from lcbayes.core.threads import threads
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.series import frame
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

NNLS_STEPS = 30
NNLS_TOLERANCE = 0.01  # of ½ χ²
TOLERANCE = 0.05  # of ½ χ², below which two steps in succession end an improvement
PATIENT = Controls(patience=2)
BATCH = 8, 2048  # motions at once, on a CPU and on an accelerator


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
    report: Callable[[int], None],
) -> States:
    """The best free body of each state, with the state improved by Gauss-Newton steps.

    Minimises Σ (F − Σ α K)²/σ² over albedo-areas α ≥ 0 of facets of the given normals (M, 3), the
    pole (n, 3), rate (n,) and phases (n, A) of ``motion``. Areas follow each step, with a weak
    penalty (α/``area_sd``)²: without it, facets that hardly receive light grow without limit.
    ``report`` is called with the number of states that are done.
    """
    grid, size = jnp.asarray(normals), together(*BATCH)

    def some(rows: NDArray[np.int64]) -> States:
        padded = np.resize(rows, size)
        at = (jnp.asarray(x[padded]) for x in motion)
        columns = _improved(law, grid, arcs, *at, area_sd, steps)
        report(rows.size)
        return States(*(np.asarray(x)[: rows.size] for x in columns))

    rows = np.arange(len(motion[1]))
    with threads(workers) as pool:
        parts = list(pool.map(some, (rows[i : i + size] for i in range(0, rows.size, size))))
    return States(*(np.concatenate(x) for x in zip(*parts, strict=True)))


class _Motion(NamedTuple):
    """Pole (3,), rate (scalar) and phases (A,) of one state."""

    pole: jax.Array
    rate: jax.Array
    phase: jax.Array


@partial(jax.jit, static_argnums=0)
def _improved(law: DiffuseLaw, grid, arcs: Arcs, pole, rate, phase, area_sd, steps):
    unit = 1.0 / jnp.maximum(jnp.max(jnp.abs(arcs.dt)), 1e-9)  # of the rate, so that steps are rad

    def one(motion: _Motion):
        end = levenberg_marquardt(
            lambda m: _eliminated(law, grid, arcs, m, area_sd, unit),
            motion,
            num_steps=steps,
            tolerance=TOLERANCE,
            controls=PATIENT,
            move=lambda m, step: _moved(m, step, unit),
        )
        units = jnp.ones(1 + len(phase[0])).at[0].set(1.0 / unit)
        information = _without_pole(end.model.curvature) * units * units[:, None]
        return *end.position, end.model.aux, 2.0 * end.model.value, information

    return each(one, _Motion(pole, rate, phase))


def _eliminated(law: DiffuseLaw, grid, arcs: Arcs, motion: _Motion, area_sd, unit) -> Quadratic:
    """½ χ² of the best areas (M,), which are ``aux``, and its derivatives by tilt, rate and phases.

    The derivatives are those of the misfit with the part removed that a change of the positive
    areas makes up for.
    """
    angle = (motion.rate * arcs.dt + motion.phase[:, None]).ravel()
    white = arcs.white.ravel()
    weak = jnp.eye(len(grid)) / area_sd**2
    design = design_matrix(law, grid, arcs, motion.pole, angle)
    area = _nonnegative(design.T @ design + weak, design.T @ white)
    misfit = white - design @ area

    def brightness(tilt: jax.Array, turn: jax.Array) -> jax.Array:
        return design_matrix(law, grid, arcs, _tilted(motion.pole, tilt), angle + turn) @ area

    zero, still = jnp.zeros(2), jnp.zeros(white.size)
    by_tilt = [jax.jvp(lambda x: brightness(x, still), (zero,), (e,))[1] for e in jnp.eye(2)]
    by_angle = jax.jvp(lambda x: brightness(zero, x), (still,), (jnp.ones_like(still),))[1]
    member = jnp.repeat(jnp.eye(len(arcs.dt)), arcs.dt.shape[1], axis=0)  # (T, A)
    columns = [*by_tilt, by_angle * arcs.dt.ravel() * unit, *(by_angle * member.T), misfit]
    every = jnp.stack(columns, axis=1)
    active = jnp.where(area > 0.0, design, 0.0)
    small = 1e-9 * jnp.max(jnp.sum(active**2, axis=0)) * jnp.eye(len(grid))
    factor = jax.scipy.linalg.cho_factor(active.T @ active + weak + small)
    free = every - active @ jax.scipy.linalg.cho_solve(factor, active.T @ every)
    slope, rest = free[:, :-1], free[:, -1]
    value = 0.5 * (misfit @ misfit + area @ weak @ area)
    return Quadratic(value, -(slope.T @ rest), slope.T @ slope, area)


def design_matrix(
    law: DiffuseLaw, grid, arcs: Arcs, pole: jax.Array, angle: jax.Array
) -> jax.Array:
    """Weighted brightness (T, M) of unit areas of a body turned by angles (T,) about the pole.

    In the precision of the grid.
    """
    axes, c, s = frame(pole), jnp.cos(angle), jnp.sin(angle)

    def turned(vectors: jax.Array) -> jax.Array:
        x, y, z = (vectors.reshape(-1, 3) @ axes).T
        return jnp.stack([c * x + s * y, c * y - s * x, z], axis=1).astype(grid.dtype)

    mu0, mu = turned(arcs.sun) @ grid.T, turned(arcs.obs) @ grid.T
    weight = arcs.weight.reshape(-1, 1).astype(grid.dtype)
    return diffuse_kernel(law, mu0, mu, LAMBERT_C)[0] * weight


def _tilted(pole: jax.Array, tilt: jax.Array) -> jax.Array:
    moved = pole + frame(pole)[:, :2] @ tilt
    return moved / jnp.linalg.norm(moved)


def _moved(motion: _Motion, step: jax.Array, unit: jax.Array) -> _Motion:
    """A motion after a step (3 + A,) in tilt (2), rate and phases."""
    rate = motion.rate + step[2] * unit
    return _Motion(_tilted(motion.pole, step[:2]), rate, motion.phase + step[3:])


def _without_pole(information: jax.Array) -> jax.Array:
    """Information (1 + A, 1 + A) of rate and phases, the tilt of the pole being free."""
    tilt = information[:2, :2]
    tilt = tilt + (1e-9 * jnp.trace(tilt) + 1e-300) * jnp.eye(2)
    cross = information[2:, :2]
    return information[2:, 2:] - cross @ jnp.linalg.solve(tilt, cross.T)


def _nonnegative(matrix: jax.Array, vector: jax.Array) -> jax.Array:
    """x ≥ 0 that minimises ½ xᵀ M x − vᵀ x, by a primal-dual interior-point method.

    Neighbouring normals have nearly the same brightness: gradient methods take thousands of steps
    on such a matrix, and this one some ten factorisations. Facets without light are exactly 0.

    References
    ----------
    Mehrotra 1992, SIAM J. Optim. 2, 575 (predictor and corrector from one factorisation).
    """
    scale = 1.0 / jnp.sqrt(jnp.diagonal(matrix) + 1e-300)
    matrix, vector = matrix * scale * scale[:, None], vector * scale
    size = jnp.maximum(jnp.max(jnp.abs(vector)), 1e-300)
    vector = vector / size

    def unfinished(carry):
        x, z, step = carry
        return (step < NNLS_STEPS) & (x @ z * size**2 > NNLS_TOLERANCE)  # the duality gap

    def body(carry):
        x, z, step = carry
        gap = matrix @ x - vector - z
        factor = jax.scipy.linalg.cho_factor(matrix + jnp.diag(z / x))

        def moves(target: jax.Array) -> tuple[jax.Array, jax.Array]:
            """Changes of x and z for which, to first order, the gap is 0 and x z is ``target``."""
            dx = jax.scipy.linalg.cho_solve(factor, (target - x * z) / x - gap)
            return dx, (target - x * z - z * dx) / x

        dx, dz = moves(jnp.zeros_like(x))
        reach = _inside(x, dx, z, dz)
        mean = jnp.mean(x * z)
        centre = (jnp.mean((x + reach * dx) * (z + reach * dz)) / mean) ** 3 * mean
        dx, dz = moves(centre - dx * dz)
        reach = 0.995 * _inside(x, dx, z, dz)
        return x + reach * dx, z + reach * dz, step + 1

    one = jnp.ones_like(vector)
    x, z, _ = jax.lax.while_loop(unfinished, body, (one, one, 0))
    return jnp.where(x > z, x, 0.0) * size * scale


def _inside(x: jax.Array, dx: jax.Array, z: jax.Array, dz: jax.Array) -> jax.Array:
    """The longest step, at most 1, that keeps x and z non-negative."""
    ratio = jnp.concatenate([jnp.where(dx < 0, -x / dx, 1.0), jnp.where(dz < 0, -z / dz, 1.0)])
    return jnp.minimum(1.0, jnp.min(ratio))
