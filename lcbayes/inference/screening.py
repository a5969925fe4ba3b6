"""Exclusion of numbers of facets by their largest likelihood, without sampling.

Z = ∫ L dp₀ cannot exceed the largest likelihood, nor can ∫ L f dp₀ / ∫ f dp₀ with the factors f of
the prior. If ln max L of N facets lies far below ln Z of another number, N is excluded for any
prior. These numbers are also the most expensive to sample: a model that cannot explain the data has
a very narrow posterior, far from the intermediate distributions of the tempering path.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.reasons import Finding
from lcbayes.inference import search
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]

MARGIN = 30.0  # nats; allowance for a search that misses the largest likelihood
MAX_SUBSETS = 64  # of omitted facets


@dataclass(frozen=True)
class RuledOut:
    """A number of facets that the data exclude by their best fit alone.

    Attributes
    ----------
    n_facets, n_parameters : int
    below : float
        ln of the largest likelihood. It is an upper bound on the ln evidence under the prior
        conditioned on every facet being seen.
    misfit : Misfit
        Misfit of the best fit.
    """

    n_facets: int
    n_parameters: int
    below: float
    misfit: Misfit


def largest_likelihood(
    problem: Problem, data: Epochs, starts: Floats, workers: int
) -> tuple[float, Floats]:
    """An upper bound on ln Z, and z (D,) of the best fit reached from ``starts`` (S, D).

    The starts are optimised to maxima of the posterior. Apart from the influence of the prior, the
    likelihood there is the largest.
    """
    ends = search.polish(problem, data, starts, workers)
    reached = np.asarray(_log_likelihoods(problem, jnp.asarray(ends.z), data))
    reached = np.nan_to_num(reached, nan=-np.inf)
    best = int(np.argmax(reached))
    return float(reached[best]), ends.z[best]


@partial(jax.jit, static_argnums=0)
def _log_likelihoods(problem: Problem, rows: jax.Array, data: Epochs) -> jax.Array:
    """ln likelihood of all points, raised to the power of their information, at rows (n, D)."""
    return jax.lax.map(lambda z: jnp.sum(data.information * problem.log_likelihood(z, data)), rows)


def with_fewer(
    larger: Problem, z: Floats, smaller: Problem, facet_sites: Sequence[str], data: Epochs
) -> Floats:
    """Starts (S, D) for the smaller problem: z of the larger one with facets omitted.

    A search with more facets finds the spin more easily. Each possible subset of facets is omitted
    in turn, up to `MAX_SUBSETS` subsets. S is zero if the problems differ in more than the number
    of facets.
    """
    sites = larger.constrain(jnp.asarray(z), data)
    want = jax.eval_shape(lambda z: smaller.constrain(z, data), jnp.zeros(smaller.dim))
    sites = {k: np.asarray(sites[k]) for k in smaller.names if k in sites}
    n_larger, n_smaller = _facets(sites, facet_sites), _facets(want, facet_sites)
    rows = []
    for kept in islice(combinations(range(n_larger), n_smaller), MAX_SUBSETS):
        part = {k: v[list(kept)] if k in facet_sites else v for k, v in sites.items()}
        if any(k not in part or part[k].shape != want[k].shape for k in smaller.names):
            break
        rows.append(np.asarray(smaller.ravel({k: jnp.asarray(v) for k, v in part.items()})))
    return np.array(rows).reshape(-1, smaller.dim)


def lost(best: Mapping[int, float], information: float) -> dict[int, Finding]:
    """Numbers of facets whose particles missed the posterior, with the reason.

    A body of N facets is equivalent to one of N + 1 with a facet divided in two, so more facets fit
    at least as well. If the best particle of a larger number fits worse by more than `MARGIN`, its
    evidence is not that of the posterior.

    Parameters
    ----------
    best : number of facets -> ln likelihood of its best particle, each point at full weight
    information : float
        Power to which the likelihood of a point is raised.
    """
    reasons = {}
    for n in sorted(best):
        fewer = max((k for k in best if k < n), key=lambda k: best[k], default=n)
        behind = information * (best[fewer] - best[n])
        if behind > MARGIN:
            values = {"facets": n, "nats": float(behind), "fewer": fewer}
            reasons[n] = Finding("particles-lost", values)
    return reasons


def _facets(sites: Mapping[str, Any], facet_sites: Sequence[str]) -> int:
    return next((sites[k].shape[0] for k in facet_sites if k in sites), 0)
