"""Model light curves of an asteroid against its rotation."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from lcbayes.analysis import asteroid_plots, style
from lcbayes.core.constants import DAY_S

PERIOD_DAY, EPOCH_JD = 0.25, 2450000.0
T = np.concatenate([np.linspace(0.0, 0.2, 9), 3.0 + np.linspace(0.0, 0.2, 5)]) * DAY_S
CURVE = np.repeat([0, 1], [9, 5])


@pytest.fixture(params=[False, True], ids=["flux", "magnitudes"])
def seen(request, monkeypatch) -> tuple[Any, Any]:
    """Results of 14 points in two curves, and a solution with two expected light curves."""
    spin = SimpleNamespace(phase_deg=lambda jd: (jd - EPOCH_JD) / PERIOD_DAY % 1.0 * 360.0)
    monkeypatch.setattr(asteroid_plots, "model_of_fit", lambda *_: SimpleNamespace(spin=spin))
    phase = 2.0 * np.pi * T / DAY_S / PERIOD_DAY
    expected = np.stack([2.0 + np.sin(phase), 4.0 + np.sin(phase)])
    curves = xr.Dataset({"expected": (("curve_draw", "time"), expected)}, {"time": np.arange(14)})
    results = SimpleNamespace(
        attrs={"epoch_jd": EPOCH_JD},
        t=T,
        curve=CURVE,
        constant={"time": np.arange(14)},
        brightness=3.1 + np.sin(phase),
        is_magnitude=request.param,
    )
    return results, SimpleNamespace(curves=curves, index=0, name="Solution 1")


def test_columns(seen):
    columns = asteroid_plots.model_curves(*seen)
    assert columns is not None
    assert tuple(columns) == asteroid_plots.LIGHT_CURVE
    turns = T / DAY_S / PERIOD_DAY
    np.testing.assert_allclose(columns["rotation"], turns % 1.0, atol=1e-6)
    np.testing.assert_allclose(columns["model"], 3.0 + np.sin(2 * np.pi * turns))
    np.testing.assert_allclose(columns["model_sd"], np.sqrt(2.0))  # of 2 and 4, about their mean


def test_figures_have_a_panel_for_each_curve(seen, tmp_path):
    results, mode = seen
    with style.drawing():
        images = asteroid_plots.draw_phased(results, mode, style.Gallery(tmp_path))
        one, two = (
            asteroid_plots._panels(
                results,
                asteroid_plots.model_curves(results, mode) or {},
                np.array([0, 1]),
                (1, across),
                88.0,
                style.Gallery(tmp_path / str(across)),
            )
            for across in (2, 4)
        )
    assert len(images) == 2
    assert [axes.get_visible() for axes in two.axes] == [True, True, False, False]
    assert all(axes.yaxis_inverted() == results.is_magnitude for axes in one.axes)
    dots = one.axes[1].lines[0]
    assert np.all(np.diff(dots.get_xdata()) > 0)
    unit = 3.0 + np.mean(np.sin(2 * np.pi * T[9:] / DAY_S / PERIOD_DAY))
    values = np.sort(results.brightness[9:])
    values = values - unit if results.is_magnitude else values / unit
    np.testing.assert_allclose(np.sort(dots.get_ydata()), values)


def test_what_is_unknown_is_not_drawn(seen, tmp_path):
    results, mode = seen
    mode.curves = None
    assert asteroid_plots.model_curves(results, mode) is None
    assert asteroid_plots.draw_phased(results, mode, style.Gallery(tmp_path)) == []


def test_the_fullest_curves_stay_in_order():
    curve = np.repeat([0, 1, 2, 3], [2, 5, 3, 5])
    np.testing.assert_array_equal(asteroid_plots._fullest(curve, 2), [1, 3])
    np.testing.assert_array_equal(asteroid_plots._fullest(curve, 3), [1, 2, 3])
