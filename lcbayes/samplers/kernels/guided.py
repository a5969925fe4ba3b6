"""NUTS along a cheaper density, each draw of which the exact one accepts or rejects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpyro.infer import NUTS
from numpyro.infer.hmc import HMCState

from lcbayes.core.jax_setup import jax, jnp

FOLLOWED = 2  # transitions along the guide for one value of the exact density


class Guided(NUTS):
    """Delayed acceptance (Christen & Fox 2005, JCGS 14, 795).

    `FOLLOWED` transitions of NUTS lead from θ to θ′. They leave the guide exp(−Ũ) invariant and are
    reversible: each point of a finished tree leads to the same tree with the same probability, and
    progressive sampling keeps detailed balance between each pair of its points. θ′ is accepted with
    probability

        min{1, exp[U(θ) − U(θ′) − Ũ(θ) + Ũ(θ′)]},

    so that the chain leaves exp(−U) invariant, whatever the guide. A draw costs gradients of the
    guide and one value of U. The warm-up follows the guide alone.

    Parameters
    ----------
    guide : callable
        NumPyro model of the guide.
    potential_fn : callable
        U: (z, *model_args) → −ln of the exact density.
    """

    def __init__(
        self, guide: Callable[..., Any], potential_fn: Callable[..., jax.Array], **options: Any
    ) -> None:
        super().__init__(guide, **options)
        self._exact_fn = potential_fn
        self._num_warmup = 0

    def init(
        self, rng_key, num_warmup, init_params=None, model_args=(), model_kwargs=None
    ) -> HMCState:
        self._num_warmup = num_warmup
        return super().init(rng_key, num_warmup, init_params, model_args, model_kwargs or {})

    def sample(self, state: HMCState, model_args, model_kwargs) -> HMCState:
        """One transition of one chain. ``potential_energy`` is U, but Ũ during the warm-up."""
        guide = self.get_potential_fn(model_args, model_kwargs)(state.z)
        one = super().sample(state._replace(potential_energy=guide), model_args, model_kwargs)

        def again(_: int, before: HMCState) -> HMCState:
            new = super(Guided, self).sample(before, model_args, model_kwargs)
            return new._replace(
                num_steps=before.num_steps + new.num_steps,
                diverging=before.diverging | new.diverging,
            )

        def judged() -> HMCState:
            after = jax.lax.fori_loop(1, FOLLOWED, again, one)
            rng_key, key = jax.random.split(after.rng_key)
            exact = self._exact_fn(after.z, *model_args)
            # U of the point where the warm-up ends is not known, and any other is better
            first = state.i == self._num_warmup
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

        return jax.lax.cond(state.i >= self._num_warmup, judged, lambda: one)
