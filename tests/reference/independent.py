"""Posterior moments without a Markov chain, from NumPyro's own density of a model."""

from __future__ import annotations

from collections.abc import Callable
from itertools import batched, product
from typing import Any

import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray
from numpyro import handlers
from numpyro.infer.util import constrain_fn, potential_energy, unconstrain_fn
from scipy.special import logsumexp

from lcbayes.core.jax_setup import jax, jnp
from tests.helpers import one_facet_posterior
from tests.reference.agreement import Moments
from tests.reference.problems import Reference, Sites

Floats = NDArray[np.float64]

KERNELS = 2000  # of the proposal, and what each is of the posterior's width
WIDTH = 0.7
TAIL = 4.0  # degrees of freedom
CHUNK = 5000
BOX = 10.0  # half width of a grid, posterior sd


class Density:
    """−ln p(y, z) over flat unconstrained vectors by `numpyro.infer.util`, which knows nothing of
    `lcbayes.inference`."""

    def __init__(self, one: Reference, sites: Sites) -> None:
        """``sites`` of some draws tell which there are."""
        self.one, self._model = one, one.bound()
        trace = handlers.trace(handlers.seed(self._model, 0)).get_trace(one.data)
        sites = {
            k: sites[k] for k, v in trace.items() if v["type"] == "sample" and not v["is_observed"]
        }
        free = jax.jit(lambda s: self._flat(s)[0])
        self._unravel = self._flat({k: jnp.asarray(v[0]) for k, v in sites.items()})[1]
        self.rows: Floats = np.asarray(
            jax.lax.map(free, {k: jnp.asarray(v) for k, v in sites.items()})
        )

        def potential(z: jax.Array) -> jax.Array:
            free = self._unravel(z)
            return jnp.asarray(potential_energy(self._model, (one.data,), {}, free))

        def constrained(z: jax.Array) -> Any:
            return constrain_fn(
                self._model, (one.data,), {}, self._unravel(z), return_deterministic=True
            )

        self._potential = jax.jit(lambda z: jax.lax.map(potential, z, batch_size=500))
        self._constrained = jax.jit(lambda z: jax.lax.map(constrained, z, batch_size=500))

    def _flat(self, sites: Any) -> tuple[jax.Array, Callable[[jax.Array], Any]]:
        return ravel_pytree(unconstrain_fn(self._model, (self.one.data,), {}, sites))

    def __call__(self, z: Floats) -> Floats:
        return np.asarray(self._potential(jnp.asarray(z)))

    def quantities(self, z: Floats) -> dict[str, Floats]:
        sites = {k: np.asarray(v) for k, v in self._constrained(jnp.asarray(z)).items()}
        return self.one.quantities(sites)


def quadrature(density: Density, n: int) -> Moments:
    """By the midpoint rule on a box of ten posterior sds to either side, n points along each axis.

    For densities that vanish at the ends it converges faster than any power of the step.
    """
    middle, sd = density.rows.mean(axis=0), density.rows.std(axis=0)
    bounds = np.stack([middle - BOX * sd, middle + BOX * sd], axis=1)
    steps = (np.arange(n) + 0.5) / n
    axes = [low + (high - low) * steps for low, high in bounds]
    log_w, values = [], []
    for some in batched(product(*axes), CHUNK):
        z = np.array(some)
        log_w.append(-density(z))
        result = density.quantities(z)
        values.append(np.stack(list(result.values()), axis=1))
    weights = np.exp(np.concatenate(log_w) - np.max(np.concatenate(log_w)))
    every = np.concatenate(values)
    mean = weights @ every / weights.sum()
    sd = np.sqrt(weights @ (every - mean) ** 2 / weights.sum())
    zero = np.zeros(len(mean))
    return Moments(tuple(result), mean, sd, zero, zero)


def one_facets(one: Reference, n: int) -> Moments:
    """Of the one facet: flux linear in α, two sums for each direction."""
    grid = one_facet_posterior.Quadrature.of(one.data, (n, n, n))
    mean, sd = grid.moments()
    zero = np.zeros(len(mean))
    return Moments(one_facet_posterior.NAMES, mean, sd, zero, zero)


def importance(density: Density, n: int, seed: int) -> tuple[Moments, float]:
    """Self-normalised importance sampling with n independent draws, and what they are worth.

    The proposal is a mixture of Student-t about some rows of ``density``, shrunk towards their
    mean so that the mixture is as wide as they are (West 1993); errors follow from the influence
    wᵢ(fᵢ − m)/Σw of each draw. It is right whatever the rows, as long as they reach everywhere.

    References
    ----------
    West 1993, JRSS B 55, 409; Owen 2013, Monte Carlo theory, methods and examples, sec. 9.2.
    """
    rng = np.random.default_rng(seed)
    centres = density.rows[np.linspace(0, len(density.rows) - 1, KERNELS).astype(int)]
    mean, covariance = density.rows.mean(axis=0), np.cov(density.rows.T)
    centres = mean + np.sqrt(1.0 - WIDTH**2) * (centres - mean)
    factor = WIDTH * np.linalg.cholesky(covariance)
    dim = len(mean)
    spread = rng.standard_normal((n, dim)) / np.sqrt(rng.chisquare(TAIL, (n, 1)) / TAIL)
    z = centres[rng.integers(KERNELS, size=n)] + spread @ factor.T
    log_w, values = [], []
    for some in np.split(z, range(CHUNK, n, CHUNK)):
        log_w.append(-density(some) - _log_mixture(some, centres, factor))
        result = density.quantities(some)
        values.append(np.stack(list(result.values()), axis=1))
    joined = np.concatenate(log_w)
    weights = np.exp(joined - logsumexp(joined))
    every = np.concatenate(values)
    mean = weights @ every
    away = every - mean
    variance = weights @ away**2
    mean_se = np.sqrt(weights**2 @ away**2)
    log_sd_se = 0.5 * np.sqrt(weights**2 @ (away**2 - variance) ** 2) / variance
    worth = float(1.0 / np.sum(weights**2))
    return Moments(tuple(result), mean, np.sqrt(variance), mean_se, log_sd_se), worth


def _log_mixture(z: Floats, centres: Floats, factor: Floats) -> Floats:
    """ln of the mean of the Student-t about the centres, up to a constant, (n,)."""
    whiten = np.linalg.inv(factor).T
    a, b = z @ whiten, centres @ whiten
    square = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1) - 2.0 * a @ b.T
    result = logsumexp(-0.5 * (TAIL + z.shape[1]) * np.log1p(square / TAIL), axis=1)
    return np.asarray(result)
