"""Calibration of the particles: 100 problems drawn from the prior, and what their posteriors hold.

python benchmarks/calibration.py         into RESULTS.md and docs/figures/calibration.png

Bodies of one to four facets, 25 each, with their spin, are drawn from the prior of `faceted`, light
curves from them, and the posterior of each by two runs of particles whose solutions are weighed as
in fits. The rank of the truth among the posterior's draws is uniform if all is right: model,
sampler, weights of the solutions (Talts et al. 2018, arXiv:1804.06788). Facets have no names, so
the quantities are those of the body: its smallest and largest albedo-area, their sum, the direction
of the largest facet, the spin. Two passes of 30 epochs; the noise is one for all, a thirtieth of
the median flux of the prior's bodies.
"""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import matplotlib
import numpy as np
from _results import table, write_section
from matplotlib.figure import Figure
from scipy.stats import binom, chi2

from lcbayes import gallery
from lcbayes._jax import jax, jnp
from lcbayes.analysis import style
from lcbayes.epochs import Epochs
from lcbayes.inference import regions, smc
from lcbayes.inference.facet_order import FacetOrder
from lcbayes.inference.prior_mass import accepted
from lcbayes.inference.problem import Problem
from lcbayes.inference.regions import Regions
from lcbayes.lightcurve import LightCurve

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "calibration.png"
COUNTS, EACH = (1, 2, 3, 4), 25
PARTICLES, RUNS, DRAWS = 60, 2, 400
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
    """Two passes whose planes differ, with nothing seen yet."""
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
        [area.min(), area.max(), area.sum(), top[0], top[2], omega[0], omega[2],
         jnp.linalg.norm(omega)]
    )  # fmt: skip


def main() -> None:
    ranks, rows, spreads = [], [], []
    for n in COUNTS:
        data = Epochs.of(geometry())
        problem = Problem(gallery.find("faceted").bind({"n_facets": n, "omega_sd": OMEGA_SD}), data)
        told = jax.jit(
            lambda z, d, p=problem: jax.lax.map(lambda r: quantities(p.constrain(r, d)), z)
        )
        truths = accepted(problem, data, jax.random.key(n), EACH)
        flux = jax.jit(lambda z, d, p=problem: jax.lax.map(lambda r: p.moments(r, d).mean, z))
        many = accepted(problem, data, jax.random.key(100 + n), 400)
        sd = float(np.median(np.mean(np.asarray(flux(many, data)), axis=1))) / SNR
        data = replace(data, error=jnp.full(data.t.size, sd))
        begun = time.monotonic()
        for k, truth in enumerate(truths):
            key_data, key_runs = jax.random.split(jax.random.fold_in(jax.random.key(n), k))
            seen = replace(data, brightness=problem.replicate(truth, data, key_data))
            found = smc.replicate(problem, seen, key_runs, PARTICLES, RUNS)
            spreads.append(found.spread)
            draws = np.asarray(told(jnp.asarray(pooled(problem, seen, found, DRAWS)), seen))
            true = np.asarray(told(truth[None], seen))[0]
            ranks.append(np.mean(draws < true, axis=0))
        took = (time.monotonic() - begun) / EACH
        jax.clear_caches()
        print(f"{n} facets: {took:.1f} s a problem", flush=True)
        rows.append([str(n), str(EACH), f"{took:.1f}"])
    report(np.array(ranks), rows, np.array(spreads))


def pooled(problem: Problem, data: Epochs, found: smc.Runs, n: int) -> np.ndarray:
    """n draws as fits have them: a solution by its weight, then a particle of any run there."""
    n_least = min(len(r.z) for r in found.runs)
    z = np.stack([regions.evenly(r.z, n_least) for r in found.runs])
    order = FacetOrder(problem, gallery.find("faceted").facet_sites)
    cut = Regions.of(problem, data, z, order)
    rng = np.random.default_rng(0)
    weight = regions.weigh(cut, z, found.log_evidences, PARTICLES, rng).weight
    flat = z.reshape(-1, problem.dim)
    label = cut.place(flat)[0]
    of = rng.choice(len(weight), n, p=weight / weight.sum())
    return np.array([rng.choice(flat[label == k]) for k in of])


def report(ranks: np.ndarray, timing: list[list[str]], spreads: np.ndarray) -> None:
    n = len(ranks)
    rows = []
    for name, column in zip(NAMES.values(), ranks.T, strict=True):
        counts = np.histogram(column, np.linspace(0, 1, BINS + 1))[0]
        p = chi2.sf(np.sum((counts - n / BINS) ** 2) / (n / BINS), BINS - 1)
        inside = [int(np.sum(np.abs(column - 0.5) < level / 2)) for level in LEVELS]
        rows.append([name, *(str(k) for k in inside), f"{p:.2f}"])
    ends = [binom.interval(0.99, n, level) for level in LEVELS]
    heads = [
        "quantity",
        *(f"in the {level:.0%} interval" for level in LEVELS),
        "p of uniform ranks",
    ]
    text = (
        f"{n} problems, {PARTICLES} particles, {RUNS} runs each. Of {n} intervals that are right "
    )
    text += ", ".join(
        f"{low:.0f} to {high:.0f} of {level:.0%}"
        for level, (low, high) in zip(LEVELS, ends, strict=True)
    )
    text += " hold the truth, but for one in a hundred quantities.\n\n" + table(heads, rows)
    text += "\n\nSpread of ln Z of the way between the runs of a problem: median "
    text += f"{np.median(spreads):.2f}, "
    text += f"largest {spreads.max():.2f}.\n\n"
    text += table(["facets", "problems", "wall a problem (s)"], timing)
    write_section("Calibration of the particles", "python benchmarks/calibration.py", text)
    print(text)
    draw(ranks)


def draw(ranks: np.ndarray) -> None:
    """Histograms of the ranks, with the band that holds 99 % of the bars."""
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
