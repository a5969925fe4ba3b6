"""Pole and sidereal period from periods alone, compared with the truth of simulated passes.

    python benchmarks/spin.py            into RESULTS.md (four minutes; --cases N for more)

Boxes spin about an axis a few degrees from one of their own axes, and cylinders end over end; they
are diffuse or have a lobe. Poles are random, periods are from 10 to 50 s, and the orbits are low
and seen from one site. The observations of asteroids are read from $LCBAYES_DATA, else
../shared/data.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # one case per core

import numpy as np
from _results import table, write_section
from scipy.signal import lfilter

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from lcbayes.data.read import read  # noqa: E402
from lcbayes.inversion.spin import Spin, estimate  # noqa: E402
from lcbayes.inversion.spin.detrended import Pass  # noqa: E402
from lcbayes.inversion.spin.mean_frequency import mean_frequency  # noqa: E402
from lcbayes.inversion.spin.sidereal import MEASURABLE, REPEATS  # noqa: E402
from lcbayes.results.reasons import reasons  # noqa: E402
from tests.helpers.low_earth_orbit import spinner, steady  # noqa: E402

PASSES = (2, 4, 6)
NOISES = (20.0, 100.0)  # signal-to-noise ratio of a point, at the mean flux
SHUFFLES = 99


def scored(result: Spin, truth: dict) -> dict:
    """Errors of the heaviest and the nearest solution; whether the region contains the truth."""
    cosine = result.sky.poles @ truth["pole"]  # pyright: ignore[reportOptionalMemberAccess]
    near = int(np.argmax(cosine))
    inside = bool(result.sky.region()[near]) and cosine[near] > np.cos(np.radians(3.0))  # pyright: ignore[reportOptionalMemberAccess]
    away = [np.degrees(np.arccos(np.clip(s.pole @ truth["pole"], -1, 1))) for s in result.solutions]
    best = result.solutions[0]
    return {
        "inside": inside,
        "unique": not result.reasons,
        "first": away[0],
        "nearest": min(away),
        "several": len(away) > 1,
        "period": abs(1 / best.frequency / truth["period"] - 1),
    }


def case(kind: str, snr: float, count: int, i: int) -> tuple[dict | None, float]:
    """Errors of the pole of one simulated object, None if refused; seconds per 1,000 points."""
    curve, truth = spinner(100_000 + 1000 * PASSES.index(count) + i, count, snr, kind)
    begun = time.perf_counter()
    result = estimate(curve, n_shuffles=SHUFFLES, seed=i)
    took = (time.perf_counter() - begun) / curve.n_obs * 1000
    return (scored(result, truth) if result.solutions else None), took


def rows_of(cases: int, pool: Executor) -> tuple[list[list[str]], list[float]]:
    kinds = [(k, s, c) for k in ("box", "cylinder") for s in NOISES for c in PASSES]
    jobs = [[pool.submit(case, *one, i) for i in range(cases)] for one in kinds]
    rows, took = [], []
    for one, job in zip(kinds, jobs, strict=True):
        done = [j.result() for j in job]
        took += [t for _, t in done]
        rows.append(_row(*one, cases, [g for g, _ in done if g is not None]))
        print(*rows[-1], sep="  ", flush=True)
    return rows, took


def _row(kind: str, snr: float, count: int, cases: int, good: list[dict]) -> list[str]:
    head = [kind, f"{snr:g}", str(count), f"{cases - len(good)} of {cases}"]
    if not good:
        return [*head, "–", "–", "–", "–", "–", "–"]

    def middle(name: str) -> float:
        return float(np.median([g[name] for g in good]))

    held = sum(g["inside"] for g in good)
    return [
        *head,
        f"{middle('first'):.1f}",
        f"{middle('nearest'):.1f}",
        f"{held} of {len(good)}",
        f"{100 * middle('period'):.2g}",
        f"{sum(g['several'] for g in good)}",
        f"{sum(g['unique'] for g in good)}",
    ]


def alarm(snr: float, i: int, spinning: bool) -> bool | None:
    """Whether a period is found in noise, or a difference of periods under constant geometry."""
    result = estimate(steady(i, snr, spinning), n_shuffles=SHUFFLES, seed=i)
    met = {c.name: c.met for c in result.conditions}
    return met.get(MEASURABLE) if spinning else met[REPEATS]


def alarms(cases: int, pool: Executor) -> list[list[str]]:
    """Rates of false detections."""
    words = {False: "noise alone: a period", True: "spin under constant geometry: a difference"}
    rows = []
    for snr in NOISES:
        for spinning, what in words.items():
            jobs = [pool.submit(alarm, snr, i, spinning) for i in range(cases)]
            asked = [a for j in jobs if (a := j.result()) is not None]
            rows.append([f"{snr:g}", what, "1 %", f"{sum(asked)} of {len(asked)}"])
    return rows


def repeating(rng: np.random.Generator, drift: float, correlation_s: float) -> tuple[Pass, float]:
    """One pass of 300 s with period 44.33 s, 10 points per second, and its mean frequency, Hz."""
    t = np.linspace(0.0, 300.0, 3000)
    x = t / 150.0 - 1.0
    cycles = (t + drift * 37.5 * (x**2 + (x**3 - 0.6 * x) / 1.5)) / 44.33
    lines = {1: 0.12, 2: 0.25, 3: 0.05, 4: 0.15, 5: 0.03, 8: 0.1}
    y = np.sum([a * np.cos(2 * np.pi * k * cycles + k**2) for k, a in lines.items()], axis=0)
    noise = rng.normal(size=t.size)
    if correlation_s:
        keep = np.exp(-(t[1] - t[0]) / correlation_s)
        noise = np.asarray(lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], noise))
    still = np.tile([0.0, 0.0, 1.0], (t.size, 1))
    one = Pass("", t, np.asarray(y + 0.18 * noise, float), np.full(t.size, 0.18), still, still)
    return one, float(np.polyfit(t, cycles, 1)[0])


def stated_errors(cases: int) -> list[list[str]]:
    """Deviations of mean periods from the truth, divided by their stated errors."""
    rows = []
    for drift, correlation_s in ((0.0, 0.0), (0.01, 0.0), (0.0, 1.0), (0.01, 3.0)):
        rng = np.random.default_rng(0)
        pulls, away, stated = [], [], []
        for _ in range(cases):
            one, truth = repeating(rng, drift, correlation_s)
            result = mean_frequency(one, truth * 1.002, list(range(1, 9)))
            pulls.append((result.frequency - truth) / result.error)
            away.append(result.period - 1.0 / truth)
            stated.append(result.period_error)
        rows.append(
            [
                f"{100 * drift:g} %",
                f"{correlation_s:g}",
                f"{1e3 * np.std(away):.1f}",
                f"{1e3 * np.median(stated):.1f}",
                f"{np.std(pulls):.2f}",
            ]
        )
        print(*rows[-1], sep="  ", flush=True)
    return rows


def asteroids() -> list[list[str]]:
    folder = Path(os.environ.get("LCBAYES_DATA", ROOT.parent / "shared" / "data")) / "damit"
    rows = []
    for name in ("43_Ariadne_rel", "135_Hertha"):
        if not (folder / f"{name}.lcs").exists():
            rows.append([name, "no data here", ""])
            continue
        begun = time.perf_counter()
        result = estimate(read(folder / f"{name}.lcs"), n_shuffles=SHUFFLES)
        said = "; ".join(map(str, reasons(result.reasons))) or "; ".join(
            f"{1 / s.frequency / 3600:.6f} h" for s in result.solutions
        )
        rows.append([name, said, f"{time.perf_counter() - begun:.1f}"])
    return rows


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=9, help="per body, noise and number of passes")
    cases = parser.parse_args().cases
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows, took = rows_of(cases, pool)
        false = alarms(6 * cases, pool)
    text = (
        f"{cases} cases a row. Pole errors are medians over the cases that were given a pole: of "
        "the heaviest solution, and of the nearest of those listed. The 90 % region is that of the "
        "pole alone. Several: cases with more than one solution. Trusted: cases whose period is "
        "unique; the others list candidates.\n\n"
        + table(
            [
                "body",
                "SNR of a point",
                "passes",
                "refused",
                "heaviest (deg)",
                "nearest (deg)",
                "truth in 90 % region",
                "period off (%)",
                "several",
                "trusted",
            ],
            rows,
        )
        + "\n\nFalse alarms.\n\n"
        + table(["SNR", "what", "nominal", "found"], false)
        + f"\n\nTime per 1,000 points: {np.median(took):.2f} s (median), {max(took):.2f} s at most."
        + "\n\nMean period of one pass (44.33 s, noise of 0.18): stated errors, goal 1 ± 0.2.\n\n"
        + table(
            ["drift", "correlation (s)", "scatter (ms)", "stated (ms)", "sd of pulls"],
            stated_errors(30 * cases),
        )
        + "\n\n"
        + table(["asteroid", "what is said", "s"], asteroids())
    )
    write_section("Spin from periods alone", "python benchmarks/spin.py", text)


if __name__ == "__main__":
    main()
