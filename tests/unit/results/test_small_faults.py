"""Small faults in words."""

from __future__ import annotations

from lcbayes.core.reasons import Reason
from lcbayes.results.small_faults import late_passes, measured_faults, rests_on


def test_small_faults_that_the_data_show_are_named():
    parameters = {
        "rate_drift": {"mean": 0.0189, "sd": 0.0017},
        "clock_offset[site B]": {"mean": -2.0, "sd": 0.1},
        "clock_offset[site C]": {"mean": 1.0, "sd": 0.2},
        "zero_point[A, night 2]": {"mean": 0.2, "sd": 0.03},
        "zero_point[A, night 1]": {"mean": 0.1, "sd": 0.03},
        "albedo_area[0]": {"mean": 2.0, "sd": 0.1},
    }
    head, drift, late, early, faint = measured_faults(parameters, [])
    assert head.startswith("small faults")
    assert "grows by 1.89 ± 0.17 % over the light curve; a motion that is not constant" in drift
    # a time that is recorded too late needs a negative offset: see test_nuisances.py
    assert late == "  the times of site B are 2.00 ± 0.10 s too late"
    assert early == "  the times of site C are 1.00 ± 0.20 s too early"
    assert faint == "  A, night 2 is 0.200 ± 0.030 mag fainter than the model"
    assert measured_faults({"rate_drift": {"mean": 0.001, "sd": 0.0017}}, []) == []
    assert measured_faults(parameters, [Reason("data-not-explained", "")]) == []


def test_the_passes_that_may_be_late_instead_are_said_with_their_period():
    instead = [
        {"number": 2, "late_s": 1.386, "period_s": 47.24211},
        {"number": 3, "late_s": -4.158, "period_s": 47.25308},
    ]
    assert late_passes(instead) == (
        "pass 2 too late by 1.4 s (the period is then about 47.242 s) or pass 3 too early by 4.2 s "
        "(the period is then about 47.253 s)"
    )


def test_no_night_of_a_site_that_is_off_in_all_nights_is_named():
    night = {"mean": 0.12, "sd": 0.02}
    parameters = {
        "zero_point[B, night 1]": night,
        "zero_point[B, night 2]": night,
        "zero_point[C, night 1]": night,
        "series_zero_point[B]": {"mean": 0.1, "sd": 0.02},
    }
    named = [line.split(" is ")[0].strip() for line in measured_faults(parameters, [])[1:]]
    assert sorted(named) == ["B", "C, night 1"]


def test_a_result_rests_on_quantities_that_are_printed():
    moved = {"clock_0.1_s": {"attitude[2,1]": 3.0, "log_brightness": 2.0, "size": 0.5, "nu": 0.1}}
    assert rests_on(moved)[1:] == ["  a clock error of 0.1 s would move size by 0.5 sd"]
    assert rests_on({"clock_0.1_s": {"attitude[2,1]": 3.0}}) == []
