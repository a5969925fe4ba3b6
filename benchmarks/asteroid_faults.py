"""Share of trusted `convex-grid` fits, and of their 90 % intervals that hold, for other bodies.

    python benchmarks/asteroid_faults.py -o DIR                          every body, 10 seeds each
    python benchmarks/asteroid_faults.py -o DIR --cells brick --seeds 1  one case
    python benchmarks/asteroid_faults.py -o DIR --table-only --write     the table, into RESULTS.md

Each case is a complete `lcbayes.fit` of ``convex-grid`` with its defaults to a DAMIT file of 300
points in six curves. Body, pole, period and orbit are random; `_asteroids.py` simulates them
without any code of the package. An ellipsoid of uniform albedo is what the model describes, a brick
with flat faces hardly, a contact binary with shadows and a dark spot not. Quantities: sidereal
period, longitude and latitude of the pole. The solution nearest to the true pole is scored, because
poles near λ + 180° are a known ambiguity of such data.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from _asteroids import BODIES, draw_case, write
from _cases import Cell, Outcome, command
from _scores import angle_within, within

import lcbayes
from lcbayes.tasks.fit.result import Fit

SEEDS = 10
MIN_WEIGHT = 0.05  # of a solution that is scored
CELLS = [Cell(name, 0.0) for name in BODIES]


def fitted(cell: Cell, seed: int, out: Path) -> Outcome:
    """Simulate a case, write its file, read and fit it as a user would."""
    case = draw_case(cell.name, seed)
    path = out / "curves" / f"{cell.name}-{seed}.lcs"
    path.parent.mkdir(exist_ok=True)
    write(case, path)
    result = lcbayes.fit(
        lcbayes.read(path), model="convex-grid", period=case.given_period_h, seed=seed
    )
    inside, off = nearest(result, case.pole, case.period_h)
    return Outcome(
        result.trusted,
        inside,
        [reason.code for reason in result.reasons],
        len(result.content["modes"]),
        result.content["fit"]["chi2"],
        result.content["fit"]["dof"],
        f"period {case.period_h:.2f} h, pole off by {off:.1f} deg",
    )


def nearest(result: Fit, pole: np.ndarray, period_h: float) -> tuple[dict[str, bool], float]:
    """Intervals of the solution whose pole is nearest to the truth, and its angle in degrees."""
    lon, lat = np.arctan2(pole[1], pole[0]), np.arcsin(pole[2])
    offsets = []
    for i, mode in enumerate(result.content["modes"]):
        if mode["weight"] < MIN_WEIGHT:
            continue
        draws = result.tree[f"modes/{i}/posterior"].to_dataset()
        lons, lats = (
            np.radians(np.asarray(draws[k].values).ravel())
            for k in ("pole_lon_deg", "pole_lat_deg")
        )
        flat = np.cos(lats)
        mean = np.array(
            [np.mean(flat * np.cos(lons)), np.mean(flat * np.sin(lons)), np.mean(np.sin(lats))]
        )
        off = float(np.degrees(np.arccos(np.clip(mean @ pole / np.linalg.norm(mean), -1, 1))))
        inside = {
            "period": within(np.asarray(draws["period_h"].values).ravel(), period_h),
            "pole lon": angle_within(lons, float(lon)),
            "pole lat": within(lats, float(lat)),
        }
        offsets.append((off, inside))
    off, inside = min(offsets, key=lambda pair: pair[0])
    return inside, off


if __name__ == "__main__":
    command(__doc__, CELLS, SEEDS, fitted, "Faults: asteroids")
