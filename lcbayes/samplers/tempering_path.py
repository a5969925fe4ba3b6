"""Tempering schedules: the power of each point's likelihood between prior and posterior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]

FULL_DATA = 0.5  # value of s from which all points are included
BINS = 48  # bins of the points in order of time, by which a particle stores its likelihood
RAMP = 0.3  # share of the points whose power rises at any one s
DRAWS = 8  # draws from the prior to find out whether the body rotates
MAX_SIGNAL = 100.0  # squared signal-to-noise ratio per parameter in the first half


@dataclass(frozen=True)
class TimePath:
    """Powers of the points' likelihoods, which rise from 0 to 1 as s goes from 0 to 1.

    In the first half, points are added with the power λ₀, in order of time if the body rotates and
    otherwise all together. In the second half, the power of all points is λ₀^(2 − 2s).

    Data over a time T determine a spin to about 1/T. If all points were included from the
    beginning, the posterior would have more modes in spin than there are particles, and the number
    of particles near the correct mode would be left to chance. For this reason alone, ln Z of four
    rotating facets scattered by 2.9 between runs of 500 particles. If the time span grows
    gradually, the number of modes remains small enough for the particles to represent. λ₀ is set by
    the signal that the parameters require: a larger power makes the first distributions too narrow,
    and a smaller one restores the many modes. For a body that does not rotate, adding all points
    together requires half as many gradients.

    Attributes
    ----------
    bins : (T,) int
        Bin of each point.
    plateau : float
        λ₀.
    time_ordered : bool
        Whether points are added in order of time.

    References
    ----------
    Chopin 2002, Biometrika 89, 539 (sequential inclusion of data).
    """

    bins: NDArray[np.int64]
    plateau: float
    time_ordered: bool = True

    @classmethod
    def of(cls, data: Epochs, dim: int, time_ordered: bool = True) -> TimePath:
        """For the points of a light curve and a number of parameters."""
        n = data.t.size
        rank = np.argsort(np.argsort(np.asarray(data.t), kind="stable"))
        brightness, error = np.asarray(data.brightness), np.asarray(data.error)
        if not data.has_error:  # prior median of the noise
            error = 0.03 * np.asarray(data.noise_unit)[np.asarray(data.curve)]
        signal = np.sum(((brightness - brightness.mean()) / error) ** 2)
        signal *= float(np.mean(np.asarray(data.information)))
        plateau = min(1.0, MAX_SIGNAL * dim / max(signal, 1e-300))
        return cls(rank * BINS // n, plateau, time_ordered)

    def powers(self, s: float) -> Floats:
        """Power of each bin, (BINS,)."""
        if s > FULL_DATA:
            return np.full(BINS, self.plateau ** ((1.0 - s) / (1.0 - FULL_DATA)))
        if not self.time_ordered:
            return np.full(BINS, self.plateau * s / FULL_DATA)
        front, place = s / FULL_DATA * (1.0 + RAMP), np.arange(BINS) / BINS
        return self.plateau * np.clip((front - place) / RAMP, 0.0, 1.0)

    def at(self, data: Epochs, s: float) -> Epochs:
        """The data with `Epochs.information` multiplied by the powers at s."""
        return replace(data, information=jnp.asarray(self.powers(s)[self.bins]) * data.information)


def time_ordered(problem: Problem, data: Epochs) -> TimePath | None:
    """The path in order of time if the body rotates, otherwise None."""
    return TimePath.of(data, problem.dim) if rotates(problem, data, jax.random.key(0)) else None


def rotates(problem: Problem, data: Epochs, key: jax.Array) -> bool:
    """Whether the predicted brightness depends on time at fixed directions to Sun and observer."""
    return bool(jnp.any(_changes(problem, data, jax.random.split(key, DRAWS)) != 0.0))


@partial(jax.jit, static_argnums=0)
def _changes(problem: Problem, data: Epochs, keys: jax.Array) -> jax.Array:
    later = replace(data, t=data.t + 0.01 * data.t_span)

    def one(key: jax.Array) -> jax.Array:
        z = problem.prior_draw(key, data)
        return problem.moments(z, later).mean - problem.moments(z, data).mean

    return jax.vmap(one)(keys)


def binned(log_likelihood: jax.Array, bins: jax.Array) -> jax.Array:
    """Sums over the points (T,) in each bin, (BINS,)."""
    return jnp.zeros(BINS).at[bins].add(log_likelihood)
