"""Fisher-adaptive Hamiltonian Monte Carlo: the published rule, and an exact one of equal cost.

Published rule (Linares & Crassidis, sec. V): M = G(θ) for one proposal. The acceptance probability
of eq. 22 assumes that the reverse move has the same mass matrix. It does not, so the rule does not
leave the posterior invariant.

Exact rule: the metric is evaluated at an auxiliary point φ, which the move does not change.

1. φ ~ N(θ, Σ), Σ = δ²S;  M = G(φ) + Σ⁻¹;  p ~ N(0, M).
2. L leapfrog steps with that M on U_φ(θ) = U(θ) + ½ (θ − φ)ᵀΣ⁻¹(θ − φ).
3. Accept with probability min{1, exp(H_φ(θ, p) − H_φ(θ′, p′))}.

Step 1 is a Gibbs draw of (φ, p) from π(θ) N(φ; θ, Σ) N(p; 0, M(φ)), whose marginal distribution is
the posterior. Steps 2 and 3 leave this density invariant, because ln det M(φ) is constant at fixed
φ. The rule needs no derivative of G, and G may be discontinuous. With δ = ∞ the metric is S⁻¹, as
in HMC.
"""

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
    exact: bool = True,
    record_steps: int = 0,
):
    """kernel(key, state, params) -> (state, info).

    If G is singular or not finite, M is the constant S⁻¹ + Σ⁻¹. This choice depends on φ alone, so
    the rule remains exact.

    Parameters
    ----------
    potential_fn
        U: z (D,) -> scalar.
    fisher_fn
        G: z -> (D, D), Fisher information plus the prior's precision.
    exact
        False selects the published rule.
    record_steps
        Number of steps whose statistics are recorded during warm-up; 0 for none.

    References
    ----------
    Linares & Crassidis, eqs. 22-28; Titsias & Papaspiliopoulos, arXiv:1610.09641.
    """
    value_and_grad = jax.value_and_grad(potential_fn)

    def kernel(key: jax.Array, state: State, params: Params) -> tuple[State, Info]:
        key_centre, key_v, key_step, key_accept = jax.random.split(key, 4)
        z, scale, delta = state.z, params.scale, params.delta
        precision = scale.precision
        local = jnp.isfinite(delta)
        if exact:
            shift = scale.root @ jax.random.normal(key_centre, z.shape)
            centre = z + jnp.where(local, delta, 0.0) * shift
            spring = precision / delta**2
            root, good = jax.lax.cond(
                local,
                lambda: metric.inverse_root(fisher_fn(centre) + spring, precision + spring),
                lambda: (scale.root, jnp.array(True)),
            )
        else:
            centre, spring = z, jnp.zeros_like(precision)
            root, good = metric.inverse_root(fisher_fn(z), precision)

        def energy(point):
            away = point.z - centre
            return point.potential + 0.5 * away @ spring @ away + metric.kinetic(point.v)

        start = trajectory.Point(
            z, metric.momentum(key_v, z.shape[0]), state.potential, state.grad, jnp.array(True)
        )
        point, info, _ = trajectory.run(
            key_accept,
            trajectory.Dynamics(integrators.leapfrog(value_and_grad, root, centre, spring), energy),
            start,
            trajectory.jittered(key_step, params.step_size),
            params.num_steps,
            params.features if record_steps else None,
            record_steps,
        )
        info = info._replace(
            fallback=~good, num_metric=(local | (not exact)).astype(info.num_steps.dtype)
        )
        return State(point.z, point.potential, point.grad), info

    return kernel
