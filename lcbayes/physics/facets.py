"""Facet normals: the two angles of the papers, and grids of normals on the sphere."""

from __future__ import annotations

from lcbayes._jax import jax, jnp


def normal(phi: jax.Array, g: jax.Array) -> jax.Array:
    """Outward unit normal from its azimuth and the cosine of its polar angle.

    u = [cos φ √(1−g²), sin φ √(1−g²), g].

    Parameters
    ----------
    phi : (...) rad
        Azimuth in the body frame.
    g : (...)
        Cosine of the polar angle, in [−1, 1].

    Returns
    -------
    (..., 3)
        Unit vectors, body frame.

    References
    ----------
    Linares & Crassidis, eq. (6).
    """
    s = jnp.sqrt(jnp.maximum(1.0 - g**2, 0.0))
    return jnp.stack([jnp.cos(phi) * s, jnp.sin(phi) * s, g * jnp.ones_like(s)], axis=-1)


def angles(normals: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Azimuth φ in [0, 2π) and cosine of the polar angle g of unit vectors (..., 3)."""
    phi = jnp.mod(jnp.arctan2(normals[..., 1], normals[..., 0]), 2 * jnp.pi)
    return phi, jnp.clip(normals[..., 2], -1.0, 1.0)
