"""The complete search for the constant spin of a body of facets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Silent, Track
from lcbayes.inference import search
from lcbayes.inference.facet_climb import climbed
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search import bodies, states
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.bodies import States
from lcbayes.inference.spin_search.cells import Cells, Coverage, Grid
from lcbayes.inference.spin_search.drift import NONE, Drift
from lcbayes.inference.spin_search.facets import OMEGA, Bodies, aliases, starts
from lcbayes.inference.spin_search.pursuit import pursued
from lcbayes.inference.spin_search.series import Series, frame, precision, total_area
from lcbayes.modelling.epochs import MIN_SUNLIGHT, Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import DIFFUSE_LAWS, DiffuseLaw
from lcbayes.samplers.facet_moves import AREAS, NORMALS

Floats = NDArray[np.float64]

MIN_POINTS = 12  # below, starts from the prior do as well
SURVIVORS = 60_000  # cells at the finest level
SERIES_ERROR = 0.15  # of the series and of the size of a cell, relative to the mean flux


@dataclass(frozen=True)
class Stage:
    """Error of the free body (relative), normals of its grid, and steps."""

    error: float
    normals: int
    steps: int


class Ranking(NamedTuple):
    """The most cells ordered by matching pursuit, the relative error of its bodies, and how."""

    most: int
    error: float
    facets: int
    normals: int
    sweeps: int


FREE = (Stage(0.05, 100, 7), Stage(0.01, 250, 6))  # with free phases between arcs
STATES = (240, 60)  # improved in each of these stages
ALIASES = 24  # constant spins tried near each of the last states
CELLS = 1000  # cells tried as they are
STRAY = 3.0  # rad over the time base by which a spin may leave the allowed rates
SLOW_TURNS = 40.0  # over the time base
SLOW_ERROR = 0.06  # of the series, as `SERIES_ERROR`: slow cells are smaller in phase
DIRECTION_RATE = 0.02  # rad/s, at most, by which directions turn in a low orbit
PURSUED = 500  # normals of matching pursuit
RANKED = Ranking(most=20_000, error=0.05, facets=4, normals=160, sweeps=1)
# Rounds of successive halving of these bodies: see `inference.search`.
ROUNDS = ((1.0, 2, 0.4), (1.0, 6, 0.35), (1.0, 12, 0.3), (1.0, 30, 0.25), (1.0, 150, 1.0))


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

    The rate may change slowly if it does so in the problem.

    1. Every cell of pole and rate gets the evidence of a random body (`series`), from the closest
       pair of passes to all (`cells`).
    2. The best are ordered once more by bodies of a few facets (`pursuit`), slow ones apart.
       Between two passes, whole turns make no difference to the evidence. One cell then stands for
       all of them at first, and each number of turns is ordered by facets afterwards.
    3. The best distinct states by either order are improved with free albedo-areas on a grid of
       normals and free phases between arcs (`bodies`).
    4. Bodies of N facets are optimised with the posterior itself at the constant spins that fit
       these phases (`states`), and at those of the best cells.

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
    drift = Drift.of(data, problem, float(options["rate_drift_sd"]))
    spins = find_spins(data, options, workers, progress, checkpoint, drift)
    return with_bodies(problem, data, options, spins, workers, progress), spins.coverage


class Motions(NamedTuple):
    """Poles (n, 3), rates (n,) rad/s and phases (n, A) rad, as in `States`."""

    pole: Floats
    rate: Floats
    phase: Floats


class Rotations(NamedTuple):
    """Poles (n, 3), rates (n,) rad/s, their drifts (n,) in prior sd, and phases (n,) at t = 0."""

    pole: Floats
    rate: Floats
    drift: Floats
    phase: Floats


@dataclass(frozen=True)
class Spins:
    """Constant spins, and what the search for them covered.

    They do not depend on a number of facets.

    Attributes
    ----------
    run : _Refinement
    rotations : Rotations
    coverage : Coverage
    """

    run: _Refinement
    rotations: Rotations
    coverage: Coverage


def find_spins(
    data: Epochs,
    options: Mapping[str, Any],
    workers: int,
    progress: Silent,
    checkpoint: Checkpoint | None = None,
    drift: Drift = NONE,
) -> Spins:
    """The constant spins at which some body fits; parameters as for `complete_search`."""
    kept = Checkpoint(None, {}) if checkpoint is None else checkpoint.within("search")
    law: DiffuseLaw = options["reflectance"]
    allowed = Allowed.of(options, data)
    points, series = Points.of(data), Series.of(law)
    total = total_area(series, points.sun, points.obs, points.flux)
    arcs = Arcs.of(points, allowed.fastest, SERIES_ERROR)
    grid = Grid.of(series, arcs, precision(series, total), allowed, drift)
    found = grid.search(workers, progress, SURVIVORS, kept)
    run = _Refinement(points, grid, law, total, workers)
    slow = run.slow(progress, kept.within("slow"))
    with progress.stage("improving spins", 2 * STATES[0] + STATES[1], "spins") as bar:
        first = found.cells if grid.n_arcs > 2 else found.states
        ordered = run.by_facets(first.kept(RANKED.most))
        free = run.free([found.cells, ordered], bar, kept)

        def constant() -> Rotations:
            cells = [found.cells, ordered]
            if grid.n_arcs == 2:  # whose states stand for many spins
                cells[1] = run.by_facets(run.aliases(ordered))
            if slow is not None:
                cells += [slow, run.by_facets(slow, run.slow_rate)]
            return run.constant(cells, free)

        rotations = kept.once("constant", Rotations, constant)
    return Spins(run, rotations, found.coverage)


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
    starts = run.bodies(problem, data, spins.rotations, n, omega_sd)
    if further is not None:
        starts = np.concatenate([starts, further])
    ends = search.successive_halving(
        problem, data, jnp.asarray(starts), workers, progress, rounds=ROUNDS
    )
    middles = np.asarray(run.grid.arcs.middle)
    more = partial(aliases, problem, data, middles)
    return climbed(problem, data, run.law, ends, workers, progress, more)


@dataclass(frozen=True)
class _Refinement:
    """From the cells that survive to bodies at constant spins."""

    points: Points
    grid: Grid
    law: DiffuseLaw
    total_area: float
    workers: int

    @property
    def slow_rate(self) -> float:
        """Rate (rad/s) of the fastest slow spins."""
        return 2 * np.pi * SLOW_TURNS / max(float(self.grid.arcs.span[-1]), 1e-9)

    def slow(self, progress: Silent, kept: Checkpoint) -> Cells | None:
        """Cells of slow spins, if the prior allows others too.

        A body symmetric about its pole fits slow changes at any rate: without places of their own,
        slow spins are crowded out.
        """
        slow = self.grid.allowed.up_to(self.slow_rate)
        if slow is None or self.slow_rate >= self.grid.allowed.fastest:
            return None
        arcs = self.arcs(SLOW_ERROR, self.slow_rate)
        slower = Grid.of(self.grid.series, arcs, self.grid.prior, slow)
        return slower.search(self.workers, progress, SURVIVORS, kept).cells

    def free(self, cells: Sequence[Cells], bar: Track, kept: Checkpoint) -> States:
        """States of the best cells improved with free phases between the arcs, best first."""
        best = [c.at(states.representatives(self.grid, c, STATES[0])) for c in cells]
        poles, phases = np.concatenate([c.pole for c in best]), [self.phase(c) for c in best]
        rate = np.concatenate([c.rate for c in best])
        at = Motions(self.grid.poles[poles], rate, np.concatenate(phases))
        for i, stage in enumerate(FREE):
            improved = kept.once(
                f"free-{i}", States, lambda m=at, s=stage: self.improved(m, s, bar)
            )
            most = STATES[min(i + 1, len(FREE) - 1)]
            improved = improved.at(states.distinct(improved, self.grid.arcs.duration, most))
            at = Motions(improved.pole, improved.rate, improved.phase)
        return improved

    def phase(self, spins: Cells | Rotations, arcs: Arcs | None = None) -> Floats:
        """Phases (n, A) in the middle of arcs, since t = 0."""
        arcs = self.grid.arcs if arcs is None else arcs
        return self.grid.drift.phase(spins.rate, spins.drift, np.asarray(arcs.middle))

    def constant(self, cells: Sequence[Cells], free: States) -> Rotations:
        """Constant spins of the best cells, and those that fit the phases of states.

        Slow spins turn little within an arc, so that free phases hardly constrain them; there, the
        cells themselves are better.
        """
        span = float(np.ptp(self.points.t))
        parts = []
        for some in cells:
            rows = states.representatives(self.grid, some, CELLS, span)
            best = some.at(rows)
            poles = self.grid.poles[best.pole]
            parts.append(Rotations(poles, best.rate, best.drift, -best.rate * self._middle))
        for i in range(free.rate.size):
            near = states.spins(self.grid, free, i, ALIASES)
            inside = self.grid.allowed.rates(near[0], STRAY / max(span, 1e-9))
            rate, drift, phase = (x[inside] for x in near)
            pole = np.broadcast_to(free.pole[i], (rate.size, 3))
            parts.append(Rotations(pole, rate, drift, phase))
        return Rotations(*(np.concatenate(x) for x in zip(*parts, strict=True)))

    def arcs(self, error: float, fastest: float) -> Arcs:
        """Arcs for rates up to the fastest (rad/s), with a relative error of the body."""
        return Arcs.of(self.points, min(fastest + DIRECTION_RATE, self.grid.allowed.fastest), error)

    def by_facets(self, cells: Cells, fastest: float = np.inf) -> Cells:
        """Cells of rates up to the fastest (rad/s) in the order in which a few facets fit.

        The evidence of a random body leaves out what its series does not resolve. Bright data tell
        motions apart by that.
        """
        arcs = self.arcs(RANKED.error, fastest)
        motion = self.grid.poles[cells.pole], cells.rate, self.phase(cells, arcs)
        normals = facets.grid(RANKED.normals)
        fit = pursued(arcs, motion, self.law, normals, RANKED.facets, self.workers, RANKED.sweeps)
        return cells.at(np.argsort(fit.chi2[:, 0], kind="stable"))

    def aliases(self, pairs: Cells) -> Cells:
        """The best states of two arcs with any number of turns between these that an arc allows."""
        some = pairs.at(states.representatives(self.grid, pairs, STATES[0]))
        turn = 2 * np.pi / self.grid.gap
        n = int(np.ceil(self.grid.coarse_step / turn))
        rate = (some.rate[:, None] + turn * np.arange(-n, n + 1)).ravel()
        each = some.at(np.repeat(np.arange(some.rate.size), 2 * n + 1))._replace(rate=rate)
        return each.at((rate > 0.0) & self.grid.allowed.rates(rate, 0.5 * some.width))

    def bodies(
        self, problem: Problem, data: Epochs, spins: Rotations, n_facets: int, omega_sd: float
    ) -> Floats:
        """Unconstrained vectors (2 n, D) of bodies of N facets, two at each constant spin.

        Both are chosen by matching pursuit, one of them with a random facet.
        """
        places, arcs = facets.grid(PURSUED), Arcs.whole(self.points, 0.0)
        if self.grid.drift.sd:
            arcs = Arcs.of(self.points, self.grid.allowed.fastest, 0.0)
        rng = np.random.default_rng(0)
        first = rng.integers(len(places), size=(spins.rate.size, 1))
        motion = spins.pole, spins.rate, spins.phase[:, None] + self.phase(spins, arcs)
        fit = pursued(arcs, motion, self.law, places, n_facets, self.workers, first=first)
        parts = []
        for i, (pole, rate, drift, phase) in enumerate(zip(*spins, strict=True)):
            axes = (np.asarray(frame(jnp.asarray(pole))) @ _about_z(phase)).T
            each = zip(fit.rows[i], fit.areas[i], strict=True)
            parts += [(pole * rate, places[rows] @ axes, areas, drift) for rows, areas in each]
        every = Bodies(*(np.stack(x) for x in zip(*parts, strict=True)))
        return starts(problem, data, every, omega_sd)

    def improved(self, motions: Motions, stage: Stage, bar: Track) -> States:
        """States improved with free phases and the normals of a stage, best first."""
        arcs = Arcs.of(self.points, self.grid.allowed.fastest, stage.error)
        improved = bodies.improved(
            arcs,
            motions,
            self.law,
            facets.grid(stage.normals),
            area_sd=self.total_area,
            steps=stage.steps,
            workers=self.workers,
            report=bar.advance,
        )
        return improved.at(np.argsort(improved.chi2, kind="stable"))

    @property
    def _middle(self) -> float:
        """Of all points, s."""
        return 0.5 * float(self.points.t[0] + self.points.t[-1])


def _about_z(angle: float) -> Floats:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
