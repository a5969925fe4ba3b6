"""The summary of a scan and its reliability, in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from scipy import stats

from lcbayes.core.constants import HOUR_S
from lcbayes.core.reasons import Finding
from lcbayes.core.text import probability
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import equivalence, sparse
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution, written_period
from lcbayes.inversion.attitude_scan.solutions import ALIAS, HALF, MIRROR, PERIOD, SAME, TWICE

POOR = 2.0  # χ² per degree of freedom, errors known, above which no hypothesis explains the data;
# below its inverse, unless by chance, the fit is closer than the errors allow
LOOSE = 0.2  # rms residual, errors unknown, above which no hypothesis explains the data
NAMED = 5  # number of equivalent solutions listed by name


def summarise(scan: AttitudeScan, curve: LightCurve) -> tuple[dict[str, Any], list[Finding]]:
    """Contents of ``summary.json`` other than the verdict, and reasons against the result."""
    best = scan.solutions[0]
    limit = equivalence.limit(scan)
    near = _near_equal(scan, limit)
    solutions = [row(s, scan, e) for s, e in zip(scan.solutions, near, strict=True)]
    smooth = best.coefficients is not None
    content = {
        "model": "attitude-scan",
        "n_facets": len(best.areas),
        "n_obs": curve.n_obs,
        "seed": 0,
        "frame": curve.frame,
        "n_hypotheses": scan.n_hypotheses,
        "n_periods": scan.n_periods,
        "n_laws": scan.n_laws,
        "laws_left_out": scan.left_out,
        "period_probability": scan.period_probability,
        "nights": scan.nights,
        "reflectance": scan.settings.reflectance,
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
            "dof": scan.dof,
            "chi2_near_equal": limit,
            "sd_from_fit": not scan.error_known,
        },
        "timing": scan.timing,
    }
    return content, list(_findings(scan, solutions, curve))


def _near_equal(scan: AttitudeScan, limit: float) -> list[bool]:
    """Whether each solution fits as well as the best; with probabilities, whether it belongs to the
    smallest number of solutions with a probability of 0.99 together."""
    if scan.period_probability is None:
        return [s.chi2 <= limit for s in scan.solutions]
    share = np.array([s.probability or 0.0 for s in scan.solutions])
    order = np.argsort(-share, kind="stable")
    before = np.empty(len(share))
    before[order] = np.cumsum(share[order]) - share[order]
    return list(map(bool, before < sparse.UNIQUE))


def row(s: Solution, scan: AttitudeScan, near_equal: bool) -> dict[str, Any]:
    """A solution as a row of ``summary.json``."""
    spin = s.spin()
    if spin:
        spin["period_resolution_h"] = scan.resolution_h(spin["period_h"])
    return {
        "law": s.law,
        **spin,
        "chi2": s.chi2,
        "rms": s.rms,
        "near_equal": near_equal,
        "relation": s.relation,
        "words": s.words,
        "hits": s.hits,
        **({} if s.coefficients is None else {"coefficients": s.coefficients.tolist()}),
        **({} if s.probability is None else {"probability": s.probability}),
    }


def _findings(
    scan: AttitudeScan, solutions: list[dict[str, Any]], curve: LightCurve
) -> Iterator[Finding]:
    best = scan.solutions[0]
    if scan.error_known and best.chi2 > POOR * scan.dof:
        misfit = f"chi2 is {best.chi2 / scan.dof:.1f} per degree of freedom"
        values = {"misfit": misfit, "to": " to its errors"}
        yield Finding("no-hypothesis-explains-data", values)
    if not scan.error_known and best.rms > LOOSE:
        misfit = f"residuals are {100 * best.rms:.0f} % of the mean flux"
        yield Finding("no-hypothesis-explains-data", {"misfit": misfit, "to": ""})
    used = scan.n_obs - scan.dof
    if used > scan.dof:
        values = {"fitted": used, "points": scan.n_obs, "others": "attitudes"}
        yield Finding("too-many-parameters", values)
    elif scan.error_known and _too_close(best.chi2, scan):
        yield Finding("fit-too-close", {"ratio": best.chi2 / scan.dof})
    if scan.period_probability is not None:
        yield from improbable(scan, solutions, curve)
        return
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
    settings = scan.settings
    if best.frequency is not None and (end := _end_of_range(best.frequency, scan)):
        yield Finding("period-at-end-of-range", {"where": end})
    if best.frequency is not None and best.hits < 2 and settings.n_poles > 1:
        yield Finding("best-hypothesis-once")


def improbable(
    scan: AttitudeScan, solutions: list[dict[str, Any]], curve: LightCurve
) -> Iterator[Finding]:
    """Findings about a period or pole whose probability is below 0.99, and a curve against it."""
    assert scan.period_probability is not None
    best = scan.solutions[0]
    assert best.frequency is not None
    span = float(np.ptp(scan.t))
    poles, of_pole = [], best.probability or 0.0
    other: dict[str, float] = {}
    for s, row in zip(scan.solutions[1:], solutions[1:], strict=True):
        assert s.frequency is not None
        if not sparse.same_period(s.frequency, best.frequency, span):
            name = written_period(row["period_h"], row["period_resolution_h"])
            other[name] = other.get(name, 0.0) + (s.probability or 0.0)
        elif row["relation"] in (SAME, MIRROR):
            of_pole += s.probability or 0.0
        else:
            poles.append(f"({row['pole_lon_deg']:.0f}, {row['pole_lat_deg']:+.0f}) degrees")
    yield from contradicted(scan, curve)
    if scan.period_probability < sparse.UNIQUE:
        some = sorted(other, key=lambda name: -other[name])[:NAMED]
        also = ", ".join(f"{name} ({probability(other[name])})" for name in some)
        words = f"its probability is {probability(scan.period_probability)}"
        values = {"others": f"{words}; others are {also}" if some else words}
        yield Finding("period-not-unique", values)
    elif of_pole < sparse.UNIQUE * scan.period_probability and poles:
        yield Finding("pole-not-unique", {"others": _fit_as_well(poles)})
    else:
        yield Finding("pole-not-calibrated")
    if end := _end_of_range(best.frequency, scan):
        yield Finding("period-at-end-of-range", {"where": end})


def contradicted(scan: AttitudeScan, curve: LightCurve) -> Iterator[Finding]:
    """A finding about the curve that contradicts the others, if there is one."""
    of = scan.contradiction
    if of is None:
        return
    period_h = 1.0 / (HOUR_S * of.frequency)
    period = written_period(period_h, scan.resolution_h(period_h))
    of_period = f"without it the period is {period} (probability {probability(of.probability)})"
    moved = ", and moved in time it agrees with them far better" if of.moved else ""
    names = [curve.dated_titles[k] for k in of.curves]
    values = {"curve": " or ".join(names), "others": of_period + moved}
    yield Finding("curve-contradicts", values)


def _too_close(chi2: float, scan: AttitudeScan) -> bool:
    """Whether χ² is far below its degrees of freedom, beyond chance for the least of many."""
    chance = float(stats.chi2.cdf(chi2, scan.dof)) * scan.n_hypotheses
    return chi2 < scan.dof / POOR and chance < equivalence.MISSED


def _fit_as_well(names: Iterable[str]) -> str:
    """The distinct names, with only the first few listed."""
    names = list(dict.fromkeys(names))
    more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
    selected = ", ".join(names[:NAMED])
    return f"{selected}{more} {'fit' if len(names) > 1 else 'fits'} as well"


def _end_of_range(frequency: float, scan: AttitudeScan) -> str:
    """The end of the period range, if the best period lies within one grid step of it."""
    settings = scan.settings
    if settings.period_range_h is None:
        return ""
    span = float(np.ptp(scan.t))
    step = 0.5 * settings.period_step / span
    low, high = (1.0 / (HOUR_S * p) for p in reversed(settings.period_range_h))
    inside, end = min((frequency - low, low), (high - frequency, high))
    if inside >= step:
        return ""
    resolution = scan.resolution_h(1.0 / (HOUR_S * frequency))
    at = f"the end of the range, {written_period(1.0 / (HOUR_S * end), resolution)}"
    if inside < 0:
        return f"beyond {at}"
    apart = written_period(0.5 * settings.period_step * resolution, resolution)
    return f"within a step of the search, {apart}, of {at}"
