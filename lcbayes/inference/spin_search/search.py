"""The complete search for the constant spin of a body of facets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search import bodies, states
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.bodies import States
from lcbayes.inference.spin_search.cells import Coverage, Grid
from lcbayes.inference.spin_search.facets import NORMALS, OMEGA, SIZES, Bodies, reinserted, starts
from lcbayes.inference.spin_search.series import Series, frame, precision
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import DIFFUSE_LAWS, DiffuseLaw

Floats = NDArray[np.float64]

PRIOR_REACH = 4.0  # fastest spin in prior sd of a component of ω: 99.9 % of the prior
SURVIVORS = 60_000  # cells at the finest level
SERIES_ERROR = 0.15  # of the series and of the size of a cell, relative to the mean flux


@dataclass(frozen=True)
class Stage:
    """States carried on, the error of the free body (relative), normals of its grid, and steps."""

    states: int
    error: float
    normals: int
    steps: int


STAGES = (Stage(200, 0.05, 100, 7), Stage(40, 0.01, 250, 7))
ALIASES = 24  # spins tried for each state of the last stage
STRICT = Stage(80, 0.01, 200, 5)  # constant spins with a free body
OPTIMISED = (24, 12, 8, 8, 6, 6, *(4,) * 10)  # bodies of N facets from each of the best of these


def applies(problem: Problem, options: Mapping[str, Any]) -> bool:
    """Whether a model is a body of free facets at a constant ω with a normal prior."""
    names = set(problem.names)
    facet_sites = NORMALS in names and any(k in names for k in SIZES)
    return facet_sites and OMEGA in names and options.get("spin", "free") == "free"


def complete_search(
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
    workers: int,
    progress: Silent,
) -> tuple[SearchState, Coverage]:
    """Optima of the posterior over all constant spins that the prior allows, best first.

    1. Every cell of pole and rate gets the evidence of a random body (`series`), from the closest
       pair of passes to all (`cells`).
    2. The best distinct states are improved with free albedo-areas on a grid of normals and free
       phases between arcs (`bodies`); the constant spins that fit these phases follow (`states`).
    3. Bodies of N facets are optimised from there with the posterior itself (`facets`).

    Parameters
    ----------
    problem : Problem
    data : Epochs
    options : mapping
        Of the model, with defaults: ``omega_sd``, ``n_facets`` and ``reflectance``.
    workers : int
    progress : Silent

    Returns
    -------
    SearchState, Coverage
    """
    law = _law(options)
    omega_sd, n_facets = float(options["omega_sd"]), int(options["n_facets"])
    points = Points.of(data)
    fastest = PRIOR_REACH * omega_sd
    arcs = Arcs.of(points, fastest, SERIES_ERROR)
    series = Series.of(law)
    prior = precision(series, points.sun, points.obs, points.flux)
    grid = Grid.of(series, arcs, prior, fastest, omega_sd)
    cells, coverage = grid.search(workers, progress, SURVIVORS)
    rows = states.representatives(grid, cells, STAGES[0].states)
    middle = np.asarray(arcs.middle)
    pole, rate = grid.poles[cells.pole[rows]], cells.rate[rows]
    phase = rate[:, None] * middle
    total = sum(s.states for s in STAGES) + STRICT.states
    with progress.stage("improving spins", total, "spins") as bar:
        found = _stage(points, fastest, pole, rate, phase, law, STAGES[0], workers)
        bar.advance(STAGES[0].states)
        for stage in STAGES[1:]:
            found = found.at(states.distinct(found, arcs.duration, stage.states))
            found = _stage(points, fastest, found.pole, found.rate, found.phase, law, stage, workers)
            bar.advance(stage.states)
        strict = _constant(grid, points, found, law, workers)
        bar.advance(STRICT.states)
    ends = _optimised(problem, data, points, strict, n_facets, omega_sd, law, workers, progress)
    return ends, coverage


def _law(options: Mapping[str, Any]) -> DiffuseLaw:
    """The reflectance of the search: that of the model if it is diffuse."""
    law = options.get("reflectance", "lambertian")
    return law if law in DIFFUSE_LAWS else "lambertian"


def _stage(
    points: Points, fastest: float, pole, rate, phase, law: DiffuseLaw, stage: Stage, workers: int
) -> States:
    """States improved with the error and the normals of a stage, best first."""
    arcs = Arcs.of(points, fastest, stage.error)
    normals = facets.grid(stage.normals)
    found = bodies.improved(arcs, pole, rate, phase, law, normals, stage.steps, workers)
    return found.at(np.argsort(found.chi2, kind="stable"))


def _constant(
    grid: Grid, points: Points, found: States, law: DiffuseLaw, workers: int
) -> States:
    """Constant spins that fit the phases of the states, improved, best first."""
    rows = states.distinct(found, grid.arcs.duration, STAGES[-1].states)
    pole, rate, phase, loss = [], [], [], []
    for i in rows:
        rates, origin, lost = states.spins(grid, found, int(i), ALIASES)
        pole += [found.pole[i]] * rates.size
        rate += list(rates)
        phase += list(origin)
        loss += list(found.chi2[i] + lost)
    best = np.argsort(loss, kind="stable")[: STRICT.states]
    arcs = Arcs.whole(points, STRICT.error)
    start = np.array(phase)[best] + np.array(rate)[best] * float(arcs.middle[0])
    strict = bodies.improved(
        arcs,
        np.array(pole)[best],
        np.array(rate)[best],
        start[:, None],
        law,
        facets.grid(STRICT.normals),
        STRICT.steps,
        workers,
    )
    strict = strict.at(np.argsort(strict.chi2, kind="stable"))
    span = float(np.ptp(points.t))
    return strict.at(states.distinct(strict, span, len(OPTIMISED)))


def _optimised(
    problem, data, points, strict: States, n_facets, omega_sd, law, workers, progress
) -> SearchState:
    """Optima of the posterior from the constant spins, best first."""
    normals = facets.grid(STRICT.normals)
    middle = 0.5 * (points.t[0] + points.t[-1])
    parts = []
    rng = np.random.default_rng(0)
    for i, n in zip(range(strict.rate.size), OPTIMISED, strict=False):
        angle = strict.phase[i, 0] - strict.rate[i] * middle  # at t = 0
        axes = np.asarray(frame(jnp.asarray(strict.pole[i]))) @ _about_z(angle)
        for _ in range(n):
            found, areas = bodies.clustered(strict.areas[i], normals, n_facets, rng)
            parts.append((strict.pole[i] * strict.rate[i], found @ axes.T, areas))
    every = Bodies(*(np.stack(x) for x in zip(*parts, strict=True)))
    rows = starts(problem, data, every, omega_sd)
    ends = search.successive_halving(problem, data, jnp.asarray(rows), workers, progress)
    return reinserted(problem, data, points, law, ends, workers)


def _about_z(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
