"""Share of trusted fits, and of their 90 % intervals that hold, under small faults of real data.

    python benchmarks/faults.py -o DIR                                    every cell, 20 seeds each
    python benchmarks/faults.py -o DIR --cells zero_point:0.03 --seeds 3  some of them
    python benchmarks/faults.py -o DIR --table-only --write               the table, into RESULTS.md

Each case is a complete `lcbayes.fit` with its defaults to a CSV file of three Lambertian facets,
whose body, orbit, sites (one to three), passes (one to six) and nights (one to three) are drawn for
each case; `_satellites.py` simulates it without any code of the package. The same seed has the same
body and campaign in all cells that need as many sites. Quantities: rate of rotation, longitude and
latitude of the pole, and for each facet albedo-area, azimuth and height of its normal. A run that
is stopped continues with the cases that are not yet in DIR/cases.csv.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from _cases import Cell, Outcome, command
from _satellites import Case, Fault, draw_case, write
from _scores import Draws, Truth, body_inside

import lcbayes
from lcbayes.tasks.fit.result import Fit

SEEDS = 20
MIN_WEIGHT = 0.05  # of a solution that is scored
SIZES = {
    "none": (0.0,),
    "zero_point": (0.01, 0.03, 0.1),  # mag, second site
    "clock": (0.1, 0.5, 2.0),  # s, second site
    "nutation": (0.3, 0.8, 2.0),  # deg
    "rate_drift": (0.003, 0.01, 0.03),  # over the light curve
    "lobe": (0.01, 0.03, 0.06),  # of one facet's light
    "extra_facet": (0.01, 0.03, 0.08),  # of the area
    "correlated_noise": (0.5, 1.0, 2.0),  # of the stated errors
    "error_factor": (1.2, 1.4, 2.0),  # true over stated errors
}
CELLS = [Cell(name, size) for name, sizes in SIZES.items() for size in sizes]


def fitted(cell: Cell, seed: int, out: Path) -> Outcome:
    """Simulate a case, write its file, read and fit it as a user would."""
    case = draw_case(fault_of(cell), seed)
    path = out / "curves" / f"{cell.name}-{cell.size:g}-{seed}.csv"
    path.parent.mkdir(exist_ok=True)
    write(case, path)
    result = lcbayes.fit(
        lcbayes.read(path), n_facets=len(case.areas), reflectance="lambertian", seed=seed
    )
    truth = Truth(case.omega, case.normals, case.areas)
    return Outcome(
        result.trusted,
        body_inside(solutions(result), truth),
        [reason.code for reason in result.reasons],
        len(result.content["modes"]),
        result.content["fit"]["chi2"],
        result.content["fit"]["dof"],
        about(case),
    )


def fault_of(cell: Cell) -> Fault:
    return Fault() if cell.name == "none" else replace(Fault(), **{cell.name: cell.size})


def solutions(result: Fit) -> list[Draws]:
    """Draws of each solution with a noticeable weight."""
    drawn = []
    for i, mode in enumerate(result.content["modes"]):
        if mode["weight"] >= MIN_WEIGHT:
            draws = result.tree[f"modes/{i}/posterior"].to_dataset()
            flat = [
                np.asarray(draws[k].values).reshape(-1, *draws[k].shape[2:])
                for k in ("omega", "normals", "albedo_area")
            ]
            drawn.append(Draws(*flat))
    return drawn


def about(case: Case) -> str:
    campaign, period = case.campaign, 2 * np.pi / np.linalg.norm(case.omega)
    numbers = (
        (campaign.n_sites, "site"),
        (campaign.n_passes, "pass"),
        (campaign.n_nights, "night"),
    )
    words = [
        f"{n} {word}{'' if n == 1 else 'es' if word == 'pass' else 's'}" for n, word in numbers
    ]
    return f"{', '.join(words)}, period {period:.0f} s"


if __name__ == "__main__":
    command(__doc__, CELLS, SEEDS, fitted, "Faults: satellites")
