"""Assignment of particles to basins of attraction, with a common order of the facets, and the
posterior weight of each basin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.reasons import Finding
from lcbayes.inference import search, solutions
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.modes import MERGE_OVERLAP, overlap
from lcbayes.inference.solutions import Solution
from lcbayes.modelling.constrained import potentials
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.samplers import bridge, smc
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.tempering import log_sum

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

POINTS = 8  # points used from the chain of each particle
OPTIMISED = 32  # particles optimised in each run
MAX_OPTIMA = 24
MIN_POINTS_PER_PARAMETER = 4  # in a region whose evidence is bridged
MIN_MEASURED_SHARE = 0.5  # of all points, in regions whose evidence is bridged
MAX_BRIDGE_ERROR = 0.3  # largest accepted standard error of a bridged evidence, nats
MAX_DEVIATION = 6.0  # of the tempered from the bridged evidence, in standard errors
MIN_RUN_SD = 0.5  # lower limit on the evidence error of one run in that comparison, nats


class Basins:
    """A partition of the parameter space by the optima of the posterior.

    The facets of a point are first matched to those of each optimum. The point then belongs to the
    nearest optimum in the metric of the Fisher information at that optimum. Each body, regardless
    of the order of its facets, corresponds to one point in one region: the regions are disjoint and
    together cover every body once.

    Parameters
    ----------
    optima : sequence of Solution
        The best first.
    """

    def __init__(
        self, problem: Problem, data: Epochs, optima: Sequence[Solution], order: FacetOrder
    ) -> None:
        self.problem, self.data, self.order, self.optima = problem, data, order, list(optima)
        self.centres = np.stack([s.z for s in optima])
        fisher = compiled(problem.fisher)
        self.metrics = [np.asarray(fisher(jnp.asarray(z), data)) for z in self.centres]
        self.basin_of = np.arange(len(self.centres))  # centre of the region that contains each

    @classmethod
    def of(
        cls,
        problem: Problem,
        data: Epochs,
        z: Floats,
        order: FacetOrder,
        *,
        max_optima: int = MAX_OPTIMA,
        known: Sequence[Floats] = (),
        workers: int = 1,
    ) -> Basins:
        """The partition by the optima reached from particles or from known points.

        Parameters
        ----------
        z : (C, N, D)
            Particles of each run.
        max_optima : int
        known : sequence of (D,)
        """
        starts = np.concatenate([*(row[None] for row in known), *(evenly(r, OPTIMISED) for r in z)])
        centres = optima(problem, data, starts, order, max_optima, workers)
        regions = cls(problem, data, centres, order)
        regions.join(z.reshape(-1, problem.dim))
        return regions

    def place(self, z: Floats) -> tuple[Labels, Floats]:
        """Index of the region's centre for each point (..., D), and the points with their facets
        in the order of that centre."""
        nearest, matched = self._nearest(z.reshape(-1, z.shape[-1]))
        label = self.basin_of[nearest]
        rows = matched[label, np.arange(len(label))]
        return label.reshape(z.shape[:-1]), rows.reshape(z.shape)

    def join(self, z: Floats) -> None:
        """Merge regions whose particles, taken from z (n, D), overlap.

        Optima along the same ridge belong to one solution.
        """
        nearest, matched = self._nearest(z)
        label = self.basin_of[nearest]
        present = [int(k) for k in np.unique(label)]
        min_points = 2 * z.shape[-1]
        again = True
        while again:
            again = False
            for a, b in ((a, b) for i, a in enumerate(present) for b in present[i + 1 :]):
                one, other = matched[a][label == a], matched[b][label == b]
                if min(len(one), len(other)) < min_points:
                    continue
                if overlap(one, other, self.order)[0] > MERGE_OVERLAP:
                    label[label == b] = a
                    self.basin_of[self.basin_of == b] = a
                    present.remove(b)
                    again = True
                    break

    def _nearest(self, z: Floats) -> tuple[Labels, Floats]:
        """Nearest centre of each point (n,), and the points in each centre's order (K, n, D)."""
        matched = np.stack([self.order.like_all(z, centre) for centre in self.centres])
        distance = [
            np.einsum("ni,ij,nj->n", rows - centre, metric, rows - centre)
            for rows, centre, metric in zip(matched, self.centres, self.metrics, strict=True)
        ]
        # argmin would return a NaN
        return np.argmin(np.nan_to_num(distance, nan=np.inf), axis=0), matched

    def evidence(
        self, label: Labels, rows: Floats, n_chains: int, rng: np.random.Generator
    ) -> dict[int, LogEvidence]:
        """ln ∫ exp(−U) over each region with enough particles, counting all orders of the facets.

        The integral is computed by bridge sampling. It depends on the location and shape of the
        particle distribution in a region, not on the number of particles. The sampling noise of the
        tempering path in the region shares and in the evidence therefore does not enter.

        Parameters
        ----------
        label, rows : (N,), (N, D)
            Particles, chain by chain, as returned by `place`.
        n_chains : int
            Number of chains, with equally many points each.
        """
        chain = np.arange(len(rows)) * n_chains // len(rows)
        shuffled = np.argsort(rng.permutation(n_chains)[chain], kind="stable")
        evidences = {}
        for k in np.unique(label):
            own = shuffled[label[shuffled] == k]
            if len(own) >= MIN_POINTS_PER_PARAMETER * self.problem.dim:
                evidences[int(k)] = self._bridged(
                    int(k), rows[own], len(np.unique(chain[own])), rng
                )
        return evidences

    def _bridged(
        self, k: int, rows: Floats, n_chains: int, rng: np.random.Generator
    ) -> LogEvidence:
        centre, width = rows.mean(axis=0), rows.std(axis=0) + 1e-300

        def potential(y: Floats) -> Floats:
            z = centre + width * y
            label, placed = self.place(z)
            inside = (label == k) & np.all(placed == z, axis=1)
            return np.where(inside, potentials(self.problem, z, self.data), np.inf)

        value, se = bridge.bridge(((rows - centre) / width)[None], potential, n_chains, rng)
        return LogEvidence(value + float(np.log(width).sum()) + self.order.log_orders, se)


class Weighed(NamedTuple):
    """Weights and evidence of regions, estimated from particles.

    Attributes
    ----------
    weight, weight_sd : (K,)
        Weights of the regions and their standard errors.
    log_evidence : LogEvidence
        Total over all regions.
    by_run : (C, K)
        Weights from each run alone.
    log_evidences : (C,)
        Log evidence of each run.
    reasons : list of Finding
        Reasons why the result is unreliable.
    """

    weight: Floats
    weight_sd: Floats
    log_evidence: LogEvidence
    by_run: Floats
    log_evidences: Floats
    reasons: list[Finding]


class Measured(NamedTuple):
    """Runs of particles, assigned to regions.

    Attributes
    ----------
    regions : Basins
    label, z : (C, N), (C, N, D)
        The points used from each run, as returned by `Basins.place`.
    weighed : Weighed
    """

    regions: Basins
    label: Labels
    z: Floats
    weighed: Weighed


def measure(
    problem: Problem,
    data: Epochs,
    runs: Sequence[smc.Result],
    order: FacetOrder,
    *,
    seed: int = 0,
    max_optima: int = MAX_OPTIMA,
    known: Sequence[Floats] = (),
    workers: int = 1,
) -> Measured:
    """Regions found in independent runs of equal size, with weights and evidence.

    Parameters
    ----------
    seed : int
        For bridge sampling.
    max_optima, known
        As in `Basins.of`.
    """
    n_chains = len(runs[0].z) // runs[0].points
    z = np.stack([evenly(r.z, POINTS * n_chains) for r in runs])
    regions = Basins.of(
        problem, data, z, order, max_optima=max_optima, known=known, workers=workers
    )
    label, rows = regions.place(z)
    path = np.array([r.log_evidence for r in runs])
    rng = np.random.default_rng(seed)
    return Measured(regions, label, rows, weigh(regions, label, rows, path, n_chains, rng))


def weigh(
    regions: Basins,
    label: Labels,
    z: Floats,
    path: Floats,
    n_chains: int,
    rng: np.random.Generator,
) -> Weighed:
    """Weights of regions and the evidence from runs of particles.

    Bridge sampling is applied to each region, both for all particles together and for those of each
    run. If it fails, the weights are the shares of the particles, and the evidence is that of the
    tempering paths.

    Parameters
    ----------
    label, z : (C, N), (C, N, D)
        Particles of each run, chain by chain, as returned by `Basins.place`.
    path : (C,)
        ln Z of each run from its tempering path.
    n_chains : int
        Number of chains in each run.
    """
    n_runs = len(z)
    shares = np.array([[np.mean(row == k) for k in range(len(regions.centres))] for row in label])
    run_weight = np.exp(path - log_sum(path))
    weight = run_weight @ shares
    spread = shares.std(axis=0, ddof=1) / np.sqrt(n_runs)
    by_path = smc.mean_evidence(path)
    counted = Weighed(weight, spread, by_path, shares, path, [])

    flat = z.reshape(-1, z.shape[-1])
    pooled = _bridged(regions, label.ravel(), flat, n_runs * n_chains, weight, rng)
    if pooled is None:
        return counted
    each = [
        _bridged(regions, here, rows, n_chains, own, rng)
        for here, rows, own in zip(label, z, shares, strict=True)
    ]
    estimates = [one for one in each if one is not None]
    if len(estimates) < n_runs:
        return counted
    (weight, weight_sd, total), by_run = pooled, np.stack([one[0] for one in estimates])
    log_evidences = np.array([one[2].value for one in estimates])
    between, weight_sd_runs = log_evidences.std(ddof=1), by_run.std(axis=0, ddof=1)
    reasons = []
    off = total.value - by_path.value
    if abs(off) > MAX_DEVIATION * max(path.std(ddof=1), MIN_RUN_SD) / np.sqrt(n_runs):
        reasons.append(Finding("evidence-differs", {"nats": float(abs(off))}))
    return Weighed(
        weight,
        np.maximum(weight_sd, weight_sd_runs / np.sqrt(n_runs)),
        LogEvidence(total.value, float(max(total.se, between / np.sqrt(n_runs)))),
        by_run,
        log_evidences,
        reasons,
    )


def _bridged(
    regions: Basins,
    label: Labels,
    z: Floats,
    n_chains: int,
    shares: Floats,
    rng: np.random.Generator,
) -> tuple[Floats, Floats, LogEvidence] | None:
    """Weights, their errors and the total evidence; None if the bridges are too imprecise."""
    evidences = regions.evidence(label, z, n_chains, rng)
    measured = np.array(sorted(evidences), int)
    share = float(shares[measured].sum())
    if share < MIN_MEASURED_SHARE:
        return None
    values, errors = np.array([evidences[k] for k in measured]).T
    inside = log_sum(values)
    part = np.exp(values - inside)
    se = float(np.linalg.norm(part * errors))
    if se > MAX_BRIDGE_ERROR:
        return None
    weight, weight_sd = shares.copy(), np.zeros(len(shares))
    weight[measured] = share * part
    slope = np.diag(part) - np.outer(part, part)
    weight_sd[measured] = share * np.linalg.norm(slope * errors, axis=1)
    return weight, weight_sd, LogEvidence(inside - float(np.log(share)), se)


def optima(
    problem: Problem, data: Epochs, rows: Floats, order: FacetOrder, max_optima: int, workers: int
) -> list[Solution]:
    """The distinct optima near points (n, D), best first."""
    ends = search.polish(problem, data, rows, workers)
    best_first = np.argsort(ends.potential, kind="stable")
    ends = jax.tree.map(lambda x: x[best_first], ends)
    found = solutions.distinct(problem, data, ends, order, max_optima)
    return [replace(s, rms=solutions.rms(problem, s.z, data)) for s in found]


def evenly(rows: NDArray, n: int) -> NDArray:
    """n rows at even intervals; rows are repeated if there are fewer than n."""
    return rows[np.linspace(0, len(rows) - 1, n).round().astype(int)]
