"""Directions to Sun and observer from what is known of a satellite's place in the sky.

Everything is in ICRS axes (which GCRS shares), kilometres, at the time of observation. Left out
are light time and aberration, 20" at most.
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

MAX_TLE_AGE_DAYS = 30.0  # beyond, a low orbit is off by degrees along its track


@dataclass(frozen=True)
class Geometry:
    """What a light curve needs to know of the sky, per time.

    Attributes
    ----------
    sun, obs : (T, 3)
        Unit vectors from the satellite to the Sun and to the observer, GCRS axes.
    range_km : (T,)
    altitude_deg : (T,)
        Height of the satellite over the observer's horizon, without refraction.
    position_km : (T, 3)
        Geocentric place of the satellite, GCRS.
    velocity_km_s : (T, 3) or None
        Its velocity, GCRS; None where no orbit is known.
    sunlit : (T,) bool
        Whether the whole disc of the Sun is seen from there past a spherical Earth.
    notes : sentences about assumptions that mattered
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
    """Directions for a satellite at a geocentric GCRS place."""
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
    """Geometry of a satellite seen from a site at a topocentric place and distance.

    `ra_deg` and `dec_deg` are astrometric, ICRS or J2000 axes, (T,); `range_km` is (T,).
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
    """Geometry of a satellite seen from a site at an altitude, an azimuth and a known height.

    Altitude is over the geodetic horizon, without refraction; azimuth from north through east;
    `height_km` is the satellite's height over the WGS84 ellipsoid. All (T,). The range is where
    the line of sight reaches that height.

    Raises
    ------
    InputError
        The line of sight does not rise to that height.
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
    """Distance along `toward` from `start` to a height over the ellipsoid; NaN where none, km.

    Newton's method on the geodetic height, from the solution for a sphere; the height grows by
    `toward`·zenith per unit of distance, exactly.
    """
    import erfa

    radius = np.linalg.norm(start, axis=-1)
    _, _, ground = erfa.gc2gd(WGS84, np.broadcast_to(start, toward.shape) * 1e3)
    above = height - ground / 1e3
    # |start + d toward| = radius + above, solved without cancellation; upward looks only
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
    """Geometry of a satellite that moves as its two-line elements say (SGP4).

    Where a file holds several element sets of the object, each time uses the nearest.

    Raises
    ------
    InputError
        The elements are older than `max_age_days` at some time, or SGP4 cannot propagate them.
    """
    earth = Earth(time)
    position, velocity = (earth.teme_to_gcrs(v) for v in tle.states(time, max_age_days))
    return replace(_seen(time, site, position, earth), velocity_km_s=velocity)
