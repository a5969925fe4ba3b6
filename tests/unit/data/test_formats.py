"""DAMIT, MMT-9, SCORE and tables whose directions are computed, on small files made here."""

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.data.read import read, read_geometry
from lcbayes.geometry.directions import from_tle
from lcbayes.geometry.sites import Site
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import parse_tle

ISS = """ISS (ZARYA)
1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
"""
SITE = "43.65,41.431,2030"
MIDNIGHT = 2454729.5  # 2008-09-20
DUSK = np.arange(60480.0, 60901.0, 20.0)

DAMIT = """2
2 0
2443845.25  2.0  0 -2 0   3 0 0
2443845.75  4.0  0 -2 0   3 0 0

1 1
2443846.5  7.5  0 0 1e-3   0 4 3
"""


@pytest.fixture(scope="module")
def seen():
    """A sunlit pass of the satellite over the site: seconds of the day and its geometry."""
    t = np.arange(0.0, 86400.0, 20.0)
    geometry = from_tle(Times.of(MIDNIGHT, t), Site.parse(SITE), parse_tle(ISS, "iss"))
    up = np.flatnonzero((geometry.altitude_deg > 5) & geometry.sunlit)
    first = up[: np.argmax(np.diff(up) > 1) + 1]
    assert first.size > 10
    return t[first], geometry, first


@pytest.fixture
def tle(tmp_path):
    path = tmp_path / "iss.tle"
    path.write_text(ISS)
    return path


def utc(seconds):
    s = int(seconds)
    return f"2008-09-20T{s // 3600:02d}:{s // 60 % 60:02d}:{s % 60:02d}Z"


def test_damit(tmp_path):
    path = tmp_path / "a.lcs"
    path.write_text(DAMIT)
    curve = read(path)
    assert curve.source["format"] == "damit"
    assert (curve.frame, curve.epoch_jd, curve.kind) == ("ecliptic-j2000", 2443845.0, "flux")
    assert curve.t.tolist() == [21600.0, 64800.0, 129600.0]
    np.testing.assert_allclose(curve.brightness, [2 / 3, 4 / 3, 7.5], rtol=1e-15)
    assert curve.free_scale.tolist() == [True, False]
    assert curve.sun.tolist() == [[0, -1, 0], [0, -1, 0], [0, 0, 1]]
    np.testing.assert_allclose(curve.obs[2], [0, 0.8, 0.6], rtol=1e-15)
    assert curve.error is None
    assert read(path, error=0.01).error.tolist() == [0.01] * 3  # pyright: ignore[reportOptionalMemberAccess]
    assert read_geometry(path).geometry_only


def test_input_of_asteroids_at_home(tmp_path):
    """14 lines of settings, remarks behind the flags, and weights of curves at the end."""
    curves = DAMIT.replace("2 0\n", "2 0 0.12 2006.9-2010.9 V 703_CATALINA\n").replace("\n\n", "\n")
    text = "2\t0.5\t1000\t 1\tperiod_start period_step period_end fixed/free\n"
    text += "0.1\t0\n" * 13 + curves + "1 0.5\n2 1\n"
    path, plain = tmp_path / "period_search_in", tmp_path / "a.lcs"
    path.write_text(text)
    plain.write_text(DAMIT)
    curve, expected = read(path), read(plain)
    assert curve.source["format"] == "damit"
    for name in ("t", "brightness", "sun", "obs", "curve", "free_scale"):
        np.testing.assert_array_equal(getattr(curve, name), getattr(expected, name))
    path.write_text(text.replace("\t0.5\t1000", "\tfrom\tto"))
    with pytest.raises(InputError):
        read(path)


def test_damit_with_more_curves_than_announced(tmp_path):
    path = tmp_path / "a.lcs"
    path.write_text(DAMIT.replace("2\n", "1\n", 1))
    curve = read(path)
    assert curve.n_curves == 2
    assert "announces 1 curves, the file holds 2" in curve.source["notes"]


def _asteroid(values, flag: int = 0) -> str:
    """Three curves of 20 intensities each, at phase angles of 0, 10 and 20 degrees."""
    curves = ["3"]
    for number, rows in enumerate(np.reshape(values, (3, 20))):
        x, y = np.cos(np.radians(10 * number)), np.sin(np.radians(10 * number))
        curves.append(f"20 {flag}")
        curves += [
            f"{2443845.25 + 30 * number + 0.01 * i} {value:.5f}  2 0 0  {2 * x:.6f} {2 * y:.6f} 0"
            for i, value in enumerate(rows)
        ]
    return "\n".join(curves)


@pytest.mark.parametrize("name", ["a.lcs", "period_search_in"])
def test_magnitudes_in_a_damit_file_are_refused(tmp_path, name):
    """An elongated asteroid of half a magnitude, which becomes fainter from curve to curve."""
    path = tmp_path / name
    settings = "2 0.5 1000 1\n" + "0.1\n" * 13 if name == "period_search_in" else ""
    level = np.repeat([13.9, 14.2, 14.6], 20)
    magnitudes = level + 0.25 * np.sin(np.tile(np.arange(20), 3))
    path.write_text(settings + _asteroid(magnitudes))
    with pytest.raises(InputError, match=r"lie in 13\.65 \.\. 14\.85 and vary by at most 3\.6 %"):
        read(path)
    path.write_text(settings + _asteroid(magnitudes, flag=1))
    with pytest.raises(InputError, match="grows with the phase angle, as magnitudes do"):
        read(path)
    assert read_geometry(path).n_obs == 60
    flux = 10.0 ** (-0.4 * (magnitudes - 18.0))  # 18 to 55, within the range of magnitudes
    for sound in (flux, magnitudes / magnitudes.mean(), np.tile(magnitudes[:20], 3)):
        path.write_text(settings + _asteroid(sound))
        assert read(path).n_curves == 3


def test_damit_with_its_own_directions_takes_no_others(tmp_path, tle):
    path = tmp_path / "a.lcs"
    path.write_text(DAMIT)
    with pytest.raises(InputError, match="leave out --tle and --site"):
        read(path, tle=tle, site=SITE)


def test_tle_site_and_times(tmp_path, seen, tle):
    t, geometry, rows = seen
    path = tmp_path / "pass.csv"
    path.write_text("\n".join(["utc,mag", *(f"{utc(s)},7" for s in t)]))
    curve = read(path, tle=tle, site=SITE)
    assert (curve.frame, curve.epoch_jd) == ("icrs", MIDNIGHT)
    np.testing.assert_array_equal(curve.t, t)
    np.testing.assert_allclose(curve.sun, geometry.sun[rows], atol=1e-12)
    np.testing.assert_allclose(curve.obs, geometry.obs[rows], atol=1e-12)
    assert curve.range_km is not None
    np.testing.assert_allclose(curve.range_km, geometry.range_km[rows], rtol=1e-12)


def test_radec_and_range_give_the_geometry_of_the_elements(tmp_path, seen):
    t, geometry, rows = seen
    obs, away = geometry.obs[rows], geometry.range_km[rows]
    ra, dec = np.degrees(np.arctan2(-obs[:, 1], -obs[:, 0])), np.degrees(np.arcsin(-obs[:, 2]))
    lines = ["utc,mag,ra_deg,dec_deg,range_km,site_lat_deg,site_lon_deg,site_height_m"]
    lines += [
        f"{utc(s)},7,{a!r},{d!r},{r!r},43.65,41.431,2030"
        for s, a, d, r in zip(t, ra.tolist(), dec.tolist(), away.tolist(), strict=True)
    ]
    path = tmp_path / "sky.csv"
    path.write_text("\n".join(lines))
    curve = read(path)
    np.testing.assert_allclose(curve.obs, obs, atol=1e-12)
    np.testing.assert_allclose(curve.sun, geometry.sun[rows], atol=1e-12)
    assert curve.extra["site_lat_deg"].tolist() == [43.65] * t.size


def test_points_in_shadow_are_flagged_and_noted(tmp_path, tle):
    """From 16:48 to 16:55 that evening, the satellite enters the shadow on its way."""
    path = tmp_path / "pass.csv"
    geometry = from_tle(Times.of(MIDNIGHT, DUSK), Site.parse(SITE), parse_tle(ISS, "iss"))
    dark = ~geometry.sunlit
    assert 0 < dark.sum() < dark.size
    path.write_text("\n".join(["utc,mag", *(f"{utc(s)},7" for s in DUSK)]))
    curve = read(path, tle=tle, site=SITE)
    assert curve.extra["sunlit"].tolist() == (~dark).astype(int).tolist()
    assert f"{dark.sum()} points lie in the Earth's shadow" in curve.source["notes"]


def test_a_wrong_satellite_is_found_out(tmp_path, seen, tle):
    t, geometry, rows = seen
    path = tmp_path / "pass.csv"
    away = geometry.range_km[rows] * 1.3
    cells = [f"{utc(s)},7,{r}" for s, r in zip(t, away, strict=True)]
    path.write_text("\n".join(["utc,mag,range_km", *cells]))
    with pytest.raises(InputError, match=r"elements contradict by over 5 % \(first in .*line 2"):
        read(path, tle=tle, site=SITE)
    path.write_text("\n".join(["utc,mag", *(f"{utc(s + 1800)},7" for s in t)]))
    with pytest.raises(InputError, match=r"below the horizon \(first in .*, line 2: altitude -"):
        read(path, tle=tle, site=SITE)


def mmt9(seen, phase_error=0.0, track=True):
    t, geometry, rows = seen
    phase = np.degrees(np.arccos(np.sum(geometry.sun * geometry.obs, 1)))[rows] + phase_error
    lines = [
        '# MMT-9, a track with an unpaired " in a comment',
        "# Date Time StdMag Mag Filter Penumbra Distance Phase Channel" + " Track" * track,
    ]
    for i, s in enumerate(t):
        date, clock = utc(s)[:-1].split("T")
        lines.append(
            f"{date} {clock}.250 6.1 {5 + i / 8} Clear {int(i == 3)} "
            f"{geometry.range_km[rows][i]:.1f} {phase[i]:.2f} 4" + " 777" * track
        )
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("track", [True, False])
def test_mmt9(tmp_path, seen, tle, track):
    path = tmp_path / "track.txt"
    path.write_text(mmt9(seen, track=track))
    curve = read(path, tle=tle)
    t, geometry, rows = seen
    assert curve.n_obs == t.size - 1  # one is in penumbra
    assert curve.source["format"] == "mmt9"
    assert "1 point in penumbra left out" in curve.source["notes"]
    assert curve.source["notes"].endswith("the site of MMT-9 (43.65,41.431,2030)")
    assert curve.brightness[:4].tolist() == [5.0, 5.125, 5.25, 5.5]
    assert curve.t[0] == t[0] + 0.25
    assert curve.curve_names == (("777",) if track else ("0",))
    assert not curve.free_scale.any()
    assert set(curve.band) == {"Clear"}
    assert curve.range_km is not None
    np.testing.assert_allclose(curve.range_km, np.delete(geometry.range_km[rows], 3), rtol=0.01)


def test_mmt9_needs_the_right_elements(tmp_path, seen, tle):
    path = tmp_path / "track.txt"
    path.write_text(mmt9(seen, phase_error=2.0))
    with pytest.raises(InputError, match=r"Phase has \d+ values that the elements contradict"):
        read(path, tle=tle)
    with pytest.raises(InputError, match="add --tle FILE"):
        read(path)


SCORE_HEAD = (
    "satellite_name,norad_cat_id,observation_time_utc,apparent_magnitude,"
    "apparent_magnitude_uncertainty,observer_latitude_deg,observer_longitude_deg,"
    "observer_altitude_m,instrument,mpc_code,observing_filter,sat_ra_deg_satchecker,"
    "sat_dec_deg_satchecker,range_to_sat_km_satchecker,alt_deg_satchecker,illuminated"
)


def score_row(name="A", minute=28, mag="2.4", err="0.2", ra="296.5", alt="52", lit=True, code=""):
    return (
        f"{name},1,2024-04-29T10:{minute}:45.000Z,{mag},{err},36.128,-95.988,201.0,B,{code},CLEAR,"
        f"{ra},2.6,409.0,{alt},{lit}"
    )


def test_score(tmp_path):
    path = tmp_path / "score.csv"
    rows = [
        score_row("B", 30),
        score_row("A", 29),
        score_row("B", 28, code="H06"),
        score_row("A", 28, lit=False),
    ]
    path.write_text("\n".join([SCORE_HEAD, *rows]))
    curve = read(path)
    assert curve.source["format"] == "score"
    assert curve.curve_names == ("A", "B")
    # what SatChecker calls dark is kept: the geometry says what is
    assert curve.curve.tolist() == [0, 0, 1, 1]
    assert curve.t.tolist()[2:] == [curve.t[0], curve.t[0] + 120]
    assert "notes" not in curve.source
    assert curve.extra["satellite_name"].tolist() == ["A", "A", "B", "B"]
    assert curve.site.tolist() == ["36.128N 95.988W B"] * 2 + ["H06 B", "36.128N 95.988W B"]
    assert curve.velocity_km_s is None  # no rates


def test_score_rows_that_cannot_be_used_are_counted(tmp_path):
    path = tmp_path / "score.csv"
    rows = [score_row("A", m) for m in (10, 11)]
    rows += [
        score_row(mag=""),
        score_row(mag="", minute=31),
        score_row(err=""),
        score_row(ra=""),
        score_row(alt="-3"),
    ]
    path.write_text("\n".join([SCORE_HEAD, *rows]))
    curve = read(path)
    assert curve.n_obs == 2
    notes = curve.source["notes"]
    for said in (
        "2 points without a magnitude",
        "1 point without an uncertainty",
        "1 point without a place in the sky",
        "1 point below the horizon",
    ):
        assert said + " left out" in notes
    assert read(path, error=0.1).n_obs == 3
    assert read_geometry(path).n_obs == 5  # magnitudes are not asked for
    path.write_text("\n".join([SCORE_HEAD, score_row(mag=""), score_row(mag="")]))
    with pytest.raises(InputError, match="all 2 points are without a magnitude"):
        read(path)


def test_score_velocities_are_those_of_the_elements(tmp_path, seen):
    """Rates by differences of SGP4's places, over 0.2 s; one of right ascension is spoilt."""
    t, place = seen[0], Site.parse(SITE)
    turned = lambda g: (  # noqa: E731
        np.degrees(np.arctan2(-g.obs[:, 1], -g.obs[:, 0])),
        np.degrees(np.arcsin(-g.obs[:, 2])),
    )
    geometry, *ends = (
        from_tle(Times.of(MIDNIGHT, t + h), place, parse_tle(ISS, "iss")) for h in (0, -0.1, 0.1)
    )
    (ra, dec), (ra0, dec0), (ra1, dec1) = turned(geometry), turned(ends[0]), turned(ends[1])
    east = ((ra1 - ra0 + 180.0) % 360.0 - 180.0) / 0.2 * np.cos(np.radians(dec))
    east[3] -= 1800.0 * np.cos(np.radians(dec[3]))
    away = (ends[1].range_km - ends[0].range_km) / 0.2
    head = (
        SCORE_HEAD
        + ",range_rate_sat_km_s_satchecker,dra_cosdec_deg_s_satchecker,"
        + ("ddec_deg_s_satchecker")
    )
    rows = [
        f"ISS,25544,{utc(s)},2.4,0.2,43.65,41.431,2030,none,,CLEAR,{a},{d},{r},{h},True,{v},{e},{n}"
        for s, a, d, r, h, v, e, n in zip(
            t,
            ra % 360.0,
            dec,
            geometry.range_km,
            geometry.altitude_deg,
            away,
            east,
            (dec1 - dec0) / 0.2,
            strict=True,
        )
    ]
    path = tmp_path / "score.csv"
    path.write_text("\n".join([head, *rows]))
    curve = read(path)
    assert "velocity of 1 point is that of a circular orbit" in curve.source["notes"]
    assert curve.velocity_km_s is not None
    assert geometry.velocity_km_s is not None
    off = np.linalg.norm(curve.velocity_km_s - geometry.velocity_km_s, axis=1)
    assert np.delete(off, 3).max() < 2e-3  # the Earth's axis is 0.12° from the axes' z: 1 m/s
    assert off[3] < 0.02  # the orbit's eccentricity is 0.0007
    path.write_text("\n".join([head, *rows]).replace(f",{away[5]},", ",,"))
    assert read(path).velocity_km_s is None  # one rate is missing


def test_pomenis(tmp_path):
    path = tmp_path / "p.csv"
    path.write_text(
        "# made here\n\nobservation_time,satellite_height,satellite_altitude,satellite_azimuth,"
        "ab_magnitude\n2022-01-26T13:28:39,550,90,316,4.8\n2022-01-25T12:53:02,550,60,45,7.8\n"
    )
    curve = read(path, site="32.4434,-110.7881,2790")
    assert curve.source["format"] == "pomenis"
    assert curve.brightness.tolist() == [7.8, 4.8]
    assert curve.range_km is not None
    assert curve.range_km[1] == pytest.approx(550 - 2.79, abs=1e-6)
    alone = read(path)
    assert "seen from Mt Lemmon" in alone.source["notes"]
    np.testing.assert_array_equal(alone.obs, curve.obs)


def test_the_format_can_be_said(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(DAMIT)
    assert read(path, format="damit").n_obs == 3
    with pytest.raises(InputError, match="unknown format 'xls'; available: csv, ecsv, damit"):
        read(path, format="xls")
    with pytest.raises(InputError):
        read(path, format="csv")
