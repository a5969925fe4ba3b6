"""Is a scan sure of a wrong period if the times of one curve are wrong, and does it say so?

    python benchmarks/late_curves.py FAULT [N]     none or late; N objects, 16 by default
    python benchmarks/late_curves.py table         into RESULTS.md

Each object is a body of eight unlike octants under the law of Lommel and Seeliger with a tenth of
Lambert's: two to six nights of 1 %, and two surveys of 4 %. Of "late", the times of one curve are
wrong by half an hour to twelve hours. Outcomes are kept in a file of JSON lines in $LCBAYES_SURVEYS
(by default the working folder), and a run that was stopped goes on there.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np
from _asteroids import EARTH_YEAR, Surface, flux, orbits, patches, to_body, unit
from _results import table, write_section
from _surveys import Cadence
from surveys import UNIQUE, curve, keep, stored

from lcbayes.core.constants import HOUR_S
from lcbayes.inversion.attitude_scan import sparse
from lcbayes.inversion.attitude_scan.contradiction import contradiction
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints

FAULTS = ("none", "late")
PERIODS_H = (2.0, 70.0)  # searched; bodies have 3 to 30 h
YEARS, FACETS = 6.3, 900
LATE_H = (0.5, 1.0, 2.0, 12.0)
NIGHT_NOISE, SURVEY_NOISE = 0.01, 0.04  # of the flux
SLOPE = 0.03  # of the phase law, mag per degree


def octants(rng: np.random.Generator) -> Surface:
    """A convex body whose eight octants are parts of ellipsoids with semi-axes of their own."""
    middle = 1.0 / rng.uniform(1.05, 1.6)
    axes, u = np.array([1.0, middle, middle / rng.uniform(1.0, 1.4)]), patches(FACETS)
    axes = np.where(u > 0, axes * rng.uniform(0.8, 1.2, 3), axes * rng.uniform(0.8, 1.2, 3))
    length = np.linalg.norm(u / axes, axis=1)
    areas = length * axes.prod(axis=1)
    return Surface(u * axes, u / axes / length[:, None], areas, np.ones(FACETS))


def drawn(seed: int, fault: str) -> tuple[Cadence, float, int]:
    """The points of an object, its period (h), and the curve with wrong times (−1: none)."""
    rng = np.random.default_rng(seed)
    surface, pole = octants(rng), unit(rng.normal(size=3))
    period = float(np.exp(rng.uniform(np.log(3.0), np.log(30.0))))
    asteroid, earth = orbits(rng)
    day = np.arange(0.0, YEARS * EARTH_YEAR)
    off_sun = np.sum(unit(-earth(day)) * unit(asteroid(day) - earth(day)), axis=1)
    dark, seen = (day[off_sun < np.cos(np.radians(angle))] for angle in (110.0, 70.0))
    times = []
    for night in rng.choice(dark, int(rng.integers(2, 7)), replace=False):
        end = 0.2 + rng.uniform(3.0, 7.0) / 24.0
        times.append(night + np.sort(rng.uniform(0.2, end, int(rng.integers(20, 60)))))
    n_nights = len(times)
    for _ in range(2):
        chosen = rng.choice(seen, int(rng.integers(40, 120)), replace=False)
        times.append(np.sort(chosen + rng.uniform(0.2, 0.45, len(chosen))))
    wrong = int(rng.integers(len(times))) if fault == "late" else -1
    late = rng.choice(LATE_H) * rng.choice([-1.0, 1.0]) / 24.0
    light = []
    for k, t in enumerate(times):
        sun, obs = unit(-asteroid(t)), unit(earth(t) - asteroid(t))
        angle = 2.0 * np.pi * 24.0 * (t - (late if k == wrong else 0.0)) / period
        bright = flux(surface, to_body(sun, pole, angle), to_body(obs, pole, angle))
        alpha = np.degrees(np.arccos(np.clip(np.sum(sun * obs, axis=1), -1.0, 1.0)))
        noise = NIGHT_NOISE if k < n_nights else SURVEY_NOISE
        bright *= 10 ** (-0.4 * SLOPE * alpha) * np.exp(noise * rng.standard_normal(len(t)))
        light.append(bright / bright.mean())
    t = np.concatenate(times)
    number = np.repeat(np.arange(len(times)), [len(x) for x in times])
    sun, obs = -asteroid(t), earth(t) - asteroid(t)
    return Cadence(str(seed), t, sun, obs, np.concatenate(light), number), period, wrong


def outcome(seed: int, fault: str) -> dict[str, Any]:
    data, period_h, wrong = drawn(seed, fault)
    points = SparsePoints.of(curve(data))
    found = sparse.search(points, PERIODS_H)
    against = contradiction(points, found.cells)
    off = abs(found.spins[0].frequency - 1.0 / (HOUR_S * period_h)) * points.span
    return {
        "seed": seed,
        "fault": fault,
        "points": len(data.jd),
        "curves": int(data.curve.max()) + 1,
        "wrong": wrong,
        "probability": found.period_probability,
        "right": bool(off < sparse.SAME_PERIOD),
        "named": [] if against is None else list(against.curves),
        "moved": against is not None and against.moved,
    }


def line(fault: str, rows: list[dict[str, Any]]) -> list[str]:
    sure = [r for r in rows if r["probability"] >= UNIQUE]
    wrong = [r for r in sure if not r["right"]]
    named = [r for r in rows if r["named"]]
    return [
        fault,
        str(len(rows)),
        str(len(named)),
        str(sum(r["named"] == [r["wrong"]] for r in named)),
        str(len(sure)),
        str(len(wrong)),
        str(sum(not r["named"] for r in wrong)),
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=[*FAULTS, "table"])
    parser.add_argument("number", type=int, nargs="?", default=16)
    asked = parser.parse_args()
    if asked.what != "table":
        path, done = stored(f"late-curves-{asked.what}")
        for seed in range(len(done), asked.number):
            row = outcome(5000 + 1000 * FAULTS.index(asked.what) + seed, asked.what)
            keep(path, row)
            print(row, flush=True)
        return
    columns = [
        "times",
        "objects",
        "a curve is named",
        "the one with wrong times",
        f"period P ≥ {UNIQUE}",
        "of these wrong",
        "wrong, and no curve named",
    ]
    text = (
        "Periods of 2 to 70 h; two to six nights and two surveys of a body of eight octants. A "
        "curve is named where an unknown shift of its times raises the evidence by ten nats, or "
        "where another period has a probability of 0.99 without it. Such a result is not "
        "trusted.\n\n"
    )
    rows = [line(fault, stored(f"late-curves-{fault}")[1]) for fault in FAULTS]
    title = "Surveys: a curve with wrong times"
    write_section(title, "python benchmarks/late_curves.py table", text + table(columns, rows))


if __name__ == "__main__":
    main()
