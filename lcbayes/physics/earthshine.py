"""Earthshine: sunlight reflected to a satellite by the Earth, a diffusely reflecting sphere."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp

RINGS, SECTORS = 4, 10


class Glow(NamedTuple):
    """Earthshine at T positions as light from Q directions each.

    Attributes
    ----------
    toward : (Q, T, 3)
        Unit vectors from the satellite to patches of the Earth, in the axes of ``position``.
    strength : (Q, T)
        Irradiance on a surface perpendicular to each direction, relative to that of the Sun.
    """

    toward: jax.Array
    strength: jax.Array


def glow(
    position: jax.Array,
    sun: jax.Array,
    albedo: jax.Array | float,
    rings: int = RINGS,
    sectors: int = SECTORS,
) -> Glow:
    """Irradiance of a satellite by a sunlit Lambertian Earth of uniform albedo.

    A patch with surface normal m has the radiance (a/π) max(0, m·s) in all directions. The
    irradiance of a plane perpendicular to direction w is therefore ∫ (a/π) max(0, m(w)·s) dΩ over
    the Earth's disc. The quadrature has Gauss-Legendre nodes in the square root of the difference
    between the cosines of the nadir angle and of its value at the limb, and equal steps in azimuth
    from the Sun. Air, clouds, seas and seasons are neglected: the albedo of the real ground below a
    satellite at dusk ranges from 0.1 to 0.8, with a mean of 0.3.

    Parameters
    ----------
    position : (T, 3)
        Geocentric, in Earth radii, with length > 1.
    sun : (T, 3)
        Unit vectors to the Sun.
    albedo : float
        Bond albedo: the fraction of the light reflected by the ground.

    References
    ----------
    Fankhauser, Tyson & Askari 2023, AJ 166, 59, sec. 3 (the same, on a grid of the ground).
    """
    radius = jnp.linalg.norm(position, axis=-1)
    up = position / radius[:, None]
    across = sun - jnp.sum(sun * up, axis=-1, keepdims=True) * up
    length = jnp.linalg.norm(across, axis=-1, keepdims=True)
    spare = jnp.cross(up, jnp.eye(3)[jnp.argmin(jnp.abs(up), axis=-1)])
    spare = spare / jnp.linalg.norm(spare, axis=-1, keepdims=True)
    x = jnp.where(length > 1e-9, across / jnp.maximum(length, 1e-9), spare)
    y = jnp.cross(up, x)

    node, weight = np.polynomial.legendre.leggauss(rings)
    edge = jnp.sqrt(1.0 - radius**-2)  # cosine from nadir of the Earth's limb
    inward = 0.5 * (1.0 + node)[:, None]  # square root of the fraction from limb to nadir: smooth
    cosine = edge + (1.0 - edge) * inward**2  # (R, T)
    sine = jnp.sqrt(jnp.maximum(1.0 - cosine**2, 0.0))
    azimuth = 2.0 * jnp.pi * (jnp.arange(sectors) + 0.5) / sectors
    around = jnp.cos(azimuth)[:, None, None] * x + jnp.sin(azimuth)[:, None, None] * y  # (S, T, 3)
    toward = sine[:, None, :, None] * around - cosine[:, None, :, None] * up
    far = radius * cosine - jnp.sqrt(jnp.maximum(1.0 - (radius * sine) ** 2, 0.0))
    ground = position + far[:, None, :, None] * toward
    lit = jnp.maximum(jnp.sum(ground * sun, axis=-1), 0.0)  # (R, S, T)
    patch = (1.0 - edge) * inward * weight[:, None] * (2.0 * jnp.pi / sectors)  # (R, T)
    strength = albedo / jnp.pi * lit * patch[:, None]
    n = rings * sectors
    return Glow(toward.reshape(n, *sun.shape), strength.reshape(n, -1))
