"""The page of a batch: one figure, and a table of all objects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator, NullFormatter

from lcbayes.analysis import style
from lcbayes.analysis.pages import environment
from lcbayes.analysis.tables import three
from lcbayes.results.catalogue import FAILED, NOT_TRUSTED, TRUSTED

RATE, AREA = "rotation rate", "total albedo-area"
COLOURS = {TRUSTED: style.colour(0), NOT_TRUSTED: style.colour(1), FAILED: style.FAINT}
ALT = "Goodness of fit and size or residuals of every object."
CAPTION = (
    "Left: goodness of fit of every object, by its row in the catalogue. Right: {what} against "
    "{against}. Dots: trusted; crosses: not trusted; marks at the foot: failed."
)
SHOWN = {
    "n_obs": "points",
    "n_facets": "facets",
    "n_solutions": "solutions",
    "weight": "weight of first",
    "rms": "rms",
    "max_rhat": "max R-hat",
    "albedo_area_m2": "albedo-area (m²)",
    "pole_lon_deg": "pole lon (°)",
    "pole_lat_deg": "pole lat (°)",
    "period_h": "period (h)",
    "omega_x_rad_s": "ω x (rad/s)",
    "omega_y_rad_s": "ω y (rad/s)",
    "omega_z_rad_s": "ω z (rad/s)",
    "seconds": "time (s)",
}


def write_page(folder: Path, summary: Mapping[str, Any], run: Mapping[str, Any]) -> None:
    """Write ``report.html`` and ``figures/batch.svg``, ``.pdf`` of a batch into a folder.

    Parameters
    ----------
    summary : content of ``summary.json``
    run : content of ``run.toml``
    """
    rows = summary["objects"]
    _, _, what, against = _bodies_of(rows)
    caption = CAPTION.format(what=what, against=against)
    image = style.picture(folder, "batch", lambda gallery: draw(rows, gallery), ALT, caption)
    columns = [k for k in SHOWN if any(row.get(k) is not None for row in rows)]
    page = (
        environment()
        .get_template("batch.html.j2")
        .render(
            title=Path(run["catalogue"]).name,
            summary=summary,
            image=image,
            heads=[SHOWN[k] for k in columns],
            rows=[_cells(row, columns) for row in rows],
            version=run["version"],
        )
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _cells(row: Mapping[str, Any], columns: Sequence[str]) -> dict[str, Any]:
    """A row of the table, with a link to the object's own page if there is one."""
    fit = "–"
    if row.get("chi2") is not None:
        fit = f"{three(row['chi2'] / max(row['dof'], 1))}"
    return {
        "name": row["name"],
        "page": row.get("page"),
        "status": row["status"],
        "fit": fit,
        "cells": ["–" if row.get(k) is None else _number(k, row[k]) for k in columns],
        "reasons": [reason["text"] for reason in row["reasons"]],
    }


def _number(name: str, value: float) -> str:
    if name == "seconds":
        return f"{value:.1f}"
    return str(value) if isinstance(value, int) else three(value)


def draw(rows: Sequence[Mapping[str, Any]], gallery: style.Gallery) -> Any:
    """The figure of the rows of ``objects``."""
    figure = gallery.figure(10.0, 3.6)
    left, right = figure.subplots(1, 2)
    _fits(left, rows)
    _bodies(right, rows)
    return figure


def _fits(axes: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    known = all(row.get("chi2") is not None for row in rows if row["status"] != FAILED)
    value = [
        row.get("rms") if not known or row.get("chi2") is None else row["chi2"] / max(row["dof"], 1)
        for row in rows
    ]
    place = np.arange(1, len(rows) + 1)
    _marked(axes, place, np.array([np.nan if v is None else v for v in value], float), rows)
    if known:
        axes.axhline(1.0, color=style.FAINT, lw=0.7, zorder=0)
    for i, row in enumerate(rows, 1):
        if row["status"] == FAILED:
            axes.axvline(i, ymax=0.04, color=style.INK, lw=1.2)
    _logarithmic(axes)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("object, place in the catalogue")
    axes.set_ylabel("χ² per degree of freedom" if known else "rms residual")


def _bodies(axes: Any, rows: Sequence[Mapping[str, Any]]) -> None:
    x, y, what, against = _bodies_of(rows)
    _marked(axes, x, y, rows)
    if against == RATE:
        axes.set_xscale("log")
        axes.set_xlabel(f"{RATE} (rotations per hour)")
    else:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.set_xlabel(f"object, {against}")
    _logarithmic(axes)
    axes.set_ylabel(f"{what} (m²)" if what == AREA else what)


def _bodies_of(rows: Sequence[Mapping[str, Any]]) -> tuple[np.ndarray, np.ndarray, str, str]:
    """Data and labels of the right panel."""
    rate = np.array([_rate(row) for row in rows])
    area = np.array([row.get("albedo_area_m2") or np.nan for row in rows])
    what = AREA
    if not np.isfinite(area).any():
        area, what = np.array([row.get("rms") or np.nan for row in rows]), "rms residual"
    if np.isfinite(rate).any():
        return rate, area, what, RATE
    return np.arange(1, len(rows) + 1), area, what, "place in the catalogue"


def _logarithmic(axes: Any) -> None:
    """A logarithmic y axis with a few plain labels."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")
    low, high = axes.get_ylim()
    axes.yaxis.set_minor_formatter("{x:.4g}" if high < 10 * low else NullFormatter())
    if high < 3 * low:  # minor ticks would be too dense
        axes.yaxis.set_minor_locator(MaxNLocator(5))


def _rate(row: Mapping[str, Any]) -> float:
    """Turns per hour of the heaviest solution."""
    if row.get("period_h"):
        return 1.0 / abs(row["period_h"])
    omega = [row.get(f"omega_{axis}_rad_s") for axis in "xyz"]
    if any(x is None for x in omega):
        return np.nan
    return float(np.linalg.norm(np.array(omega, float))) * 3600.0 / (2.0 * np.pi)


def _marked(axes: Any, x: np.ndarray, y: np.ndarray, rows: Sequence[Mapping[str, Any]]) -> None:
    for status, mark in ((TRUSTED, "."), (NOT_TRUSTED, "x")):
        here = np.array([row["status"] == status for row in rows], bool)
        if here.any():
            axes.plot(x[here], y[here], mark, ms=5, color=COLOURS[status], label=status)
    if axes.get_legend_handles_labels()[1]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)  # away from all points
