"""What models see of a light curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import lcbayes
from lcbayes.core.constants import SOLAR_FLUX_VISIBLE
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics import photometry
from tests.helpers import small_curves


def test_time_starts_at_the_first_point():
    light = small_curves.curve(10)
    light = replace(light, t=light.t + 1234.5)
    data = Epochs.of(light)
    np.testing.assert_allclose(data.t, np.linspace(0, 60, 10))
    assert (float(data.t_middle), float(data.t_span)) == (30.0, 60.0)


def test_time_origin_is_the_fitted_curves():
    """Epochs to predict are counted from the fitted curve's first point, over any epoch_jd."""
    fitted = replace(small_curves.curve(10), epoch_jd=2460000.5)
    later = replace(
        small_curves.curve(4), epoch_jd=2460001.5, t=np.array([100.0, 110.0, 120.0, 130.0])
    )
    data = Epochs.of(later, fitted)
    np.testing.assert_allclose(data.t, 86400.0 + later.t)
    assert (float(data.t_middle), float(data.t_span)) == (30.0, 60.0)


def test_a_leap_second_between_two_files_counts(tmp_path):
    """Two files and one file of the same rows agree on the time between them."""
    rows = [f"2016-12-31T23:59:{s:02d}Z,1,1,0,0,0,1,0" for s in (0, 30)]
    rows += [f"2017-01-01T00:00:{s:02d}Z,1,1,0,0,0,1,0" for s in (0, 30)]
    files = {"one": rows, "first": rows[:2], "second": rows[2:]}
    for name, lines in files.items():
        head = "utc,flux,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z"
        (tmp_path / f"{name}.csv").write_text("\n".join([head, *lines]))
    one, first, second = (lcbayes.read(tmp_path / f"{name}.csv") for name in files)
    np.testing.assert_allclose(Epochs.of(one).t, [0, 30, 61, 91])
    np.testing.assert_allclose(Epochs.of(second, first).t, [61, 91], rtol=0, atol=1e-4)
    # asteroids' dates have no leap seconds
    first, second = (replace(c, frame="ecliptic-j2000") for c in (first, second))
    np.testing.assert_allclose(Epochs.of(second, first).t, [60, 90], rtol=0, atol=1e-4)


def test_fitted_sets_the_kind():
    mag = small_curves.curve(
        5, kind="mag", brightness=np.full(5, 6.0), error=None, range_km=np.full(5, 700.0)
    )
    flux = small_curves.curve(5, range_km=np.full(5, 700.0))
    assert Epochs.of(flux, mag).kind == "mag"
    np.testing.assert_allclose(Epochs.of(flux, mag).dilution, 1 / 7e5**2)
    np.testing.assert_allclose(Epochs.of(mag, flux).dilution, SOLAR_FLUX_VISIBLE / 7e5**2)


def test_levels_make_a_unit_scale_ordinary():
    """An unknown scale is counted from the curve's mean, whatever unit the file is in."""
    light = small_curves.curve(6, free_scale=np.array([True]))
    data = Epochs.of(
        replace(light, brightness=1e5 * light.brightness, error=1e5 * np.asarray(light.error))
    )
    np.testing.assert_allclose(data.level, [1e5 * light.brightness.mean()])
    np.testing.assert_allclose(data.noise_unit, data.level)
    known = Epochs.of(replace(light, free_scale=np.array([False])))
    np.testing.assert_array_equal(known.level, [1.0])


def test_a_band_without_a_tabled_sun_is_taken_for_v():
    light = small_curves.curve(
        4,
        kind="mag",
        brightness=np.full(4, 6.0),
        error=None,
        range_km=np.full(4, 700.0),
        band=np.array(["V", "R", "Clear", ""]),
    )
    v, r = photometry.sun_magnitude("V"), photometry.sun_magnitude("R")
    np.testing.assert_array_equal(Epochs.of(light).zero_point, [v, r, v, v])
