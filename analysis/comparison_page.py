"""The page of a comparison of numbers of facets, self-contained, with one figure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.analysis import style
from lcbayes.analysis.pages import command, environment
from lcbayes.core.options import Options
from lcbayes.results import comparison

DEPTH = 12.0  # nats below the best that are drawn; arrows mark lower values
ALT = "Posterior probability, ln evidence and predictive density of each number of facets."
CAPTION = (
    "Left: posterior probability of each number of facets, with its 90 % interval from the "
    "errors of the evidences. Middle: ln evidence against the best with its standard error, and "
    "each chain or independent run as a dot. Right: predictive density of left-out epochs against "
    "the best, with the standard error of the difference. Arrows: below the scale; with <, "
    "for an excluded number, the upper bound of its evidence."
)


def write_page(
    folder: Path, summary: Mapping[str, Any], run: Mapping[str, Any], options: type[Options]
) -> None:
    """Write ``report.html`` and ``figures/compare.svg``, ``.pdf`` of a comparison into a folder.

    Parameters
    ----------
    folder : path
    summary : mapping
        The content of summary.json.
    run : mapping
        The content of run.toml.
    options : options of the task
    """
    image = style.picture(
        folder,
        "compare",
        lambda g: draw(summary["candidates"], g, summary["ruled_out"]),
        ALT,
        CAPTION,
    )
    heads, rows = comparison.cells(summary)
    said = summary["conclusion"]
    page = (
        environment()
        .get_template("compare.html.j2")
        .render(
            title=Path(run.get("curve", "")).name or "a light curve",
            conclusion=said[0].upper() + said[1:] + ".",
            summary=summary,
            of_bodies=comparison.of_bodies(summary),
            image=image,
            heads=heads,
            rows=rows,
            notes=comparison.notes(summary),
            command=command(run, options),
            version=run["version"],
        )
    )
    (folder / "report.html").write_text(page, encoding="utf-8")


def draw(
    rows: Sequence[Mapping[str, Any]],
    gallery: style.Gallery,
    ruled_out: Sequence[Mapping[str, Any]] = (),
) -> Any:
    """The figure of the rows of `candidates` and of `ruled_out`."""
    figure = gallery.figure(10.0, 3.3)
    left, middle, right = figure.subplots(1, 3)
    bodies = [row["body"] for row in rows if row.get("body")]
    n = np.arange(len(rows)) if bodies else np.array([row["n_facets"] for row in rows])
    _probabilities(left, n, rows)
    top = max(row["log_evidence"] for row in rows)
    runs = [np.asarray(row["log_evidences"], float) - top for row in rows]
    depth = _differences(
        middle,
        n,
        np.array([row["log_evidence"] for row in rows]) - top,
        np.array([row["log_evidence_se"] for row in rows]),
        "ln evidence − best (nat)",
        np.concatenate(runs),
    )
    for k, one in zip(n, runs, strict=True):
        shown = one[one > -depth]
        middle.plot(np.full(shown.size, k + 0.18), shown, ".", ms=4, color=style.FAINT, zorder=1)
    _differences(
        right,
        n,
        np.array([row["elpd_diff"] for row in rows]),
        np.array([row["elpd_diff_se"] for row in rows]),
        "elpd LOO − best (nat)",
    )
    for row in ruled_out:
        _far_below(middle, row["n_facets"], row["log_evidence_below"] - top, depth, "< ")
    every = np.sort(np.append(n, [row["n_facets"] for row in ruled_out]).astype(int))
    for axes in (left, middle, right):
        axes.set_xlabel("" if bodies else "number of facets")
        axes.set_xticks(every, bodies or [str(k) for k in every], rotation=30 if bodies else 0)
        axes.set_xlim(every[0] - 0.7, every[-1] + 0.7)
    return figure


def _probabilities(axes: Any, n: np.ndarray, rows: Sequence[Mapping[str, Any]]) -> None:
    p = np.array([[row[f"probability{q}"] for row in rows] for q in ("", "_q05", "_q95")])
    axes.bar(n, p[0], width=0.62, color=style.colour(0), alpha=0.85)
    reach = np.maximum([p[0] - p[1], p[2] - p[0]], 0.0)
    axes.errorbar(n, p[0], reach, fmt="none", ecolor=style.INK, elinewidth=1.1, capsize=3)
    for k, value, high in zip(n, p[0], np.maximum(p[0], p[2]), strict=True):
        if value >= 0.005:
            axes.annotate(
                f"{value:.2f}",
                (k, high),
                xytext=(0, 3),
                textcoords="offset points",
                ha="center",
                va="bottom",
                fontsize=8.5,
            )
    axes.set_ylim(0.0, 1.12)
    axes.set_yticks(np.linspace(0.0, 1.0, 6))
    axes.set_ylabel("posterior probability")


def _differences(
    axes: Any,
    n: np.ndarray,
    values: np.ndarray,
    errors: np.ndarray,
    label: str,
    others: np.ndarray | None = None,
) -> float:
    """Draw values relative to the best with their errors; returns the depth of the scale, which
    also includes ``others`` unless they are far below."""
    lowest = (values - errors)[values > -DEPTH]
    if others is not None:
        lowest = np.append(lowest, others[others > -DEPTH])
    depth = 1.12 * max(1.0, -lowest.min(initial=0.0))
    shown = values > -depth
    axes.axhline(0.0, color=style.FAINT, lw=0.7, zorder=0)
    axes.errorbar(
        n[shown],
        values[shown],
        errors[shown],
        fmt="o",
        ms=5,
        capsize=3,
        elinewidth=1.1,
        color=style.colour(0),
        zorder=2,
    )
    for k, value in zip(n[~shown], values[~shown], strict=True):
        _far_below(axes, k, value, depth)
    highest = np.append((values + errors)[shown], [] if others is None else others)
    axes.set_ylim(-depth, max(0.08 * depth, 1.15 * float(highest.max())))
    axes.set_ylabel(label)
    return depth


def _far_below(axes: Any, k: float, value: float, depth: float, sign: str = "") -> None:
    """An arrow that points off the scale, labelled with the value."""
    axes.annotate(
        "",
        (k, -depth),
        xytext=(k, -0.88 * depth),
        arrowprops={"arrowstyle": "->", "color": style.FAINT},
    )
    axes.annotate(
        f"{sign}{value:.0f}".replace("-", "−"),
        (k, -0.87 * depth),
        ha="center",
        va="bottom",
        fontsize=7.5,
        color=style.FAINT,
        rotation=90,
    )
