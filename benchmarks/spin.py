"""Pole and sidereal period from periods alone, against the truth of simulated passes.

    python benchmarks/spin.py            into RESULTS.md (four minutes; --cases N for more)

Boxes about an axis within some degrees of one of their own, and cylinders end over end, diffuse or
with a lobe, poles anywhere, periods from 10 to 50 s, on low orbits over one site. The observations
of asteroids are read from $LCBAYES_DATA, else ../shared/data.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # a case per core

import numpy as np
from _results import table, write_section

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from leo import spinner, steady  # noqa: E402

from lcbayes.data.read import read  # noqa: E402
from lcbayes.inversion.spin import Spin, estimate  # noqa: E402
from lcbayes.inversion.spin.sidereal import MEASURABLE, REPEATS  # noqa: E402

PASSES = (2, 4, 6)
NOISES = (20.0, 100.0)  # signal over noise of a point, of the mean flux
SHUFFLES = 99


def judged(found: Spin, truth: dict) -> dict:
    """Errors of the heaviest solution and of the nearest; whether the region holds the truth."""
    cosine = found.sky.poles @ truth["pole"]  # pyright: ignore[reportOptionalMemberAccess]
    near = int(np.argmax(cosine))
    inside = bool(found.sky.region()[near]) and cosine[near] > np.cos(np.radians(3.0))  # pyright: ignore[reportOptionalMemberAccess]
    away = [np.degrees(np.arccos(np.clip(s.pole @ truth["pole"], -1, 1))) for s in found.solutions]
    best = found.solutions[0]
    return {
        "inside": inside,
        "first": away[0],
        "nearest": min(away),
        "several": len(away) > 1,
        "period": abs(1 / best.frequency / truth["period"] - 1),
    }


def case(kind: str, snr: float, count: int, i: int) -> tuple[dict | None, float]:
    """One simulated object: what is wrong with its pole, None where it is refused; s per 1,000."""
    curve, truth = spinner(100_000 + 1000 * PASSES.index(count) + i, count, snr, kind)
    begun = time.perf_counter()
    found = estimate(curve, n_shuffles=SHUFFLES, seed=i)
    took = (time.perf_counter() - begun) / curve.n_obs * 1000
    return (None if found.reasons else judged(found, truth)), took


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
        return [*head, "–", "–", "–", "–", "–"]

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
    ]


def alarm(snr: float, i: int, spinning: bool) -> bool | None:
    """Whether noise has a period, or a spin that nothing moves about a difference of periods."""
    found = estimate(steady(i, snr, spinning), n_shuffles=SHUFFLES, seed=i)
    met = {c.name: c.met for c in found.conditions}
    return met.get(MEASURABLE) if spinning else met[REPEATS]


def alarms(cases: int, pool: Executor) -> list[list[str]]:
    """How often nothing is taken for something."""
    words = {False: "noise alone: a period", True: "spin under constant geometry: a difference"}
    rows = []
    for snr in NOISES:
        for spinning, what in words.items():
            jobs = [pool.submit(alarm, snr, i, spinning) for i in range(cases)]
            asked = [a for j in jobs if (a := j.result()) is not None]
            rows.append([f"{snr:g}", what, "1 %", f"{sum(asked)} of {len(asked)}"])
    return rows


def asteroids() -> list[list[str]]:
    folder = Path(os.environ.get("LCBAYES_DATA", ROOT.parent / "shared" / "data")) / "damit"
    rows = []
    for name in ("43_Ariadne_rel", "135_Hertha"):
        if not (folder / f"{name}.lcs").exists():
            rows.append([name, "no data here", ""])
            continue
        begun = time.perf_counter()
        found = estimate(read(folder / f"{name}.lcs"), n_shuffles=SHUFFLES)
        said = "; ".join(found.reasons) or "; ".join(
            f"{1 / s.frequency / 3600:.6f} h" for s in found.solutions
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
        "pole alone. Several: cases with more than one solution.\n\n"
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
            ],
            rows,
        )
        + "\n\nFalse alarms.\n\n"
        + table(["SNR", "what", "nominal", "found"], false)
        + f"\n\nTime per 1,000 points: {np.median(took):.2f} s (median), {max(took):.2f} s at most."
        + "\n\n"
        + table(["asteroid", "what is said", "s"], asteroids())
    )
    write_section("Spin from periods alone", "python benchmarks/spin.py", text)


if __name__ == "__main__":
    main()
