"""Hamiltonian Monte Carlo with a constant mass matrix (Linares & Crassidis, sec. IV)."""

from __future__ import annotations

from collections.abc import Callable

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import integrators, metric, trajectory
from lcbayes.samplers.kernels.adaptation import Params
from lcbayes.samplers.kernels.trajectory import Info, State, init

__all__ = ["build_kernel", "init"]


def build_kernel(potential_fn: Callable[[jax.Array], jax.Array], record_steps: int = 0):
    """kernel(key, state, params) -> (state, info) that leaves exp(−U) invariant.

    M⁻¹ = S, the covariance from the warm-up; the step size is jittered.

    Parameters
    ----------
    potential_fn
        U: z (D,) -> scalar.
    record_steps
        Number of steps whose statistics are recorded during warm-up; 0 for none.
    """
    value_and_grad = jax.value_and_grad(potential_fn)

    def kernel(key: jax.Array, state: State, params: Params) -> tuple[State, Info]:
        key_v, key_step, key_accept = jax.random.split(key, 3)
        dynamics = trajectory.Dynamics(
            integrators.leapfrog(value_and_grad, params.scale.root),
            lambda point: point.potential + metric.kinetic(point.v),
        )
        start = trajectory.Point(
            state.z,
            metric.momentum(key_v, state.z.shape[0]),
            state.potential,
            state.grad,
            jnp.array(True),
        )
        point, info, _ = trajectory.run(
            key_accept,
            dynamics,
            start,
            trajectory.jittered(key_step, params.step_size),
            params.num_steps,
            params.features if record_steps else None,
            record_steps,
        )
        return State(point.z, point.potential, point.grad), info

    return kernel
