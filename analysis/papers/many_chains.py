"""Means and variances from many short chains at once, each with a reliable standard error.

The chains are independent, so the scatter of their averages gives the Monte-Carlo error of the
overall mean without an estimate of autocorrelations. All chains advance in one compiled loop.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels.numpyro_kernel import Kernel

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Moments from chains of Q quantities whose exact mean and sd are known.

    Attributes
    ----------
    mean, sd : (Q,) the exact values
    first, second : (C, Q) averages of f − mean and of (f − mean)² in each chain
    accept_prob : mean over all chains and draws
    """

    mean: Floats
    sd: Floats
    first: Floats
    second: Floats
    accept_prob: float

    @property
    def bias(self) -> Floats:
        """Error of the mean, in exact standard deviations, (Q,)."""
        return self.first.mean(axis=0) / self.sd

    @property
    def bias_error(self) -> Floats:
        """Monte-Carlo standard error of `bias`."""
        return _error(self.first) / self.sd

    @property
    def sd_bias(self) -> Floats:
        """Relative error of the sd about the exact mean, (Q,)."""
        return np.sqrt(self.second.mean(axis=0)) / self.sd - 1.0

    @property
    def sd_bias_error(self) -> Floats:
        """Monte-Carlo standard error of `sd_bias`."""
        return 0.5 * _error(self.second) / np.sqrt(self.second.mean(axis=0)) / self.sd

    @property
    def z(self) -> Floats:
        """Errors of mean and sd in units of their Monte-Carlo standard errors, (2 Q,)."""
        variance = (self.second.mean(axis=0) - self.sd**2) / _error(self.second)
        return np.concatenate([self.bias / self.bias_error, variance])

    @property
    def effective_draws(self) -> float:
        """Number of independent draws that would give the same error of the least precise mean."""
        return float(np.min(self.bias_error**-2))


def _error(per_chain: Floats) -> Floats:
    return per_chain.std(axis=0, ddof=1) / np.sqrt(len(per_chain))


def run(
    kernel: Kernel,
    start: ArrayLike,
    quantities: Callable[[jax.Array], jax.Array],
    exact: tuple[Floats, Floats],
    *,
    draws: int,
    burn: int,
    seed: int,
) -> Moments:
    """Run chains of a kernel without warm-up, with given step size, number of steps and covariance.

    Parameters
    ----------
    kernel : kernel with a ``potential_fn`` of flat vectors
    start : (C, D) starting points of the chains
    quantities : z (D,) → (Q,)
    exact : mean and sd (Q,) of the quantities
    draws, burn : number of draws per chain; the first ``burn`` are discarded
    """
    mean, sd = exact

    @jax.jit
    def go(start: jax.Array, key: jax.Array):
        state = kernel.init(jax.random.split(key, len(start)), 0, start)

        def step(carry, i):
            state, first, second, accept = carry
            state = kernel.sample(state, (), {})
            away = jnp.where(i >= burn, jax.vmap(quantities)(state.z) - mean, 0.0)
            return (state, first + away, second + away**2, accept + state.accept_prob.mean()), None

        zero = jnp.zeros((len(start), len(mean)))
        carry = (state, zero, zero, jnp.zeros(()))
        (_, first, second, accept), _ = jax.lax.scan(step, carry, jnp.arange(burn + draws))
        return first / draws, second / draws, accept / (burn + draws)

    first, second, accept = go(jnp.asarray(start), jax.random.key(seed))
    return Moments(mean, sd, np.asarray(first), np.asarray(second), float(accept))
