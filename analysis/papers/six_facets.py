"""Sec. VII.C of Linares & Crassidis: a cube of six diffuse facets, and ten facets at the start.

Eq. (32) has six facets of 10 m² along ±x, ±y and ±z on a body that does not rotate; in eq. (31) Sun
and observer are always in the x-y plane. The facets along ±z are then never lit: their flux is
zero, the prior (8) excludes them, and the data contain no information on them. The same pass is
therefore repeated three times here, with Sun *and* observer moved from x-y to y-z and z-x, so that
each facet is lit in two passes.

The paper gives neither rates nor phases. Here the Sun makes one revolution per pass, and the
observer two.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import _script
import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import sparse
from lcbayes.inference.basins import evenly
from lcbayes.inference.replicates import independent_runs
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.simulate import flux_at

Floats = NDArray[np.float64]

SCENARIO = Path(__file__).with_name("six-facets.toml")
UPPER_BOUND = 10
AREA = 10.0  # m² per facet
PAUSE = 5.0  # s, between passes
ENTRY = registry.find("faceted")
SIDES = ("+x", "+y", "+z", "−x", "−y", "−z")
PARTICLES, RUNS = 150, 2  # for the six facets of figures 6 and 7


@dataclass(frozen=True)
class Experiment:
    """A light curve of the cube, and the same without noise."""

    curve: LightCurve
    clean: Floats
    normals: Floats

    @property
    def data(self) -> Epochs:
        return Epochs.of(self.curve)

    def best_seen(self) -> Floats:
        """maxₜ min(μ₀, μ) of each facet, (6,): positive if the facet is ever lit and seen."""
        both = np.minimum(self.normals @ self.curve.sun.T, self.normals @ self.curve.obs.T)
        return both.max(axis=1)


def experiment(seed: int, n_passes: int = 3) -> Experiment:
    """The experiment; one pass as in the paper, and each further one with the axes permuted."""
    what = scenario.load(SCENARIO)
    base = epochs(what.geometry)
    length = base.t[-1] - base.t[0] + PAUSE
    t = np.concatenate([base.t + i * length for i in range(n_passes)])
    sun, obs = (
        np.concatenate([np.roll(v, i, axis=1) for i in range(n_passes)])
        for v in (base.sun, base.obs)
    )
    clean = flux_at(what, t, sun, obs)
    sigma = np.full(t.size, what.noise.value)
    noise = sigma * np.random.default_rng(seed).standard_normal(t.size)
    curve = LightCurve(t=t, brightness=clean + noise, error=sigma, kind="flux", sun=sun, obs=obs)
    return Experiment(curve, clean, np.asarray(what.body.normals))


def problem_of(n_facets: int, data: Epochs, **options: float) -> Problem:
    """The problem of the paper, in which the nights have one zero point."""
    fixed = {"spin": "none", "zero_point_sd": 0.0}
    return Problem(ENTRY.bind({"n_facets": n_facets, **fixed, **options}), data)


def sample(
    problem: Problem, data: Epochs, seed: int, n_particles: int, n_runs: int, name: str, out: Path
) -> list[smc.Result]:
    """Runs of tempered particles, saved with the figures for use by the next figure."""
    identity = {
        "name": name,
        "seed": seed,
        "particles": n_particles,
        "dim": problem.dim,
        "data": float(np.sum(np.asarray(data.brightness) * np.arange(data.t.size))),
    }
    return independent_runs(
        problem,
        data,
        jax.random.key(seed),
        n_particles,
        n_runs,
        name=name,
        checkpoint=Checkpoint(out / f"{name}-runs", identity),
    )


def parser(doc: str) -> argparse.ArgumentParser:
    """The command line of figures 6 and 7."""
    made = _script.parser(doc, draws=4000)
    made.add_argument("--particles", type=int, default=PARTICLES)
    return made


def sample_six(data: Epochs, args: argparse.Namespace) -> tuple[Problem, list[smc.Result]]:
    """The posterior of six facets, the true number, with the options of `parser`."""
    problem = problem_of(len(SIDES), data)
    return problem, sample(problem, data, args.seed, args.particles, RUNS, "six", args.out)


def sparse_problem(data: Epochs, n_facets: int, area: float) -> tuple[Problem, float]:
    """The problem with the squared-L1 prior of sec. VI, and the weight of that prior."""
    weight = sparse.weight(area)
    return problem_of(n_facets, data, sparsity=weight, log_area_sd=sparse.LOG_AREA_SD), weight


def facets(problem: Problem, data: Epochs, z: Floats) -> tuple[Floats, Floats]:
    """Areas (S, N) and normals (S, N, 3) of vectors z (S, D), facets by decreasing area."""

    def one(row: jax.Array) -> tuple[jax.Array, jax.Array]:
        sites = problem.constrain(row, data)
        order = jnp.argsort(-sites["albedo_area"])
        return sites["albedo_area"][order], sites["normals"][order]

    areas, normals = jax.jit(jax.vmap(one))(jnp.asarray(z))
    return np.asarray(areas), np.asarray(normals)


def misfit(problem: Problem, data: Epochs, z: Floats) -> Floats:
    """χ² of vectors z (S, D)."""

    def one(row: jax.Array) -> jax.Array:
        return jnp.sum(((data.brightness - problem.moments(row, data).mean) / data.error) ** 2)

    return np.asarray(jax.jit(lambda z: jax.lax.map(one, z))(jnp.asarray(z)))


def pooled(runs: list[smc.Result], n: int) -> Floats:
    """At most n draws (n, D); each run is weighted by its evidence, which is unbiased."""
    log_z = np.array([r.log_evidence for r in runs])
    share = np.exp(log_z - np.logaddexp.reduce(log_z))
    counts = np.floor(share * min(n, min(len(r.z) for r in runs) / share.max())).astype(int)
    return np.concatenate([evenly(r.z, k) for r, k in zip(runs, counts, strict=True)])
