"""AHMC along a cheaper density, each draw of which the exact one accepts or rejects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels.numpyro_kernel import AHMC, KernelState

FOLLOWED = 4  # transitions along the guide for one value of the exact density


class Guided(AHMC):
    """Delayed acceptance (Christen & Fox 2005, JCGS 14, 795).

    `FOLLOWED` transitions of AHMC lead from θ to θ′. They leave the guide exp(−Ũ) invariant and are
    reversible, one as well as several of one kind. θ′ is accepted with probability

        min{1, exp[U(θ) − U(θ′) − Ũ(θ) + Ũ(θ′)]},

    so that the chain leaves exp(−U) invariant, whatever the guide. A draw costs gradients and
    Fisher matrices of the guide, and one value of U. The warm-up follows the guide alone.

    Parameters
    ----------
    guide_fn, potential_fn
        Ũ and U, (z, *model_args) → −ln of the density.
    fisher_fn
        Of the guide, as for `AHMC`.
    """

    def __init__(
        self,
        guide_fn: Callable[..., jax.Array],
        potential_fn: Callable[..., jax.Array],
        **options: Any,
    ) -> None:
        super().__init__(potential_fn=guide_fn, **options)
        self._guide_fn, self._exact_fn = guide_fn, potential_fn

    def sample(self, state: KernelState, model_args, model_kwargs) -> KernelState:
        """One transition of one chain. ``potential_energy`` is U, but Ũ during the warm-up."""
        guide = self._guide_fn(state.z, *model_args)
        target = self._target(state.z, model_args, model_kwargs or {})
        after = super().sample(state._replace(potential_energy=guide), model_args, model_kwargs)

        def again(_: int, after: KernelState) -> KernelState:
            new = self._draw(after._replace(i=state.i), target=target)
            return new._replace(
                num_steps=after.num_steps + new.num_steps,
                diverging=after.diverging | new.diverging,
            )

        def judged(after: KernelState) -> KernelState:
            after = jax.lax.fori_loop(1, FOLLOWED, again, after)
            rng_key, key = jax.random.split(after.rng_key)
            exact = self._exact_fn(after.z, *model_args)
            # U of the point where the warm-up ends is not known, and any other is better
            first = state.i < jnp.maximum(state.num_warmup, 1)
            before = jnp.where(first, jnp.inf, state.potential_energy)
            change = before - exact - guide + after.potential_energy
            accept = jnp.where(jnp.isfinite(exact), jnp.exp(jnp.minimum(change, 0.0)), 0.0)
            accepted = jax.random.uniform(key) < accept
            z, grad, potential = jax.tree.map(
                lambda new, old: jnp.where(accepted, new, old),
                (after.z, after.z_grad, exact),
                (state.z, state.z_grad, before),
            )
            followed = jnp.where(accepted, after.potential_energy, guide)
            return after._replace(
                z=z,
                z_grad=grad,
                potential_energy=potential,
                energy=after.energy + potential - followed,
                accept_prob=after.accept_prob * accept,
                rng_key=rng_key,
            )

        late = state.i + 1 >= state.num_warmup
        return jax.lax.cond(late, judged, lambda after: after, after)
