"""The sparse path to the number of facets (Linares & Crassidis, sec. VI).

The path starts from an upper bound on the number of facets, at the best fits of a search. Under the
squared-L1 prior, areas that the data do not require shrink to nearly zero. At the optimum these
facets are dropped, and facets whose normals coincide within their uncertainty are merged. The
remaining number is then used for the posterior under the log-normal prior. The method estimates one
number, without a probability: a quick estimate when the evidence of every number would be too
expensive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import search
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, prior_draws
from lcbayes.modelling.registry import Entry

Floats = NDArray[np.float64]

AREA_COST = 50.0  # nats; prior penalty for the total albedo-area of the best fit
LOG_AREA_SD = 3.0  # of the log-normal prior on the path; wide, to let areas shrink
MIN_AREA_SHARE = 0.02  # share of the albedo-area below which a facet is dropped
MERGE_SD = 2.0  # two normals coincide within this many standard deviations of their distance ...
MAX_MERGE_ANGLE = np.deg2rad(30.0)  # ... unless they differ by more than this angle
STARTS = 24  # starts of the path
ADDED_SHARE = 0.1  # share of the albedo-area of the facets that are added to a fit with fewer
NEAR = 10.0  # nats above the lowest potential within which an optimum counts


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
        Shares of the optima within 10 nats of the best, by remaining number of facets.
    n_facets : int
        The number that remains at the best optimum.
    best : float
        ln likelihood at the best optimum at the weight used; shows whether the fit is good.
    """

    upper_bound: int
    sparsity: float
    shares: dict[int, float]
    n_facets: int
    best: float

    @property
    def sentence(self) -> str:
        """The path in words, with its thresholds."""
        merged = f"{MERGE_SD:g} sd and {np.degrees(MAX_MERGE_ANGLE):.0f}°"
        return (
            f"The number of facets, {self.n_facets}, is that which remains of {self.upper_bound} "
            f"under a squared-L1 prior of weight {self.sparsity:.3g} /m⁴: facets below "
            f"{MIN_AREA_SHARE:.0%} of the albedo-area are dropped, and facets whose normals agree "
            f"within {merged} are merged. The fit has the log-normal prior, and no probability "
            "belongs to the number (`lcbayes compare`)."
        )


class Fit(NamedTuple):
    """A fit from which the path starts: the problem, and z (D,) in its coordinates."""

    problem: Problem
    z: Floats


def check(entry: Entry, upper_bound: int) -> None:
    """Raise an InputError if the model has no squared-L1 prior."""
    asked = {"sparsity", "log_area_sd", "n_facets"}
    if not asked <= set(entry.options) or "normals_base" not in entry.facet_sites:
        raise InputError(
            f"--sparse {upper_bound} goes with faceted and faceted-brdf: {entry.name} lacks their "
            "options sparsity and log_area_sd, or their site normals_base"
        )


def follow(
    entry: Entry,
    options: Mapping[str, Any],
    upper_bound: int,
    fits: Sequence[Fit],
    data: Epochs,
    key: jax.Array,
    workers: int,
) -> SparsePath:
    """The path from the best fits of a search.

    Parameters
    ----------
    options
        Options of the model; ``sparsity``, if given, replaces `weight`.
    upper_bound : int
        Initial number of facets.
    fits
        Best fits with at most that many facets, the one with the highest likelihood first.
    data : Epochs
        With the weight of the final posterior.

    Raises
    ------
    InputError
        If no start has a finite density under the sparse prior.
    """
    first = fits[0]
    area = first.problem.constrain(jnp.asarray(first.z), data)["albedo_area"]
    sparsity = float(options.get("sparsity", 0.0)) or weight(float(np.sum(area)))
    changed = {"n_facets": upper_bound, "sparsity": sparsity, "log_area_sd": LOG_AREA_SD}
    problem = build_problem(entry, {**options, **changed}, data)[0]
    n = -(-STARTS // len(fits))
    rows = [
        widened(fit, problem, entry.facet_sites, data, jax.random.fold_in(key, i), n)
        for i, fit in enumerate(fits)
    ]
    ends = search.polish(problem, data, np.concatenate(rows), workers)
    return path(problem, data, entry.facet_sites, ends.z, np.asarray(ends.potential), sparsity)


def widened(
    fit: Fit, larger: Problem, facet_sites: Sequence[str], data: Epochs, key: jax.Array, n: int
) -> Floats:
    """Starts (n, D) for a larger number of facets: a fit, and further facets.

    The further facets are drawn from the prior and share `ADDED_SHARE` of the fit's albedo-area, so
    that the start fits nearly as well.
    """
    sites = fit.problem.constrain(jnp.asarray(fit.z), data)
    known = len(sites["log_albedo_area"])

    def one(draw: jax.Array) -> jax.Array:
        drawn = larger.constrain(draw, data)
        added = max(len(drawn["log_albedo_area"]) - known, 1)
        area = jnp.log(ADDED_SHARE * jnp.sum(sites["albedo_area"]) / added)
        drawn["log_albedo_area"] = jnp.full_like(drawn["log_albedo_area"], area)
        return larger.ravel(
            {
                k: jnp.concatenate([sites[k], drawn[k][known:]]) if k in facet_sites else sites[k]
                for k in larger.names
            }
        )

    draws = prior_draws(larger, jax.random.split(key, n), data)
    return np.stack([np.asarray(one(draw)) for draw in draws])


def weight(area: float) -> float:
    """The weight that gives the albedo-area of the best fit a penalty of 50 nats, m⁻⁴.

    A facet with a fiftieth of the area then costs two nats. The total area, which the data
    determine to about a per cent, hardly changes.
    """
    return AREA_COST / area**2


def path(
    problem: Problem,
    data: Epochs,
    sites: tuple[str, ...],
    z: Floats,
    potential: Floats,
    sparsity: float,
) -> SparsePath:
    """Reduce the facets of optima z (B, D) of the posterior under the sparse prior."""
    potential = np.where(np.isfinite(potential), potential, np.inf)
    order = np.argsort(potential, kind="stable")
    if not np.isfinite(potential[order[0]]):
        raise InputError("no start of the sparse path has a finite density; lower --sparse")
    near = order[potential[order] <= potential[order[0]] + NEAR]
    left = remaining_at(problem, data, z[near])
    points = compiled(problem.log_likelihood)(jnp.asarray(z[near[0]]), data)
    best = float(jnp.sum(data.information * points))
    upper_bound = FacetOrder(problem, sites).n_facets
    return SparsePath(upper_bound, sparsity, shares_of(left), left[0], best)


def remaining_at(problem: Problem, data: Epochs, z: Floats) -> list[int]:
    """Number of facets that remain at each z (B, D) of the posterior under the sparse prior."""
    index = problem.unravel(jnp.arange(float(problem.dim)))
    base = np.asarray(index["normals_base"], int)
    left = []
    for row in z:
        area = np.asarray(problem.constrain(jnp.asarray(row), data)["albedo_area"])
        covariance = np.linalg.inv(np.asarray(compiled(problem.fisher)(jnp.asarray(row), data)))
        left.append(remaining(row[base], area, covariance[np.ix_(base.ravel(), base.ravel())]))
    return left


def shares_of(left: Sequence[int]) -> dict[int, float]:
    """Share of each of the numbers of facets that remain."""
    numbers, hits = np.unique(left, return_counts=True)
    return {int(n): float(h / len(left)) for n, h in zip(numbers, hits, strict=True)}


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
