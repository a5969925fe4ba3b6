"""A prior with its factors: draws from it, and the mass that the factors leave of it."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.bridge import LogEvidence

Floats = NDArray[np.float64]
BATCH = 4096
MAX_BATCHES = 64
RELATIVE_ERROR = 0.01  # relative error of the mass at which to stop
MAX_TRIED = 16_384  # draws of the prior from which those with its factors are taken
MIN_EFFECTIVE = 100.0  # effective sample size that resampled draws must have


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


class PriorDraws(NamedTuple):
    """Draws from a prior with its factors.

    Attributes
    ----------
    z : (n, D)
    note : str
        How they were drawn, or that the factors could not be honoured; empty where there are none.
    honoured : bool
        Whether the draws follow the prior with its factors.
    """

    z: Floats
    note: str
    honoured: bool


def prior_sample(problem: Problem, data: Epochs, key: jax.Array, n: int) -> PriorDraws:
    """n draws from the prior with its factors f, by rejection: a draw z from the prior alone is
    kept with probability f(z)/max f.

    The largest f is taken as one, or as the largest seen where that is more. At most 16,384 draws
    of the prior are made. If the factors keep fewer than n of these, draws are resampled by
    weight with replacement, provided that their effective sample size is at least
    `MIN_EFFECTIVE`. Otherwise the factors are left out.

    References
    ----------
    Robert & Casella 2004, Monte Carlo Statistical Methods, secs. 2.3 and 14.3.5.
    """
    z, log_f = _tried(problem, data, jax.random.split(key, n))
    if not np.any(log_f):  # no factors
        return PriorDraws(z, "", honoured=True)
    while len(z) < MAX_TRIED:
        if len(kept := _kept(log_f, key)) >= n:
            break
        keys = jax.random.split(jax.random.fold_in(key, len(z)), n)
        more, log_more = _tried(problem, data, keys)
        z, log_f = np.concatenate([z, more]), np.concatenate([log_f, log_more])
    kept = _kept(log_f, key)
    if len(kept) >= n:
        share = f"{len(kept) / len(z):.2g}"
        return PriorDraws(z[kept[:n]], f"by rejection; the factors keep a share {share}", True)
    weight = np.exp(log_f - log_f.max()) if np.isfinite(log_f.max()) else np.zeros(len(z))
    effective = weight.sum() ** 2 / max(np.sum(weight**2), 1e-300)
    if effective >= MIN_EFFECTIVE:
        upto = np.cumsum(weight) / weight.sum()
        chosen = np.searchsorted(upto, (np.arange(n) + 0.5) / n)
        note = f"resampled by weight; effective sample size {effective:.0f}"
        return PriorDraws(z[np.minimum(chosen, len(z) - 1)], note, honoured=True)
    note = (
        f"the factors leave an effective sample size of {effective:.0f} of {len(z)} draws and are "
        "NOT in these draws"
    )
    return PriorDraws(z[:n], note, honoured=False)


def _tried(problem: Problem, data: Epochs, keys: jax.Array) -> tuple[Floats, Floats]:
    """A draw from the prior for each key (n, D), and ln of its factors, −∞ where undefined."""
    z, log_f = _weighed(problem, data, keys)
    return np.asarray(z), np.nan_to_num(np.asarray(log_f), nan=-np.inf, neginf=-np.inf)


def _kept(log_f: Floats, key: jax.Array) -> NDArray[np.int64]:
    """Indices of the draws that are kept, the same for the first ones however many follow."""
    seed = np.asarray(jax.random.key_data(key)).ravel()
    uniform = np.random.default_rng(seed).random(len(log_f))
    return np.flatnonzero(np.log(uniform) < log_f - max(0.0, float(np.max(log_f))))


@partial(jax.jit, static_argnums=0)
def _weighed(problem: Problem, data: Epochs, keys: jax.Array) -> tuple[jax.Array, jax.Array]:

    def one(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        z = problem.prior_draw(key, data)
        return z, problem.log_factors(z, data)

    return jax.lax.map(one, keys)
