"""Two facets as one facet that is divided: their centre, share and angle.

Facets of areas uα and (1 − u)α lie at angles (1 − u)θ and uθ on opposite sides of a direction n on
the sphere, their centre. The moves of `samplers.facet_moves` split, merge and exchange such pairs.
"""

from __future__ import annotations

import numpy as np

from lcbayes.core.jax_setup import jax, jnp

WIDTHS = np.radians([2.0, 5.0, 12.0, 30.0])  # of the angle between the parts of a split facet


def merged(normal: jax.Array, log_area: jax.Array):
    """The facet that two facets (2, 3), (2,) are merged into, the share u of the first in its area,
    and the angle θ between them."""
    centre, _, u, angle = between(normal, log_area)
    return (centre, jnp.logaddexp(log_area[0], log_area[1])), u, angle


def between(normal: jax.Array, log_area: jax.Array):
    """The centre of two facets (2, 3), (2,), the direction along the sphere from there to the
    first, the share u of the first in their area, and the angle θ between them."""
    u = jax.nn.sigmoid(log_area[0] - log_area[1])
    cosine = normal[0] @ normal[1]
    across = normal[0] - cosine * normal[1]
    sine = jnp.sqrt(jnp.sum(across**2) + 1e-30)
    angle, across = jnp.arctan2(sine, cosine), across / sine
    cos, sin = jnp.cos(u * angle), jnp.sin(u * angle)
    return _unit(cos * normal[1] + sin * across), _unit(cos * across - sin * normal[1]), u, angle


def divided(centre: jax.Array, along: jax.Array, log_area: jax.Array, u: jax.Array, angle):
    """The two facets, normals (2, 3) and ln(area) (2,), of which `between` gives these."""
    offset = jnp.stack([(1.0 - u) * angle, -u * angle])[:, None]
    normals = jnp.cos(offset) * centre + jnp.sin(offset) * along
    return normals, log_area + jnp.log(jnp.stack([u, 1.0 - u]))


def drawn_split(key: jax.Array, normal: jax.Array, log_area: jax.Array):
    """The inverse of `merged`, with random u, θ and direction ψ."""
    key_share, key_width, key_angle, key_turn = jax.random.split(key, 4)
    u = jax.random.uniform(key_share, minval=1e-9, maxval=1.0 - 1e-9)
    angle = jax.random.choice(key_width, jnp.asarray(WIDTHS)) * jax.random.rayleigh(key_angle, 1.0)
    angle = jnp.maximum(angle, 1e-9)
    axis = jnp.eye(3)[jnp.argmin(jnp.abs(normal))]
    first = _unit(jnp.cross(normal, axis))
    turn = 2.0 * jnp.pi * jax.random.uniform(key_turn)
    along = jnp.cos(turn) * first + jnp.sin(turn) * jnp.cross(normal, first)
    return divided(normal, along, log_area, u, angle), u, angle


def log_angle(angle: jax.Array) -> jax.Array:
    """ln of the density of θ and ψ in `drawn_split`; none for θ above π, which `merged` cannot
    undo."""
    widths = jnp.asarray(WIDTHS)
    each = jnp.log(angle / widths**2) - 0.5 * (angle / widths) ** 2
    density = jax.nn.logsumexp(each) - np.log(len(WIDTHS) * 2.0 * np.pi)
    return jnp.where(angle < jnp.pi, density, jnp.inf)


def log_split(u: jax.Array, angle: jax.Array) -> jax.Array:
    """ln of the density of the parts of a split facet over that of the facet, dΩ dln α each.

    The volume dΩᵢ dΩⱼ dln αᵢ dln αⱼ is sin θ/(u(1 − u)) dθ dψ du dΩ dln α, and u is uniform.
    """
    return jnp.log(u * (1.0 - u)) - jnp.log(jnp.sin(angle)) + log_angle(angle)


def log_exchange(u: jax.Array, angle: jax.Array) -> jax.Array:
    """ln of the volume sin θ/[2θ u²(1 − u)²] of an exchange, to a constant; none for θ above π,
    which `between` cannot undo."""
    sinc = jnp.sinc(jnp.minimum(angle, np.pi) / np.pi)
    inside = jnp.log(jnp.maximum(sinc, 1e-300)) - 2.0 * jnp.log(u * (1.0 - u))
    return jnp.where(angle < jnp.pi, inside, -jnp.inf)


def _unit(vector: jax.Array) -> jax.Array:
    return vector / jnp.sqrt(jnp.sum(vector**2))
