"""`lcbayes shape-match` on 500 simulated objects at two noise levels, and on moving objects.

python benchmarks/shape_match.py [--objects 500]
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from _results import table, write_section
from attitude_test import share

sys.path.insert(0, str(Path(__file__).parents[1]))

from scipy.spatial.transform import Rotation

from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.shape_match import (
    Surface,
    candidates,
    reflected_flux,
    shape_match,
    turned,
)
from lcbayes.modelling.ephemeris import frames
from lcbayes.physics.attitude import catalogue
from tests.helpers.simulated_passes import passes

NOISE = (0.02, 0.2)
POINTS, NULLS, LEVEL = 150, 40, 0.05


def noisy(t, flux, sun, obs, noise: float, rng: np.random.Generator) -> LightCurve:
    error = np.full(len(flux), noise * np.median(flux[flux > 0]))
    return LightCurve(
        t=t, brightness=flux + error * rng.normal(size=len(flux)), error=error, sun=sun, obs=obs
    )


def at_random(name: str, noise: float, seed: int) -> LightCurve:
    """A light curve with a random orientation at every point, phase angles 20 to 140 degrees."""
    rng = np.random.default_rng(seed)
    sun, obs = turned(np.radians(rng.uniform(20.0, 140.0, POINTS)), rng)
    return noisy(
        1000.0 * np.arange(POINTS),
        reflected_flux(candidates()[name], Surface(), sun, obs),
        sun,
        obs,
        noise,
        rng,
    )


def spinning(geometry: LightCurve, name: str, noise: float, seed: int) -> LightCurve:
    """A body spinning about an axis other than its own axes, 5 to 60 s per turn, real geometry."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis *= 2 * np.pi / rng.uniform(5.0, 60.0) / np.linalg.norm(axis)
    turn = Rotation.from_rotvec(geometry.t[:, None] * axis) * Rotation.random(None, rng)
    sun, obs = (turn.inv().apply(v) for v in (geometry.sun, geometry.obs))
    made = noisy(
        geometry.t,
        reflected_flux(candidates()[name], Surface(), sun, obs),
        geometry.sun,
        geometry.obs,
        noise,
        rng,
    )
    return replace(
        made, frame="icrs", position_km=geometry.position_km, velocity_km_s=geometry.velocity_km_s
    )


def held(geometry: LightCurve, name: str, noise: float, seed: int) -> LightCurve:
    """A stabilised body, nadir pointing."""
    rng = np.random.default_rng(seed)
    body = np.asarray(frames(catalogue.find("lvlh"), geometry).body)
    turn = Rotation.from_matrix(body) * Rotation.random(None, rng)
    sun, obs = (turn.inv().apply(v) for v in (geometry.sun, geometry.obs))
    made = noisy(
        geometry.t,
        reflected_flux(candidates()[name], Surface(), sun, obs),
        geometry.sun,
        geometry.obs,
        noise,
        rng,
    )
    return replace(
        made, frame="icrs", position_km=geometry.position_km, velocity_km_s=geometry.velocity_km_s
    )


def confusion(objects: int, noise: float, took: list[float]) -> tuple[str, str]:
    """The table of true against nearest shape, and the rates."""
    names = list(candidates())
    count = np.zeros((len(names), len(names)), int)
    alarms, kept = {"kolmogorov": [], "energy": []}, []
    right: list[bool] = []
    for seed in range(objects):
        truth = seed % len(names)
        begun = time.perf_counter()
        result = shape_match(
            at_random(names[truth], noise, seed), n_nulls=NULLS, n_draws=4000, seed=seed
        )
        took.append(time.perf_counter() - begun)
        count[truth, names.index(result.matches[0].name)] += 1
        mine = next(m for m in result.matches if m.name == names[truth])
        alarms["kolmogorov"].append(mine.p_kolmogorov <= LEVEL)
        alarms["energy"].append(mine.p_energy <= LEVEL)
        right.append(result.matches[0].name == names[truth])
        kept.append(sum(min(m.p_kolmogorov, m.p_energy) > LEVEL for m in result.matches))
        if seed % 50 == 49:
            print(noise, seed + 1, np.mean(right), flush=True)
    rows = [[n, *(str(c) for c in row)] for n, row in zip(names, count, strict=True)]
    rates = (
        f"Right: {share(right)}. True shape rejected at p ≤ {LEVEL:g} (nominal 5 %): "
        f"Kolmogorov-Smirnov {share(alarms['kolmogorov'])}, "
        f"energy distance {share(alarms['energy'])}. "
        f"Candidates kept: {np.mean(kept):.1f} of {len(names)} on average."
    )
    return table(["true \\ nearest", *names], rows), rates


def moving(cases: int) -> list[list[str]]:
    """Rows for objects with realistic rotation, on passes of four weeks."""
    names = list(candidates())
    whole = passes(550.0, 53.0, days=28, step=30.0)
    geometry = whole.select(np.linspace(0, whole.n_obs - 1, 300).astype(int))
    rows = []
    for title, make in (("spinning about a fixed axis", spinning), ("stabilised (lvlh)", held)):
        for noise in NOISE:
            right, alarm, warned, refused = [], [], [], []
            for seed in range(cases):
                name = names[seed % len(names)]
                result = shape_match(
                    make(geometry, name, noise, seed), n_nulls=NULLS, n_draws=4000, seed=seed
                )
                warned.append(any(r.code == "stabilised" for r in result.reasons))
                refused.append(bool(result.reasons))
                right.append(result.matches[0].name == name)
                mine = next(m for m in result.matches if m.name == name)
                alarm.append(mine.p_energy <= LEVEL)
            rows.append(
                [
                    title,
                    f"{100 * noise:.0f} %",
                    share(right),
                    share(alarm),
                    share(warned),
                    share(refused),
                ]
            )
            print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--objects", type=int, default=500, help="per noise level (default 500)")
    parser.add_argument("--moving", type=int, default=28, help="that turn (default 28 per row)")
    args = parser.parse_args()
    took: list[float] = []
    text = (
        f"{POINTS} points each, phase angles 20 to 140°, every point in a random orientation; "
        f"30 % Lambertian and 30 % specular (Blinn-Phong, exponent 100); {NULLS} nulls. Noise is "
        "a share of the median flux; points below 3σ are left out. Nearest is the candidate that "
        "is named first.\n\n"
    )
    for noise in NOISE:
        counts, rates = confusion(args.objects, noise, took)
        text += f"Noise {100 * noise:.0f} %, {args.objects} objects.\n\n{counts}\n\n{rates}\n\n"
    heads = [
        "object",
        "noise",
        "nearest is right",
        "true shape rejected (energy, p ≤ 0.05)",
        "said to be stabilised",
        "refused",
    ]
    text += (
        "300 points over the passes of four weeks at three sites (53°, 550 km).\n\n"
        + table(heads, moving(args.moving))
        + f"\n\n{np.median(took):.2f} s an object against 7 candidates (median)."
    )
    command = f"python benchmarks/shape_match.py --objects {args.objects} --moving {args.moving}"
    write_section("Shapes by phase angle and brightness", command, text)


if __name__ == "__main__":
    main()
