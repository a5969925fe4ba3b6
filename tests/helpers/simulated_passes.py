"""Passes of a satellite on a circular orbit over sites of a turning Earth, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from lcbayes.core.constants import EARTH_GM, EARTH_RATE
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import ensemble
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics.attitude.laws import Attitude

EARTH = 6371.0
SITES = ((37.2, -2.5), (46.9, 7.5), (20.7, -156.3))  # degrees north, east
DAY = 86400.0


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def passes(
    height_km: float = 690.0,
    inclination_deg: float = 98.1,
    node_deg: float = 130.0,
    days: float = 10.0,
    step: float = 15.0,
    sites: Sequence[tuple[float, float]] = SITES,
    sun_lon_deg: float = 25.0,
    least_altitude_deg: float = 20.0,
    start: float = 0.0,
    darkness: bool = True,
) -> LightCurve:
    """Epochs at which a site in darkness sees a sunlit satellite; brightness all NaN."""
    t = start + np.arange(0.0, days * DAY, step)
    radius = EARTH + height_km
    rate = np.sqrt(EARTH_GM / radius**3)
    i = np.radians(inclination_deg)
    # nodal precession by J2, which makes the orbit Sun-synchronous at 98.1 deg
    node = np.radians(node_deg) - 1.5 * 1.0826e-3 * (6378.1 / radius) ** 2 * rate * np.cos(i) * t
    u = rate * t
    ahead = np.stack([np.cos(node), np.sin(node), 0 * node], 1)
    side = np.stack(
        [-np.sin(node) * np.cos(i), np.cos(node) * np.cos(i), np.full(t.size, np.sin(i))], 1
    )
    place = radius * (np.cos(u)[:, None] * ahead + np.sin(u)[:, None] * side)
    velocity = radius * rate * (np.cos(u)[:, None] * side - np.sin(u)[:, None] * ahead)
    lon = np.radians(sun_lon_deg) + 2 * np.pi * t / (365.25 * DAY)
    tilt = np.radians(23.44)
    sun = np.stack([np.cos(lon), np.cos(tilt) * np.sin(lon), np.sin(tilt) * np.sin(lon)], 1)
    depth = np.sum(place * sun, axis=1)
    lit = (depth > 0) | (np.linalg.norm(place - depth[:, None] * sun, axis=1) > EARTH + 20)
    columns: list[np.ndarray] = []
    for k, (lat, east) in enumerate(sites):
        angle, phi = np.radians(east) + EARTH_RATE * t, np.radians(lat)
        zenith = np.stack(
            [
                np.cos(phi) * np.cos(angle),
                np.cos(phi) * np.sin(angle),
                np.full(t.size, np.sin(phi)),
            ],
            1,
        )
        line = EARTH * zenith - place
        obs = unit(line)
        high = -np.sum(obs * zenith, axis=1) > np.sin(np.radians(least_altitude_deg))
        dark = np.sum(sun * zenith, axis=1) < np.sin(np.radians(-9.0))
        kept = np.flatnonzero(high & lit & (dark | (not darkness)))
        columns.append(
            np.column_stack(
                [
                    t[kept],
                    np.full(kept.size, k),
                    sun[kept],
                    obs[kept],
                    place[kept],
                    velocity[kept],
                    np.linalg.norm(line[kept], axis=1),
                ]
            )
        )
    rows = np.concatenate(columns)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return LightCurve(
        t=rows[:, 0],
        site=rows[:, 1].astype(int).astype(str),
        sun=rows[:, 2:5],
        obs=rows[:, 5:8],
        position_km=rows[:, 8:11],
        velocity_km_s=rows[:, 11:14],
        brightness=np.full(len(rows), np.nan),
        error=None,
        frame="icrs",
        epoch_jd=2461000.5,
    )


def measured(geometry: LightCurve, law: Attitude, bodies: ensemble.Bodies, noise: float, seed: int):
    """The first body that is seen, turned by the law; errors are a part of its mean flux."""
    parts = [
        (np.einsum("tij,ti->tj", turn, geometry.sun), np.einsum("tij,ti->tj", turn, geometry.obs))
        for turn in law.frames(ephemeris(geometry))
        if turn is not None
    ]
    sun, obs = parts[0]
    flux = ensemble.fluxes(bodies, sun, obs, parts[1] if len(parts) > 1 else None)
    flux = flux[np.argmax(flux.mean(axis=1) > 0)]
    error = np.full(flux.size, noise * flux.mean())
    noisy = flux + error * np.random.default_rng(seed).standard_normal(flux.size)
    return replace(geometry, brightness=noisy, error=error)
