"""Bodies of N facets at given spins, and moves between the local optima of such bodies."""

from __future__ import annotations

import itertools
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.arcs import Points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

NORMALS, OMEGA, AREAS = "normals_base", "omega_unit", "log_albedo_area"
CANDIDATES = 600  # normals tried for a facet
PLACES = 3  # best places tried for each facet that is moved
APART = np.cos(np.radians(25.0))  # between these places
MOVED = 4  # best bodies whose facets are moved
ROUNDS = 6
MIN_GAIN = 0.1  # nats


class Bodies(NamedTuple):
    """Bodies of N facets with their spins.

    Attributes
    ----------
    omega : (n, 3) rad/s
    normals : (n, N, 3), body axes, which are the inertial axes at t = 0
    areas : (n, N) m²
    """

    omega: Floats
    normals: Floats
    areas: Floats


def starts(problem: Problem, data: Epochs, bodies: Bodies, omega_sd: float) -> Floats:
    """Unconstrained vectors (n, D); sites that a body does not set are at their prior means."""
    draw = compiled(problem.constrain)(jnp.zeros(problem.dim), data)
    rest = {k: draw[k] for k in problem.names if k not in (NORMALS, OMEGA, AREAS)}
    return np.asarray(_rows(problem, rest, *(jnp.asarray(x) for x in bodies), omega_sd))


@partial(jax.jit, static_argnums=0)
def _rows(problem: Problem, rest, omega, normals, areas, omega_sd):
    def one(omega, normals, areas):
        known = {OMEGA: omega / omega_sd, NORMALS: normals, AREAS: jnp.log(areas)}
        return problem.ravel(rest | known)

    return jax.vmap(one)(omega, normals, areas)


def climbed(
    problem: Problem,
    data: Epochs,
    points: Points,
    law: DiffuseLaw,
    ends: SearchState,
    middles: Floats,
    workers: int,
) -> SearchState:
    """The end points, with better optima reached by moving one facet or adding turns.

    Bodies of N facets have local optima: a facet that the optimiser has put in a wrong place stays
    there. Each facet of the best bodies in turn is taken away and put where it explains the most of
    what the others leave. A rate may also be wrong by whole turns between two passes, whose
    ``middles`` (A,) s are given. All parameters are then optimised.
    """
    for _ in range(ROUNDS):
        rows = []
        for i in _different(ends):
            z = np.asarray(ends.z[i])
            rows += [*_moves(problem, data, points, law, z), *_aliases(problem, data, middles, z)]
        if not rows:
            break
        tried = search.polish(problem, data, np.stack(rows), workers)
        best = float(ends.potential[0])
        both = (np.concatenate([a, b]) for a, b in zip(ends, tried, strict=True))
        ends = search.best_first(SearchState(*both))
        if not float(ends.potential[0]) < best - MIN_GAIN:
            break
    return ends


def _aliases(problem: Problem, data: Epochs, middles: Floats, z: Floats):
    """Unconstrained vectors with one or two turns more or fewer between neighbouring passes, or
    from the first pass to the last.

    The attitude in the middle of the earlier pass is unchanged, and so is that of the later one.
    """
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    omega, rate = sites[OMEGA], float(np.linalg.norm(sites["omega"]))
    pairs = list(itertools.pairwise(np.sort(middles)))
    if len(pairs) > 1:
        pairs.append((middles.min(), middles.max()))
    for start, end in pairs:
        for turns in (-2, -1, 1, 2):
            change = 2 * np.pi * turns / (end - start)
            if rate + change <= 0:
                continue
            turn = Rotation.from_rotvec(-sites["omega"] / rate * change * start).as_matrix()
            known = {k: jnp.asarray(sites[k]) for k in problem.names}
            known |= {
                OMEGA: jnp.asarray(omega * (1.0 + change / rate)),
                NORMALS: jnp.asarray(sites[NORMALS] @ turn.T),
            }
            yield np.asarray(problem.ravel(known))


def _different(ends: SearchState) -> list[int]:
    """Rows of the best end points of different potential."""
    rows = [0]
    for i in range(1, len(ends.potential)):
        if ends.potential[i] > ends.potential[rows[-1]] + MIN_GAIN:
            rows.append(i)
        if len(rows) == MOVED:
            break
    return [i for i in rows if np.isfinite(ends.potential[i])]


def _moves(problem: Problem, data: Epochs, points: Points, law: DiffuseLaw, z: Floats):
    """Unconstrained vectors of a body with one facet elsewhere."""
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    normals = sites[NORMALS] / np.linalg.norm(sites[NORMALS], axis=1, keepdims=True)
    grid = facets.grid(CANDIDATES)
    columns = (
        np.asarray(
            _columns(
                law,
                jnp.asarray(np.concatenate([normals, grid])),
                jnp.asarray(sites["omega"]),
                *(jnp.asarray(x) for x in (points.t, points.sun, points.obs)),
            )
        )
        / points.error[:, None]
    )
    white = points.flux / points.error
    own, other = columns[:, : len(normals)], columns[:, len(normals) :]
    unit = np.linalg.lstsq(own, white, rcond=None)[0]
    sizes = np.exp(sites[AREAS])
    scale = max(float(np.median(np.abs(unit) / sizes)), 1e-300)  # of curves of unknown scale
    area = scale * sizes
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
            known = {k: jnp.asarray(sites[k]) for k in problem.names}
            yield np.asarray(
                problem.ravel(known | {NORMALS: jnp.asarray(moved), AREAS: jnp.asarray(sized)})
            )
            gain[grid @ grid[i] > APART] = 0.0


@partial(jax.jit, static_argnums=0)
def _columns(law, normals, omega, t, sun, obs) -> jax.Array:
    sun, obs = rotations.constant_rate_to_body(t, omega, sun, obs)
    return diffuse_kernel(law, sun @ normals.T, obs @ normals.T, LAMBERT_C)[0]
