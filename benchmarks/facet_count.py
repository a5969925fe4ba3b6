"""`lcbayes.compare` on bodies with a known number of facets.

python benchmarks/facet_count.py             1, 2, 3 and 5 facets, 5 seeds each, into RESULTS.md
python benchmarks/facet_count.py timed       1 to 8 facets on one curve of 300 epochs, timed

The bodies do not rotate. In three passes of 40 epochs, Sun and observer move in three planes, so
that every facet is lit; SNR 30. Normals are random with separations of at least 40 degrees, and
albedo-areas are log-uniform from 1 to 4 m². The true number is compared with one fewer and one
more. The timed curve has four facets and the spin of four-facets.toml, with 300 epochs.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Console
from lcbayes.physics import brightness
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.viewing import Planar
from lcbayes.simulation.simulate import simulate

HERE = Path(__file__).parent
TRUTHS, SEEDS = (1, 2, 3, 5), range(5)
SNR, EPOCHS, APART = 30.0, 40, np.radians(40.0)


def passes() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (T,) and directions to Sun and observer (T, 3): the same arc in three planes."""
    u = np.linspace(0.0, 1.0, EPOCHS)
    sun, obs = 0.3 + 2 * np.pi * u, -0.5 + 4 * np.pi * u
    flat = [np.stack([np.cos(a), np.sin(a), 0 * a], axis=1) for a in (sun, obs)]
    sun, obs = (np.concatenate([np.roll(v, k, axis=1) for k in range(3)]) for v in flat)
    t = np.concatenate([300.0 * k + 200.0 * u for k in range(3)])
    return t, sun, obs


def body(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Normals (n, 3) and albedo-areas (n,)."""
    while True:
        normals = rng.normal(size=(n, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        if np.all((normals @ normals.T)[np.triu_indices(n, 1)] < np.cos(APART)):
            return normals, np.exp(rng.uniform(0.0, np.log(4.0), n))


def observed(n: int, seed: int) -> lcbayes.LightCurve:
    rng = np.random.default_rng([n, seed])
    t, sun, obs = passes()
    normals, areas = body(n, rng)
    flux = np.asarray(
        brightness.flux(
            jnp.asarray(sun),
            jnp.asarray(obs),
            jnp.asarray(normals),
            jnp.asarray(areas),
            "non-lambertian",
        )
    )
    sd = np.full(t.size, flux[flux > 0].mean() / SNR)
    return lcbayes.LightCurve(
        t=t, brightness=flux + sd * rng.normal(size=t.size), error=sd, kind="flux", sun=sun, obs=obs
    )


def study() -> None:
    rows, good, best, weighed, particles, behind = [], 0, 0, 0, 0, []
    for seed in SEEDS:
        for n in TRUTHS:
            begun = time.monotonic()
            result = lcbayes.compare(
                observed(n, seed),
                n_facets=range(max(1, n - 1), n + 2),
                seed=seed,
                spin="none",
            )
            jax.clear_caches()  # the programs of 16 comparisons exhaust LLVM's memory
            by = {c["n_facets"]: c for c in result.content["candidates"]}
            top = max(by, key=lambda k: by[k]["log_evidence"])
            gap = by[top]["log_evidence"] - by[n]["log_evidence"]
            good, best = good + (gap <= 1.0), best + (top == n)
            weighed += len(by)
            particles += sum(c["evidence_from"] == "particles" for c in by.values())
            behind.append(gap)
            probability = result.probability[n]
            rows.append(
                [
                    str(n),
                    str(seed),
                    str(top),
                    f"{gap:.2f}",
                    f"{probability:.2f}",
                    f"{max(c['log_evidence_spread'] for c in by.values()):.2f}",
                    "yes" if result.trusted else "no",
                    f"{time.monotonic() - begun:.0f}",
                ]
            )
            print(" | ".join(rows[-1]), flush=True)
    heads = [
        "facets",
        "seed",
        "most probable",
        "true number behind (nat)",
        "its probability",
        "largest spread (nat)",
        "trusted",
        "wall (s)",
    ]
    text = (
        "Each number against one fewer and one more. "
        f"{particles} of {weighed} evidences are from particles. "
    )
    text += (
        f"The true number is the most probable in {best} of {len(rows)}, it or within 1 nat of it "
    )
    text += f"in {good} (goal: 16 of 20).\n\n" + table(heads, rows)
    write_section("Number of facets", "python benchmarks/facet_count.py", text)


def turning() -> lcbayes.LightCurve:
    """Four facets and a spin, 296 epochs."""
    what = scenario.load(HERE / "four-facets.toml")
    assert isinstance(what.geometry, Planar)
    passes = tuple(replace(one, step=0.4 * one.step) for one in what.geometry.passes)
    return simulate(replace(what, geometry=replace(what.geometry, passes=passes)), 1)[0]


def timed() -> None:
    curve = turning()
    begun = time.monotonic()
    result = lcbayes.compare(curve, n_facets=range(1, 9), seed=1, progress=Console())
    took = time.monotonic() - begun
    text = "`lcbayes.compare(curve, n_facets=range(1, 9), seed=1)`, "
    text += f"{curve.n_obs} epochs, ω unknown, four "
    text += f"facets: {took:.0f} s (goal: 200 s).\n\n```\n{result.text()}\n```"
    print(text)
    write_section("Number of facets, 1 to 8, timed", "python benchmarks/facet_count.py timed", text)


if __name__ == "__main__":
    {"": study, "timed": timed}["".join(sys.argv[1:])]()
