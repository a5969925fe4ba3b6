"""Light curves with glints of known facets, wires and panels, for tests and benchmarks."""

from __future__ import annotations

import numpy as np

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.glints.directions import bisector
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.laws import Attitude, ConstantRate
from lcbayes.physics.bodies import shapes
from tests.helpers.low_earth_orbit import campaign, shine, tilted

YEAR, DAY = 365.25 * 86400.0, 86164.1
OBLIQUITY = np.radians(23.44)
GEO_KM, EARTH_KM = 42164.0, 6378.0


def random_unit(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def noisy(rng, t, flux, snr, sun, obs) -> LightCurve:
    error = np.full(t.size, np.median(flux) / snr)
    return LightCurve(
        t=t,
        brightness=flux + error * rng.normal(size=t.size),
        error=error,
        sun=np.array(sun),
        obs=obs,
        frame="icrs",
    )


def turned(t: np.ndarray, omega: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Body components under a constant rate, body axes the inertial ones at the first point."""
    from lcbayes.core.jax_setup import jnp

    rotation = np.asarray(rotations.constant_rate(jnp.asarray(t - t[0]), jnp.asarray(omega)))
    return np.einsum("tij,ti->tj", rotation, vectors)


def one_pass(rng: np.random.Generator) -> tuple:
    """Times, Sun and observer of a pass, and a slow spin: bisector in body axes, too."""
    orbit, ((start, stop),) = campaign(rng, 1)
    t = np.arange(start, stop, 0.4)
    sun, obs, _ = orbit.look(t)
    omega = 2 * np.pi / rng.uniform(60.0, 120.0) * random_unit(rng)
    return t, sun, obs, omega, bisector(turned(t, omega, sun), turned(t, omega, obs))


def facet_flashes(seed: int, snr: float) -> tuple[LightCurve, Attitude, np.ndarray]:
    """A slowly spinning diffuse box with one mirror-like facet; spin known."""
    rng = np.random.default_rng(seed)
    while True:
        t, sun, obs, omega, b = one_pass(rng)
        normal = b[rng.integers(t.size // 4, 3 * t.size // 4)]
        width = np.radians(rng.uniform(1.0, 3.0))
        lobe = np.exp(-0.5 * (np.arccos(np.clip(b @ normal, -1, 1)) / width) ** 2)
        high = np.flatnonzero(
            (lobe[1:-1] > 0.3) & (lobe[1:-1] > lobe[:-2]) & (lobe[1:-1] > lobe[2:])
        )
        if len(high) >= 2 and np.mean(lobe > 0.5) < 0.1:
            break
    body = tilted(shapes.box(1.0, 1.1, 1.2), 30.0, rng)
    flux = 0.3 + shine(body, turned(t, omega, sun), turned(t, omega, obs))
    flux = flux + rng.uniform(3.0, 10.0) * np.median(flux) * lobe
    x, y, z = omega
    return noisy(rng, t, flux, snr, sun, obs), ConstantRate((x, y, z)), normal


def wire_flashes(seed: int, snr: float) -> tuple[LightCurve, Attitude, np.ndarray]:
    """A slowly spinning body with a wire that glints where c·b = 0; spin known."""
    rng = np.random.default_rng(seed)
    while True:
        t, sun, obs, omega, b = one_pass(rng)
        axis = random_unit(rng)
        width = np.radians(rng.uniform(0.5, 1.5))
        along = b @ axis
        if np.sum(np.diff(np.sign(along)) != 0) >= 4 and np.mean(np.abs(along) < 2 * width) < 0.15:
            break
    flux = 1.0 + rng.uniform(0.8, 2.0) * np.exp(-0.5 * (along / width) ** 2)
    x, y, z = omega
    return noisy(rng, t, flux, snr, sun, obs), ConstantRate((x, y, z)), axis


def panel_flashes(
    seed: int, snr: float, nights: int = 4
) -> tuple[LightCurve, tuple[float, float, float], float]:
    """A geostationary satellite, weeks from an equinox, so that it just misses the Earth's shadow;
    its panels follow the Sun with an offset, rad."""
    rng = np.random.default_rng(seed)
    offset = np.radians(rng.uniform(-8.0, 8.0))
    width = np.radians(rng.uniform(1.5, 3.0))
    lat = np.radians(rng.uniform(-35.0, 35.0))
    first = 0.5 * YEAR * rng.integers(2) + 86400.0 * float(
        rng.choice([-1.0, 1.0]) * rng.uniform(25.0, 45.0)
    )
    parts = []
    for night in range(nights):
        # local midnight of the satellite's meridian, which is the site's
        day = first + 86400.0 * night * 2
        longitude = 2 * np.pi * day / YEAR
        right = np.arctan2(np.sin(longitude) * np.cos(OBLIQUITY), np.cos(longitude))
        parts.append((day + np.arange(-4.5 * 3600, 4.5 * 3600, 60.0), right + np.pi, day))
    t = np.concatenate([p[0] for p in parts])
    meridian = np.concatenate([m + 2 * np.pi * (x - day) / DAY for x, m, day in parts])
    longitude = 2 * np.pi * t / YEAR
    sun = np.stack(
        [
            np.cos(longitude),
            np.sin(longitude) * np.cos(OBLIQUITY),
            np.sin(longitude) * np.sin(OBLIQUITY),
        ],
        1,
    )
    up = np.stack([np.cos(meridian), np.sin(meridian), np.zeros_like(t)], 1)
    site = EARTH_KM * (np.cos(lat) * up + np.sin(lat) * np.array([0.0, 0.0, 1.0]))
    line = site - GEO_KM * up
    obs = line / np.linalg.norm(line, axis=1, keepdims=True)
    b = bisector(sun, obs)
    azimuth = np.arctan2(sun[:, 1], sun[:, 0]) + offset
    tilt = np.arcsin(b[:, 2]).mean()  # canted as far as the season asks
    normal = np.stack(
        [
            np.cos(tilt) * np.cos(azimuth),
            np.cos(tilt) * np.sin(azimuth),
            np.full_like(t, np.sin(tilt)),
        ],
        1,
    )
    lobe = np.exp(-0.5 * (np.arccos(np.clip(np.sum(b * normal, 1), -1, 1)) / width) ** 2)
    phase = np.arccos(np.clip(np.sum(sun * obs, 1), -1, 1))
    flux = 1.0 + 2.0 * (1 + np.cos(phase)) + rng.uniform(4.0, 12.0) * lobe
    return noisy(rng, t, flux, snr, sun, obs), (0.0, 0.0, 1.0), offset


def no_flashes(seed: int, snr: float) -> LightCurve:
    """A pass of a diffuse box that spins slowly: it brightens and fades, and does not glint."""
    rng = np.random.default_rng(seed)
    t, sun, obs, omega, _ = one_pass(rng)
    body = tilted(shapes.box(1.0, 1.1, 1.2), 30.0, rng)
    flux = 0.3 + shine(body, turned(t, omega, sun), turned(t, omega, obs))
    return noisy(rng, t, flux, snr, sun, obs)
