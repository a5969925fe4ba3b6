"""What of each panel is lit and seen near some directions of Sun and observer, to first order."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from lcbayes.core.jax_setup import jax, jnp


class Slopes(NamedTuple):
    """Derivatives of the fraction of each polygon at some directions.

    Attributes
    ----------
    by_sun, by_obs : (T, R, 3)
    sun, obs : (T, 3)
    """

    by_sun: jax.Array
    by_obs: jax.Array
    sun: jax.Array
    obs: jax.Array


class Lit(NamedTuple):
    """The fraction of each polygon that no solid shades and none hides, about some directions.

    Attributes
    ----------
    fraction : (T, R)
    polygon : (N,) int, or None
        Of which each panel has the fraction; None if the panels are the polygons.
    slopes : Slopes or None
        None where the fraction is the same along all directions.

    Examples
    --------
    >>> along, across = jnp.array([[1.0, 0, 0]]), jnp.array([[0.0, 1, 0]])
    >>> slopes = Slopes(jnp.array([[[0.0, 2, 0]]]), jnp.zeros((1, 1, 3)), along, across)
    >>> lit = Lit(jnp.array([[0.5]]), jnp.array([0, 0]), slopes)
    >>> lit(along + 0.1 * across, across).tolist()
    [[0.7, 0.7]]
    >>> lit.fixed(along + 0.1 * across, across).tolist()
    [[0.5, 0.5]]
    """

    fraction: jax.Array
    polygon: jax.Array | None = None
    slopes: Slopes | None = None

    @property
    def fixed(self) -> Lit:
        """The same fraction along all directions."""
        return self._replace(slopes=None)

    def __call__(self, sun: jax.Array, obs: jax.Array) -> jax.Array:
        """The fraction of each panel (T, N) along directions (T, 3)."""
        fraction = self.fraction
        if (at := self.slopes) is not None:
            fraction = fraction + jnp.einsum("trj,tj->tr", at.by_sun, sun - at.sun)
            fraction = fraction + jnp.einsum("trj,tj->tr", at.by_obs, obs - at.obs)
        return fraction if self.polygon is None else fraction[:, self.polygon]


class Shading(NamedTuple):
    """How the shadows of a body are computed.

    Attributes
    ----------
    about : callable
        Compiled function of directions to Sun and observer, (T, 3) each, body axes, that gives
        `Lit` about them; fixed with ``slopes=False``.
    polygons : int
        R of the result.
    """

    about: Callable[..., Lit]
    polygons: int
