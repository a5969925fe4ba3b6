"""What attitude laws read, from a light curve: time, Sun, orbit and the poles of its axes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcbayes._jax import jnp
from lcbayes.geometry import EARTH_GM
from lcbayes.lightcurve import LightCurve
from lcbayes.physics.laws import OBLIQUITY, Attitude, Ephemeris, Frames

Floats = NDArray[np.float64]

MAX_STEP_S = 60.0  # between neighbours of which a velocity is taken
SERIES_S = 0.1  # of the radian of orbit that a step may be, for the f and g series
TILT = {
    "icrs": (0.0, OBLIQUITY),
    "ecliptic-j2000": (-OBLIQUITY, 0.0),
}  # angle about x from the axes' z to celestial and to ecliptic north, towards −y


def ephemeris(curve: LightCurve) -> Ephemeris:
    """Time, Sun and, where the curve has them, orbit and poles.

    Where a curve has places of the satellite without velocities, these come from neighbouring
    points: v₁ = (r₂ − f r₁)/g, with the f and g series of two-body motion. They are None unless
    every point has a neighbour within a minute on a bound orbit, as points of one pass do and the
    places of many satellites in one catalogue do not.

    References
    ----------
    Bate, Mueller & White 1971, Fundamentals of Astrodynamics, sec. 5.6 (f and g).
    """
    north = [None, None]
    if curve.frame in TILT:
        north = [jnp.array([0.0, -np.sin(a), np.cos(a)]) for a in TILT[curve.frame]]
    velocity = with_velocity(curve).velocity_km_s
    place, motion = (None if v is None else jnp.asarray(v) for v in (curve.position_km, velocity))
    return Ephemeris(jnp.asarray(curve.t), jnp.asarray(curve.sun), place, motion, *north)


def with_velocity(curve: LightCurve) -> LightCurve:
    """The curve with velocities from neighbouring places, where it has none and they can be had."""
    if curve.velocity_km_s is not None or curve.position_km is None:
        return curve
    velocity = velocity_from_places(curve.t, curve.position_km, curve.curve)
    return curve if velocity is None else replace(curve, velocity_km_s=velocity)


def frames(law: Attitude, curve: LightCurve) -> Frames:
    """Axes of the body (and of its array) at the times of a light curve, by a law.

    Raises
    ------
    InputError
        The law needs an orbit, or to know north, and the curve does not have it.
    """
    return law.frames(ephemeris(curve))


def velocity_from_places(t: Floats, places: Floats, curve: NDArray[np.integer]) -> Floats | None:
    """Velocities (T, 3) km/s from geocentric places (T, 3) km of one object per curve, or None."""
    velocity = np.full(places.shape, np.nan)
    for i in range(int(curve.max()) + 1):
        here = np.flatnonzero(curve == i)
        for a, b in ((here[:-1], here[1:]), (here[1:], here[:-1])):
            todo = np.isnan(velocity[a, 0])
            found = _from_pairs(t[b] - t[a], places[a], places[b])
            velocity[a[todo]] = found[todo]
    return None if np.isnan(velocity).any() else velocity


def _from_pairs(dt: Floats, first: Floats, second: Floats) -> Floats:
    """Velocity at the first of two places; NaN rows where they are no pair of one orbit."""
    radius = np.linalg.norm(first, axis=1)
    rate2 = EARTH_GM / radius**3
    near = (dt != 0) & (np.abs(dt) <= MAX_STEP_S) & (rate2 * dt**2 <= SERIES_S**2)
    dt = np.where(near, dt, np.nan)
    velocity = (second - first) / dt[:, None]
    for _ in range(3):  # the series need r·v/r², which the last turn has better
        u = np.sum(first * velocity, axis=1) / radius**2
        f = 1 - rate2 * dt**2 / 2 + rate2 * u * dt**3 / 2
        g = dt - rate2 * dt**3 / 6 + rate2 * u * dt**4 / 4
        velocity = (second - f[:, None] * first) / g[:, None]
    bound = np.sum(velocity**2, axis=1) < 2 * EARTH_GM / radius
    low = np.linalg.norm(np.cross(first, velocity), axis=1) ** 2 / EARTH_GM > 0.3 * radius
    return np.where((bound & low)[:, None], velocity, np.nan)
