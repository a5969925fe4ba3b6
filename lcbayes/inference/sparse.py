"""The sparse path to the number of facets (Linares & Crassidis, sec. VI).

From an upper bound of facets, under the squared-L1 prior, until the areas that the data do not ask
for are nearly zero; these are dropped, and facets whose normals coincide within their uncertainty
are merged. What remains is the number with which the posterior under the log-normal prior is then
taken. It is a guess at one number, without a probability: a quick look where the evidence of every
number would cost too much, and a check on it where it does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc

Floats = NDArray[np.float64]

AREA_COST = 50.0  # nats that the prior takes for the whole albedo-area of the best fit
LOG_AREA_SD = 3.0  # of the log-normal prior meanwhile, which must not hold the areas up
MIN_AREA_SHARE = 0.02  # share of the albedo-area below which a facet is dropped
MERGE_SD = 2.0  # standard deviations of their distance within which two normals coincide ...
MAX_MERGE_ANGLE = np.deg2rad(30.0)  # ... unless they are this far from each other
MAX_PARTICLES = 200  # particles that are thinned out


@dataclass(frozen=True)
class SparsePath:
    """Where the sparse path ends.

    Attributes
    ----------
    upper_bound : int
        Facets to begin with.
    sparsity : float, m⁻⁴
        Weight of (Σα)² in −ln prior; the paper's λ of eq. (30) is its inverse square root.
    shares : dict
        Of the particles, by the number of facets that remain of them.
    n_facets : int
        The most frequent number.
    best : float
        ln likelihood of the best particle, as it was weighed: whether the path found a good fit.
    """

    upper_bound: int
    sparsity: float
    shares: dict[int, float]
    n_facets: int
    best: float


def weight(area: float) -> float:
    """A weight that costs 50 nats for the albedo-area of the best fit, m⁻⁴.

    A facet of a fiftieth of the area then costs two nats, while the area as a whole, which the
    data hold to a part in hundreds, is hardly moved.
    """
    return AREA_COST / area**2


def path(
    problem: Problem, data: Epochs, sites: tuple[str, ...], found: smc.Result, sparsity: float
) -> SparsePath:
    """Thin out particles of the posterior under the sparse prior, each by itself."""
    z = found.z
    rows = z[np.linspace(0, len(z) - 1, min(MAX_PARTICLES, len(z))).round().astype(int)]
    index = problem.unravel(jnp.arange(float(problem.dim)))
    base = np.asarray(index["normals_base"], int)
    area_of = jax.jit(jax.vmap(lambda row: problem.constrain(row, data)["albedo_area"]))
    areas = np.asarray(area_of(jnp.asarray(rows)))
    fisher = jax.jit(lambda z: jax.lax.map(lambda row: problem.fisher(row, data), z))
    covariance = np.linalg.inv(np.asarray(fisher(jnp.asarray(rows))))
    left = [
        remaining(row[base], area, cov[np.ix_(base.ravel(), base.ravel())])
        for row, area, cov in zip(rows, areas, covariance, strict=True)
    ]
    numbers, hits = np.unique(left, return_counts=True)
    shares = {int(n): float(h / len(left)) for n, h in zip(numbers, hits, strict=True)}
    n_facets = max(shares, key=lambda n: shares[n])
    start = FacetOrder(problem, sites).n_facets
    return SparsePath(start, sparsity, shares, n_facets, float(found.log_likelihood.max()))


def remaining(vectors: Floats, areas: Floats, covariance: Floats) -> int:
    """Facets that are neither small nor one with another.

    Parameters
    ----------
    vectors : (N, 3)
        Of any length, along the normals.
    areas : (N,)
    covariance : (3N, 3N)
        Of the vectors.
    """
    kept = np.flatnonzero(areas >= MIN_AREA_SHARE * areas.sum())
    group = np.arange(len(kept))
    for i in range(len(kept)):
        for j in range(i):
            if _coincide(vectors, covariance, int(kept[i]), int(kept[j])):
                group[group == group[i]] = group[j]
    return len(np.unique(group))


def _coincide(vectors: Floats, covariance: Floats, i: int, j: int) -> bool:
    """Whether the distance of two normals is within two of its standard deviations of zero."""
    length = np.linalg.norm(vectors[[i, j]], axis=1)
    a, b = vectors[i] / length[0], vectors[j] / length[1]
    apart = a - b
    distance = np.linalg.norm(apart)
    if distance == 0.0:
        return True
    if distance > 2.0 * np.sin(0.5 * MAX_MERGE_ANGLE):
        return False
    # the derivative of |a − b| by the two vectors: along the distance, across each vector
    along = apart / distance
    gradient = np.concatenate(
        [(along - a * (a @ along)) / length[0], -(along - b * (b @ along)) / length[1]]
    )
    rows = np.concatenate([3 * i + np.arange(3), 3 * j + np.arange(3)])
    return bool(distance**2 < MERGE_SD**2 * (gradient @ covariance[np.ix_(rows, rows)] @ gradient))
