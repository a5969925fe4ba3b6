"""Brightness for other epochs."""

from __future__ import annotations

import csv
import re
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from lcbayes.cli.main import main
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.write import write
from lcbayes.results.posterior import dataset
from lcbayes.tasks.predict import brightness
from lcbayes.tasks.predict.brightness import predicted
from lcbayes.tasks.predict.result import Prediction
from lcbayes.tasks.predict.run import Fitted, load_fit
from tests.helpers import results_folders, small_curves
from tests.helpers.false_alarms import EACH, counts, limit

ONE = {"n_facets": 1, "spin": "none"}


def posterior(light: LightCurve, n: int = 300, **options):
    """Draws from the Gaussian at the truth: what chains would give, without running them."""
    problem, data = small_curves.posterior(light, **(ONE | options))
    z0 = small_curves.truth(problem, data, 1)
    fisher = jax.jit(problem.fisher)(z0, data)
    factor = jnp.linalg.inv(jnp.linalg.cholesky(fisher)).T
    z = z0 + jax.random.normal(jax.random.key(0), (n, problem.dim)) @ factor.T
    sites = jax.jit(lambda z, d: jax.lax.map(lambda row: problem.constrain(row, d), z))(z, data)
    kept = {k: np.asarray(v)[None] for k, v in sites.items() if k not in ("flux", "expected")}
    return dataset(kept)


@pytest.fixture(scope="module")
def light() -> LightCurve:
    return small_curves.curve(200, noise=0.05)


@pytest.fixture(scope="module")
def draws(light):
    return posterior(light)


@pytest.mark.statistical(false_alarm=EACH)
def test_intervals_hold_what_was_recorded(light, draws):
    columns, notes = predicted(draws, light, light, "faceted", ONE)
    inside = (columns["flux_q05"] < light.brightness) & (light.brightness < columns["flux_q95"])
    half = (columns["flux_q25"] < light.brightness) & (light.brightness < columns["flux_q75"])
    for hits, level in ((inside, 0.9), (half, 0.5)):
        low, high = counts(200, level, 2)
        assert low <= hits.sum() <= high
    assert notes == []
    assert set(columns) == {f"flux_{k}" for k in ("mean", "q05", "q25", "q75", "q95")}


def test_mean_is_the_models(light):
    """At one draw without spread the mean is what the model expects, also in a part of them."""
    problem, data = small_curves.posterior(light, **ONE)
    z = small_curves.truth(problem, data, 1)
    sites = {
        k: np.asarray(v)[None, None]
        for k, v in problem.constrain(z, data).items()
        if k not in ("flux", "expected")
    }
    columns, _ = predicted(dataset(sites), light, light, "faceted", ONE)
    want = jax.jit(problem.moments)(z, data).mean
    np.testing.assert_allclose(columns["flux_mean"], want, rtol=1e-12)
    some = light.select(np.arange(50, 90))
    columns, _ = predicted(dataset(sites), light, some, "faceted", ONE)
    np.testing.assert_allclose(columns["flux_mean"], want[50:90], rtol=1e-12)


def test_a_turning_body_is_predicted_on_the_fits_clock():
    light = replace(small_curves.curve(40, spinning=True), epoch_jd=2460000.5)
    options = {"n_facets": 1, "spin": "free"}
    draws = posterior(light, 2, spin="free")
    whole, _ = predicted(draws, light, light, "faceted", options)
    later = light.select(np.arange(25, 40))
    moved = replace(later, t=later.t - 8640.0, epoch_jd=2460000.6)
    part, _ = predicted(draws, light, moved, "faceted", options)
    # a Julian date resolves 40 µs
    np.testing.assert_allclose(part["flux_mean"], whole["flux_mean"][25:], rtol=1e-5, atol=1e-6)


def test_zero_points_are_those_of_the_site_or_drawn_anew():
    """A fitted site keeps its zero point; another one scatters by the prior."""
    from tests.helpers import small_faults

    body = small_faults.body(1, 1)
    light = small_faults.light_curve(body, small_faults.Fault(zero_point=0.3), n=40, noise=1e-3)
    options = {"n_facets": 1, "clock_sd": 0.0, "rate_drift_sd": 0.0, "zero_point_spread": 0.0}
    problem, data = small_curves.posterior(light, **options)
    sites = {
        "normals_base": jnp.asarray(body.normals),
        "log_albedo_area": jnp.log(jnp.asarray(body.areas)),
        "omega_unit": jnp.asarray(body.omega / 0.1),
        "log_level": jnp.zeros(0),
    }
    known = problem.constrain(problem.ravel(sites), data)
    kept = {k: np.repeat(np.asarray(v)[None, None], 400, 1) for k, v in known.items()}
    draws = dataset({k: v for k, v in kept.items() if not k.startswith("zero_point")})
    zero_point = np.tile([0.0, 0.3], (1, 400, 1))
    draws["zero_point"] = (("chain", "draw", "calibration"), zero_point)
    options["zero_point_sd"] = 0.05

    bright = light.brightness > 0.2 * light.brightness.max()
    columns, _ = predicted(draws, light, light, "faceted", options)
    np.testing.assert_allclose(columns["flux_mean"][bright], light.brightness[bright], rtol=0.02)
    other = replace(light, site=np.full(light.n_obs, "C"))
    columns, _ = predicted(draws, light, other, "faceted", options)
    width = (columns["flux_q95"] - columns["flux_q05"])[bright] / columns["flux_mean"][bright]
    np.testing.assert_allclose(width, 3.29 * 0.4 * np.log(10) * 0.05, rtol=0.15)
    draws["calibration_sd"] = (("chain", "draw"), np.full((1, 400), 0.1))  # inferred
    columns, _ = predicted(draws, light, other, "faceted", options)
    wider = (columns["flux_q95"] - columns["flux_q05"])[bright] / columns["flux_mean"][bright]
    np.testing.assert_allclose(wider, 2.0 * width, rtol=0.05)


@pytest.mark.statistical(false_alarm=EACH)
def test_a_new_night_has_the_offset_that_its_site_has_in_all_nights():
    """B is 0.3 mag fainter than A in two nights; the widths are 0.01 of nights, 0.1 of sites."""
    from tests.helpers import small_faults

    body = small_faults.body(1, 1)
    light = small_faults.light_curve(body, n=40, noise=1e-3, spacing_s=86400.0)
    n, fainter = 4000, np.where(light.site == "B", 0.3, 0.0)
    nights, sites = np.tile([0.0, 0.0, 0.3, 0.3], (1, n, 1)), np.tile([0.0, 0.3], (1, n, 1))
    draws = xr.Dataset(
        {
            "zero_point": (("chain", "draw", "calibration"), nights),
            "series_zero_point": (("chain", "draw", "series"), sites),
            "calibration_sd": (("chain", "draw"), np.full((1, n), 0.01)),
            "series_sd": (("chain", "draw"), np.full((1, n), 0.1)),
        }
    )
    later = replace(light, t=light.t + 10 * 86400.0)

    def magnitudes(wanted):
        flux = brightness._calibrated(
            np.ones((n, light.n_obs)),
            draws,
            light,
            wanted,
            np.arange(n),
            0.03,
            np.random.default_rng(0),
        )
        return -2.5 * np.log10(flux)

    np.testing.assert_allclose(magnitudes(light), np.tile(fainter, (n, 1)), atol=1e-12)
    known, other = magnitudes(later), magnitudes(replace(later, site=np.full(light.n_obs, "C")))
    error = limit(3) / np.sqrt(n)  # of a mean, in sd; all points share the draws
    assert np.abs(known.mean(0) - fainter).max() < 0.01 * error
    np.testing.assert_allclose(known.std(0), 0.01, rtol=error / np.sqrt(2.0))
    np.testing.assert_allclose(other.std(0), np.hypot(0.01, 0.1), rtol=error / np.sqrt(2.0))


def test_free_scales_are_carried_to_the_curve_of_that_name(light):
    unknown = replace(
        light,
        brightness=50 * light.brightness,
        error=50 * light.error,
        free_scale=np.array([True]),
    )
    draws = posterior(unknown)
    columns, notes = predicted(draws, unknown, unknown, "faceted", ONE)
    inside = (columns["flux_q05"] < unknown.brightness) & (unknown.brightness < columns["flux_q95"])
    assert inside.mean() > 0.83
    assert notes == []


def test_an_unknown_scale_is_relative_and_said_so(light):
    unknown = replace(light, free_scale=np.array([True]), curve_names=("a",))
    other = replace(light, free_scale=np.array([True]), curve_names=("b",), error=None)
    columns, notes = predicted(posterior(unknown), unknown, other, "faceted", ONE)
    np.testing.assert_allclose(columns["flux_mean"].mean(), 1.0, rtol=1e-9)
    assert "no fitted curve is named b" in notes[0]
    # The noise is relative too: 5 % of the mean, whatever unit the fitted curve was in.
    width = np.median(columns["flux_q95"] - columns["flux_q05"])
    np.testing.assert_allclose(width, 3.29 * 0.05, rtol=0.25)


def test_inferred_noise_is_that_of_the_curve():
    """The same at every epoch, in proportion to the mean of the curve: dark ones scatter too."""
    light = small_curves.curve(200)
    quiet = replace(light, error=None)
    draws = posterior(quiet)
    columns, _ = predicted(draws, quiet, quiet, "faceted", ONE)
    inside = (columns["flux_q05"] <= light.brightness) & (light.brightness <= columns["flux_q95"])
    assert 0.83 < inside.mean() < 0.96
    width = columns["flux_q95"] - columns["flux_q05"]
    # 3.29 sd, of which the draws' spread adds a little
    np.testing.assert_allclose(width.min(), 3.29 * 0.03 * light.brightness.mean(), rtol=0.35)


def test_magnitudes():
    light = small_curves.magnitudes(80)
    columns, _ = predicted(posterior(light), light, light, "faceted", ONE)
    inside = (columns["mag_q05"] < light.brightness) & (light.brightness < columns["mag_q95"])
    assert inside.mean() > 0.8


def test_epochs_that_name_no_band_are_in_that_of_the_fit():
    """Without a band a point would be taken for V, 0.38 mag from R in the Sun's light."""
    light = small_curves.magnitudes(80)
    light = replace(light, band=np.full(light.n_obs, "R"))
    draws = posterior(light, 2)
    wanted = replace(light, band=np.full(light.n_obs, ""))
    named, plain = (predicted(draws, light, w, "faceted", ONE)[0] for w in (light, wanted))
    np.testing.assert_array_equal(plain["mag_mean"], named["mag_mean"])


def test_epochs_that_name_none_of_several_bands_are_refused():
    light = small_curves.magnitudes(80)
    light = replace(light, band=np.resize(["R", "V"], light.n_obs))
    wanted = replace(light, band=np.full(light.n_obs, ""))
    with pytest.raises(InputError, match=r"bands R, V.*give a column band"):
        predicted(dataset({}), light, wanted, "faceted", ONE)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"range_km": np.full(200, 700.0)}, "give range_km in both or in neither"),
        ({"frame": "icrs"}, "are in the frame icrs, the fit in inertial"),
        ({"epoch_jd": 2460000.5}, "give utc or jd in both"),
    ],
)
def test_what_does_not_fit_together_is_refused(light, draws, change, says):
    with pytest.raises(InputError, match=says):
        predicted(draws, light, replace(light, **change), "faceted", ONE)


def test_a_fit_of_an_earlier_model_is_refused(light, draws):
    (name, *_) = small_curves.posterior(light, **ONE)[0].names
    two = xr.concat([draws[name], draws[name]], dim="another").transpose("chain", "draw", ...)
    for earlier in (draws.drop_vars(name), draws.drop_vars(name).assign({name: two})):
        with pytest.raises(InputError, match=f"the fit has no {name} of the size .*fit again"):
            predicted(earlier, light, light, "faceted", ONE)


def test_a_folder_without_a_fit(tmp_path):
    with pytest.raises(InputError, match=r"holds no posterior\.nc; give the folder"):
        load_fit(tmp_path)


@pytest.mark.parametrize(
    ("name", "break_it", "says"),
    [
        ("posterior.nc", lambda was: was[: len(was) // 2], "cannot be read"),
        ("run.toml", lambda _: b'curve = "a.csv"\nmodel = "faceted"\n', "of another version"),
        ("run.toml", lambda was: was.replace(b"model", b"mode"), "names no model"),
        ("run.toml", lambda _: b"schema = 4\noptions = 3\n", "options is 3; expected a table"),
        ("run.toml", lambda was: was + b"[reading]\nerror = 'x'\n", "--error is 'x'"),
        (
            "summary.json",
            lambda was: was.replace(b'"model_options": {', b'"model_options": {"a": 1'),
            "'a'",
        ),
        (
            "summary.json",
            lambda was: was.replace(b'"trusted": true', b'"trusted": 1'),
            "is damaged",
        ),
    ],
)
def test_a_damaged_fit_is_named_in_a_line(tmp_path, name, break_it, says):
    folder = results_folders.faceted(tmp_path / "fit")
    (folder / name).write_bytes(break_it((folder / name).read_bytes()))
    with pytest.raises(InputError, match=re.escape(says)) as fault:
        load_fit(folder)
    assert "\n" not in str(fault.value)


def test_a_curve_of_any_name_stays_in_its_column(tmp_path, light, draws, monkeypatch):
    name = 'x,y "q"'
    later = replace(light, curve_names=(name,))
    write(later, tmp_path / "later.csv")
    fit = Fitted(draws, light, "faceted", ONE, [])
    monkeypatch.setattr("lcbayes.tasks.predict.run.load_fit", lambda *_: fit)
    out = tmp_path / "out.csv"
    assert main(["predict", "fit", str(tmp_path / "later.csv"), "-o", str(out)]) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert {row["curve"] for row in rows} == {name}
    want = predicted(draws, light, later, "faceted", ONE)[0]["flux_q95"]
    np.testing.assert_array_equal([float(row["flux_q95"]) for row in rows], want)


def test_a_prediction_is_a_table_a_file_and_a_figure(tmp_path):
    columns = {"jd": [2460000.5, 2460000.6], "mag_mean": [12.0, 12.5]}
    shifts = {"q05": -0.2, "q25": -0.1, "q75": 0.1, "q95": 0.2}
    columns |= {f"mag_{q}": [12.0 + x, 12.5 + x] for q, x in shifts.items()}
    result = Prediction(columns, ["one note"], [])
    assert list(result.summary()["trusted"]) == [True, True]
    assert result.lines() == ["note: one note", "mag predicted at 2 epochs"]
    rows = list(csv.DictReader(result.save(tmp_path / "table.csv").read_text().splitlines()))
    assert [float(row["mag_q95"]) for row in rows] == [12.2, 12.7]
    assert {row["trusted"] for row in rows} == {"true"}
    (figure,) = result.plot_light_curve()
    (axes,) = figure.axes
    assert axes.yaxis_inverted()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("Julian date (UTC)", "magnitude")
    np.testing.assert_array_equal(axes.lines[0].get_ydata(), [12.0, 12.5])
    result.write_page(tmp_path)
    assert "Predicted brightness" in (tmp_path / "report.html").read_text()
