"""From the ends of a search to the few solutions worth sampling."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes._jax import jax, jnp
from lcbayes.epochs import Epochs
from lcbayes.inference.facet_order import FacetOrder
from lcbayes.inference.problem import Problem
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
    mean = jax.jit(problem.moments)(jnp.asarray(z), data).mean
    return float(np.sqrt(np.mean((np.asarray(data.brightness - mean) / unit) ** 2)))


def distinct(
    problem: Problem, data: Epochs, ends: SearchState, fits: Floats, order: FacetOrder, most: int
) -> list[Solution]:
    """The different optima among the ends of a search, best first, near-equal ones kept.

    ``fits`` (B, D) are the same ends with every point at its full weight: they tell the rms.
    """
    fisher = jax.jit(problem.fisher)
    best = ends.z[np.argmin(ends.potential)]
    noise = np.asarray(jax.jit(problem.moments)(jnp.asarray(best), data).sd)
    found: list[Solution] = []
    metrics: list[Floats] = []
    misfits: list[float] = []  # rms of the residuals in units of the best end's noise
    limit = SAME**2 * problem.dim
    finite = np.isfinite(ends.potential)
    for row in np.argsort(ends.potential, kind="stable")[: finite.sum()]:
        z, potential = np.asarray(ends.z[row]), float(ends.potential[row])
        for i, known in enumerate(found):
            step = order.like(z, known.z) - known.z
            if step @ metrics[i] @ step < limit:
                found[i] = replace(known, hits=known.hits + 1)
                break
        else:
            if len(found) >= 4 * most:
                continue
            metric = np.asarray(fisher(jnp.asarray(z), data))
            log_det = np.linalg.slogdet(metric)[1]
            evidence = -potential - 0.5 * log_det + 0.5 * problem.dim * np.log(2 * np.pi)
            rms = _residual_rms(problem, fits[row], data, np.asarray(data.noise_unit)[data.curve])
            found.append(Solution(z, potential, float(evidence), rms, 1))
            misfits.append(_residual_rms(problem, z, data, noise))
            metrics.append(metric)
    if not found:
        return []
    close = [misfit < WORSE_FIT * min(misfits) for misfit in misfits]
    likely = max(s.log_evidence for s in found) - LESS_LIKELY
    kept = [s for s, c in zip(found, close, strict=True) if c or s.log_evidence > likely]
    return sorted(kept, key=lambda s: -s.log_evidence)[:most]
