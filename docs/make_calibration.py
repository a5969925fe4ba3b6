"""Calibrate every model with every sampler and write docs/calibration.md: `make calibration`.

    python docs/make_calibration.py                               all, 100 curves each; hours
    python docs/make_calibration.py --n 40 --models faceted       fewer
    python docs/make_calibration.py --models "faceted, rotating" --samplers nuts ahmc

Each completed pair of model and sampler is stored in a file, so a stopped run can be continued, and
pairs can be run one at a time. The page shows all stored pairs.
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
STORE = HERE.parent / "build" / "calibration"
PAGE = HERE / "calibration.md"
FIGURES = HERE / "figures"
FALSE_ALARM = 1e-3  # probability for the whole page
BINS = 10
SAMPLERS = [name for name in WARMUP if name != PUBLISHED]

# Model, options, and the scenario whose times, geometry and errors are taken.
CASES: dict[str, tuple[str, dict[str, Any], str]] = {
    "faceted": ("faceted", {"n_facets": 1, "spin": "none", "log_area_mean": 2.0}, "one-facet"),
    "faceted, rotating": ("faceted", {"n_facets": 1, "omega_sd": 0.02}, "two-facet-spin"),
    "faceted-brdf": (
        "faceted-brdf",
        {"n_facets": 1, "spin": "none", "reflectance": "blinn-phong", "log_area_mean": 2.0},
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

Simulation-based calibration tests the whole of `lcbayes fit`, including search, solutions and
weights. Light curves are simulated from the prior of each model and fitted. If everything is
correct, the rank of the truth among the draws is uniform, and a 90 % interval contains the truth
nine times in ten, for every quantity ([Talts et al. 2018](https://arxiv.org/abs/1804.06788)). The
log-likelihood is included, because a posterior that ignored the data would pass for all other
quantities ([Modrák et al. 2023](https://arxiv.org/abs/2211.02383)).
`lcbayes.tasks.calibrate.run.calibrate` runs the same test for any model and geometry.

`make calibration` generates this page. This version is from {date} and contains {done} of {pairs}
combinations of model and sampler. If everything is correct, the smallest of all {tests}
Kolmogorov–Smirnov p-values is below {level} on one page in {pages}. *Trusted* is the fraction of
fits that passed their own diagnostics; the others, which `lcbayes` marks as not to be trusted,
are included here. All samplers were given the same curves, so their random deviations are
correlated.
`convex-grid` is omitted: its surfaces must close to 1 %, which almost no prior draw does, so truths
cannot be drawn.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=100, help="simulated curves per pair")
    parser.add_argument("--models", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--samplers", nargs="+", default=SAMPLERS, choices=SAMPLERS)
    args = parser.parse_args()
    console = Console()
    for case in args.models:
        for sampler in args.samplers:
            if stored_path(case, sampler).exists():
                continue
            console.say(f"{case}, {sampler}")
            model, options, of = CASES[case]
            curve, _ = simulate(scenario.load(of), 0)
            if case == "stabilised":  # its scatter would be in units of each curve's mean flux
                curve = in_magnitudes(curve)
            result = calibrate(curve, model, n=args.n, sampler=sampler, progress=console, **options)
            store(case, sampler, result)
            problem_cache.forget()
            write()
    write()


def in_magnitudes(curve: LightCurve) -> LightCurve:
    """The same times and geometry in V, errors 0.03 mag; the brightness is not used."""
    n = curve.t.size
    return replace(
        curve, kind="mag", band=np.full(n, "V"), brightness=np.zeros(n), error=np.full(n, 0.03)
    )


def stored_path(case: str, sampler: str) -> Path:
    return STORE / f"{case.replace(', ', '-')}-{sampler}.json"


def store(case: str, sampler: str, result: Calibration) -> None:
    STORE.mkdir(parents=True, exist_ok=True)
    record = {
        "names": result.names,
        "places": result.places.tolist(),
        "trusted": result.trusted.tolist(),
    }
    write_atomic(stored_path(case, sampler), lambda path: path.write_text(json.dumps(record)))


def write() -> None:
    """Write the page and its figures for all stored pairs."""
    done: dict[str, dict[str, Calibration]] = {}
    for case in CASES:
        for sampler in SAMPLERS:
            if stored_path(case, sampler).exists():
                record = json.loads(stored_path(case, sampler).read_text())
                done.setdefault(case, {})[sampler] = Calibration(
                    tuple(record["names"]), np.array(record["places"]), np.array(record["trusted"])
                )
    tests = sum(len(c.names) for by in done.values() for c in by.values())
    head = HEAD.format(
        date=f"{datetime.now(UTC):%Y-%m-%d}",
        tests=tests,
        level=f"{FALSE_ALARM / max(tests, 1):.1g}",
        pages=round(1 / FALSE_ALARM),
        done=sum(map(len, done.values())),
        pairs=len(CASES) * len(SAMPLERS),
    )
    lines = [head]
    for case, by in done.items():
        picture = f"calibration-{case.replace(', ', '-')}.png"
        draw(by, FIGURES / picture)
        model, options, of = CASES[case]
        settings = ", ".join(f"{k}={v}" for k, v in options.items())
        names = next(iter(by.values())).names
        errors = case != "stabilised"
        geometry = ", geometry and errors" if errors else " and geometry, in magnitudes,"
        lines += [
            f"## {case}",
            "",
            f"Model `{model}` ({settings}); times{geometry} from the scenario `{of}`.",
            f"Quantities: {', '.join(f'`{n}`' for n in names)}.",
            "",
            "| sampler | curves | trusted | in 50 % interval | in 90 % interval | smallest p |",
            "| --- | --- | --- | --- | --- | --- |",
        ]
        for sampler, result in by.items():
            p = result.p_values()
            lines.append(
                f"| {sampler} | {len(result.places)} | {result.trusted.mean():.0%} | "
                f"{_span(result.coverage(0.5))} | {_span(result.coverage(0.9))} | "
                f"{p.min():.2g} ({result.names[int(p.argmin())]}) |"
            )
        n = min(len(c.places) for c in by.values())
        ends = [[x / n for x in binom.interval(0.99, n, level)] for level in (0.5, 0.9)]
        lines += [
            "",
            f"Smallest and largest fraction over the quantities. For correct intervals and {n} "
            "curves, in 99 of 100 quantities the fraction lies "
            + ", and ".join(
                f"between {low:.0%} and {high:.0%} for {level} intervals"
                for (low, high), level in zip(ends, ("50 %", "90 %"), strict=True)
            )
            + ".",
            "",
            f"![Ranks of the truth among the draws, {case}](figures/{picture})",
            "",
        ]
    write_atomic(PAGE, lambda path: path.write_text("\n".join(lines)))


def _span(fractions: np.ndarray) -> str:
    return f"{fractions.min():.0%} to {fractions.max():.0%}"


def draw(by: dict[str, Calibration], path: Path) -> None:
    """Plot histograms of the ranks, and below them their ECDF minus the uniform one.

    If everything is correct, the bands contain all bars of a quantity, and a whole line, in 99 of
    100 cases.
    """
    with matplotlib.rc_context(cast(Any, style.RC)):
        figure = Figure(figsize=(2.2 * len(by) + 1.0, 4.8), layout="constrained")
        axes = figure.subplots(2, len(by), sharex=True, sharey="row", squeeze=False)
        for (top, below), (sampler, result) in zip(axes.T, by.items(), strict=True):
            n = len(result.places)
            low, high = binom.interval(1 - 0.01 / BINS, n, 1 / BINS)
            top.axhspan(low / n, high / n, color=style.INK, alpha=0.12, lw=0)
            half = kstwo.ppf(0.99, n)
            below.axhspan(-half, half, color=style.INK, alpha=0.12, lw=0)
            edges = np.linspace(0, 1, BINS + 1)
            for i, (name, column) in enumerate(zip(result.names, result.places.T, strict=True)):
                counts = np.histogram(column, edges)[0] / n
                line = {"color": style.colour(i), "ls": "-" if i < len(style.PALETTE) else "--"}
                top.stairs(counts, edges, label=name, **line)
                x = np.sort(column)
                below.step(x, np.arange(1, n + 1) / n - x, where="post", **line)
            top.set_title(sampler, loc="left")
            below.set_xlabel("rank of the truth")
        axes[0, 0].set_ylabel("fraction of the curves")
        axes[1, 0].set_ylabel("ECDF − uniform")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside lower center", ncols=min(5, 2 * len(by)), fontsize=8
        )
        figure.savefig(path, dpi=120, metadata={"Software": None})


if __name__ == "__main__":
    main()
