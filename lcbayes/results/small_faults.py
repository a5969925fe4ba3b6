"""Lines on small faults: those that the data show, and how far others would move the result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import SimpleNamespace
from typing import Any

from lcbayes.core.reasons import Reason
from lcbayes.core.text import join_words
from lcbayes.results.reasons import cause

FAULTS = {
    "shadows": "the shadows of parts on one another",
    "clock_0.1_s": "a clock error of 0.1 s",
    "late_pass_0.1_s": "a clock error of 0.1 s in one pass",
    "late_curve_1_min": "late times of one curve, by 1 min,",
    "zero_point_0.03_mag": "0.03 mag between sites or nights",
    "rate_drift_1_percent": "a rate drift of 1 %",
    "nutation_0.3_deg": "nutation of 0.3 deg",
    "errors_1.4_times": "errors 1.4 times as large",
    "site_100_m": "100 m of site position",
    "elements_1_day": "elements one day older",
}
LEAST_SHIFT = 0.05  # sd; smaller shifts are not mentioned
MEASURED_SD = 4.0  # distance from zero at which a fault is measured
LIKE_A_DRIFT = "; a motion that is not constant may look the same"
MEASURED = {  # the alternative that a parameter stands for, and its unit as a factor
    "rate_drift": ("rate-drift", 100.0),
    "clock_offset": ("clock", 1.0),
    "series_zero_point": ("zero-point", 1.0),
    "zero_point": ("zero-point", 1.0),
}


def measured_faults(parameters: Mapping[str, Any], against: Iterable[Reason]) -> list[str]:
    """Lines on small faults that the data show, if the model with them explains the data.

    Of a site that is off in all nights, no single night is listed.
    """
    if any(reason.code == "data-not-explained" for reason in against):
        return []
    shown: dict[tuple[str, str], str] = {}
    for name, found in parameters.items():
        base, _, about = name.removesuffix("]").partition("[")
        mean, sd = found.get("mean"), found.get("sd")
        if base not in MEASURED or mean is None or sd is None or abs(mean) < MEASURED_SD * sd:
            continue
        code, unit = MEASURED[base]
        remark = LIKE_A_DRIFT if base == "rate_drift" else ""
        values = {"about": about, "version": "", "amount": unit * mean, "sd": unit * sd}
        shown[base, about] = f"  {cause(SimpleNamespace(name=code, **values))}{remark}"
    for base, about in list(shown):
        if base == "zero_point" and ("series_zero_point", about.rpartition(", ")[0]) in shown:
            del shown[base, about]
    head = "small faults that the data show, and that the fit allows for:"
    return [head, *shown.values()] if shown else []


def late_passes(instead: Iterable[Mapping[str, Any]]) -> str:
    """Late passes that give the same phases as a drift, as in the summary, in words."""
    passes = [
        f"pass {one['number']} too {'late' if one['late_s'] > 0 else 'early'} by "
        f"{abs(one['late_s']):.2g} s (the period is then about {one['period_s']:#.5g} s)"
        for one in instead
    ]
    return join_words(passes, "or")


def rests_on(moved: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Lines on how far the printed quantity that moves most would move under each fault."""
    parts: list[str] = []
    for fault, every in moved.items():
        shifts = {k: x for k, x in every.items() if not k.startswith(("attitude[", "log_"))}
        name = max(shifts, key=lambda k: shifts[k], default=None)
        if name is None or fault not in FAULTS or shifts[name] < LEAST_SHIFT:
            continue
        verb = "would widen" if fault.startswith("errors") else "would move"
        parts.append(f"  {FAULTS[fault]} {verb} {name} by {shifts[name]:.2g} sd")
    return ["what the result rests on:", *parts] if parts else []
