"""Sunlight that the Earth sends up: a lit sphere that reflects diffusely, seen from above."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp

RINGS, SECTORS = 4, 10


class Glow(NamedTuple):
    """Earthshine at T places as light from Q directions each.

    Attributes
    ----------
    toward : (Q, T, 3)
        Unit vectors from the satellite to patches of the Earth, the axes of ``position``.
    strength : (Q, T)
        Irradiance on a surface square to each, as a share of the Sun's.
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
    """Light of a Lambertian Earth of one albedo, lit by the Sun, at a satellite.

    A patch at the surface normal m has the radiance (a/π) max(0, m·s), wherever it is seen from, so
    that the irradiance of a plane square to direction w is ∫ (a/π) max(0, m(w)·s) dΩ over the
    Earth's disc. The integral is taken by Gauss-Legendre nodes in the root of the cosine of the
    angle from nadir, less that of the limb, and evenly in azimuth from the Sun's. No air, clouds,
    seas or seasons: the albedo of real ground under a satellite at dusk is 0.1 to 0.8, 0.3 in the
    mean.

    Parameters
    ----------
    position : (T, 3)
        Geocentric, in radii of the Earth, of length > 1.
    sun : (T, 3)
        Unit vectors to the Sun.
    albedo : float
        Of Bond: the share of the light that the ground sends back.

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
    inward = 0.5 * (1.0 + node)[:, None]  # root of the way from limb to nadir: no kink at the limb
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
