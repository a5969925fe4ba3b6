"""Light curves of known bodies seen from random directions, for tests of albedo-areas."""

from __future__ import annotations

import numpy as np

from lcbayes.data.lightcurve import LightCurve
from lcbayes.physics.bodies.shapes import Body


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    """Random unit vectors (n, 3)."""
    vectors = rng.normal(size=(n, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def lambertian(sun: np.ndarray, obs: np.ndarray, body: Body) -> np.ndarray:
    """Σ A μ₀μ/π over facets lit and seen, written down once more."""
    return (
        np.maximum(sun @ body.normals.T, 0)
        * np.maximum(obs @ body.normals.T, 0)
        @ (body.areas / np.pi)
    )


def curve_of(body: Body, n: int = 300, noise: float = 0.01, seed: int = 0, **fields) -> LightCurve:
    """Lambertian facets, each epoch from other directions, errors a part of the mean flux."""
    rng = np.random.default_rng(seed)
    sun, obs = directions(rng, n), directions(rng, n)
    flux = lambertian(sun, obs, body)
    error = np.full(n, noise * flux.mean())
    values = {"error": error, "kind": "flux"} | fields
    return LightCurve(
        t=np.arange(float(n)),
        brightness=flux + error * rng.normal(size=n),
        sun=sun,
        obs=obs,
        **values,
    )
