"""Survey asteroids: is a probability of 0.99 right in 99 of 100, and the fifty real ones.

    python benchmarks/surveys.py calibration [N]     N simulated objects
    python benchmarks/surveys.py real [N]            the first N real objects

Each writes a section of RESULTS.md, with the load of the machine at the end.
Needs the Asteroids@home inputs in $LCBAYES_DATA/sparse-survey or ../shared/data/sparse-survey.
Outcomes are kept in a file of JSON lines in $LCBAYES_SURVEYS (by default the working folder), and a
run that was stopped goes on there.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from _asteroids import Floats, unit
from _results import table, write_section
from _surveys import KINDS, Cadence, Simulated, draw, folder, read_cadence

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import evidence, maxima, sparse
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints, shape_columns
from lcbayes.inversion.attitude_scan.periodogram import weights
from lcbayes.inversion.attitude_scan.shape_classes import prior
from lcbayes.inversion.attitude_scan.spin import tilts

UNIQUE = 0.99
BINS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, UNIQUE, 1.01)
SEED = 9200  # of the first simulated object; smaller ones served to develop or measure before
RULES = (0.05, 0.1)  # least difference of chi2 between the best period and every other
RIVALS = 300  # periods, the best by evidence, whose chi2 is compared
MISSED = 1.0  # nats; a maximum at the truth that is higher by more was missed
LISTED = 3  # solutions of a real object in the table

Rows = list[dict[str, Any]]


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


def outcome(case: Simulated) -> dict[str, Any]:
    """What the search says of a simulated object, and whether it is right."""
    begun, cpu = time.perf_counter(), time.process_time()
    points = SparsePoints.of(curve(case.data))
    found = sparse.search(points)
    best, truth = found.spins[0], 1.0 / (HOUR_S * case.period_h)
    turns = [abs(s.frequency - truth) * points.span for s in found.spins]
    off = [float(np.degrees(np.arccos(np.clip(s.pole @ case.pole, -1, 1)))) for s in found.spins]
    cpu_s, wall_s = time.process_time() - cpu, time.perf_counter() - begun
    rule_hz, margin = rule(points, found)
    pair = [t < 1.0 and o < sparse.SAME_POLE for t, o in zip(turns, off, strict=True)]
    return {
        "cadence": case.data.name,
        "kind": case.kind,
        "period_h": case.period_h,
        "found_h": 1.0 / (HOUR_S * best.frequency),
        "noise": case.noise,
        "amplitude": case.amplitude,
        "period_probability": found.period_probability,
        "turns_off": turns[0],
        "period_right": turns[0] < sparse.SAME_PERIOD,
        "pole_probability": best.probability,
        "pole_right": pair[0],
        **offsets(best.pole, case.pole),
        "truth_above": at_truth(points, case.pole, truth) - float(found.cells.log_evidence.max()),
        "listed": any(pair),
        "probability_listed": float(sum(s.probability for s in found.spins)),
        "wall_s": wall_s,
        "cpu_s": cpu_s,
        "rule_margin": margin,
        "rule_right": abs(rule_hz - truth) * points.span < sparse.SAME_PERIOD,
    }


def offsets(pole: Floats, true: Floats) -> dict[str, float]:
    """Degrees from a pole to the true one, and to those that often explain the same data: at the
    opposite longitude, and at the opposite latitude."""
    signs = {"off": (1, 1, 1), "off_opposite_longitude": (-1, -1, 1), "off_flipped": (1, 1, -1)}
    return {
        name: float(np.degrees(np.arccos(np.clip(pole @ (true * sign), -1, 1))))
        for name, sign in signs.items()
    }


def at_truth(points: SparsePoints, pole: Floats, frequency: float) -> float:
    """ln of the evidence by class at the maximum uphill of the true spin."""
    given = pole[None], np.array([frequency])
    noise = maxima.Noise.of(points, evidence.fits(points, *given))
    ends = maxima.ascended(points, *given, noise)
    return float(max(evidence.by_class(points, *spin)[0] for spin in (given, ends)))


def rule(points: SparsePoints, found: sparse.SparseSearch) -> tuple[float, float]:
    """Frequency of the period with the least χ² of the linear model, and the share by which it is
    below that of every other period: the usual rule, with this model in place of a convex body."""
    rows = np.concatenate(evidence.best_of_periods(found.cells, points.span, RIVALS, 2))
    of, w = found.cells.rows(rows), weights(points)
    known, chi2 = prior(points.group.shape[1]), []
    for tilt, f in zip(tilts(of.pole), of.frequency, strict=True):
        shape = shape_columns(points.bisector, points.across, tilt, points.t * f)
        x = np.concatenate([points.fixed, np.asarray(shape)], axis=1)
        matrix = x.T @ (w[:, None] * x) + known.precision
        fit = np.linalg.solve(matrix, x.T @ (w * points.log_flux) + known.precision @ known.mean)
        chi2.append(float(w @ (points.log_flux - x @ fit) ** 2))
    best = of.frequency[int(np.argmin(chi2))]
    others = np.abs(of.frequency - best) * points.span >= sparse.SAME_PERIOD
    return float(best), 1.0 - min(chi2) / float(np.min(np.array(chi2)[others]))


def load() -> str:
    """The load of the machine in words; two cores are busy with one run at a load of two."""
    one, _, fifteen = os.getloadavg()
    return f"{one:.1f} (15 minutes: {fifteen:.1f})"


def stored(name: str) -> tuple[Path, Rows]:
    """The file of outcomes, and those that it holds."""
    path = Path(os.environ.get("LCBAYES_SURVEYS", ".")) / f"surveys-{name}.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return path, [json.loads(line) for line in lines]


def keep(path: Path, row: dict[str, Any]) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def objects(number: int) -> list[Simulated]:
    """Simulated objects: all kinds of bodies at all cadences in turn."""
    every, seeds = cadences(), range(SEED, SEED + number)
    return [draw(every[i % len(every)], KINDS[i % len(KINDS)], i) for i in seeds]


def simulate(number: int) -> Rows:
    """Outcomes of simulated objects."""
    path, rows = stored("calibration")
    for case in objects(number)[len(rows) :]:
        rows.append(outcome(case))
        keep(path, rows[-1])
    return rows[:number]


def reliability(rows: Rows, probability: str, right: str) -> list[list[str]]:
    """Number, mean probability and share right of the objects in each bin of probability."""
    p = np.array([r[probability] for r in rows])
    good = np.array([r[right] for r in rows])
    out = []
    for low, high in pairwise(BINS):
        here = (p >= low) & (p < high)
        if here.any():
            bounds = f"{low:g} to {min(high, 1.0):g}"
            cells = [f"{p[here].mean():.3f}", f"{int(good[here].sum())} of {int(here.sum())}"]
            out.append([bounds, str(int(here.sum())), *cells])
    return out


def wrong_poles(rows: Rows) -> str:
    """Where the wrong poles are that were called unique."""
    heads = ["body", "turns off", "off", "opposite longitude", "flipped latitude", "truth above"]
    cells = [
        [
            r["kind"],
            f"{r['turns_off']:.2f}",
            f"{r['off']:.0f}",
            f"{r['off_opposite_longitude']:.0f}",
            f"{r['off_flipped']:.0f}",
            f"{r['truth_above']:.1f}",
        ]
        for r in rows
    ]
    return (
        "Wrong poles called unique: turns over the data between the periods, degrees from the true "
        "pole and from two others that often explain the same data, and nats by which the true "
        "spin is above the best that was found.\n\n" + table(heads, cells)
    )


def calibration(number: int) -> None:
    rows = simulate(number)
    called = [r for r in rows if r["period_probability"] >= UNIQUE]
    right = sum(r["period_right"] for r in called)
    poles = [r for r in rows if r["pole_probability"] >= UNIQUE]
    of_pole = ", ".join(
        f"{kind} {sum(r['pole_right'] for r in poles if r['kind'] == kind)} of "
        f"{sum(r['kind'] == kind for r in poles)}"
        for kind in KINDS
    )
    wrong = [r for r in poles if not r["pole_right"]]
    kinds = ", ".join(
        f"{kind} {sum(r['kind'] == kind for r in called)} of {sum(r['kind'] == kind for r in rows)}"
        for kind in KINDS
    )
    compared = [[f"P ≥ {UNIQUE}", f"{len(called)} of {len(rows)}", f"{right} of {len(called)}"]]
    for share in RULES:
        ruled = [r for r in rows if r["rule_margin"] >= share]
        good = sum(r["rule_right"] for r in ruled)
        cells = [f"{len(ruled)} of {len(rows)}", f"{good} of {len(ruled)}"]
        compared.append([f"χ² lower by {100 * share:.0f} %", *cells])
    text = (
        f"{len(rows)} simulated objects at the epochs of {len(cadences())} real ones (about 100 "
        "points of 25 nights in years): ellipsoids, convex hulls with hills, "
        "bricks (b/a 0.6 to 0.85), contact binaries with shadows, ellipsoids with a dark spot. "
        "Poles isotropic, periods near 8 h with a fifth from 20 to 900 h, noise 0.5 to 5 %, up to "
        "3 % common to a night, 2 % of points five times as bad, phase laws drawn anew. The "
        "simulator shares no code with the package. Search: 2 to 1000 h. A period is right "
        "within one turn over the data, a spin if its pole is also within "
        f"{sparse.SAME_POLE:g} degrees.\n\n"
        f"Seeds {SEED} to {SEED + len(rows) - 1}. Called unique, by body: {kinds}. The usual rule "
        "calls a period unique whose χ² is 5 or 10 % below that of every other; here it is that of "
        "the linear model, and not of a convex body. The period is right in "
        f"{sum(r['period_right'] for r in rows)} of all {len(rows)}. Processor time of an object: "
        f"{np.median([r['cpu_s'] for r in rows]):.1f} s (median). Load at the end: {load()}.\n\n"
        f"Poles called unique, right by body: {of_pole}. In "
        f"{sum(r['truth_above'] > MISSED for r in rows)} of all {len(rows)} objects the search "
        "missed the maximum at the true spin, which has more evidence than any that was found, by "
        f"more than {MISSED:g} nat.\n\n"
    )
    if wrong:
        text += wrong_poles(wrong) + "\n\n"
    text += table(["rule", "called unique", "right"], compared) + "\n\n"
    heads = ["P of the period", "objects", "mean P", "right"]
    text += table(heads, reliability(rows, "period_probability", "period_right")) + "\n\n"
    heads = ["P of pole and period", "objects", "mean P", "right"]
    text += table(heads, reliability(rows, "pole_probability", "pole_right"))
    print(text)
    write_section(
        "Surveys: calibration", f"python benchmarks/surveys.py calibration {number}", text
    )


def real(number: int) -> None:
    """The search of the first real objects, with sparse points alone or with dense curves too."""
    path, done = stored("real")
    files = sorted(folder().glob("period_search_in_*"))
    for file in files[len(done) : number]:
        data = read_cadence(file)
        given = curve(data)
        begun, cpu = time.perf_counter(), time.process_time()
        points = SparsePoints.of(given)
        found = sparse.search(points)
        row = {
            "name": data.name,
            "points": given.n_obs,
            "curves": given.n_curves,
            "sparse": sparse.is_sparse(given),
            "period_probability": found.period_probability,
            "spins": [
                (1.0 / (HOUR_S * s.frequency), *_lon_lat(list(s.pole)), s.probability)
                for s in found.spins[:LISTED]
            ],
            "wall_s": time.perf_counter() - begun,
            "cpu_s": time.process_time() - cpu,
        }
        done.append(row)
        keep(path, row)
    unique = [r for r in done if r["period_probability"] >= UNIQUE]
    few = [r for r in done if r["sparse"]]
    text = (
        f"{len(done)} of {len(files)} inputs of Asteroids@home, 2 to 1000 h, the most probable "
        "solution of each. "
        f"{len(few)} have sparse points alone; the others have dense curves too, and for these the "
        "scan fits bodies unless a periodogram is asked for. No published answers come with the "
        f"files. Unique at P ≥ {UNIQUE}: {len(unique)} of {len(done)} "
        f"({sum(r['sparse'] for r in unique)} of {len(few)} sparse). Processor time, median: "
        f"{np.median([r['cpu_s'] for r in done]):.1f} s an object. Load at the end: {load()}.\n\n"
    )
    heads = ["object", "points", "curves", "P of period", "period, h", "pole", "P", "CPU, s"]
    rows = [
        [
            r["name"],
            str(r["points"]),
            str(r["curves"]),
            f"{r['period_probability']:.3f}",
            f"{r['spins'][0][0]:.5f}",
            f"({r['spins'][0][1]:.0f}, {r['spins'][0][2]:+.0f})",
            f"{r['spins'][0][3]:.3f}",
            f"{r['cpu_s']:.1f}",
        ]
        for r in sorted(done, key=lambda r: -r["period_probability"])
    ]
    print(text + table(heads, rows))
    write_section(
        "Surveys: real objects", "python benchmarks/surveys.py real", text + table(heads, rows)
    )


def _lon_lat(v: Sequence[float]) -> tuple[float, float]:
    return float(np.degrees(np.arctan2(v[1], v[0])) % 360), float(np.degrees(np.arcsin(v[2])))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Measure the search of sparse points.")
    parser.add_argument("what", choices=["calibration", "real"])
    parser.add_argument("number", type=int, nargs="?", help="of objects: 200, or all real ones")
    options = parser.parse_args()
    if options.what == "real":
        real(options.number or 1000)
    else:
        calibration(options.number or 200)
