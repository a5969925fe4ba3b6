"""Draws in the units of the model, the quantities that a result reports, and their density."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import on_all_cores
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unwrapped
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.likelihood import FLUX, OUTLIER
from lcbayes.modelling.nutation import RESPONSE
from lcbayes.modelling.problem import LIT, OBS, SUN, Problem, Sites
from lcbayes.modelling.variables import reported

Floats = NDArray[np.float64]

PER_EPOCH = ("expected", FLUX, OUTLIER, SUN, OBS, LIT, RESPONSE)
VALUES = 10_000  # epochs times draws in one batch, so that its arrays stay in the cache
CIRCLES = {"phi": 2 * np.pi, "pole_lon_deg": 360.0}


def constrain_draws(problem: Problem, z: Floats, data: Epochs) -> dict[str, NDArray]:
    """Every site at draws z (C, S, D), except sites with one value per epoch."""
    flat = z.reshape(-1, z.shape[-1])
    sites = on_all_cores(lambda rows: _constrained(problem, rows, data), flat)
    return {k: v.reshape(*z.shape[:2], *v.shape[1:]) for k, v in sites.items()}


def without_epochs(sites: Sites) -> Sites:
    """The sites without those that have one value per epoch."""
    return {k: v for k, v in sites.items() if k not in PER_EPOCH}


def potentials(problem: Problem, z: Floats, data: Epochs) -> Floats:
    """−ln p(y, z) for rows (n, D), as (n,)."""
    return on_all_cores(lambda rows: _potentials(problem, rows, data), z)


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
def _potentials(problem: Problem, rows: Floats, data: Epochs) -> jax.Array:
    return jax.lax.map(lambda row: problem.potential(row, data), jnp.asarray(rows))


@partial(jax.jit, static_argnums=0)
def _constrained(problem: Problem, rows: Floats, data: Epochs) -> Sites:
    def one(row: jax.Array) -> Sites:
        return without_epochs(problem.constrain(row, data))

    together = int(np.clip(VALUES // data.t.size, 1, 32))
    return jax.lax.map(one, jnp.asarray(rows), batch_size=together)
