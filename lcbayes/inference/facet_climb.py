"""From the optima of a search to better ones, by putting one facet elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.arcs import Points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import OBS, SUN, Problem, compiled
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel
from lcbayes.samplers.facet_moves import AREAS, NORMALS

Floats = NDArray[np.float64]

CANDIDATES = 600  # normals tried for a facet
PLACES = 3  # best places tried for each facet that is moved
APART = np.cos(np.radians(25.0))  # between these places
CLIMB = search.Climb(most=12, rounds=6, halving=((1.0, 15, 0.5), (1.0, 150, 1.0)))


def climbed(
    problem: Problem,
    data: Epochs,
    law: DiffuseLaw,
    ends: SearchState,
    workers: int,
    progress: Silent,
    further: Callable[[Floats], Iterable[Floats]] = lambda _: (),
) -> SearchState:
    """The end points, with better optima reached by moving one facet, best first.

    Bodies of N facets have local optima: a facet that the optimiser has put in a wrong place stays
    there. Each facet of the best bodies in turn is taken away and put where it explains the most of
    what the others leave. All parameters are then optimised.

    Parameters
    ----------
    problem : Problem
        Of a body of diffuse facets.
    data : Epochs
    law : reflectance
    ends : SearchState
    workers : int
    progress : Silent
    further : callable
        More points to try, (D,) each, from an optimum (D,).
    """
    points = Points.of(data)

    def neighbours(z: Floats) -> Iterator[Floats]:
        yield from _moves(problem, data, points, law, z)
        yield from further(z)

    return search.climbed(problem, data, ends, neighbours, CLIMB, workers, progress)


def _moves(
    problem: Problem, data: Epochs, points: Points, law: DiffuseLaw, z: Floats
) -> Iterator[Floats]:
    """Unconstrained vectors of a body with one facet elsewhere."""
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    normals = sites[NORMALS] / np.linalg.norm(sites[NORMALS], axis=1, keepdims=True)
    grid = facets.grid(CANDIDATES)
    sun, obs = (jnp.asarray(sites[k][points.epoch]) for k in (SUN, OBS))
    every = jnp.asarray(np.concatenate([normals, grid]))
    columns = np.asarray(_columns(law, every, sun, obs)) / points.error[:, None]
    white = points.flux / points.error
    own, other = columns[:, : len(normals)], columns[:, len(normals) :]
    area, scale = np.exp(sites[AREAS]), 1.0
    if any(data.free_scale):
        found = np.abs(np.linalg.lstsq(own, white, rcond=None)[0])
        scale = max(float(np.median(found / area)), 1e-300)
    area = scale * area
    norm = np.sum(other**2, axis=0) + 1e-300
    for j in range(len(normals)):
        left = white - own @ area + own[:, j] * area[j]
        along = np.maximum(left @ other, 0.0)
        gain = along**2 / norm
        for _ in range(PLACES):
            i = int(np.argmax(gain))
            if gain[i] <= 0:
                break
            moved, sized = sites[NORMALS].copy(), sites[AREAS].copy()
            moved[j] = grid[i]
            sized[j] = np.log(along[i] / norm[i] / scale)
            yield with_sites(problem, sites, {NORMALS: moved, AREAS: sized})
            gain[grid @ grid[i] > APART] = 0.0


def with_sites(problem: Problem, sites: Mapping[str, Any], changed: Mapping[str, Any]) -> Floats:
    """The unconstrained vector (D,) of sites of which some are changed."""
    known = {k: jnp.asarray(changed.get(k, sites[k])) for k in problem.names}
    return np.asarray(problem.ravel(known))


@partial(jax.jit, static_argnums=0)
def _columns(law: DiffuseLaw, normals, sun, obs) -> jax.Array:
    return diffuse_kernel(law, sun @ normals.T, obs @ normals.T, LAMBERT_C)[0]
