"""A box and a cylinder that turn at a constant rate, in NumPy: brightness written down once more.

Lambert's law, r/π per unit solid angle; the side of the cylinder is summed over its azimuth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

AZIMUTHS = 4000


def lambert(sun: np.ndarray, obs: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """μ₀ μ/π of one flat face of unit area, (T,)."""
    return np.clip(sun @ normal, 0.0, None) * np.clip(obs @ normal, 0.0, None) / np.pi


def box(sun: np.ndarray, obs: np.ndarray, sides: Sequence[float], albedo: float) -> np.ndarray:
    """Flux (T,) of a box with sides along x, y and z; directions in body axes."""
    total = np.zeros(len(sun))
    for i in range(3):
        normal = np.eye(3)[i]
        area = float(np.prod(sides)) / sides[i]
        total += area * (lambert(sun, obs, normal) + lambert(sun, obs, -normal))
    return albedo * total


def cylinder(
    sun: np.ndarray, obs: np.ndarray, radius: float, length: float, side: float, end: float
) -> np.ndarray:
    """Flux (T,) of a cylinder about z, with albedos of its side and of its ends."""
    angle = 2.0 * np.pi * (np.arange(AZIMUTHS) + 0.5) / AZIMUTHS
    across = np.stack([np.cos(angle), np.sin(angle)])
    mu0, mu = (np.clip(v[:, :2] @ across, 0.0, None) for v in (sun, obs))
    strip = 2.0 * np.pi * radius * length / AZIMUTHS
    axis = np.array([0.0, 0.0, 1.0])
    ends = lambert(sun, obs, axis) + lambert(sun, obs, -axis)
    return side * strip / np.pi * (mu0 * mu).sum(axis=1) + end * np.pi * radius**2 * ends


def in_body(
    t: np.ndarray, attitude: np.ndarray, omega: np.ndarray, sun: np.ndarray, obs: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Body components (T, 3) of directions: A(t) = exp([ω×] t) A, from body to inertial."""
    turns = Rotation.from_rotvec(t[:, None] * omega).as_matrix() @ attitude
    return np.einsum("ti,tij->tj", sun, turns), np.einsum("ti,tij->tj", obs, turns)


def geometry(
    starts: Sequence[float], n: int, length: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and directions of passes: the Sun at rest, the observer going round by 70°."""
    t = np.concatenate([start + np.linspace(0.0, length, n) for start in starts])
    sun = np.tile(np.array([0.6, 0.64, 0.48]), (t.size, 1))
    obs = []
    for i, start in enumerate(starts):
        angle = 0.4 + 0.5 * i + 1.2 * (t[i * n : (i + 1) * n] - start) / length
        tilt = 0.3 + 0.2 * i
        obs.append(
            np.stack(
                [np.cos(angle), np.sin(angle) * np.cos(tilt), np.sin(angle) * np.sin(tilt)], axis=1
            )
        )
    return t, sun, np.concatenate(obs)
