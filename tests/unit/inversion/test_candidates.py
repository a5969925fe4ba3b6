"""Candidate periods: from single passes, from nights joined, and none where there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin.candidates import WORK, candidate_periods
from tests.helpers.low_earth_orbit import steady

HOUR = 3600.0
PASSES = ((0.0, 210.0), (5900.0, 190.0), (88_700.0, 290.0))  # start and length, s


def nights(period_h: float, count: int = 6, n: int = 40) -> LightCurve:
    """Nights of five hours of a body with two unequal maxima, without directions."""
    rng = np.random.default_rng(5)
    t = np.concatenate([np.linspace(0, 5 * HOUR, n) + 86400.0 * k * 1.0 for k in range(count)])
    angle = 2 * np.pi * t / (period_h * HOUR)
    mag = 0.3 * np.cos(2 * angle) + 0.08 * np.cos(angle) + 0.01 * rng.normal(size=t.size)
    unknown = np.full((t.size, 3), np.nan)
    return LightCurve(t, 12 + mag, np.full(t.size, 0.01), unknown, unknown, kind="mag")


def test_single_passes_give_the_period_of_the_brightness():
    curve = steady(3, 50.0, spinning=True)
    result = candidate_periods(curve)
    assert result is not None
    assert result.significant
    assert not result.joined
    assert result.best is not None
    assert result.spin.base is not None
    assert result.best == result.listed[0].period_s == pytest.approx(1 / result.spin.base)
    assert result.listed[0].of_base == 1
    assert 7.0 < result.best < 41.0  # the body turns in 15 to 40 s
    y = result.spin.passes[0]
    folded = np.argsort(y.t % result.best)
    assert np.std(np.diff(y.y[folded])) < 0.5 * np.std(y.y)


def test_faint_points_of_a_deep_light_curve_do_not_hide_its_period():
    """Errors of 0.05 mag at all points, of which those in the minima are fainter by 6 to 9 mag."""
    rng = np.random.default_rng(4)
    t = np.concatenate([start + np.arange(0.0, length) for start, length in PASSES])
    flux = np.maximum(np.cos(2 * np.pi * t / 23.7), 0.0) ** 2 + 10 ** rng.uniform(
        -3.6, -2.4, t.size
    )
    mag = -2.5 * np.log10(flux) + 0.05 * rng.normal(size=t.size)
    unknown = np.full((t.size, 3), np.nan)
    curve = LightCurve(t, mag, np.full(t.size, 0.05), unknown, unknown, kind="mag")
    found = candidate_periods(curve)
    assert found is not None
    assert not found.joined
    assert found.best == pytest.approx(23.7, rel=5e-3)


def test_nights_are_joined_where_one_is_shorter_than_the_period():
    result = candidate_periods(nights(7.3))
    assert result is not None
    assert result.joined
    assert result.significant
    assert result.best == pytest.approx(7.3 * HOUR, rel=0.01)
    assert [one.explained for one in result.listed] == sorted(
        (one.explained for one in result.listed), reverse=True
    )


def test_noise_has_no_best_period():
    result = candidate_periods(steady(1, 50.0, spinning=False))
    assert result is not None
    assert not result.significant
    assert result.best is None


def test_a_few_points_are_not_searched():
    curve = steady(1, 50.0, spinning=True).select(np.arange(20))
    assert candidate_periods(curve) is None


def test_a_curve_without_brightness_is_refused():
    curve = steady(1, 50.0, spinning=True)
    empty = replace(curve, brightness=np.full(curve.n_obs, np.nan))
    with pytest.raises(InputError, match="has no brightness"):
        candidate_periods(empty)


def test_work_is_bounded_and_what_is_left_out_is_said():
    curve = steady(3, 50.0, spinning=True)
    result = candidate_periods(curve, work=WORK / 100)
    assert result is not None
    used = sum(one.t.size for one in result.spin.passes)
    assert used * len(result.spin.grid) <= 1.1 * WORK / 100
    assert any(f"is of {used} of {curve.n_obs} points" in note for note in result.notes)
