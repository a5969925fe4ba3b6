"""From the ends of a search to the few solutions worth sampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes._jax import jax, jnp
from lcbayes.epochs import Epochs
from lcbayes.inference.facet_order import FacetOrder
from lcbayes.inference.problem import Problem
from lcbayes.inference.search import SearchState

Floats = NDArray[np.float64]

SAME = 2.0  # whitened distance per √dimension within which two ends are one solution
WORSE_FIT = 1.05  # residual rms over the best one's, above which a solution is dropped ...
LESS_LIKELY = 10.0  # ... unless its Laplace evidence is within this many nats of the best


@dataclass(frozen=True)
class Solution:
    """One optimum of the posterior.

    Attributes
    ----------
    z : (D,) unconstrained vector
    potential : −ln p(y, z)
    log_evidence : Laplace's approximation; a rank, not a weight
    rms : of the residuals, in the unit of `residual_rms`
    hits : starts of the search that ended here
    """

    z: Floats
    potential: float
    log_evidence: float
    rms: float
    hits: int


def residual_rms(problem: Problem, z: Floats, data: Epochs) -> float:
    """Root mean square of observed minus expected brightness.

    For fluxes each residual is divided by its curve's mean brightness, so that it is the rms of
    relative intensity; for magnitudes it is in magnitudes.
    """
    mean = jax.jit(problem.moments)(jnp.asarray(z), data).mean
    unit = np.asarray(data.noise_unit)[np.asarray(data.curve)]
    return float(np.sqrt(np.mean((np.asarray(data.brightness - mean) / unit) ** 2)))


def distinct(
    problem: Problem, data: Epochs, ends: SearchState, order: FacetOrder, most: int
) -> list[Solution]:
    """The different optima among the ends of a search, best first, near-equal ones kept."""
    fisher = jax.jit(problem.fisher)
    found: list[Solution] = []
    metrics: list[Floats] = []
    limit = SAME**2 * problem.dim
    finite = np.isfinite(ends.potential)
    for z, potential in zip(ends.z[finite], np.asarray(ends.potential)[finite], strict=True):
        z = np.asarray(z)
        for i, known in enumerate(found):
            step = order.like(z, known.z) - known.z
            if step @ metrics[i] @ step < limit:
                found[i] = Solution(
                    known.z, known.potential, known.log_evidence, known.rms, known.hits + 1
                )
                break
        else:
            if len(found) >= 4 * most:
                continue
            metric = np.asarray(fisher(jnp.asarray(z), data))
            log_det = np.linalg.slogdet(metric)[1]
            evidence = -potential - 0.5 * log_det + 0.5 * problem.dim * np.log(2 * np.pi)
            rms = residual_rms(problem, z, data)
            found.append(Solution(z, float(potential), float(evidence), rms, 1))
            metrics.append(metric)
    if not found:
        return []
    best_rms = min(s.rms for s in found)
    best = max(s.log_evidence for s in found)
    kept = [s for s in found if s.log_evidence > best - LESS_LIKELY or s.rms < WORSE_FIT * best_rms]
    return sorted(kept, key=lambda s: -s.log_evidence)[:most]
