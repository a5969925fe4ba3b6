"""Evidence from chains about separate solutions and bridges, where these can be relied on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search, solutions
from lcbayes.inference.basins import evenly
from lcbayes.inference.fit import Found, Posterior, Stages, evidence, hold
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.modes import translated
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.search import Spins, applies, find_spins, with_bodies
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, prior_draws
from lcbayes.samplers import smc
from lcbayes.samplers.added_facet import Ratio
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.chains import Whitening
from lcbayes.samplers.convergence import MAX_DIVERGING, MAX_RHAT, MIN_ESS, rhat_and_ess
from lcbayes.samplers.tempering_path import time_ordered

Floats = NDArray[np.float64]

MAX_SE = 0.3  # nats, of an evidence or of a ratio that is relied on
DOUBTED = 3.0  # nats, least error of an evidence from chains that are in doubt
MAX_SPREAD = 0.5  # nats, standard deviation between chains
ALIKE = 3.0  # nats, by which arrangements of as many facets may differ in density
MIXED = 1.1  # R-hat of chains whose draws are bridged to those of another number of facets
OPTIMISED = 32  # end points of the search that are kept, and optimised for the prior on areas
WITH_ONE_MORE = 16  # starts that add a facet to the best fit with one facet fewer


class Ends(NamedTuple):
    """End points of a search, best first, and whether it visited all spins."""

    state: SearchState
    complete: bool

    @property
    def best(self) -> Floats | None:
        """z of the best end point, (D,); None if its density is not finite."""
        return np.asarray(self.state.z[0]) if np.isfinite(self.state.potential[0]) else None

    def moved(self, source: Problem, target: Problem, data: Epochs) -> Ends:
        """The same bodies as points of a problem with another prior."""
        z = np.asarray(translated(source, target, self.state.z, data))
        return self._replace(state=self.state._replace(z=z))


class Doubtful(Exception):
    """Chains and bridges do not determine an evidence; the message says why."""


@dataclass
class Searches:
    """Searches for the best fits of increasing numbers of facets.

    The search over spins does not depend on the number of facets and is done once. Each number
    starts from the best fit of the number before, with a facet added, too.

    Attributes
    ----------
    data : Epochs
    options : mapping
        Of the model, with defaults, without ``n_facets``.
    facet_sites : sequence of str
    num_starts : int
        From the prior, if the spins cannot all be visited.
    """

    data: Epochs
    options: Mapping[str, Any]
    facet_sites: Sequence[str]
    num_starts: int
    workers: int
    checkpoint: Checkpoint
    progress: Silent
    spins: Spins | None = None
    before: tuple[Problem, Floats] | None = None  # the best fit of the number before

    def ends(self, problem: Problem, n_facets: int, key: jax.Array) -> Ends:
        """End points of the search with a number of facets, larger than those before."""
        options = {**self.options, "n_facets": n_facets}
        complete = applies(problem, self.data, options)
        name = f"ends-{n_facets}"
        stored = self.checkpoint.load(name)
        if stored is None:
            state = self._searched(problem, options, complete, key)
            stored = {k: np.asarray(v)[:OPTIMISED] for k, v in state._asdict().items()}
            self.checkpoint.save(name, stored)
        ends = Ends(SearchState(**stored), complete and self.data.has_error)
        if (best := ends.best) is not None:
            self.before = problem, best
        return ends

    def _searched(
        self, problem: Problem, options: Mapping[str, Any], complete: bool, key: jax.Array
    ) -> SearchState:
        data, workers = self.data, self.workers
        more = None
        if self.before is not None:
            more = one_more(*self.before, problem, self.facet_sites, data, key)
        if complete:
            if self.spins is None:
                arguments = (data, options, workers, self.progress, self.checkpoint)
                self.spins = find_spins(*arguments)
            return with_bodies(problem, data, options, self.spins, workers, self.progress, more)
        starts = prior_draws(problem, jax.random.split(key, self.num_starts), data)
        if more is not None:
            starts = jnp.concatenate([starts, more])
        path = time_ordered(problem, data)
        return search.successive_halving(problem, data, starts, workers, self.progress, path)


def one_more(
    smaller: Problem,
    z: Floats,
    larger: Problem,
    facet_sites: Sequence[str],
    data: Epochs,
    key: jax.Array,
) -> Floats | None:
    """Starts (S, D) of the larger problem: z of the smaller one with facets added from the prior.

    None if the problems differ in more than the number of facets.
    """
    own = {k: np.asarray(v) for k, v in smaller.constrain(jnp.asarray(z), data).items()}
    draws = prior_draws(larger, jax.random.split(key, WITH_ONE_MORE), data)
    rows = []
    for draw in draws:
        sites = {k: np.array(v) for k, v in larger.constrain(draw, data).items()}
        for name in larger.names:
            if name not in own:
                return None
            if name in facet_sites:
                sites[name][: len(own[name])] = own[name]
            elif sites[name].shape == own[name].shape:
                sites[name] = own[name]
            else:
                return None
        rows.append(np.asarray(larger.ravel({k: jnp.asarray(sites[k]) for k in larger.names})))
    return np.stack(rows)


class FromChains(NamedTuple):
    """An evidence from chains.

    Attributes
    ----------
    posterior : Posterior
    runs : list of smc.Result
        Equally weighted draws of each chain over all solutions, in the plain coordinates, with the
        evidence from that chain alone.
    log_evidence : LogEvidence
    doubt : str
        Why the evidence is not to be relied on; empty if it is.
    mixed : bool
        Whether the draws represent the posterior, by chains that agree and solutions that are
        complete.
    """

    posterior: Posterior
    runs: list[smc.Result]
    log_evidence: LogEvidence
    doubt: str = ""
    mixed: bool = True

    @property
    def by_chain(self) -> Floats:
        """ln evidence from each chain alone, (C,)."""
        return np.array([run.log_evidence for run in self.runs])

    def related(self, other: FromChains, ratio: Ratio, sign: int) -> FromChains | None:
        """The same draws with the evidence of ``other``, whose ``ratio`` to it has that sign of its
        logarithm; None if the ratio is not to be relied on."""
        spread = float(np.std(ratio.each, ddof=1))
        se = max(ratio.whole.se, spread / np.sqrt(ratio.each.size))
        if not (se <= MAX_SE and spread <= MAX_SPREAD):
            return None
        value = other.log_evidence.value + sign * ratio.whole.value
        total = LogEvidence(value, float(np.hypot(se, other.log_evidence.se)))
        self.posterior.log_evidence = total
        by_chain = other.by_chain + sign * ratio.each
        runs = [
            replace(run, log_evidence=float(own))
            for run, own in zip(self.runs, by_chain, strict=True)
        ]
        return self._replace(runs=runs, log_evidence=total, doubt="")


def estimate(
    stages: Stages, problem: Problem, ends: Ends, data: Epochs, key: jax.Array
) -> FromChains:
    """The evidence from chains about each solution and bridges.

    If chains or bridges are in doubt, the error is at least `DOUBTED`. Otherwise it is the largest
    of that of the bridges, the scatter between chains, each of which gives an evidence by itself,
    and the difference of their mean from the evidence of all: on a thin curved sheet a bridge may
    be far off without noticing.

    Parameters
    ----------
    stages : Stages
        With settings of a sampler that runs chains.
    problem : Problem
        In sampling coordinates.
    ends : Ends
        In the plain coordinates of ``stages``.
    data : Epochs
        At the power of the likelihood at which numbers are compared.

    Raises
    ------
    Doubtful
        The solutions may be incomplete, so that nothing was sampled.
    """
    posterior = _sampled(stages, problem, ends, data, key)
    doubt = _doubt(posterior)
    if not doubt:
        return _from_chains(stages, posterior)
    bridged = posterior.log_evidence
    total = LogEvidence(bridged.value, max(bridged.se, DOUBTED))
    same = np.full(stages.settings.num_chains, bridged.value)
    posterior.log_evidence = total
    runs, mixed = _runs(posterior, stages.plain, same), _mixed(posterior)
    return FromChains(posterior, runs, total, doubt, mixed)


def _mixed(posterior: Posterior) -> bool:
    if posterior.reasons:
        return False
    return all(max(rhat_and_ess(m.z)[0], m.apart) <= MIXED for m in posterior.modes)


def _sampled(
    stages: Stages, problem: Problem, ends: Ends, data: Epochs, key: jax.Array
) -> Posterior:
    """Chains about each plausible solution."""
    plain, settings = stages.plain, stages.settings
    order = stages.order(plain)
    top = np.asarray(ends.state.z)[np.isfinite(ends.state.potential)]
    state = search.best_first(search.polish(plain, data, top, stages.workers))
    found = solutions.distinct(plain, data, state, order, len(state.z))
    hits = found[0].hits
    if stages.moves(plain, data) is not None:  # which lead from one arrangement to another
        hits = int(np.sum(state.potential < state.potential[0] + ALIKE))
    if not ends.complete and hits < 2:
        raise Doubtful("only one start ended at the best solution")
    if (mirror := stages.mirror(plain, data)) is not None:
        found = solutions.with_images(plain, data, found, mirror, order)
    found = solutions.select_for_sampling(plain, data, found)
    here, rest = found[: settings.max_modes], found[settings.max_modes :]
    if problem is not plain and not hold(plain, problem, here, data):
        problem = plain
    chosen = Found(here, rest, ends.state, data, len(ends.state.z), None)
    return stages.by_chains(problem, chosen, key)


def _from_chains(stages: Stages, posterior: Posterior) -> FromChains:
    """The evidence with the larger of its two errors."""
    order = stages.order(posterior.problem)
    by_chain = _by_chain(posterior, order, stages.settings.seed)
    spread = float(np.std(by_chain, ddof=1))
    bridged = posterior.log_evidence
    apart = abs(float(np.mean(by_chain)) - bridged.value)
    error = max(bridged.se, spread / np.sqrt(by_chain.size), apart)
    total = LogEvidence(bridged.value, float(error))
    doubt = ""
    if not (total.se <= MAX_SE and spread <= MAX_SPREAD):
        doubt = (
            f"the bridges are uncertain by {total.se:.2g} nat and scatter by {spread:.2g} nat "
            "between chains"
        )
    posterior.log_evidence = total
    return FromChains(posterior, _runs(posterior, stages.plain, by_chain), total, doubt)


def _doubt(posterior: Posterior) -> str:
    """Whether the draws of a solution have not converged, or one was left out; empty if not."""
    if posterior.reasons:
        return "plausible solutions were not sampled"
    for mode in posterior.modes:
        rhat, size = rhat_and_ess(mode.z)
        if not (max(rhat, mode.apart) <= MAX_RHAT and size >= MIN_ESS):
            return f"chains disagree (R-hat {rhat:.3f}, {size:.0f} effective draws)"
        if np.mean(mode.stats["diverging"]) > MAX_DIVERGING:
            return "trajectories diverge"
    return ""


def _by_chain(posterior: Posterior, order: FacetOrder, seed: int) -> Floats:
    """ln evidence of all solutions from each chain by itself, (C,)."""
    problem, data = posterior.problem, posterior.data
    found = []
    for m, mode in enumerate(posterior.modes):
        flat = mode.z.reshape(-1, mode.z.shape[-1])
        centre = flat.mean(axis=0)
        covariance = np.cov(flat.T).reshape(len(centre), -1)
        scaled = Whitening(jnp.asarray(centre), jnp.linalg.cholesky(covariance))
        whitening = jax.tree.map(np.asarray, scaled)
        rngs = (np.random.default_rng([seed, m, c]) for c in range(len(mode.z)))
        found.append(
            [
                evidence(problem, data, order, whitening, z[None], centre, rng).value
                for z, rng in zip(mode.z, rngs, strict=True)
            ]
        )
    return np.asarray(logsumexp(np.array(found), axis=0))


def _runs(posterior: Posterior, plain: Problem, by_chain: Floats) -> list[smc.Result]:
    """Equally weighted draws of each chain, over all solutions."""
    problem, data, timing = posterior.problem, posterior.data, posterior.timing
    runs = []
    for c, log_evidence in enumerate(by_chain):
        n = min(m.z.shape[1] for m in posterior.modes)
        rows = np.concatenate([evenly(m.z[c], round(n * m.weight)) for m in posterior.modes])
        z = rows if problem is plain else np.asarray(translated(problem, plain, rows, data))
        log_likelihood = np.asarray(_log_likelihoods(plain, jnp.asarray(z), data))
        share = 1.0 / by_chain.size
        gradients = round(timing.gradients * share)
        seconds = (timing.warmup_s + timing.sampling_s) * share
        value = float(log_evidence)
        runs.append(smc.Result(z, log_likelihood, value, [], len(z), gradients, seconds))
    return runs


@partial(jax.jit, static_argnums=0)
def _log_likelihoods(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    """ln likelihood of all points, each at full weight, at rows (n, D)."""
    return jax.lax.map(lambda z: jnp.sum(problem.log_likelihood(z, data)), rows)
