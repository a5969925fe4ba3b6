"""Evidence from tempered particles compared with nested sampling and, for one facet, quadrature.

python benchmarks/evidence.py            all parts, into RESULTS.md; needs blackjax (extra bench)
python benchmarks/evidence.py three      one of: one, two, two-spin, three
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _results import table, write_section

from lcbayes.core.jax_setup import jax
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))
NOISE_SEED = 1
PARTICLES, RUNS = 1000, 4
LIVE, NESTED_RUNS = 1000, 4


class Part(NamedTuple):
    what: str | Path
    n_facets: int
    spin: bool
    title: str


PARTS = {
    "one": Part("one-facet", 1, False, "one facet"),
    "two": Part(HERE / "still-facets.toml", 2, False, "two facets"),
    "two-spin": Part("two-facet-spin", 2, True, "two facets and ω"),
    "three": Part(HERE / "still-facets.toml", 3, False, "three facets"),
}
HEADS = ["", "ln Z", "error", "from", "likelihoods or gradients", "wall (s)"]


def compare(name: str) -> None:
    from tests.helpers import nested_sampling, one_facet_posterior

    part = PARTS[name]
    what = scenario.load(part.what)
    body, n = what.body, part.n_facets
    first = body._replace(
        normals=body.normals[:n],
        areas=body.areas[:n],
        labels=body.labels[:n],
        u_axes=body.u_axes[:n],
    )
    data = Epochs.of(simulate(replace(what, body=first), NOISE_SEED)[0])
    options = {"n_facets": part.n_facets, "spin": "free" if part.spin else "none"}
    problem = Problem(registry.find("faceted").bind(options), data)

    begun = time.monotonic()
    runs = smc.replicate(problem, data, jax.random.key(0), PARTICLES, RUNS)
    took = (time.monotonic() - begun) / RUNS
    spent = np.mean([r.gradients for r in runs.runs])
    reasons = sum(len(r.reasons) for r in runs.runs)
    lines = [
        [
            "tempered particles",
            runs.log_evidence,
            runs.se,
            f"{RUNS} runs of {PARTICLES} chains, spread {runs.spread:.2f}",
            spent,
            took,
        ]
    ]
    print(lines[0], flush=True)

    result, evaluations, begun = [], [], time.monotonic()
    for seed in range(NESTED_RUNS):
        one, n = nested_sampling.log_evidence(
            problem, data, jax.random.key(seed), part.n_facets, part.spin, LIVE
        )
        result.append(one)
        evaluations.append(n)
        print(one, flush=True)
    took = (time.monotonic() - begun) / NESTED_RUNS
    value, error = nested_sampling.pooled(result)
    each = ", ".join(f"{f.value:.2f} ± {f.se:.2f}" for f in result)
    lines.append(
        [
            "nested slice sampling",
            value,
            error,
            f"{NESTED_RUNS} runs of {LIVE} live points ({each})",
            np.mean(evaluations),
            took,
        ]
    )

    rows = [[n, f"{z:.2f}", f"{e:.2f}", f, f"{k:.1e}", f"{t:.1f}"] for n, z, e, f, k, t in lines]
    text = f"{data.t.size} epochs, {problem.dim} parameters of the model."
    apart = abs(runs.log_evidence - value) / np.hypot(runs.se, error)
    if name == "one":
        exact = one_facet_posterior.Quadrature.of(data).log_evidence(data)
        rows.append(["quadrature", f"{exact:.2f}", "", "", "", ""])
    text += f"\n\n{table(HEADS, rows)}\n\nThe two differ by {runs.log_evidence - value:+.2f},"
    text += f" {apart:.1f} of their combined error. The particles themselves gave {reasons} reasons"
    text += " not to trust a run. Likelihoods, gradients and seconds are of one run."
    print(text)
    command = f"python benchmarks/evidence.py {name}"
    write_section(f"Evidence beside nested sampling: {part.title}", command, text)


if __name__ == "__main__":
    chosen = sys.argv[1:] or list(PARTS)
    if unknown := set(chosen) - set(PARTS):
        sys.exit(f"unknown part {', '.join(sorted(unknown))}; available: {', '.join(PARTS)}")
    for part in chosen:
        compare(part)
