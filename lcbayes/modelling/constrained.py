"""Draws in the units of the model, the quantities that a result reports, and their density."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from jax.core import Tracer
from numpy.typing import NDArray

from lcbayes.core.blocks import ROWS, on_all_cores
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unwrapped
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import FLUX, OUTLIER
from lcbayes.modelling.nutation import RESPONSE
from lcbayes.modelling.problem import LIT, OBS, SUN, Problem, with_lit
from lcbayes.modelling.recorded import Sites
from lcbayes.modelling.variables import reported
from lcbayes.physics.bodies.lit import Lit

Floats = NDArray[np.float64]

PER_EPOCH = ("expected", FLUX, OUTLIER, SUN, OBS, LIT, RESPONSE)
SHADED = 1_000_000  # polygons times epochs in a block of draws of a body with shadows
VALUES = 10_000  # epochs times draws in one batch, so that its arrays stay in the cache
CIRCLES = {"phi": 2 * np.pi, "pole_lon_deg": 360.0}


def over_draws(
    program: Callable[..., Any],
    problem: Problem,
    z: Floats | jax.Array,
    data: Epochs,
    *others: Any,
) -> Any:
    """``program(rows, data, lit, *others)`` of draws (n, D), in blocks on all cores.

    It must be compiled. ``lit`` is `lit_of_draws`, for `with_lit` of each row. While the caller is
    traced for its shapes, it is one program.
    """
    if isinstance(z, Tracer):
        return program(z, data, None, *others)

    def block(rows: Floats, *more: Any) -> Any:
        return program(rows, data, lit_of_draws(problem, jnp.asarray(rows), data), *more)

    size = ROWS
    if problem.shading is not None:
        size = int(np.clip(SHADED // (data.t.size * problem.shading.polygons), 1, 32))
    return on_all_cores(block, np.asarray(z), *others, size=size)


def lit_of_draws(problem: Problem, rows: jax.Array, data: Epochs) -> Lit | None:
    """`lit_at` of draws (n, D), fixed and stacked; None where a program computes it."""
    if problem.shading is None or data.lit is not None or data.expansion is not None:
        return None
    if data.has_exposure:
        return None
    sun, obs = _directions(problem, rows, data)
    lit = problem.shading.about(sun.reshape(-1, 3), obs.reshape(-1, 3), slopes=False)
    fraction = lit.fraction.reshape(*sun.shape[:2], -1)
    return Lit(fraction, jax.tree.map(lambda x: jnp.tile(x, (len(rows), 1)), lit.polygon))


@partial(jax.jit, static_argnums=0)
def _directions(problem: Problem, rows: jax.Array, data: Epochs) -> tuple[jax.Array, jax.Array]:
    return jax.lax.map(lambda row: problem.directions(row, data), rows)


def constrain_draws(problem: Problem, z: Floats, data: Epochs) -> dict[str, NDArray]:
    """Every site at draws z (C, S, D), except sites with one value per epoch."""
    flat = z.reshape(-1, z.shape[-1])
    sites = over_draws(partial(_constrained, problem), problem, flat, data)
    return {k: v.reshape(*z.shape[:2], *v.shape[1:]) for k, v in sites.items()}


def without_epochs(sites: Sites) -> Sites:
    """The sites without those that have one value per epoch."""
    return {k: v for k, v in sites.items() if k not in PER_EPOCH}


def potentials(problem: Problem, z: Floats, data: Epochs) -> Floats:
    """−ln p(y, z) for rows (n, D), as (n,)."""
    return over_draws(partial(_potentials, problem), problem, z, data)


def reported_draws(draws: Mapping[str, NDArray]) -> dict[str, Floats]:
    """Draws (C, S, ...) of the reported variables, each angle within half a turn of its mean."""
    shown = {k: np.asarray(draws[k], float) for k in reported(draws)}
    circles = {k: unwrapped(shown[k], CIRCLES[k], axis=(0, 1)) for k in shown.keys() & CIRCLES}
    return shown | circles


def quantities(problem: Problem, z: Floats, data: Epochs) -> Floats:
    """Every scalar (C, S, Q) that a result reports, at draws z (C, S, D)."""
    shown = reported_draws(constrain_draws(problem, z, data))
    return np.concatenate([v.reshape(*z.shape[:2], -1) for v in shown.values()], axis=2)


@partial(jax.jit, static_argnums=0)
def _potentials(problem: Problem, rows: Floats, data: Epochs, lit: Lit | None) -> jax.Array:
    def one(args: tuple[jax.Array, Lit | None]) -> jax.Array:
        return problem.potential(args[0], with_lit(data, args[1]))

    return jax.lax.map(one, (jnp.asarray(rows), lit))


@partial(jax.jit, static_argnums=0)
def _constrained(problem: Problem, rows: Floats, data: Epochs, lit: Lit | None) -> Sites:
    def one(args: tuple[jax.Array, Lit | None]) -> Sites:
        return without_epochs(problem.constrain(args[0], with_lit(data, args[1])))

    together = int(np.clip(VALUES // data.t.size, 1, 32))
    return jax.lax.map(one, (jnp.asarray(rows), lit), batch_size=together)
