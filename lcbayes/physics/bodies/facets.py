"""Facet normals: their two angles as in the papers, grids of normals, spherical harmonics."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lcbayes.core.jax_setup import jax, jnp


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
        Unit vectors, body frame. At g = ±1 the derivative by g is infinite; it is returned without
        its horizontal part to avoid NaN.

    References
    ----------
    Linares & Crassidis, eq. (6).
    """
    s2 = 1.0 - g**2
    off_pole = s2 > 0.0
    s = jnp.where(off_pole, jnp.sqrt(jnp.where(off_pole, s2, 1.0)), 0.0)
    return jnp.stack([jnp.cos(phi) * s, jnp.sin(phi) * s, g * jnp.ones_like(s)], axis=-1)


def across(normals: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that form a right-handed triad with each unit vector (..., 3) as third."""
    third = np.asarray(normals, float)
    first = np.cross(third, np.eye(3)[np.argmin(np.abs(third), axis=-1)])
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(third, first)


def angles(normals: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Azimuth φ in [0, 2π) and cosine of the polar angle g of unit vectors (..., 3)."""
    phi = jnp.mod(jnp.arctan2(normals[..., 1], normals[..., 0]), 2 * jnp.pi)
    return phi, jnp.clip(normals[..., 2], -1.0, 1.0)


def grid(n: int) -> np.ndarray:
    """n nearly equal-area directions on the sphere, a Fibonacci lattice.

    gᵢ = 1 − (2i + 1)/n, φᵢ = 2π i/Φ² with Φ the golden ratio. All represent cells of equal area, so
    every quadrature weight is 4π/n.

    Returns
    -------
    (n, 3)
        Unit vectors.
    """
    i = np.arange(n)
    g = 1.0 - (2.0 * i + 1.0) / n
    phi = 2.0 * np.pi * np.mod(i / ((1.0 + np.sqrt(5.0)) / 2.0) ** 2, 1.0)
    s = np.sqrt(1.0 - g**2)
    return np.stack([s * np.cos(phi), s * np.sin(phi), g], axis=1)


def rings(n: int) -> tuple[np.ndarray, np.ndarray]:
    """About n directions on parallels of latitude, with the weights of a quadrature of the sphere.

    The parallels are those of Gauss-Legendre quadrature. Each has equally spaced points, their
    number proportional to its length and at least six; every second one begins half a step later.

    Returns
    -------
    directions : (N, 3)
        Unit vectors, with N within a few per cent of n from n = 100 on.
    weights : (N,)
        Shares of the sphere; their sum is 1.

    References
    ----------
    Hesse, Sloan & Womersley 2010, Numerical Integration on the Sphere, Handbook of Geomathematics.
    """
    number = max(2, round(np.sqrt(np.pi * n / 4.0)))
    heights, shares = np.polynomial.legendre.leggauss(number)
    directions, weights = [], []
    for k, (g, share) in enumerate(zip(heights, shares, strict=True)):
        s = np.sqrt(1.0 - g * g)
        m = max(6, round(2.0 * number * s))
        phi = 2.0 * np.pi * (np.arange(m) + 0.5 * (k % 2)) / m
        directions.append(np.stack([s * np.cos(phi), s * np.sin(phi), np.full(m, g)], axis=1))
        weights.append(np.full(m, 0.5 * share / m))
    return np.concatenate(directions), np.concatenate(weights)


def spherical_harmonics(directions: ArrayLike, degree: int) -> np.ndarray:
    """Real spherical harmonics up to a degree, orthonormal over the sphere.

    Y_lm = √2 N_lm P_l^|m|(cos θ) {cos mφ for m > 0, sin |m|φ for m < 0}, Y_l0 = N_l0 P_l(cos θ),
    without the Condon-Shortley phase; ∫ Y_lm Y_l'm' dΩ = δ.

    Parameters
    ----------
    directions : (N, 3)
        Unit vectors.
    degree : int
        L ≥ 0.

    Returns
    -------
    (N, (L+1)²)
        Column l² + l + m holds Y_lm.
    """
    x, y, z = np.moveaxis(np.asarray(directions, float), -1, 0)
    out = np.empty((len(z), (degree + 1) ** 2))
    # sinᵐθ cos mφ and sinᵐθ sin mφ are polynomials in x and y, so nothing is singular at a pole.
    cos_m, sin_m = np.ones_like(x), np.zeros_like(x)
    p_mm = np.sqrt(1.0 / (4.0 * np.pi))  # normalised P_mm / sinᵐθ
    for m in range(degree + 1):
        below, p = np.zeros_like(z), np.full_like(z, p_mm)
        for order in range(m, degree + 1):
            centre = order * order + order
            if m == 0:
                out[:, centre] = p
            else:
                out[:, centre + m] = np.sqrt(2.0) * p * cos_m
                out[:, centre - m] = np.sqrt(2.0) * p * sin_m
            up = order + 1
            a = np.sqrt((4.0 * up**2 - 1.0) / (up**2 - m**2))
            b = np.sqrt(max((order**2 - m**2) / (4.0 * order**2 - 1.0), 0.0)) if order else 0.0
            below, p = p, a * (z * p - b * below)
        cos_m, sin_m = cos_m * x - sin_m * y, sin_m * x + cos_m * y
        p_mm *= np.sqrt((2.0 * m + 3.0) / (2.0 * m + 2.0))
    return out
