"""Late times of a pass that look like a drift of the rate, against the phases themselves."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.late_pass import instead_of_drift
from lcbayes.results import summary
from lcbayes.results.reasons import reasons

PERIOD = 47.3
DRAWS = {  # of one rate of rotation, about axes that are uncertain
    "rate_drift": np.array([[6.93e-4, 7.07e-4]]),
    "omega": np.array([[[0.1, 0.02, 0.0096**0.5], [0.1, -0.02, 0.0096**0.5]]]),
}


def curve(starts, sites=("",)) -> LightCurve:
    t = np.concatenate([start + np.linspace(0.0, 300.0, 31) for start in starts])
    toward = np.tile([0.0, 0.6, 0.8], (t.size, 1))
    site = np.array(sites)[np.arange(t.size) % len(sites)]
    return LightCurve(
        t=t, brightness=np.ones(t.size), error=None, sun=toward, obs=toward, site=site
    )


def drift_through(starts, late):
    """ε and ω of a drifting rate with the phases of a constant one whose times are late.

    The phase ω (t − late) is followed by a quadratic in t through the three passes.
    """
    middle, span = np.array(starts) + 150.0, starts[-1] + 300.0
    phase = 2.0 * np.pi / PERIOD * (middle - np.array(late))
    a, b, _ = np.polyfit(middle - 0.5 * span, phase, 2)
    return 2.0 * a * span / b, b  # φ = b [τ + ε τ²/2T], τ the time since the middle


@pytest.mark.parametrize(("which", "late"), [(0, 3.0), (1, -2.0), (2, 4.0)])
def test_the_pass_that_is_late_is_among_those_found(which, late):
    starts = (0.0, 5900.0, 17600.0)
    drift, rate = drift_through(starts, late * (np.arange(3) == which))
    found = instead_of_drift(curve(starts), drift, abs(drift) / 100.0, rate, 0.3)
    assert [one.number for one in found] == [1, 2, 3]  # any one explains three phases
    assert found[which].late_s == pytest.approx(late, rel=1e-3)
    assert found[which].period_s == pytest.approx(PERIOD, rel=1e-8)


def test_no_late_pass_looks_like_a_drift_seen_in_five_passes():
    light = curve((0.0, 5900.0, 11800.0, 17600.0, 23500.0))
    assert instead_of_drift(light, 7e-4, 7e-6, 2.0 * np.pi / PERIOD, 0.3) == []
    # unless the drift is hardly measured
    assert len(instead_of_drift(light, 7e-4, 1.4e-3, 2.0 * np.pi / PERIOD, 0.3)) == 5


@pytest.mark.parametrize(("changed", "expected"), [({}, 3), ({"inertia": np.ones((1, 2, 3))}, 0)])
def test_a_summary_lists_passes_unless_the_body_tumbles(changed, expected):
    draws = DRAWS | changed
    found = summary._late_pass(curve((0.0, 5900.0, 17600.0)), draws, {})
    assert len(found.get("late_pass_instead", [])) == expected
    uncertain = draws | {"rate_drift": np.array([[0.0, 1.4e-3]])}  # no drift is measured
    assert summary._late_pass(curve((0.0, 5900.0, 17600.0)), uncertain, {}) == {}


def test_no_pass_is_late_by_far_more_than_the_clock_allows():
    starts = (0.0, 5900.0, 17600.0)
    drift, rate = drift_through(starts, (0.0, 0.0, 4.0))
    # of equal curvature: 4 s · 5900/11700 = 2.02 s of pass 1, 4 s · 5900/17600 = 1.34 s of pass 2
    for most, expected in ((4.1, [1, 2, 3]), (3.9, [1, 2]), (2.0, [2]), (1.3, [])):
        found = instead_of_drift(curve(starts), drift, abs(drift) / 100.0, rate, most / 100.0)
        assert [one.number for one in found] == expected


@pytest.mark.parametrize(
    ("explained", "clock_sd", "expected"), [(1, 0.3, 1), (0, 0.3, 0), (1, 0.001, 0)]
)
def test_a_period_that_a_late_pass_would_change_is_not_trusted(explained, clock_sd, expected):
    """A fit that is refused for its residuals needs no second reason."""
    options = {"clock_sd": repr(clock_sd)}
    late = summary._late_pass(curve((0.0, 5900.0, 17600.0)), DRAWS, options)
    misfit: Any = SimpleNamespace(explained=bool(explained))
    found = reasons(summary._drift_or_late(late, DRAWS, misfit))
    assert [one.code for one in found] == ["drift-or-late-pass"] * expected
    if found:
        assert "it is 44.42883 s if the rate drifts" in found[0].text  # 2π/√0.02, of each draw
        assert "with pass 1 too early by 2 s (the period is then" in found[0].text


def test_nothing_is_said_of_several_sites_or_two_passes():
    """Their clocks are parameters; two phases fit any rate."""
    given = (7e-4, 7e-6, 2.0 * np.pi / PERIOD, 0.3)
    assert instead_of_drift(curve((0.0, 5900.0, 17600.0), sites=("A", "B")), *given) == []
    assert instead_of_drift(curve((0.0, 5900.0)), *given) == []
