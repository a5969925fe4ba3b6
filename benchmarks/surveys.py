"""Survey asteroids: is a probability of 0.99 right in 99 of 100, and the fifty real ones.

    python benchmarks/surveys.py [calibration N] [real]     into RESULTS.md

Needs the Asteroids@home inputs in $LCBAYES_DATA/sparse-survey or ../shared/data/sparse-survey.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
from _asteroids import unit
from _results import table, write_section
from _surveys import KINDS, Cadence, Simulated, draw, folder, read_cadence

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import sparse
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints

UNIQUE = 0.99
LONGEST_NIGHT = 8.0  # points a night, on average, of a cadence of sparse points alone


def curve(data: Cadence) -> LightCurve:
    return LightCurve(
        t=DAY_S * (data.jd - np.floor(data.jd.min())),
        brightness=data.flux,
        error=None,
        sun=unit(data.sun),
        obs=unit(data.earth),
        kind="flux",
        curve=data.curve,
        free_scale=np.ones(data.curve.max() + 1, bool),
        frame="ecliptic-j2000",
    )


def cadences() -> list[Cadence]:
    """The cadences of sparse points alone."""
    every = [read_cadence(path) for path in sorted(folder().glob("period_search_in_*"))]
    return [c for c in every if sparse.is_sparse(curve(c))]


def outcome(case: Simulated) -> dict[str, object]:
    """What the search says of a simulated object, and whether it is right."""
    begun, cpu = time.perf_counter(), time.process_time()
    points = SparsePoints.of(curve(case.data))
    found = sparse.search(points)
    best, truth = found.spins[0], 1.0 / (HOUR_S * case.period_h)
    turns = [abs(s.frequency - truth) * points.span for s in found.spins]
    off = [float(np.degrees(np.arccos(np.clip(s.pole @ case.pole, -1, 1)))) for s in found.spins]
    pair = [t < 1.0 and o < sparse.SAME_POLE for t, o in zip(turns, off, strict=True)]
    return {
        "cadence": case.data.name,
        "kind": case.kind,
        "period_h": case.period_h,
        "found_h": 1.0 / (HOUR_S * best.frequency),
        "noise": case.noise,
        "amplitude": case.amplitude,
        "period_probability": found.period_probability,
        "period_right": turns[0] < sparse.SAME_PERIOD,
        "pole_probability": best.probability,
        "pole_right": pair[0],
        "listed": any(pair),
        "probability_listed": float(sum(s.probability for s in found.spins)),
        "wall_s": time.perf_counter() - begun,
        "cpu_s": time.process_time() - cpu,
    }


def simulate(number: int, first: int, store: Path) -> list[dict[str, object]]:
    """Outcomes of simulated objects; those already stored are not computed again."""
    every = cadences()
    rows = [json.loads(line) for line in store.read_text().splitlines()] if store.exists() else []
    for i in range(first + len(rows), first + number):
        cadence, kind = every[i % len(every)], KINDS[i % len(KINDS)]
        rows.append(outcome(draw(cadence, kind, i)))
        with store.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
    return rows
