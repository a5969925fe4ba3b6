"""Accuracy and coverage of pole, rate and inertia of tumbling bodies from three passes.

    python benchmarks/tumbling.py [--first 0] [--cases 20] [--search] [-o DIR]

Each seed draws a body of three visible facets and its motion from the prior of the model, and noise
of 2 %. The curves are fitted by `lcbayes.batch` with the defaults of a fit, one after the other; an
interrupted run is resumed if the same DIR is given again. Over draws from the prior, 90 % intervals
contain the truth in 90 % of cases: 16 to 20 of 20 in 95.7 % of trials.

With --search, one search of each kind is compared with the posterior optimum reached from the
truth, and no curve is fitted.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import xarray as xr
from _results import table, write_section
from scipy.stats import binom, chi2

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Console, Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import unit_vector
from lcbayes.inference import goodness_of_fit, search
from lcbayes.inference.annealed_search import GROWING, WHOLE, Stage, annealed
from lcbayes.inference.facet_climb import climbed
from lcbayes.inference.goodness_of_fit import MIN_FIT
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.solutions import completed
from lcbayes.inference.tumbling_search import STARTS
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.physics.brightness import DiffuseLaw

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.helpers import low_earth_orbit

N_FACETS, NOISE = 3, 0.02
TOLERANCE = 0.5  # nats
WORKERS = 2
OPTIONS = {
    "n_facets": N_FACETS,
    "spin": "torque-free",
    "omega_sd": 0.01,
    "seed": 1,
}
PASSES = ((0.0, 400.0), (350.0, 750.0), (800.0, 1200.0))  # s, each seen from a different site
POINTS = 40  # per pass
ASKED = {k: OPTIONS[k] for k in ("n_facets", "spin", "omega_sd")}


def geometry(rng: np.random.Generator) -> LightCurve:
    """Three sites along the ground track see the body one after the other."""
    orbit = low_earth_orbit.Orbit.random(rng)
    t, sun, obs, which = [], [], [], []
    for i, (start, end) in enumerate(PASSES):
        at = np.linspace(start, end, POINTS)
        satellite, _ = orbit.place(np.array([0.5 * (start + end)]))
        x, y, z = satellite[0] / np.linalg.norm(satellite)
        site = replace(
            orbit,
            lat=np.arcsin(z) + rng.normal(0.0, 0.08),
            lon=np.arctan2(y, x)
            - 2 * np.pi * at.mean() / low_earth_orbit.DAY
            + rng.normal(0.0, 0.08),
        )
        place, ground = site.place(at)
        t.append(at)
        obs.append((ground - place) / np.linalg.norm(ground - place, axis=1, keepdims=True))
        sun.append(np.broadcast_to(orbit.sun, (POINTS, 3)))
        which.append(np.full(POINTS, i))
    n = len(PASSES) * POINTS
    return LightCurve(
        t=np.concatenate(t),
        brightness=np.ones(n),
        error=np.full(n, 1.0),
        kind="flux",
        sun=np.concatenate(sun),
        obs=np.concatenate(obs),
        curve=np.concatenate(which),
        free_scale=np.zeros(len(PASSES), bool),
    )


def drawn(seed: int) -> tuple[LightCurve, dict[str, np.ndarray]]:
    """A light curve and the true values of all sites, drawn from the prior. A body is drawn again
    if one of its facets is never lit and seen, which the prior excludes, or if it is dark over half
    the time."""
    rng = np.random.default_rng(seed)
    entry = registry.find("faceted")
    while True:
        curve = geometry(rng)
        data = Epochs.of(curve)
        problem, _ = build_problem(entry, entry.check(ASKED), data)
        for attempt in range(200):
            z = compiled(problem.prior_draw)(jax.random.key(1000 * seed + attempt), data)
            sites = compiled(problem.constrain)(z, data)
            flux = np.asarray(sites["flux"])
            seen = compiled(problem.log_factors)(z, data) == 0.0
            if seen and np.median(flux) > 0.05 * flux.max():
                error = NOISE * float(flux.mean())
                noisy = flux + error * rng.standard_normal(flux.size)
                return replace(curve, brightness=noisy, error=np.full(flux.size, error)), {
                    k: np.asarray(v) for k, v in sites.items()
                }


def unit(lon: np.ndarray, lat: np.ndarray) -> np.ndarray:
    lon, lat = np.radians(lon), np.radians(lat)
    return unit_vector(lon, lat)


def compared(folder: Path, truth: dict[str, np.ndarray]) -> dict[str, tuple[float, float, bool]]:
    """For each quantity: error of the posterior mean, sd, and whether the 90 % interval contains
    the truth."""
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        draws = lcbayes.weighted_draws(tree["posterior"].to_dataset())
    names = ("omega", "inertia_ratio", "pole_lon_deg", "pole_lat_deg")
    flat = {k: draws[k].to_numpy().reshape(-1, *draws[k].shape[2:]) for k in names}
    pole = unit(flat["pole_lon_deg"], flat["pole_lat_deg"])
    true = unit(truth["pole_lon_deg"], truth["pole_lat_deg"])
    east = np.cross([0.0, 0.0, 1.0], true)
    east /= np.linalg.norm(east)
    rate, true_rate = np.linalg.norm(flat["omega"], axis=1), np.linalg.norm(truth["omega"])
    result = {}
    for name, values, at in (
        ("pole, east (deg)", np.degrees(pole @ east), 0.0),
        ("pole, north (deg)", np.degrees(pole @ np.cross(true, east)), 0.0),
        ("rate (relative)", rate / true_rate, 1.0),
        ("smallest moment / largest", flat["inertia_ratio"][:, 0], truth["inertia_ratio"][0]),
        ("middle moment / largest", flat["inertia_ratio"][:, 1], truth["inertia_ratio"][1]),
    ):
        low, high = np.quantile(values, [0.05, 0.95])
        result[name] = (float(values.mean() - at), float(values.std()), bool(low <= at <= high))
    return result


@dataclass(frozen=True)
class Drawn:
    """A body of `drawn` as the search sees it, without clock offsets and a drift of the rate.

    ``best`` is the potential of the optimum reached from the truth.
    """

    problem: Problem
    data: Epochs
    law: DiffuseLaw
    turns: float
    best: float

    @classmethod
    def of(cls, seed: int) -> Drawn:
        curve, truth = drawn(seed)
        data, entry = Epochs.of(curve), registry.find("faceted")
        options = {o.name: o.default for o in entry.options.values()} | ASKED | dict(entry.pooled)
        problem, _ = build_problem(entry, options, data)
        z = np.asarray(problem.ravel({k: jnp.asarray(truth[k]) for k in problem.names}))
        best = float(search.polish(problem, data, z[None], WORKERS).potential[0])
        turns = np.linalg.norm(truth["omega"]) * np.ptp(curve.t) / (2.0 * np.pi)
        return cls(problem, data, options["reflectance"], float(turns), best)

    def searched(self, stages: Sequence[Stage], key: int) -> search.SearchState:
        """The end points of one search, best first."""
        every = self.data.information * jnp.ones(self.data.t.size)  # one value for each point
        data = replace(self.data, information=every)
        given = STARTS, jax.random.key(key), WORKERS, Silent()
        ends = annealed(self.problem, data, self.law, stages, *given)
        return climbed(self.problem, data, self.law, ends, WORKERS, Silent())

    def p_value(self, z: np.ndarray) -> float:
        """Of χ² after the optimum (1, D) is completed by clock offsets and drift."""
        entry = registry.find("faceted")
        plain, _ = build_problem(entry, entry.check(ASKED), self.data)
        whole = completed(self.problem, plain, self.data, z)
        fit = goodness_of_fit.measure(
            plain, self.data, search.polish(plain, self.data, whole, WORKERS).z
        )
        return float(chi2.sf(fit.chi2, fit.dof))


def searches(seeds: range) -> None:
    """The best end point of a search of each kind against the optimum reached from the truth."""
    rows = []
    for seed in seeds:
        body = Drawn.of(seed)
        rows.append([f"{seed}", f"{body.turns:.1f}"])
        for stages, key in ((WHOLE, 2 * seed), (GROWING, 2 * seed + 1)):
            begun = time.monotonic()
            ends = body.searched(stages, key)
            seconds = time.monotonic() - begun
            above = float(ends.potential[0]) - body.best
            p = body.p_value(ends.z[:1])
            rows[-1] += [f"{above:.1f}", f"{p:.2g}", f"{seconds:.0f}"]
        print(*rows[-1], flush=True)
    write_searches(rows, seeds, jax.devices()[0].device_kind)


def write_searches(rows: list[list[str]], seeds: range, device: str) -> None:
    """Their section of RESULTS.md; one of its own for an accelerator."""
    found = [sum(float(row[i]) <= TOLERANCE for row in rows) for i in (2, 5)]
    either = sum(min(float(row[2]), float(row[5])) <= TOLERANCE for row in rows)
    text = (
        f"Two searches of {STARTS} starts for each body, with all data from the beginning and with "
        f"data that grow in time. One succeeds if it ends at most {TOLERANCE} nats above the "
        f"optimum reached from the truth: {found[0]} and {found[1]} of {len(rows)}, and one of the "
        f"two in {either}. All lack the clock offsets and the drift of the rate, with which χ² is "
        "given. The first two times include compilation.\n\n"
    )
    heads = ["seed", "turns"]
    for kind in ("whole", "growing"):
        heads += [f"{kind}: best above the truth (nats)", "p of χ²", "search (s)"]
    where = "" if device == "cpu" else f" on one {device}"
    write_section(
        f"Torque-free tumbling: one search{where}",
        f"python benchmarks/tumbling.py --search --first {seeds.start} --cases {len(seeds)}",
        text + table(heads, rows),
    )


def measure(seeds: range, folder: Path) -> None:
    curves = folder / "curves"
    curves.mkdir(parents=True, exist_ok=True)
    truths = {}
    for seed in seeds:
        curve, truth = drawn(seed)
        truths[f"seed-{seed:02d}"] = truth
        lcbayes.write(curve, curves / f"seed-{seed:02d}.csv")
    result = lcbayes.batch(curves, out=folder / "out", workers=1, **OPTIONS, progress=Console())
    status = {row["name"]: row["status"] for row in result.rows}
    every = {
        name: compared(folder / "out" / "objects" / name, truth)
        for name, truth in truths.items()
        if status[name] != "failed"
    }
    for name, row in every.items():
        print(name, status[name], {k: f"{e:+.4f} ± {s:.4f} {i}" for k, (e, s, i) in row.items()})
    trusted = [n for n in every if status[n] == "trusted"]
    likely = {row["name"]: chi2.sf(row["chi2"], row["dof"]) for row in result.rows if "chi2" in row}
    explained = [n for n in every if likely[n] > MIN_FIT]
    rows = []
    for quantity in next(iter(every.values())):
        cells = [quantity]
        for among in (trusted, explained, list(every)):
            values = [every[n][quantity] for n in among]
            inside, n = sum(v[2] for v in values), len(values)
            low, high = binom.interval(0.95, n, 0.9) if n else (0, 0)
            cells += [f"{inside} of {n}", f"{low:.0f} to {high:.0f}"]
        errors = np.abs([v[0] for n, v in ((n, every[n][quantity]) for n in every)])
        sds = [every[n][quantity][1] for n in every]
        rows.append([*cells, f"{np.median(errors):.2g}", f"{np.median(sds):.2g}"])
    seconds = [row["seconds"] for row in result.rows]
    text = (
        f"{len(seeds)} bodies of {N_FACETS} facets drawn from the prior (omega_sd "
        f"{OPTIONS['omega_sd']} rad/s, inertia_sd 1), each seen from three sites in "
        f"{PASSES[-1][1]:.0f} s, {len(PASSES) * POINTS} points, noise {NOISE:.0%} of the mean; "
        f"{len(explained)} fits explain the data by their chi2; trusted: {len(trusted)}. Time of a "
        f"fit: median {np.median(seconds):.0f} s, 90 % {np.quantile(seconds, 0.9):.0f} s.\n\n"
    )
    text += table(
        [
            "quantity",
            "truth inside 90 %, trusted",
            "expected",
            "those that explain the data",
            "expected",
            "all",
            "expected",
            "median error",
            "median sd",
        ],
        rows,
    )
    write_section(
        "Torque-free tumbling: pole, rate and inertia",
        f"python benchmarks/tumbling.py --first {seeds.start} --cases {len(seeds)}",
        text,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description="Accuracy and coverage of tumbling bodies.")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--cases", type=int, default=20, help="number of seeds")
    parser.add_argument("-o", type=Path, help="folder of the results, to resume")
    parser.add_argument("--search", action="store_true", help="one search of each, and no fit")
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.cases)
    if options.search:
        searches(seeds)
        return
    if options.o is not None:
        measure(seeds, options.o)
        return
    with tempfile.TemporaryDirectory() as scratch:
        measure(seeds, Path(scratch))


if __name__ == "__main__":
    main()
