"""Bodies of N facets at given spins, and the aliases of these spins."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.facet_climb import with_sites
from lcbayes.inference.spin_search.drift import SITE
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.samplers.facet_moves import AREAS, NORMALS

Floats = NDArray[np.float64]

OMEGA = "omega_unit"


class Bodies(NamedTuple):
    """Bodies of N facets with their spins.

    Attributes
    ----------
    omega : (n, 3) rad/s
    normals : (n, N, 3), body axes, which are the inertial axes at t = 0
    areas : (n, N) m²
    drift : (n,), optional
        Of the rate, in its prior sd; by default there is none.
    """

    omega: Floats
    normals: Floats
    areas: Floats
    drift: Floats | None = None


def starts(problem: Problem, data: Epochs, bodies: Bodies, omega_sd: float) -> Floats:
    """Unconstrained vectors (n, D); sites that a body does not set are at their prior means."""
    draw = compiled(problem.constrain)(jnp.zeros(problem.dim), data)
    rest = {k: draw[k] for k in problem.names if k not in (NORMALS, OMEGA, AREAS)}
    drift = np.zeros(len(bodies.omega)) if bodies.drift is None else bodies.drift
    every = bodies._replace(drift=drift)
    return np.asarray(_rows(problem, rest, *(jnp.asarray(x) for x in every), omega_sd))


@partial(jax.jit, static_argnums=0)
def _rows(problem: Problem, rest, omega, normals, areas, drift, omega_sd):
    def one(omega, normals, areas, drift):
        known = {OMEGA: omega / omega_sd, NORMALS: normals, AREAS: jnp.log(areas)}
        if SITE in rest:
            known[SITE] = drift
        return problem.ravel(rest | known)

    return jax.vmap(one)(omega, normals, areas, drift)


def aliases(problem: Problem, data: Epochs, middles: Floats, z: Floats) -> Iterator[Floats]:
    """Unconstrained vectors (D,) with one or two turns more or fewer between neighbouring passes,
    or from the first pass to the last.

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
            changed = {OMEGA: omega * (1.0 + change / rate), NORMALS: sites[NORMALS] @ turn.T}
            yield with_sites(problem, sites, changed)
