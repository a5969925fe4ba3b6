"""Densities, widths and MCMC moves of particles at one step of the tempering schedule."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from lcbayes.core.blocks import each
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import tempering_path
from lcbayes.samplers.kernels import ahmc, metric, trajectory
from lcbayes.samplers.kernels.adaptation import Params
from lcbayes.samplers.kernels.trajectory import State


class Drawn(NamedTuple):
    """Draws from the prior."""

    z: Any  # (N, D)
    log_factors: Any  # (N,) ln of the model's further factors on the prior
    log_likelihood: Any  # (N, BINS)


class Moved(NamedTuple):
    """One transition of each particle."""

    state: State  # (n, ...)
    log_likelihood: Any  # (n, BINS)
    accept: Any  # (n,)
    num_steps: Any  # (n,)


class Tuning(NamedTuple):
    """Parameters shared by the moves of all particles."""

    step_size: Any  # median of the step sizes, log-normal with sd `spread`
    spread: Any
    length: Any  # of a trajectory: number of steps times step size
    max_steps: Any
    delta: Any
    width: Any  # (D,) of a single solution, not of all particles


def log_likelihood(problem: Problem, z: jax.Array, data: Epochs, bins: jax.Array) -> jax.Array:
    """ln p(y | z) times the data's information, summed over each bin, (BINS,)."""
    return tempering_path.binned(data.information * problem.log_likelihood(z, data), bins)


@partial(jax.jit, static_argnums=0)
def draw(problem: Problem, data: Epochs, bins: jax.Array, keys: jax.Array) -> Drawn:
    """One draw from the prior for each key (N,)."""

    def one(key: jax.Array) -> Drawn:
        z = problem.prior_draw(key, data)
        return Drawn(z, problem.log_factors(z, data), log_likelihood(problem, z, data, bins))

    return each(one, keys)


@partial(jax.jit, static_argnums=0)
def start(problem: Problem, at: Epochs, z: jax.Array) -> State:
    """Potential and gradient of particles z (n, D)."""
    return each(lambda z: trajectory.init(z, lambda z: problem.potential(z, at)), z)


def reflect(
    potential: Callable[[jax.Array], jax.Array], mirror: jax.Array, key: jax.Array, state: State
) -> State:
    """Move of a particle to its mirror image, z → Q z.

    The move is proposed with probability ½ and accepted with probability min{1, exp(U − U′)}. It is
    exact if Q (D, D) is its own inverse and |det Q| = 1, even if U is not symmetric. If it were
    always proposed, the two sides would merely exchange their weights.
    """
    image = trajectory.init(mirror @ state.z, potential)
    key_coin, key_accept = jax.random.split(key)
    ratio = jnp.exp(jnp.minimum(state.potential - image.potential, 0.0))
    taken = jax.random.bernoulli(key_coin) & (jax.random.uniform(key_accept) < ratio)
    return jax.tree.map(lambda a, b: jnp.where(taken, a, b), image, state)


@partial(jax.jit, static_argnums=0)
def inform(problem: Problem, at: Epochs, z: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Information G (n, D, D) and the diagonal of its inverse (n, D)."""

    def one(z: jax.Array) -> tuple[jax.Array, jax.Array]:
        information = problem.fisher(z, at)
        return information, metric.variance(information)

    return each(one, z)


@partial(jax.jit, static_argnums=0)
def move(
    problem: Problem,
    at: Epochs,
    data: Epochs,
    bins: jax.Array,
    tuning: Tuning,
    mirror: jax.Array | None,
    keys: jax.Array,
    state: State,
) -> Moved:
    """One transition of each particle by the exact kernel, and to its image by ``mirror`` (D, D).

    The transitions leave exp(−U) invariant for ``at``, the data weighted for a step of the
    tempering schedule. The returned likelihood is that of ``data`` at full weight. Keys and states
    are (n,).

    Step sizes are drawn over a wide range, independently of the states. The posterior has sharp
    edges where a facet turns away; only small steps cross them, and large steps are efficient
    elsewhere.
    """
    kernel = ahmc.build_kernel(lambda z: problem.potential(z, at), lambda z: problem.fisher(z, at))
    scale = metric.Scale(
        jnp.zeros(problem.dim), jnp.diag(tuning.width), jnp.diag(1.0 / tuning.width)
    )

    def one(row: tuple[jax.Array, State]) -> Moved:
        key, state = row
        key_step, key = jax.random.split(key)
        step = tuning.step_size * jnp.exp(tuning.spread * jax.random.normal(key_step))
        step = jnp.minimum(step, tuning.length)
        num_steps = jnp.minimum(jnp.ceil(tuning.length / step), tuning.max_steps).astype(int)
        key_mirror, key = jax.random.split(key)
        state, info = kernel(key, state, Params(step, num_steps, tuning.delta, scale))
        if mirror is not None:
            state = reflect(lambda z: problem.potential(z, at), mirror, key_mirror, state)
        reached = log_likelihood(problem, state.z, data, bins)
        return Moved(state, reached, info.accept_prob, info.num_steps)

    return each(one, (keys, state))
