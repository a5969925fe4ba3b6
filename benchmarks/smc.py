"""Tempered particles: evidence against quadrature, mirror images, four rotating facets.

python benchmarks/smc.py                 all parts, into RESULTS.md
python benchmarks/smc.py four            one of: one, mirror, four, agreement
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _results import table, write_section

import lcbayes
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Console
from lcbayes.inference import basins, symmetry
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))
SEEDS = range(8)
NOISE_SEED = 1
ORDER_OF = registry.find("faceted").facet_sites
HEADS = ["seed", "ln Z of the way", "ln Z of the particles", "steps", "gradients", "wall (s)"]


class Run(NamedTuple):
    result: smc.Result
    took: float
    ended: float  # ln Z from the final particles


def problem_of(what: str | Path, **options: Any) -> tuple[Problem, Epochs]:
    data = Epochs.of(simulate(scenario.load(what), NOISE_SEED)[0])
    return Problem(registry.find("faceted").bind(options), data), data


def measured(
    problem: Problem, data: Epochs, n_particles: int, seeds: range, **options: Any
) -> list[Run]:
    """A run for every seed with its wall time; the first includes compilation."""
    found = []
    for seed in seeds:
        begun = time.monotonic()
        result = smc.run(problem, data, jax.random.key(seed), n_particles, **options)
        found.append((result, time.monotonic() - begun))
        print(f"seed {seed}: ln Z {result.log_evidence:.3f}, {found[-1][1]:.1f} s", flush=True)
        for reason in result.reasons:
            print(f"  {reason}", flush=True)
    order = FacetOrder(problem, ORDER_OF)
    weighed = basins.measure(problem, data, [r for r, _ in found], order, workers=2).weighed
    return [
        Run(r, took, float(one))
        for (r, took), one in zip(found, weighed.log_evidences, strict=True)
    ]


def columns(seed: int, run: Run) -> list[str]:
    result = run.result
    told = [f"{result.log_evidence:.2f}", f"{run.ended:.2f}"]
    return [
        str(seed),
        *told,
        str(len(result.stages)),
        f"{result.gradients:.2e}",
        f"{run.took:.1f}",
    ]


def said(found: list[Run]) -> str:
    told = [reason for run in found for reason in run.result.reasons]
    text = ""
    of = {"way": [r.result.log_evidence for r in found], "particles": [r.ended for r in found]}
    for name, values in of.items():
        text += f"ln Z of the {name} {np.mean(values):.2f}, sd over seeds "
        text += f"{np.std(values, ddof=1):.3f}, range {np.ptp(values):.2f}; "
    if of["way"] == of["particles"]:
        text += "the particles do not bear a bridge, so that it is the way's that counts; "
    text += f"{np.median([run.took for run in found]):.1f} s per run (median)"
    return text + f". Reasons not to trust a run, told by it: {len(told)}."


def one() -> None:
    from tests.helpers import one_facet_posterior

    problem, data = problem_of("one-facet", n_facets=1, spin="none")
    want = one_facet_posterior.Quadrature.of(data).log_evidence(data)
    found = measured(problem, data, 1000, SEEDS)
    errors = [run.ended - want for run in found]
    rows = [
        [*columns(seed, run), f"{error:+.3f}"]
        for seed, run, error in zip(SEEDS, found, errors, strict=True)
    ]
    text = f"1000 particles. Quadrature: ln Z {want:.3f}.\n\n" + table([*HEADS, "error"], rows)
    text += f"\n\n{said(found)} Within 0.1 nat: {np.sum(np.abs(errors) < 0.1)} of {len(found)}"
    text += " (goal: all)."
    write_section("Evidence of one facet", "python benchmarks/smc.py one", text)


def mirror() -> None:
    problem, data = problem_of(HERE / "mirror.toml", n_facets=2)

    @jax.jit
    def side(z: jax.Array) -> jax.Array:
        return jax.lax.map(lambda z: problem.constrain(z, data)["omega"][0] > 0, z)

    text = "Two facets and ω, Sun and observer in one plane, SNR 30, 61 epochs, 100 particles: the"
    text += " posterior is the same under n_z → −n_z, (ω_x, ω_y) → −(ω_x, ω_y)."
    moves = {
        "without a move to the mirror image": None,
        "with it": symmetry.plane_mirror(problem, data),
    }
    for name, matrix in moves.items():
        found = measured(problem, data, 100, SEEDS, mirror=matrix)
        weights = [float(np.mean(side(jnp.asarray(run.result.z)))) for run in found]
        rows = [
            [*columns(seed, run), f"{weight:.3f}"]
            for seed, run, weight in zip(SEEDS, found, weights, strict=True)
        ]
        within = np.sum(np.abs(np.array(weights) - 0.5) < 0.05)
        text += f"\n\nRuns {name}:\n\n" + table([*HEADS, "weight of ω_x > 0"], rows)
        text += f"\n\n{said(found)} Weight 0.5 ± 0.05: {within} of {len(found)} (goal: all)."
    write_section("Weights of two mirror images", "python benchmarks/smc.py mirror", text)


def four() -> None:
    problem, data = problem_of(HERE / "four-facets.toml", n_facets=4)
    truth = simulate(scenario.load(HERE / "four-facets.toml"), NOISE_SEED)[1]
    omega = np.array(truth["attitude"]["omega_rad_s"])
    text = f"Four facets and ω, SNR 30, two passes, {data.t.size} epochs."
    for n in (100, 250):
        text += f"\n\n{n} particles:\n\n{_four(problem, data, omega, n)}"
    text += "\n\nGoals: spread below 0.3, ten times faster than the 230 s of a trial."
    write_section("Four facets and a spin", "python benchmarks/smc.py four", text)


def _four(problem: Problem, data: Epochs, omega: np.ndarray, n_particles: int) -> str:
    found = measured(problem, data, n_particles, SEEDS)
    rows = []
    for seed, run in zip(SEEDS, found, strict=True):
        result = run.result
        spins = np.asarray(
            jax.jit(jax.vmap(lambda z: problem.constrain(z, data)["omega"]))(result.z)
        )
        near = np.linalg.norm(spins - omega, axis=1) < 0.003
        misfit = np.mean(-2 * result.log_likelihood) - np.sum(
            np.log(2 * np.pi * np.asarray(data.error) ** 2)
        )
        rows.append([*columns(seed, run), f"{near.mean():.3f}", f"{misfit:.1f}"])
    heads = [*HEADS, "weight within 0.003 rad/s of the true ω", "mean χ²"]
    return table(heads, rows) + f"\n\n{said(found)}"


def agreement() -> None:
    """Eight populations of one fit: the weight that each gives to every distinct solution."""
    curve = simulate(scenario.load(HERE / "four-facets.toml"), NOISE_SEED)[0]
    begun = time.monotonic()
    found = lcbayes.fit(
        curve,
        n_facets=4,
        sampler="smc",
        num_chains=len(SEEDS),
        num_samples=250,
        seed=1,
        progress=Console(),
    )
    took = time.monotonic() - begun
    summary = found.content
    rows = []
    for k, mode in enumerate(summary["modes"], start=1):
        shares = np.array(mode.get("weight_by_run"))
        spin = ", ".join(f"{1e3 * mode[f'omega_{x}_rad_s']:+.1f}" for x in "xyz")
        far = float(np.abs(shares - mode["weight"]).max())
        rows.append(
            [
                str(k),
                f"{mode['weight']:.3f}",
                ", ".join(f"{s:.2f}" for s in shares),
                f"{far:.3f}",
                spin,
                f"{mode['rms']:.4f}",
            ]
        )
    heavy = [float(row[3]) for row in rows if float(row[1]) > 0.05]
    heads = ["solution", "weight", "by run", "farthest run", "ω (10⁻³ rad/s)", "rms"]
    text = (
        f"Four facets and ω as above, {len(SEEDS)} runs of 250 particles in one "
        f'`lcbayes.fit(…, sampler="smc")`, {took:.0f} s. Solutions above 5 %: {len(heavy)}; the '
        f"farthest run is {max(heavy):.3f} off (goal 0.05).\n\n{table(heads, rows)}\n\n"
        f"Reasons told: {'; '.join(map(str, found.reasons)) or 'none'}."
    )
    write_section("Agreement of independent runs", "python benchmarks/smc.py agreement", text)


PARTS = {"one": one, "mirror": mirror, "four": four, "agreement": agreement}

if __name__ == "__main__":
    chosen = sys.argv[1:] or list(PARTS)
    if unknown := set(chosen) - set(PARTS):
        sys.exit(f"unknown part {', '.join(sorted(unknown))}; available: {', '.join(PARTS)}")
    for part in chosen:
        PARTS[part]()
