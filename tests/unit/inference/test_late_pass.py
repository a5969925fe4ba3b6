"""Late times of a pass that look like a drift of the rate, against the phases themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.late_pass import instead_of_drift
from lcbayes.results import summary

PERIOD = 47.3


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
    found = instead_of_drift(curve(starts), drift, abs(drift) / 100.0, rate)
    assert [one.number for one in found] == [1, 2, 3]  # any one explains three phases
    assert found[which].late_s == pytest.approx(late, rel=1e-3)
    assert found[which].period_s == pytest.approx(PERIOD, rel=1e-8)


def test_no_late_pass_looks_like_a_drift_seen_in_five_passes():
    light = curve((0.0, 5900.0, 11800.0, 17600.0, 23500.0))
    assert instead_of_drift(light, 7e-4, 7e-6, 2.0 * np.pi / PERIOD) == []
    # unless the drift is hardly measured
    assert len(instead_of_drift(light, 7e-4, 1.4e-3, 2.0 * np.pi / PERIOD)) == 5


@pytest.mark.parametrize(("changed", "expected"), [({}, 3), ({"inertia_ratio[0]": 0.5}, 0)])
def test_a_summary_lists_passes_unless_the_body_tumbles(changed, expected):
    means = {"rate_drift": 7e-4, "omega_x_rad_s": 0.1, "omega_y_rad_s": 0.0, "omega_z_rad_s": 0.1}
    table: Any = {name: {"mean": x, "sd": 7e-6} for name, x in (means | changed).items()}
    found = summary._late_pass(curve((0.0, 5900.0, 17600.0)), table)
    assert len(found.get("late_pass_instead", [])) == expected
    uncertain: Any = table | {"rate_drift": {"mean": 7e-4, "sd": 7e-4}}  # no drift is measured
    assert summary._late_pass(curve((0.0, 5900.0, 17600.0)), uncertain) == {}


def test_nothing_is_said_of_several_sites_or_two_passes():
    """Their clocks are parameters; two phases fit any rate."""
    given = (7e-4, 7e-6, 2.0 * np.pi / PERIOD)
    assert instead_of_drift(curve((0.0, 5900.0, 17600.0), sites=("A", "B")), *given) == []
    assert instead_of_drift(curve((0.0, 5900.0)), *given) == []
