"""From the ends of a search to the few solutions worth sampling."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes._jax import jnp
from lcbayes.epochs import Epochs
from lcbayes.inference import search
from lcbayes.inference.facet_order import FacetOrder
from lcbayes.inference.problem import Problem, compiled
from lcbayes.inference.search import SearchState

Floats = NDArray[np.float64]

SAME = 2.0  # whitened distance per √dimension within which two ends are one solution
WORSE_FIT = 1.05  # residuals, in units of the noise, over the best one's: dropped above this ...
LESS_LIKELY = 10.0  # ... unless its Laplace evidence is within this many nats of the best


@dataclass(frozen=True)
class Solution:
    """One optimum of the posterior.

    Attributes
    ----------
    z : (D,) unconstrained vector
    potential : −ln p(y, z)
    log_evidence : Laplace's approximation; a rank, not a weight
    rms : of the residuals of the fit to the points at their full weight: relative to a
        curve's mean brightness for fluxes, in magnitudes for magnitudes
    hits : starts of the search that ended here
    """

    z: Floats
    potential: float
    log_evidence: float
    rms: float
    hits: int


def _residual_rms(problem: Problem, z: Floats, data: Epochs, unit: Floats) -> float:
    """Root mean square of observed minus expected brightness over ``unit`` (T,)."""
    mean = compiled(problem.moments)(jnp.asarray(z), data).mean
    return float(np.sqrt(np.mean((np.asarray(data.brightness - mean) / unit) ** 2)))


def distinct(
    problem: Problem, data: Epochs, ends: SearchState, order: FacetOrder, most: int
) -> list[Solution]:
    """The different optima among the ends of a search, best first."""
    fisher = compiled(problem.fisher)
    found: list[Solution] = []
    metrics: list[Floats] = []
    limit = SAME**2 * problem.dim
    unit = np.asarray(data.noise_unit)[data.curve]
    finite = np.isfinite(ends.potential)
    for z, potential in zip(ends.z[finite], np.asarray(ends.potential)[finite], strict=True):
        z = np.asarray(z)
        for i, known in enumerate(found):
            step = order.like(z, known.z) - known.z
            if step @ metrics[i] @ step < limit:
                found[i] = replace(known, hits=known.hits + 1)
                break
        else:
            if len(found) >= most:
                continue
            metrics.append(np.asarray(fisher(jnp.asarray(z), data)))
            evidence = _laplace(potential, metrics[-1])
            rms = _residual_rms(problem, z, data.apart(), unit)
            found.append(Solution(z, float(potential), evidence, rms, 1))
    return found


def polished(problem: Problem, data: Epochs, found: list[Solution], workers: int) -> list[Solution]:
    """The same optima once the data weigh less than in the search; the rms stays that of the fit
    to the points at their full weight."""
    fisher = compiled(problem.fisher)
    state = search.polish(problem, data, np.stack([s.z for s in found]), workers)
    moved = []
    for solution, z, potential in zip(found, state.z, state.potential, strict=True):
        metric = np.asarray(fisher(jnp.asarray(z), data))
        evidence = _laplace(potential, metric)
        moved.append(replace(solution, z=z, potential=float(potential), log_evidence=evidence))
    return moved


def worth_sampling(
    problem: Problem, data: Epochs, found: list[Solution], most: int
) -> list[Solution]:
    """The solutions near the best in fit or evidence, the most likely first."""
    best = min(found, key=lambda s: s.potential)
    noise = np.asarray(compiled(problem.moments)(jnp.asarray(best.z), data).sd)
    misfit = [_residual_rms(problem, s.z, data, noise) for s in found]
    likely = max(s.log_evidence for s in found) - LESS_LIKELY
    kept = [
        s
        for s, m in zip(found, misfit, strict=True)
        if m < WORSE_FIT * min(misfit) or s.log_evidence > likely
    ]
    return sorted(kept, key=lambda s: -s.log_evidence)[:most]


def _laplace(potential: float, metric: Floats) -> float:
    """ln ∫ exp(−U) by a Gaussian."""
    half_log_det = 0.5 * np.linalg.slogdet(metric)[1]
    return float(-potential - half_log_det + 0.5 * len(metric) * np.log(2 * np.pi))
