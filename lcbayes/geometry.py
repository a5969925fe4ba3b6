"""Directions to Sun and observer from what is known of a satellite's place in the sky.

Everything is in ICRS axes (which GCRS shares), kilometres, at the time of observation. Left out
are light time and aberration, 20" at most. Nothing is fetched: the Earth's
orientation comes from the IERS table that astropy bundles.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.errors import InputError
from lcbayes.lightcurve import RowError

if TYPE_CHECKING:
    from lcbayes.tle import Tle

Floats = NDArray[np.float64]

AU_KM = 149_597_870.7
EARTH_KM, SUN_KM = 6378.137, 695_700.0  # radii: WGS84 equator, IAU 2015 nominal
EARTH_GM = 398600.4418  # km³/s², EGM2008
MAX_TLE_AGE_DAYS = 30.0  # beyond, a low orbit is off by degrees along its track
_WGS84 = 1  # erfa's number for the ellipsoid


@dataclass(frozen=True)
class Site:
    """Where the observer stands, on the WGS84 ellipsoid; numbers, or (T,) one per time.

    Parameters
    ----------
    lat_deg, lon_deg : geodetic latitude (north) and longitude (east), degrees
    height_m : above the ellipsoid, metres
    """

    lat_deg: ArrayLike
    lon_deg: ArrayLike
    height_m: ArrayLike

    def __post_init__(self) -> None:
        for name, low, high in (
            ("lat_deg", -90.0, 90.0),
            ("lon_deg", -180.0, 360.0),
            ("height_m", -1000.0, 50_000.0),
        ):
            value = np.atleast_1d(np.asarray(getattr(self, name), dtype=float))
            bad = ~((value >= low) & (value <= high))
            if bad.any():
                row = int(np.argmax(bad))
                what = f"has {int(bad.sum())} values outside {low:g} .. {high:g}"
                remedy = "give latitude and longitude in degrees, height in metres"
                raise RowError(f"site_{name}", what, row, value[row], remedy)

    @classmethod
    def parse(cls, text: str) -> Site:
        """A site from "latitude,longitude,height"."""
        try:
            lat, lon, height = (float(part) for part in text.split(","))
        except ValueError:
            raise InputError(
                f"site is {text!r}; expected latitude,longitude,height in degrees (north, east) "
                "and metres, like 43.65,41.431,2030"
            ) from None
        try:
            return cls(lat, lon, height)
        except RowError as fault:
            raise InputError(f"site {text!r}: {fault}") from None

    def itrs(self) -> Floats:
        """Place in ITRS, km, (3,) or (T, 3)."""
        import erfa

        lon, lat = np.radians(self.lon_deg), np.radians(self.lat_deg)
        return erfa.gd2gc(_WGS84, lon, lat, np.asarray(self.height_m, dtype=float)) / 1e3

    def axes(self) -> Floats:
        """Unit vectors to east, north and zenith, ITRS, (3, 3) or (T, 3, 3)."""
        lon, lat = np.radians(self.lon_deg), np.radians(self.lat_deg)
        lon, lat = np.broadcast_arrays(lon, lat)
        sl, cl, sp, cp = np.sin(lon), np.cos(lon), np.sin(lat), np.cos(lat)
        east = np.stack([-sl, cl, np.zeros_like(sl)], -1)
        north = np.stack([-sp * cl, -sp * sl, cp], -1)
        zenith = np.stack([cp * cl, cp * sl, sp], -1)
        return np.stack([east, north, zenith], -2)


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


@dataclass(frozen=True)
class Times:
    """Moments as two-part Julian dates (T,), whose sum is the date, in the scales used here."""

    utc: tuple[Floats, Floats]
    tt: tuple[Floats, Floats]

    @classmethod
    def of(cls, epoch_jd: float, t: ArrayLike) -> Times:
        """Seconds elapsed since a UTC Julian date, leap seconds counted."""
        import erfa

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)  # years whose leap seconds are open
            whole = np.floor(epoch_jd)
            tai1, tai2 = erfa.utctai(whole, epoch_jd - whole)
            days, rest = np.divmod(np.atleast_1d(np.asarray(t, dtype=float)), 86400.0)
            tai = tai1 + days, tai2 + rest / 86400.0
            return cls(erfa.taiutc(*tai), erfa.taitt(*tai))

    def text(self, row: int, decimals: int = 0) -> str:
        """One of them in ISO 8601, UTC, to the second or to decimals of it."""
        import erfa

        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            year, month, day, clock = erfa.d2dtf("UTC", decimals, *(x[row] for x in self.utc))
        h, m, s, rest = clock.tolist()
        part = f".{rest:0{decimals}d}" if decimals else ""
        return f"{year:04d}-{month:02d}-{day:02d}T{h:02d}:{m:02d}:{s:02d}{part}Z"


def seconds_between(first_jd: float, second_jd: float) -> float:
    """Seconds from one UTC Julian date to another, leap seconds counted as readers of files do."""
    (a1, a2), (b1, b2) = (Times.of(jd, 0.0).tt for jd in (first_jd, second_jd))
    return float(((b1 - a1) + (b2 - a2))[0] * 86400.0)


def sun_position(time: Times) -> Floats:
    """Geocentric place of the Sun, ICRS axes, km, (T, 3).

    Geometric, as catalogues of satellites and asteroids have it: the aberration of sunlight by
    the Earth's motion (20") is left out. From erfa's `epv00`, good to 10 km over 1900-2100.
    """
    import erfa

    heliocentric, _ = erfa.epv00(*time.tt)  # wants TDB, which is within 2 ms of TT
    return -heliocentric["p"] * AU_KM


class Earth:
    """The Earth's orientation at given times: rotations between ITRS, GCRS and TEME.

    IAU 2006/2000A with polar motion and UT1 from the IERS table bundled with astropy. For times
    beyond the table its nearest value is taken, and `notes` says so.
    """

    def __init__(self, time: Times) -> None:
        import erfa

        ut1_utc, xp, yp, known, span = _orientation(time.utc)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", erfa.ErfaWarning)
            ut1 = erfa.utcut1(*time.utc, ut1_utc)
        self._to_itrs = erfa.c2t06a(*time.tt, *ut1, xp, yp)
        polar = erfa.pom00(xp, yp, erfa.sp00(*time.tt))
        spin = erfa.rz(erfa.gmst82(*ut1), np.broadcast_to(np.eye(3), polar.shape))
        self._teme_to_itrs = polar @ spin
        self.notes: tuple[str, ...] = ()
        if not known:
            self.notes = (
                f"the Earth's rotation is tabulated for MJD {span} only: beyond, the nearest "
                "value is used, and the site may be off by some 0.4 km",
            )

    def to_gcrs(self, itrs: Floats) -> Floats:
        """Rotate (3,) or (T, 3) from ITRS to GCRS."""
        return np.einsum("...ji,...j->...i", self._to_itrs, itrs)

    def teme_to_gcrs(self, teme: Floats) -> Floats:
        """Rotate (T, 3) from SGP4's frame (true equator, mean equinox) to GCRS."""
        return self.to_gcrs(np.einsum("...ij,...j->...i", self._teme_to_itrs, teme))


def _orientation(
    utc: tuple[Floats, Floats],
) -> tuple[Floats, Floats, Floats, bool, str]:
    """UT1-UTC (s), polar motion x and y (rad), whether all times are in the table, its MJDs.

    From the IERS table that astropy bundles; linear between its days, after taking the leap
    seconds out.
    """
    table = _iers()
    mjd = (utc[0] - 2400000.5) + utc[1]
    day = table["mjd"]
    values = [np.interp(mjd, day, table[name]) for name in ("ut1_tai", "xp", "yp")]
    leap = table["tai_utc"][np.clip(np.searchsorted(day, mjd, side="right") - 1, 0, None)]
    known = bool(((mjd >= day[0]) & (mjd <= day[-1])).all())
    return values[0] + leap, values[1], values[2], known, f"{day[0]:.0f} .. {day[-1]:.0f}"


@cache
def _iers() -> dict[str, Floats]:
    import erfa

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its age, which the notes speak of
        from astropy.utils import iers

        with iers.conf.set_temp("auto_download", False):
            table: Any = iers.IERS_A.open(iers.IERS_A_FILE)
        mjd = np.asarray(table["MJD"].to_value("d"), dtype=float)
        year, month, day, _ = erfa.jd2cal(2400000.5, mjd)
        tai_utc = erfa.dat(year, month, day, 0.0)
    return {
        "mjd": mjd,
        "tai_utc": tai_utc,
        "ut1_tai": np.asarray(table["UT1_UTC"].to_value("s"), dtype=float) - tai_utc,
        "xp": np.asarray(table["PM_x"].to_value("rad"), dtype=float),
        "yp": np.asarray(table["PM_y"].to_value("rad"), dtype=float),
    }


def sunlit(position_km: Floats, to_sun_km: Floats) -> NDArray[np.bool_]:
    """Whether the whole disc of the Sun is seen past the Earth, a sphere of its equator's radius.

    Both arguments are (T, 3): the geocentric place, and the vector from there to the Sun.
    """
    away, far = np.linalg.norm(position_km, axis=-1), np.linalg.norm(to_sun_km, axis=-1)
    cosine = -np.sum(position_km * to_sun_km, axis=-1) / (away * far)
    apart = np.arccos(np.clip(cosine, -1.0, 1.0))
    discs = np.arcsin(np.minimum(EARTH_KM / away, 1.0)) + np.arcsin(SUN_KM / far)
    return apart >= discs


def airmass(position_km: Floats, obs: Floats, range_km: Floats) -> Floats:
    """Air between a satellite and its observer, (T,), as a multiple of that toward the zenith.

    X = 1/(sin h + 0.50572 (h + 6.07995°)^(−1.6364)), h the altitude in degrees over a horizon that
    is square to the observer's geocentric place (within 0.2° of the true one).

    References
    ----------
    Kasten & Young 1989, Applied Optics 28, 4735, eq. (3).
    """
    site = position_km + range_km[:, None] * obs
    rise = -np.sum(site * obs, axis=-1) / np.linalg.norm(site, axis=-1)
    h = np.degrees(np.arcsin(np.clip(rise, 0.0, 1.0)))
    return 1.0 / (np.sin(np.radians(h)) + 0.50572 * (h + 6.07995) ** -1.6364)


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
    toward = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], -1)
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
    _, _, ground = erfa.gc2gd(_WGS84, np.broadcast_to(start, toward.shape) * 1e3)
    above = height - ground / 1e3
    # |start + d toward| = radius + above, solved without cancellation; upward looks only
    half = radius * rise
    root = half**2 + above * (2.0 * radius + above)
    with np.errstate(invalid="ignore"):
        up = (rise >= 0) & (above > 0)
        distance = np.where(up, above * (2.0 * radius + above) / (half + np.sqrt(root)), np.nan)
    for _ in range(8):
        lon, lat, now = erfa.gc2gd(
            _WGS84, 1e3 * (start + np.nan_to_num(distance, nan=1.0)[:, None] * toward)
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
