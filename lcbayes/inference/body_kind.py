"""Comparison of kinds of body by evidence: known bodies and numbers of facets together."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import chain_evidence
from lcbayes.inference import correlation as information
from lcbayes.inference.area_prior import AreaPrior, area_prior_of
from lcbayes.inference.candidate import Candidate, candidate, log_likelihood
from lcbayes.inference.chain_evidence import Doubtful, Ends
from lcbayes.inference.facet_count import Compared
from lcbayes.inference.fit import Found, Stages
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.search import SearchState
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.registry import Entry
from lcbayes.samplers.settings import Settings


@dataclass(frozen=True)
class Kind:
    """A kind of body that a light curve may be of.

    Attributes
    ----------
    name : str
    entry : Entry
    options : mapping
        Of the model.
    n_facets : int
        0 for a known body.
    """

    name: str
    entry: Entry
    options: Mapping[str, Any]
    n_facets: int = 0


@dataclass(frozen=True)
class _Searched:
    kind: Kind
    problem: Problem
    result: Found

    @property
    def z(self) -> np.ndarray:
        return self.result.solutions[0].z


def run(
    curve: LightCurve,
    kinds: Sequence[Kind],
    settings: Settings,
    checkpoint: Checkpoint,
    progress: Silent,
) -> Compared:
    """Evidence and LOO of each kind of body, by chains about each solution and bridges.

    As with numbers of facets (`facet_count.run`), the likelihood is raised to the same power for
    every kind, from the residuals of the best fit over all of them. The prior on the area of a
    facet is centred at the typical area of the best fit with facets, unless it is given. An
    evidence that cannot be relied on is kept, with the reason: the evidences of different bodies
    often differ by more than any doubt.

    Raises
    ------
    InputError
        If no kind of body could be sampled.
    """
    data = Epochs.of(curve)
    key_search, key_runs, key_mass = jax.random.split(jax.random.key(settings.seed), 3)
    begun = time.monotonic()
    searched = [
        _search(kind, data, jax.random.fold_in(key_search, k), settings, checkpoint, progress)
        for k, kind in enumerate(kinds)
    ]
    area_prior = _area_prior(searched, data)
    if area_prior is not None and area_prior.from_data:
        searched = [_centred(one, area_prior, data) for one in searched]
    best = max(searched, key=lambda one: log_likelihood(one.problem, one.z, data))
    weighed = information.tempered(best.problem, best.z, data)
    search_s = time.monotonic() - begun
    candidates: list[Candidate] = []
    failed: list[Finding] = []
    for k, one in enumerate(searched):
        keys = (jax.random.fold_in(key, k) for key in (key_runs, key_mass))
        try:
            candidates.append(_measured(one, weighed, data, settings, checkpoint, progress, *keys))
        except (Doubtful, InputError) as fault:
            failed.append(Finding("number-not-followed", {"why": f"{one.kind.name}: {fault}"}))
    if not candidates:
        raise InputError(failed[0].values["why"])
    worth = float(weighed.information)
    compared = Compared(candidates, [], failed, worth, best.kind.n_facets, None, search_s)
    return replace(compared, area_prior=area_prior, weighed_body=best.kind.name)


def _search(
    kind: Kind,
    data: Epochs,
    key: jax.Array,
    settings: Settings,
    checkpoint: Checkpoint,
    progress: Silent,
) -> _Searched:
    with kind.entry.blamed():
        problem = build_problem(kind.entry, kind.options, data)[0]
    kept = checkpoint.within(f"search-{folder_name(kind.name)}")
    stages = Stages.of(problem, kind.entry, kind.options, settings, kept, progress)
    return _Searched(kind, problem, stages.search(data, key))


def _area_prior(searched: Sequence[_Searched], data: Epochs) -> AreaPrior | None:
    """The prior on the areas of facets, from the best fit with facets."""
    with_facets = [one for one in searched if one.kind.n_facets]
    if not with_facets:
        return None
    top = max(with_facets, key=lambda one: log_likelihood(one.problem, one.z, data))
    return area_prior_of(top.kind.entry, top.kind.options, top.problem, top.z, data)


def _centred(one: _Searched, prior: AreaPrior, data: Epochs) -> _Searched:
    """A search with facets whose areas have that prior; the bodies remain the same."""
    if not one.kind.n_facets:
        return one
    kind = replace(one.kind, options={**one.kind.options, "log_area_mean": prior.log_mean})
    problem = build_problem(kind.entry, kind.options, data)[0]
    solutions = [
        replace(s, z=np.asarray(problem.ravel(one.problem.constrain(jnp.asarray(s.z), data))))
        for s in (*one.result.solutions, *one.result.rest)
    ]
    return _Searched(kind, problem, one.result._replace(solutions=solutions, rest=[]))


def _measured(
    one: _Searched,
    weighed: Epochs,
    data: Epochs,
    settings: Settings,
    checkpoint: Checkpoint,
    progress: Silent,
    key_runs: jax.Array,
    key_mass: jax.Array,
) -> Candidate:
    """Evidence, fit and diagnostics of one kind of body."""
    kind = one.kind
    plain, sampled = build_problem(kind.entry, kind.options, data)
    kept = checkpoint.within(folder_name(kind.name))
    stages = Stages.of(plain, kind.entry, kind.options, settings, kept, progress)
    z = np.stack([s.z for s in (*one.result.solutions, *one.result.rest)])
    n = len(z)
    state = SearchState(z, np.zeros(n), np.ones(n), np.zeros(n, int))  # optimised again
    ends = Ends(state, complete=True)
    estimate = chain_evidence.estimate(stages, sampled, ends, weighed, key_runs)
    log_z = np.array([r.log_evidence for r in estimate.runs])
    doubt = [Finding("evidence-doubtful", {"why": estimate.doubt})] if estimate.doubt else []
    total = (estimate.log_evidence, log_z, doubt)
    made = candidate(kind.n_facets, plain, weighed, estimate.runs, total, key_mass)
    return replace(made, posterior=estimate.posterior, body=kind.name, options=kind.options)


def folder_name(name: str) -> str:
    """A name without characters that are special in paths."""
    return "".join(c if c.isalnum() or c in "-_." else "-" for c in name)
