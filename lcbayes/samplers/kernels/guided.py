"""NUTS along a cheaper density, each draw of which the exact one accepts or rejects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpyro.infer import NUTS
from numpyro.infer.hmc import HMCState

from lcbayes.core.jax_setup import jax, jnp

FOLLOWED = 2  # transitions along the guide for one value of the exact density
EVERY = 10  # one draw in so many follows the exact density


class Guided(NUTS):
    """Delayed acceptance (Christen & Fox 2005, JCGS 14, 795), in turn with NUTS.

    `FOLLOWED` transitions of NUTS lead from θ to θ′. They leave the guide exp(−Ũ) invariant and are
    reversible: each point of a finished tree leads to the same tree with the same probability, and
    progressive sampling keeps detailed balance between each pair of its points. θ′ is accepted with
    probability

        min{1, exp[U(θ) − U(θ′) − Ũ(θ) + Ũ(θ′)]},

    so that the chain leaves exp(−U) invariant, whatever the guide. A draw costs gradients of the
    guide and one value of U. Where Ũ is far too large, no proposal would be accepted for a long
    time; every tenth draw is therefore a transition of NUTS along U. The warm-up follows the guide
    alone.

    Parameters
    ----------
    guide, exact : callable
        NumPyro models of Ũ and of U, of the same sites.
    """

    def __init__(
        self, guide: Callable[..., Any], exact: Callable[..., Any], **options: Any
    ) -> None:
        super().__init__(guide, **options)
        self._along_exact = NUTS(exact, **options)
        self._num_warmup = 0

    def init(
        self, rng_key, num_warmup, init_params=None, model_args=(), model_kwargs=None
    ) -> HMCState:
        self._num_warmup = num_warmup
        given = rng_key, num_warmup, init_params, model_args, model_kwargs or {}
        self._along_exact.init(*given)
        return super().init(*given)

    def sample(self, state: HMCState, model_args, model_kwargs) -> HMCState:
        """One transition of one chain. ``potential_energy`` is U, but Ũ during the warm-up."""
        args = model_args, model_kwargs
        guide_fn, exact_fn = (x.get_potential_fn(*args) for x in (self, self._along_exact))

        drawn = state.i - self._num_warmup

        def followed(before: HMCState) -> HMCState:
            return super(Guided, self).sample(before, *args)

        def again(_: int, before: HMCState) -> HMCState:
            new = followed(before)
            return new._replace(
                num_steps=before.num_steps + new.num_steps,
                diverging=before.diverging | new.diverging,
            )

        def judged() -> HMCState:
            guide = guide_fn(state.z)
            one = followed(state._replace(potential_energy=guide))
            after = jax.lax.fori_loop(1, FOLLOWED, again, one)
            rng_key, key = jax.random.split(after.rng_key)
            exact = exact_fn(after.z)
            # U of the point where the warm-up ends is not known, and any other is better
            before = jnp.where(drawn == 0, jnp.inf, state.potential_energy)
            change = before - exact - guide + after.potential_energy
            accept = jnp.where(jnp.isfinite(exact), jnp.exp(jnp.minimum(change, 0.0)), 0.0)
            accepted = jax.random.uniform(key) < accept
            z, grad, potential = jax.tree.map(
                lambda new, old: jnp.where(accepted, new, old),
                (after.z, after.z_grad, exact),
                (state.z, state.z_grad, before),
            )
            last = jnp.where(accepted, after.potential_energy, guide)
            return after._replace(
                i=state.i + 1,
                z=z,
                z_grad=grad,
                potential_energy=potential,
                energy=after.energy + potential - last,
                accept_prob=after.accept_prob * accept,
                rng_key=rng_key,
            )

        def exactly() -> HMCState:
            potential, grad = jax.value_and_grad(exact_fn)(state.z)
            before = state._replace(potential_energy=potential, z_grad=grad)
            after = self._along_exact.sample(before, *args)
            return after._replace(z_grad=jax.grad(guide_fn)(after.z))

        kind = jnp.where(drawn < 0, 0, jnp.where((drawn + 1) % EVERY == 0, 1, 2))
        return jax.lax.switch(kind, [lambda: followed(state), exactly, judged])
