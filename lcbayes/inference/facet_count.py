"""How many facets: the evidence of each number, under one weight of the data for all of them."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
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
from lcbayes.inference import basins, screening, search, sparse
from lcbayes.inference import correlation as information
from lcbayes.inference import goodness_of_fit as misfit
from lcbayes.inference.basins import evenly
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.loo import Loo, loo
from lcbayes.inference.odds import facets
from lcbayes.inference.prior_mass import log_prior_mass
from lcbayes.inference.problem_cache import posed
from lcbayes.inference.replicates import independent_runs
from lcbayes.inference.screening import RuledOut
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, prior_draws
from lcbayes.modelling.registry import Entry
from lcbayes.samplers import smc
from lcbayes.samplers.settings import Settings
from lcbayes.samplers.tempering_path import in_time

Floats = NDArray[np.float64]

STARTS = 64  # of the search, for each number of facets
LOO_DRAWS = 2000


@dataclass(frozen=True)
class Candidate:
    """A number of facets and what the data say of it.

    Attributes
    ----------
    n_facets, n_parameters : int
        Facets, and parameters in all.
    log_evidences : (R,)
        Of each run, under the prior given that every facet is seen.
    log_evidence, se : float
        ln of their mean; its error, with that of the prior's mass.
    spread : float
        Standard deviation of the runs' ln evidence.
    log_prior_mass : float
        `lcbayes.inference.prior_mass`; taken off already.
    loo : Loo
    misfit : Misfit
        Of the best fit that is reached from the best particle.
    information : float
        Per point, of the best particle's residuals.
    best : float
        ln likelihood of the best particle, each point taken whole.
    z_best : (D,)
        That particle.
    reasons : list of Finding
        Why not to trust it; empty where nothing is wrong.
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

    @property
    def spread(self) -> float:
        return float(np.std(self.log_evidences, ddof=1))


@dataclass
class Compared:
    """Everything a comparison finds, before it is put into words and files."""

    candidates: list[Candidate]  # by rising number of facets
    ruled_out: list[RuledOut]  # likewise
    failed: list[Finding]  # numbers that could not be followed, and why
    information: float  # per point, the same for all
    weighed_at: int  # facets of the fit whose residuals it is from
    path: sparse.SparsePath | None
    search_s: float


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
    """Evidence and LOO of each number of facets that has a chance, by `smc` from the prior.

    The numbers are taken in order of their best fits. One whose best fit is far below an evidence
    that has been found cannot reach it and is ruled out (`lcbayes.inference.screening`).

    The likelihood is raised to the same power for every number, as evidences of different data
    cannot be compared. The power is that of the residuals of the best fit of all
    (`lcbayes.inference.correlation`): correlation that the best model leaves is the data's own, and
    what a poorer model leaves on top of it is its fault, for which it has to pay. If the search
    misses the best fit the power is too low, and the result too timid rather than too sure; where
    the particles then find one that fits with cleaner residuals, the candidate says so.

    Parameters
    ----------
    counts
        Numbers of facets.
    settings
        Of sampler "smc".
    upper_bound
        Facets with which the sparse path begins, or None for no such path. The number at which it
        ends is compared with the others.

    Raises
    ------
    InputError
        If no number of facets can be followed from the prior.
    """
    data = Epochs.of(curve)
    keys = jax.random.split(jax.random.key(settings.seed), 4)
    workers = max(1, min(os.cpu_count() or 1, settings.num_chains))
    plain = dict(options)
    sparsity = plain.pop("sparsity", 0.0) if upper_bound else 0.0  # of the path alone
    with entry.blamed():
        problems = {n: posed(entry, {**plain, "n_facets": n}, data)[0] for n in counts}

    begun = time.monotonic()
    ends = {
        n: _best_fit(problem, data, keys[0], n, settings, workers, checkpoint, progress)
        for n, problem in problems.items()
    }
    ends = {n: z for n, z in ends.items() if z is not None}
    if not ends:
        raise InputError(
            "no start of the search has a finite posterior density; check the errors and the "
            "geometry, or widen the priors"
        )
    weighed_at = max(ends, key=lambda n: _log_likelihood(problems[n], ends[n], data))
    weighed = information.weighed(problems[weighed_at], ends[weighed_at], data)
    search_s = time.monotonic() - begun

    def candidate(n: int, problem: Problem, within: Silent) -> Candidate:
        runs = independent_runs(
            problem,
            weighed,
            jax.random.fold_in(keys[1], n),
            settings.num_samples,
            settings.num_chains,
            name=f"facets-{n}-run",
            checkpoint=checkpoint,
            workers=workers,
            progress=within,
        )
        order = FacetOrder(problem, entry.facet_sites)
        measured = basins.measure(
            problem, weighed, runs, order, seed=settings.seed, workers=workers
        )
        key = jax.random.fold_in(keys[2], n)
        return _candidate(n, problem, weighed, runs, measured.weighed, key)

    def chance(n: int, problem: Problem) -> RuledOut | None:
        """The number ruled out by the best of the evidences so far; None where it has a chance, as
        every number has that is larger than one which fits: a facet cut in two fits as well."""
        if not found or min(found) < n:
            return None
        starts = [ends[n][None]] if n in ends else []
        k = min(found)
        starts.append(
            screening.with_fewer(problems[k], found[k].z_best, problem, entry.facet_sites, data)
        )
        rows = np.concatenate([np.zeros((0, problem.dim)), *starts])
        if not len(rows):
            return None
        below, z = screening.largest_likelihood(problem, weighed, rows, workers)
        if below + screening.MARGIN > max(c.log_evidence for c in found.values()):
            return None
        return RuledOut(n, problem.n_parameters, below, misfit.measure(problem, weighed, z[None]))

    def promise(n: int) -> float:
        return _log_likelihood(problems[n], ends[n], data) if n in ends else -np.inf

    found, ruled_out, failed, path = {}, {}, [], None
    with progress.stage("comparing", 100, "%") as track:
        to_do = [*counts, upper_bound] if upper_bound else counts
        parts = Parts(track, 100, sum(map(_cost, to_do)))
        if upper_bound:
            area = _area(problems[weighed_at], ends[weighed_at], data)
            weight = sparsity or sparse.weight(area)
            with parts.part(_cost(upper_bound), "sparse path", 1) as within:
                try:
                    path = _sparse_path(
                        entry,
                        plain,
                        weighed,
                        upper_bound,
                        weight,
                        settings,
                        keys[3],
                        workers,
                        checkpoint,
                        within,
                    )
                except (smc.Collapse, InputError) as fault:
                    why = f"the sparse path from {upper_bound} facets: {fault}"
                    failed.append(Finding("number-not-followed", {"why": why}))
            if path and path.n_facets not in problems:
                end = {**plain, "n_facets": path.n_facets}
                problems[path.n_facets] = posed(entry, end, data)[0]
                parts.total += _cost(path.n_facets)
        for n in sorted(problems, key=lambda n: (-promise(n), n)):
            problem = problems[n]
            if out := chance(n, problem):
                ruled_out[n] = out
                parts.total -= _cost(n)
                parts.reach(parts.done, f"{facets(n)} ruled out")
                continue
            with parts.part(_cost(n), facets(n), settings.num_chains) as within:
                try:
                    found[n] = candidate(n, problem, within)
                except (smc.Collapse, InputError) as fault:
                    why = f"{facets(n)}: {fault}"
                    failed.append(Finding("number-not-followed", {"why": why}))
    best = {n: c.best for n, c in found.items()}
    for n, reason in screening.lost(best, float(weighed.information)).items():
        del found[n]
        failed.append(reason)
    if not found:  # no number that was followed can be the worst of several
        raise InputError(failed[0].values["why"])
    return Compared(
        [found[n] for n in sorted(found)],
        [ruled_out[n] for n in sorted(ruled_out)],
        failed,
        float(weighed.information),
        weighed_at,
        path,
        search_s,
    )


def _best_fit(problem, data, key, n, settings, workers, checkpoint, progress) -> Floats | None:
    """z of the best end of a search, (D,)."""
    stored = checkpoint.load(f"search-{n}")
    if stored is None:
        keys = jax.random.split(jax.random.fold_in(key, n), settings.num_starts or STARTS)
        starts, way = prior_draws(problem, keys, data), in_time(problem, data)
        ends = search.race(problem, data, starts, workers, progress, way)
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
    own = information.weighed(problem, best, data)
    reasons = [reason for r in runs for reason in r.reasons]
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
    )


def _pooled(runs: Sequence[smc.Result]) -> Floats:
    """Equally weighted draws of all runs, each run counted by its evidence, which is unbiased."""
    log_z = np.array([r.log_evidence for r in runs])
    share = np.exp(log_z - logsumexp(log_z))
    n = min(LOO_DRAWS, min(len(r.z) for r in runs) / share.max())
    parts = np.floor(n * share).astype(int)
    return np.concatenate([evenly(r.z, k) for r, k in zip(runs, parts, strict=True)])


def _best_particle(runs: Sequence[smc.Result]) -> Floats:
    best = max(runs, key=lambda r: r.log_likelihood.max())
    return best.z[np.argmax(best.log_likelihood)]


def _log_likelihood(problem: Problem, z: Floats, data: Epochs) -> float:
    """Of all points, each taken whole."""
    return float(compiled(problem.log_likelihood)(jnp.asarray(z), data).sum())


@partial(jax.jit, static_argnums=0)
def _pointwise(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    """ln likelihood of every point at rows (n, D), (n, T)."""
    return jax.lax.map(lambda row: problem.log_likelihood(row, data), rows)


def _area(problem: Problem, z: Floats, data: Epochs) -> float:
    return float(np.sum(problem.constrain(jnp.asarray(z), data)["albedo_area"]))


def _sparse_path(
    entry, options, data, upper_bound, weight, settings, key, workers, checkpoint, progress
) -> sparse.SparsePath:
    """One run under the sparse prior: it only proposes a number, which the others then judge."""
    changed = {
        **options,
        "n_facets": upper_bound,
        "sparsity": weight,
        "log_area_sd": sparse.LOG_AREA_SD,
    }
    problem = posed(entry, changed, data)[0]
    (found,) = independent_runs(
        problem,
        data,
        key,
        settings.num_samples,
        1,
        name="sparse",
        checkpoint=checkpoint,
        workers=workers,
        progress=progress,
    )
    return sparse.path(problem, data, entry.facet_sites, found, weight)


def _cost(n_facets: int) -> float:
    """Of a number of facets, about: each gradient and the number of temperatures grow with it."""
    return (1.0 + n_facets) ** 2
