"""Calibration of every model with every sampler, into docs/calibration.md: `make calibration`.

    python docs/make_calibration.py                               all, 100 curves each; hours
    python docs/make_calibration.py --n 40 --models faceted       fewer
    python docs/make_calibration.py --models "faceted, turning" --samplers nuts ahmc

Each pair of model and sampler is kept in a file once it is done, so that a run that was stopped
goes on, and pairs can be done one at a time; the page shows all that are kept.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binom, kstwo

from lcbayes.analysis import style
from lcbayes.core.checkpoint import write_atomic
from lcbayes.core.progress import Console
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import problem_cache
from lcbayes.samplers.settings import PUBLISHED, WARMUP
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate
from lcbayes.tasks.calibrate.run import Calibration, calibrate

HERE = Path(__file__).parent
KEPT = HERE.parent / "build" / "calibration"
PAGE = HERE / "calibration.md"
FIGURES = HERE / "figures"
ALARM = 1e-3  # of the whole page, if all is right
BINS = 10
SAMPLERS = [name for name in WARMUP if name != PUBLISHED]

# Model, options, and the scenario whose times, geometry and errors are taken.
CASES: dict[str, tuple[str, dict[str, Any], str]] = {
    "faceted": ("faceted", {"n_facets": 1, "spin": "none", "log_area_mean": 2.0}, "one-facet"),
    "faceted, turning": ("faceted", {"n_facets": 1, "omega_sd": 0.02}, "two-facet-spin"),
    "faceted-brdf": (
        "faceted-brdf",
        {"n_facets": 1, "spin": "none", "law": "blinn-phong", "log_area_mean": 2.0},
        "one-facet",
    ),
    "stabilised": (
        "stabilised",
        {"facets": "+z~10", "n_facets": 2, "reflectance": "lambertian"},
        "box-wing",
    ),
}

HEAD = """\
# Calibration

Light curves were simulated from each model's prior and fitted as `lcbayes fit` does, search,
solutions and weights included. Where all is right, the place of the truth among the draws is
uniform, and a 90 % interval holds the truth nine times in ten, whatever the quantity
([Talts et al. 2018](https://arxiv.org/abs/1804.06788)). The log-likelihood is one of the
quantities, since a posterior that ignored the data would pass all the others
([Modrák et al. 2023](https://arxiv.org/abs/2211.02383)). `lcbayes.tasks.calibrate.run.calibrate`
does the same for a model and a geometry of your own.

`make calibration` makes this page; this one is of {date} and has {done} of its {pairs} pairs of
model and sampler: those that are not here have not been run. The least of all {tests} p-values
(Kolmogorov-Smirnov) would be below {level} once in {pages} pages if all were right. *Trusted* is
the share of fits that passed their own diagnostics; the others, of which `lcbayes` says that they
are not to be trusted, count here all the same. All samplers met the same curves, so that by chance
they deviate together. `convex-grid` is left out: its surfaces must close
to 1 %, which hardly a draw from its prior does, so truths cannot be drawn.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=100, help="simulated curves of each pair")
    parser.add_argument("--models", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS, choices=SAMPLERS)
    args = parser.parse_args()
    console = Console()
    for case in args.models:
        for sampler in args.samplers:
            if kept(case, sampler).exists():
                continue
            console.say(f"{case}, {sampler}")
            model, options, of = CASES[case]
            curve, _ = simulate(scenario.load(of), 0)
            if case == "stabilised":  # its scatter would be in units of each curve's mean flux
                curve = in_magnitudes(curve)
            found = calibrate(curve, model, n=args.n, sampler=sampler, progress=console, **options)
            keep(case, sampler, found)
            problem_cache.forget()
            write()
    write()


def in_magnitudes(curve: LightCurve) -> LightCurve:
    """The same times and geometry in V, errors 0.03 mag; brightness does not matter here."""
    n = curve.t.size
    return replace(
        curve, kind="mag", band=np.full(n, "V"), brightness=np.zeros(n), error=np.full(n, 0.03)
    )


def kept(case: str, sampler: str) -> Path:
    return KEPT / f"{case.replace(', ', '-')}-{sampler}.json"


def keep(case: str, sampler: str, found: Calibration) -> None:
    KEPT.mkdir(parents=True, exist_ok=True)
    said = {
        "names": found.names,
        "places": found.places.tolist(),
        "trusted": found.trusted.tolist(),
    }
    write_atomic(kept(case, sampler), lambda path: path.write_text(json.dumps(said)))


def write() -> None:
    """The page and its figures, of all pairs that are kept."""
    done: dict[str, dict[str, Calibration]] = {}
    for case in CASES:
        for sampler in SAMPLERS:
            if kept(case, sampler).exists():
                said = json.loads(kept(case, sampler).read_text())
                done.setdefault(case, {})[sampler] = Calibration(
                    tuple(said["names"]), np.array(said["places"]), np.array(said["trusted"])
                )
    tests = sum(len(c.names) for by in done.values() for c in by.values())
    told = HEAD.format(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        tests=tests,
        level=f"{ALARM / max(tests, 1):.1g}",
        pages=round(1 / ALARM),
        done=sum(map(len, done.values())),
        pairs=len(CASES) * len(SAMPLERS),
    )
    lines = [told]
    for case, by in done.items():
        picture = f"calibration-{case.replace(', ', '-')}.png"
        draw(by, FIGURES / picture)
        model, options, of = CASES[case]
        asked = ", ".join(f"{k}={v}" for k, v in options.items())
        names = next(iter(by.values())).names
        errors = case != "stabilised"
        geometry = ", geometry and errors" if errors else " and geometry, in magnitudes,"
        lines += [
            f"## {case}",
            "",
            f"Model `{model}` ({asked}), times{geometry} of the scenario `{of}`.",
            f"Quantities: {', '.join(f'`{n}`' for n in names)}.",
            "",
            "| sampler | curves | trusted | in 50 % interval | in 90 % interval | least p |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for sampler, found in by.items():
            p = found.p_values()
            lines.append(
                f"| {sampler} | {len(found.places)} | {found.trusted.mean():.0%} | "
                f"{_span(found.coverage(0.5))} | {_span(found.coverage(0.9))} | "
                f"{p.min():.2g} ({found.names[int(p.argmin())]}) |"
            )
        n = min(len(c.places) for c in by.values())
        ends = [[x / n for x in binom.interval(0.99, n, level)] for level in (0.5, 0.9)]
        lines += [
            "",
            f"Least and largest share over the quantities; of {n} right intervals "
            + " and ".join(
                f"{low:.0%} to {high:.0%} of those of {level}"
                for (low, high), level in zip(ends, ("50 %", "90 %"), strict=True)
            )
            + " hold the truth in 99 of 100 quantities.",
            "",
            f"![Where the truth stands among the draws, {case}](figures/{picture})",
            "",
        ]
    write_atomic(PAGE, lambda path: path.write_text("\n".join(lines)))


def _span(shares: np.ndarray) -> str:
    return f"{shares.min():.0%} to {shares.max():.0%}"


def draw(by: dict[str, Calibration], path: Path) -> None:
    """Above: histograms of the places; below: their distribution minus the uniform one. Bands hold
    all bars of a quantity, and a whole line, in 99 of 100 if all is right."""
    with matplotlib.rc_context(cast(Any, style.RC)):
        figure = Figure(figsize=(2.2 * len(by) + 1.0, 4.8), layout="constrained")
        axes = figure.subplots(2, len(by), sharex=True, sharey="row", squeeze=False)
        for (top, below), (sampler, found) in zip(axes.T, by.items(), strict=True):
            n = len(found.places)
            low, high = binom.interval(1 - 0.01 / BINS, n, 1 / BINS)
            top.axhspan(low / n, high / n, color=style.INK, alpha=0.12, lw=0)
            half = kstwo.ppf(0.99, n)
            below.axhspan(-half, half, color=style.INK, alpha=0.12, lw=0)
            edges = np.linspace(0, 1, BINS + 1)
            for i, (name, column) in enumerate(zip(found.names, found.places.T, strict=True)):
                counts = np.histogram(column, edges)[0] / n
                line = {"color": style.colour(i), "ls": "-" if i < len(style.PALETTE) else "--"}
                top.stairs(counts, edges, label=name, **line)
                x = np.sort(column)
                below.step(x, np.arange(1, n + 1) / n - x, where="post", **line)
            top.set_title(sampler, loc="left")
            below.set_xlabel("place of the truth")
        axes[0, 0].set_ylabel("share of the curves")
        axes[1, 0].set_ylabel("distribution − uniform")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(5, 2 * len(by)), fontsize=8
        )
        figure.savefig(path, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    main()
