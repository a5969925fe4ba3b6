"""Do 90 % intervals hold the truth? One diffuse facet, two passes, 20 noise seeds.

    python benchmarks/coverage.py            20 whole fits, into RESULTS.md

Each seed is a whole `lcbayes.fit` with its defaults, as a user gets it. With exact intervals the
number of 20 that hold the truth is binomial: 16 to 20 in 95.7 % of trials.
"""

from __future__ import annotations

import time

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes import scenario
from lcbayes.simulate import simulate

SEEDS = range(20)
NAMES = {"albedo_area": "albedo_area_m2", "phi": "phi", "g": "g"}


def main() -> None:
    what = scenario.load("one-facet")
    inside = dict.fromkeys(NAMES, 0)
    pulls: dict[str, list[float]] = {name: [] for name in NAMES}
    trusted, seconds = 0, []
    for seed in SEEDS:
        curve, truth = simulate(what, seed)
        begun = time.monotonic()
        found = lcbayes.fit(curve, n_facets=1, spin="none", seed=seed)
        seconds.append(time.monotonic() - begun)
        trusted += found.converged
        for name, key in NAMES.items():
            true, row = truth["facets"][0][key], found.summary()["parameters"][f"{name}[0]"]
            inside[name] += row["q05"] <= true <= row["q95"]
            pulls[name].append((row["mean"] - true) / row["sd"])
        print(f"seed {seed}: {seconds[-1]:.1f} s, inside so far {inside}", flush=True)
    rows = [
        [
            name,
            f"{inside[name]} of {len(SEEDS)}",
            "16 to 20",
            f"{np.mean(p):+.2f} ± {np.std(p):.2f}",
        ]
        for name, p in pulls.items()
    ]
    found = table(["parameter", "truth inside 90 %", "goal", "(mean − truth)/sd"], rows)
    write_section(
        "Coverage: one facet, two passes",
        "python benchmarks/coverage.py",
        f"Scenario `one-facet` (Linares & Crassidis, sec. VII.A), noise seeds 0 to 19.\n\n"
        f"{found}\n\n"
        f"{trusted} of {len(SEEDS)} fits converged; {np.median(seconds):.1f} s per fit (median), "
        "of which the chains take 0.2 s and the rest is tracing and compiling.",
    )


if __name__ == "__main__":
    main()
