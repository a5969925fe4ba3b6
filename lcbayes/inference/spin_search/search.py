"""The complete search for the constant spin of a body of facets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Silent, Track
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search import bodies, states
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import MIN_SUNLIGHT, Arcs, Points
from lcbayes.inference.spin_search.bodies import States
from lcbayes.inference.spin_search.cells import Cells, Coverage, Grid
from lcbayes.inference.spin_search.facets import (
    AREAS,
    NORMALS,
    OMEGA,
    Bodies,
    climbed,
    sharpened,
    starts,
)
from lcbayes.inference.spin_search.series import Series, frame, precision, total_area
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import DIFFUSE_LAWS, DiffuseLaw

Floats = NDArray[np.float64]

MIN_POINTS = 12  # below, starts from the prior do as well
SURVIVORS = 60_000  # cells at the finest level
SERIES_ERROR = 0.15  # of the series and of the size of a cell, relative to the mean flux


@dataclass(frozen=True)
class Stage:
    """States carried on, the error of the free body (relative), normals of its grid, and steps."""

    states: int
    error: float
    normals: int
    steps: int


STAGES = (Stage(240, 0.05, 100, 7), Stage(60, 0.01, 250, 6))
ALIASES = 24  # spins tried for each state of the last stage
SCREENED = Stage(60 * ALIASES, 0.03, 120, 0)  # their bodies, before the best are improved
CELLS = 1000  # cells tried as they are
PER_STATE = 3  # of the aliases of a state, carried on
STRAY = 3.0  # rad over the time base by which a spin may leave the allowed rates
CONSTANT = (Stage(240, 0.01, 160, 5), Stage(110, 0.003, 400, 4))  # constant spins with a free body
OPTIMISED: tuple[int, ...] = (
    24,
    16,
    12,
    8,
    8,
    8,
    *(4,) * 20,
    *(2,) * 50,
)  # bodies of N facets from each of the best of these


OPTIMISED_SLOW: tuple[int, ...] = (12, 8, 8, *(4,) * 12, *(2,) * 20)
SLOW_TURNS = 40.0  # over the time base
SLOW_ERROR = 0.06  # of the series, as `SERIES_ERROR`: slow cells are smaller in phase
# Rounds of successive halving of bodies of N facets: see `inference.search`.
ROUNDS = ((1.0, 12, 0.25), (1.0, 30, 0.3), (1.0, 150, 1.0))


def applies(problem: Problem, data: Epochs, options: Mapping[str, Any]) -> bool:
    """Whether a fit is of a body of diffuse facets at a constant ω with a normal prior."""
    sites = {NORMALS, OMEGA, AREAS} <= set(problem.names)
    spins = options.get("spin") == "free" and options.get("reflectance") in DIFFUSE_LAWS
    return sites and spins and int(jnp.sum(data.sunlight > MIN_SUNLIGHT)) >= MIN_POINTS


def complete_search(
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
    workers: int,
    progress: Silent,
    checkpoint: Checkpoint | None = None,
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
        Of the model, with defaults: ``omega_sd``, ``period``, ``pole``, ``n_facets`` and
        ``reflectance``.
    workers : int
    progress : Silent
    checkpoint : Checkpoint, optional
        Keeps the cells of each level and the spins of each stage, from which an interrupted search
        goes on.

    Returns
    -------
    SearchState, Coverage
    """
    spins = find_spins(data, options, workers, progress, checkpoint)
    return with_bodies(problem, data, options, spins, workers, progress), spins.coverage


@dataclass(frozen=True)
class Spins:
    """Constant spins, each with a free body, and what the search for them covered.

    They do not depend on a number of facets.

    Attributes
    ----------
    run : _Refinement
    found : tuple of (States, tuple of int)
        Spins, best first, and the number of bodies to optimise from each.
    coverage : Coverage
    """

    run: _Refinement
    found: tuple[tuple[States, tuple[int, ...]], ...]
    coverage: Coverage


def find_spins(
    data: Epochs,
    options: Mapping[str, Any],
    workers: int,
    progress: Silent,
    checkpoint: Checkpoint | None = None,
) -> Spins:
    """The constant spins at which some body fits; parameters as for `complete_search`."""
    kept = Checkpoint(None, {}) if checkpoint is None else checkpoint.within("search")
    law: DiffuseLaw = options["reflectance"]
    allowed = Allowed.of(options, data)
    points, series = Points.of(data), Series.of(law)
    total = total_area(series, points.sun, points.obs, points.flux)
    arcs = Arcs.of(points, allowed.fastest, SERIES_ERROR)
    grid = Grid.of(series, arcs, precision(series, total), allowed)
    cells, coverage = grid.search(workers, progress, SURVIVORS, kept)
    slow_cells = _slow(grid, points, workers, progress, kept.within("slow"))
    run = _Refinement(points, grid, law, total, workers)
    constant = SCREENED.states + sum(s.states for s in CONSTANT)
    n_states = sum(s.states for s in STAGES) + constant * (1 if slow_cells is None else 2)
    with progress.stage("improving spins", n_states, "spins") as bar:
        found = [(run.constant(cells, run.free(cells, bar, kept), bar, kept), OPTIMISED)]
        if slow_cells is not None:
            slow = run.constant(slow_cells, None, bar, kept.within("slow"))
            found.append((slow, OPTIMISED_SLOW))
    return Spins(run, tuple(found), coverage)


def with_bodies(
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
    spins: Spins,
    workers: int,
    progress: Silent,
    further: Floats | None = None,
) -> SearchState:
    """Optima of bodies of N facets at spins, best first; ``further`` are more starts (n, D)."""
    run, n, omega_sd = spins.run, int(options["n_facets"]), float(options["omega_sd"])
    starts = [run.bodies(problem, data, f, counts, n, omega_sd) for f, counts in spins.found]
    if further is not None:
        starts.append(further)
    ends = search.successive_halving(
        problem, data, jnp.concatenate(starts), workers, progress, rounds=ROUNDS
    )
    gaps = np.diff(np.sort(np.asarray(run.grid.arcs.middle)))
    return climbed(problem, data, run.points, run.law, ends, gaps, workers)


def _slow(
    grid: Grid, points: Points, workers: int, progress: Silent, kept: Checkpoint
) -> Cells | None:
    """Cells of slow spins, if the prior allows others too.

    A body symmetric about its pole fits slow changes at any rate: without places of their own, slow
    spins are crowded out.
    """
    limit = 2 * np.pi * SLOW_TURNS / max(float(grid.arcs.span[-1]), 1e-9)
    slow = grid.allowed.up_to(limit)
    if slow is None or limit >= grid.allowed.fastest:
        return None
    arcs = Arcs.of(points, grid.allowed.fastest, SLOW_ERROR)
    slower = Grid.of(grid.series, arcs, grid.prior, slow)
    return slower.search(workers, progress, SURVIVORS, kept)[0]


class Motions(NamedTuple):
    """Constant spins: poles (n, 3), rates (n,) rad/s and phases (n, 1) rad, as in `States`."""

    pole: Floats
    rate: Floats
    phase: Floats


@dataclass(frozen=True)
class _Refinement:
    """From the cells that survive to bodies at constant spins."""

    points: Points
    grid: Grid
    law: DiffuseLaw
    total_area: float
    workers: int

    def free(self, cells: Cells, bar: Track, kept: Checkpoint) -> States:
        """States improved with free phases between the arcs, best first."""
        rows = states.representatives(self.grid, cells, STAGES[0].states)
        rate = cells.rate[rows]
        phase = rate[:, None] * np.asarray(self.grid.arcs.middle)
        at = self.grid.poles[cells.pole[rows]], rate, phase
        for i, stage in enumerate(STAGES):
            arcs = Arcs.of(self.points, self.grid.allowed.fastest, stage.error)
            found = kept.once(
                f"free-{i}", States, lambda a=arcs, m=at, s=stage: self._improved(a, *m, s)[1]
            )
            bar.advance(stage.states)
            if i + 1 < len(STAGES):
                duration = self.grid.arcs.duration
                found = found.at(states.distinct(found, duration, STAGES[i + 1].states))
                at = found.pole, found.rate, found.phase
        return found

    def constant(self, cells: Cells, found: States | None, bar: Track, kept: Checkpoint) -> States:
        """Constant spins of cells or that fit the phases of states, improved, best first.

        Slow spins turn little within an arc, so that free phases hardly constrain them; there, the
        cells themselves are better.
        """
        span = float(np.ptp(self.points.t))
        at = kept.once("screened", Motions, lambda: self._screened(cells, found, span))
        bar.advance(SCREENED.states)
        for i, stage in enumerate(CONSTANT):
            arcs = Arcs.whole(self.points, stage.error)
            strict = kept.once(
                f"constant-{i}", States, lambda a=arcs, m=at, s=stage: self._improved(a, *m, s)[1]
            )
            bar.advance(stage.states)
            rows = states.distinct(strict, span, CONSTANT[-1].states)
            at = Motions(strict.pole[rows], strict.rate[rows], strict.phase[rows])
        strict = strict.at(self._permitted(strict, span))
        return strict.at(states.distinct(strict, span, len(OPTIMISED)))

    def _permitted(self, found: States, span: float) -> NDArray[np.int64]:
        """Rows of states that have not left the allowed rates; all rows if every state has."""
        inside = self.grid.allowed.rates(found.rate, STRAY / max(span, 1e-9))
        return np.flatnonzero(inside if inside.any() else ~inside)

    def _screened(self, cells: Cells, found: States | None, span: float) -> Motions:
        """The best constant spins among the cells and those near states."""
        middle = 0.5 * (self.points.t[0] + self.points.t[-1])
        rows = states.representatives(self.grid, cells, CELLS, span)
        pole, rate = [*self.grid.poles[cells.pole[rows]]], [*cells.rate[rows]]
        phase, group = [0.0] * len(rows), [*range(-len(rows), 0)]
        if found is not None:
            for i in states.distinct(found, self.grid.arcs.duration, STAGES[-1].states):
                rates, origin = states.spins(self.grid, found, int(i), ALIASES)
                inside = self.grid.allowed.rates(rates, STRAY / max(span, 1e-9))
                rates, origin = rates[inside], origin[inside]
                pole += [found.pole[i]] * rates.size
                rate += [*rates]
                phase += [*(origin + rates * middle)]
                group += [int(i)] * rates.size
        arcs = Arcs.whole(self.points, SCREENED.error)
        start = np.array(pole), np.array(rate), np.array(phase)[:, None]
        order, screened = self._improved(arcs, *start, SCREENED)
        rows = states.within(np.array(group)[order], PER_STATE)[: CONSTANT[0].states]
        return Motions(screened.pole[rows], screened.rate[rows], screened.phase[rows])

    def bodies(
        self,
        problem: Problem,
        data: Epochs,
        found: States,
        counts: Sequence[int],
        n_facets: int,
        omega_sd: float,
    ) -> Floats:
        """Unconstrained vectors (n, D) of bodies of N facets, ``counts`` at each constant spin."""
        normals = facets.grid(CONSTANT[-1].normals)
        middle = 0.5 * (self.points.t[0] + self.points.t[-1])
        rng = np.random.default_rng(0)
        parts = []
        for i, n in zip(range(found.rate.size), counts, strict=False):
            angle = found.phase[i, 0] - found.rate[i] * middle  # at t = 0
            axes = np.asarray(frame(jnp.asarray(found.pole[i]))) @ _about_z(angle)
            omega = found.pole[i] * found.rate[i]
            free = sharpened(
                self.points, omega, self.law, normals @ axes.T, found.areas[i], self.total_area
            )
            parts += [(omega, *bodies.clustered(*free, n_facets, rng)) for _ in range(n)]
        every = Bodies(*(np.stack(x) for x in zip(*parts, strict=True)))
        return starts(problem, data, every, omega_sd)

    def _improved(
        self, arcs: Arcs, pole, rate, phase, stage: Stage
    ) -> tuple[NDArray[np.int64], States]:
        """States improved with the normals of a stage, best first, and their rows at the start."""
        found = bodies.improved(
            arcs,
            (pole, rate, phase),
            self.law,
            facets.grid(stage.normals),
            area_sd=self.total_area,
            steps=stage.steps,
            workers=self.workers,
        )
        order = np.argsort(found.chi2, kind="stable")
        return order, found.at(order)


def _about_z(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
