"""Earth and Sun: orientation, positions, shadow and air mass, in GCRS axes and kilometres.

Nothing is downloaded: the Earth's orientation comes from the IERS table bundled with astropy.
"""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import AU_KM, EARTH_RADIUS_KM, SUN_RADIUS_KM
from lcbayes.geometry.times import Times

Floats = NDArray[np.float64]


def sun_position(time: Times) -> Floats:
    """Geocentric position of the Sun, ICRS axes, km, (T, 3).

    The position is geometric, as in catalogues of satellites and asteroids: the aberration of
    sunlight by the Earth's motion (20") is neglected. From erfa's `epv00`, accurate to 10 km over
    1900-2100.
    """
    import erfa

    heliocentric, _ = erfa.epv00(*time.tt)  # expects TDB, which is within 2 ms of TT
    return -heliocentric["p"] * AU_KM


class Earth:
    """The Earth's orientation at given times: rotations between ITRS, GCRS and TEME.

    IAU 2006/2000A with polar motion and UT1 from the IERS table bundled with astropy. Times outside
    the table use its nearest value and add a sentence to `notes`.
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

    Interpolated linearly between the days of the IERS table bundled with astropy, after removal of
    the leap seconds.
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
        warnings.simplefilter("ignore")  # about its age, which the notes mention
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
    """Whether the whole solar disc is visible past a spherical Earth of equatorial radius.

    Both arguments are (T, 3): the geocentric position, and the vector from there to the Sun.
    """
    away, far = np.linalg.norm(position_km, axis=-1), np.linalg.norm(to_sun_km, axis=-1)
    cosine = -np.sum(position_km * to_sun_km, axis=-1) / (away * far)
    apart = np.arccos(np.clip(cosine, -1.0, 1.0))
    discs = np.arcsin(np.minimum(EARTH_RADIUS_KM / away, 1.0)) + np.arcsin(SUN_RADIUS_KM / far)
    return apart >= discs


def airmass(position_km: Floats, obs: Floats, range_km: Floats) -> Floats:
    """Air mass between a satellite and its observer relative to the zenith, (T,).

    X = 1/(sin h + 0.50572 (h + 6.07995°)^(−1.6364)), where h is the altitude in degrees above a
    horizon perpendicular to the observer's geocentric position (within 0.2° of the true horizon).

    References
    ----------
    Kasten & Young 1989, Applied Optics 28, 4735, eq. (3).
    """
    site = position_km + range_km[:, None] * obs
    rise = -np.sum(site * obs, axis=-1) / np.linalg.norm(site, axis=-1)
    h = np.degrees(np.arcsin(np.clip(rise, 0.0, 1.0)))
    return 1.0 / (np.sin(np.radians(h)) + 0.50572 * (h + 6.07995) ** -1.6364)
