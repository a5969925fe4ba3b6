"""The self-contained page of `lcbayes scan`, with its figures and the body."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lcbayes.analysis import scan_plots, shape_files, style
from lcbayes.analysis.numerals import duration
from lcbayes.analysis.pages import command, environment
from lcbayes.analysis.sky_plots import FRAMES
from lcbayes.core.errors import InputError
from lcbayes.core.options import Options
from lcbayes.core.text import probability
from lcbayes.inversion.attitude_scan import nights
from lcbayes.inversion.attitude_scan.result import AttitudeScan, written_period
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.physics.bodies.polyhedron import Polyhedron


def write_page(
    folder: Path,
    scan: AttitudeScan,
    summary: Mapping[str, Any],
    run: Mapping[str, Any],
    options: type[Options],
) -> None:
    """Write ``report.html``, ``figures/`` and, for smooth bodies, ``shape.*`` into a folder.

    Parameters
    ----------
    summary : content of ``summary.json``
    run : content of ``run.toml``
    options : options of the task
    """
    figures = folder / "figures"
    figures.mkdir()
    body = body_of(scan)
    with style.drawing():
        gallery = style.Gallery(figures)
        drawn = [
            scan_plots.draw_sky(scan, gallery),
            scan_plots.draw_periods(scan, gallery),
            scan_plots.draw_nights(scan, gallery),
            scan_plots.draw_laws(scan, gallery),
            scan_plots.draw_fit(scan, gallery),
            None if body is None else scan_plots.draw_shape(body, gallery),
        ]
    page = (
        environment()
        .get_template("scan.html.j2")
        .render(
            title=Path(run.get("curve", "")).name or "a light curve",
            summary=summary,
            headline=headline(summary),
            images=[image for image in drawn if image is not None],
            rows=_rows(summary),
            ahead=nights.words(scan.nights) if scan.nights else [],
            spins=any("period_h" in s for s in summary["solutions"]),
            frame=FRAMES.get(scan.frame, scan.frame),
            took=duration(sum(scan.timing.values())),
            command=command(run, options),
            version=run["version"],
        )
    )
    (folder / "report.html").write_text(page, encoding="utf-8")
    if body is not None:
        comment = "convex body of the best solution, lcbayes scan"
        shape_files.write_body(folder, body, "", comment, shape_files.model_of_scan(scan))


def headline(summary: Mapping[str, Any]) -> str:
    """The result in one sentence."""
    best = summary["solutions"][0]
    near = sum(s["near_equal"] for s in summary["solutions"]) - 1
    also = "" if not near else f"; {near} other{'s fit' if near > 1 else ' fits'} as well"
    if (chance := summary["period_probability"]) is not None:
        also = f" (probability of this period, whatever the pole: {probability(chance)})"
    if "period_h" not in best:
        return f"Best attitude: {best['law']}{also}."
    period = written_period(best["period_h"], best["period_resolution_h"])
    return (
        f"Best spin: pole ({best['pole_lon_deg']:.1f}°, {best['pole_lat_deg']:+.1f}°), "
        f"period {period}{also}."
    )


def body_of(scan: AttitudeScan) -> Polyhedron | None:
    """The convex body of the best solution, if its facets close."""
    best = scan.solutions[0]
    if best.coefficients is None:
        return None  # facets of unknown albedos do not close
    try:
        return minkowski(best.normals, close(best.normals, best.areas))
    except InputError:
        return None


def _rows(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The table of solutions."""
    rows = []
    for i, s in enumerate(summary["solutions"], start=1):
        known = "period_h" in s
        rows.append(
            {
                "near": s["near_equal"],
                "cells": [
                    str(i),
                    s["law"],
                    f"{s['pole_lon_deg']:.1f}" if known else "",
                    f"{s['pole_lat_deg']:+.1f}" if known else "",
                    written_period(s["period_h"], s["period_resolution_h"]) if known else "",
                    f"{s['chi2']:.5g}",
                    f"{s['rms']:.4f}",
                    (f"{s['probability']:.3f}" if "probability" in s else str(s["hits"]))
                    if known
                    else "",
                ],
                "words": s["words"],
            }
        )
    return rows
