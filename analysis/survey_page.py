"""The page of a survey: distributions of periods, amplitudes and poles, and a table.

Many objects are drawn as densities, so that the page of 100,000 is no larger than that of 100.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (Matplotlib comes without complete types)

from __future__ import annotations

import heapq
from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.ticker import FuncFormatter, NullFormatter
from numpy.typing import NDArray

from lcbayes.analysis import style
from lcbayes.analysis.numerals import FRAMES, duration
from lcbayes.analysis.pages import environment
from lcbayes.analysis.sky_plots import mollweide, place
from lcbayes.analysis.tables import three
from lcbayes.core.text import probability
from lcbayes.inversion.attitude_scan.result import written_period
from lcbayes.results.catalogue import FAILED
from lcbayes.results.survey_table import UNIQUE, Row, SurveyTable, folder_name

MARKS = 1500  # objects that are drawn one by one
LISTED = 300  # rows of each table
PALE = "#dceaf5"  # of one object
ALT = "Periods, probabilities, amplitudes and poles of all objects."
CAPTION = (
    "The most probable solution of each object. Above: number of objects by period, and by the "
    "probability of that period. Below: amplitude against period, and poles in {frame} (equal "
    "areas). Orange: probability of the period of at least {unique:g}. {marks}"
)
DENSE = "Shades: number of objects; lines: that of the orange ones. Poles: {poles}."
NUMBERS = ("period_h", "period_probability", "amplitude_mag", "pole_lon_deg", "pole_lat_deg")

Floats = NDArray[np.float64]


@dataclass
class First:
    """What the page shows of the most probable solution of each object.

    Attributes
    ----------
    columns : values of `NUMBERS`, of all objects with a solution
    top : rows of the objects with the most probable periods, the most probable first
    failed : rows of the first failures
    frames : axes of the poles
    """

    columns: dict[str, Floats]
    top: list[Row]
    failed: list[Row]
    frames: set[str] = field(default_factory=set[str])

    @classmethod
    def of(cls, table: SurveyTable) -> First:
        """Read a table once."""
        values = {name: array("d") for name in NUMBERS}
        best: list[tuple[float, int, Row]] = []
        failed: list[Row] = []
        frames: set[str] = set()
        number = count(0, -1)  # of equal probabilities the first are kept
        for rows in table.objects():
            row = rows[0]
            if row["status"] == FAILED:
                if len(failed) < LISTED:
                    failed.append(row)
                continue
            for name, column in values.items():
                column.append(row[name])
            frames.add(row["frame"])
            item = (row["period_probability"], next(number), row)
            if len(best) < LISTED:
                heapq.heappush(best, item)
            else:
                heapq.heappushpop(best, item)
        columns = {name: np.array(column) for name, column in values.items()}
        return cls(columns, [row for _, _, row in sorted(best, reverse=True)], failed, frames)

    @property
    def unique(self) -> NDArray[np.bool_]:
        """Which objects have a period with a probability of at least 0.99."""
        return self.columns["period_probability"] >= UNIQUE

    @property
    def dense(self) -> bool:
        """Whether there are too many objects for marks."""
        return len(self.unique) > MARKS

    @property
    def poles_shown(self) -> NDArray[np.bool_]:
        """Which poles are drawn as densities: those of the only periods, if there are many."""
        return self.unique if self.unique.sum() > MARKS else np.ones(len(self.unique), bool)


def write_page(
    folder: Path, table: SurveyTable, summary: Mapping[str, Any], run: Mapping[str, Any]
) -> None:
    """Write ``report.html`` and ``figures/survey.svg``, ``.pdf`` of a survey into a folder.

    Parameters
    ----------
    summary : content of ``summary.json``
    run : content of ``run.toml``
    """
    first = First.of(table)
    image = None
    if first.top:
        frame = " or ".join(FRAMES.get(name, name) for name in sorted(first.frames))
        marks = "One mark for each object."
        if first.dense:
            chosen = "all objects" if first.poles_shown.all() else "the orange ones alone"
            marks = DENSE.format(poles=chosen)
        caption = CAPTION.format(frame=frame, marks=marks, unique=UNIQUE)
        image = style.picture(folder, "survey", lambda g: draw(first, g), ALT, caption)
    full = set(run["options"].get("full", []))
    done = summary["n_trusted"] + summary["n_not_trusted"] + summary["n_failed"]
    page = (
        environment()
        .get_template("survey.html.j2")
        .render(
            title=Path(run["catalogue"]).name,
            summary=summary,
            done=done,
            took=duration(summary["seconds"]),
            image=image,
            rows=[_cells(row, full) for row in first.top],
            failed=first.failed,
            unique=UNIQUE,
            version=run["version"],
        )
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def _cells(row: Row, full: set[str]) -> dict[str, Any]:
    """A row of the table, with a link to the object's own page if there is one."""
    name = row["object"]
    return {
        "name": name,
        "page": f"objects/{folder_name(name)}/report.html" if name in full else None,
        "status": row["status"],
        "cells": [
            written_period(row["period_h"], row["period_resolution_h"]),
            probability(row["period_probability"]),
            probability(row["probability"]),
            f"{row['pole_lon_deg']:.0f}",
            f"{row['pole_lat_deg']:+.0f}".replace("-", "−"),
            f"{row['amplitude_mag']:.2f}",
            three(row["rms"]),
            str(row["n_obs"]),
            f"{row['seconds']:.1f}",
        ],
    }


def draw(first: First, gallery: style.Gallery) -> Any:
    """The figure of all objects."""
    figure = gallery.figure(10.0, 7.2)
    grid = figure.add_gridspec(2, 2)
    _periods(figure.add_subplot(grid[0, 0]), first)
    _probabilities(figure.add_subplot(grid[0, 1]), first)
    _amplitudes(figure.add_subplot(grid[1, 0]), first)
    axes = mollweide(figure, grid[1, 1])
    lon, lat = first.columns["pole_lon_deg"], first.columns["pole_lat_deg"]
    _poles(axes, first, *place(lon, lat))
    return figure


def _period_edges(period: Floats, n: int) -> Floats:
    low, high = np.log10(period.min()), np.log10(period.max())
    return np.logspace(low - 0.02, high + 0.02, n)


def _hours(axes: Any) -> None:
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("period (h)")


def _periods(axes: Any, first: First) -> None:
    period = first.columns["period_h"]
    edges = _period_edges(period, int(np.clip(len(period) / 4, 10, 60)))
    for values, colour, label in (
        (period, style.colour(0), "all"),
        (period[first.unique], style.colour(1), f"P ≥ {UNIQUE:g}"),
    ):
        axes.hist(values, edges, color=colour, alpha=0.75, label=label)
    _hours(axes)
    axes.set_ylabel("objects")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)


def _probabilities(axes: Any, first: First) -> None:
    values = first.columns["period_probability"]
    edges = [*np.linspace(0.0, 0.9, 19), 0.95, UNIQUE, 1.0]
    number, _ = np.histogram(values, edges)
    places = np.arange(len(number))
    colours = [style.colour(0)] * (len(number) - 1) + [style.colour(1)]
    axes.bar(places, number, width=0.9, color=colours)
    ticks = [*range(0, 19, 4), 18, 20]
    axes.set_xticks([t - 0.5 for t in ticks], [f"{edges[t]:.3g}" for t in ticks])
    axes.set_xlabel("probability of the period")
    axes.set_ylabel("objects")


def _amplitudes(axes: Any, first: First) -> None:
    period, amplitude = first.columns["period_h"], first.columns["amplitude_mag"]
    top = float(np.quantile(amplitude, 0.999)) * 1.1 + 0.05
    amplitude = np.minimum(amplitude, top)
    _hours(axes)
    axes.set_ylim(0.0, top)
    axes.set_ylabel("amplitude (mag)")
    if not first.dense:
        _marks(axes, period, amplitude, first.unique)
        return
    edges = _period_edges(period, 90), np.linspace(0.0, top, 70)
    number, _, _ = np.histogram2d(period, amplitude, edges)
    norm = LogNorm(1.0, max(float(number.max()), 2.0))
    _shades(axes, *edges, number, norm)
    chosen = first.unique
    if chosen.sum() <= MARKS // 3:
        _marks(axes, period[chosen], amplitude[chosen], chosen[chosen])
        return
    edges = _period_edges(period, 30), np.linspace(0.0, top, 24)
    number, _, _ = np.histogram2d(period[chosen], amplitude[chosen], edges)
    middle = np.sqrt(edges[0][1:] * edges[0][:-1]), 0.5 * (edges[1][1:] + edges[1][:-1])
    levels = number.max() * np.array([0.1, 0.4, 0.8])
    axes.contour(*middle, number.T, levels, colors=style.colour(1), linewidths=1.1)


def _poles(axes: Any, first: First, x: Floats, y: Floats) -> None:
    axes.grid(color=style.FAINT, lw=0.4, alpha=0.5)
    if not first.dense:
        _marks(axes, x, y, first.unique)
        return
    chosen = first.poles_shown
    edges = np.linspace(-np.pi, np.pi, 49), np.arcsin(np.linspace(-1.0, 1.0, 25))
    number, _, _ = np.histogram2d(x[chosen], y[chosen], edges)
    _shades(axes, *edges, number, Normalize(0.0, float(number.max())))


def _marks(axes: Any, x: Floats, y: Floats, unique: NDArray[np.bool_]) -> None:
    """One mark for each object; those with one period above the others, in orange."""
    for k, chosen in enumerate((~unique, unique)):
        axes.plot(x[chosen], y[chosen], ".", ms=3.5, color=style.colour(k), alpha=0.8)


def _shades(axes: Any, x: Floats, y: Floats, number: Floats, norm: Normalize) -> None:
    shades = LinearSegmentedColormap.from_list("", [PALE, style.colour(0)])
    shown = np.ma.masked_equal(number.T, 0.0)
    axes.pcolormesh(x, y, shown, cmap=shades, norm=norm, rasterized=True)
