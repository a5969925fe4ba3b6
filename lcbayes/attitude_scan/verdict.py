"""The summary of a scan, and whether to trust it, in words."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from lcbayes.attitude_scan.engine import WORSE
from lcbayes.attitude_scan.found import Found, Solution, written_period
from lcbayes.attitude_scan.solutions import ALIAS, HALF, MIRROR, PERIOD, TWICE
from lcbayes.lightcurve import LightCurve

POOR = 2.0  # χ² per degree of freedom, errors known, from which no hypothesis explains the data
LOOSE = 0.2  # rms residual, errors unknown, from which none does
EDGE = 1.0  # steps of the grid from the end of a range of periods


def summarise(found: Found, curve: LightCurve) -> dict[str, Any]:
    """The content of ``summary.json``."""
    best = found.solutions[0]
    solutions = [_row(s, found) for s in found.solutions]
    reasons = list(_doubts(found, solutions))
    smooth = best.coefficients is not None
    return {
        "model": "attitude-scan",
        "n_facets": len(best.areas),
        "n_obs": curve.n_obs,
        "seed": 0,
        "converged": not reasons,
        "reasons": reasons,
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
            "sd_from_fit": not found.error_known,
        },
        "timing": found.timing,
    }


def _row(s: Solution, found: Found) -> dict[str, Any]:
    spin = s.spin()
    if spin:
        spin["period_resolution_h"] = found.resolution_h(spin["period_h"])
    return {
        "law": s.law,
        **spin,
        "chi2": s.chi2,
        "rms": s.rms,
        "near_equal": near_equal(s, found.solutions[0]),
        "relation": s.relation,
        "words": s.words,
        "hits": s.hits,
        **({} if s.coefficients is None else {"coefficients": s.coefficients.tolist()}),
    }


def near_equal(s: Solution, best: Solution) -> bool:
    """Whether a solution fits as well as the best, to 5 % of residuals in units of the errors."""
    return s.chi2 <= WORSE**2 * best.chi2


def _doubts(found: Found, solutions: list[dict[str, Any]]) -> Iterator[str]:
    best = found.solutions[0]
    if found.error_known and best.chi2 > POOR * found.dof:
        yield (
            f"chi2 is {best.chi2 / found.dof:.1f} per degree of freedom: none of the hypotheses "
            "explains the light curve to its errors"
        )
    if not found.error_known and best.rms > LOOSE:
        yield (
            f"residuals are {100 * best.rms:.0f} % of the mean flux: none of the hypotheses "
            "explains the light curve"
        )
    near = [s for s in solutions[1:] if s["near_equal"]]
    other = [s for s in near if s["relation"] in (ALIAS, HALF, TWICE, PERIOD)]
    if other:
        words = (written_period(s["period_h"], s["period_resolution_h"]) for s in other)
        yield f"the period is not unique: {', '.join(words)} fit as well"
    poles = [s for s in near if s["relation"] not in (ALIAS, HALF, TWICE, PERIOD, MIRROR, "law")]
    if poles:
        where = ", ".join(f"({s['pole_lon_deg']:.0f}, {s['pole_lat_deg']:+.0f})" for s in poles)
        yield f"the pole is not unique beyond its mirror: {where} degrees fit as well"
    laws = [s["law"] for s in near if s["relation"] == "law"]
    if laws:
        yield f"the attitude is not unique: {', '.join(laws)} fit as well"
    settings = found.settings
    if best.frequency is not None and settings.period_range_h is not None:
        low, high = (1.0 / (3600.0 * p) for p in reversed(settings.period_range_h))
        span = float(np.ptp(found.t))
        if min(best.frequency - low, high - best.frequency) * 2.0 * span < EDGE:
            yield "the best period lies at the end of the range that was tried: widen it"
    if best.frequency is not None and best.hits < 2 and settings.n_poles > 1:
        yield (
            "fewer than two starts came to the best solution: there may be a better one; "
            "raise --n-poles"
        )
