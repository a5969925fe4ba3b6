"""CCSDS tracking data messages, against times and directions computed here by another library."""

from __future__ import annotations

import numpy as np
import pytest

import lcbayes
from lcbayes.core.errors import InputError

TLE = (
    "1 25544U 98067A   24001.50000000  .00016717  00000-0  30000-3 0  9995",
    "2 25544  51.6400 100.0000 0003000  60.0000 300.0000 15.50000000    15",
)


def checksum(line: str) -> str:
    body = line[:-1]
    return body + str(sum(int(c) if c.isdigit() else c == "-" for c in body) % 10)


def message(rows: str, meta: str = "TIME_SYSTEM = UTC\nANGLE_TYPE = RADEC\n", comments: str = ""):
    return (
        f"CCSDS_TDM_VERS = 2.0\nCREATION_DATE = 2024-001T00:00:00\nORIGINATOR = TEST\n{comments}"
        f"META_START\n{meta}META_STOP\nDATA_START\n{rows}DATA_STOP\n"
    )


ROWS = """\
MAG = 2024-001T00:00:00.5 5.1
ANGLE_1 = 2024-001T00:00:00.5 50.0
ANGLE_2 = 2024-001T00:00:00.5 -20.0
RANGE = 2024-001T00:00:00.5 36000.0
MAG = 2024-01-01T00:00:10.5 5.3
ANGLE_1 = 2024-01-01T00:00:10.5 50.1
ANGLE_2 = 2024-01-01T00:00:10.5 -20.0
RANGE = 2024-01-01T00:00:10.5 36001.0
"""
SITE = "-30.2,-70.8,2200"


def saved(tmp_path, text):
    path = tmp_path / "track.tdm"
    path.write_text(text)
    return path


def test_a_standard_message_with_angles_and_ranges(tmp_path):
    astropy_time = pytest.importorskip("astropy.time")
    curve = lcbayes.read(saved(tmp_path, message(ROWS)), site=SITE)
    assert curve.source["format"] == "tdm"
    np.testing.assert_array_equal(curve.brightness, [5.1, 5.3])
    assert curve.epoch_jd is not None
    first = astropy_time.Time("2024-01-01T00:00:00.5", scale="utc").jd
    assert curve.epoch_jd + curve.t[0] / 86400 == pytest.approx(first, abs=1e-9)
    np.testing.assert_allclose(np.diff(curve.t), [10.0])
    assert curve.range_km is not None
    np.testing.assert_allclose(curve.range_km, [36000.0, 36001.0])
    ra, dec = np.radians([50.0, -20.0])
    toward = [np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)]
    np.testing.assert_allclose(-curve.obs[0], toward, atol=1e-12)
    assert curve.free_scale.all()
    assert "no zero point" in curve.source["notes"]


def test_a_stated_photometric_error_makes_magnitudes_calibrated(tmp_path):
    text = message(ROWS, comments="COMMENT AVG_PHOTOMETRIC_RMS=0.05\n")
    curve = lcbayes.read(saved(tmp_path, text), site=SITE)
    assert not curve.free_scale.any()
    np.testing.assert_array_equal(curve.error, [0.05, 0.05])


def test_elements_in_comments_and_lenient_spelling(tmp_path):
    first, second = map(checksum, TLE)
    comments = f"COMMENT FIRSTLINE={first}\nCOMMENT SECONDLINE={second}\nCOMMENT SITE={SITE}\n"
    rows = "".join(f"ANGLE_1= {t} nan\nMAG = {t} {m}\n" for t, m in times_overhead(first, second))
    text = message(rows, comments=comments).replace("META_START", "META START").split("\n", 3)[3]
    curve = lcbayes.read(saved(tmp_path, text))
    assert "elements of the message were used" in curve.source["notes"]
    assert "days from the last point" in curve.source["notes"]
    elements = tmp_path / "object.tle"
    elements.write_text(f"{first}\n{second}\n")
    again = lcbayes.read(saved(tmp_path, text), tle=elements, site=SITE)
    np.testing.assert_array_equal(curve.obs, again.obs)


def times_overhead(first, second):
    """Two times at which the satellite is high over the site, in sunlight, by astropy and sgp4."""
    from astropy import units as u
    from astropy.coordinates import ITRS, TEME, AltAz, CartesianRepresentation, EarthLocation
    from astropy.time import Time
    from sgp4.api import Satrec

    satellite = Satrec.twoline2rv(first, second)
    jd = 2460311.0 + np.arange(0.0, 2.0, 20.0 / 86400)
    whole = np.floor(jd)
    _, place, _ = satellite.sgp4_array(whole, jd - whole)
    time = Time(jd, format="jd", scale="utc")
    teme = TEME(CartesianRepresentation(place.T * u.km), obstime=time)
    location = EarthLocation.from_geodetic(-70.8 * u.deg, -30.2 * u.deg, 2200 * u.m)
    itrs = teme.transform_to(ITRS(obstime=time))
    altitude = (
        ITRS(itrs.cartesian - location.get_itrs(time).cartesian, obstime=time, location=location)
        .transform_to(AltAz(obstime=time, location=location))
        .alt.deg
    )
    high = [int(k) for k in np.flatnonzero(altitude > 20.0)]
    first_pass = high[0]
    return [(str(time.isot[k]), 5.0) for k in (first_pass, first_pass + 1)]


@pytest.mark.parametrize(
    ("rows", "meta", "expected"),
    [
        ("ANGLE_1 = 2024-001T00:00:00 5\n", None, "without MAG"),
        ("MAG = 2024-001T00:00:00\n", None, "line 9: MAG has 1 values"),
        ("MAG = 2024-001T00:00:00 bright\n", None, "no number"),
        ("MAG = yesterday 5\n", None, "the time is 'yesterday'"),
        (ROWS, "TIME_SYSTEM = TAI\nANGLE_TYPE = RADEC\n", "TIME_SYSTEM is TAI"),
        (ROWS, "ANGLE_TYPE = RADEC\nREFERENCE_FRAME = TEME\n", "REFERENCE_FRAME is TEME"),
        (ROWS, "ANGLE_TYPE = RADEC\nRANGE_UNITS = s\n", "RANGE_UNITS is s"),
        ("MAG = 2024-001T00:00:00 5\nMAG = 2024-001T00:00:10 5\n", None, "neither angles nor"),
        (ROWS.replace("RANGE", "DOPPLER_INSTANTANEOUS"), None, "without RANGE"),
        ("??\n" + ROWS, None, "no 'KEYWORD = value'"),
    ],
)
def test_faults_of_a_message_in_one_line(tmp_path, rows, meta, expected):
    text = message(rows) if meta is None else message(rows, meta)
    with pytest.raises(InputError, match=expected):
        lcbayes.read(saved(tmp_path, text), site=SITE)


def test_elements_that_contradict_the_angles_are_refused(tmp_path):
    first, second = map(checksum, TLE)
    elements = tmp_path / "object.tle"
    elements.write_text(f"{first}\n{second}\n")
    (time, _), (later, _) = times_overhead(first, second)
    rows = "".join(f"MAG = {t} 5\nANGLE_1 = {t} 10\nANGLE_2 = {t} 88\n" for t in (time, later))
    with pytest.raises(InputError, match="elements contradict by over 3 deg"):
        lcbayes.read(saved(tmp_path, message(rows)), tle=elements, site=SITE)
