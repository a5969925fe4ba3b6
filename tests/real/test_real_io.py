"""Readers and geometry on observations that others published."""

import numpy as np
import pytest

from lcbayes.core.constants import EARTH_GM
from lcbayes.data.read import read
from lcbayes.data.write import write

pytestmark = pytest.mark.real


@pytest.mark.parametrize(
    ("name", "points", "curves", "relative"),
    [
        ("43_Ariadne_rel.lcs", 1541, 37, 37),
        ("43_Ariadne_mixed.lcs", 1541, 37, 21),
        ("135_Hertha.lcs", 1285, 32, 32),
    ],
)
def test_damit(data_dir, tmp_path, name, points, curves, relative):
    curve = read(data_dir / "damit" / name)
    assert (curve.n_obs, curve.n_curves, curve.free_scale.sum()) == (points, curves, relative)
    assert curve.frame == "ecliptic-j2000"
    assert curve.error is None
    means = np.bincount(curve.curve, curve.brightness) / np.bincount(curve.curve)
    np.testing.assert_allclose(means[curve.free_scale], 1.0, rtol=1e-12)
    write(curve, tmp_path / "again.csv")
    again = read(tmp_path / "again.csv")
    for field in ("t", "brightness", "sun", "obs", "curve", "free_scale"):
        np.testing.assert_array_equal(getattr(again, field), getattr(curve, field))
    assert (again.epoch_jd, again.frame) == (curve.epoch_jd, curve.frame)


def test_damit_first_row_of_ariadne(data_dir):
    """2438882.233275, 9.843520e-01, Sun (1.467574, 1.309298, 0.08242228) au, as printed."""
    curve = read(data_dir / "damit" / "43_Ariadne_rel.lcs")
    assert curve.epoch_jd == 2438882.0
    assert curve.t[0] == pytest.approx(0.233275 * 86400, abs=1e-4)
    sun = np.array([1.467574, 1.309298, 0.08242228])
    np.testing.assert_allclose(curve.sun[0], sun / np.sqrt(sun @ sun), rtol=1e-15)
    # t is far from the epoch in the last curve: the Julian date comes back
    last = curve.epoch_jd + curve.t[-1] / 86400
    assert last == pytest.approx(2447896.3, abs=1.0)


def test_score_geometry_gives_the_phase_angles_of_satchecker(data_dir):
    """Site, RA/Dec, range and Sun: 2781 phase angles that other software computed."""
    curve = read(data_dir / "starlink-v2mini-score" / "v2mini.csv")
    assert curve.n_obs == 2781
    assert curve.source["format"] == "score"
    assert "1 point below the horizon" in curve.source["notes"]
    assert curve.range_km is not None
    # the wrong match of 2023-06-30 is kept
    wrong = (curve.extra["satellite_name"] == "STARLINK-30112") & (curve.range_km > 1500)
    assert wrong.sum() == 6
    published = curve.extra["phase_angle_deg_satchecker"].astype(float)
    assert np.max(np.abs(np.degrees(curve.phase_angle) - published)) < 1e-5
    # what SatChecker calls illuminated, from the Sun's centre, we do but for a few in penumbra
    lit = curve.extra["illuminated"] == "True"
    assert (curve.extra["sunlit"][lit] == 0).sum() <= 8
    assert not lit[wrong].any()
    assert not curve.free_scale.any()
    assert set(curve.band) == {"CLEAR"}
    assert (curve.site == "43.650N 41.431E MMT9").sum() == 2352
    assert len(set(curve.site)) == 8
    one = curve.select(curve.extra["satellite_name"] == "STARLINK-30123")
    assert one.n_obs == 45
    assert one.curve_names == ("STARLINK-30123",)


def test_score_rates_are_those_of_orbits(data_dir):
    """Starlink flies on circles, at 43 and 53° to the equator: speeds, climbs and planes."""
    curve = read(data_dir / "starlink-v2mini-score" / "v2mini.csv")
    assert curve.position_km is not None
    assert curve.velocity_km_s is not None
    radius, speed = (np.linalg.norm(v, axis=1) for v in (curve.position_km, curve.velocity_km_s))
    ratio = speed / np.sqrt(EARTH_GM / radius)
    assert np.mean(np.abs(ratio - 1) < 2e-3) > 0.99
    assert np.abs(ratio - 1).max() < 0.01
    pole = np.cross(curve.position_km, curve.velocity_km_s)
    tilt = np.degrees(np.arccos(pole[:, 2] / np.linalg.norm(pole, axis=1)))
    assert np.mean((np.abs(tilt - 43) < 0.3) | (np.abs(tilt - 53.2) < 0.3)) > 0.99


def test_pomenis_ranges_follow_from_heights(data_dir):
    """Law of cosines on a sphere of the Earth's mean radius there: good to some per cent."""
    path = data_dir / "starlink-v1.5-pomenis" / "pomenis_observations.csv"
    curve = read(path, site="32.4434,-110.7881,2790")
    lines = [line.split(",") for line in path.read_text().splitlines() if line.startswith("2022")]
    lines.sort(key=lambda cells: cells[0])
    assert curve.n_obs == len(lines) == 1173
    assert curve.error is None
    height, altitude, mag = np.array([[float(x[1]), float(x[2]), float(x[4])] for x in lines]).T
    np.testing.assert_array_equal(np.sort(curve.brightness), np.sort(mag))
    radius, rise = 6372.0 + 2.79, np.sin(np.radians(altitude))
    half, above = radius * rise, height - 2.79
    expected = np.sqrt(half**2 + above * (2 * radius + above)) - half
    assert curve.range_km is not None
    np.testing.assert_allclose(np.sort(curve.range_km), np.sort(expected), rtol=5e-3)
