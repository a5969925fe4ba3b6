"""The way from the prior to the posterior: which points count, and how much, at each step of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]

HALF = 0.5  # of the path, where all points have come in
BINS = 48  # of the epochs, in order of time: what a particle keeps of its likelihood
RAMP = 0.3  # share of the points that are coming in together
DRAWS = 8  # of the prior, on which it is looked at whether the body turns
SIGNAL = 100.0  # squared signal over noise for each parameter, to which the power is first held


@dataclass(frozen=True)
class Path:
    """Powers of the points' likelihoods that rise from 0 to 1 as s goes from 0 to 1.

    In the first half points come in at the power λ₀, one after the other in time if the body
    turns, else all together; in the second the power of all rises to λ₀^(2 − 2s).

    A spin is known to about 1/T once it has been seen for a time T. If all points counted a
    little from the beginning there would be far more spins to tell apart than particles, and
    chance would decide how many of these are near the right one when it begins to win: ln Z of four
    facets that turn scattered by 2.9 between runs of 500 particles, all of it from there. As the
    time grows bit by bit no more spins come up than the particles can follow. The power λ₀ leaves
    as much signal as parameters need to be told; more of it makes the first steps narrow, less
    brings the many spins back. Where nothing turns there are no spins to tell apart, and points
    that come in together take half of the gradients.

    Attributes
    ----------
    bins : (T,) int
        Bin of each point.
    plateau : float
        λ₀.
    in_time : bool
        Whether points come in one after the other.

    References
    ----------
    Chopin 2002, Biometrika 89, 539 (from the prior by taking in data bit by bit).
    """

    bins: NDArray[np.int64]
    plateau: float
    in_time: bool = True

    @classmethod
    def of(cls, data: Epochs, dim: int, in_time: bool = True) -> Path:
        """For the points of a light curve and a number of parameters."""
        n = data.t.size
        rank = np.argsort(np.argsort(np.asarray(data.t), kind="stable"))
        brightness, error = np.asarray(data.brightness), np.asarray(data.error)
        if not data.has_error:  # as its prior has it
            error = 0.03 * np.asarray(data.noise_unit)[np.asarray(data.curve)]
        signal = np.sum(((brightness - brightness.mean()) / error) ** 2)
        signal *= float(np.mean(np.asarray(data.information)))
        plateau = min(1.0, SIGNAL * dim / max(signal, 1e-300))
        return cls(rank * BINS // n, plateau, in_time)

    def powers(self, s: float) -> Floats:
        """Of each bin, (BINS,)."""
        if s > HALF:
            return np.full(BINS, self.plateau ** ((1.0 - s) / (1.0 - HALF)))
        if not self.in_time:
            return np.full(BINS, self.plateau * s / HALF)
        front, place = s / HALF * (1.0 + RAMP), np.arange(BINS) / BINS
        return self.plateau * np.clip((front - place) / RAMP, 0.0, 1.0)

    def at(self, data: Epochs, s: float) -> Epochs:
        """The data as they count at s, on top of `Epochs.information`."""
        return replace(data, information=jnp.asarray(self.powers(s)[self.bins]) * data.information)


def in_time(problem: Problem, data: Epochs) -> Path | None:
    """The path on which points come in one after the other, where the body turns."""
    return Path.of(data, problem.dim) if turns(problem, data, jax.random.key(0)) else None


def turns(problem: Problem, data: Epochs, key: jax.Array) -> bool:
    """Whether the brightness of the prior's bodies changes with time where the directions to Sun
    and observer do not."""
    return bool(jnp.any(_changes(problem, data, jax.random.split(key, DRAWS)) != 0.0))


@partial(jax.jit, static_argnums=0)
def _changes(problem: Problem, data: Epochs, keys: jax.Array) -> jax.Array:
    later = replace(data, t=data.t + 0.01 * data.t_span)

    def one(key: jax.Array) -> jax.Array:
        z = problem.prior_draw(key, data)
        return problem.moments(z, later).mean - problem.moments(z, data).mean

    return jax.vmap(one)(keys)


def binned(log_likelihood: jax.Array, bins: jax.Array) -> jax.Array:
    """Sums over the points (T,) of each bin, (BINS,)."""
    return jnp.zeros(BINS).at[bins].add(log_likelihood)
