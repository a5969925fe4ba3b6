"""The usual rule of 5 to 10 % with the χ² of the C program, on simulated survey asteroids.

    python benchmarks/period_rule.py PROGRAM FILE [--workers 2]

FILE holds the outcomes of `accelerator.py measure`; PROGRAM is that of `period_scan.py`. All
periods from 2 to 1000 h would take the program hours an object. It tries those about the best of
lcbayes by evidence, and about the true one. A right period that is unique among all would be unique
among these too, so that the number called unique and right is an upper bound.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
from _results import table, write_section
from _surveys import Cadence, Simulated, folder
from period_scan import run, settings
from surveys import RULES, UNIQUE, objects

from lcbayes.core.constants import DAY_S
from lcbayes.inversion.attitude_scan import sparse

PERIODS = 20  # tried, the best by evidence
TURNS = 0.6  # over the data, on either side of each
RANGE_H = (2.0, 1000.0)
COMPLETE = 0.9  # share of the periods, below which an object is counted as one where it stopped


def light_curves(data: Cadence) -> str:
    """In the form of the program, each calibrated as in the inputs of Asteroids@home."""
    lines = [f"{data.curve.max() + 1}"]
    rows = np.column_stack([data.jd, data.flux, data.sun, data.earth])
    for k in range(data.curve.max() + 1):
        mine = rows[data.curve == k]
        lines.append(f"{len(mine)} 0")
        lines += [" ".join(f"{x:.10g}" if i else f"{x:.6f}" for i, x in enumerate(r)) for r in mine]
    return "\n".join(lines) + "\n"


def tried(program: Path, case: Simulated, periods_h: list[float]) -> np.ndarray:
    """Periods (h) and rms (n, 2) of the program about some periods."""
    file, light = folder() / f"period_search_in_{case.data.name}", light_curves(case.data)
    half = TURNS / (np.ptp(case.data.jd) * DAY_S / 3600.0)
    parts = []
    for f in 1.0 / np.unique(periods_h):
        start, end = 1.0 / min(f + half, 1.0 / RANGE_H[0]), 1.0 / max(f - half, 1.0 / RANGE_H[1])
        parts.append(run(program, settings(file, start, end), light)[0])
    return np.concatenate(parts)


def judged(program: Path, case: Simulated, outcome: dict) -> dict:
    """The best period of the program, whether it is right, and by how much its χ² is lower."""
    scan = tried(program, case, [*outcome["rivals_h"][:PERIODS], case.period_h])
    span = np.ptp(case.data.jd) * DAY_S / 3600.0
    best_h, least = scan[np.argmin(scan[:, 1])]
    turns = np.abs(1.0 / scan[:, 0] - 1.0 / best_h) * span
    others = scan[turns >= sparse.SAME_PERIOD, 1]
    off = abs(1.0 / best_h - 1.0 / case.period_h) * span
    margin = 1.0 - (least / others.min()) ** 2 if others.size else 1.0
    return {"right": bool(off < sparse.SAME_PERIOD), "margin": float(margin), "tried": len(scan)}


def main() -> None:
    parser = argparse.ArgumentParser(description="The rule of 5 to 10 % with the C program.")
    parser.add_argument("program", type=Path)
    parser.add_argument("file", type=Path)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rows = [json.loads(line) for line in options.file.read_text(encoding="utf-8").splitlines()]
    outcomes = [r for r in rows if r["part"] == "survey"][-1]["objects"]
    cases, done = objects(len(outcomes)), []
    with ThreadPoolExecutor(options.workers) as pool:
        for row in pool.map(partial(judged, options.program), cases, outcomes):
            done.append(row)
            print(len(done), row, flush=True)
    write(outcomes, done)


def write(outcomes: list[dict], done: list[dict]) -> None:
    """The section of RESULTS.md."""
    called = [o for o in outcomes if o["period_probability"] >= UNIQUE]
    right = sum(o["period_right"] for o in called)
    of = len(outcomes)
    compared = [[f"lcbayes, P ≥ {UNIQUE}", f"{len(called)} of {of}", f"{right} of {len(called)}"]]
    most = max(r["tried"] for r in done)
    whole = [r for r in done if r["tried"] >= COMPLETE * most]
    for rows, where in ((done, ""), (whole, ", without those where it stopped")):
        for share in RULES:
            ruled = [r for r in rows if r["margin"] >= share]
            good = sum(r["right"] for r in ruled)
            name = f"C program, χ² lower by {100 * share:.0f} %{where}"
            compared.append([name, f"{len(ruled)} of {len(rows)}", f"{good} of {len(ruled)}"])
    text = (
        f'{of} objects of "Surveys: calibration". The program tries the {PERIODS} best periods by '
        f"the evidence of lcbayes and the true one, each with {2 * TURNS:g} turns over the data "
        f"(at most {most} periods an object), with the settings of the inputs, and a period is "
        "called unique if its χ² is 5 or 10 % below that of every other at least one turn away. "
        "The true period is always tried, and among all periods from 2 to 1000 h it has more "
        "rivals, so that no more could be called unique and be right. At a singular matrix the "
        f"program stops, and the later periods of that window are missing: in {of - len(whole)} "
        f"objects more than {100 * (1 - COMPLETE):.0f} % of all. Its best period is right in "
        f"{sum(r['right'] for r in done)} of {of}, that of lcbayes in "
        f"{sum(o['period_right'] for o in outcomes)}.\n\n"
    )
    write_section(
        "Surveys: the rule of the C program",
        "python benchmarks/period_rule.py PROGRAM FILE",
        text + table(["rule", "called unique", "right"], compared),
    )


if __name__ == "__main__":
    main()
