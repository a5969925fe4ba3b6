"""The main task: search, sampling of each solution, weights, and a check of reliability."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from threading import Event, Thread
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import (
    correlation,
    population,
    search,
    solutions,
    symmetry,
    tumbling_search,
)
from lcbayes.inference.arrangements import by_motion, joint, number_to_sample, plausible
from lcbayes.inference.bridge_evidence import evidence
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.label_switching import AttitudeOrder, FacetOrder, by_size
from lcbayes.inference.modes import (
    Mode,
    join,
    left_out,
    recount,
    unsampled,
    weigh,
)
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.replicates import Execution
from lcbayes.inference.solutions import Solution
from lcbayes.inference.spin_search.cells import Coverage
from lcbayes.inference.spin_search.search import applies, complete_search
from lcbayes.inference.spin_solutions import (
    SpinSolution,
    largest_share,
    spin_solutions,
    undetermined,
)
from lcbayes.inference.start_from import placed
from lcbayes.inference.tumbling_search import Repeats
from lcbayes.inference.warped_bridge import APART_SE, related
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, prior_draws
from lcbayes.modelling.registry import Entry
from lcbayes.samplers import annealing
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.facet_moves import FacetMoves
from lcbayes.samplers.sampling import BLOCK, OPTIMA, Negligible, Sampler, Timing
from lcbayes.samplers.settings import NUTS, PARTICLES, Settings
from lcbayes.samplers.tempering_path import time_ordered

Floats = NDArray[np.float64]

SEARCH, AGAIN = "search", "search-again"  # in a checkpoint
NEGLIGIBLE = 20.0  # nats below the best evidence at which a solution is left out


@dataclass
class Posterior:
    """Complete result of a fit, before it is reported and written to files."""

    problem: Problem  # in the coordinates of z
    data: Epochs
    modes: list[Mode]
    log_evidence: LogEvidence  # of the whole posterior
    n_starts: int
    timing: Timing = field(default_factory=Timing)
    reasons: list[Finding] = field(default_factory=list)  # from the sampler: why it is unreliable
    settings: Settings = field(default_factory=partial(Settings, NUTS))
    searched: Coverage | Repeats | None = None  # how thoroughly, if not once from random starts
    spins: list[SpinSolution] = field(default_factory=list)  # of the search, sampled or not


def run(
    curve: LightCurve,
    entry: Entry,
    options: Mapping[str, Any],
    settings: Settings,
    checkpoint: Checkpoint,
    progress: Silent,
    spins: Sequence[Mapping[str, Any]] = (),
) -> Posterior:
    """Fit a model to a light curve; ``spins`` from a scan replace those of the starts.

    Raises
    ------
    InputError
        If no start of the search reaches a finite posterior density.
    """
    data = Epochs.of(curve)
    if settings.sampler == PARTICLES and (entry.hook("starts") or entry.hook("search")):
        raise InputError(
            f"--sampler {PARTICLES} goes from draws of the prior to the posterior, too far a way "
            f"for {entry.name}; choose --sampler nuts"
        )
    with entry.blamed():
        plain, problem = build_problem(entry, options, data)
    key_start, key = jax.random.split(jax.random.key(settings.seed))
    fit = Stages.of(plain, entry, options, settings, checkpoint, progress)
    begun = time.monotonic()
    # The compiler does not hold the interpreter, so that the search goes on meanwhile.
    stopped = Event()
    ahead = Thread(target=fit.prepared, args=(problem, data, stopped))
    ahead.start()
    try:
        found = fit.search(data, key_start, spins)
    except BaseException:
        stopped.set()  # the message does not wait for the compiler, but the end of the process does
        raise
    ahead.join()
    fit.timing.search_s = time.monotonic() - begun
    if settings.sampler == PARTICLES:
        return fit.by_particles(found, key)
    if plain is not problem and not hold(
        plain, problem, [*found.solutions, *found.rest], found.data
    ):
        problem = plain
    return fit.by_chains(problem, found, key)


class Found(NamedTuple):
    """Solutions to sample, in the plain coordinates, with the data at their final weight."""

    solutions: list[Solution]
    rest: list[Solution]  # plausible solutions beyond the maximum number
    ends: search.SearchState
    data: Epochs
    n_starts: int
    searched: Coverage | Repeats | None  # how thoroughly, if not once from random starts


@dataclass(frozen=True)
class Stages:
    """The stages of one fit and their shared state."""

    plain: Problem
    entry: Entry
    settings: Settings
    workers: int
    checkpoint: Checkpoint
    progress: Silent
    timing: Timing
    options: Mapping[str, Any] = field(default_factory=dict)
    superfluous: bool = False  # whether there may be more facets than the data show

    @classmethod
    def of(
        cls,
        plain: Problem,
        entry: Entry,
        options: Mapping[str, Any],
        settings: Settings,
        checkpoint: Checkpoint,
        progress: Silent,
    ) -> Stages:
        """The stages of a fit, with as many threads as it has chains, if there are cores."""
        workers = max(1, min(os.cpu_count() or 1, settings.num_chains))
        return cls(plain, entry, settings, workers, checkpoint, progress, Timing(), options)

    def simpler(self, data: Epochs, *, faulty: bool = False) -> Problem:
        """The problem of the search: the pooled and coarser form of the model, if it has one.

        ``faulty``: with the small faults of clocks and motion that the search otherwise leaves out.
        """
        options = self.entry.searched(self.options, faulty=faulty)
        with self.entry.blamed():
            if build_problem(self.entry, options, data)[0].dim == self.plain.dim:
                options = dict(self.options)
            options = self.entry.coarser | options
            if options == self.options:
                return self.plain
            return build_problem(self.entry, options, data)[0]

    def order(self, problem: Problem) -> FacetOrder:
        """The labels of a problem that may be exchanged."""
        alike = self.entry.hook("equivalents")
        if alike is not None:
            return AttitudeOrder(problem, alike(**self.options))
        return FacetOrder(problem, self.entry.facet_sites)

    def mirror(self, problem: Problem, data: Epochs) -> Floats | None:
        """The reflection in the plane of Sun and observer, (D, D), if there is one."""
        return symmetry.mirror_of(problem, data, self.entry.hook("mirrored"), self.options)

    def search(
        self, data: Epochs, key: jax.Array, spins: Sequence[Mapping[str, Any]] = ()
    ) -> Found:
        """Search with the model's pooled form if it has one, then re-optimise the solutions under
        the full model and under the data weight that the misfit allows.

        If none explains the data, small faults of clocks and motion take part in another search.
        """
        plain, settings, workers = self.plain, self.settings, self.workers
        pooled = self.simpler(data)
        found, ends, n_starts, searched = self._optima(data, key, spins)
        again = not spins and not isinstance(searched, Repeats)
        again = again and self.simpler(data, faulty=True).dim > pooled.dim
        if again and not measure(plain, data, found[0].z[None]).explained:
            self.progress.say(
                "no solution explains the data; searching again with errors of clocks and a drift "
                "of the rate"
            )
            more, others, n, _ = self._optima(data, key, faulty=True)
            found = sorted([*found, *more], key=lambda s: s.potential)
            ends, n_starts = search.joined(ends, others), n_starts + n
        data = correlation.tempered(plain, found[0].z, data)
        if data.information < 1.0 and pooled is plain:
            found = solutions.polished(plain, data, self.most_probable(plain, data, found), workers)
        elif data.information < 1.0:
            found = solutions.optimise_held(pooled, plain, data, found)
        found = solutions.select_for_sampling(plain, data, found)
        sampled, rest = found[: settings.max_modes], found[settings.max_modes :]
        return Found(sampled, rest, ends, data, n_starts, searched)

    def _optima(
        self,
        data: Epochs,
        key: jax.Array,
        spins: Sequence[Mapping[str, Any]] = (),
        *,
        faulty: bool = False,
    ) -> tuple[list[Solution], search.SearchState, int, Coverage | Repeats | None]:
        """Optima under the full model near those of `simpler`, and what `_ends` gives for that."""
        plain, entry, name = self.plain, self.entry, AGAIN if faulty else SEARCH
        pooled = self.simpler(data, faulty=faulty)
        with entry.blamed():
            chosen = {o.name: o.default for o in entry.options.values()}
            chosen |= entry.searched(self.options, faulty=faulty)
            ends, n_starts, searched = self._ends(name, pooled, data, chosen, key, spins)
        order = self.order(pooled)
        found = solutions.distinct(pooled, data, ends, order, len(ends.z))
        if not found:
            raise InputError(
                "no start of the search has a finite posterior density; check the errors and the "
                "geometry, or widen the priors"
            )
        if (mirror := self.mirror(pooled, data)) is not None:
            found = solutions.with_images(pooled, data, found, mirror, order)
        if pooled is not plain:
            found = solutions.select_for_sampling(pooled, data, found)
            found = solutions.refined(pooled, plain, data, self.most_probable(pooled, data, found))
            ends = ends._replace(z=solutions.completed(pooled, plain, data, ends.z))
        return found, ends, n_starts, searched

    def _ends(
        self,
        name: str,
        problem: Problem,
        data: Epochs,
        options: Mapping[str, Any],
        key: jax.Array,
        spins: Sequence[Mapping[str, Any]],
    ) -> tuple[search.SearchState, int, Coverage | Repeats | None]:
        """End points of the search, the number of its starts, and how thorough it was."""
        entry, settings, workers = self.entry, self.settings, self.workers
        progress, checkpoint = self.progress, self.checkpoint
        if tumbling_search.applies(problem, options) and not spins:
            problems = (problem, self.plain)
            ends, repeats = tumbling_search.repeated(
                problems, data, options, settings.num_starts, key, workers, progress, checkpoint
            )
            return ends, repeats.starts, repeats
        facets = complete_search if applies(problem, data, options) else None
        complete = None if spins or settings.num_starts else entry.hook("search") or facets
        stored = checkpoint.load(name)
        if complete is not None:
            if stored is None:
                ends, coverage = complete(problem, data, options, workers, progress, checkpoint)
                checkpoint.save(name, ends._asdict() | coverage.stored())
            else:
                coverage, ends = Coverage.restored(stored), search.SearchState(**stored)
            return ends, len(ends.z), coverage
        starts = _starts(entry, self.options, problem, data, key, settings.num_starts)
        if spins:
            starts = placed(spins, starts, problem, data, options, entry.hook("shapes"))
        if stored is not None:
            return search.SearchState(**stored), len(starts), None
        informed = entry.hook("starts") is not None or spins
        way = None if informed else time_ordered(problem, data)
        ends = search.successive_halving(problem, data, starts, workers, progress, way)
        checkpoint.save(name, ends._asdict())
        return ends, len(starts), None

    def most_probable(
        self, problem: Problem, data: Epochs, found: list[Solution]
    ) -> list[Solution]:
        """The solutions that are optimised again for other data or another model.

        Many arrangements of facets at one motion must not crowd out other motions.
        """
        most = 4 * self.settings.max_modes
        if self.sampler(problem, data).moves is None:
            return found[:most]
        groups = by_motion(problem, data, found)[:most]
        likely = number_to_sample(groups, self.settings.max_modes)
        here, rest = groups[:likely], groups[likely:]
        return [s for group in here for s in group[:OPTIMA]] + [group[0] for group in rest]

    def sampler(self, problem: Problem, data: Epochs) -> Sampler:
        """The sampler of chains, with the moves or the guide of the model if it has any."""
        moves = self.moves(problem, data)
        hook = self.entry.hook("guide")
        held = None if hook is None else hook(problem, data, **self.options)
        ordered = self.order(problem).like_all
        return Sampler(problem, self.settings, self.workers, moves, ordered, held)

    def moves(self, problem: Problem, data: Epochs) -> FacetMoves | None:
        """The moves of the model, if it has any."""
        hook = self.entry.hook("moves")
        own = {"superfluous": True} if self.superfluous else {}
        return None if hook is None else hook(problem, data, **self.options, **own)

    def prepared(self, problem: Problem, data: Epochs, stopped: Event) -> None:
        """Compile what is needed after the search, until the fit has ``stopped``."""
        if self.settings.sampler == PARTICLES:
            return
        with suppress(Exception):  # whatever fails will fail again where the message is seen
            if self.simpler(data) is not self.plain:  # else the search compiles these
                for method in (self.plain.potential, self.plain.slope, self.plain.fisher):
                    if not stopped.is_set():
                        compiled(method)(jnp.zeros(self.plain.dim), data)
            if not stopped.is_set():
                self.sampler(problem, data).prepare(data, self.timing)

    def groups(self, sampler: Sampler, found: Found) -> list[list[Solution]]:
        """The optima between which the chains move, in one group each; the most probable first."""
        every = [*found.solutions, *found.rest]
        if sampler.moves is None:
            return [[solution] for solution in every]
        return by_motion(self.plain, found.data, every)

    def by_particles(self, found: Found, key: jax.Array) -> Posterior:
        """Particles from the prior; the search only supplies centres."""
        plain, data = self.plain, found.data
        order = self.order(plain)
        modes, log_evidence, reasons = population.sample(
            plain,
            data,
            found.solutions,
            order,
            Execution(self.settings, self.workers, self.checkpoint),
            key,
            self.timing,
            self.progress,
        )
        posterior = posterior_of(plain, data, order, modes, log_evidence)
        posterior.n_starts, posterior.timing = found.n_starts, self.timing
        posterior.searched = found.searched
        posterior.reasons, posterior.settings = reasons, self.settings
        return posterior

    def by_chains(self, problem: Problem, found: Found, key: jax.Array) -> Posterior:
        """Chains about each solution in the coordinates of ``problem``, with bridge weights."""
        settings, data = self.settings, found.data
        order = self.order(problem)
        sampler = self.sampler(problem, data)
        groups = self.groups(sampler, found)
        most = settings.max_modes
        if sampler.moves is not None:
            most = number_to_sample(groups, most)
        elif isinstance(order, AttitudeOrder):
            most = number_to_sample(groups, most, near_gaussian=True)
        sampled, rest = groups[:most], [s for group in groups[most:] for s in group]
        modes = self._modes(sampler, order, sampled, data, key)
        recount(modes, self.plain, problem, found.ends, order, data)
        left, share = unsampled(modes, self.plain, problem, rest, order, data)
        error = 0.0
        if sampler.moves is not None:
            key = jax.random.fold_in(key, len(sampled))
            annealed = partial(self._annealed, problem, data, key)
            modes, error = related(modes, problem, order, data, share, annealed)
        share = largest_share(share, error)
        log_evidence = weigh(modes)
        modes.sort(key=lambda m: -m.weight)
        spins = spin_solutions(self.plain, data, [m.solution for m in modes], left, error)
        return Posterior(
            problem,
            data,
            modes,
            log_evidence,
            found.n_starts,
            self.timing,
            undetermined(spins, share) or left_out(len(left), share),
            sampler.settings,
            found.searched,
            spins,
        )

    def _modes(
        self,
        sampler: Sampler,
        order: FacetOrder,
        groups: Sequence[Sequence[Solution]],
        data: Epochs,
        key: jax.Array,
    ) -> list[Mode]:
        """Chains about each group of optima, with its evidence.

        A solution whose first draws show that it holds next to nothing of the posterior is left
        out: Laplace's approximation, by which it was chosen, may be wrong by many nats.
        """
        settings, problem = self.settings, sampler.problem
        modes: list[Mode] = []
        draws = len(groups) * settings.num_chains * sum(sampler.n_blocks) * BLOCK
        with self.progress.stage("sampling", draws, "draws") as track:
            for i, group in enumerate(groups):
                optima = plausible(group, APART_SE)
                starts = [np.asarray(_translate(self.plain, problem, s.z, data)) for s in optima]
                z0 = starts[0]
                best = max((m.log_evidence.value for m in modes), default=-np.inf)
                try:
                    chains = sampler.run(
                        f"mode-{i}",
                        np.stack([order.like(start, z0) for start in starts]),
                        data,
                        jax.random.fold_in(key, i),
                        self.checkpoint,
                        self.timing,
                        track,
                        best - order.log_orders - NEGLIGIBLE,
                    )
                except Negligible:
                    self.progress.say(f"solution {i + 1} is left out: its share is below 10⁻⁸")
                    continue
                z = by_size(problem, order, chains.z, z0, data)
                rng = np.random.default_rng([settings.seed, i])
                energies = chains.stats["potential_energy"]
                log_z = evidence(problem, data, order, chains.whitening, z, z0, rng, energies)
                new = Mode(joint(group), z, chains.stats, log_z, tuning=chains.tuning)
                join(modes, new, order)
        return modes

    def _annealed(
        self,
        problem: Problem,
        data: Epochs,
        key: jax.Array,
        first: Floats,
        second: Floats,
        matrix: Floats,
        shift: Floats,
    ) -> LogEvidence:
        """The ratio of two evidences by annealing, which is announced because it takes time."""
        self.progress.say("weighing a rotation that overlaps with no other, by annealing")
        between = first, second, matrix, shift
        return annealing.log_ratio(problem, data, *between, key, self.workers)


def posterior_of(
    problem: Problem, data: Epochs, order: FacetOrder, modes: list[Mode], log_evidence: LogEvidence
) -> Posterior:
    """The posterior of particles, with the facets of each solution in order of size."""
    for mode in modes:
        mode.z = by_size(problem, order, mode.z, mode.solution.z, data)
    return Posterior(problem, data, modes, log_evidence, 1)


def hold(plain: Problem, problem: Problem, found: Sequence[Solution], data: Epochs) -> bool:
    """Whether the model's sampling coordinates represent every solution.

    These coordinates serve efficient sampling and do not define the posterior. They may fail for
    extreme bodies: the areas of a brick, concentrated in six directions, cannot be recovered from
    their moments.
    """
    density = compiled(problem.potential)
    at = (_translate(plain, problem, solution.z, data) for solution in found)
    return all(np.isfinite(density(jnp.asarray(z), data)) for z in at)


def _starts(entry, options, problem: Problem, data, key, n: int) -> jax.Array:
    hook = entry.hook("starts")
    n = n or entry.hook("NUM_STARTS") or int(np.clip(3.5 * problem.dim**2, 48, 3000))
    if hook is None:
        return prior_draws(problem, jax.random.split(key, n), data)
    return jnp.stack([problem.ravel(sites) for sites in hook(data, key, **options)])


def _translate(source: Problem, target: Problem, z: Floats, data: Epochs) -> jax.Array:
    if source is target:
        return jnp.asarray(z)
    return target.ravel(compiled(source.constrain)(jnp.asarray(z), data))


__all__ = ["Mode", "Posterior", "run"]
