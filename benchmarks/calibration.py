"""Simulation-based calibration of tempered particles: 100 problems drawn from the prior.

python benchmarks/calibration.py         into RESULTS.md and docs/figures/calibration.png

Bodies of one to four facets, 25 each, and their spins are drawn from the prior of `faceted`, and
light curves are simulated from them. The posterior of each is sampled by two runs of particles,
whose solutions are weighted as in fits. The rank of the truth among the posterior's draws is
uniform if model, sampler and weights of the solutions are correct (Talts et al. 2018,
arXiv:1804.06788). Facets can be exchanged, so the quantities are those of the body: its smallest
and largest albedo-area, their sum, the direction of the largest facet, and the spin. Each curve has
two passes of 30 epochs. The noise is the same for all: 1/30 of the median flux of bodies from the
prior.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple, cast

import matplotlib
import numpy as np
from _results import table, write_section
from matplotlib.figure import Figure
from scipy.stats import binom, chi2

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import basins
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.population import MAX_WEIGHT_SD
from lcbayes.inference.prior_mass import accepted
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "calibration.png"
COUNTS, EACH = (1, 2, 3, 4), 25
PARTICLES, RUNS, DRAWS = 250, 2, 400
SNR, OMEGA_SD = 30.0, 0.02
LEVELS = (0.5, 0.9)
BINS = 10
NAMES = {
    "smallest": "smallest albedo-area",
    "largest": "largest albedo-area",
    "sum": "sum of the albedo-areas",
    "across": "x of the largest facet's normal",
    "up": "z of the largest facet's normal",
    "omega_x": "ω_x",
    "omega_z": "ω_z",
    "rate": "|ω|",
}


def geometry() -> LightCurve:
    """Two passes in different planes, without measurements."""
    u = np.linspace(0.0, 1.0, 30)
    t = np.concatenate([120.0 * u, 300.0 + 120.0 * u])
    angles = (0.3 + 0.5 * u, -0.8 + 2.2 * u)
    flat = [np.stack([np.cos(a), np.sin(a), 0.3 + 0 * a], axis=1) for a in angles]
    flat = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in flat]
    sun, obs = (np.concatenate([v, np.roll(v, 1, axis=1)]) for v in flat)
    return LightCurve(t=t, brightness=np.ones(60), error=np.ones(60), kind="flux", sun=sun, obs=obs)


def quantities(sites: dict[str, jax.Array]) -> jax.Array:
    area, normals, omega = sites["albedo_area"], sites["normals"], sites["omega"]
    top = normals[jnp.argmax(area)]
    return jnp.stack(
        [
            area.min(),
            area.max(),
            area.sum(),
            top[0],
            top[2],
            omega[0],
            omega[2],
            jnp.linalg.norm(omega),
        ]
    )


class Placed(NamedTuple):
    """Ranks of the truth in each problem, for bodies of one number of facets."""

    ranks: np.ndarray  # (P, Q)
    agreed: np.ndarray  # (P,) whether the runs agree, by the criterion of fits
    spread: np.ndarray  # (P,) scatter between the runs of ln Z from tempering
    took: float  # seconds per problem


def main() -> None:
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        result = list(pool.map(placed, COUNTS[::-1]))[::-1]
    report(result)


def placed(n: int) -> Placed:
    data = Epochs.of(geometry())
    problem = Problem(registry.find("faceted").bind({"n_facets": n, "omega_sd": OMEGA_SD}), data)
    values = jax.jit(lambda z, d: jax.lax.map(lambda r: quantities(problem.constrain(r, d)), z))
    truths = accepted(problem, data, jax.random.key(n), EACH)
    flux = jax.jit(lambda z, d: jax.lax.map(lambda r: problem.moments(r, d).mean, z))
    many = accepted(problem, data, jax.random.key(100 + n), 400)
    sd = float(np.median(np.mean(np.asarray(flux(many, data)), axis=1))) / SNR
    data = replace(data, error=jnp.full(data.t.size, sd))
    ranks, agreed, spread = [], [], []
    begun = time.monotonic()
    for k, truth in enumerate(truths):
        key_data, key_runs = jax.random.split(jax.random.fold_in(jax.random.key(n), k))
        seen = replace(data, brightness=problem.replicate(truth, data, key_data))
        result = smc.replicate(problem, seen, key_runs, PARTICLES, RUNS, workers=1)
        z, agree = pooled(problem, seen, result, DRAWS)
        draws = np.asarray(values(jnp.asarray(z), seen))
        true = np.asarray(values(truth[None], seen))[0]
        ranks.append(np.mean(draws < true, axis=0))
        agreed.append(agree)
        spread.append(result.spread)
        print(f"{n} facets, {k + 1} of {EACH}", flush=True)
    took = (time.monotonic() - begun) / EACH
    return Placed(np.array(ranks), np.array(agreed), np.array(spread), took)


def pooled(problem: Problem, data: Epochs, result: smc.Runs, n: int) -> tuple[np.ndarray, bool]:
    """n draws as in fits (a solution by its weight, then a particle of any run in it), and whether
    the runs agree on the weights."""
    order = FacetOrder(problem, registry.find("faceted").facet_sites)
    _, label, z, weighed = basins.measure(problem, data, result.runs, order)
    disagreements = weighed.reasons or any(r.reasons for r in result.runs)
    agree = not disagreements and bool(np.all(weighed.by_run.std(axis=0, ddof=1) <= MAX_WEIGHT_SD))
    rng = np.random.default_rng(0)
    of = rng.choice(len(weighed.weight), n, p=weighed.weight / weighed.weight.sum())
    return np.array([rng.choice(z[label == k]) for k in of]), agree


def report(result: list[Placed]) -> None:
    ranks = np.concatenate([f.ranks for f in result])
    agreed = np.concatenate([f.agreed for f in result])
    spreads = np.concatenate([f.spread for f in result])
    n = len(ranks)
    text = f"{n} problems, {PARTICLES} particles, {RUNS} runs each. "
    for name, which in (("All", np.full(n, True)), ("Those whose runs agree", agreed)):
        text += f"{name}, {which.sum()}:\n\n{covered(ranks[which])}\n\n"
    text += "Spread of ln Z of the way between the runs of a problem: median "
    text += f"{np.median(spreads):.2f}, largest {spreads.max():.2f}.\n\n"
    timing = [
        [str(k), str(len(f.ranks)), str(int(f.agreed.sum())), f"{f.took:.1f}"]
        for k, f in zip(COUNTS, result, strict=True)
    ]
    text += table(["facets", "problems", "runs agree", "wall a problem, one core (s)"], timing)
    write_section("Calibration of the particles", "python benchmarks/calibration.py", text)
    print(text)
    draw(ranks)


def covered(ranks: np.ndarray) -> str:
    n = len(ranks)
    rows = []
    for name, column in zip(NAMES.values(), ranks.T, strict=True):
        counts = np.histogram(column, np.linspace(0, 1, BINS + 1))[0]
        p = chi2.sf(np.sum((counts - n / BINS) ** 2) / (n / BINS), BINS - 1)
        inside = [int(np.sum(np.abs(column - 0.5) < level / 2)) for level in LEVELS]
        rows.append([name, *(str(k) for k in inside), f"{p:.2f}"])
    ends = [binom.interval(0.99, n, level) for level in LEVELS]
    heads = ["quantity", *(f"in the {level:.0%} interval" for level in LEVELS), "p, uniform ranks"]
    right = ", ".join(
        f"{low:.0f} to {high:.0f} of {level:.0%}"
        for level, (low, high) in zip(LEVELS, ends, strict=True)
    )
    text = f"\n\nOf {n} intervals that are right {right} hold the truth, but for one in a hundred"
    return table(heads, rows) + text + " quantities."


def draw(ranks: np.ndarray) -> None:
    """Histograms of the ranks, with the band that contains 99 % of the bars."""
    with matplotlib.rc_context(cast(Any, style.RC)):
        figure = Figure(figsize=(10.0, 4.6), layout="constrained")
        axes = figure.subplots(2, 4, sharex=True, sharey=True)
        low, high = binom.interval(0.99, len(ranks), 1 / BINS)
        for axis, name, column in zip(axes.flat, NAMES.values(), ranks.T, strict=True):
            axis.axhspan(low, high, color=style.INK, alpha=0.12, lw=0)
            axis.hist(column, np.linspace(0, 1, BINS + 1), color=style.PALETTE[0], alpha=0.8)
            axis.set_title(name, loc="left", fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("rank of the truth among the draws")
        for axis in axes[:, 0]:
            axis.set_ylabel("problems")
        figure.savefig(FIGURE, dpi=150, metadata={"Software": None})


if __name__ == "__main__":
    main()
