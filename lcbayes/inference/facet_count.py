"""Comparison of numbers of facets by evidence, with the same data weight for every number."""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Parts, Silent
from lcbayes.core.reasons import Finding
from lcbayes.core.threads import threads
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import basins, chain_evidence, population, screening, search, sparse
from lcbayes.inference import correlation as information
from lcbayes.inference import goodness_of_fit as misfit
from lcbayes.inference.area_prior import AreaPrior, area_prior_of, bic
from lcbayes.inference.candidate import Candidate, candidate, log_likelihood
from lcbayes.inference.chain_evidence import Doubtful, Ends, FromChains, Searches
from lcbayes.inference.fit import Stages, posterior_of
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.odds import facets
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.replicates import Execution
from lcbayes.inference.screening import RuledOut
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, prior_draws
from lcbayes.modelling.registry import Entry
from lcbayes.samplers import added_facet, smc
from lcbayes.samplers.added_facet import Ratio
from lcbayes.samplers.sampling import Timing
from lcbayes.samplers.settings import Settings
from lcbayes.samplers.tempering_path import time_ordered

Floats = NDArray[np.float64]

STARTS = 64  # starts of the search for each number of facets
DRAWS = 1000  # of a chain, enough for an evidence; of the likeliest number, as many as a fit needs


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
    weighed_body: str = ""  # kind of body of that fit, if kinds are compared


@dataclass(frozen=True)
class Plan:
    """How numbers of facets are compared.

    Attributes
    ----------
    particles : Settings
        Of the sampler "smc".
    chains : Settings or None
        Of chains, which give the evidence where they can be relied on; None for particles alone.
    upper_bound : int or None
        Initial number of facets of the sparse path, or None for no such path. The final number is
        compared with the others.
    """

    particles: Settings
    chains: Settings | None = None
    upper_bound: int | None = None


def run(
    curve: LightCurve,
    entry: Entry,
    options: Mapping[str, Any],
    counts: Sequence[int],
    plan: Plan,
    checkpoint: Checkpoint,
    progress: Silent,
) -> Compared:
    """Evidence and LOO of each plausible number of facets, by `smc` from the prior or by chains.

    The numbers are processed in order of their Bayesian information criterion. A number whose
    largest likelihood lies far below an evidence already computed is ruled out
    (`lcbayes.inference.screening`).

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
    plan : Plan

    Raises
    ------
    InputError
        If sampling from the prior fails for every number of facets.
    """
    data, settings, upper_bound = Epochs.of(curve), plan.particles, plan.upper_bound
    key_search, key_runs, key_mass, key_path = jax.random.split(jax.random.key(settings.seed), 4)
    workers = max(1, min(os.cpu_count() or 1, settings.num_chains))
    plain = dict(options)
    sparsity = plain.pop("sparsity", 0.0) if upper_bound else 0.0  # for the sparse path only
    with entry.blamed():
        problems = {n: build_problem(entry, {**plain, "n_facets": n}, data)[0] for n in counts}

    begun, ends = time.monotonic(), {}
    if plan.chains is None:
        searched = {
            n: _best_fit(problem, data, key_search, n, settings, workers, checkpoint, progress)
            for n, problem in problems.items()
        }
    else:
        known = {o.name: o.default for o in entry.options.values()} | plain
        number = settings.num_starts or STARTS
        arguments = (known, entry.facet_sites, number, workers, checkpoint, progress)
        searches = Searches(data, *arguments)
        ends = {
            n: searches.ends(p, n, jax.random.fold_in(key_search, n))
            for n, p in sorted(problems.items())
        }
        searched = {n: e.best for n, e in ends.items()}
    optima = {n: z for n, z in searched.items() if z is not None}
    if not optima:
        raise InputError(
            "no start of the search has a finite posterior density; check the errors and the "
            "geometry, or widen the priors"
        )
    weighed_at = max(optima, key=lambda n: log_likelihood(problems[n], optima[n], data))
    weighed = information.tempered(problems[weighed_at], optima[weighed_at], data)
    simplest = min(optima, key=lambda n: bic(problems[n], optima[n], weighed))
    area_prior = area_prior_of(entry, plain, problems[simplest], optima[simplest], data)
    if area_prior is not None and area_prior.from_data:
        plain["log_area_mean"] = area_prior.log_mean
        centred = {n: build_problem(entry, {**plain, "n_facets": n}, data)[0] for n in counts}
        optima = {n: _same_body(problems[n], z, centred[n], data) for n, z in optima.items()}
        ends = {n: e.moved(problems[n], centred[n], data) for n, e in ends.items()}
        problems = centred
    search_s = time.monotonic() - begun

    execution = Execution(settings, workers, checkpoint)
    comparison = _Comparison(entry, execution, problems, optima, data, weighed, plain)
    comparison.area_prior, comparison.chains, comparison.ends = area_prior, plan.chains, ends
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
    chains: Settings | None = None
    ends: Mapping[int, Ends] = field(default_factory=dict)  # of the searches, for chains
    likeliest: int = 0  # by the information criterion
    sampled: dict[int, FromChains] = field(default_factory=dict)
    ratios: dict[int, Ratio] = field(default_factory=dict)  # of n + 1 and n facets
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
        """Evidence of each number, the likeliest first, or the reason it is ruled out."""
        doubts: dict[int, str] = {}
        order = sorted(self.problems, key=self._criterion)
        self.likeliest = order[0]
        with threads(1) as compiler:
            ready: Future | None = None
            for n, following in itertools.pairwise([*order, 0]) if self.chains else ():
                if n not in self.ends or self._ruled_out(n, parts):
                    continue
                if ready is not None:
                    ready.result()
                ready = compiler.submit(self._prepare, following)
                with parts.part(_cost(n), facets(n), self.execution.settings.num_chains) as within:
                    doubts[n] = self._by_chains(n, key_runs, key_mass, within)
        while self._relate(doubts, key_runs, key_mass):
            pass
        for n in order:
            if n in self.candidates or n in self.ruled_out or self._ruled_out(n, parts):
                continue
            parts.total += _cost(n) if n in doubts else 0.0
            with parts.part(_cost(n), facets(n), self.execution.settings.num_chains) as within:
                try:
                    made = self._by_particles(n, key_runs, key_mass, within)
                except (smc.Collapse, InputError) as fault:
                    why = f"{facets(n)}: {fault}"
                    self.failed.append(Finding("number-not-followed", {"why": why}))
                    continue
            self.candidates[n] = replace(made, doubt=doubts.get(n, ""))

    def _prepare(self, n: int) -> None:
        """Compile the chains of the next number while those of another run."""
        least = max((c.log_evidence for c in self.candidates.values()), default=-np.inf)
        if n not in self.ends or self._best_likelihood(n) < least - screening.MARGIN:
            return  # it will be ruled out
        stages = self._stages(n, Silent())
        with suppress(Exception):  # whatever fails will fail again where the message is seen
            problem = build_problem(self.entry, stages.options, self.data)[1]
            stages.sampler(problem, self.weighed).prepare(self.weighed, Timing())

    def _ruled_out(self, n: int, parts: Parts) -> bool:
        """Whether a number is ruled out, which is then recorded."""
        out = self._excluded(n)
        if out is not None:
            self.ruled_out[n] = out
            parts.total -= _cost(n)
            parts.reach(parts.done, f"{facets(n)} ruled out")
        return out is not None

    def _by_particles(
        self, n: int, key_runs: jax.Array, key_mass: jax.Array, progress: Silent
    ) -> Candidate:
        key_runs, key_mass = (jax.random.fold_in(key, n) for key in (key_runs, key_mass))
        problem, settings = self.problems[n], self.execution.settings
        name = f"facets-{n}-run"
        runs = self.execution.runs(
            problem, self.weighed, key_runs, settings.num_chains, name, progress
        )
        order = FacetOrder(problem, self.entry.facet_sites)
        measured = basins.measure(
            problem, self.weighed, runs, order, seed=settings.seed, workers=self.execution.workers
        )
        whole, log_z, reasons = measured.weighed.log_evidence, *measured.weighed[-2:]
        result = candidate(n, problem, self.weighed, runs, (whole, log_z, reasons), key_mass)
        modes, warnings = population.solutions_of(problem, self.weighed, measured, settings)
        timing = Timing(sampling_s=result.seconds, gradients=result.gradients)
        posterior = posterior_of(problem, self.weighed, order, modes, measured.weighed.log_evidence)
        posterior.reasons, posterior.timing = [*result.reasons, *warnings], timing
        posterior.settings = settings
        return replace(result, posterior=posterior)

    def _by_chains(self, n: int, key_runs: jax.Array, key_mass: jax.Array, progress: Silent) -> str:
        """Sample a number by chains, and keep its candidate unless its evidence is in doubt.

        The reason for the doubt is returned.
        """
        stages = self._stages(n, progress)
        sampled = build_problem(self.entry, stages.options, self.data)[1]
        key = jax.random.fold_in(key_runs, n)
        try:
            found = chain_evidence.estimate(stages, sampled, self.ends[n], self.weighed, key)
        except (Doubtful, InputError) as fault:
            return str(fault)
        self.sampled[n] = found
        if not found.doubt:
            self._keep(n, found, key_mass)
        return found.doubt

    def _relate(self, doubts: Mapping[int, str], key_runs: jax.Array, key_mass: jax.Array) -> bool:
        """Whether the evidence of a number in doubt follows from that of a neighbour.

        The ratio of the two is that of `lcbayes.samplers.added_facet`.
        """
        for n in sorted(doubts):
            if n in self.candidates or n not in self.sampled or not self.sampled[n].mixed:
                continue
            for known, sign in ((n - 1, 1), (n + 1, -1)):
                if known not in self.candidates:
                    continue
                ratio = self._ratio(min(n, known), key_runs)
                if ratio is None:
                    continue
                found = self.sampled[n].related(self.sampled[known], ratio, sign)
                if found is not None:
                    self.sampled[n] = found
                    self._keep(n, found, key_mass)
                    return True
        return False

    def _ratio(self, n: int, key: jax.Array) -> Ratio | None:
        """The ratio of the evidences of n + 1 and n facets.

        None if the model has no moves of facets, or if priors of facets are not its own: these need
        not be the same for all facets.
        """
        if set(self.entry.facet_sites) & set(self.entry.replaced):
            return None
        if n not in self.ratios:
            stages = self._stages(n + 1, Silent())
            moves = stages.moves(stages.plain, self.weighed)
            if moves is None:
                return None
            fewer, more = ([r.z for r in self.sampled[k].runs] for k in (n, n + 1))
            key = jax.random.fold_in(jax.random.fold_in(key, n), 1)
            arguments = (self.problems[n], moves, self.weighed, fewer, more, key)
            self.ratios[n] = added_facet.log_ratio(*arguments)
        return self.ratios[n]

    def _stages(self, n: int, progress: Silent) -> Stages:
        assert self.chains is not None
        options = {**self.options, "n_facets": n}
        problem = build_problem(self.entry, options, self.data)[0]
        kept = self.execution.checkpoint.within(f"facets-{n}")
        settings = self.chains
        if n != self.likeliest:
            asked: dict[str, Any] = settings.as_dict() | {"num_samples": DRAWS}
            settings = Settings(**asked)
        arguments = (settings, self.execution.workers, kept, progress, Timing(), options)
        return Stages(problem, self.entry, *arguments, superfluous=True)

    def _keep(self, n: int, found: FromChains, key_mass: jax.Array) -> None:
        """Make the candidate of a number from its chains."""
        problem, key = self.problems[n], jax.random.fold_in(key_mass, n)
        evidence = (found.log_evidence, found.by_chain, [])
        made = candidate(n, problem, self.weighed, found.runs, evidence, key)
        self.candidates[n] = replace(made, posterior=found.posterior)

    def _criterion(self, n: int) -> tuple[float, int]:
        """Bayesian information criterion of a number, by which numbers are processed."""
        if n not in self.optima:
            return np.inf, n
        return bic(self.problems[n], self.optima[n], self.weighed), n

    def _best_likelihood(self, n: int) -> float:
        if n not in self.optima:
            return -np.inf
        return log_likelihood(self.problems[n], self.optima[n], self.data)

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
        starts, path = prior_draws(problem, keys, data), time_ordered(problem, data)
        ends = search.successive_halving(problem, data, starts, workers, progress, path)
        stored = {"z": np.asarray(ends.z[0]), "potential": np.asarray(ends.potential[0])}
        checkpoint.save(f"search-{n}", stored)
    return stored["z"] if np.isfinite(stored["potential"]) else None


def _same_body(source: Problem, z: Floats, target: Problem, data: Epochs) -> Floats:
    """z of a problem with another prior that describes the same body."""
    return np.asarray(target.ravel(source.constrain(jnp.asarray(z), data)))


def _cost(n_facets: int) -> float:
    """Approximate cost: each gradient and the number of temperatures grow with the facets."""
    return (1.0 + n_facets) ** 2
