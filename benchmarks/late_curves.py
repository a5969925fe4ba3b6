"""Is a scan sure of a wrong period if the times of one curve are wrong, and does it say so?

    python benchmarks/late_curves.py FAULT [N]     none or late; N objects, 16 by default
    python benchmarks/late_curves.py table         into RESULTS.md

Each object is a body of eight unlike octants under the law of Lommel and Seeliger with a tenth of
Lambert's: two to six nights of 1 %, and two surveys of 4 %. Of "late", the times of one curve are
wrong by half an hour to twelve hours. Plain NumPy makes the light. Outcomes are kept in a file of
JSON lines in $LCBAYES_SURVEYS (by default the working folder), and a run that was stopped goes on
there.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from _results import table, write_section
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import sparse
from lcbayes.inversion.attitude_scan.contradiction import contradiction
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints

Floats = NDArray[np.float64]

FAULTS = ("none", "late")
PERIODS_H = (2.0, 70.0)  # searched; bodies have 3 to 30 h
UNIQUE = 0.99
YEAR, DAYS, FACETS = 365.25, 2300, 900
LATE_H = (0.5, 1.0, 2.0, 12.0)


def unit(v: Floats) -> Floats:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


class Body:
    """Facets of eight octants with semi-axes of their own, and a spin, drawn from a seed."""

    def __init__(self, rng: np.random.Generator) -> None:
        i = np.arange(FACETS) + 0.5
        z, around = 1 - 2 * i / FACETS, np.pi * (1 + 5**0.5) * i
        flat = np.sqrt(1 - z * z)
        point = np.stack([flat * np.cos(around), flat * np.sin(around), z], 1)
        middle = 1.0 / rng.uniform(1.05, 1.6)
        axes = np.array([1.0, middle, middle / rng.uniform(1.0, 1.4)])
        axes = np.where(point > 0, axes * rng.uniform(0.8, 1.2, 3), axes * rng.uniform(0.8, 1.2, 3))
        length = np.linalg.norm(point / axes, axis=1)
        self.normals, self.areas = point / axes / length[:, None], length * axes.prod(1)
        self.period_h = float(np.exp(rng.uniform(np.log(3.0), np.log(30.0))))
        pole = unit(rng.normal(size=3))
        x = unit(np.cross(pole, [0.0, 0.0, 1.0]))
        self.tilt = np.stack([x, np.cross(pole, x), pole], 1)
        self.axis, self.tilted = rng.uniform(2.2, 3.1), np.radians(rng.uniform(1.0, 20.0))
        self.start = rng.uniform(0.0, 2.0 * np.pi)

    def directions(self, day: Floats) -> tuple[Floats, Floats]:
        """Vectors (T, 3) to Sun and Earth, au."""
        mean = 2 * np.pi * day / (YEAR * self.axis**1.5) + self.start
        flat, high = np.cos(self.tilted), np.sin(self.tilted)
        asteroid = self.axis * np.stack(
            [np.cos(mean), np.sin(mean) * flat, np.sin(mean) * high], -1
        )
        home = 2 * np.pi * day / YEAR + 0.3
        return -asteroid, np.stack([np.cos(home), np.sin(home), 0 * home], -1) - asteroid

    def flux(self, day: Floats, seen: Floats) -> Floats:
        """Brightness (T,) of the attitude at ``day``, from the directions at ``seen``."""
        angle = 2 * np.pi * day * 24.0 / self.period_h
        cos, sin = np.cos(angle), np.sin(angle)
        light = []
        for vector in self.directions(seen):
            x, y, z = (unit(vector) @ self.tilt).T
            body = np.stack([cos * x + sin * y, cos * y - sin * x, z], 1)
            light.append(np.maximum(body @ self.normals.T, 0.0))
        sun, obs = light
        return (sun * obs / np.maximum(sun + obs, 1e-9) + 0.1 * sun * obs) @ self.areas


def drawn(seed: int, fault: str) -> tuple[LightCurve, Body, int]:
    """A light curve, its body, and the curve with wrong times (−1: none)."""
    rng = np.random.default_rng(seed)
    body, day = Body(rng), np.arange(0.0, DAYS)
    sun, obs = body.directions(day)
    elongation = np.degrees(np.arccos(np.sum(unit(sun - obs) * unit(-obs), axis=-1)))
    nights = rng.choice(day[elongation > 110], int(rng.integers(2, 7)), replace=False)
    times = []
    for night in nights:
        end = 0.2 + rng.uniform(3.0, 7.0) / 24.0
        times.append(night + np.sort(rng.uniform(0.2, end, int(rng.integers(20, 60)))))
    for _ in range(2):
        chosen = rng.choice(day[elongation > 70], int(rng.integers(40, 120)), replace=False)
        times.append(np.sort(chosen + rng.uniform(0.2, 0.45, len(chosen))))
    wrong = int(rng.integers(len(times))) if fault == "late" else -1
    off = rng.choice(LATE_H) * rng.choice([-1.0, 1.0]) / 24.0
    flux = []
    for k, t in enumerate(times):
        light = body.flux(t + (off if k == wrong else 0.0), t)
        s, o = (unit(v) for v in body.directions(t))
        light = light * 10 ** (-0.012 * np.degrees(np.arccos(np.clip(np.sum(s * o, 1), -1, 1))))
        light *= np.exp((0.01 if k < len(nights) else 0.04) * rng.standard_normal(len(t)))
        flux.append(light / light.mean())
    t = np.concatenate(times)
    sun, obs = map(unit, body.directions(t))
    curve = LightCurve(
        t=DAY_S * t,
        brightness=np.concatenate(flux),
        error=None,
        sun=sun,
        obs=obs,
        kind="flux",
        curve=np.repeat(np.arange(len(times)), [len(x) for x in times]),
        free_scale=np.ones(len(times), bool),
        frame="ecliptic-j2000",
    )
    return curve, body, wrong


def outcome(seed: int, fault: str) -> dict[str, Any]:
    curve, body, wrong = drawn(seed, fault)
    points = SparsePoints.of(curve)
    begun = time.process_time()
    found = sparse.search(points, PERIODS_H)
    searched = time.process_time()
    against = contradiction(points, found.cells)
    off = abs(found.spins[0].frequency - 1.0 / (HOUR_S * body.period_h)) * points.span
    return {
        "seed": seed,
        "fault": fault,
        "points": curve.n_obs,
        "curves": curve.n_curves,
        "wrong": wrong,
        "probability": found.period_probability,
        "right": bool(off < 1.0),
        "named": -1 if against is None else against.curve,
        "late": against is not None and against.late,
        "search_s": searched - begun,
        "curves_s": time.process_time() - searched,
    }


def stored(fault: str) -> tuple[Path, list[dict[str, Any]]]:
    path = Path(os.environ.get("LCBAYES_SURVEYS", ".")) / f"late-curves-{fault}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return path, [json.loads(line) for line in lines]


def line(fault: str, rows: list[dict[str, Any]]) -> list[str]:
    sure = [r for r in rows if r["probability"] >= UNIQUE]
    wrong = [r for r in sure if not r["right"]]
    named = [r for r in sure if r["named"] >= 0]
    return [
        fault,
        str(len(rows)),
        str(len(sure)),
        str(len(wrong)),
        str(sum(r["named"] >= 0 for r in wrong)),
        str(sum(r["right"] for r in named)),
        str(sum(r["named"] == r["wrong"] for r in named)),
        f"{np.median([r['search_s'] for r in rows]):.0f}",
        f"{np.median([r['curves_s'] for r in rows]):.1f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=[*FAULTS, "table"])
    parser.add_argument("number", type=int, nargs="?", default=16)
    asked = parser.parse_args()
    if asked.what != "table":
        path, done = stored(asked.what)
        for seed in range(len(done), asked.number):
            row = outcome(5000 + 1000 * FAULTS.index(asked.what) + seed, asked.what)
            with path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
            print(row, flush=True)
        return
    columns = [
        "times",
        "objects",
        f"period P ≥ {UNIQUE}",
        "of these wrong",
        "of the wrong: a curve named",
        "of the right: a curve named",
        "named is the one with wrong times",
        "search, CPU s",
        "curves left out, CPU s",
    ]
    text = (
        "Periods of 2 to 70 h; two to six nights and two surveys of a body of eight octants. The "
        "times include compilation. A curve is named where another period has a probability of "
        "0.99 without it; such a result is not trusted.\n\n"
    )
    rows = [line(fault, stored(fault)[1]) for fault in FAULTS]
    title = "Surveys: a curve with wrong times"
    write_section(title, "python benchmarks/late_curves.py table", text + table(columns, rows))


if __name__ == "__main__":
    main()
