"""Passes of a low orbit over a site, and what a spinning body shows there: written down once more.

Circular orbits about a spherical Earth that turns evenly, the Sun at rest: as much as the spin
methods need, and a thousand times faster than SGP4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from lcbayes.data.lightcurve import LightCurve
from lcbayes.physics.bodies import shapes

EARTH_KM, MU, DAY = 6378.0, 398600.0, 86164.1
STEP = 20.0


@dataclass(frozen=True)
class Orbit:
    """A circular orbit, a site and the Sun's direction, inertial axes."""

    radius_km: float
    inclination: float
    node: float
    phase: float
    lat: float
    lon: float
    sun: np.ndarray

    @classmethod
    def random(cls, rng: np.random.Generator) -> Orbit:
        ecliptic = rng.uniform(0, 2 * np.pi)
        tilt = np.radians(23.44)
        sun = np.array(
            [np.cos(ecliptic), np.sin(ecliptic) * np.cos(tilt), np.sin(ecliptic) * np.sin(tilt)]
        )
        return cls(
            EARTH_KM + rng.uniform(500, 1200),
            np.radians(rng.choice([51.6, 74.0, 82.0, 98.0])),
            rng.uniform(0, 2 * np.pi),
            rng.uniform(0, 2 * np.pi),
            np.radians(rng.uniform(-55, 55)),
            rng.uniform(0, 2 * np.pi),
            sun,
        )

    def place(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Satellite and site, km, (T, 3) each."""
        u = self.phase + np.sqrt(MU / self.radius_km**3) * t
        x, y = np.cos(u), np.sin(u)
        ci, si, cn, sn = (
            np.cos(self.inclination),
            np.sin(self.inclination),
            np.cos(self.node),
            np.sin(self.node),
        )
        satellite = self.radius_km * np.stack(
            [cn * x - sn * ci * y, sn * x + cn * ci * y, si * y], 1
        )
        a = self.lon + 2 * np.pi * t / DAY
        site = EARTH_KM * np.stack(
            [
                np.cos(self.lat) * np.cos(a),
                np.cos(self.lat) * np.sin(a),
                np.full_like(a, np.sin(self.lat)),
            ],
            1,
        )
        return satellite, site

    def look(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Sun and observer seen from the satellite, (T, 3), and whether it can be observed."""
        satellite, site = self.place(t)
        line = site - satellite
        obs = line / np.linalg.norm(line, axis=1, keepdims=True)
        zenith = site / EARTH_KM
        high = -np.sum(obs * zenith, axis=1) > np.sin(np.radians(20.0))
        dark = zenith @ self.sun < np.sin(np.radians(-8.0))
        along = satellite @ self.sun
        aside = np.linalg.norm(satellite - along[:, None] * self.sun, axis=1)
        lit = (along > 0) | (aside > EARTH_KM)
        return np.broadcast_to(self.sun, obs.shape), obs, high & dark & lit

    def passes(self, days: float = 6.0) -> list[tuple[float, float]]:
        """First and last second of the passes of at least four minutes."""
        t = np.arange(0.0, days * DAY, STEP)
        rows = np.flatnonzero(self.look(t)[2])
        runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if rows.size else []
        return [(float(t[r[0]]), float(t[r[-1]])) for r in runs if t[r[-1]] - t[r[0]] >= 240.0]


def campaign(rng: np.random.Generator, count: int) -> tuple[Orbit, list[tuple[float, float]]]:
    """A random orbit with ``count`` of its passes."""
    while True:
        orbit = Orbit.random(rng)
        result = orbit.passes()
        if len(result) >= count:
            return orbit, [result[i] for i in sorted(rng.permutation(len(result))[:count])]


def triad(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors that make a right-handed triad with an axis."""
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return first, np.cross(axis, first)


def spun(vectors: np.ndarray, t: np.ndarray, pole: np.ndarray, omega: float) -> np.ndarray:
    """Components in the frame of a body that turns about its z axis, which is the pole."""
    e1, e2 = triad(pole)
    x, y, angle = vectors @ e1, vectors @ e2, omega * t
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * x + s * y, c * y - s * x, vectors @ pole], axis=1)


def shine(
    body: shapes.Body, sun: np.ndarray, obs: np.ndarray, spec: float = 0.0, exponent: float = 50.0
) -> np.ndarray:
    """Σ A f μ₀ μ: Lambertian facets with a Blinn-Phong lobe of weight ``spec``."""
    mu0, mu = np.maximum(sun @ body.normals.T, 0), np.maximum(obs @ body.normals.T, 0)
    half = sun + obs
    half = half / np.linalg.norm(half, axis=1, keepdims=True)
    lobe = (exponent + 8) / (8 * np.pi) * np.maximum(half @ body.normals.T, 0) ** exponent
    return ((1 - spec) / np.pi + spec * lobe) * mu0 * mu @ body.areas


def tilted(body: shapes.Body, degrees: float, rng: np.random.Generator) -> shapes.Body:
    """The body turned by an angle about a random axis."""
    from scipy.spatial.transform import Rotation

    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    return body._replace(normals=body.normals @ turn.T)


def lengthwise(rng: np.random.Generator) -> shapes.Body:
    """A cylinder that turns end over end: its axis along x."""
    made = shapes.cylinder(rng.uniform(0.3, 1.0), rng.uniform(2.0, 6.0), 48)
    return made._replace(normals=made.normals[:, [2, 0, 1]])


def spinner(
    seed: int, count: int, snr: float, kind: str = "box", per_turn: float = 30.0
) -> tuple[LightCurve, dict]:
    """A light curve of a body that spins about a principal axis, to within some degrees."""
    rng = np.random.default_rng(seed)
    orbit, spans = campaign(rng, count)
    body = lengthwise(rng) if kind == "cylinder" else shapes.box(*np.sort(rng.uniform(0.5, 2.5, 3)))
    body = tilted(body, 5.0 * abs(rng.normal()), rng)
    pole = rng.normal(size=3)
    pole /= np.linalg.norm(pole)
    period = float(np.exp(rng.uniform(np.log(10.0), np.log(50.0))))
    spec, exponent = float(rng.choice([0.0, 0.3])), float(rng.choice([20.0, 100.0]))
    t = np.concatenate([np.arange(a, b, period / per_turn) for a, b in spans])
    sun, obs, _ = orbit.look(t)
    omega = 2 * np.pi / period
    flux = shine(body, spun(sun, t, pole, omega), spun(obs, t, pole, omega), spec, exponent)
    error = np.full(t.size, flux.mean() / snr)
    curve = LightCurve(
        t=t,
        brightness=flux + error * rng.normal(size=t.size),
        error=error,
        sun=np.array(sun),
        obs=obs,
        frame="icrs",
    )
    return curve, {"pole": pole, "period": period, "spec": spec}


def steady(seed: int, snr: float, spinning: bool, n: int = 500, passes: int = 2) -> LightCurve:
    """Noise about a constant, or a body that spins, under a geometry that does not change."""
    rng = np.random.default_rng(seed)
    sun, obs, pole = (v / np.linalg.norm(v) for v in rng.normal(size=(3, 3)))
    obs = obs if obs @ sun > -0.5 else -obs
    t = np.concatenate([np.linspace(0, 400.0, n) + 6000.0 * k for k in range(passes)])
    sun, obs = np.tile(sun, (t.size, 1)), np.tile(obs, (t.size, 1))
    flux = np.ones(t.size)
    if spinning:
        omega = 2 * np.pi / rng.uniform(15.0, 40.0)
        body = tilted(shapes.box(0.6, 1.0, 2.0), 5.0, rng)
        flux = shine(body, spun(sun, t, pole, omega), spun(obs, t, pole, omega))
    error = np.full(t.size, flux.mean() / snr)
    return LightCurve(
        t=t, brightness=flux + error * rng.normal(size=t.size), error=error, sun=sun, obs=obs
    )
