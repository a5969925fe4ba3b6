"""Bodies of known shape: is the motion found, and are missing shadows noticed?

    python benchmarks/bodies.py [--first 0] [--cases 20] [--body rocket-stage] [--spin flat]
        [--passes 2] [--snr 30] [--without-shadows] [--fit | --optimum] [-o DIR]

Each case is a bundled body with a random surface and a random motion (one turn in 20 to 200 s),
seen on random passes of a low orbit and simulated with the shadows of its file; see `_body_cases`.
The search covers all motions that the prior allows. It succeeds if the best end point is at most
0.5 nats above the posterior optimum reached from the truth; `right` says whether its pole is within
10 degrees and its rate within half a turn over the time base of the truth. With --without-shadows,
the body that is fitted has none. χ² of the best end point, or the largest shift of any combination
of parameters by the shadows computed there, shows whether that is noticed. With --fit, each curve
is fitted by `lcbayes.fit` instead: is it trusted, is the motion right, and which of rate, pole and
surface lie outside their 90 % intervals in the solution of weight above 5 % whose motion is closest
to the truth? With --optimum, nothing is searched and nothing is sampled: which quantities lie
outside the 90 % intervals of the Gaussian about the posterior optimum that is reached from the
truth? One row a case is appended to bodies.csv in DIR; cases there are not repeated.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _body_cases import Case, drawn
from _scores import direction_within, encoded, pooled, share, within
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.misfit_tests import Projection
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models.body import shadows_left_out
from lcbayes.results.summary import MAX_SHIFT
from lcbayes.samplers.chains import Whitening

type Given = dict[str, object]

TOLERANCE = 0.5  # nats
NOTICED = 0.01  # p-value of χ²
WORKERS = 2
DRAWS = 4_000  # of the Gaussian about an optimum
COLUMNS = (
    "task",
    "body",
    "spin",
    "seed",
    "passes",
    "snr",
    "shadows",
    "turns",
    "nats_above_truth",
    "right",
    "p_chi2",
    "shift_sd",
    "search_s",
    "trusted",
    "reasons",
    "right_inside",
    "outside",
    "quantities",
    "fit_s",
)


def _problem(case: Case, given: Given) -> tuple[Problem, Epochs, Mapping[str, Any]]:
    """The posterior of a case, its data and the options of the model."""
    entry, data = registry.find("body"), Epochs.of(case.curve)
    options = entry.check({o.name: o.default for o in entry.options.values()} | given)
    options |= entry.pooled
    return build_problem(entry, options, data)[0], data, options


def searched(case: Case, given: Given) -> dict[str, object]:
    """The best end point of the search against the optimum reached from the truth."""
    problem, data, options = _problem(case, given)
    hook = registry.find("body").hook("search")
    assert hook is not None
    begun = time.monotonic()
    ends, _ = hook(problem, data, options, WORKERS, Silent())
    seconds = time.monotonic() - begun
    best = compiled(problem.constrain)(ends.z[0], data)
    truth = search.polish(problem, data, _truth(problem, data, case, ends.z[0])[None], 1)
    misfit = measure(problem, data, ends.z[:1])
    return {
        "nats_above_truth": float(ends.potential[0] - truth.potential[0]),
        "right": _right(case, np.asarray(best["omega"])),
        "p_chi2": float(chi2.sf(misfit.chi2, misfit.dof)),
        "shift_sd": _shift(problem, data, options, ends.z[0]),
        "search_s": seconds,
    }


def _shift(problem: Problem, data: Epochs, options: Mapping[str, Any], z: np.ndarray) -> float:
    """Largest shift of a combination of parameters by shadows that are left out, in its sd."""
    sites = compiled(problem.constrain)(z, data)
    change = shadows_left_out([sites], data, **options)
    if change is None:
        return 0.0
    maker = Projection.of(problem, np.asarray(z), data)
    column = np.asarray(compiled(problem.response)(z, data, jnp.asarray(change)))[0]
    slope = maker.power * column @ maker.jacobian
    return float(np.sqrt(slope @ maker.covariance @ slope))


def _truth(problem: Problem, data: Epochs, case: Case, z: np.ndarray) -> np.ndarray:
    """An end point with the true motion in place of its own."""
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    middle = Rotation.from_rotvec(float(data.t_middle) * case.omega).as_matrix() @ case.attitude
    moved = {k: sites[k] for k in problem.names}
    if "rate_unit" in moved:
        unit = np.linalg.norm(sites["omega"]) / abs(sites["rate_unit"])
        moved["rate_unit"] = case.omega @ case.attitude @ case.body.flat_axis / unit
    else:
        unit = np.linalg.norm(sites["omega"]) / np.linalg.norm(sites["omega_unit"])
        moved["omega_unit"] = case.omega / unit
    if "axis_base" in moved:
        assert case.body.symmetry.axis is not None
        moved["axis_base"] = (middle @ case.body.symmetry.axis)[None]
    else:
        moved["attitude_base"] = Rotation.from_matrix(middle).as_quat(scalar_first=True)
    return np.asarray(problem.ravel({k: jnp.asarray(v, float) for k, v in moved.items()}))


def _right(case: Case, omega: np.ndarray) -> bool:
    """Whether pole and rate are those of the truth."""
    return max(_apart(case, omega)) < 1.0


def _apart(case: Case, omega: np.ndarray) -> tuple[float, float]:
    """From the truth: the pole, over 10 degrees, and the rate, over half a turn in all."""
    rate, true = float(np.linalg.norm(omega)), float(np.linalg.norm(case.omega))
    cosine = float(np.clip(omega @ case.omega / (rate * true), -1.0, 1.0))
    turns = abs(rate - true) * float(np.ptp(case.curve.t)) / np.pi
    return float(np.degrees(np.arccos(cosine))) / 10.0, turns


def at_optimum(case: Case, given: Given) -> dict[str, object]:
    """The intervals of the Gaussian about the posterior optimum that is reached from the truth."""
    problem, data, options = _problem(case, given)
    anywhere = np.full(problem.dim, 0.3)  # a motion that is not zero, in its unit
    moved = compiled(problem.constrain)(_truth(problem, data, case, anywhere), data)
    true = {k: np.asarray(moved[k]) for k in problem.names}
    for name, value in case.surface.items():
        true |= {name: value} if name in true else {f"log_{name}": np.log(value)}
    unit = compiled(problem.constrain)(problem.ravel(_arrays(true)), data)["size"]
    true["log_brightness"] = true["log_brightness"] - np.log(unit)  # of a body of its size
    start = np.asarray(problem.ravel(_arrays(true)))
    end = search.polish(problem, data, start[None], 1)
    z = np.asarray(end.z[0])
    gaussian = Whitening.at(problem, z, data)
    y = np.random.default_rng(DRAWS).standard_normal((DRAWS, z.size))
    posterior = _drawn(problem, tuple(case.surface), gaussian, y, data)
    misfit = measure(problem, data, end.z)
    inside = _inside(case, posterior)
    return {
        "nats_above_truth": float(end.potential[0])
        - float(compiled(problem.potential)(start, data)),
        "p_chi2": float(chi2.sf(misfit.chi2, misfit.dof)),
        "shift_sd": _shift(problem, data, options, z),
        "outside": encoded(inside),
        "quantities": len(inside),
    }


@partial(jax.jit, static_argnums=(0, 1))
def _drawn(
    problem: Problem, surface: tuple[str, ...], gaussian: Whitening, rows: jax.Array, data: Epochs
) -> Mapping[str, jax.Array]:
    """ω and the parameters of the surface at whitened rows (n, D)."""

    def one(y: jax.Array) -> Mapping[str, jax.Array]:
        sites = problem.constrain(gaussian(y), data)
        return {k: sites[k] for k in ("omega", *surface)}

    return jax.vmap(one)(rows)


def _arrays(sites: Mapping[str, Any]) -> dict[str, jax.Array]:
    return {k: jnp.asarray(v, float) for k, v in sites.items()}


def _inside(case: Case, posterior: Mapping[str, Any]) -> dict[str, bool]:
    """Which of rate, pole and surface lie inside their 90 % intervals."""
    omega = np.asarray(posterior["omega"]).reshape(-1, 3)
    inside = {"rate": within(np.linalg.norm(omega, axis=1), float(np.linalg.norm(case.omega)))}
    inside |= {f"pole {k}": held for k, held in direction_within(omega, case.omega).items()}
    for name, true in case.surface.items():
        inside[name] = within(np.asarray(posterior[name]).ravel(), true)
    return inside


def fitted(case: Case, given: Given) -> dict[str, object]:
    """The verdict of `lcbayes.fit`, and what the solution closest to the truth says."""
    begun = time.monotonic()
    result = lcbayes.fit(case.curve, model="body", seed=1, **given)
    took = time.monotonic() - begun
    solutions = []
    for i, mode in enumerate(result.content["modes"]):
        if mode["weight"] > 0.05:
            posterior = result.data[f"modes/{i}/posterior"]
            omega = np.asarray(posterior["omega"]).reshape(-1, 3)
            solutions.append((max(_apart(case, omega.mean(0))), omega, posterior))
    _, omega, posterior = min(solutions, key=lambda one: one[0])
    inside = _inside(case, posterior)
    return {
        "trusted": result.trusted,
        "reasons": " ".join(reason.code for reason in result.reasons),
        "right_inside": _right(case, omega.mean(0)),
        "outside": encoded(inside),
        "quantities": len(inside),
        "fit_s": took,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure the search for a known body.")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--body", default="rocket-stage")
    parser.add_argument("--spin", default="flat", choices=("flat", "free"))
    parser.add_argument("--passes", type=int, default=2)
    parser.add_argument("--snr", type=float, default=30.0)
    parser.add_argument("--without-shadows", action="store_true")
    how = parser.add_mutually_exclusive_group()
    how.add_argument("--fit", dest="task", action="store_const", const="fit", default="search")
    how.add_argument("--optimum", dest="task", action="store_const", const="optimum")
    parser.add_argument("-o", "--out", type=Path, default=Path("build/bodies"))
    args = parser.parse_args()
    compute, summarise = TASKS[args.task]
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "bodies.csv"
    rows = list(csv.DictReader(path.open(encoding="utf-8"))) if path.exists() else []
    about = {
        "task": args.task,
        "body": args.body,
        "spin": args.spin,
        "passes": args.passes,
        "snr": args.snr,
        "shadows": not args.without_shadows,
    }
    key = [str(v) for v in about.values()]
    known = {int(r["seed"]) for r in rows if [r[k] for k in about] == key}
    given = {"body": args.body, "spin": args.spin, "shadows": not args.without_shadows}
    for seed in sorted({*range(args.first, args.first + args.cases)} - known):
        case = drawn(args.body, args.spin, seed, args.snr, args.passes)
        row = about | {"seed": seed, "turns": case.turns}
        row |= compute(case, given)
        new = not path.exists()
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS)
            if new:
                writer.writeheader()
            writer.writerow({k: row.get(k, "") for k in COLUMNS})
        print(row, flush=True)
        rows.append({k: str(v) for k, v in row.items()})
    mine = [r for r in rows if [r[k] for k in about] == key]
    summarise(mine)


def _noticed(row: dict[str, str]) -> bool:
    """Whether a fit without shadows would be refused."""
    return float(row["p_chi2"]) < NOTICED or float(row["shift_sd"]) > MAX_SHIFT


def optima(mine: list[dict[str, str]]) -> None:
    """Which quantities are inside, of all cases and of those that would not be refused."""
    for what, rows in (("all", mine), ("not refused", [r for r in mine if not _noticed(r)])):
        counts = np.array([float(r["quantities"]) for r in rows])
        missed = [[q for q in r["outside"].split(";") if q] for r in rows]
        hits = counts - np.array([len(names) for names in missed], float)
        print(f"{what}: {len(rows)} cases, inside 90 %: {hits.sum():.0f} of {counts.sum():.0f}")
        print(f"  {pooled(hits, counts)}; outside: {Counter(n for m in missed for n in m)}")


def searches(mine: list[dict[str, str]]) -> None:
    """What the searches find, and whether shadows that are left out are noticed."""
    for name, hits in (
        ("right motion", [r["right"] == "True" for r in mine]),
        ("best not above the truth", [float(r["nats_above_truth"]) <= TOLERANCE for r in mine]),
        ("refused by χ²", [float(r["p_chi2"]) < NOTICED for r in mine]),
        ("shadows left out matter", [float(r["shift_sd"]) > MAX_SHIFT for r in mine]),
    ):
        print(f"{name}: {sum(hits)} of {len(hits)} ({share(sum(hits), len(hits))})")


def verdicts(fits: list[dict[str, str]]) -> None:
    """What the fits say: trusted, and of these right, inside and outside."""
    trusted = [r for r in fits if r["trusted"] == "True"]
    print(f"trusted: {len(trusted)} of {len(fits)} ({share(len(trusted), len(fits))})")
    right = sum(r["right_inside"] == "True" for r in trusted)
    print(f"motion right, of trusted: {right} ({share(right, len(trusted))})")
    counts = np.array([float(r["quantities"]) for r in trusted])
    out = np.array([len([q for q in r["outside"].split(";") if q]) for r in trusted], float)
    print(f"inside 90 %, of trusted: {counts.sum() - out.sum():.0f} of {counts.sum():.0f}", end=" ")
    print(f"({pooled(counts - out, counts)})")
    for row in fits:
        if row["trusted"] != "True":
            print(f"refused: {row['seed']}: {row['reasons']}")


TASKS = {"fit": (fitted, verdicts), "optimum": (at_optimum, optima), "search": (searched, searches)}

if __name__ == "__main__":
    main()
