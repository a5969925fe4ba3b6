"""Facets, wires and panels from glints, compared with the truth of simulated light curves.

    python benchmarks/glints.py            into RESULTS.md (a minute; --cases N for more)

Facets and wires are on bodies with known spin periods of 60 to 120 s, in passes of low orbits.
Panels are on geostationary satellites, seen over four nights, weeks from an equinox.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"  # one case per core

import numpy as np
from _results import table, write_section

sys.path.insert(0, str(Path(__file__).parents[1]))

from lcbayes.inversion.glints import analyse
from tests.helpers.simulated_glints import facet_flashes, no_flashes, panel_flashes, wire_flashes

NOISES = (10.0, 50.0)  # median flux over the noise of one point
LEVEL_90 = 1.645
Case = tuple[float, bool] | None  # error in degrees, whether the 90 % region contains the truth


def facet(seed: int, snr: float) -> tuple[Case, float]:
    curve, attitude, normal = facet_flashes(seed, snr)
    begun = time.perf_counter()
    result = analyse(curve, attitude)
    took = time.perf_counter() - begun
    if not result.facets:
        return None, took
    best = result.facets[0]
    return (float(np.degrees(np.arccos(min(1.0, best.vector @ normal)))), best.holds(normal)), took


def wire(seed: int, snr: float) -> tuple[Case, float]:
    curve, attitude, axis = wire_flashes(seed, snr)
    begun = time.perf_counter()
    best = analyse(curve, attitude).cylinder
    took = time.perf_counter() - begun
    if best is None:
        return None, took
    away = float(np.degrees(np.arccos(min(1.0, abs(best.vector @ axis)))))
    return (away, best.holds(axis, axis=True)), took


def panel(seed: int, snr: float) -> tuple[Case, float]:
    curve, axis, offset = panel_flashes(seed, snr)
    begun = time.perf_counter()
    best = analyse(curve, axis=axis).panel
    took = time.perf_counter() - begun
    if best is None:
        return None, took
    away = abs(best.mean - offset)
    return (float(np.degrees(away)), away < LEVEL_90 * best.error), took


def alarm(seed: int, snr: float) -> tuple[bool, bool]:
    """Whether a glint, and a direction, is reported for a box without a glint."""
    result = analyse(no_flashes(seed, snr))
    return bool(result.glints), not result.reasons


def rows_of(cases: int, pool: Executor) -> list[list[str]]:
    kinds: tuple[tuple[str, Callable], ...] = (
        ("facet: normal", facet),
        ("wire: axis", wire),
        ("tracking panel: offset", panel),
    )
    rows = []
    for name, function in kinds:
        for snr in NOISES:
            done = list(pool.map(function, range(cases), [snr] * cases))
            good = [c for c, _ in done if c is not None]
            away = np.array([g[0] for g in good])
            middle, most = np.quantile(away, [0.5, 0.9])
            rows.append(
                [
                    name,
                    f"{snr:g}",
                    f"{cases - len(good)} of {cases}",
                    f"{middle:.2g}",
                    f"{most:.2g}",
                    f"{sum(g[1] for g in good)} of {len(good)}",
                    f"{np.median([t for _, t in done]):.2f}",
                ]
            )
            print(*rows[-1], sep="  ", flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=50, help="per kind and noise")
    cases = parser.parse_args().cases
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        rows = rows_of(cases, pool)
        false = []
        for snr in NOISES:
            done = list(pool.map(alarm, range(4 * cases), [snr] * 4 * cases))
            false.append(
                [
                    f"{snr:g}",
                    "1 %",
                    f"{sum(g for g, _ in done)} of {len(done)}",
                    f"{sum(d for _, d in done)} of {len(done)}",
                ]
            )
    text = (
        table(
            [
                "what",
                "SNR of a point",
                "refused",
                "median error (deg)",
                "90 % of errors (deg)",
                "truth in 90 % region",
                "s a case",
            ],
            rows,
        )
        + "\n\nDiffuse boxes that spin without a glint.\n\n"
        + table(["SNR", "nominal", "curves with a glint", "with a direction"], false)
    )
    write_section("Glints", "python benchmarks/glints.py", text)


if __name__ == "__main__":
    main()
