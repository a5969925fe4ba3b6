"""Surveys, searches and particles on a GPU and on the CPU: the same code, time and results.

    python benchmarks/accelerator.py measure FILE [--objects 200] [--threads 2] [--parts survey,...]
    python benchmarks/accelerator.py report GPU-FILE CPU-FILE

The first runs on the machine to be measured, on the device that JAX chooses, and writes JSON lines.
The second writes the section of RESULTS.md. Objects are those of `surveys.py calibration`. Needs
the Asteroids@home inputs, as that does.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from _results import table, write_section
from _surveys import Simulated
from smc import problem_of
from surveys import RIVALS, UNIQUE, curve, objects
from tumbling import Drawn

from lcbayes.core.constants import HOUR_S
from lcbayes.core.jax_setup import jax
from lcbayes.inference.annealed_search import WHOLE
from lcbayes.inference.tumbling_search import STARTS
from lcbayes.inversion.attitude_scan import evidence, sparse
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.samplers import smc

TUMBLERS = (27, 30)  # seeds; the first time includes compilation
PARTICLES = 10_000

Row = dict[str, Any]


def timed(function: Callable[[], Any]) -> tuple[Any, float]:
    begun = time.monotonic()
    return function(), time.monotonic() - begun


def searched(case: Simulated) -> Row:
    """What the search says of an object, and the periods of the best evidence."""
    points = SparsePoints.of(curve(case.data))
    found, seconds = timed(lambda: sparse.search(points))
    best = evidence.best_of_periods(found.cells, points.span, RIVALS, 1)
    turns = abs(found.spins[0].frequency - 1.0 / (HOUR_S * case.period_h)) * points.span
    return {
        "seconds": seconds,
        "found_h": 1.0 / (HOUR_S * found.spins[0].frequency),
        "period_probability": found.period_probability,
        "period_right": turns < sparse.SAME_PERIOD,
        "rivals_h": [1.0 / (HOUR_S * f) for f in found.cells.frequency[np.concatenate(best)]],
    }


def survey(number: int, threads: int) -> Iterator[Row]:
    """All objects on some threads, after a tenth of them on one, and one of each shape before."""
    cases, shapes = objects(number), {}
    for case in cases:
        points = SparsePoints.of(curve(case.data))
        shapes.setdefault((points.night.shape, points.group.shape), case)
    _, compiled = timed(lambda: [searched(case) for case in shapes.values()])
    yield {"part": "compilation", "shapes": len(shapes), "seconds": compiled}
    for n, some in ((1, cases[: -(-number // 10)]), (threads, cases)):
        with ThreadPoolExecutor(n) as pool:
            found, seconds = timed(lambda pool=pool, some=some: list(pool.map(searched, some)))
        yield {"part": "survey", "threads": n, "seconds": seconds, "objects": found}
        print(f"{n} threads: {3600 * len(some) / seconds:.0f} objects an hour", flush=True)


def tumblers() -> Iterator[Row]:
    """One search for each body, against the optimum reached from the truth."""
    for seed in TUMBLERS:
        body = Drawn.of(seed)
        ends, seconds = timed(partial(body.searched, WHOLE, 2 * seed))
        above = float(ends.potential[0]) - body.best
        yield {"part": "tumbler", "seed": seed, "seconds": seconds, "above": above}


def particles() -> Iterator[Row]:
    """Those of one facet, twice: the first time with compilation."""
    problem, data = problem_of("one-facet", n_facets=1, spin="none")
    for key in range(2):
        run, seconds = timed(partial(smc.run, problem, data, jax.random.key(key), PARTICLES))
        yield {
            "part": "particles",
            "key": key,
            "seconds": seconds,
            "gradients": run.gradients,
            "log_evidence": run.log_evidence,
        }


def measure(path: Path, number: int, threads: int, parts: list[str]) -> None:
    device = jax.devices()[0]
    head = {"part": "machine", "device": device.device_kind, "platform": device.platform}
    head |= {"cores": len(os.sched_getaffinity(0)), "jax": jax.__version__}
    every = {"survey": partial(survey, number, threads), "tumblers": tumblers}
    every |= {"particles": particles}
    with path.open("w", encoding="utf-8", buffering=1) as file:
        for row in chain([head], *(every[name]() for name in parts)):
            file.write(json.dumps(row) + "\n")
            print({k: v for k, v in row.items() if k != "objects"}, flush=True)


def with_compilation(i: int) -> str:
    return "" if i else ", with compilation"


def report(gpu: Path, cpu: Path) -> None:
    """The section of RESULTS.md from the outcomes of a GPU and of a CPU."""
    machines = [
        [json.loads(x) for x in p.read_text(encoding="utf-8").splitlines()] for p in (gpu, cpu)
    ]
    head = [m[0] for m in machines]
    names = [head[0]["device"], f"{head[1]['cores']} cores of a CPU"]
    rows = []

    def of(part: str, **known: Any) -> list[list[Row]]:
        return [
            [r for r in m if r["part"] == part and all(r[k] == v for k, v in known.items())]
            for m in machines
        ]

    compiled = [c[0] for c in of("compilation")]
    rows.append(
        ["first object of each shape, with compilation (s)"]
        + [f"{c['seconds']:.0f} ({c['shapes']} shapes)" for c in compiled]
    )
    surveys = of("survey")
    for name, at in (("one thread", 0), ("several threads", -1)):
        rows.append([f"objects an hour, {name}"])
        for each in surveys:
            run = each[at]
            many = len(run["objects"])
            rows[-1].append(
                f"{3600 * many / run['seconds']:,.0f} ({many} objects, {run['threads']} threads)"
            )
    for i, seed in enumerate(TUMBLERS):
        found = [r[0] for r in of("tumbler", seed=seed)]
        rows.append(
            [f"search of {STARTS:,} starts, tumbler {seed}{with_compilation(i)} (s)"]
            + [f"{r['seconds']:.1f} ({r['above']:+.2f} nats from the best)" for r in found]
        )
    for key in range(2):
        found = [r[0] for r in of("particles", key=key)]
        rows.append(
            [f"{PARTICLES:,} particles of one facet{with_compilation(key)} (s)"]
            + [f"{r['seconds']:.0f} (ln Z {r['log_evidence']:.2f})" for r in found]
        )
    pairs = list(zip(surveys[0][-1]["objects"], surveys[1][-1]["objects"], strict=False))
    same = sum(abs(a["found_h"] / b["found_h"] - 1.0) < 1e-6 for a, b in pairs)
    off = max(abs(a["period_probability"] - b["period_probability"]) for a, b in pairs)
    every = surveys[0][-1]["objects"]
    called = [o for o in every if o["period_probability"] >= UNIQUE]
    text = (
        f"The same code on one {names[0]} ({head[0]['cores']} cores beside it, JAX "
        f"{head[0]['jax']}) and on {names[1]} (JAX {head[1]['jax']}). Objects and their search are "
        f'those of "Surveys: calibration". Of the {len(pairs)} objects that both have searched, '
        f"the best period is the same in {same}, and its probability differs by at most {off:.1g}. "
        f"On the GPU, {len(called)} of {len(every)} are called unique at P ≥ {UNIQUE}, and "
        f"{sum(o['period_right'] for o in called)} of these are right.\n\n"
    )
    write_section(
        "Surveys: one GPU beside a CPU",
        "python benchmarks/accelerator.py report GPU-FILE CPU-FILE",
        text + table(["what", *names], rows),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure surveys, searches and particles.")
    what = parser.add_subparsers(dest="what", required=True)
    of = what.add_parser("measure")
    of.add_argument("file", type=Path)
    of.add_argument("--objects", type=int, default=200)
    of.add_argument("--threads", type=int, default=2)
    of.add_argument("--parts", default="survey,tumblers,particles")
    of = what.add_parser("report")
    of.add_argument("gpu", type=Path)
    of.add_argument("cpu", type=Path)
    options = parser.parse_args()
    if options.what == "report":
        return report(options.gpu, options.cpu)
    return measure(options.file, options.objects, options.threads, options.parts.split(","))


if __name__ == "__main__":
    main()
