"""Whether chains about a solution have seen every arrangement of its facets.

A weak facet may lie wherever it is hardly seen, or share the place of a strong one. Chains that
follow gradients do not cross from one such arrangement to another, and agree with each other all
the same. `samplers.facet_moves` crosses, and leaves the posterior invariant: draws of the whole
posterior remain in the region that they fill. If more leave it than chance allows, the chains have
missed a part.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import binom

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.reasons import Finding
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.modes import ENCLOSED, Mode, Region
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.convergence import MAX_RHAT, rhat_and_ess
from lcbayes.samplers.facet_moves import FacetMoves

DRAWS, SWEEPS = 200, 4  # draws moved, and times that each is moved
FALSE_ALARM = 1e-3  # of a solution
LEAST_WEIGHT = 0.05  # of a solution that is tested


def missed(
    moves: FacetMoves, modes: Sequence[Mode], order: FacetOrder, data: Epochs, key: jax.Array
) -> list[Finding]:
    """A warning if draws of the solutions leave their regions when facets are moved.

    The region of a solution is the ellipsoid that encloses 99 % of its draws. Solutions of small
    weight, and those whose chains disagree, are not tested. The number of draws that are moved is
    at most their effective number, so that they are nearly independent.
    """
    regions = [Region.of(mode.z) for mode in modes]
    worst = 0.0
    for i, mode in enumerate(modes):
        flat = mode.z.reshape(-1, mode.z.shape[-1])
        rhat, size = rhat_and_ess(mode.z)
        if mode.weight < LEAST_WEIGHT or not rhat <= MAX_RHAT:
            continue
        number = int(min(DRAWS, size))
        rows = np.linspace(0, len(flat) - 1, number).round().astype(int)
        padded = np.resize(flat[rows], (DRAWS, flat.shape[1]))
        keys = jax.random.split(jax.random.fold_in(key, i), DRAWS)
        moved = np.asarray(_moved(moves, keys, padded, data))[:number]
        inside = [r.share(order.like_all(moved, r.mean)) <= 1.0 for r in regions]
        outside = ~np.any(inside, axis=0)
        if binom.sf(outside.sum() - 1, number, 1.0 - ENCLOSED) < FALSE_ALARM:
            worst = max(worst, float(outside.mean()))
    return [Finding("facets-elsewhere", {"percent": 100.0 * worst})] if worst else []


@jax.jit
def _moved(moves: FacetMoves, keys: jax.Array, rows: jax.Array, data: Epochs) -> jax.Array:
    """Rows z (n, D) after `SWEEPS` sweeps of the moves."""

    def one(row: tuple[jax.Array, jax.Array]) -> jax.Array:
        key, z = row
        z, _ = jax.lax.scan(
            lambda z, k: (moves(k, z, data), None), z, jax.random.split(key, SWEEPS)
        )
        return z

    return jax.lax.map(one, (keys, jnp.asarray(rows)))
