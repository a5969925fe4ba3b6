"""Complete search over constant spins: is a fit as good as that of the truth found, and how soon?

    python benchmarks/search.py [--first 0] [--cases 200] [--fit all|few] [-o DIR]

Each case is a body of 3 to 6 diffuse facets that turns 5 to 2,000 times in 2 to 6 passes over one
to three nights, with a signal-to-noise ratio of 20 (odd seeds) or 100 (even seeds); see
`_spin_cases`. The search covers all spins that the prior allows. It succeeds if the best end point
is at most 0.5 nats above the posterior optimum reached from the truth. The data determine the spin,
as the search sees it, if at most `FEW` rotations reach a potential within `PLAUSIBLE` of the best.
With --fit, the curves are then fitted by `lcbayes.fit`: all, or those few that determine the spin.
One row a case is appended to search.csv in DIR; cases that are there are not repeated.
"""

from __future__ import annotations

import argparse
import csv
import time
from pathlib import Path

import numpy as np
from _results import table, write_section
from _scores import share
from _spin_cases import Case, drawn

import lcbayes
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.motions import motion, same_motion
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.inference.spin_search.search import complete_search
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

TOLERANCE = 0.5  # nats
PLAUSIBLE = 5.0  # nats above the best
FEW = 3  # rotations
WORKERS = 2
COLUMNS: tuple[str, ...] = (
    "seed",
    "snr",
    "facets",
    "passes",
    "turns",
    "cells",
    "nats_above_truth",
    "rotations",
    "search_s",
    "trusted",
    "reasons",
    "rate_inside",
    "solutions",
    "fit_s",
)


def searched(case: Case) -> dict[str, float]:
    """Nats above the optimum reached from the truth, and the time."""
    entry, data = registry.find("faceted"), Epochs.of(case.curve)
    options = {o.name: o.default for o in entry.options.values()} | {
        "n_facets": len(case.areas),
        "omega_sd": case.omega_sd,
    }
    problem, _ = build_problem(entry, options | dict(entry.pooled), data)
    begun = time.monotonic()
    ends, coverage = complete_search(problem, data, options, WORKERS, Silent())
    seconds = time.monotonic() - begun
    truth = Bodies(case.omega[None], case.normals[None], case.areas[None])
    best = search.polish(problem, data, starts(problem, data, truth, case.omega_sd), 1)
    above = float(ends.potential[0] - best.potential[0])
    return {
        "cells": coverage.cells,
        "nats_above_truth": above,
        "rotations": rotations(problem, data, ends),
        "search_s": seconds,
    }


def rotations(problem: Problem, data: Epochs, ends: search.SearchState) -> int:
    """Number of rotations among the end points that are nearly as good as the best."""
    found: list[np.ndarray] = []
    for z in ends.z[np.asarray(ends.potential) < float(ends.potential[0]) + PLAUSIBLE]:
        moving = motion(problem, data, z)
        if not any(same_motion(moving, known) for known in found):
            found.append(moving)
    return len(found)


def fitted(case: Case) -> dict[str, object]:
    """Verdict of a fit, and whether its 90 % interval of the rate holds the truth."""
    begun = time.monotonic()
    result = lcbayes.fit(case.curve, n_facets=len(case.areas), omega_sd=case.omega_sd, seed=1)
    draws = lcbayes.weighted_draws(result.data["posterior"].to_dataset())
    rate = np.linalg.norm(draws["omega"].to_numpy().reshape(-1, 3), axis=1)
    low, high = np.quantile(rate, [0.05, 0.95])
    return {
        "trusted": int(result.trusted),
        "reasons": " ".join(dict.fromkeys(r.code for r in result.reasons)),
        "rate_inside": int(low <= np.linalg.norm(case.omega) <= high),
        "solutions": len(result.content["modes"]),
        "fit_s": time.monotonic() - begun,
    }


def counted(values: list[int]) -> str:
    """k of n, with the share and its standard error."""
    return f"{sum(values)} of {len(values)} ({share(sum(values), len(values))})"


def report(rows: list[dict[str, str]]) -> str:
    """The table of all cases so far."""
    lines = []
    for name, some in (
        ("all", rows),
        ("SNR 20", [r for r in rows if r["snr"] == "20"]),
        ("SNR 100", [r for r in rows if r["snr"] == "100"]),
        ("two passes", [r for r in rows if r["passes"] == "2"]),
        ("three and more", [r for r in rows if int(r["passes"]) > 2]),
        ("one rotation", [r for r in rows if int(r["rotations"]) == 1]),
        ("two or three", [r for r in rows if 1 < int(r["rotations"]) <= FEW]),
        ("more rotations", [r for r in rows if int(r["rotations"]) > FEW]),
    ):
        if not some:
            continue
        seconds = [float(r["search_s"]) for r in some]
        fits = [r for r in some if r["trusted"]]
        trusted = [r for r in fits if r["trusted"] == "1"]
        lines.append(
            [
                name,
                counted([int(float(r["nats_above_truth"]) < TOLERANCE) for r in some]),
                f"{np.median(seconds):.0f}, {np.quantile(seconds, 0.9):.0f}",
                counted([int(r["trusted"]) for r in fits]) if fits else "",
                counted([int(r["rate_inside"]) for r in trusted]) if trusted else "",
            ]
        )
    head = [
        "cases",
        "best not above the truth",
        "search: median, 90 % (s)",
        "trusted",
        "rate inside 90 %, trusted",
    ]
    return table(head, lines)


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the complete search over constant spins.")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--cases", type=int, default=200, help="number of seeds")
    parser.add_argument(
        "--fit", choices=["all", "few"], help="fit curves too: all, or those with few rotations"
    )
    parser.add_argument("--write", action="store_true", help="write the table to RESULTS.md")
    parser.add_argument("-o", type=Path, default=Path("search-benchmark"), help="folder")
    options = parser.parse_args()
    options.o.mkdir(parents=True, exist_ok=True)
    path = options.o / "search.csv"
    rows = list(csv.DictReader(path.open())) if path.exists() else []
    done = {int(r["seed"]) for r in rows}
    for seed in range(options.first, options.first + options.cases):
        if seed in done:
            continue
        snr = 20 if seed % 2 else 100
        case = drawn(seed, snr)
        row = dict.fromkeys(COLUMNS, "") | {
            "seed": seed,
            "snr": snr,
            "facets": len(case.areas),
            "passes": int(np.sum(np.diff(case.curve.t) > 600.0)) + 1,
            "turns": round(case.turns, 1),
        }
        row |= searched(case)
        if options.fit == "all" or (options.fit == "few" and int(row["rotations"]) <= FEW):
            row |= fitted(case)
        with path.open("a", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            if file.tell() == 0:
                writer.writeheader()
            writer.writerow(row)
        print({k: row[k] for k in COLUMNS if row[k] != ""}, flush=True)
    text = report(list(csv.DictReader(path.open())))
    print(text)
    if options.write:
        command = f"python benchmarks/search.py --first {options.first} --cases {options.cases}"
        command += f" --fit {options.fit}" if options.fit else ""
        write_section("Complete search over constant spins", command, text)


if __name__ == "__main__":
    main()
