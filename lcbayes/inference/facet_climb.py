"""From the optima of a search to better ones, by putting one facet elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.motions import OBS, SUN
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.arcs import Points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

NORMALS, AREAS = "normals_base", "log_albedo_area"
CANDIDATES = 600  # normals tried for a facet
PLACES = 3  # best places tried for each facet that is moved
APART = np.cos(np.radians(25.0))  # between these places
MOVED = 12  # best bodies whose facets are moved
ROUNDS = 6
FIRST_STEPS, KEPT = 15, 0.5  # steps after which this share of the bodies is optimised
MIN_GAIN = 0.1  # nats


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
    what the others leave. All parameters are then optimised. Bodies are tried until all of the
    best have been, or until a round finds none that is better than all.

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
    ends, tried = search.best_first(ends), np.zeros(0)
    with progress.stage("moving facets", ROUNDS, "rounds") as bar:
        for _ in range(ROUNDS):
            rows = _different(ends, tried)
            if not rows:
                break
            tried = np.concatenate([tried, np.asarray(ends.potential)[rows]])
            starts = []
            for i in rows:
                z = np.asarray(ends.z[i])
                starts += [*_moves(problem, data, points, law, z), *further(z)]
            better = search.halved(problem, data, np.stack(starts), workers, FIRST_STEPS, KEPT)
            best = float(ends.potential[0])
            both = (np.concatenate([a, b]) for a, b in zip(ends, better, strict=True))
            ends = search.best_first(SearchState(*both))
            bar.advance(1)
            if not float(ends.potential[0]) < best - MIN_GAIN:
                break
    return ends


def _different(ends: SearchState, tried: Floats) -> list[int]:
    """Rows of the best end points of different potential, without those already tried."""
    rows: list[int] = []
    last = -np.inf
    for i, potential in enumerate(np.asarray(ends.potential)):
        if not np.isfinite(potential) or potential < last + MIN_GAIN:
            continue
        last = potential
        if not np.any(np.abs(tried - potential) < MIN_GAIN):
            rows.append(i)
        if len(rows) == MOVED:
            break
    return rows


def _moves(problem: Problem, data: Epochs, points: Points, law: DiffuseLaw, z: Floats):
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
