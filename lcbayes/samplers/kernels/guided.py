"""NUTS along a cheaper density, each draw of which the exact one accepts or rejects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpyro.infer import NUTS
from numpyro.infer.hmc import HMCState

from lcbayes.core.jax_setup import jax, jnp

FOLLOWED = 2  # transitions along the guide for one value of the exact density
EVERY = 10  # one draw in so many does without the guide
WALKED = 8  # steps of a random walk to that draw
STEP = 2.4  # widths of the posterior over √D, with which the walk is fastest


class Guided(NUTS):
    """Delayed acceptance (Christen & Fox 2005, JCGS 14, 795), in turn with a random walk.

    `FOLLOWED` transitions of NUTS lead from θ to θ′. They leave the guide exp(−Ũ) invariant and are
    reversible: each point of a finished tree leads to the same tree with the same probability, and
    progressive sampling keeps detailed balance between each pair of its points. θ′ is accepted with
    probability

        min{1, exp[U(θ) − U(θ′) − Ũ(θ) + Ũ(θ′)]},

    so that the chain leaves exp(−U) invariant, whatever the guide. A draw costs gradients of the
    guide and one value of U, and no gradient of U is ever compiled. Where Ũ is far too large, no
    proposal would be accepted for a long time. Every tenth draw therefore comes from `WALKED` steps
    of a random walk, each of which U alone accepts or rejects. Its widths are those of the warm-up;
    `STEP` is from Roberts, Gelman & Gilks (1997, Ann. Appl. Probab. 7, 110). The warm-up follows
    the guide alone.

    Parameters
    ----------
    guide, exact : callable
        NumPyro models of Ũ and of U, of the same site, a vector.
    """

    def __init__(
        self, guide: Callable[..., Any], exact: Callable[..., Any], **options: Any
    ) -> None:
        super().__init__(guide, **options)
        self._exact = NUTS(exact)  # of which only the density is used
        self._num_warmup = 0

    def init(
        self, rng_key, num_warmup, init_params=None, model_args=(), model_kwargs=None
    ) -> HMCState:
        self._num_warmup = num_warmup
        given = rng_key, num_warmup, init_params, model_args, model_kwargs or {}
        self._exact.init(*given)
        return super().init(*given)

    def sample(self, state: HMCState, model_args, model_kwargs) -> HMCState:
        """One transition of one chain. ``potential_energy`` is U, but Ũ during the warm-up.

        The gradient in a state is not used: a walk leaves none.
        """
        args = model_args, model_kwargs
        guide_fn, exact_fn = (x.get_potential_fn(*args) for x in (self, self._exact))
        drawn = state.i - self._num_warmup
        warmup, walk = drawn < 0, (drawn + 1) % EVERY == 0

        def again(_: int, before: HMCState) -> HMCState:
            new = super(Guided, self).sample(before, *args)
            return new._replace(
                num_steps=before.num_steps + new.num_steps,
                diverging=before.diverging | new.diverging,
            )

        # Ũ is computed here for all kinds of draws, because each call of a density is compiled.
        guide, grad = jax.value_and_grad(guide_fn)(state.z)
        start = state._replace(
            potential_energy=guide,
            z_grad=grad,
            num_steps=jnp.zeros_like(state.num_steps),
            diverging=jnp.zeros_like(state.diverging),
        )
        count = jnp.where(warmup, 1, jnp.where(walk, 0, FOLLOWED))
        after = jax.lax.fori_loop(0, count, again, start)

        def judged() -> HMCState:
            rng_key, key = jax.random.split(after.rng_key)

            def step(i: int, carry: tuple[Any, jax.Array, jax.Array]):
                z, potential, total = carry
                key_step, key_accept = jax.random.split(jax.random.fold_in(key, i))
                change = _step(key_step, state)
                proposed = jax.tree.map(lambda x, y: jnp.where(walk, x + change, y), z, after.z)
                exact = exact_fn(proposed)
                gain = potential - exact + after.potential_energy - guide
                accept = jnp.where(jnp.isfinite(exact), jnp.exp(jnp.minimum(gain, 0.0)), 0.0)
                accepted = jax.random.uniform(key_accept) < accept
                kept = jax.tree.map(
                    lambda new, old: jnp.where(accepted, new, old),
                    (proposed, exact),
                    (z, potential),
                )
                return *kept, total + accept

            # U of the point where the warm-up ends is not known, and any other is better
            before = jnp.where(drawn == 0, jnp.inf, state.potential_energy)
            number = jnp.where(walk, WALKED, 1)
            z, potential, total = jax.lax.fori_loop(0, number, step, (state.z, before, 0.0))
            accept = total / number
            # the kinetic energy remains: that at the end of a trajectory, or at its beginning
            along_guide = jnp.where(potential == before, guide, after.potential_energy)
            last = jnp.where(walk, before, along_guide)
            return after._replace(
                i=state.i + 1,
                z=z,
                potential_energy=potential,
                energy=after.energy + potential - last,
                accept_prob=jnp.where(walk, accept, after.accept_prob * accept),
                rng_key=rng_key,
            )

        return jax.lax.cond(warmup, lambda: after, judged)


def _step(key: jax.Array, state: HMCState) -> jax.Array:
    """A step (D,) of the walk."""
    (variance,) = state.adapt_state.inverse_mass_matrix.values()
    return STEP * jnp.sqrt(variance / variance.size) * jax.random.normal(key, variance.shape)
