"""What `lcbayes scan` draws: figures, the body, and one page that needs nothing else."""

from __future__ import annotations

import re
import shlex
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lcbayes.analysis import scan_plots, style
from lcbayes.analysis.numerals import duration
from lcbayes.analysis.pages import environment
from lcbayes.analysis.sky_plots import FRAMES
from lcbayes.core.errors import InputError
from lcbayes.inversion.attitude_scan.result import Found, written_period
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.physics.bodies.polyhedron import Polyhedron
from lcbayes.results.folder import put_in_place

PAGE, BODY = "report.html", "shape.obj"
FLAGS = {
    "period_h": "--period",
    "period_range_h": "--period-range",
    "period_step": "--period-step",
    "reflectance": "--reflectance",
    "n_poles": "--n-poles",
    "n_facets": "--n-facets",
    "degree": "--degree",
    "keep": "--keep",
    "n_sky": "--n-sky",
}


def write(folder: Path, found: Found, summary: Mapping[str, Any], run: Mapping[str, Any]) -> Path:
    """Write `report.html`, `figures/` and, of smooth bodies, `shape.obj` into a results folder.

    All are made aside and put in place when complete.

    Returns
    -------
    Path
        The page.
    """
    scratch = Path(tempfile.mkdtemp(prefix=".report-", dir=folder))
    try:
        scratch.chmod(0o755)
        figures = scratch / "figures"
        figures.mkdir()
        body = _body(found)
        with style.drawing():
            gallery = style.Gallery(figures)
            drawn = [
                scan_plots.draw_sky(found, gallery),
                scan_plots.draw_periods(found, gallery),
                scan_plots.draw_laws(found, gallery),
                scan_plots.draw_fit(found, gallery),
                None if body is None else scan_plots.draw_shape(body, gallery),
            ]
        page = (
            environment()
            .get_template("scan.html.j2")
            .render(
                title=Path(run["curve"]).name or "a light curve",
                summary=summary,
                headline=headline(summary),
                images=[image for image in drawn if image is not None],
                rows=_rows(summary),
                spins=any("period_h" in s for s in summary["solutions"]),
                frame=FRAMES.get(found.frame, found.frame),
                took=duration(sum(found.timing.values())),
                command=_command(run),
                version=run["version"],
            )
        )
        (scratch / PAGE).write_text(page, encoding="utf-8")
        (folder / BODY).unlink(missing_ok=True)
        if body is not None:
            (scratch / BODY).write_text(
                body.obj("convex body of the best solution, lcbayes scan"), encoding="utf-8"
            )
        put_in_place(scratch, folder)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return folder / PAGE


def headline(summary: Mapping[str, Any]) -> str:
    """The result in one sentence."""
    best = summary["solutions"][0]
    near = sum(s["near_equal"] for s in summary["solutions"]) - 1
    also = "" if not near else f"; {near} other{'s fit' if near > 1 else ' fits'} as well"
    if "period_h" not in best:
        return f"Best attitude: {best['law']}{also}."
    period = written_period(best["period_h"], best["period_resolution_h"])
    return (
        f"Best spin: pole ({best['pole_lon_deg']:.1f}°, {best['pole_lat_deg']:+.1f}°), "
        f"period {period}{also}."
    )


def _body(found: Found) -> Polyhedron | None:
    best = found.solutions[0]
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
                    str(s["hits"]) if known else "",
                ],
                "words": s["words"],
            }
        )
    return rows


def _command(run: Mapping[str, Any]) -> str:
    """What to type for the same numbers."""
    words = ["lcbayes", "scan", run["curve"]]
    options = run["options"]
    for name, flag in FLAGS.items():
        if name in options:
            words += [flag, options[name]]
    # commas are between laws, and between the settings NAME=NUMBER of one
    for law in filter(None, re.split(r",(?!\w+=)", str(options.get("laws", "")))):
        words += ["--law", law]
    if options.get("common_noise"):
        words.append("--common-noise")
    for name, value in run["reading"].items():
        words += ["--" + name.replace("_", "-"), value]
    return shlex.join(map(str, [*words, "-o", "DIR"]))
