"""Random-walk Metropolis-Hastings with the adaptive covariance of Haario."""

from __future__ import annotations

from collections.abc import Callable

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels.adaptation import Params
from lcbayes.samplers.kernels.trajectory import Info, Record, State

__all__ = ["build_kernel", "init"]


def init(z: jax.Array, potential_fn: Callable[[jax.Array], jax.Array]) -> State:
    """The state of a chain at z (D,), without the gradient."""
    return State(z, potential_fn(z), jnp.zeros_like(z))


def build_kernel(potential_fn: Callable[[jax.Array], jax.Array]):
    """kernel(key, state, params) -> (state, info) with θ′ ~ N(θ, ε² S), symmetric.

    References
    ----------
    Linares & Crassidis, eq. 17; Haario, Saksman & Tamminen (2001), Bernoulli 7, 223.
    """

    def kernel(key: jax.Array, state: State, params: Params) -> tuple[State, Info]:
        key_move, key_accept = jax.random.split(key)
        shift = params.scale.root @ jax.random.normal(key_move, state.z.shape)
        z = state.z + params.step_size * shift
        potential = potential_fn(z)
        error = potential - state.potential
        accept = jnp.where(jnp.isnan(error), 0.0, jnp.exp(-jnp.maximum(error, 0.0)))
        accepted = jax.random.uniform(key_accept) < accept
        new = State(
            jnp.where(accepted, z, state.z),
            jnp.where(accepted, potential, state.potential),
            state.grad,
        )
        no = jnp.array(False)
        info = Info(
            accept_prob=accept,
            diverging=no,
            failed=no,
            fallback=no,
            energy=new.potential,
            num_steps=jnp.array(1),
            num_metric=jnp.array(0),
            record=Record(jnp.zeros(0), jnp.zeros((0, 0))),
        )
        return new, info

    return kernel
