"""Exact Fisher-adaptive trajectories in turn with moves that cross gaps.

One transition consists of `ROUNDS` rounds. A round has one call of the moves and `TRAJECTORIES`
transitions of the exact rule of `kernels.ahmc`, with step sizes drawn from a log-normal density.
All parts leave the posterior invariant. The metric is local, so that the step size suits narrow and
wide arrangements alike, between which the moves lead; a constant metric would suit the narrowest.
A transition diverges if all its trajectories do, whose step sizes differ threefold.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from jax.flatten_util import ravel_pytree
from numpyro.infer.mcmc import MCMCKernel

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import ahmc, metric, trajectory
from lcbayes.samplers.kernels.adaptation import Params, Steps, steps_at, steps_update

ROUNDS, TRAJECTORIES = 2, 3
DELTA = 0.5  # δ of `kernels.ahmc`, in widths of the posterior
LENGTH, MOST_STEPS = 1.5, 12  # of a trajectory: a quarter turn of a Gaussian in its own metric
SPREAD = 0.5  # sd of ln(step size)
TARGET = 0.75  # acceptance rate
FIRST_STEP = 0.3


class AlternatingState(NamedTuple):
    """State of a chain: the fields of NumPyro and the adaptation."""

    i: jax.Array  # transitions so far, including warm-up
    z: Any
    potential_energy: jax.Array  # after a transition
    energy: jax.Array
    num_steps: jax.Array  # gradients in the last transition
    accept_prob: jax.Array  # mean over its trajectories
    diverging: jax.Array
    num_fallback: jax.Array  # singular metrics since the warm-up
    step_size: jax.Array  # median
    steps: Steps
    num_warmup: jax.Array
    rng_key: jax.Array


def trajectories(kernel: Callable, key: jax.Array, here: trajectory.State, step_size, scale):
    """The state and statistics after `TRAJECTORIES` transitions of `ahmc.build_kernel`."""

    def one(here: trajectory.State, key: jax.Array):
        key_step, key = jax.random.split(key)
        step = step_size * jnp.exp(SPREAD * jax.random.normal(key_step))
        step = jnp.minimum(step, LENGTH)
        number = jnp.minimum(jnp.ceil(LENGTH / step), MOST_STEPS).astype(int)
        return kernel(key, here, Params(step, number, jnp.array(DELTA), scale))

    return jax.lax.scan(one, here, jax.random.split(key, TRAJECTORIES))


class Alternating(MCMCKernel):
    """Kernel of a posterior with moves of its own.

    Parameters
    ----------
    potential_fn
        U(z, *model_args), −ln of the density.
    fisher_fn
        G(z, *model_args) -> (D, D): Fisher information plus the prior's precision. The posterior
        must have a width of about one in each of the coordinates z.
    moves_fn
        moves(key, z, *model_args) -> z, which leaves the posterior invariant.
    """

    def __init__(
        self,
        potential_fn: Callable[..., jax.Array],
        fisher_fn: Callable[..., jax.Array],
        moves_fn: Callable[..., Any],
    ) -> None:
        self._potential_fn, self._fisher_fn, self._moves_fn = potential_fn, fisher_fn, moves_fn

    @property
    def sample_field(self) -> str:
        return "z"

    @property
    def default_fields(self) -> tuple[str, ...]:
        return ("z", "diverging")

    def init(
        self,
        rng_key,
        num_warmup,
        init_params=None,
        model_args=(),  # noqa: ARG002
        model_kwargs=None,  # noqa: ARG002
    ) -> AlternatingState:
        """State before the first transition, at ``init_params``."""
        zero, no = jnp.zeros(()), jnp.array(False)
        count, step = jnp.array(0), jnp.array(FIRST_STEP)
        return AlternatingState(
            i=count,
            z=init_params,
            potential_energy=zero,
            energy=zero,
            num_steps=count,
            accept_prob=zero,
            diverging=no,
            num_fallback=count,
            step_size=step,
            steps=steps_at(jnp.log(step), 1),
            num_warmup=jnp.array(num_warmup),
            rng_key=rng_key,
        )

    def sample(self, state, model_args, model_kwargs) -> AlternatingState:  # noqa: ARG002
        """One transition."""
        first, unravel = ravel_pytree(state.z)

        def potential(z: jax.Array) -> jax.Array:
            return self._potential_fn(unravel(z), *model_args)

        kernel = ahmc.build_kernel(potential, lambda z: self._fisher_fn(unravel(z), *model_args))
        scale = metric.unit_scale(first)

        def one_round(z: jax.Array, key: jax.Array):
            key_moves, key = jax.random.split(key)
            z = ravel_pytree(self._moves_fn(key_moves, unravel(z), *model_args))[0]
            here = trajectory.init(z, potential)
            here, info = trajectories(kernel, key, here, state.step_size, scale)
            return here.z, (here.potential, info)

        rng_key, key = jax.random.split(state.rng_key)
        z, (potentials, info) = jax.lax.scan(one_round, first, jax.random.split(key, ROUNDS))
        accept = jnp.mean(info.accept_prob)
        warming = state.i < state.num_warmup
        steps = steps_update(state.steps, jnp.array(0), accept, TARGET)
        steps = jax.tree.map(lambda new, old: jnp.where(warming, new, old), steps, state.steps)
        last = state.i + 1 >= state.num_warmup
        return state._replace(
            i=state.i + 1,
            z=unravel(z),
            potential_energy=potentials[-1],
            energy=info.energy[-1, -1],
            num_steps=jnp.sum(info.num_steps),
            accept_prob=accept,
            diverging=jnp.all(info.diverging),
            num_fallback=jnp.where(warming, 0, state.num_fallback + jnp.sum(info.fallback)),
            step_size=jnp.exp(jnp.where(last, steps.average[0], steps.log_step[0])),
            steps=steps,
            rng_key=rng_key,
        )

    def get_diagnostics_str(self, state: AlternatingState) -> str:
        """Text for a progress bar."""
        return f"{int(state.num_steps)} steps, acc. prob={float(state.accept_prob):.2f}"
