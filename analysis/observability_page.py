"""The page of `lcbayes observability`, with its figures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.analysis import observability_plots as plots
from lcbayes.analysis import style
from lcbayes.analysis.numerals import show
from lcbayes.analysis.pages import environment
from lcbayes.core.version import installed_version
from lcbayes.simulation.observability import summary
from lcbayes.simulation.observability.summary import Findings


def write_page(findings: Findings, content: Mapping[str, Any], folder: Path, command: str) -> None:
    """Write ``report.html`` and ``figures/``.

    Parameters
    ----------
    content : content of `observability.json`
    folder : folder to write to
    command : command line that gives the same numbers
    """
    figures = folder / "figures"
    figures.mkdir()
    with style.drawing():
        images = plots.draw(findings, style.Gallery(figures))
    page = _page(findings, content, images, command)
    (folder / "report.html").write_text(page, encoding="utf-8")


def _page(
    findings: Findings, content: Mapping[str, Any], images: dict[str, style.Image], command: str
) -> str:
    sentences = summary.sentences(findings.trades)
    return (
        environment()
        .get_template("observability.html.j2")
        .render(
            title=findings.scenario.name,
            n_obs=findings.measured.curve.n_obs,
            head=f"{summary.headline(findings)}.",
            good=not findings.trades,
            trades=[line[0].upper() + line[1:] for line in sentences[:16]],
            more=max(0, len(sentences) - 16),
            images=images,
            scene=scene(findings),
            parameters=_parameters(findings),
            linearity=summary.linearity_words(findings),
            plan=content["plan"],
            plan_words=[] if findings.plan is None else summary.plan_words(findings.plan),
            schedule=[] if findings.plan is None else _schedule(content["plan"]),
            notes=findings.notes,
            command=command,
            version=installed_version(),
        )
    )


def _parameters(findings: Findings) -> list[tuple[str, ...]]:
    c = findings.campaign
    rows = []
    for p, alone, both, off in zip(
        c.unknowns.parameters, c.bound, c.bound_with_prior, findings.nonlinearity, strict=True
    ):
        bent = "> 100" if off > 1.0 else f"{100.0 * off:.0f}" if off >= 0.01 else "< 1"
        rows.append(
            (
                p.name,
                p.words,
                p.unit,
                show(p.prior_sd, p.prior_sd),
                show(alone, alone),
                show(both, both),
                bent,
            )
        )
    return rows


def _schedule(plan: dict[str, Any]) -> list[tuple[str, ...]]:
    rows = []
    for row in plan["schedule"]:
        when = row["utc"] or f"t = {row['t_s']:.1f} s"
        counted = str(row["n_measurements"]), f"{row['mag']:.2f}"
        gain = f"{row['gain_nats']:.2f}", f"{row['sd_after']:.3g}"
        rows.append((str(row["rank"]), when, row["site"], *counted, *gain))
    return rows


def scene(findings: Findings) -> dict[str, Any]:
    """The sphere of observers for the viewer, coloured by the information from each direction."""
    from matplotlib import colormaps

    patches, middles = plots.sphere_patches()
    share = plots.levels(findings.map_information(middles))
    colours = colormaps[plots.CMAP](np.nan_to_num(share))[:, :3]
    colours[~np.isfinite(share)] = 0.90
    m, i = findings.measured, findings.most_informative
    rows = np.linspace(0, len(m.obs_body) - 1, min(len(m.obs_body), 400)).astype(int)
    best = middles[int(np.nanargmax(np.nan_to_num(share)))]
    body = findings.scenario.body
    marks = [("Sun", m.sun_body[i]), ("best", best)]
    if len(body.areas) <= 12:
        marks += [(f"facet {k}", n) for k, n in enumerate(body.normals)]
    return {
        "polygons": [
            {"p": np.round(p, 3).tolist(), "c": [round(float(x), 3) for x in c]}
            for p, c in zip(patches, colours, strict=True)
        ],
        "solid": True,
        "flat": True,
        "axis": None,
        "labels": [np.round(1.06 * where, 4).tolist() for _, where in marks],
        "names": [name for name, _ in marks],
        "dots": np.round(1.005 * m.obs_body[rows], 3).tolist(),
        "view": [
            float(np.arctan2(best[1], best[0])),
            float(np.clip(np.arcsin(best[2]), -1.2, 1.2)),
        ],
    }
