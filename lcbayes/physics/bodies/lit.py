"""What of each panel is lit and seen near some directions of Sun and observer, to first order."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp


class Lit(NamedTuple):
    """The fraction of each panel that no other shades and none hides, about some directions.

    Attributes
    ----------
    fraction : (T, N)
    slopes : tuple or None
        Derivatives by the directions to Sun and observer, (T, N, 3) each, and the directions
        (T, 3) at which they are; None where the fraction is fixed.

    Examples
    --------
    >>> along, across = jnp.array([[1.0, 0, 0]]), jnp.array([[0.0, 1, 0]])
    >>> lit = Lit(jnp.array([[0.5]]), (jnp.array([[[0.0, 2, 0]]]), jnp.zeros((1, 1, 3)),
    ...     along, across))
    >>> lit(along + 0.1 * across, across).tolist()
    [[0.7]]
    >>> lit.fixed(along + 0.1 * across, across).tolist()
    [[0.5]]
    """

    fraction: jax.Array
    slopes: tuple[jax.Array, jax.Array, jax.Array, jax.Array] | None = None

    @property
    def fixed(self) -> Lit:
        """The same fraction in all directions."""
        return Lit(self.fraction)

    def of(self, which: NDArray[np.integer]) -> Lit:
        """That of some panels, each as often as it is in `which`."""
        if self.slopes is None:
            return Lit(self.fraction[:, which])
        by_sun, by_obs, *at = self.slopes
        return Lit(self.fraction[:, which], (by_sun[:, which], by_obs[:, which], at[0], at[1]))

    def __call__(self, sun: jax.Array, obs: jax.Array) -> jax.Array:
        """The fraction (T, N) along directions (T, 3)."""
        if self.slopes is None:
            return self.fraction
        by_sun, by_obs, at_sun, at_obs = self.slopes
        change = jnp.einsum("tnj,tj->tn", by_sun, sun - at_sun)
        return self.fraction + change + jnp.einsum("tnj,tj->tn", by_obs, obs - at_obs)
