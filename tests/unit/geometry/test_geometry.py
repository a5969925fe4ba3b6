"""Places of satellites, Sun and sites against published numbers and astropy's own machinery."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import erfa
import numpy as np
import pytest
import sgp4
from sgp4.api import Satrec

from lcbayes.core.errors import InputError
from lcbayes.geometry.directions import from_altaz, from_radec, from_tle
from lcbayes.geometry.earth import Earth, sun_position, sunlit
from lcbayes.geometry.sites import Site
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import Tle, parse_tle

ISS = """ISS (ZARYA)
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
"""
EPOCH = 2454729.5 + 0.51782528  # 2008 day 264 = September 20
SITE = Site(43.65, 41.431, 2030.0)


def astropy_time(time) -> Any:
    from astropy.time import Time

    return Time(*time.utc, format="jd", scale="utc")


def jd_of(*calendar):
    """Two-part Julian date, UTC, of year, month, day, hour, minute, second."""
    return erfa.dtf2d("UTC", *calendar)


def published_positions() -> Iterator[tuple[Any, float, list[float]]]:
    """Satellite, minutes and TEME position of each row of the set published with SGP4."""
    folder = Path(sgp4.__file__).parent
    lines = [x for x in (folder / "SGP4-VER.TLE").read_text().splitlines() if x[:1] in "12" and x]
    records: dict[int, list[Satrec]] = {}
    for first, second in zip(lines[::2], lines[1::2], strict=True):
        satellite = Satrec.twoline2rv(first[:69], second[:69])
        records.setdefault(satellite.satnum, []).append(satellite)
    satellite: Any = None
    for row in (folder / "tcppver.out").read_text().splitlines():
        cells = row.split()
        if cells[-1] == "xx":
            satellite = records[int(cells[0])].pop(0)
        else:
            numbers = [float(x) for x in cells[:4]]
            yield satellite, numbers[0], numbers[1:]


def test_positions_are_those_published_with_sgp4():
    """AIAA 2006-6753, its verification set: 33 objects, about 700 positions, to a centimetre."""
    count, worst, failed = 0, 0.0, []
    for satellite, minutes, published in published_positions():
        epoch = satellite.jdsatepoch + satellite.jdsatepochF
        tle = Tle("set", (satellite,), np.array([epoch]))
        utc = np.array([satellite.jdsatepoch]), np.array([satellite.jdsatepochF + minutes / 1440])
        try:
            result = tle.teme(Times(utc, utc))
        except InputError:  # the set holds one object that must fail
            failed.append(satellite.satnum)
            continue
        worst = max(worst, float(np.max(np.abs(result[0] - published))))
        count += 1
    assert count > 600
    assert failed == [33334]
    assert worst < 1e-5


def test_teme_and_itrs_to_gcrs_as_published():
    """Vallado et al., AIAA 2006-6753, appendix C: 2004-04-06 07:51:28.386009 UTC, km."""
    utc = jd_of(2004, 4, 6, 7, 51, 28.386009)
    tt = erfa.taitt(*erfa.utctai(*utc))
    earth = Earth(Times(*(tuple(np.atleast_1d(x) for x in pair) for pair in (utc, tt))))
    gcrs = np.array([5102.508958, 6123.011401, 6378.136928])
    teme = np.array([[5094.18016210, 6127.64465950, 6380.34453270]])
    itrs = np.array([-1033.4793830, 7901.2952754, 6380.3565958])
    np.testing.assert_allclose(earth.teme_to_gcrs(teme)[0], gcrs, atol=1e-5)
    np.testing.assert_allclose(earth.to_gcrs(itrs)[0], gcrs, atol=1e-3)


@pytest.fixture(scope="module")
def time():
    return Times.of(EPOCH, np.linspace(0.0, 86400.0, 145))


def test_teme_to_gcrs_as_astropy_frames_do(time):
    from astropy import units
    from astropy.coordinates import GCRS, TEME, CartesianRepresentation

    teme = parse_tle(ISS, "iss").teme(time)
    when = astropy_time(time)
    frame: Any = TEME(CartesianRepresentation(teme.T * units.km), obstime=when)
    result: Any = frame.transform_to(GCRS(obstime=when)).cartesian
    theirs = result.xyz.to_value("km").T
    np.testing.assert_allclose(Earth(time).teme_to_gcrs(teme), theirs, atol=1e-4)


def test_site_as_astropy_places_it(time):
    from astropy import units
    from astropy.coordinates import EarthLocation

    there = EarthLocation.from_geodetic(41.431 * units.deg, 43.65 * units.deg, 2030 * units.m)
    place, _ = there.get_gcrs_posvel(astropy_time(time))
    theirs = place.xyz.to_value("km").T
    np.testing.assert_allclose(Earth(time).to_gcrs(SITE.itrs()), theirs, atol=1e-3)


def test_sun_by_the_almanac_formula(time):
    """Astronomical Almanac, page C5: good to 0.01° between 1950 and 2050, of date."""
    n = astropy_time(time).jd - 2451545.0
    anomaly = np.radians(357.528 + 0.9856003 * n)
    longitude = np.radians(
        280.460 + 0.9856474 * n + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2 * anomaly)
    )
    precession = np.radians(50.29 / 3600 * n / 365.25)  # of date → J2000
    tilt = np.radians(23.439)
    lon = longitude - precession
    formula = np.stack(
        [np.cos(lon), np.sin(lon) * np.cos(tilt), np.sin(lon) * np.sin(tilt)], axis=1
    )
    place = sun_position(time)
    distance = np.linalg.norm(place, axis=1)
    off = np.degrees(np.arccos(np.clip(np.sum(place / distance[:, None] * formula, 1), -1, 1)))
    assert off.max() < 0.02
    au = 1.00014 - 0.01671 * np.cos(anomaly) - 0.00014 * np.cos(2 * anomaly)
    np.testing.assert_allclose(distance / 149597870.7, au, atol=2e-4)


def test_a_satellite_seen_as_astropy_sees_it_in_the_sky(time):
    """Altitude and azimuth by astropy, from our TLE geometry, must lead back to its place."""
    from astropy import units
    from astropy.coordinates import ITRS, AltAz, CartesianRepresentation, EarthLocation

    seen = from_tle(time, SITE, parse_tle(ISS, "iss"))
    earth = Earth(time)
    itrs = np.einsum("tij,tj->ti", earth._to_itrs, seen.position_km)
    there = EarthLocation.from_geodetic(41.431 * units.deg, 43.65 * units.deg, 2030 * units.m)
    when = astropy_time(time)
    local = (itrs - SITE.itrs()).T * units.km
    topocentric = ITRS(CartesianRepresentation(local), obstime=when, location=there)
    sky = topocentric.transform_to(AltAz(obstime=when, location=there))
    altitude, azimuth = sky.alt.to_value("deg"), sky.az.to_value("deg")
    np.testing.assert_allclose(seen.altitude_deg, altitude, atol=1e-6)
    _, _, height = erfa.gc2gd(1, itrs * 1e3)
    up = altitude > 0
    assert up.sum() >= 2
    some = Times(*(tuple(x[up] for x in pair) for pair in (time.utc, time.tt)))
    again = from_altaz(some, SITE, altitude[up], azimuth[up], height[up] / 1e3)
    np.testing.assert_allclose(again.position_km, seen.position_km[up], atol=1e-4)

    toward = -seen.obs
    ra, dec = (
        np.degrees(np.arctan2(toward[:, 1], toward[:, 0])),
        np.degrees(np.arcsin(toward[:, 2])),
    )
    third = from_radec(time, SITE, ra, dec, seen.range_km)
    for name in ("sun", "obs", "range_km", "altitude_deg"):
        np.testing.assert_allclose(getattr(third, name), getattr(seen, name), atol=1e-8)


def test_sites_may_differ_from_time_to_time(time):
    both = Site([43.65, -30.0], [41.431, -70.0], [2030.0, 2400.0])
    two = Times(*(tuple(x[:2] for x in pair) for pair in (time.utc, time.tt)))
    args = (np.array([40.0, 60.0]), np.array([10.0, 200.0]), np.array([550.0, 550.0]))
    together = from_altaz(two, both, *args)
    for i, site in enumerate((SITE, Site(-30.0, -70.0, 2400.0))):
        alone = from_altaz(two, site, *args)
        np.testing.assert_allclose(together.position_km[i], alone.position_km[i], atol=1e-9)
    np.testing.assert_allclose(together.altitude_deg, args[0], atol=1e-9)


def test_straight_up_the_range_is_the_height():
    time = Times.of(EPOCH, [0.0])
    result = from_altaz(time, SITE, np.array([90.0]), np.array([0.0]), np.array([500.0]))
    np.testing.assert_allclose(result.range_km, 500.0 - 2.03, atol=1e-9)


def test_sunlit_by_a_drawing():
    """Sun on +x, 1 au off; behind the Earth the shadow's edge lies near y = its radius."""
    place = np.array(
        [[7000.0, 0, 0], [-7000, 0, 0], [-7000, 6330, 0], [-7000, 6378, 0], [-7000, 6420, 0]]
    )
    to_sun = np.array([149597870.7, 0.0, 0.0]) - place
    # edge of umbra and penumbra: the radius ∓ 7000 km × the Sun's angular radius, 0.00465
    assert sunlit(place, to_sun).tolist() == [True, False, False, False, True]


def test_times_beyond_the_table_are_used_and_noted():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        early = Earth(Times.of(2437000.5, [0.0]))
        late = Earth(Times.of(2466154.5, [0.0]))
        now = Earth(Times.of(EPOCH, [0.0]))
    assert now.notes == ()
    for earth in (early, late):
        assert "the nearest value is used" in earth.notes[0]
        assert np.isfinite(earth.to_gcrs(SITE.itrs())).all()


def test_a_leap_second_is_a_second():
    """2016-12-31T23:59:60 stood between these midnights' neighbours."""
    before = sum(jd_of(2016, 12, 31, 0, 0, 0.0))
    time = Times.of(before, [86399.0, 86400.0, 86401.0])
    assert [time.text(i) for i in range(3)] == [
        "2016-12-31T23:59:59Z",
        "2016-12-31T23:59:60Z",
        "2017-01-01T00:00:00Z",
    ]
    assert Times.of(before, [86400.046]).text(0, 2) == "2016-12-31T23:59:60.05Z"


def test_the_nearest_elements_are_used():
    one = parse_tle(ISS, "iss")
    later = ISS.replace("08264.51782528", "08268.51782528").replace("0  2927", "0  2921")
    two = parse_tle(later + ISS, "iss")
    assert two.epochs[1] - two.epochs[0] == pytest.approx(4.0)
    time = Times.of(EPOCH, [0.0, 86400.0])
    np.testing.assert_array_equal(two.teme(time), one.teme(time))
    time = Times.of(EPOCH, [3 * 86400.0])
    assert np.abs(two.teme(time) - one.teme(time)).max() > 100


def test_stale_elements_are_refused():
    time = Times.of(EPOCH, [0.0, 40 * 86400.0])
    with pytest.raises(InputError, match=r"are 40 days from .* at index 1: 2008-10-30T12:25"):
        from_tle(time, SITE, parse_tle(ISS, "iss"))
    assert from_tle(time, SITE, parse_tle(ISS, "iss"), max_age_days=None).range_km.size == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("-11606-4 0  2927", "-11606-4 0  2926"), "x.tle, line 2: checksum is 6, .* up to 7"),
        (("2 25544", "2 25545"), "x.tle, line 3: checksum"),
        (("2 25544  51.6416", "2 25544  51.641"), "line 3 has 68 characters"),
        (("  51.6416", "  51,6416"), "line 3: checksum|not laid out as line 2"),
        (("1 25544U", "3 25544U"), "line 3 starts with '2'; expected line 1"),
        (("\n2 25544", "\n# 2 25544"), "line 2 of the elements is missing"),
        ((ISS, "no elements here"), "holds no two-line elements"),
    ],
)
def test_broken_elements_name_their_line(change, message):
    with pytest.raises(InputError, match=message):
        parse_tle(ISS.replace(*change), "x.tle")


def test_elements_of_two_objects_are_refused():
    other = ISS.replace("25544U", "25545U").replace("2 25544", "2 25545")
    other = other.replace("0  2927", "0  2928").replace("1563537", "1563538")
    with pytest.raises(InputError, match="elements of 2 objects"):
        parse_tle(ISS + other, "x.tle")


@pytest.mark.parametrize(
    "text", ["43", "43,41", "a,b,c", "91,0,0", "nan,0,0", "0,0,1e6", "0,-181,0"]
)
def test_bad_sites(text):
    with pytest.raises(InputError, match="site"):
        Site.parse(text)


def test_no_line_of_sight():
    time = Times.of(EPOCH, [0.0])
    with pytest.raises(InputError, match="cannot be reached by 1 of the lines of sight"):
        from_altaz(time, SITE, np.array([10.0]), np.array([0.0]), np.array([1.0]))
