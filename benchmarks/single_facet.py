"""`lcbayes single-facet` on simulated passes over Maui and Kauai.

python benchmarks/single_facet.py [--cases 100]
"""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
from _results import table, write_section
from attitude_test import share

sys.path.insert(0, str(Path(__file__).parents[1]))

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.single_facet import SURE, SingleFacet, single_facet
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.bodies import shapes
from tests.helpers.single_facet_passes import (
    body_directions,
    crossing,
    flux_of,
    one_pass,
    with_noise,
)

LVLH = catalogue.find("lvlh")
NOISE = (0.01, 0.05)
POINTS = 200  # points of both sites together


def apart_deg(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))


def sites(curve: LightCurve, both: bool) -> LightCurve:
    rows = np.arange(curve.n_obs) if both else np.flatnonzero(curve.site == "0")
    count = POINTS if both else POINTS // 2
    return curve.select(rows[np.linspace(0, len(rows) - 1, count).astype(int)])


def kind_of(curve: LightCurve, normal: np.ndarray) -> str:
    """The true kind of the change."""
    sun, obs = body_directions(curve, LVLH)
    lit, seen = sun @ normal > 0, obs @ normal > 0
    result = set()
    for k in np.unique(curve.site):
        r = np.flatnonzero(curve.site == k)
        light = (lit[r][1:] != lit[r][:-1]) & (seen[r][1:] | seen[r][:-1])
        view = (seen[r][1:] != seen[r][:-1]) & (lit[r][1:] | lit[r][:-1])
        result |= ({"illumination"} if light.any() else set()) | (
            {"visibility"} if view.any() else set()
        )
    return result.pop() if len(result) == 1 else "both"


def holds(result: SingleFacet, normal: np.ndarray) -> bool:
    """Whether a cell of the region is within one cell width of the normal."""
    cells = result.normals[result.region]
    return apart_deg(cells[np.argmax(cells @ normal)], normal) < 1.5 * np.degrees(
        np.sqrt(result.cell)
    )


def with_edge(cases: int) -> list[tuple[int, np.ndarray]]:
    """Seeds of passes with an edge of some facet, and the normal of one such facet."""
    result, seed = [], 0
    while len(result) < cases:
        with suppress(LookupError):
            result.append((seed, crossing(sites(one_pass(seed), True), LVLH, seed)))
        seed += 1
    return result


def edges(cases: int, took: list[float]) -> list[list[str]]:
    """Facets with an edge in the pass: error, coverage, kinds, refusals."""
    rows, drawn = [], with_edge(cases)
    for both in (False, True):
        for noise in NOISE:
            error, radius, inside, sure_and_right, right, refused = [], [], [], [], [], 0
            for seed, normal in drawn:
                curve = sites(one_pass(seed), both)
                curve = with_noise(curve, flux_of(curve, LVLH, normal, 1.0), noise, seed)
                begun = time.perf_counter()
                result = single_facet(curve, LVLH, seed=seed)
                took.append(time.perf_counter() - begun)
                if result.reasons:
                    refused += 1
                    continue
                error.append(apart_deg(result.normal, normal))
                radius.append(result.radius_deg)
                inside.append(holds(result, normal))
                best = max(result.kind, key=lambda k, f=result: f.kind[k])
                sure_and_right.append(result.kind[best] >= SURE)
                if sure_and_right[-1]:
                    right.append(best == kind_of(curve, normal))
            rows.append(
                [
                    "two" if both else "one",
                    f"{100 * noise:.0f} %",
                    f"{np.median(error):.2f}, {np.quantile(error, 0.9):.2f}",
                    f"{np.median(radius):.1f}",
                    share(inside),
                    share(sure_and_right),
                    share(right),
                    f"{refused} of {cases}",
                ]
            )
            print(rows[-1], flush=True)
    return rows


def nothing(cases: int) -> list[list[str]]:
    """Curves without a single-facet signature, for which any result is a false alarm."""
    box = shapes.box(1.0, 1.4, 2.0)
    rows = []
    for what in ("a sphere alone", "a box of three sizes of side"):
        for noise in NOISE:
            chance, answered, right = [], [], []
            for seed in range(cases):
                curve = sites(one_pass(seed), True)
                flux = flux_of(curve, LVLH, np.array([1.0, 0.0, 0.0]), 0.0)
                if what.startswith("a box"):
                    sides = zip(box.normals, box.areas, strict=True)
                    flux = np.sum([flux_of(curve, LVLH, n, a) for n, a in sides], axis=0)
                result = single_facet(with_noise(curve, flux, noise, seed), LVLH, seed=seed)
                chance.append(result.p_value <= 0.01)
                answered.append(not result.reasons)
                if answered[-1]:
                    right.append(any(holds(result, n) for n in box.normals))
            side = share(right) if what.startswith("a box") and right else "–"
            rows.append([what, f"{100 * noise:.0f} %", share(chance), share(answered), side])
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100, help="per row (default 100)")
    cases = parser.parse_args().cases
    took: list[float] = []
    heads = [
        "sites",
        "noise",
        "error of the normal, median and 90 % (deg)",
        "region reaches (deg, median)",
        "truth in the 90 % region",
        "kind told",
        "kind right where told",
        "refused",
    ]
    alone = ["body", "noise", "p ≤ 0.01", "an orientation is given", "it is a side of the box"]
    text = (
        "Orbits of 450 to 900 km over Maui and Kauai, 100 points a site; a Lambertian "
        "facet of 1 m² over a sphere of 0.3 m radius, both of albedo 0.3, held in LVLH; normals at "
        "random among those whose edge both sites see crossed.\n\n"
        + table(heads, edges(cases, took))
        + "\n\nWithout a single facet, two sites. The nominal rate of p ≤ 0.01 is 1 % for the "
        "sphere; a box does have edges, of several facets.\n\n"
        + table(alone, nothing(cases // 2))
        + f"\n\n{np.median(took):.1f} s a case (median)."
    )
    write_section("Single facets", f"python benchmarks/single_facet.py --cases {cases}", text)


if __name__ == "__main__":
    main()
