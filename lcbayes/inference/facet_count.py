"""Comparison of numbers of facets by evidence, with the same data weight for every number."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Parts, Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import basins, population, screening, search, sparse
from lcbayes.inference import correlation as information
from lcbayes.inference import goodness_of_fit as misfit
from lcbayes.inference.area_prior import AREA, AreaPrior, area_prior_of, bic
from lcbayes.inference.basins import evenly
from lcbayes.inference.fit import Posterior, posterior_of
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.loo import Loo, loo
from lcbayes.inference.odds import facets
from lcbayes.inference.prior_mass import log_prior_mass
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.replicates import Execution
from lcbayes.inference.screening import RuledOut
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, prior_draws
from lcbayes.modelling.registry import Entry
from lcbayes.samplers import smc
from lcbayes.samplers.sampling import Timing
from lcbayes.samplers.settings import Settings
from lcbayes.samplers.tempering_path import time_ordered

Floats = NDArray[np.float64]

STARTS = 64  # starts of the search for each number of facets
LOO_DRAWS = 2000


@dataclass(frozen=True)
class Candidate:
    """A number of facets and its evidence, fit and diagnostics.

    Attributes
    ----------
    n_facets, n_parameters : int
        Number of facets, and total number of parameters.
    log_evidences : (R,)
        Log evidence of each run, under the prior conditioned on every facet being seen.
    log_evidence, se : float
        ln of the mean evidence; its error, including that of the prior mass.
    spread : float
        Standard deviation of the runs' ln evidence.
    log_prior_mass : float
        `lcbayes.inference.prior_mass`; already subtracted.
    loo : Loo
    misfit : Misfit
        Misfit of the best fit reached from the best particle.
    information : float
        Information per point, from the residuals of the best particle.
    best : float
        ln likelihood of the best particle, with each point at full weight.
    z_best : (D,)
        The best particle.
    log_areas : (S, N)
        ln of the albedo-areas with a log-normal prior, of equally weighted draws; S = 0 if the
        model has none.
    posterior : Posterior or None
        Draws of each solution.
    reasons : list of Finding
        Reasons why the result is unreliable; empty if there are no problems.
    """

    n_facets: int
    n_parameters: int
    log_evidences: Floats
    log_evidence: float
    se: float
    log_prior_mass: float
    loo: Loo
    misfit: Misfit
    information: float
    best: float
    z_best: Floats
    gradients: int
    seconds: float
    reasons: list[Finding] = field(default_factory=list)
    log_areas: Floats = field(default_factory=lambda: np.zeros((0, 0)))
    posterior: Posterior | None = None

    @property
    def spread(self) -> float:
        return float(np.std(self.log_evidences, ddof=1))


@dataclass
class Compared:
    """Complete result of a comparison, before it is reported and written to files."""

    candidates: list[Candidate]  # in order of increasing number of facets
    ruled_out: list[RuledOut]  # in the same order
    failed: list[Finding]  # numbers for which sampling failed, with the reason
    information: float  # per point, the same for all candidates
    weighed_at: int  # number of facets of the fit whose residuals give it
    path: sparse.SparsePath | None
    search_s: float
    area_prior: AreaPrior | None = None
    path_fault: str = ""  # why there is no sparse path although it was asked for
    options: Mapping[str, Any] = field(default_factory=dict)  # of the model, without n_facets


def run(
    curve: LightCurve,
    entry: Entry,
    options: Mapping[str, Any],
    counts: Sequence[int],
    settings: Settings,
    upper_bound: int | None,
    checkpoint: Checkpoint,
    progress: Silent,
) -> Compared:
    """Evidence and LOO of each plausible number of facets, by `smc` from the prior.

    The numbers are processed in order of their best fits. A number whose largest likelihood lies
    far below an evidence already computed is ruled out (`lcbayes.inference.screening`).

    The likelihood is raised to the same power for every number, because evidences of different data
    cannot be compared. The power follows from the residuals of the best fit over all numbers
    (`lcbayes.inference.correlation`). Correlation that remains in the best model is attributed to
    the data; any further correlation in a poorer model counts against that model. If the search
    misses the best fit, the power is too low and the result is conservative. If the particles then
    find a fit with less correlated residuals, the candidate reports it.

    Parameters
    ----------
    counts
        Numbers of facets.
    settings
        Settings of the sampler "smc".
    upper_bound
        Initial number of facets of the sparse path, or None for no such path. The final number is
        compared with the others.

    Raises
    ------
    InputError
        If sampling from the prior fails for every number of facets.
    """
    data = Epochs.of(curve)
    key_search, key_runs, key_mass, key_path = jax.random.split(jax.random.key(settings.seed), 4)
    workers = max(1, min(os.cpu_count() or 1, settings.num_chains))
    plain = dict(options)
    sparsity = plain.pop("sparsity", 0.0) if upper_bound else 0.0  # for the sparse path only
    with entry.blamed():
        problems = {n: build_problem(entry, {**plain, "n_facets": n}, data)[0] for n in counts}

    begun = time.monotonic()
    searched = {
        n: _best_fit(problem, data, key_search, n, settings, workers, checkpoint, progress)
        for n, problem in problems.items()
    }
    optima = {n: z for n, z in searched.items() if z is not None}
    if not optima:
        raise InputError(
            "no start of the search has a finite posterior density; check the errors and the "
            "geometry, or widen the priors"
        )
    weighed_at = max(optima, key=lambda n: _log_likelihood(problems[n], optima[n], data))
    weighed = information.tempered(problems[weighed_at], optima[weighed_at], data)
    simplest = min(optima, key=lambda n: bic(problems[n], optima[n], weighed))
    area_prior = area_prior_of(entry, plain, problems[simplest], optima[simplest], data)
    if area_prior is not None and area_prior.from_data:
        plain["log_area_mean"] = area_prior.log_mean
        centred = {n: build_problem(entry, {**plain, "n_facets": n}, data)[0] for n in counts}
        optima = {n: _same_body(problems[n], z, centred[n], data) for n, z in optima.items()}
        problems = centred
    search_s = time.monotonic() - begun

    execution = Execution(settings, workers, checkpoint)
    comparison = _Comparison(entry, execution, problems, optima, data, weighed, plain)
    comparison.area_prior = area_prior
    with progress.stage("comparing", 100, "%") as track:
        parts = Parts(track, 100, sum(map(_cost, counts)))
        if upper_bound:
            comparison.follow_sparse_path(upper_bound, sparsity, key_path, parts)
        comparison.measure_all(key_runs, key_mass, parts)
    return comparison.result(weighed_at, search_s)


def reduced(
    curve: LightCurve,
    entry: Entry,
    options: Mapping[str, Any],
    upper_bound: int,
    settings: Settings,
    checkpoint: Checkpoint,
    progress: Silent,
) -> sparse.SparsePath:
    """The sparse path from the best fit with ``upper_bound`` facets.

    Raises
    ------
    InputError
        If no start of the search reaches a finite density.
    """
    data = Epochs.of(curve)
    key_search, key_path = jax.random.split(jax.random.key(settings.seed))
    workers = max(1, min(os.cpu_count() or 1, settings.num_chains))
    plain = {k: v for k, v in options.items() if k != "sparsity"} | {"n_facets": upper_bound}
    with entry.blamed():
        problem = build_problem(entry, plain, data)[0]
    z = _best_fit(problem, data, key_search, upper_bound, settings, workers, checkpoint, progress)
    if z is None:
        raise InputError(
            "no start of the search has a finite posterior density; check the errors and the "
            "geometry, or widen the priors"
        )
    weighed = information.tempered(problem, z, data)
    fits = [sparse.Fit(problem, z)]
    return sparse.follow(entry, options, upper_bound, fits, weighed, key_path, workers)


@dataclass
class _Comparison:
    """A comparison in progress: the problems and the results so far."""

    entry: Entry
    execution: Execution
    problems: dict[int, Problem]
    optima: dict[int, Floats]  # z of the best fit from each search
    data: Epochs
    weighed: Epochs  # the same data, with the common power of the likelihood
    options: Mapping[str, Any]  # of the model, without n_facets
    area_prior: AreaPrior | None = None
    candidates: dict[int, Candidate] = field(default_factory=dict)
    ruled_out: dict[int, RuledOut] = field(default_factory=dict)
    failed: list[Finding] = field(default_factory=list)
    path: sparse.SparsePath | None = None
    path_fault: str = ""

    def follow_sparse_path(
        self, upper_bound: int, sparsity: float, key: jax.Array, parts: Parts
    ) -> None:
        """The path from the best fits; its final number of facets joins the candidates."""
        options = dict(self.options) | ({"sparsity": sparsity} if sparsity else {})
        able = [n for n in self.optima if n <= upper_bound]
        able.sort(key=lambda n: -self._best_likelihood(n))
        fits = [sparse.Fit(self.problems[n], self.optima[n]) for n in able]
        try:
            self.path = sparse.follow(
                self.entry, options, upper_bound, fits, self.weighed, key, self.execution.workers
            )
        except InputError as fault:
            self.path_fault = str(fault)
            return
        n = self.path.n_facets
        if n not in self.problems:
            self.problems[n] = build_problem(
                self.entry, {**self.options, "n_facets": n}, self.data
            )[0]
            parts.total += _cost(n)

    def measure_all(self, key_runs: jax.Array, key_mass: jax.Array, parts: Parts) -> None:
        """Evidence of each number in order of the best fits, or the reason it is ruled out."""
        for n in sorted(self.problems, key=lambda n: (-self._best_likelihood(n), n)):
            if out := self._excluded(n):
                self.ruled_out[n] = out
                parts.total -= _cost(n)
                parts.reach(parts.done, f"{facets(n)} ruled out")
                continue
            settings = self.execution.settings
            with parts.part(_cost(n), facets(n), settings.num_chains) as within:
                own_runs, own_mass = (jax.random.fold_in(key, n) for key in (key_runs, key_mass))
                try:
                    self.candidates[n] = self._measured(n, own_runs, own_mass, within)
                except (smc.Collapse, InputError) as fault:
                    why = f"{facets(n)}: {fault}"
                    self.failed.append(Finding("number-not-followed", {"why": why}))

    def _measured(
        self, n: int, key_runs: jax.Array, key_mass: jax.Array, progress: Silent
    ) -> Candidate:
        problem, settings = self.problems[n], self.execution.settings
        name = f"facets-{n}-run"
        runs = self.execution.runs(
            problem, self.weighed, key_runs, settings.num_chains, name, progress
        )
        order = FacetOrder(problem, self.entry.facet_sites)
        measured = basins.measure(
            problem, self.weighed, runs, order, seed=settings.seed, workers=self.execution.workers
        )
        found = _candidate(n, problem, self.weighed, runs, measured.weighed, key_mass)
        modes, warnings = population.solutions_of(problem, self.weighed, measured, settings)
        timing = Timing(sampling_s=found.seconds, gradients=found.gradients)
        posterior = posterior_of(problem, self.weighed, order, modes, measured.weighed.log_evidence)
        posterior.reasons, posterior.timing = [*found.reasons, *warnings], timing
        posterior.settings = settings
        return replace(found, posterior=posterior)

    def _best_likelihood(self, n: int) -> float:
        if n not in self.optima:
            return -np.inf
        return _log_likelihood(self.problems[n], self.optima[n], self.data)

    def _excluded(self, n: int) -> RuledOut | None:
        """The number if it is ruled out by the largest evidence so far, or None.

        A number larger than one already sampled is never ruled out: a body with more facets fits at
        least as well, because a facet can be divided in two.
        """
        if not self.candidates or min(self.candidates) < n:
            return None
        problem, k = self.problems[n], min(self.candidates)
        starts = [self.optima[n][None]] if n in self.optima else []
        larger, sites = self.candidates[k].z_best, self.entry.facet_sites
        starts.append(screening.with_fewer(self.problems[k], larger, problem, sites, self.data))
        rows = np.concatenate([np.zeros((0, problem.dim)), *starts])
        if not len(rows):
            return None
        below, z = screening.largest_likelihood(problem, self.weighed, rows, self.execution.workers)
        if below + screening.MARGIN > max(c.log_evidence for c in self.candidates.values()):
            return None
        fit = misfit.measure(problem, self.weighed, z[None])
        return RuledOut(n, problem.n_parameters, below, fit)

    def result(self, weighed_at: int, search_s: float) -> Compared:
        """The complete result, without the numbers whose particles missed the posterior.

        Raises
        ------
        InputError
            If sampling from the prior failed for every number of facets.
        """
        power = float(self.weighed.information)
        best = {n: c.best for n, c in self.candidates.items()}
        for n, reason in screening.lost(best, power).items():
            del self.candidates[n]
            self.failed.append(reason)
        if not self.candidates:
            raise InputError(self.failed[0].values["why"])
        return Compared(
            [self.candidates[n] for n in sorted(self.candidates)],
            [self.ruled_out[n] for n in sorted(self.ruled_out)],
            self.failed,
            power,
            weighed_at,
            self.path,
            search_s,
            self.area_prior,
            self.path_fault,
            self.options,
        )


def _best_fit(problem, data, key, n, settings, workers, checkpoint, progress) -> Floats | None:
    """z of the best optimum of a search, (D,)."""
    stored = checkpoint.load(f"search-{n}")
    if stored is None:
        keys = jax.random.split(jax.random.fold_in(key, n), settings.num_starts or STARTS)
        starts, way = prior_draws(problem, keys, data), time_ordered(problem, data)
        ends = search.successive_halving(problem, data, starts, workers, progress, way)
        stored = {"z": np.asarray(ends.z[0]), "potential": np.asarray(ends.potential[0])}
        checkpoint.save(f"search-{n}", stored)
    return stored["z"] if np.isfinite(stored["potential"]) else None


def _candidate(
    n: int,
    problem: Problem,
    data: Epochs,
    runs: Sequence[smc.Result],
    weighed: basins.Weighed,
    key: jax.Array,
) -> Candidate:
    mass = log_prior_mass(problem, data, key)
    total, log_z = weighed.log_evidence, weighed.log_evidences - mass.value
    best = _best_particle(runs)
    optimum = search.polish(problem, data, best[None], 1).z[0]
    rows = jnp.asarray(np.vstack([_pooled(runs), best]))
    log_likelihood = np.asarray(_pointwise(problem, rows, data))
    log_areas = np.zeros((0, 0))
    if AREA in problem.names:
        log_areas = np.asarray(_log_areas(problem, rows[:-1], data))
    own = information.tempered(problem, best, data)
    reasons = list(dict.fromkeys(reason for r in runs for reason in r.reasons))
    reasons += weighed.reasons
    return Candidate(
        n_facets=n,
        n_parameters=problem.n_parameters,
        log_evidences=log_z,
        log_evidence=total.value - mass.value,
        se=float(np.hypot(total.se, mass.se)),
        log_prior_mass=mass.value,
        loo=loo(log_likelihood[:-1], float(data.information)),
        misfit=misfit.measure(problem, data, np.stack([best, optimum])),
        information=float(own.information),
        best=float(log_likelihood[-1].sum()),
        z_best=best,
        gradients=sum(r.gradients for r in runs),
        seconds=sum(r.seconds for r in runs),
        reasons=reasons,
        log_areas=log_areas,
    )


def _pooled(runs: Sequence[smc.Result]) -> Floats:
    """Equally weighted draws of all runs; each run is weighted by its evidence (unbiased)."""
    log_z = np.array([r.log_evidence for r in runs])
    share = np.exp(log_z - logsumexp(log_z))
    n = min(LOO_DRAWS, min(len(r.z) for r in runs) / share.max())
    parts = np.floor(n * share).astype(int)
    return np.concatenate([evenly(r.z, k) for r, k in zip(runs, parts, strict=True)])


def _best_particle(runs: Sequence[smc.Result]) -> Floats:
    best = max(runs, key=lambda r: r.log_likelihood.max())
    return best.z[np.argmax(best.log_likelihood)]


def _log_likelihood(problem: Problem, z: Floats, data: Epochs) -> float:
    """ln likelihood of all points, each at full weight."""
    return float(compiled(problem.log_likelihood)(jnp.asarray(z), data).sum())


@partial(jax.jit, static_argnums=0)
def _pointwise(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    """ln likelihood of every point at rows (n, D), as (n, T)."""
    return jax.lax.map(lambda row: problem.log_likelihood(row, data), rows)


@partial(jax.jit, static_argnums=0)
def _log_areas(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    return jax.lax.map(lambda row: problem.constrain(row, data)[AREA], rows)


def _same_body(source: Problem, z: Floats, target: Problem, data: Epochs) -> Floats:
    """z of a problem with another prior that describes the same body."""
    return np.asarray(target.ravel(source.constrain(jnp.asarray(z), data)))


def _cost(n_facets: int) -> float:
    """Approximate cost: each gradient and the number of temperatures grow with the facets."""
    return (1.0 + n_facets) ** 2
