"""Simulated sparse points of a triaxial ellipsoid, a few a night over four years.

Plain NumPy, without any code of the package but its `LightCurve`. An ellipsoid under geometric
scattering has the brightness √(bᵀCb) of its projected area along the bisector.
"""

from __future__ import annotations

import numpy as np

from lcbayes.data.lightcurve import LightCurve

AXES = np.array([1.0, 0.7, 0.55])
POLE = np.array([0.36, 0.48, 0.8])
PERIOD_H = 7.3
YEAR = 365.25


def directions(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (T, 3) to Sun and Earth of an asteroid at 2.6 au, t in days."""
    around = 2 * np.pi * t / (YEAR * 2.6**1.5)
    home = 2 * np.pi * t / YEAR + 0.4
    tilt = 0.15
    asteroid = 2.6 * np.stack(
        [np.cos(around), np.sin(around) * np.cos(tilt), np.sin(around) * np.sin(tilt)], 1
    )
    earth = np.stack([np.cos(home), np.sin(home), 0 * t], 1)
    sun, obs = -asteroid, earth - asteroid
    sun, obs = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (sun, obs))
    return sun, obs


def times(rng: np.random.Generator, n_nights: int = 30, per_night: int = 4) -> np.ndarray:
    """Days of points within half an hour of random nights at phase angles below 30°."""
    days = np.arange(0.0, 4 * YEAR)
    sun, obs = directions(days)
    good = days[np.sum(sun * obs, axis=1) > np.cos(np.radians(30.0))]
    nights = np.sort(rng.choice(good, n_nights, replace=False))
    return np.concatenate([n + 0.3 + np.sort(rng.uniform(0, 0.02, per_night)) for n in nights])


def brightness(
    t: np.ndarray, axes: np.ndarray = AXES, period_h: float = PERIOD_H, pole: np.ndarray = POLE
) -> np.ndarray:
    """Flux of an ellipsoid with a phase law, t in days."""
    sun, obs = directions(t)
    bisector = sun + obs
    bisector /= np.linalg.norm(bisector, axis=1, keepdims=True)
    x = np.cross([0.0, 0.0, 1.0], pole)
    x /= np.linalg.norm(x)
    y = np.cross(pole, x)
    angle = 2 * np.pi * 24.0 * t / period_h
    cos, sin = np.cos(angle), np.sin(angle)
    a, b, c = bisector @ x, bisector @ y, bisector @ pole
    body = np.stack([cos * a + sin * b, cos * b - sin * a, c], 1)
    flux = np.prod(axes) * np.linalg.norm(body / axes, axis=1)
    alpha = np.arccos(np.sum(sun * obs, axis=1))
    return flux * np.exp(-1.5 * alpha + 0.3 * np.exp(-alpha / 0.07))


def box_brightness(t: np.ndarray, edges: np.ndarray, period_h: float = PERIOD_H) -> np.ndarray:
    """Flux of a box that spins about its shortest edge, under Lommel and Seeliger's law."""
    sun, obs = directions(t)
    x = np.cross([0.0, 0.0, 1.0], POLE)
    x /= np.linalg.norm(x)
    angle = 2 * np.pi * 24.0 * t / period_h
    cos, sin = np.cos(angle), np.sin(angle)
    flux = np.zeros(t.size)
    body = []
    for v in (sun, obs):
        a, b, c = v @ x, v @ np.cross(POLE, x), v @ POLE
        body.append(np.stack([cos * a + sin * b, cos * b - sin * a, c], 1))
    for axis in range(3):
        for side in (-1.0, 1.0):
            mu0, mu = (np.maximum(side * v[:, axis], 0.0) for v in body)
            flux += np.prod(edges) / edges[axis] * mu0 * mu / np.maximum(mu0 + mu, 1e-9)
    return flux


def observed(
    noise: float = 0.02,
    axes: np.ndarray = AXES,
    seed: int = 1,
    period_h: float = PERIOD_H,
    pole: np.ndarray = POLE,
) -> LightCurve:
    """Sparse points of an ellipsoid with a phase law and one outlier."""
    rng = np.random.default_rng(seed)
    t = times(rng)
    sun, obs = directions(t)
    flux = brightness(t, axes, period_h, pole) * np.exp(noise * rng.standard_normal(t.size))
    flux[7] *= 2.0
    return LightCurve(
        t=86400.0 * t,
        brightness=flux / flux.mean(),
        error=None,
        sun=sun,
        obs=obs,
        kind="flux",
        free_scale=np.array([True]),
        frame="ecliptic-j2000",
    )
