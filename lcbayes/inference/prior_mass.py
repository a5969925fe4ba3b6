"""How much of a prior its factors leave: what makes evidences of different models comparable."""

from __future__ import annotations

from functools import partial

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.bridge import LogEvidence

BATCH = 4096
MAX_BATCHES = 64
RELATIVE_ERROR = 0.01  # relative error of the mass at which to stop


@partial(jax.jit, static_argnums=0)
def _factors(problem: Problem, data: Epochs, keys: jax.Array) -> jax.Array:
    """ln of all that multiplies the prior, at a draw from it for each key (n,)."""

    def one(key: jax.Array) -> jax.Array:
        return problem.log_factors(problem.prior_draw(key, data), data)

    return jax.lax.map(one, keys, batch_size=64)


@partial(jax.jit, static_argnums=0)
def _drawn(problem: Problem, data: Epochs, keys: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A draw from the prior for each key, and whether its factors keep it."""

    def one(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        key_draw, key_keep = jax.random.split(key)
        z = problem.prior_draw(key_draw, data)
        return z, jnp.log(jax.random.uniform(key_keep)) < problem.log_factors(z, data)

    return jax.lax.map(one, keys, batch_size=64)


def accepted(problem: Problem, data: Epochs, key: jax.Array, n: int) -> jax.Array:
    """n draws (n, D) from the prior with its factors, which are at most one: by rejection.

    Raises
    ------
    InputError
        If the factors keep fewer of 16,384 draws.
    """
    found = jnp.zeros((0, problem.dim))
    for i in range(MAX_BATCHES):
        keys = jax.random.split(jax.random.fold_in(key, i), 256)
        z, kept = _drawn(problem, data, keys)
        found = jnp.concatenate([found, z[np.asarray(kept)]])
        if len(found) >= n:
            return found[:n]
    raise InputError(
        f"the factors of the prior keep {len(found)} of {MAX_BATCHES * 256} draws; {n} are wanted"
    )


def log_prior_mass(problem: Problem, data: Epochs, key: jax.Array) -> LogEvidence:
    """ln ∫ p₀(z) f(z) dz of the prior p₀ and the model's factors f, with its error.

    A model may multiply its prior by factors: every facet is lit and seen, reflectances do not
    exceed one. p₀ f does not integrate to one then. Within one model that is of no account, but it
    lowers the evidence of N facets by about qᴺ, with q the chance that a facet of the prior is
    seen: enough to decide between N and N + 1 where the body turns little. The evidence under the
    prior *given* that all facets are seen is Z over this mass.

    By the mean of f over draws from p₀, until its error is 1 %, or 262,144 draws.
    """
    weights = np.zeros(0)
    mean = error = np.nan
    for i in range(MAX_BATCHES):
        keys = jax.random.split(jax.random.fold_in(key, i), BATCH)
        weights = np.append(weights, np.exp(np.asarray(_factors(problem, data, keys))))
        mean = weights.mean()
        error = weights.std() / np.sqrt(weights.size)
        if error <= RELATIVE_ERROR * mean and mean > 0:
            break
    with np.errstate(divide="ignore", invalid="ignore"):
        return LogEvidence(float(np.log(mean)), float(error / mean))
