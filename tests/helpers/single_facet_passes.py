"""A satellite with one large facet over a smooth rest, passing two sites on Hawaii."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.physics.attitude.laws import Attitude
from tests.helpers.simulated_passes import DAY, passes, unit

MAUI, KAUAI = (20.708, -156.257), (22.126, -159.665)
ALBEDO, REST_M = 0.3, 0.3  # of everything; radius of the sphere that is the rest


@cache
def one_pass(seed: int, step: float = 2.0) -> LightCurve:
    """A pass of some low orbit that both sites see for 100 points and more."""
    rng = np.random.default_rng(seed)
    while True:
        orbit = rng.uniform(450, 900), rng.uniform(50, 100), rng.uniform(0, 360)
        start = rng.uniform(0, 300) * DAY
        try:
            result = passes(*orbit, 3.0, 20.0, (MAUI, KAUAI), least_altitude_deg=10.0, start=start)
        except InputError:  # nothing is seen in three days
            continue
        for rows in np.split(np.arange(result.n_obs), np.flatnonzero(np.diff(result.t) > 600) + 1):
            if min(np.sum(result.site[rows] == k) for k in "01") > 10:
                begin, end = float(result.t[rows[0]]), float(result.t[rows[-1]])
                return passes(
                    *orbit,
                    (end - begin) / DAY,
                    step,
                    (MAUI, KAUAI),
                    least_altitude_deg=10.0,
                    start=begin,
                )


def body_directions(curve: LightCurve, law: Attitude) -> tuple[np.ndarray, np.ndarray]:
    turn = np.asarray(law.frames(ephemeris(curve)).body)
    sun, obs = (np.einsum("tij,ti->tj", turn, v) for v in (curve.sun, curve.obs))
    return sun, obs


def flux_of(curve: LightCurve, law: Attitude, normal: np.ndarray, area: float) -> np.ndarray:
    """Lambertian facet of that area (m²) and sphere."""
    sun, obs = body_directions(curve, law)
    facet = area * np.maximum(sun @ normal, 0.0) * np.maximum(obs @ normal, 0.0)
    phase = curve.phase_angle
    sphere = np.sin(phase) + (np.pi - phase) * np.cos(phase)
    return ALBEDO / np.pi * (facet + 2.0 / 3.0 * REST_M**2 * sphere)


def with_noise(curve: LightCurve, flux: np.ndarray, noise: float, seed: int) -> LightCurve:
    error = np.full(flux.size, noise * flux.mean())
    noisy = flux + error * np.random.default_rng(seed).standard_normal(flux.size)
    return replace(curve, brightness=noisy, error=error)


def crossing(curve: LightCurve, law: Attitude, seed: int) -> np.ndarray:
    """A normal whose facet begins or ceases to be lit and seen from both sites, well within.

    Raises LookupError where 5,000 normals have none: not every pass has one.
    """
    rng = np.random.default_rng(seed)
    sun, obs = body_directions(curve, law)
    sites = [np.flatnonzero(curve.site == k) for k in "01"]
    for _ in range(5000):
        normal = unit(rng.normal(size=3))
        on = (sun @ normal > 0) & (obs @ normal > 0)
        inner = [on[r][len(r) // 8 : -(len(r) // 8)] for r in sites]
        bright = (sun @ normal) * (obs @ normal) * on
        if all(x.any() and not x.all() for x in inner) and bright.max() > 0.1:
            return normal
    raise LookupError("no facet begins or ceases to be lit and seen from both sites")
