"""What attitude laws read, from a light curve: time, Sun, orbit and the poles of its axes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import EARTH_GM, EARTH_J2, EARTH_RADIUS_KM, OBLIQUITY
from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.physics.attitude.laws import Attitude, Ephemeris, Frames

Floats = NDArray[np.float64]

MAX_STEP_S = 60.0  # between a point and those of which its velocity is taken
SERIES_S = 0.1  # of the radian of orbit that a step may be, for the f and g series
SLACK_S = 1e-3  # of those bounds, for times that were rounded
MAX_NEIGHBOURS = 25  # places at most, evenly out of those within the bounds
MAX_RESIDUAL = 1e-3  # of the radius that an orbit may leave of its places, rms of a component
MAX_DIRECTION_SD = 0.1  # rad of the direction of flight, beyond which it is none
TILT = {
    "icrs": (0.0, OBLIQUITY),
    "ecliptic-j2000": (-OBLIQUITY, 0.0),
}  # angle about x from the axes' z to celestial and to ecliptic north, towards −y


def ephemeris(curve: LightCurve) -> Ephemeris:
    """Time, Sun and, where the curve has them, orbit and poles.

    Where a curve has places of the satellite without velocities, these are those of the orbit that
    fits best, by least squares, the places within a minute of each point (`velocity_from_places`).
    They are None unless every point has others within a minute on one bound orbit, as points of one
    pass do and the places of many satellites in one catalogue do not.
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
    """Velocities (T, 3) km/s from geocentric places (T, 3) km of one object per curve, or None.

    About each point rⱼ = f(tⱼ) r + g(tⱼ) v + ½ a t² is fitted to the places of the same curve that
    are near enough in time, for r and v: f and g are the series of two-body motion, whose terms the
    last turn gives, and a is the acceleration by the Earth's J2. All places have one weight, so
    that the rounding of single ones, which a difference of two divides by a short time, averages
    out. ``t`` (T,) s never decreases within a curve.

    References
    ----------
    Bate, Mueller & White 1971, Fundamentals of Astrodynamics, sec. 5.6 (f and g), 9.7 (J2).
    """
    velocity, _ = _fitted(t, places, curve)
    return None if np.isnan(velocity).any() else velocity


def velocity_direction_sd_deg(curve: LightCurve) -> float | None:
    """How far the directions of flight are unsure where they come from places: 1 sd, deg, the worst
    of all points; None where velocities are given or there are none."""
    if curve.velocity_km_s is not None or curve.position_km is None:
        return None
    velocity, unsure = _fitted(curve.t, curve.position_km, curve.curve)
    return None if np.isnan(velocity).any() else float(np.degrees(unsure.max()))


@np.errstate(divide="ignore", invalid="ignore")  # where a time or a place is none
def _fitted(t: Floats, places: Floats, curve: NDArray[np.integer]) -> tuple[Floats, Floats]:
    """Velocities (T, 3), NaN where there is none, and 1 sd of their direction (T,) rad.

    The sd is that of one component across, from what the fit leaves of the places; where it leaves
    nothing, of two places alone, from what it leaves in the rest of the curve.
    """
    order = np.argsort(curve, kind="stable")
    t, places, curve = t[order], places[order], curve[order]
    radius = np.linalg.norm(places, axis=1)
    rate2 = EARTH_GM / radius**3
    bent = 0.5 * _oblate(places, radius)
    near = list(_neighbours(t, curve, np.minimum(MAX_STEP_S, SERIES_S / np.sqrt(rate2)) + SLACK_S))
    count = np.sum([new for _, new in near], axis=0)
    p, q, speed2, rr, ff, free = np.zeros((6, t.size))  # p and q of `_series`: those of a circle
    offset, velocity, fr, gr = np.zeros((4, *places.shape))
    for _ in range(3):  # turns
        ff, fg, gg, rr = np.zeros((4, t.size))
        fr, gr = np.zeros((2, *places.shape))
        for j, new in near:
            dt = t[j] - t
            f, g = (new * x for x in _series(dt, rate2, p, q))
            # against r itself, lest sums of squares of thousands of km cancel
            left = new[:, None] * (places[j] - bent * (dt**2)[:, None]) - f[:, None] * places
            ff, fg, gg, rr = ff + f * f, fg + f * g, gg + g * g, rr + np.sum(left**2, axis=1)
            fr, gr = fr + f[:, None] * left, gr + g[:, None] * left
        free = np.where(gg > 0, ff * gg - fg**2, np.nan)  # NaN: all are of one time
        offset = (gg[:, None] * fr - fg[:, None] * gr) / free[:, None]
        velocity = (ff[:, None] * gr - fg[:, None] * fr) / free[:, None]
        speed2 = np.sum(velocity**2, axis=1)
        p, q = np.sum(places * velocity, axis=1) / radius**2, speed2 / radius**2 - rate2
    left2 = rr - np.sum(offset * fr, axis=1) - np.sum(velocity * gr, axis=1)
    left2, spare = np.maximum(left2, 0.0), 3 * (count - 2)
    known = ~np.isnan(left2) & (spare > 0)
    total, of = (np.bincount(curve, np.where(known, x, 0)) for x in (left2, spare))
    pooled = total / np.maximum(of, 1)
    noise2 = np.where(spare > 0, left2 / np.maximum(spare, 1), pooled[curve])
    unsure = np.sqrt(noise2 * ff / free / speed2)
    bound = speed2 < 2 * EARTH_GM / radius
    low = np.linalg.norm(np.cross(places, velocity), axis=1) ** 2 / EARTH_GM > 0.3 * radius
    one = noise2 <= (MAX_RESIDUAL * radius) ** 2
    good = bound & low & one & (unsure <= MAX_DIRECTION_SD)
    velocity = np.where(good[:, None], velocity, np.nan)
    back = np.argsort(order)
    return velocity[back], unsure[back]


def _neighbours(
    t: Floats, curve: NDArray[np.integer], reach: Floats
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.bool_]]]:
    """Rows within `reach` (T,) s of each row and in its curve, and whether they are new; sorted."""
    gap = np.where(np.diff(curve) == 0, np.minimum(np.diff(t), 2 * MAX_STEP_S), 2 * MAX_STEP_S)
    clock = np.concatenate([[0.0], np.cumsum(gap)])  # of all curves in one, none near another
    first = np.searchsorted(clock, clock - reach, "left")
    more = np.searchsorted(clock, clock + reach, "right") - 1 - first
    last = np.full(t.size, -1)
    for k in range(MAX_NEIGHBOURS):
        row = first + k * more // (MAX_NEIGHBOURS - 1)
        yield row, row > last
        last = row


def _series(dt: Floats, rate2: Floats, p: Floats, q: Floats) -> tuple[Floats, Floats]:
    """f and g (s) of two-body motion: u = GM/r³, p = r·v/r², q = v²/r² − u, to dt⁵."""
    u, dt2 = rate2, dt * dt
    f4, f5 = (3 * q - 15 * p**2 + u) / 24, p * (7 * p**2 - 3 * q - u) / 8
    f = 1 - u * dt2 * (0.5 - dt * (p / 2 + dt * (f4 + dt * f5)))
    g = dt - u * dt2 * dt * (1 / 6 - dt * (p / 4 + dt * (9 * q - 45 * p**2 + u) / 120))
    return f, g


def _oblate(places: Floats, radius: Floats) -> Floats:
    """Acceleration by the Earth's J2, km/s², (T, 3); the axes' z is taken for the Earth's pole."""
    sine2 = (places[:, 2:] / radius[:, None]) ** 2
    size = 1.5 * EARTH_J2 * EARTH_GM * EARTH_RADIUS_KM**2 / radius[:, None] ** 5
    return -size * places * (np.array([1.0, 1.0, 3.0]) - 5 * sine2)
