"""The report of a fit: the contents of a results folder on one self-contained page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.analysis import (
    asteroid_plots,
    diagnostics_plots,
    explore,
    light_curve_plots,
    quantities,
    shape_files,
    shape_plots,
    sky_plots,
    style,
    tables,
)
from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.numerals import duration, percent, show
from lcbayes.analysis.pages import environment
from lcbayes.geometry.times import date
from lcbayes.results import rivals
from lcbayes.results.asteroid import tilt_warning
from lcbayes.results.reasons import agreement, searched, stored
from lcbayes.results.small_faults import measured_faults

MOST_MODES = 3  # solutions drawn in full; the others are listed


def write_page(folder: Path, results: Results) -> None:
    """Write ``report.html``, ``figures/`` and the files of the shape into a folder."""
    figures = folder / "figures"
    figures.mkdir()
    with style.drawing():
        page, shapes = _compose(results, style.Gallery(figures))
    (folder / "report.html").write_text(page, encoding="utf-8")
    _write_shapes(folder, results, shapes)


def _write_shapes(folder: Path, results: Results, shapes: list[shape_plots.Shape]) -> None:
    """Write the heaviest solution as ``shape.*``, and the others as ``shape-2.*`` and so on."""
    for shape in shapes:
        if shape.body is not None:
            tail = "" if shape is shapes[0] else f"-{shape.mode.index + 1}"
            comment = f"{shape.mode.name}, made by lcbayes\n{shape.caption}"
            model = shape_files.model_of_fit(results, shape.mode)
            shape_files.write_body(folder, shape.body, tail, comment, model)


def _compose(results: Results, gallery: style.Gallery) -> tuple[str, list[shape_plots.Shape]]:
    drawn = results.modes[:MOST_MODES]
    lists = {m.index: list(quantities.quantities(results, m)) for m in drawn}
    selected = {m.index: quantities.important(lists[m.index]) for m in drawn}
    panels, panel_note = light_curve_plots.draw_panels(results, gallery)
    shapes = [s for m in drawn if (s := shape_plots.build(results, m, gallery)) is not None]
    overview = (
        light_curve_plots.draw_folded,
        light_curve_plots.draw_residuals,
        light_curve_plots.draw_residual_periodogram,
    )
    curves = tables.curve_table(results)
    values: dict[str, Any] = {
        "title": Path(str(results.attrs.get("source_file") or "")).name or "a light curve",
        "attrs": results.attrs,
        "summary": results.summary,
        "verdict": _verdict(results),
        "several": len(results.modes) > 1,
        "modes": results.modes,
        "drawn": drawn,
        "key": tables.key_table(results, drawn),
        "facet_tables": [(m, t) for m in drawn if (t := tables.facet_table(results, m))],
        "observed": _observed(results),
        "assumptions": _assumptions(results),
        "coverage": _coverage(results),
        "explored": explore.payload(results, drawn, shapes),
        "panels": panels,
        "legend": _legend(results),
        "panel_note": panel_note,
        "overview": [i for f in overview if (i := f(results, gallery)) is not None],
        "phased": [i for m in drawn for i in asteroid_plots.draw_phased(results, m, gallery)[-1:]],
        "warnings": [
            f"{m.name}: {words}." for m in drawn if (words := tilt_warning(m.summary.get("body")))
        ],
        "curves": curves if len(curves) > 1 else [],
        "outliers": tables.outlier_table(results),
        "spins": tables.spin_table(results),
        "measured_faults": measured_faults(
            drawn[0].summary.get("parameters", {}), stored(results.summary)
        )[1:],
        "rests_on": tables.rests_on_table(results),
        "residual_tests": tables.residual_table(results),
        "residual_unit": "mag" if results.is_magnitude else "in the unit of the flux",
        "facets": [i for m in drawn for i in sky_plots.draw_facets(results, m, gallery)],
        "sky": sky_plots.draw_sky(results, gallery),
        "axis": quantities.constant_axis(results.modes[0].draws),
        "frame": sky_plots.frame_words(results),
        "shapes": shapes,
        "tables": [(m, tables.parameter_table(lists[m.index], m)) for m in drawn],
        "loo_pit": diagnostics_plots.draw_loo_pit(results, gallery),
        "diagnostics": [(m, _diagnostics(m, selected[m.index], gallery)) for m in drawn],
        "run_toml": results.run_toml,
        "timing": _timing(results),
    }
    pages = environment()
    pages.globals["show"] = show
    pages.filters["weight"] = tables.weight
    return pages.get_template("report.html.j2").render(values), shapes


def _diagnostics(
    mode: Mode, selected: list[quantities.Quantity], gallery: style.Gallery
) -> list[style.Image]:
    """Traces, energies and pairs of the draws of one solution, where they can be drawn."""
    images = (
        diagnostics_plots.draw_traces(mode, selected, gallery),
        diagnostics_plots.draw_energy(mode, gallery),
        diagnostics_plots.draw_pairs(mode, selected, gallery),
    )
    return [image for image in images if image is not None]


def _verdict(results: Results) -> dict[str, Any]:
    """The verdict on the result in words, which precedes all numbers."""
    summary, count = results.summary, len(results.modes)
    reasons = [reason.text for reason in stored(summary)]
    if not summary["trusted"]:
        return {
            "good": False,
            "head": "Do not trust these numbers.",
            "reasons": reasons or ["The run gave no reason; see the diagnostics below."],
        }
    head = agreement([mode.weight for mode in results.modes], summary.get("fit") or {})
    notes = []
    if count > 1:
        shares = ", ".join(f"{m.name} {tables.weight(m)}" for m in results.modes)
        notes.insert(
            0,
            f"They are shown side by side and never averaged. Their posterior weights: {shares}.",
        )
    worst, least = summary.get("max_rhat"), summary.get("min_ess_bulk")
    if worst is not None and least is not None:
        notes.append(
            f"Largest R-hat {worst:.3f} (1.01 or less is good), smallest effective sample size "
            f"{least:.0f} (400 or more is good), "
            f"{_count(summary.get('divergences', 0), 'divergence')}."
        )
    notes += [f"{line[0].upper()}{line[1:]}." for line in rivals.lines(summary.get("rival"))]
    return {"good": True, "head": head, "reasons": notes}


def _count(number: int, noun: str) -> str:
    return f"{number or 'no'} {noun}{'s' * (number != 1)}"


def _observed(results: Results) -> list[tuple[str, str]]:
    """The input data, as pairs of label and text."""
    angle = results.phase_angle_deg
    count = np.unique(results.curve).size
    kind = "apparent magnitudes" if results.is_magnitude else "fluxes"
    facts = [("Points", f"{results.t.size} {kind} in {count} curve{'s' * (count > 1)}")]
    epoch = results.attrs.get("epoch_jd")
    span = duration(results.span_s)
    if epoch:
        first, last = (float(epoch) + x / 86400 for x in (results.t.min(), results.t.max()))
        clock = results.span_s < 20 * 86400
        begins, ends = date(first, clock), date(last, clock)
        if begins[:10] == ends[:10]:
            ends = ends[11:]
        span = f"{begins} to {ends} UTC ({span})" if clock else f"{begins} to {ends} ({span})"
    facts.append(("Time", span))
    facts.append(("Phase angle", f"{angle.min():.1f}° to {angle.max():.1f}°"))
    if "range_km" in results.constant:
        reach = results.constant["range_km"].to_numpy()
        facts.append(("Range", f"{reach.min():.0f} to {reach.max():.0f} km"))
    known = np.isfinite(results.error)
    unit = " mag" if results.is_magnitude else " W/m²" if "range_km" in results.constant else ""
    if known.all():
        facts.append(
            (
                "Errors",
                "given with the data, median "
                f"{tables.three(float(np.median(results.error)))}{unit}",
            )
        )
    else:
        facts.append(("Errors", "not given with the data" if not known.any() else "partly given"))
    for name, words in (("site", "Sites"), ("band", "Bands")):
        labels = [s for s in np.unique(results.labels.get(name, np.array([], str))) if s]
        listed = ", ".join(labels[:8]) + (f" and {len(labels) - 8} more" if len(labels) > 8 else "")
        facts += [(words, listed)] if labels else []
    facts.append(("Directions in", sky_plots.frame_words(results)))
    return facts


def _assumptions(results: Results) -> list[str]:
    text = results.attrs.get("assumptions") or "[]"
    try:
        stated = json.loads(text) if isinstance(text, str) else list(text)
    except json.JSONDecodeError:
        stated = [text]
    lines = [str(s) for s in (stated if isinstance(stated, list) else [stated])]
    return lines + searched(results.summary.get("search"))


def _coverage(results: Results) -> str:
    """A sentence on the agreement of the prediction with the data."""
    parts = []
    q = light_curve_plots.bands(results.modes[0])
    if q is not None:
        inside = np.mean((results.brightness >= q[0]) & (results.brightness <= q[4]))
        parts.append(f"{percent(float(inside))} of the points lie inside the 90 % band.")
    fit = results.summary.get("fit") or {}
    chi2, dof = fit.get("chi2"), fit.get("dof")
    if chi2 is not None and dof:
        ratio = chi2 / dof
        parts.append(f"χ² is {show(chi2, chi2 / 30)} for {dof:g} degrees of freedom")
        parts[-1] += (
            ": the scatter is larger than the errors explain."
            if ratio > 1.5
            else ": the errors look too large."
            if ratio < 0.5
            else "."
        )
    if fit.get("rms") is not None:
        unit = " mag" if results.is_magnitude else " of a curve's mean flux"
        parts.append(f"The rms of the residuals is {tables.three(fit['rms'])}{unit}.")
    information = fit.get("information_per_point", 1.0)
    if information < 1.0:
        n = results.summary["n_obs"]
        parts.append(
            f"The residuals are correlated: the {n} points are equivalent to {information * n:.0f} "
            "independent ones, and the uncertainties and weights take this into account."
        )
    return " ".join(parts)


def _legend(results: Results) -> dict[str, Any]:
    """Colours of the light-curve panels; the bands are those of the heaviest solution."""
    shown = [m for m in results.modes if light_curve_plots.bands(m) is not None]
    sigma = light_curve_plots.sigmas(results, results.modes[0])
    return {
        "bands": style.colour(shown[0].index) if shown else None,
        "others": [(m.name, style.colour(m.index)) for m in shown[1:]],
        "scaled": bool(np.isfinite(sigma).all()),
    }


def _timing(results: Results) -> str:
    timing = results.summary.get("timing") or {}
    words = {
        "search_s": "search",
        "compile_s": "compilation of the chains",
        "warmup_s": "warm-up",
        "sampling_s": "sampling",
    }
    parts = [f"{w} {duration(timing[k])}" for k, w in words.items() if timing.get(k) is not None]
    if timing.get("gradients"):
        parts.append(f"{timing['gradients']:,} gradients".replace(",", " "))
    return ", ".join(parts)
