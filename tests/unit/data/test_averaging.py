"""Averages of consecutive points: the rule, the errors and the geometry."""

import json

import numpy as np
import pytest

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.data.averaging import averaged, noise_of
from lcbayes.data.lightcurve import LightCurve

STEP = 0.1
NOISE = 0.2


def curve(flux, error=None, kind="flux", **more):
    """Points 0.1 s apart, seen along the y axis with the Sun in the xy plane."""
    t = STEP * np.arange(flux.size)
    angle = np.linspace(0.0, 0.5, flux.size)
    sun = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    obs = np.tile([0.0, 1.0, 0.0], (flux.size, 1))
    return LightCurve(t=t, brightness=flux, error=error, sun=sun, obs=obs, kind=kind, **more)


def noisy(signal, seed=0):
    return signal + NOISE * np.random.default_rng(seed).standard_normal(signal.size)


def group_size(result):
    return round(float(np.median(np.diff(result.t))) / STEP)


@pytest.mark.parametrize(("period", "expected"), [(30.0, 35), (10.0, 14), (3.0, 5)])
def test_number_of_points_follows_the_fastest_change(period, expected):
    """Of a sine of amplitude 1, an average of n is wrong by (2 pi n h/P)^2 / (24 sqrt 2) rms."""
    t = STEP * np.arange(6000)
    chosen = averaged(curve(noisy(3.0 + np.sin(2.0 * np.pi * t / period))), "auto")
    n = group_size(chosen)
    rate = 2.0 * np.pi / period

    def allowed(n):
        wrong = (rate * n * STEP) ** 2 / 24.0 / np.sqrt(2.0)
        return wrong <= 0.5 * NOISE / np.sqrt(n)

    largest = max(k for k in range(1, 101) if allowed(k))
    assert largest == pytest.approx(expected, abs=1)
    assert min(0.4 * largest, 10) <= n <= 1.2 * largest


def test_averages_are_wrong_by_less_than_half_their_error():
    t = STEP * np.arange(6000)
    signal = 3.0 + np.exp(8.0 * (np.cos(2.0 * np.pi * t / 20.0) - 1.0))
    result = averaged(curve(noisy(signal)), "auto")
    assert result.error is not None
    n = group_size(result)
    m = 6000 // n
    middle = signal[: m * n].reshape(m, n)
    at = np.interp(middle.shape[1] / 2.0 - 0.5, np.arange(n), np.arange(n))
    exact = np.array([np.interp(at, np.arange(n), row) for row in middle])
    bias = np.sqrt(np.mean((middle.mean(axis=1) - exact) ** 2))
    assert n > 2
    assert bias < 0.7 * result.error[0]


def test_errors_without_errors_in_the_file_are_those_of_the_scatter():
    result = averaged(curve(noisy(np.full(4000, 3.0))), "0.8")
    assert result.error is not None
    assert result.n_obs == 500
    assert result.error == pytest.approx(NOISE / np.sqrt(8.0), rel=0.05)
    assert np.std(result.brightness) == pytest.approx(result.error[0], rel=0.15)


def test_given_errors_are_propagated():
    error = np.where(np.arange(12) < 6, 0.1, 0.3)
    result = averaged(curve(np.arange(12.0) + 1.0, error), "0.4")
    one = np.sqrt(np.array([4 * 0.01, 2 * 0.01 + 2 * 0.09, 4 * 0.09])) / 4.0
    assert result.error == pytest.approx(one)
    assert result.brightness == pytest.approx([2.5, 6.5, 10.5])
    assert result.t == pytest.approx([0.15, 0.55, 0.95])


def test_magnitudes_are_averaged_as_fluxes():
    magnitude = np.tile([10.0, 11.0], 6)
    result = averaged(
        curve(magnitude, np.full(12, 0.01), "mag", range_km=np.full(12, 500.0)), "0.2"
    )
    flux = 0.5 * (1.0 + 10.0**-0.4)
    assert result.brightness == pytest.approx(10.0 - 2.5 * np.log10(flux))
    relative = np.sqrt(0.5 * (1.0 + 10.0**-0.8)) * 0.01 / np.sqrt(2.0) / flux
    assert result.error == pytest.approx(relative)
    assert result.range_km == pytest.approx(500.0)


def test_noise_of_magnitudes_is_relative_to_the_flux():
    rng = np.random.default_rng(1)
    level = 2.0 + np.sin(0.05 * np.arange(5000))
    flux = level * (1.0 + 0.1 * rng.standard_normal(5000))
    result = noise_of(flux, [np.arange(5000)], relative=True)
    assert result == pytest.approx(0.1 * 2.5 / np.log(10.0), rel=0.05)


def test_gaps_curves_and_bands_are_not_bridged():
    t = np.array([0.0, 0.1, 0.2, 0.3, 5.0, 5.1, 5.2, 5.3, 5.4, 5.5])
    which = np.array([0, 0, 0, 0, 0, 0, 0, 1, 1, 1])
    one = curve(np.arange(10.0), np.full(10, 0.1))
    light = LightCurve(
        t=t, brightness=one.brightness, error=one.error, sun=one.sun, obs=one.obs, curve=which
    )
    result = averaged(light, "0.3")
    assert result.brightness == pytest.approx([1.0, 3.0, 5.0, 8.0])
    assert result.curve.tolist() == [0, 0, 0, 1]


def test_directions_stay_of_unit_length():
    result = averaged(curve(noisy(np.full(1000, 3.0))), "10")
    assert np.linalg.norm(result.sun, axis=1) == pytest.approx(1.0, abs=1e-12)
    assert np.linalg.norm(result.obs, axis=1) == pytest.approx(1.0, abs=1e-12)


def test_fast_changes_are_left_alone_and_reported():
    light = curve(noisy(100.0 * np.sin(np.pi / 6.0 * np.arange(300))))
    result = averaged(light, "auto")
    assert result.n_obs == 300
    assert "points were not averaged" in result.source["notes"]


def test_note_states_the_rule():
    result = averaged(curve(noisy(np.full(1000, 3.0))), "auto")
    assert result.source["notes"].startswith("1000 points were averaged in groups of ")
    assert "at most 0.5 of its random error" in result.source["notes"]


def test_a_window_that_blurs_is_said_to():
    """A sine of 3 s may be averaged over 0.5 s, as the rule for a sine says; not over 1.5 s."""
    light = curve(noisy(3.0 + np.sin(2.0 * np.pi * STEP * np.arange(6000) / 3.0)))
    for window, blurs in (("0.3", False), ("1.5", True)):
        notes = averaged(light, window).source["notes"]
        assert ("more than half of their random error" in notes) == blurs


@pytest.mark.parametrize("given", ["slow", "-1", "nan", "0.1"])
def test_impossible_windows_are_refused(given):
    with pytest.raises(InputError, match="--average is"):
        averaged(curve(np.ones(20)), given)


def test_read_averages_and_records_it(tmp_path):
    lcbayes.write(curve(np.arange(12.0) + 1.0, np.full(12, 0.1)), tmp_path / "fast.csv")
    result = lcbayes.read(tmp_path / "fast.csv", average="0.4")
    assert result.n_obs == 3
    assert json.loads(result.source["reading"])["average"] == "0.4"
    assert "12 points were averaged in groups of 4" in result.source["notes"]
