"""Selection of the solutions to sample from the end points of a search."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import Controls, Quadratic, levenberg_marquardt
from lcbayes.inference import search
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.search import SearchState
from lcbayes.modelling import nuisances, zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, shaded

Floats = NDArray[np.float64]

SAME = 2.0  # whitened distance per √dimension within which two end points are one solution
MAX_RELATIVE_MISFIT = 1.05  # rms residual relative to the best: dropped above this ...
MAX_EVIDENCE_DEFICIT = 10.0  # ... unless its Laplace evidence is within this many nats of the best
MAX_IMAGE_DIFFERENCE = 0.1  # largest difference in ln density of a solution and its image, nats
MAX_STEPS = 60  # of the optimisation of the parameters that a simpler problem lacks
CONTROLS = Controls(largest_damping=1e6, patience=1)


@dataclass(frozen=True)
class Solution:
    """One optimum of the posterior.

    Attributes
    ----------
    z : (D,) unconstrained vector
    potential : −ln p(y, z)
    log_evidence : Laplace approximation; used for ranking, not as a weight
    rms : of the residuals of the fit to the points at full weight, of `rms`
    hits : number of starts of the search that ended here
    """

    z: Floats
    potential: float
    log_evidence: float
    rms: float
    hits: int


def _rms(data: Epochs, mean: Floats | jax.Array, unit: Floats | jax.Array) -> float:
    """Root mean square of (observed minus expected brightness)/``unit`` (T,)."""
    return float(np.sqrt(np.mean((np.asarray(data.brightness - mean) / unit) ** 2)))


def distinct(
    problem: Problem, data: Epochs, ends: SearchState, order: FacetOrder, most: int
) -> list[Solution]:
    """The distinct optima among the end points of a search, best first."""
    fisher = compiled(problem.fisher)
    found: list[Solution] = []
    metrics: list[Floats] = []
    unit = np.asarray(data.noise_unit)[data.curve]
    finite = np.isfinite(ends.potential)
    for z, potential in zip(ends.z[finite], np.asarray(ends.potential)[finite], strict=True):
        z = np.asarray(z)
        for i, known in enumerate(found):
            if _is_same(z, known, metrics[i], order):
                found[i] = replace(known, hits=known.hits + 1)
                break
        else:
            if len(found) >= most:
                continue
            here = shaded(problem, z, data)
            metrics.append(np.asarray(fisher(jnp.asarray(z), here)))
            evidence = laplace(potential, metrics[-1])
            mean = compiled(problem.moments)(jnp.asarray(z), here.without_passes()).mean
            found.append(Solution(z, float(potential), evidence, _rms(data, mean, unit), 1))
    return found


def _is_same(z: Floats, known: Solution, metric: Floats, order: FacetOrder) -> bool:
    """Whether z (D,) is a known solution, by the distance in its own metric."""
    step = order.like(z, known.z) - known.z
    return bool(step @ metric @ step < SAME**2 * len(z))


def with_images(
    problem: Problem, data: Epochs, found: list[Solution], mirror: Floats, order: FacetOrder
) -> list[Solution]:
    """Solutions and any missing mirror images, z → Q z with ``mirror`` Q (D, D), best first.

    An image is added only if it is as probable as the solution; otherwise Q is not a symmetry of
    the posterior. It receives the hits of the solution, because starts reach either equally often.
    """
    metrics = [np.asarray(compiled(problem.fisher)(jnp.asarray(s.z), data)) for s in found]
    every = list(found)
    for solution in found:
        z = mirror @ solution.z
        known = any(_is_same(z, s, m, order) for s, m in zip(found, metrics, strict=True))
        if not known:
            potential = float(compiled(problem.potential)(jnp.asarray(z), data))
            if abs(potential - solution.potential) < MAX_IMAGE_DIFFERENCE:
                every.append(replace(solution, z=z, potential=potential))
    return sorted(every, key=lambda s: s.potential)


def polished(problem: Problem, data: Epochs, found: list[Solution], workers: int) -> list[Solution]:
    """The optima re-optimised for data of lower weight than in the search. The rms remains that of
    the fit to the points at full weight."""
    fisher = compiled(problem.fisher)
    state = search.polish(problem, data, np.stack([s.z for s in found]), workers)
    moved = []
    for solution, z, potential in zip(found, state.z, state.potential, strict=True):
        metric = np.asarray(fisher(jnp.asarray(z), data))
        evidence = laplace(potential, metric)
        moved.append(replace(solution, z=z, potential=float(potential), log_evidence=evidence))
    return moved


def completed(pooled: Problem, problem: Problem, data: Epochs, z: Floats) -> Floats:
    """Rows (B, D) of a simpler problem as rows of the full one. Parameters that the simpler problem
    lacks take their conditional prior means."""

    return np.stack([np.asarray(_completed(pooled, problem, data, row)) for row in jnp.asarray(z)])


@partial(jax.jit, static_argnums=(0, 1))
def _completed(pooled: Problem, problem: Problem, data: Epochs, z: jax.Array) -> jax.Array:
    sites = pooled.constrain(z, data)
    trace = problem.trace(sites, data)
    for name in problem.names:
        if name not in pooled.names:
            sites[name] = trace[name]["fn"].mean
    return problem.ravel(sites)


def refined(
    pooled: Problem, problem: Problem, data: Epochs, found: list[Solution]
) -> list[Solution]:
    """The solutions of a simpler problem as starting points for sampling the full one.

    Parameters that the simpler problem lacks are optimised, except for group spreads
    (``log_…_sd``), which stay at their prior means. The joint optimum of a spread and its members
    is uninformative: it lies at a spread of zero or, in non-centred form, at one far too large.
    """
    rows = completed(pooled, problem, data, np.stack([s.z for s in found]))
    climbed = [replace(s, z=z) for s, z in zip(found, rows, strict=True)]
    climbed = optimise_held(pooled, problem, data, climbed)
    return [replace(s, rms=rms(problem, s.z, data)) for s in climbed]


def rms(problem: Problem, z: Floats, data: Epochs) -> float:
    """Root mean square of the residuals, with zero points at their means given the data.

    It is in magnitudes for magnitudes, and relative to a curve's mean brightness for fluxes.
    Offsets of passes are not subtracted.
    """
    here = shaded(problem, z, data)
    mean = compiled(problem.moments)(jnp.asarray(z), here.without_passes()).mean
    sites = compiled(problem.constrain)(jnp.asarray(z), here)
    at_mean = nuisances.jointly(sites, lambda name: np.zeros(sites[name].shape))
    zero_point = at_mean.zero_point
    if zero_point is not None:
        each = jnp.append(zero_point, 0.0)[data.calibration]
        mean = mean + zero_points.response(data, mean) * each
    return _rms(data, mean, data.noise_unit[data.curve])


def optimise_held(
    pooled: Problem, problem: Problem, data: Epochs, found: list[Solution]
) -> list[Solution]:
    """The optima near given points, with spreads that the simpler problem lacks held fixed."""
    held = [k for k in problem.names if k not in pooled.names and _is_spread(k)]
    free = np.setdiff1d(np.arange(problem.dim), problem.rows(held))
    moved = []
    for solution in found:
        z, potential = optimum(problem, data, solution.z, free)
        metric = np.asarray(compiled(problem.fisher)(jnp.asarray(z), data))
        evidence = laplace(potential, metric)
        moved.append(replace(solution, z=z, potential=potential, log_evidence=evidence))
    return moved


def _is_spread(name: str) -> bool:
    return name.startswith("log_") and name.endswith("_sd")


def optimum(
    problem: Problem, data: Epochs, z: Floats, free: NDArray[np.intp]
) -> tuple[Floats, float]:
    """The end point of a minimisation along some coordinates, and the potential there."""

    def at(position: Floats) -> Floats:
        moved = z.copy()
        moved[free] = position
        return moved

    def model(position: Floats) -> Quadratic:
        where = jnp.asarray(at(position))
        here = shaded(problem, where, data)
        return Quadratic(
            float(compiled(problem.potential)(where, here)),
            np.asarray(compiled(problem.slope)(where, here))[free],
            np.asarray(compiled(problem.fisher)(where, here))[np.ix_(free, free)],
        )

    end = levenberg_marquardt(
        model, z[free], num_steps=MAX_STEPS, tolerance=search.TOLERANCE, controls=CONTROLS
    )
    return at(end.position), end.model.value


def select_for_sampling(problem: Problem, data: Epochs, found: list[Solution]) -> list[Solution]:
    """The solutions close to the best in fit or evidence, the most probable first."""
    best = min(found, key=lambda s: s.potential)
    moments = compiled(problem.moments)
    noise = np.asarray(moments(jnp.asarray(best.z), data).sd)
    misfit = [_rms(data, moments(jnp.asarray(s.z), data).mean, noise) for s in found]
    likely = max(s.log_evidence for s in found) - MAX_EVIDENCE_DEFICIT
    kept = [
        s
        for s, m in zip(found, misfit, strict=True)
        if m < MAX_RELATIVE_MISFIT * min(misfit) or s.log_evidence > likely
    ]
    return sorted(kept, key=lambda s: -s.log_evidence)


def laplace(potential: float, metric: Floats) -> float:
    """ln ∫ exp(−U) in the Gaussian (Laplace) approximation."""
    half_log_det = 0.5 * np.linalg.slogdet(metric)[1]
    return float(-potential - half_log_det + 0.5 * len(metric) * np.log(2 * np.pi))
