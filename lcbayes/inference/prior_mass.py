"""Prior with factors: draws from it, and the prior mass that remains under the factors."""

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
RELATIVE_ERROR = 0.01  # target relative error of the mass
MAX_TRIED = 16_384  # largest number of prior draws tried
MIN_EFFECTIVE = 100.0  # least effective sample size of resampled draws


@partial(jax.jit, static_argnums=0)
def _factors(problem: Problem, data: Epochs, keys: jax.Array) -> jax.Array:
    """ln of the product of all prior factors, at a prior draw for each key (n,)."""

    def one(key: jax.Array) -> jax.Array:
        return problem.log_factors(problem.prior_draw(key, data), data)

    return jax.lax.map(one, keys, batch_size=64)


@partial(jax.jit, static_argnums=0)
def _drawn(problem: Problem, data: Epochs, keys: jax.Array) -> tuple[jax.Array, jax.Array]:
    """A prior draw for each key, and whether the factors accept it."""

    def one(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        key_draw, key_keep = jax.random.split(key)
        z = problem.prior_draw(key_draw, data)
        return z, jnp.log(jax.random.uniform(key_keep)) < problem.log_factors(z, data)

    return jax.lax.map(one, keys, batch_size=64)


def accepted(problem: Problem, data: Epochs, key: jax.Array, n: int) -> jax.Array:
    """n draws (n, D) from the prior with its factors (at most one), by rejection sampling.

    Raises
    ------
    InputError
        If the factors accept fewer than n of 16,384 draws.
    """
    draws = jnp.zeros((0, problem.dim))
    for i in range(MAX_BATCHES):
        keys = jax.random.split(jax.random.fold_in(key, i), 256)
        z, kept = _drawn(problem, data, keys)
        draws = jnp.concatenate([draws, z[np.asarray(kept)]])
        if len(draws) >= n:
            return draws[:n]
    raise InputError(
        f"the factors of the prior keep {len(draws)} of {MAX_BATCHES * 256} draws; {n} are wanted"
    )


def log_prior_mass(problem: Problem, data: Epochs, key: jax.Array) -> LogEvidence:
    """ln ∫ p₀(z) f(z) dz for the prior p₀ and the model's factors f, with its error.

    A model may multiply its prior by factors that require every facet to be lit and seen, or
    reflectances not to exceed one. The product p₀ f then does not integrate to one. Within one
    model this has no effect. However, it lowers the evidence of N facets by a factor of about qᴺ,
    with q the prior probability that a facet is seen. If the body rotates little, this can decide
    between N and N + 1. The evidence under the prior *conditioned* on all facets being seen is Z
    divided by this mass.

    The estimate is the mean of f over draws from p₀. Sampling stops when the relative error is 1 %
    or after 262,144 draws.
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
        The sampling method, or a note that the factors were not applied; empty without factors.
    honoured : bool
        Whether the draws follow the prior with its factors.
    """

    z: Floats
    note: str
    honoured: bool


def prior_sample(problem: Problem, data: Epochs, key: jax.Array, n: int) -> PriorDraws:
    """n draws from the prior with its factors f, by rejection sampling.

    A draw z from the prior alone is accepted with probability f(z)/max f. The maximum of f is taken
    as one, or as the largest value drawn if that exceeds one. At most 16,384 prior draws are made.
    If fewer than n are accepted, draws are resampled by weight with replacement, provided that
    their effective sample size is at least `MIN_EFFECTIVE`. Otherwise the factors are omitted.

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
    """A prior draw for each key (n, D), and ln of its factors (−∞ where undefined)."""
    z, log_f = _weighed(problem, data, keys)
    return np.asarray(z), np.nan_to_num(np.asarray(log_f), nan=-np.inf, neginf=-np.inf)


def _kept(log_f: Floats, key: jax.Array) -> NDArray[np.int64]:
    """Indices of the accepted draws; the result for early draws is independent of later ones."""
    seed = np.asarray(jax.random.key_data(key)).ravel()
    uniform = np.random.default_rng(seed).random(len(log_f))
    return np.flatnonzero(np.log(uniform) < log_f - max(0.0, float(np.max(log_f))))


@partial(jax.jit, static_argnums=0)
def _weighed(problem: Problem, data: Epochs, keys: jax.Array) -> tuple[jax.Array, jax.Array]:

    def one(key: jax.Array) -> tuple[jax.Array, jax.Array]:
        z = problem.prior_draw(key, data)
        return z, problem.log_factors(z, data)

    return jax.lax.map(one, keys)
