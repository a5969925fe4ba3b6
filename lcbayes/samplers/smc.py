"""Tempered sequential Monte Carlo from the prior: all solutions, their weights and the evidence.

Particles drawn from the prior p₀ move to the posterior p₀ Πₜ Lₜ through the sequence of densities
p₀ Πₜ Lₜ^wₜ(s), s = 0 → 1, in which all powers wₜ rise from 0 to 1
(`lcbayes.samplers.tempering_path`). Each step has three parts:

1. The step to s′ is chosen such that a given share of the particles remains effective. The evidence
   is multiplied by the mean of the weights Π Lₜ^(wₜ(s′) − wₜ(s)) over the particles at s.
2. The starting points of the chains are resampled in proportion to these weights.
3. Each chain moves by the exact Fisher-adaptive kernel (`kernels`), until the distance moved is
   about the width of a solution. All points of the chains are particles at s′; none is discarded.

Step size and scale are adapted to the set of all particles. A single particle has little influence
on them, and the resulting bias is O(1/N).

References
----------
Del Moral, Doucet & Jasra 2006, JRSS B 68, 411; Dau & Chopin 2022, JRSS B 84, 114 (waste-free: all
points of the chains are particles); Jasra et al. 2011, Scand. J. Stat. 38, 1 (adaptive steps).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import in_blocks
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent, Track
from lcbayes.core.reasons import Finding
from lcbayes.core.threads import threads
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import moves, tempering, tempering_path
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.moves import Moved, Tuning
from lcbayes.samplers.tempering_path import FULL_DATA, TimePath

Floats = NDArray[np.float64]

BLOCKS = 4  # of particles; constant, so that results do not depend on the number of threads
PROBES = 256  # particles whose information matrices determine the width of a solution
MAX_STAGES = 300
MIN_ACCEPTANCE = 0.15


class Collapse(RuntimeError):
    """The particles no longer follow the posterior; the message gives the stage and a remedy."""


@dataclass(frozen=True)
class Plan:
    """Settings of a run; the defaults were determined with benchmarks/smc.py."""

    # Factor on the number of chains while points are added, when solutions are found or lost.
    oversampling: int = 4
    share: float = 0.8  # of the particles that remains effective in a step
    length: float = 1.5  # of a trajectory: a quarter turn of a Gaussian in its own metric
    max_steps: int = 12  # leapfrog steps of a move
    spread: float = 0.5  # of the logarithm of step sizes
    accept: float = 0.75  # target acceptance rate of the step size adaptation
    delta: float = 0.5  # distance at which the metric is evaluated, in widths of a solution
    moved: float = 0.5  # squared distance of a stage, over that of independent points
    min_moves: int = 8  # with 3, most runs on four facets lost the true solution
    max_moves: int = 40
    max_pool: int = 64  # maximum number of draws from the prior, over the number of chains


@dataclass
class Stage:
    """One step of the tempering schedule."""

    s: float
    num_moves: int
    accept: float  # mean acceptance rate of the last moves
    step_size: float
    moved: float
    log_evidence: float  # up to this step


@dataclass
class Result:
    """Equally weighted particles of the posterior, with diagnostics of the run.

    Attributes
    ----------
    z : (N, D)
        N = n_particles × points on each chain, ordered by chain.
    log_likelihood : (N,)
    log_evidence : float
        ln ∫ exp(−U) dz, with the potential U of the problem and the given data.
    stages : list of Stage
        In order of s, up to 1.
    reasons : list of Finding
        Reasons not to trust the result; empty if the run detected no problem.
    """

    z: Floats
    log_likelihood: Floats
    log_evidence: float
    stages: list[Stage]
    points: int  # on each chain
    gradients: int
    seconds: float
    reasons: list[Finding] = field(default_factory=list)

    @property
    def acceptance(self) -> Floats:
        """Acceptance rate of each stage, (K,)."""
        return np.array([s.accept for s in self.stages])


def run(
    problem: Problem,
    data: Epochs,
    key: jax.Array,
    n_particles: int = 1000,
    *,
    plan: Plan | None = None,
    mirror: Floats | None = None,
    workers: int = 2,
    progress: Silent | None = None,
) -> Result:
    """The posterior of a problem from its prior; results do not depend on the number of workers.

    Parameters
    ----------
    problem, data
        Stages differ only in the values of `Epochs.information`, so programs compile only once.
    key : random key
    n_particles : int
        Number of chains at each stage; the particles are all points of the chains.
    plan : Plan, optional
    mirror : (D, D), optional
        A matrix that is its own inverse and an expected symmetry of the posterior
        (`lcbayes.inference.symmetry`). A move to the mirror image is proposed for half of the
        particles after each move.
    workers : int
        Number of threads.
    progress : Silent or Console

    Raises
    ------
    InputError
        If the likelihood of the model ignores `Epochs.information`, so that it cannot be tempered,
        or if hardly any draw from its prior has a non-zero density.
    Collapse
        If hardly any move is accepted, or if no further step is possible.
    """
    progress = progress or Silent()
    with threads(workers) as pool, progress.stage("tempering", 100, "%") as track:
        return _Run(problem, data, n_particles, plan or Plan(), mirror, pool, track).go(key)


class _Run:
    """State of a run."""

    def __init__(
        self,
        problem: Problem,
        data: Epochs,
        n: int,
        plan: Plan,
        mirror: Floats | None,
        pool: Executor,
        track: Track,
    ) -> None:
        self.problem, self.data, self.n, self.plan, self.mirror = problem, data, n, plan, mirror
        self.pool, self.track = pool, track
        self.path = TimePath.of(
            data, problem.dim, tempering_path.rotates(problem, data, jax.random.key(0))
        )
        self.step_size, self.gradients, self.reported = 0.5, 0, 0
        self.stages: list[Stage] = []
        self.reasons: list[Finding] = []

    def go(self, key: jax.Array) -> Result:
        begun = time.monotonic()
        key, key_draw = jax.random.split(key)
        z, log_likelihood, log_weights, log_evidence = self._first(key_draw)
        s = 0.0
        while s < 1.0:
            new = tempering.next_step(
                log_weights, log_likelihood, self.path.powers, s, self.plan.share
            )
            if new <= s or len(self.stages) == MAX_STAGES:
                raise Collapse(
                    f"the particles stopped {s:.0%} of the way to the posterior after "
                    f"{len(self.stages)} steps: the likelihood differs too much between them; "
                    "give more particles"
                )
            rise = self.path.powers(new) - self.path.powers(s)
            log_weights = log_weights + tempering.change(log_likelihood, rise)
            log_evidence += tempering.log_sum(log_weights)
            s = new
            key, key_choice, key_move = jax.random.split(key, 3)
            uniform = float(jax.random.uniform(key_choice))
            n_chains = self.n if s > FULL_DATA else self.n * self.plan.oversampling
            chosen = tempering.systematic(log_weights, n_chains, uniform)
            z, log_likelihood = self._moved(key_move, s, z[chosen], log_evidence)
            log_weights = np.full(len(z), -np.log(len(z)))
            self._tell()
        return Result(
            z,
            log_likelihood.sum(axis=1),
            float(log_evidence),
            self.stages,
            len(z) // self.n,
            self.gradients,
            time.monotonic() - begun,
            self.reasons,
        )

    def _first(self, key: jax.Array) -> tuple[Floats, Floats, Floats, float]:
        """Draws from the prior, weighted by the model's factors, enough for n particles."""
        drawn, n_pool, wanted = [], 0, self.n * self.plan.oversampling
        for i in range(self.plan.max_pool):
            parts = self._blocks(
                lambda k: moves.draw(
                    self.problem, self.data, self.path.bins, jax.random.wrap_key_data(k)
                ),
                _keys(jax.random.fold_in(key, i), wanted),
            )
            good = np.isfinite(parts.log_factors) & np.isfinite(parts.log_likelihood).all(axis=1)
            drawn.append(jax.tree.map(lambda x, good=good: x[good], parts))
            n_pool += wanted
            pooled = jax.tree.map(lambda *x: np.concatenate(x), *drawn)
            if len(pooled.z) and tempering.effective_number(pooled.log_factors) >= wanted:
                break
        else:
            effective = tempering.effective_number(pooled.log_factors) if len(pooled.z) else 0.0
            if effective < 0.05 * wanted:
                raise InputError(
                    f"of {n_pool} draws from the prior only about {effective:.0f} have any density "
                    "(every facet must be lit and seen); ask for fewer facets or more particles"
                )
        if not self._follows(pooled.z[0], pooled.log_likelihood[0].sum()):
            raise InputError(
                "the model's likelihood does not follow data.information, so that it cannot be "
                "tempered; end the model with lcbayes.modelling.likelihood.observe(data, flux)"
            )
        kept = pooled.log_factors > pooled.log_factors.max() - 40.0
        z, log_factors, log_likelihood = (np.asarray(x)[kept] for x in pooled)
        log_evidence = float(tempering.log_sum(log_factors) - np.log(n_pool))
        return z, log_likelihood, tempering.normalised(log_factors), log_evidence

    def _follows(self, z: Floats, log_likelihood: float) -> bool:
        """Whether the likelihood of the model drops out if the data have no information."""
        ends = (self.path.at(self.data, 0.0), self.path.at(self.data, 1.0))
        without, whole = (
            self._blocks(lambda z, at=at: moves.start(self.problem, at, z), z[None]).potential[0]
            for at in ends
        )
        return bool(np.isclose(without - whole, log_likelihood, rtol=1e-6))

    def _moved(
        self, key: jax.Array, s: float, z: Floats, log_evidence: float
    ) -> tuple[Floats, Floats]:
        """Chains from z (n, D) at one step of the schedule: all their points, ordered by chain."""
        plan, at = self.plan, self.path.at(self.data, s)
        state = self._blocks(lambda z: moves.start(self.problem, at, z), z)
        probes = np.linspace(0, len(z) - 1, min(PROBES, len(z))).astype(int)
        information, variance = (
            np.asarray(x)
            for x in self._blocks(lambda z: moves.inform(self.problem, at, z), z[probes])
        )
        width = _width(variance, z)
        passed, moved, accepted = [], 0.0, []
        while len(passed) < plan.max_moves and (len(passed) < plan.min_moves or moved < plan.moved):
            tuning = Tuning(
                self.step_size, plan.spread, plan.length, plan.max_steps, plan.delta, width
            )
            out: Moved = self._blocks(
                lambda k, s, tuning=tuning: moves.move(
                    self.problem,
                    at,
                    self.data,
                    self.path.bins,
                    tuning,
                    self.mirror,
                    jax.random.wrap_key_data(k),
                    s,
                ),
                _keys(jax.random.fold_in(key, len(passed)), len(z)),
                state,
            )
            state = out.state
            passed.append((state.z, out.log_likelihood))
            accepted.append(float(np.mean(out.accept)))
            self.gradients += int(out.num_steps.sum())
            self.step_size *= float(np.exp(np.clip(accepted[-1] - plan.accept, -0.5, 0.5)))
            moved = _moved_by(np.asarray(state.z[probes]) - z[probes], information)
        accept = float(np.mean(accepted[-5:]))
        self.stages.append(
            Stage(s, len(passed), accept, self.step_size, moved, float(log_evidence))
        )
        if accept < MIN_ACCEPTANCE:
            raise Collapse(
                f"{s:.0%} of the way to the posterior {accept:.1%} of the moves are accepted "
                f"after {len(passed)} changes of the step size (now {self.step_size:.2g}); the "
                "posterior is too rough to follow: check the errors of the data"
            )
        if moved < 0.5 * plan.moved:
            little = {"progress": float(s), "moved": float(moved), "moves": len(passed)}
            self.reasons.append(Finding("particles-moved-little", little))
        points, reached = (np.stack(x, axis=1) for x in zip(*passed, strict=True))
        return points.reshape(-1, points.shape[-1]), reached.reshape(-1, reached.shape[-1])

    def _blocks(self, f: Callable[..., Any], *rows: Any) -> Any:
        """f of rows, which share the first axis, in equal blocks on the threads."""
        return in_blocks(f, -(-self.n // BLOCKS), *rows, over=self.pool.map)

    def _tell(self) -> None:
        """Report the progress in per cent of s."""
        now = self.stages[-1]
        done = int(100 * now.s)
        self.track.advance(done - self.reported, f"{now.accept:.0%} accepted")
        self.reported = done


def _keys(key: jax.Array, n: int) -> NDArray[np.uint32]:
    """The data of n keys split from one key, as integers.

    Indexing an array of keys is a hundred times as slow and blocks the other threads.
    """
    return np.asarray(jax.random.key_data(jax.random.split(key, n)))


def _width(variance: Floats, z: Floats) -> Floats:
    """Typical width of a solution (D,), from the valid ones of the variances (n, D)."""
    good = np.all(np.isfinite(variance) & (variance > 0), axis=1)
    return np.sqrt(np.median(variance[good], axis=0)) if good.any() else z.std(axis=0) + 1e-12


def _moved_by(jump: Floats, information: Floats) -> float:
    """Typical squared distance in widths of a solution, over 2 D, the value of independent points.

    The median is used, because points that move to another solution cover much larger distances.
    """
    distance = np.einsum("ni,nij,nj->n", jump, information, jump) / (2 * jump.shape[1])
    return float(np.median(np.nan_to_num(distance)))


@dataclass(frozen=True)
class Runs:
    """Independent runs, whose scatter gives the error of the evidence.

    Attributes
    ----------
    runs : list of Result
    """

    runs: list[Result]

    @property
    def log_evidences(self) -> Floats:
        return np.array([r.log_evidence for r in self.runs])

    @property
    def log_evidence(self) -> float:
        return mean_evidence(self.log_evidences).value

    @property
    def spread(self) -> float:
        """Standard deviation of the runs' ln evidence: the error of one run."""
        return float(np.std(self.log_evidences, ddof=1))

    @property
    def se(self) -> float:
        """Standard error of the mean over the runs."""
        return mean_evidence(self.log_evidences).se


def mean_evidence(log_evidences: Floats) -> LogEvidence:
    """ln of the mean evidence of runs (C,); the evidence is unbiased, its logarithm is not."""
    n = len(log_evidences)
    value = tempering.log_sum(log_evidences) - float(np.log(n))
    return LogEvidence(value, float(np.std(log_evidences, ddof=1) / np.sqrt(n)))


def replicate(
    problem: Problem,
    data: Epochs,
    key: jax.Array,
    n_particles: int = 1000,
    n_runs: int = 4,
    **options: Any,
) -> Runs:
    """Independent runs with different keys, at least 2; compiled once."""
    if n_runs < 2:
        raise ValueError(f"n_runs is {n_runs}; a spread needs 2 or more")
    keys = jax.random.split(key, n_runs)
    return Runs([run(problem, data, k, n_particles, **options) for k in keys])
