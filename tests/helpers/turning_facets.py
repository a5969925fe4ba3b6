"""Facets that turn at a constant rate, in NumPy: directions in body axes and Lambert's law."""

from __future__ import annotations

import numpy as np


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def in_body_axes(vectors: np.ndarray, t: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Inertial vectors (T, 3) in the axes of bodies with ω (..., 3), by Rodrigues' formula.

    Body axes are inertial at t = 0. The result is (..., T, 3).
    """
    rate = np.linalg.norm(omega, axis=-1)[..., None, None]
    axis = omega[..., None, :] / rate
    c, s = np.cos(rate * t[:, None]), -np.sin(rate * t[:, None])
    along = np.sum(vectors * axis, axis=-1, keepdims=True) * axis
    return along + c * (vectors - along) + s * np.cross(axis, vectors)


def cosines(sun: np.ndarray, obs: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """μ₀ and μ (..., T, N) of normals (..., N, 3), negative where a facet is turned away."""
    columns = np.swapaxes(normals, -1, -2)
    return sun @ columns, obs @ columns


def flux(mu0: np.ndarray, mu: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Σ α μ₀μ/π, (..., T), of albedo-areas (..., N)."""
    lit = np.maximum(mu0, 0.0) * np.maximum(mu, 0.0) / np.pi
    return np.einsum("...tn,...n->...t", lit, areas)
