"""Velocities of satellites from the topocentric rates given by SatChecker."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import EARTH_GM, EARTH_RATE
from lcbayes.data.lightcurve import LightCurve

Floats = NDArray[np.float64]

RATES = (
    "range_rate_sat_km_s_satchecker",
    "dra_cosdec_deg_s_satchecker",
    "ddec_deg_s_satchecker",
)
NEAR_POLE = np.cos(np.radians(85.0))  # cos δ below which a difference of RA is not used as a rate


def observed_velocity(curve: LightCurve, rates: Mapping[str, Floats]) -> tuple[Floats | None, str]:
    """Geocentric velocity, ICRS axes, km/s, (T, 3), and a note; None if a rate is missing.

    v = Ω × s + ρ̇ u + ρ (α̇ cos δ e_α + δ̇ e_δ), with s the observer's position and u the direction
    to the satellite. SatChecker computes α̇ from a difference of right ascensions, which is wrong
    at the step from 24 h to 0 h and near a pole. If the orbit would be unbound or |δ| exceeds 85°,
    the component along e_α is therefore chosen to give the speed of a circular orbit. Of the two
    solutions, the one with the velocity more nearly perpendicular to the radius is used. The
    Earth's axis is approximated by the z axis of the frame: 0.13° of precession, 1 m/s.

    Parameters
    ----------
    curve : LightCurve
        With ``position_km`` and ``range_km``.
    rates : mapping
        ρ̇ (km/s), α̇ cos δ and δ̇ (deg/s) under the names `RATES`, (T,) each.
    """
    place, distance = curve.position_km, curve.range_km
    if place is None or distance is None or any(name not in rates for name in RATES):
        return None, ""
    along, right, up = (rates[name] for name in RATES)
    if np.isnan([along, right, up]).any():
        return None, ""
    u = -curve.obs
    flat = np.maximum(np.hypot(u[:, 0], u[:, 1]), 1e-12)  # cos δ
    east = np.stack([-u[:, 1] / flat, u[:, 0] / flat, np.zeros_like(flat)], axis=-1)
    site = place - distance[:, None] * u
    known = EARTH_RATE * np.cross([0.0, 0.0, 1.0], site) + along[:, None] * u
    known += (distance * np.radians(up))[:, None] * np.cross(u, east)
    x = distance * np.radians(right)
    radius = np.linalg.norm(place, axis=1)
    bound = np.sum((known + x[:, None] * east) ** 2, axis=1) < 2.0 * EARTH_GM / radius
    wrong = ~bound | (flat < NEAR_POLE)
    x = np.where(wrong, _circular(known, east, place, radius), x)
    count = int(wrong.sum())
    points = f"{count} {'point' if count == 1 else 'points'}"
    note = f"the velocity of {points} is that of a circular orbit, for want of a rate of RA"
    return known + x[:, None] * east, note if count else ""


def _circular(known: Floats, east: Floats, place: Floats, radius: Floats) -> Floats:
    """x for which |known + x east|² = GM/r, or is closest to it, (T,)."""
    half = np.sum(known * east, axis=1)
    excess = np.sum(known**2, axis=1) - EARTH_GM / radius
    root = np.sqrt(np.maximum(half**2 - excess, 0.0))
    both = np.stack([-half - root, -half + root])
    climb = np.sum(known * place, axis=1) + both * np.sum(east * place, axis=1)
    return np.where(np.abs(climb[0]) <= np.abs(climb[1]), both[0], both[1])
