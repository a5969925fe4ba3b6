"""Facets that turn at a constant rate, in NumPy: directions in body axes and Lambert's law."""

from __future__ import annotations

import numpy as np

from tests.helpers import small_curves

GAP = 5400.0  # s between the passes of a `Truth`


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


class Truth:
    """Three facets seen in passes, by default two during some twenty turns."""

    pole = np.array([0.48, -0.6, 0.64])
    normals = np.array([[0.6, 0.0, 0.8], [-0.8, 0.6, 0.0], [0.0, -0.8, -0.6]])
    areas = np.array([2.0, 1.0, 3.0])

    def __init__(
        self,
        snr: float = 50.0,
        period: float = 300.0,
        passes: tuple[float, ...] = (0.0, GAP),
        drift: float = 0.0,
    ) -> None:
        self.omega = 2 * np.pi / period * self.pole
        rng = np.random.default_rng(5)
        t = np.concatenate([start + np.linspace(0, 400, 40) for start in passes])
        changing = t - t.max() / 2  # the rate is ω (1 + drift × changing/T)
        turned = t + drift * (changing**2 - changing[0] ** 2) / (2 * t.max())
        lon = 0.9 + 1.3 * (t % GAP) / 400 + 0.8 * (t // GAP)
        obs = np.stack([np.cos(lon), 0.8 * np.sin(lon), 0.6 * np.sin(lon)], axis=1)
        sun = np.tile([0.0, 0.6, 0.8], (t.size, 1))
        s, o = (in_body_axes(v, turned, self.omega) for v in (sun, obs))
        exact = flux(*cosines(s, o, self.normals), self.areas)
        error = float(exact.mean()) / snr
        noisy = exact + error * rng.standard_normal(t.size)
        self.curve = small_curves.of_flux(t, noisy, error, sun, obs)
