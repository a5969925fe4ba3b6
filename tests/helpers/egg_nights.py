"""Seven nights and a survey of a body of eight unlike octants, whose turn is nearly two half turns.

Plain NumPy, without any code of the package but its `LightCurve`. The body is many facets under the
law of Lommel and Seeliger with a tenth of Lambert's. Its light varies so little that a few nights
fit twice the period nearly as well.
"""

from __future__ import annotations

import numpy as np

from lcbayes.data.lightcurve import LightCurve

PERIOD_H, POLE_DEG = 9.2137, (67.0, 31.0)
NEGATIVE, POSITIVE = np.array([0.9, 0.8, 0.75]), np.array([1.45, 1.0, 0.8])  # semi-axes
YEAR, DAYS = 365.25, 2300


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def _facets(n: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    """Normals (n, 3) and areas (n,), from nearly even points of a sphere."""
    i = np.arange(n) + 0.5
    z, around = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    flat = np.sqrt(1 - z * z)
    point = np.stack([flat * np.cos(around), flat * np.sin(around), z], 1)
    axes = np.where(point > 0, POSITIVE, NEGATIVE)
    length = np.linalg.norm(point / axes, axis=1)
    return point / axes / length[:, None], length * axes.prod(1)


def directions(day: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vectors (T, 3) to Sun and Earth of an asteroid at 2.7 au."""
    mean, tilt = 2 * np.pi * day / (YEAR * 2.7**1.5) + 1.4, np.radians(7.0)
    asteroid = 2.7 * np.stack(
        [np.cos(mean), np.sin(mean) * np.cos(tilt), np.sin(mean) * np.sin(tilt)], -1
    )
    home = 2 * np.pi * day / YEAR + 0.3
    earth = np.stack([np.cos(home), np.sin(home), 0 * home], -1)
    return -asteroid, earth - asteroid


def brightness(day: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Flux (T,) of the attitude at ``day``, from the directions at ``seen``."""
    lon, colat = np.radians(POLE_DEG[0]), np.pi / 2 - np.radians(POLE_DEG[1])
    c, s, a, b = np.cos(lon), np.sin(lon), np.cos(colat), np.sin(colat)
    tilt = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.array(
        [[a, 0, b], [0, 1, 0], [-b, 0, a]]
    )
    angle = 2 * np.pi * day * 24 / PERIOD_H
    normals, areas = _facets()

    def cosines(vector: np.ndarray) -> np.ndarray:
        x, y, z = (_unit(vector) @ tilt).T
        body = [
            np.cos(angle) * x + np.sin(angle) * y,
            np.cos(angle) * y - np.sin(angle) * x,
            z,
        ]
        return np.maximum(np.stack(body, 1) @ normals.T, 0.0)

    sun, obs = map(cosines, directions(seen))
    return (sun * obs / np.maximum(sun + obs, 1e-9) + 0.1 * sun * obs) @ areas


def observed(early_h: float = 0.0, which: int = 3) -> LightCurve:
    """Seven nights of 1 % and a survey of 4 %; the times of one night are too early."""
    rng = np.random.default_rng(417)
    day = np.arange(0.0, DAYS)
    sun, obs = directions(day)
    elongation = np.degrees(np.arccos(np.sum(_unit(sun - obs) * _unit(-obs), axis=-1)))
    dark, seen = day[elongation > 110], day[elongation > 70]
    nights = dark[np.linspace(4, len(dark) - 5, 7).astype(int)]
    times = [n + np.sort(rng.uniform(0.2, 0.45, 45)) for n in nights]
    times.append(np.sort(rng.choice(seen, 140) + rng.uniform(0.2, 0.45, 140)))
    flux = []
    for k, t in enumerate(times):
        light = brightness(t + (early_h / 24 if k == which else 0.0), t)
        noise = 0.01 if k < len(nights) else 0.04
        light *= np.exp(noise * rng.standard_normal(len(t)))
        flux.append(light / light.mean())
    t = np.concatenate(times)
    sun, obs = directions(t)
    return LightCurve(
        t=86400 * t, brightness=np.concatenate(flux), error=None, sun=_unit(sun), obs=_unit(obs),
        kind="flux", curve=np.repeat(np.arange(len(times)), [len(x) for x in times]),
        free_scale=np.ones(len(times), bool), frame="ecliptic-j2000", epoch_jd=2457100.5,
    )  # fmt: skip
