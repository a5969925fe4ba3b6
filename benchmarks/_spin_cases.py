"""Light curves of spinning bodies drawn from the prior, for `search.py`: orbit, passes, facets."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lcbayes.data.lightcurve import LightCurve

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.helpers.low_earth_orbit import Orbit

MAX_TURNS = 2000.0
POINTS_PER_TURN = 4.0  # at least, within a pass
LOG_AREA_SD = 1.0


@dataclass(frozen=True)
class Case:
    """A light curve and the truth that it was made from.

    Attributes
    ----------
    curve : LightCurve
    omega : (3,) rad/s
    normals : (N, 3), body axes, which are the inertial axes at the first epoch
    areas : (N,) m², albedo-areas
    omega_sd : rad/s, of the prior of ω
    turns : over the time base
    """

    curve: LightCurve
    omega: np.ndarray
    normals: np.ndarray
    areas: np.ndarray
    omega_sd: float
    turns: float


def turned(vectors: np.ndarray, t: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """Inertial vectors (T, 3) in body axes, by Rodrigues' formula for the angle −|ω| t."""
    rate = np.linalg.norm(omega)
    axis = omega / rate
    c, s = np.cos(rate * t)[:, None], np.sin(rate * t)[:, None]
    along = (vectors @ axis)[:, None] * axis
    return along + c * (vectors - along) - s * np.cross(axis, vectors)


def shouldered(x: np.ndarray) -> np.ndarray:
    """x [1 − (1 − x/2)⁵], the factor of the Ashikhmin-Shirley diffuse term."""
    return x * (1.0 - (1.0 - 0.5 * x) ** 5)


def shine(sun: np.ndarray, obs: np.ndarray, normals: np.ndarray, areas: np.ndarray) -> np.ndarray:
    """Flux (T,) of the diffuse facets of Linares & Crassidis at unit distance."""
    mu0, mu = np.maximum(sun @ normals.T, 0.0), np.maximum(obs @ normals.T, 0.0)
    return (shouldered(mu0) * shouldered(mu) / np.pi) @ areas


def passes_of(orbit: Orbit, nights: int, n_passes: int, rng) -> list[tuple[float, float]]:
    """Passes within some nights, or an empty list."""
    every = orbit.passes(days=float(nights))
    if len(every) < n_passes:
        return []
    chosen = np.sort(rng.permutation(len(every))[:n_passes])
    return [every[i] for i in chosen]


def drawn(seed: int, snr: float, points: int = 60) -> Case:
    """A case: 3 to 6 facets, 2 to 6 passes over one to three nights, 5 to 2,000 turns.

    Facets are uniform on the sphere with log-normal areas and each is lit and seen at some epoch;
    turns are uniform in their logarithm, up to `POINTS_PER_TURN` points a turn.
    """
    rng = np.random.default_rng([seed, int(snr)])
    while True:
        n_passes, nights = int(rng.integers(2, 7)), int(rng.integers(1, 4))
        orbit = Orbit.random(rng)
        spans = passes_of(orbit, nights, n_passes, rng)
        if not spans:
            continue
        t = np.concatenate([np.linspace(a, min(b, a + 480.0), points) for a, b in spans])
        step = max((min(b, a + 480.0) - a) / (points - 1) for a, b in spans)
        sun, obs, _ = orbit.look(t)
        t = t - t[0]
        most = min(MAX_TURNS, t[-1] / (POINTS_PER_TURN * step))
        if most <= 5.0:
            continue
        n_facets = int(rng.integers(3, 7))
        normals = rng.normal(size=(n_facets, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        areas = np.exp(LOG_AREA_SD * rng.normal(size=n_facets))
        pole = rng.normal(size=3)
        turns = float(np.exp(rng.uniform(np.log(5.0), np.log(most))))
        omega = 2 * np.pi * turns / t[-1] * pole / np.linalg.norm(pole)
        s, o = turned(sun, t, omega), turned(obs, t, omega)
        visible = np.all(np.max(np.minimum(s @ normals.T, o @ normals.T), axis=0) > 0)
        flux = shine(s, o, normals, areas)
        if not visible or np.median(flux) < 0.05 * flux.max():
            continue
        error = np.full(t.size, flux.mean() / snr)
        curve = LightCurve(
            t=t,
            brightness=flux + error * rng.standard_normal(t.size),
            error=error,
            kind="flux",
            sun=sun,
            obs=obs,
            free_scale=np.array([False]),
        )
        fastest = 2 * np.pi * most / t[-1]
        return Case(curve, omega, normals, areas, fastest / 3.0, turns)
