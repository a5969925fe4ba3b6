"""The tables of a report, as formatted text."""

from __future__ import annotations

from typing import Any

import numpy as np

from lcbayes.analysis import quantities
from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.light_curve_plots import bands, segments
from lcbayes.analysis.numerals import duration, percent, show
from lcbayes.data.segments import PASS
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.geometry.times import date
from lcbayes.results.asteroid import QUANTITIES
from lcbayes.results.reasons import name_of_test, p_words
from lcbayes.results.small_faults import FAULTS

LONG = 24  # rows from which a group is collapsed


def weight(mode: Mode) -> str:
    if 0 < mode.weight < 0.005:
        return "< 1 %"
    if 0.995 < mode.weight < 1:
        return "> 99 %"
    text = percent(mode.weight)
    certain = mode.weight_sd is None or mode.weight_sd < 0.005
    return text if certain else f"{text} ± {percent(mode.weight_sd or 0.0)}"


def three(value: float) -> str:
    """A number with three significant digits."""
    return show(value, abs(value) / 10)


def key_table(results: Results, drawn: list[Mode]) -> dict[str, Any]:
    """Rows of the short table, with two cells per solution: mean and 90 % interval."""
    by_mode = [{q.words: q for q in quantities.key_results(results, m)} for m in drawn]
    names = list(dict.fromkeys(name for one in by_mode for name in one))
    rows = []
    for name in names:
        cells, unit = [], ""
        for one in by_mode:
            q = one.get(name)
            if q is None:
                cells.append(("–", ""))
                continue
            unit = q.unit
            low, high = (show(q.quantile(p), q.sd) for p in (0.05, 0.95))
            cells.append((show(q.mean, q.sd), f"{low} to {high}"))
        rows.append({"name": name, "unit": unit, "cells": cells})
    rows += _body_rows(drawn)
    return {"heads": [(m.name, weight(m)) for m in drawn], "rows": rows}


def _body_rows(drawn: list[Mode]) -> list[dict[str, Any]]:
    """Rows on the body of an asteroid, one for each quantity."""
    known = [(m.summary.get("body") or {}).get("quantities") or {} for m in drawn]
    rows = []
    for name, words in QUANTITIES.items():
        if any(name in one for one in known):
            cells = [_cell(one[name]) if name in one else ("–", "") for one in known]
            rows.append({"name": words, "unit": "", "cells": cells})
    return rows


def _cell(row: dict[str, float]) -> tuple[str, str]:
    mean, low, high = (show(row[k], row["sd"]) for k in ("mean", "q05", "q95"))
    return mean, f"{low} to {high}"


def facet_table(results: Results, mode: Mode) -> dict[str, Any] | None:
    """A row for each facet: albedo-area with its interval, and direction of the normal."""
    facets = quantities.facets(results, mode)
    if not facets:
        return None
    rows = []
    for i, f in enumerate(facets):
        low, high = (show(f.area.quantile(p), f.area.sd) for p in (0.05, 0.95))
        angles = [show(x, f.radius) for x in (f.azimuth, f.polar)]
        area = (show(f.area.mean, f.area.sd), f"{low} to {high}")
        rows.append(
            {"number": i, "area": area, "angles": angles, "radius": show(f.radius, f.radius)}
        )
    return {"unit": facets[0].area.unit, "rows": rows, "long": len(rows) > LONG}


def parameter_table(listed: list[quantities.Quantity], mode: Mode) -> list[dict[str, Any]]:
    """Groups of rows by variable; a long group is collapsed on the page."""
    groups: dict[str, list[list[str]]] = {}
    worst: dict[str, tuple[float, float]] = {}
    meaning: dict[str, tuple[str, str]] = {}
    for row in quantities.table(listed, mode):
        q = row.quantity
        base = "omega" if q.name.startswith("omega_") else q.name.split("[")[0]
        meaning[base] = (q.words, q.unit)
        cells = [q.name, *(show(x, row.sd) for x in (row.mean, row.sd, *row.quantiles))]
        cells += ["–" if not np.isfinite(row.rhat) else f"{row.rhat:.3f}"]
        cells += ["–" if not np.isfinite(x) else f"{x:.0f}" for x in (row.ess_bulk, row.ess_tail)]
        groups.setdefault(base, []).append(cells)
        high, low = worst.get(base, (0.0, np.inf))
        worst[base] = (np.nanmax([high, row.rhat]), np.nanmin([low, row.ess_bulk]))
    out = []
    for base, rows in groups.items():
        words, unit = meaning[base]
        high, low = worst[base]
        out.append(
            {
                "words": words,
                "unit": unit,
                "rows": rows,
                "long": len(rows) > LONG,
                "worst": f"largest R-hat {high:.3f}, smallest bulk ESS {low:.0f}",
            }
        )
    return out


def curve_table(results: Results) -> list[list[str]]:
    """Each stretch of data with the scatter of its residuals and its fraction in the 90 % band."""
    q = bands(results.modes[0])
    angle = results.phase_angle_deg
    epoch = results.attrs.get("epoch_jd")
    rows = []
    for part in segments(results):
        at = part.points
        start, y = float(results.t[at[0]]), results.brightness[at]
        rms = inside = "–"
        if q is not None:
            rms = three(float(np.sqrt(np.mean((y - q[2, at]) ** 2))))
            inside = percent(float(np.mean((y >= q[0, at]) & (y <= q[4, at]))))
        begins = date(float(epoch) + start / 86400, clock=True) if epoch else f"{start:.6g} s"
        lasts = duration(float(np.ptp(results.t[at])))
        where = f"{np.mean(angle[at]):.1f}"
        rows.append([str(part.curve + 1), begins, lasts, str(at.size), where, rms, inside])
    return rows


def outlier_table(results: Results) -> list[list[str]]:
    """A row for each stretch of points that are more likely than not outliers: curve, start,
    number of points, mean residual, lowest probability."""
    rows: list[list[dict[str, Any]]] = []
    for one in results.summary.get("outliers") or []:
        last = rows[-1][-1] if rows else None
        if last and one["curve"] == last["curve"] and 0 <= one["t"] - last["t"] <= PASS.seconds:
            rows[-1].append(one)
        else:
            rows.append([one])
    return [
        [
            str(part[0]["curve"]),
            str(part[0].get("utc") or f"{part[0]['t']:.6g} s"),
            str(len(part)),
            three(float(np.mean([one["residual"] for one in part]))),
            f"{min(one['probability'] for one in part):.3f}",
        ]
        for part in rows
    ]


def rests_on_table(results: Results) -> dict[str, Any] | None:
    """Shifts of each quantity under each small fault, in standard deviations."""
    moved = results.summary.get("rests_on") or {}
    faults = [fault for fault in moved if fault in FAULTS]
    if not faults:
        return None
    names = [name for name in moved[faults[0]] if len(moved[faults[0]]) <= LONG or "[" not in name]
    # a sum with 0.0 leaves no sign before a zero
    rows = [[n, *(f"{round(moved[f][n], 2) + 0.0:.2f}" for f in faults)] for n in names]
    return {"heads": [FAULTS[fault] for fault in faults], "rows": rows}


def spin_table(results: Results) -> dict[str, Any] | None:
    """The spins that explain the data, if some were not sampled."""
    spins = results.summary.get("spins") or []
    if all(s["sampled"] for s in spins):
        return None
    lon, lat = lon_lat_deg(np.array([s["omega_rad_s"] for s in spins]))
    angles = [f"axis, {name} (deg)" for name in quantities.axis_names(results.frame)]
    rows = [
        [
            percent(s["share"]),
            f"{s['period_s']:.6g}",
            f"{a:.1f}",
            f"{b:.1f}",
            "yes" if s["sampled"] else "no",
        ]
        for s, a, b in zip(spins, lon, lat, strict=True)
    ]
    return {"heads": ["share", "period (s)", *angles, "sampled"], "rows": rows}


def residual_table(results: Results) -> dict[str, Any] | None:
    """Tests of the residuals, the smallest p-values first."""
    fit = results.summary.get("fit") or {}
    if not fit.get("tests"):
        return None
    rows = [
        [
            name_of_test(t["name"]),
            show(t["statistic"], min(0.1 * abs(t["statistic"]), 10.0)),
            p_words(t["p_value"], t.get("upper_limit", False)).removeprefix("= "),
        ]
        for t in sorted(fit["tests"], key=lambda t: t["p_value"])
    ]
    return {
        "rows": rows,
        "limit": f"{fit['p_limit']:.2g}",
        "false_alarm": percent(fit["false_alarm"]),
        "affect_verdict": fit.get("chi2") is not None,
    }
