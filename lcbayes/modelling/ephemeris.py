"""Input of attitude laws from a light curve: time, Sun, orbit and the poles of its axes."""

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

MAX_STEP_S = 60.0  # between a point and the positions from which its velocity is estimated
SERIES_S = 0.1  # largest step in radians of orbit, for the f and g series
SLACK_S = 1e-3  # tolerance of those bounds, for rounded times
MAX_NEIGHBOURS = 25  # positions at most, spread evenly over those within the bounds
MAX_RESIDUAL = 1e-3  # of the radius: largest rms residual of a component about the orbit
MAX_DIRECTION_SD = 0.1  # rad: a direction of flight more uncertain than this is discarded
TILT = {
    "icrs": (0.0, OBLIQUITY),
    "ecliptic-j2000": (-OBLIQUITY, 0.0),
}  # angle about x from the z axis to celestial and to ecliptic north, towards −y


def ephemeris(curve: LightCurve) -> Ephemeris:
    """Time, Sun and, where the curve has them, orbit and poles.

    If a curve has positions of the satellite but no velocities, the velocity at each point is that
    of the orbit fitted by least squares to the positions within a minute of it
    (`velocity_from_places`). Velocities are None unless every point has neighbours within a minute
    on one bound orbit. The points of one pass have such neighbours; the positions of many
    satellites in one catalogue do not.
    """
    north = [None, None]
    if curve.frame in TILT:
        north = [jnp.array([0.0, -np.sin(a), np.cos(a)]) for a in TILT[curve.frame]]
    velocity = with_velocity(curve).velocity_km_s
    place, motion = (None if v is None else jnp.asarray(v) for v in (curve.position_km, velocity))
    return Ephemeris(jnp.asarray(curve.t), jnp.asarray(curve.sun), place, motion, *north)


def with_velocity(curve: LightCurve) -> LightCurve:
    """The curve with velocities estimated from neighbouring positions if it has none."""
    if curve.velocity_km_s is not None or curve.position_km is None:
        return curve
    velocity = velocity_from_places(curve.t, curve.position_km, curve.curve)
    return curve if velocity is None else replace(curve, velocity_km_s=velocity)


def frames(law: Attitude, curve: LightCurve) -> Frames:
    """Axes of the body (and of its array) at the times of a light curve, by a law.

    Raises
    ------
    InputError
        The law needs an orbit or the direction of north, and the curve does not provide it.
    """
    return law.frames(ephemeris(curve))


def velocity_from_places(t: Floats, places: Floats, curve: NDArray[np.integer]) -> Floats | None:
    """Velocities (T, 3) km/s from geocentric positions (T, 3) km of one object per curve, or None.

    At each point, r and v are fitted in rⱼ = f(tⱼ) r + g(tⱼ) v + ½ a t² to the positions of the
    same curve that are close enough in time. Here f and g are the series of two-body motion, with
    coefficients from the previous iteration, and a is the acceleration due to the Earth's J2. All
    positions have equal weight, so that the rounding of individual positions averages out; the
    difference of two positions would amplify it. ``t`` (T,) s never decreases within a curve.

    References
    ----------
    Bate, Mueller & White 1971, Fundamentals of Astrodynamics, sec. 5.6 (f and g), 9.7 (J2).
    """
    velocity, _ = _fitted(t, places, curve)
    return None if np.isnan(velocity).any() else velocity


def velocity_direction_sd_deg(curve: LightCurve) -> float | None:
    """Standard deviation of directions of flight estimated from positions, deg.

    The largest value of all points is returned. It is None if velocities are given or cannot be
    estimated.
    """
    if curve.velocity_km_s is not None or curve.position_km is None:
        return None
    velocity, unsure = _fitted(curve.t, curve.position_km, curve.curve)
    return None if np.isnan(velocity).any() else float(np.degrees(unsure.max()))


@np.errstate(divide="ignore", invalid="ignore")  # for undefined times or positions
def _fitted(t: Floats, places: Floats, curve: NDArray[np.integer]) -> tuple[Floats, Floats]:
    """Velocities (T, 3), NaN where undetermined, and the sd of their direction (T,) rad.

    The sd is that of one transverse component and follows from the residuals of the fit. Two
    positions alone leave no residuals; their sd follows from those of the rest of the curve.
    """
    order = np.argsort(curve, kind="stable")
    t, places, curve = t[order], places[order], curve[order]
    radius = np.linalg.norm(places, axis=1)
    rate2 = EARTH_GM / radius**3
    bent = 0.5 * _oblate(places, radius)
    near = list(_neighbours(t, curve, np.minimum(MAX_STEP_S, SERIES_S / np.sqrt(rate2)) + SLACK_S))
    count = np.sum([new for _, new in near], axis=0)
    p, q, speed2, rr, ff, free = np.zeros((6, t.size))  # p and q of `_series`, here of a circle
    offset, velocity, fr, gr = np.zeros((4, *places.shape))
    for _ in range(3):  # iterations
        ff, fg, gg, rr = np.zeros((4, t.size))
        fr, gr = np.zeros((2, *places.shape))
        for j, new in near:
            dt = t[j] - t
            f, g = (new * x for x in _series(dt, rate2, p, q))
            # relative to r, to avoid cancellation in sums of squares of thousands of km
            left = new[:, None] * (places[j] - bent * (dt**2)[:, None]) - f[:, None] * places
            ff, fg, gg, rr = ff + f * f, fg + f * g, gg + g * g, rr + np.sum(left**2, axis=1)
            fr, gr = fr + f[:, None] * left, gr + g[:, None] * left
        free = np.where(gg > 0, ff * gg - fg**2, np.nan)  # NaN: all at the same time
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
    """Rows of the same curve within `reach` (T,) s of each row, sorted, and whether each is new."""
    gap = np.where(np.diff(curve) == 0, np.minimum(np.diff(t), 2 * MAX_STEP_S), 2 * MAX_STEP_S)
    # One time axis for all curves, with wide gaps between them.
    clock = np.concatenate([[0.0], np.cumsum(gap)])
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
    """Acceleration due to the Earth's J2, km/s², (T, 3), with the z axis as the Earth's pole."""
    sine2 = (places[:, 2:] / radius[:, None]) ** 2
    size = 1.5 * EARTH_J2 * EARTH_GM * EARTH_RADIUS_KM**2 / radius[:, None] ** 5
    return -size * places * (np.array([1.0, 1.0, 3.0]) - 5 * sine2)
