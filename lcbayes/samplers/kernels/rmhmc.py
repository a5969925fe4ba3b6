"""Riemannian manifold HMC with the local Fisher information as metric (sec. V)."""

from __future__ import annotations

from collections.abc import Callable

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import integrators, metric, trajectory
from lcbayes.samplers.kernels.adaptation import Params
from lcbayes.samplers.kernels.trajectory import Info, State, init

__all__ = ["build_kernel", "init"]


def build_kernel(
    potential_fn: Callable[[jax.Array], jax.Array],
    fisher_fn: Callable[[jax.Array], jax.Array],
    record_steps: int = 0,
):
    """kernel(key, state, params) -> (state, info) that leaves exp(−U) invariant.

    p ~ N(0, G(θ)), then L steps of the generalised leapfrog on H = U + ½ ln det G + ½ pᵀG⁻¹p. The
    acceptance probability is min{1, exp(H − H′)}, or zero if an implicit step or its reverse does
    not converge. If G is singular or not finite, the metric is the constant S⁻¹.

    Parameters
    ----------
    potential_fn
        U: z (D,) -> scalar.
    fisher_fn
        G: z -> (D, D), differentiable: Fisher information plus the prior's precision.
    record_steps
        Number of steps whose statistics are recorded during warm-up; 0 for none.

    References
    ----------
    Linares & Crassidis, eq. 26; Girolami & Calderhead (2011), JRSS B 73, 123; for the check of the
    reverse step, Brofos & Lederman (2021), arXiv:2102.07139.
    """
    value_and_grad = jax.value_and_grad(potential_fn)

    def kernel(key: jax.Array, state: State, params: Params) -> tuple[State, Info]:
        key_p, key_step, key_accept = jax.random.split(key, 3)
        manifold = integrators.Manifold(fisher_fn, params.scale.precision)
        here = manifold.at(state.z, jnp.array(0))
        white = metric.momentum(key_p, state.z.shape[0])
        p = integrators.unwhiten(here.root, white)
        start = trajectory.Point(state.z, p, state.potential, state.grad, jnp.array(True), here)
        point, info, end = trajectory.run(
            key_accept,
            trajectory.Dynamics(
                integrators.generalised_leapfrog(value_and_grad, manifold), manifold.energy
            ),
            start,
            trajectory.jittered(key_step, params.step_size),
            params.num_steps,
            params.features if record_steps else None,
            record_steps,
        )
        info = info._replace(num_metric=end.extra.evaluations, fallback=~end.extra.good)
        return State(point.z, point.potential, point.grad), info

    return kernel
