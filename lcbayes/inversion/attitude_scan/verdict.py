"""The summary of a scan and its reliability, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from scipy import stats

from lcbayes.core.constants import HOUR_S
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import equivalence
from lcbayes.inversion.attitude_scan.result import Found, Solution, written_period
from lcbayes.inversion.attitude_scan.solutions import ALIAS, HALF, MIRROR, PERIOD, TWICE

POOR = 2.0  # χ² per degree of freedom, errors known, above which no hypothesis explains the data;
# below its inverse, unless by chance, the fit is closer than the errors allow
LOOSE = 0.2  # rms residual, errors unknown, above which no hypothesis explains the data
NAMED = 5  # number of equivalent solutions listed by name


def summarise(found: Found, curve: LightCurve) -> tuple[dict[str, Any], list[Finding]]:
    """Contents of ``summary.json`` other than the verdict, and reasons against the result."""
    best = found.solutions[0]
    limit = equivalence.limit(found)
    solutions = [_row(s, found, limit) for s in found.solutions]
    smooth = best.coefficients is not None
    content = {
        "model": "attitude-scan",
        "n_facets": len(best.areas),
        "n_obs": curve.n_obs,
        "seed": 0,
        "frame": curve.frame,
        "n_hypotheses": found.n_hypotheses,
        "n_periods": found.n_periods,
        "n_laws": found.n_laws,
        "laws_left_out": found.left_out,
        "reflectance": found.settings.reflectance,
        "body": "harmonics" if smooth else "facets",
        "solutions": solutions,
        "parameters": {
            name: {"mean": value, "sd": None, "q05": None, "q50": None, "q95": None}
            for name, value in best.spin().items()
        },
        "modes": [s for s in solutions if s["near_equal"]],
        "fit": {
            "rms": best.rms,
            "chi2": best.chi2,
            "dof": found.dof,
            "chi2_near_equal": limit,
            "sd_from_fit": not found.error_known,
        },
        "timing": found.timing,
    }
    return content, list(_findings(found, solutions))


def _row(s: Solution, found: Found, limit: float) -> dict[str, Any]:
    spin = s.spin()
    if spin:
        spin["period_resolution_h"] = found.resolution_h(spin["period_h"])
    return {
        "law": s.law,
        **spin,
        "chi2": s.chi2,
        "rms": s.rms,
        "near_equal": s.chi2 <= limit,
        "relation": s.relation,
        "words": s.words,
        "hits": s.hits,
        **({} if s.coefficients is None else {"coefficients": s.coefficients.tolist()}),
    }


def _findings(found: Found, solutions: list[dict[str, Any]]) -> Iterator[Finding]:
    best = found.solutions[0]
    if found.error_known and best.chi2 > POOR * found.dof:
        misfit = f"chi2 is {best.chi2 / found.dof:.1f} per degree of freedom"
        values = {"misfit": misfit, "to": " to its errors"}
        yield Finding("no-hypothesis-explains-data", values)
    if not found.error_known and best.rms > LOOSE:
        misfit = f"residuals are {100 * best.rms:.0f} % of the mean flux"
        yield Finding("no-hypothesis-explains-data", {"misfit": misfit, "to": ""})
    used = found.n_obs - found.dof
    if used > found.dof:
        values = {"fitted": used, "points": found.n_obs, "others": "attitudes"}
        yield Finding("too-many-parameters", values)
    elif found.error_known and _too_close(best.chi2, found):
        yield Finding("fit-too-close", {"ratio": best.chi2 / found.dof})
    near = [s for s in solutions[1:] if s["near_equal"]]
    other = [s for s in near if s["relation"] in (ALIAS, HALF, TWICE, PERIOD)]
    if other:
        words = (written_period(s["period_h"], s["period_resolution_h"]) for s in other)
        yield Finding("period-not-unique", {"others": _fit_as_well(words)})
    poles = [s for s in near if s["relation"] not in (ALIAS, HALF, TWICE, PERIOD, MIRROR, "law")]
    if poles:
        where = (f"({s['pole_lon_deg']:.0f}, {s['pole_lat_deg']:+.0f}) degrees" for s in poles)
        yield Finding("pole-not-unique", {"others": _fit_as_well(where)})
    laws = [s["law"] for s in near if s["relation"] == "law"]
    if laws:
        yield Finding("attitude-not-unique", {"others": _fit_as_well(laws)})
    settings = found.settings
    if best.frequency is not None and (end := _end_of_range(best.frequency, found)):
        yield Finding("period-at-end-of-range", {"where": end})
    if best.frequency is not None and best.hits < 2 and settings.n_poles > 1:
        yield Finding("best-hypothesis-once")


def _too_close(chi2: float, found: Found) -> bool:
    """Whether χ² is far below its degrees of freedom, beyond chance for the least of many."""
    chance = float(stats.chi2.cdf(chi2, found.dof)) * found.n_hypotheses
    return chi2 < found.dof / POOR and chance < equivalence.MISSED


def _fit_as_well(names: Iterable[str]) -> str:
    """The distinct names, with only the first few listed."""
    names = list(dict.fromkeys(names))
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    few = ", ".join(names[:NAMED])
    return f"{few}{more} {'fit' if len(names) > 1 else 'fits'} as well"


def _end_of_range(frequency: float, found: Found) -> str:
    """The end of the period range, if the best period lies within one grid step of it."""
    settings = found.settings
    if settings.period_range_h is None:
        return ""
    span = float(np.ptp(found.t))
    step = 0.5 * settings.period_step / span
    low, high = (1.0 / (HOUR_S * p) for p in reversed(settings.period_range_h))
    inside, end = min((frequency - low, low), (high - frequency, high))
    if inside >= step:
        return ""
    resolution = found.resolution_h(1.0 / (HOUR_S * frequency))
    at = f"the end of the range, {written_period(1.0 / (HOUR_S * end), resolution)}"
    if inside < 0:
        return f"beyond {at}"
    apart = written_period(0.5 * settings.period_step * resolution, resolution)
    return f"within a step of the search, {apart}, of {at}"
