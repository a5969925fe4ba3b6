"""The sparse path to the number of facets (Linares & Crassidis, sec. VI).

The path starts from an upper bound on the number of facets. Under the squared-L1 prior, areas that
the data do not require shrink to nearly zero. These facets are dropped, and facets whose normals
coincide within their uncertainty are merged. The remaining number is then used for the posterior
under the log-normal prior. The method estimates one number, without a probability. It is a quick
estimate when the evidence of every number would be too expensive, and otherwise a check on it.
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

AREA_COST = 50.0  # nats; prior penalty for the total albedo-area of the best fit
LOG_AREA_SD = 3.0  # of the log-normal prior on the path; wide, to let areas shrink
MIN_AREA_SHARE = 0.02  # share of the albedo-area below which a facet is dropped
MERGE_SD = 2.0  # two normals coincide within this many standard deviations of their distance ...
MAX_MERGE_ANGLE = np.deg2rad(30.0)  # ... unless they differ by more than this angle
MAX_PARTICLES = 200  # particles whose facets are reduced


@dataclass(frozen=True)
class SparsePath:
    """End point of the sparse path.

    Attributes
    ----------
    upper_bound : int
        Initial number of facets.
    sparsity : float, m⁻⁴
        Weight of (Σα)² in −ln prior; the paper's λ of eq. (30) is its inverse square root.
    shares : dict
        Shares of the particles, by remaining number of facets.
    n_facets : int
        The most frequent number.
    best : float
        ln likelihood of the best particle at the weight used; shows whether the fit is good.
    """

    upper_bound: int
    sparsity: float
    shares: dict[int, float]
    n_facets: int
    best: float


def weight(area: float) -> float:
    """The weight that gives the albedo-area of the best fit a penalty of 50 nats, m⁻⁴.

    A facet with a fiftieth of the area then costs two nats. The total area, which the data
    determine to about a per cent, hardly changes.
    """
    return AREA_COST / area**2


def path(
    problem: Problem, data: Epochs, sites: tuple[str, ...], found: smc.Result, sparsity: float
) -> SparsePath:
    """Reduce the facets of each particle of the posterior under the sparse prior."""
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
    """Number of facets that are not small, after merging those that coincide.

    Parameters
    ----------
    vectors : (N, 3)
        Vectors of any length along the normals.
    areas : (N,)
    covariance : (3N, 3N)
        Covariance of the vectors.
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
    # derivative of |a − b| with respect to the vectors: along the distance, normal to each vector
    along = apart / distance
    gradient = np.concatenate(
        [(along - a * (a @ along)) / length[0], -(along - b * (b @ along)) / length[1]]
    )
    rows = np.concatenate([3 * i + np.arange(3), 3 * j + np.arange(3)])
    return bool(distance**2 < MERGE_SD**2 * (gradient @ covariance[np.ix_(rows, rows)] @ gradient))
