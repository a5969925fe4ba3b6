"""Light curves of an L-shaped body that shades itself: points on its faces and rays, in NumPy.

Shares no code with the package: a body of two boxes, each face sampled by a grid of points, each
point lit and seen where the ray to the Sun and to the observer meets neither box.
"""

from __future__ import annotations

import numpy as np

Box = tuple[np.ndarray, np.ndarray]  # lowest and highest corner


def boxes(arm: float, length: float = 2.0, width: float = 1.0, thick: float = 1.0) -> list[Box]:
    """A bar along x, and an arm of this height on one end of it."""
    return [
        (np.zeros(3), np.array([length, width, thick])),
        (np.array([0.0, 0.0, thick]), np.array([thick, width, thick + arm])),
    ]


def points(of: list[Box], per_side: int = 10) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (P, 3) on the outer faces, their normals (P, 3) and areas (P,)."""
    place, normal, area = [], [], []
    x = (np.arange(per_side) + 0.5) / per_side
    for low, high in of:
        size = high - low
        for axis in range(3):
            u, v = [k for k in range(3) if k != axis]
            for side in (0.0, 1.0):
                p = np.empty((per_side, per_side, 3))
                p[..., axis] = low[axis] + side * size[axis]
                p[..., u] = (low[u] + x * size[u])[:, None]
                p[..., v] = (low[v] + x * size[v])[None]
                n = np.zeros(3)
                n[axis] = 2.0 * side - 1.0
                p = p.reshape(-1, 3)
                outside = ~inside(of, p + 1e-6 * n)
                place.append(p[outside])
                normal.append(np.tile(n, (int(outside.sum()), 1)))
                area.append(np.full(int(outside.sum()), size[u] * size[v] / per_side**2))
    return np.concatenate(place), np.concatenate(normal), np.concatenate(area)


def inside(of: list[Box], p: np.ndarray) -> np.ndarray:
    return np.any([np.all((p > low) & (p < high), axis=-1) for low, high in of], axis=0)


def free(of: list[Box], place: np.ndarray, normal: np.ndarray, toward: np.ndarray) -> np.ndarray:
    """Whether the ray from each place leaves the body without meeting it, (P,), by slabs."""
    start = place + 1e-6 * normal
    with np.errstate(divide="ignore"):
        inverse = 1.0 / toward
    out = np.ones(len(place), bool)
    for low, high in of:
        a, b = (low - start) * inverse, (high - start) * inverse
        enter, leave = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
        out &= ~(leave > np.maximum(enter, 0.0))
    return out


def flux(
    of: list[Box], sun: np.ndarray, obs: np.ndarray, shadows: bool = True, per_side: int = 10
) -> np.ndarray:
    """Lambertian flux at unit distance and irradiance, albedo 1, (T,) m²."""
    place, normal, area = points(of, per_side)
    out = np.empty(len(sun))
    for i, (s, o) in enumerate(zip(sun, obs, strict=True)):
        light = np.maximum(normal @ s, 0.0) * np.maximum(normal @ o, 0.0) * area / np.pi
        if shadows:
            light = light * free(of, place, normal, s) * free(of, place, normal, o)
        out[i] = light.sum()
    return out
