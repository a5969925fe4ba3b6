"""Geometry of a table without directions, computed from a site and celestial coordinates."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError, RowError
from lcbayes.data.formats.columns import ALTAZ, RADEC, SITE, Options, need
from lcbayes.data.formats.table import Table
from lcbayes.geometry.directions import Geometry, from_altaz, from_radec, from_tle
from lcbayes.geometry.sites import Site
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import Tle, read_tle

Floats = NDArray[np.float64]

OLD_DAYS = 5.0  # age of elements above which a low orbit is noticeably off
LOW_ORBIT_KM = 8400.0  # distance from the centre of the Earth
RANGE_TOLERANCE = 0.05  # relative difference between the ranges in the file and from the elements


def computed_geometry(
    table: Table, options: Options, t: Floats, epoch_jd: float | None, used: set[str]
) -> tuple[Geometry, tuple[str, ...], dict[str, Any]]:
    """Directions and ranges in ICRS axes, notes, and columns to add to `extra`.

    Points in the Earth's shadow or penumbra are kept, marked and counted in a note. Models dim them
    (`lcbayes.data.earth_shadow`); methods without a model treat them as fully lit.
    """
    if epoch_jd is None:
        raise InputError(
            f"{table.file.name} gives seconds without a date, so the Sun cannot be placed; give "
            "utc or jd, or the line '# epoch_jd: …' above the header"
        )
    try:
        site = _site(table, options)
        geometry = _place(table, options, site, t, epoch_jd, used)
        low = geometry.altitude_deg < 0.0
        if low.any():
            row, worst = int(np.argmax(low)), float(geometry.altitude_deg[low][0])
            what = f"has {int(low.sum())} of {low.size} points below the horizon"
            remedy = (
                "check the site (degrees, north and east positive), the times (UTC) and that the "
                "elements are of this object"
            )
            if likely := _site_that_sees(table, options, site, t, epoch_jd):
                remedy = f"with {likely}, all would be above it: check the site"
            raise RowError("the satellite", what, row, f"altitude {worst:.1f} deg", remedy)
    except RowError as fault:
        raise fault.located(table.label(fault.name), table.at(fault.row)) from None
    notes, extra = geometry.notes, {}
    dark = int(np.count_nonzero(~geometry.sunlit))
    if dark == t.size and not options.geometry_only:
        raise InputError(
            f"{table.file.name}: all {dark} points lie in the Earth's shadow, where nothing is "
            "seen; check the times and that the places or elements are of this object"
        )
    if dark:
        extra["sunlit"] = geometry.sunlit.astype(int)
        notes += (f"{dark} points lie in the Earth's shadow or penumbra (column sunlit is 0)",)
    return geometry, notes, extra


def _site_that_sees(table: Table, options: Options, site: Site, t: Floats, epoch_jd: float) -> str:
    """The usual mistake about a site without which all points are above the horizon, or ""."""
    lat, lon = np.asarray(site.lat_deg), np.asarray(site.lon_deg)
    others = {
        "the opposite sign of the longitude (east is positive)": (lat, -lon),
        "latitude and longitude exchanged": (lon, lat),
        "degrees in place of radians": (np.degrees(lat), np.degrees(lon)),
    }
    for what, (other_lat, other_lon) in others.items():
        try:
            other = Site(other_lat, other_lon, site.height_m)
            seen = _place(table, options, other, t, epoch_jd, set())
        except InputError:
            continue
        if np.all(seen.altitude_deg > 0.0):
            return what
    return ""


def _place(
    table: Table, options: Options, site: Site, t: Floats, epoch_jd: float, used: set[str]
) -> Geometry:
    time = Times.of(epoch_jd, t)
    if options.tle is not None:
        elements = options.tle if isinstance(options.tle, Tle) else read_tle(options.tle)
        geometry = from_tle(time, site, elements)
        age = float(np.max(elements.age_days(time)))
        if (
            age > OLD_DAYS
            and np.median(np.linalg.norm(geometry.position_km, axis=1)) < LOW_ORBIT_KM
        ):
            note = (
                f"the elements are up to {age:.0f} days from the observations, so that the "
                "satellite may be degrees from its place along the track: get elements within "
                f"{OLD_DAYS:g} days"
            )
            geometry = replace(geometry, notes=(*geometry.notes, note))
        if "range_km" in table:
            used.add("range_km")
            given = table.number("range_km")
            off = np.abs(geometry.range_km - given) > RANGE_TOLERANCE * given
            remedy = f"check that {elements.name} is of this object and date"
            table.reject("range_km", off, "that the elements contradict by over 5 %", remedy)
        return geometry
    if "ra_deg" in table or "dec_deg" in table:
        need(table, RADEC)
        used |= {*RADEC}
        ra = table.number("ra_deg", -360.0, 360.0)
        dec = table.number("dec_deg", -90.0, 90.0)
        return from_radec(time, site, ra, dec, table.number("range_km", low=1e-6))
    need(table, ALTAZ)
    used |= {*ALTAZ}
    altitude = table.number("altitude_deg", 0.0, 90.0, "drop points below the horizon")
    azimuth = table.number("azimuth_deg", -360.0, 360.0)
    return from_altaz(time, site, altitude, azimuth, table.number("height_km", 1.0, 1e6))


def _site(table: Table, options: Options) -> Site:
    """The site from the option or from the columns, which stay in `extra`."""
    in_table = any(name in table for name in SITE)
    if options.site is not None and in_table:
        raise InputError(
            f"{table.file.name} has columns {SITE[0]} …, and a site is given as well; keep one"
        )
    if options.site is not None:
        return Site.parse(options.site)
    if not in_table:
        raise InputError(
            f"{table.file.name} names no site; give columns {' '.join(SITE)}, or --site LAT,LON,H"
        )
    need(table, SITE)
    return Site(*(table.number(name) for name in SITE))
