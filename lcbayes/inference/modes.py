"""Sampled modes of a posterior: separation, merging of duplicates, and weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.reasons import Finding
from lcbayes.inference import search, solutions
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import bridge

Floats = NDArray[np.float64]
MERGE_OVERLAP = 0.1  # least share of one mode's draws within another's region for a merger
ENCLOSED = 0.99  # share of the draws of a mode within its region
MAX_LEFT_OUT = 0.01  # largest share of the posterior left out without a warning


@dataclass
class Mode:
    """One solution of the posterior, as sampled."""

    solution: solutions.Solution
    z: Floats  # (C, S, D), facets in one order
    stats: dict[str, NDArray]
    log_evidence: bridge.LogEvidence
    weight: float = 0.0
    weight_sd: float = 0.0
    apart: float = 1.0  # R-hat between independent runs in this region, if several
    run_weights: Floats | None = None  # (C,) from each independent population, if any
    tuning: dict[str, NDArray] = field(default_factory=dict)  # (C, ...) each, of `sampling.Chains`


class Region(NamedTuple):
    """Region of the draws of a mode: their mean, the inverse of their covariance, and the squared
    distance in that metric that encloses 99 % of the draws (`ENCLOSED`)."""

    mean: Floats
    inverse: Floats
    limit: float

    @classmethod
    def of(cls, z: Floats) -> Region:
        draws = z.reshape(-1, z.shape[-1])
        mean = draws.mean(axis=0)
        inverse = np.linalg.pinv(np.atleast_2d(np.cov(draws.T)), hermitian=True)
        apart = draws - mean
        return cls(mean, inverse, np.quantile(np.sum((apart @ inverse) * apart, axis=1), ENCLOSED))

    def share(self, z: Floats) -> Floats:
        """Squared distance of each row (n, D), divided by the limit."""
        apart = z - self.mean
        return np.sum((apart @ self.inverse) * apart, axis=1) / self.limit


def join(modes: list[Mode], new: Mode, order: FacetOrder) -> None:
    """Add a mode, or merge it with a mode whose region it shares.

    Two searches can end at two optima of the same region, which would receive twice its weight if
    counted twice. Of two runs in one region, the one with the larger evidence is kept, because it
    has explored more of the region.
    """
    for i, old in enumerate(modes):
        shared, z = overlap(new.z, old.z, order)
        if shared > MERGE_OVERLAP:
            apart = max(old.apart, new.apart, _rhat(old.z, z))
            kept = new if new.log_evidence.value > old.log_evidence.value else old
            modes[i] = replace(kept, apart=apart)
            return
    modes.append(new)


def overlap(z: Floats, other: Floats, order: FacetOrder) -> tuple[float, Floats]:
    """The larger share of the draws (..., D) of one mode within the region of the other, and z with
    its facets in the order of the other; the means fix one order for all draws."""
    region, there = Region.of(z), Region.of(other)
    z = order.carried(region.mean, there.mean, z)
    flat, others = z.reshape(-1, z.shape[-1]), other.reshape(-1, z.shape[-1])
    shared = max(np.mean(there.share(flat) <= 1.0), np.mean(Region.of(z).share(others) <= 1.0))
    return float(shared), z


def _rhat(a: Floats, b: Floats) -> float:
    """The largest R-hat over the parameters, for the combined chains of two runs (C, S, D)."""
    n = min(a.shape[1], b.shape[1])
    chains = np.concatenate([a[:, -n:], b[:, -n:]])
    within = chains.var(axis=1, ddof=1).mean(axis=0)
    between = chains.mean(axis=1).var(axis=0, ddof=1)
    return float(np.sqrt((n - 1) / n + between / np.maximum(within, 1e-300)).max())


def recount(
    modes: list[Mode],
    plain: Problem,
    problem: Problem,
    ends: search.SearchState,
    order: FacetOrder,
    data: Epochs,
) -> None:
    """Count the end points of the search within the draws of a mode as its hits.

    If the optimum is a ridge, starts end at points all along it, separated by many widths of the
    local Gaussian. The draws trace the full extent of the ridge. An end point counts for the
    nearest mode, provided that it lies within the region of that mode.
    """
    z = np.asarray(ends.z)[np.isfinite(ends.potential)]
    share = _shares(modes, plain, problem, z, order, data)
    nearest = np.argmin(share, axis=0)
    for i, mode in enumerate(modes):
        hits = int(np.sum((share[i] <= 1.0) & (nearest == i)))
        mode.solution = replace(mode.solution, hits=max(hits, mode.solution.hits))


def unsampled(
    modes: list[Mode],
    plain: Problem,
    problem: Problem,
    rest: Sequence[solutions.Solution],
    order: FacetOrder,
    data: Epochs,
) -> tuple[list[solutions.Solution], float]:
    """Solutions that were not sampled, and their share of the posterior.

    Solutions within the region of a mode, such as the optima along a ridge, are not among them.
    """
    if not rest:
        return [], 0.0
    inside = _shares(modes, plain, problem, np.stack([s.z for s in rest]), order, data) <= 1.0
    left = [s for s, known in zip(rest, inside.any(axis=0), strict=True) if not known]
    return left, float(shares([*left, *(m.solution for m in modes)])[: len(left)].sum())


def shares(every: Sequence[solutions.Solution]) -> Floats:
    """Share of each solution, from its Gaussian (Laplace) approximation."""
    log_z = np.array([s.log_evidence for s in every])
    likely = np.exp(log_z - log_z.max())
    return likely / likely.sum()


def left_out(n: int, share: float) -> list[Finding]:
    """Warning about n solutions left out of the result, with their share of the posterior."""
    if share <= MAX_LEFT_OUT:
        return []
    number = "1 more solution was" if n == 1 else f"{n} more solutions were"
    return [Finding("solutions-not-sampled", {"number": number, "percent": 100 * share})]


def _shares(
    modes: list[Mode],
    plain: Problem,
    problem: Problem,
    z: Floats,
    order: FacetOrder,
    data: Epochs,
) -> Floats:
    """Squared distance of points z (n, D) of the plain problem from each mode, divided by the limit
    of the mode's region, (M, n)."""
    z = np.asarray(z if problem is plain else translated(plain, problem, z, data))
    share = np.full((len(modes), len(z)), np.inf)
    for i, mode in enumerate(modes):
        region = Region.of(mode.z)
        share[i] = region.share(np.array([order.like(row, region.mean) for row in z]))
    return np.where(np.isfinite(share), share, np.inf)


@partial(jax.jit, static_argnums=(0, 1))
def translated(plain: Problem, problem: Problem, z: Floats, data: Epochs) -> jax.Array:
    """Rows (n, D) of one problem in the coordinates of the other."""
    return jax.lax.map(lambda row: problem.ravel(plain.constrain(row, data)), jnp.asarray(z))


def weigh(modes: list[Mode]) -> bridge.LogEvidence:
    """Set the weights from the evidences, with errors propagated from the independent errors of
    the evidences. Return the total evidence of all modes."""
    log_z = np.array([m.log_evidence.value for m in modes])
    w = np.exp(log_z - log_z.max())
    total = float(log_z.max() + np.log(w.sum()))
    w /= w.sum()
    se = np.array([m.log_evidence.se for m in modes])
    for i, mode in enumerate(modes):
        mode.weight = float(w[i])
        slope = w[i] * (np.eye(len(modes))[i] - w)
        mode.weight_sd = float(np.sqrt(np.sum((slope * se) ** 2)))
    return bridge.LogEvidence(total, float(np.linalg.norm(w * se)))
