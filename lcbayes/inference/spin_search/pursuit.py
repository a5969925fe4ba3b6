"""Bodies of N facets at given spins by orthogonal matching pursuit on a grid of normals.

Facets are added one by one, each where it improves the fit the most when the areas of all follow.
Each is then taken away and put where that holds with the others there. The normal equations need
only the products of the columns of these facets with all others.

References
----------
Pati, Rezaiifar & Krishnaprasad 1993, Proc. 27th Asilomar Conf., 40.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import each, in_blocks, together
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.threads import threads
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.bodies import design_matrix
from lcbayes.physics.brightness import DiffuseLaw

Floats = NDArray[np.float64]

BATCH = 64, 2048  # motions at once, on a CPU and on an accelerator
SWEEPS = 2  # by default: see `pursued`
NEW = 1e-6  # part of a column that must be perpendicular to those of the other facets
SMALLEST = 0.02  # area of a facet, relative to the largest


class Pursued(NamedTuple):
    """B bodies at each of n motions.

    Attributes
    ----------
    rows : (n, B, N)
        Of the normals of the facets.
    areas : (n, B, N) m²
    chi2 : (n, B)
    """

    rows: NDArray[np.int64]
    areas: Floats
    chi2: Floats


def pursued(
    arcs: Arcs,
    motion: tuple[Floats, Floats, Floats],
    law: DiffuseLaw,
    normals: Floats,
    n_facets: int,
    workers: int,
    sweeps: int = SWEEPS,
    first: NDArray[np.int64] | None = None,
) -> Pursued:
    """The facets of a body at each of n motions, and of one more for each facet that is given.

    Parameters
    ----------
    arcs : Arcs
    motion : (n, 3), (n,) rad/s, (n, A) rad
        Pole, rate and phases, as in `bodies.States`.
    law : reflectance
    normals : (M, 3)
        In the axes of `series.frame` of the pole, turned by the phase.
    n_facets : int
    workers : int
    sweeps : int
        In which each facet is taken away once.
    first : (n, B − 1), optional
        Rows of the normal of a facet that each further body has in any case.
    """
    grid = jnp.asarray(normals, jnp.float32)  # the choice of facets needs no more
    rows = (*motion, np.zeros((len(motion[1]), 0), int) if first is None else first)

    def some(*rows: jax.Array) -> Pursued:
        found = _pursued(law, n_facets, sweeps, grid, arcs, *map(jnp.asarray, rows))
        return Pursued(*map(np.asarray, found))

    with threads(workers) as pool:
        return in_blocks(some, together(*BATCH), *rows, over=pool.map)


@partial(jax.jit, static_argnums=(0, 1, 2))
def _pursued(law: DiffuseLaw, n_facets: int, sweeps: int, grid, arcs: Arcs, *rows):
    top = jnp.max(arcs.weight)  # so that single precision suffices for any unit of flux
    arcs = replace(arcs, weight=arcs.weight / top, white=arcs.white / top)
    white = arcs.white.ravel().astype(grid.dtype)

    def one(row):
        pole, rate, phase, first = row
        angle = (rate * arcs.dt + phase[:, None]).ravel()
        columns = design_matrix(law, grid, arcs, pole, angle)

        def body(facet: jax.Array | None):
            chosen, areas = pursuit(columns, white, n_facets, facet, sweeps)
            left = white - columns[:, chosen] @ areas
            return chosen, areas.astype(float), (left @ left).astype(float) * top**2

        found = [body(facet) for facet in (None, *first)]
        return jax.tree.map(lambda *x: jnp.stack(x), *found)

    return each(one, rows)


def pursuit(
    columns: jax.Array,
    white: jax.Array,
    n_facets: int,
    first: jax.Array | None = None,
    sweeps: int = SWEEPS,
) -> tuple[jax.Array, jax.Array]:
    """Indices (N,) of columns (T, M), and their positive coefficients (N,), for the data (T,).

    The column ``first`` is among them if it is given; the others are chosen.
    """
    along, square = white @ columns, jnp.sum(columns**2, axis=0)
    slots = jnp.arange(n_facets)
    given = 0 if first is None else 1

    def solved(products: jax.Array, chosen: jax.Array, used: jax.Array, right: jax.Array):
        """Solution for right-hand sides (N, K) of the normal equations of the slots in use."""
        matrix = jnp.where(used[:, None] & used, products[:, chosen], 0.0)
        matrix += jnp.diag(jnp.where(used, NEW * square[chosen], 1.0))
        return _eliminated(matrix, jnp.where(used[:, None], right, 0.0))

    def areas(products: jax.Array, chosen: jax.Array, used: jax.Array) -> jax.Array:
        """Areas of the slots in use; those that would be negative are left out."""
        for _ in range(2):
            area = solved(products, chosen, used, along[chosen][:, None])[:, 0]
            used = used & (area > 0.0)
        return jnp.where(used, solved(products, chosen, used, along[chosen][:, None])[:, 0], 0.0)

    def step(k, state):
        products, chosen, used, value = state
        j = given + k % (n_facets - given)
        others = used & (slots != j)
        left = along - areas(products, chosen, others) @ products
        across = jnp.where(others[:, None], products, 0.0)
        free = square - jnp.sum(across * solved(products, chosen, others, across), axis=0)
        possible = (left > 0.0) & (free > NEW * square)
        best = jnp.argmax(jnp.where(possible, left**2 / jnp.where(possible, free, 1.0), 0.0))
        new_products = products.at[j].set(columns[:, best] @ columns)
        new_chosen, new_used = chosen.at[j].set(best), used.at[j].set(True)
        new_value = areas(new_products, new_chosen, new_used) @ along[new_chosen]
        better = (new_value > value) | ~used[j]
        new = new_products, new_chosen, new_used, new_value
        return jax.tree.map(lambda a, b: jnp.where(better, a, b), new, state)

    none = jnp.zeros(n_facets, int)
    products, chosen, used = jnp.zeros((n_facets, len(square))), none, none > 0
    if first is not None:
        products = products.at[0].set(columns[:, first] @ columns)
        chosen, used = chosen.at[0].set(first), used.at[0].set(True)
    if n_facets > given:
        start = products, chosen, used, jnp.zeros(())
        steps = (1 + sweeps) * (n_facets - given)
        products, chosen, used, _ = jax.lax.fori_loop(0, steps, step, start)
    area = areas(products, chosen, used)
    return chosen, jnp.maximum(area, SMALLEST * jnp.max(area) + jnp.finfo(area.dtype).tiny)


def _eliminated(matrix: jax.Array, right: jax.Array) -> jax.Array:
    """Solution (N, K) for a positive definite matrix (N, N), by elimination.

    A call of LAPACK for each of many small matrices takes longer.
    """
    rows = jnp.concatenate([matrix, right], axis=1)
    for i in range(len(matrix)):
        pivot = rows[i] / rows[i, i]
        rows = (rows - rows[:, i : i + 1] * pivot).at[i].set(pivot)
    return rows[:, len(matrix) :]
