"""Directions to Sun and observer from coordinates or orbital elements of a satellite.

Everything is in ICRS axes (shared by GCRS) and kilometres, at the time of observation. Light time
and aberration (at most 20") are neglected.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.errors import RowError
from lcbayes.geometry.earth import Earth, sun_position, sunlit
from lcbayes.geometry.sites import WGS84, Site
from lcbayes.geometry.spherical import unit_vector
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import Tle

Floats = NDArray[np.float64]

MAX_TLE_AGE_DAYS = 30.0  # for older elements a low orbit is off by degrees along its track


@dataclass(frozen=True)
class Geometry:
    """Geometry of the observations of a light curve, per time.

    Attributes
    ----------
    sun, obs : (T, 3)
        Unit vectors from the satellite to the Sun and to the observer, GCRS axes.
    range_km : (T,)
    altitude_deg : (T,)
        Altitude of the satellite above the observer's horizon, without refraction.
    position_km : (T, 3)
        Geocentric position of the satellite, GCRS.
    velocity_km_s : (T, 3) or None
        Its velocity, GCRS; None if no orbit is known.
    sunlit : (T,) bool
        Whether the whole solar disc is visible from there, for a spherical Earth.
    notes : sentences about assumptions that affect the result
    """

    sun: Floats
    obs: Floats
    range_km: Floats
    altitude_deg: Floats
    position_km: Floats
    sunlit: NDArray[np.bool_]
    notes: tuple[str, ...] = ()
    velocity_km_s: Floats | None = None


def _seen(time: Times, site: Site, satellite: Floats, earth: Earth) -> Geometry:
    """Geometry of a satellite at a geocentric GCRS position."""
    place = np.broadcast_to(earth.to_gcrs(site.itrs()), satellite.shape)
    zenith = earth.to_gcrs(site.axes()[..., 2, :])
    line = place - satellite
    distance = np.linalg.norm(line, axis=-1)
    to_sun = sun_position(time) - satellite
    obs = line / distance[:, None]
    return Geometry(
        sun=to_sun / np.linalg.norm(to_sun, axis=-1)[:, None],
        obs=obs,
        range_km=distance,
        altitude_deg=np.degrees(np.arcsin(np.clip(-np.sum(obs * zenith, -1), -1.0, 1.0))),
        position_km=satellite,
        sunlit=sunlit(satellite, to_sun),
        notes=earth.notes,
    )


def from_radec(
    time: Times, site: Site, ra_deg: ArrayLike, dec_deg: ArrayLike, range_km: ArrayLike
) -> Geometry:
    """Geometry of a satellite from its topocentric coordinates and range.

    `ra_deg` and `dec_deg` are astrometric, in ICRS or J2000 axes, (T,); `range_km` is (T,).
    """
    ra, dec = np.radians(ra_deg), np.radians(dec_deg)
    toward = unit_vector(ra, dec)
    earth = Earth(time)
    satellite = earth.to_gcrs(site.itrs()) + np.asarray(range_km, float)[..., None] * toward
    return _seen(time, site, satellite, earth)


def from_altaz(
    time: Times,
    site: Site,
    altitude_deg: ArrayLike,
    azimuth_deg: ArrayLike,
    height_km: ArrayLike,
) -> Geometry:
    """Geometry of a satellite from its altitude, azimuth and height.

    The altitude is above the geodetic horizon, without refraction; the azimuth is counted from
    north through east; `height_km` is the satellite's height above the WGS84 ellipsoid. All are
    (T,). The range is the distance at which the line of sight reaches that height.

    Raises
    ------
    InputError
        The line of sight does not reach that height.
    """
    alt, az = np.radians(altitude_deg), np.radians(azimuth_deg)
    enu = np.stack([np.cos(alt) * np.sin(az), np.cos(alt) * np.cos(az), np.sin(alt)], -1)
    toward = np.einsum("...i,...ij->...j", enu, site.axes())
    start, height = site.itrs(), np.asarray(height_km, float)
    distance = _range_at_height(start, toward, enu[..., 2], height)
    low = ~(np.isfinite(distance) & (distance > 0))
    if low.any():
        row = int(np.argmax(low))
        what = f"cannot be reached by {int(low.sum())} of the lines of sight from the site"
        remedy = "correct altitude_deg (over the horizon) and height_km (over the Earth)"
        raise RowError("height_km", what, row, height[row], remedy)
    earth = Earth(time)
    return _seen(time, site, earth.to_gcrs(start + distance[:, None] * toward), earth)


def _range_at_height(start: Floats, toward: Floats, rise: Floats, height: Floats) -> Floats:
    """Distance along `toward` from `start` to a height above the ellipsoid, km; NaN if not reached.

    Newton's method on the geodetic height, starting from the solution for a sphere. The derivative
    of the height with respect to the distance is exactly `toward`·zenith.
    """
    import erfa

    radius = np.linalg.norm(start, axis=-1)
    _, _, ground = erfa.gc2gd(WGS84, np.broadcast_to(start, toward.shape) * 1e3)
    above = height - ground / 1e3
    # |start + d toward| = radius + above, solved without cancellation, for upward directions only
    half = radius * rise
    root = half**2 + above * (2.0 * radius + above)
    with np.errstate(invalid="ignore"):
        up = (rise >= 0) & (above > 0)
        distance = np.where(up, above * (2.0 * radius + above) / (half + np.sqrt(root)), np.nan)
    for _ in range(8):
        lon, lat, now = erfa.gc2gd(
            WGS84, 1e3 * (start + np.nan_to_num(distance, nan=1.0)[:, None] * toward)
        )
        zenith = Site(np.degrees(lat), np.degrees(lon), 0.0).axes()[..., 2, :]
        distance = distance - (now / 1e3 - height) / np.sum(zenith * toward, -1)
    return distance


def from_tle(
    time: Times, site: Site, tle: Tle, max_age_days: float | None = MAX_TLE_AGE_DAYS
) -> Geometry:
    """Geometry of a satellite from its two-line elements, propagated with SGP4.

    If a file contains several element sets of the object, the nearest in time is used.

    Raises
    ------
    InputError
        The elements are older than `max_age_days` at some time, or SGP4 cannot propagate them.
    """
    earth = Earth(time)
    position, velocity = (earth.teme_to_gcrs(v) for v in tle.states(time, max_age_days))
    return replace(_seen(time, site, position, earth), velocity_km_s=velocity)
