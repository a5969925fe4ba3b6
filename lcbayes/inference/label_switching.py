"""Label switching: facets are exchangeable, so a permuted body is the same solution.

The same holds of the attitudes in which a symmetric body looks the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import lgamma, log
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lcbayes.core.blocks import in_blocks
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]

ROWS = 256  # turned together


class FacetOrder:
    """Puts the facets of a vector z in the order of a reference.

    Parameters
    ----------
    problem : Problem
    sites : names of the sampled sites, drawn by the model, whose first axis is the facet.
    """

    def __init__(self, problem: Problem, sites: Sequence[str]) -> None:
        self.sites = tuple(sites)
        index = problem.unravel(jnp.arange(float(problem.dim)))
        self._rows = [
            np.asarray(index[s], int).reshape(len(index[s]), -1) for s in sites if s in index
        ]
        self.n_facets = len(self._rows[0]) if self._rows else 0

    @property
    def log_orders(self) -> float:
        """ln N!, with N! the number of facet orders of each body in the posterior."""
        return lgamma(self.n_facets + 1.0)

    def _features(self, z: Floats) -> Floats:
        return np.concatenate([z[rows] for rows in self._rows], axis=1)

    def _permuted(self, z: Floats, order: NDArray[np.int64]) -> Floats:
        z = z.copy()
        for rows in self._rows:
            z[rows] = z[rows[order]]
        return z

    def like(self, z: Floats, reference: Floats) -> Floats:
        """z (D,) with its facets matched to those of the reference (D,) at least distance."""
        return self.matching(z, reference, z)

    def like_all(self, z: Floats, reference: Floats) -> Floats:
        """`like` applied to every row of z (n, D)."""
        if self.n_facets < 2:
            return z
        a, b = self._features(reference), np.concatenate([z[:, r] for r in self._rows], axis=-1)
        cost = np.sum((a[None, :, None] - b[:, None]) ** 2, axis=-1)  # (n, N, N)
        best = np.array([linear_sum_assignment(c)[1] for c in cost]).reshape(cost.shape[:2])
        z = z.copy()
        for rows in self._rows:
            z[:, rows] = np.take_along_axis(z[:, rows], best[..., None], axis=1)
        return z

    def matching(self, z: Floats, reference: Floats, values: Floats) -> Floats:
        """``values`` (D,) permuted so that the facets of z match those of the reference."""
        if self.n_facets < 2:
            return values
        a, b = self._features(reference), self._features(z)
        cost = np.sum((a[:, None] - b[None]) ** 2, axis=-1)
        return self._permuted(values, linear_sum_assignment(cost)[1])

    def carried(self, z: Floats, reference: Floats, values: Floats) -> Floats:
        """``values`` (..., D), each changed as z (D,) must be to match the reference."""
        columns = self.matching(z, reference, np.arange(float(z.size)))
        return values[..., columns.astype(int)]

    def by_size(self, z: Floats, size: Floats) -> Floats:
        """z with its facets in order of decreasing ``size`` (N,)."""
        if self.n_facets < 2:
            return z
        return self._permuted(z, np.argsort(-size, kind="stable"))


class AttitudeOrder(FacetOrder):
    """Turns a symmetric body of known shape to the attitude that is nearest to a reference.

    Parameters
    ----------
    problem : Problem
    equivalents : list of {site: (n, n)}
        Orthogonal matrices on constrained sites; sites without one are unchanged. The first is the
        identity.
    """

    def __init__(
        self, problem: Problem, equivalents: Sequence[Mapping[str, NDArray[np.float64]]]
    ) -> None:
        super().__init__(problem, ())
        self._count = len(equivalents)
        self._problem = problem
        self._moves = {
            name: np.stack([np.asarray(one[name], float) for one in equivalents])
            for name in equivalents[0]
        }

    @property
    def log_orders(self) -> float:
        """ln of the number of equivalent attitudes."""
        return log(self._count)

    def images(self, z: Floats) -> Floats:
        """Each row of z (n, D) in all equivalent attitudes, (n, K, D)."""
        found = in_blocks(lambda rows: _images(self._problem, self._moves, rows), ROWS, z)
        found[:, 0] = z
        return found

    def like_all(self, z: Floats, reference: Floats) -> Floats:
        images = self.images(z)
        which = np.argmin(np.sum((images - reference) ** 2, axis=-1), axis=1)
        return np.take_along_axis(images, which[:, None, None], axis=1)[:, 0]

    def like(self, z: Floats, reference: Floats) -> Floats:
        return self.like_all(z[None], reference)[0]

    def matching(self, z: Floats, reference: Floats, values: Floats) -> Floats:
        return self.carried(z, reference, values)

    def carried(self, z: Floats, reference: Floats, values: Floats) -> Floats:
        which = np.argmin(np.sum((self.images(z[None])[0] - reference) ** 2, axis=-1))
        flat = values.reshape(-1, values.shape[-1])
        return self.images(flat)[:, which].reshape(values.shape)


@partial(jax.jit, static_argnums=0)  # one program for all instances
def _images(problem: Problem, moves: Mapping[str, Any], rows: jax.Array) -> jax.Array:
    """Rows z (n, D) after each move of the constrained sites, (n, K, D)."""

    def one(z: jax.Array, move: Mapping[str, jax.Array]) -> jax.Array:
        def moved(m: jax.Array) -> Callable[[jax.Array], jax.Array]:
            return lambda value: (m @ value.ravel()).reshape(value.shape)

        return problem.replaced(z, {name: moved(m) for name, m in move.items()})

    return jax.vmap(lambda z: jax.vmap(partial(one, z))(moves))(rows)


def by_size(problem: Problem, order: FacetOrder, z: Floats, centre: Floats, data: Epochs) -> Floats:
    """Facets of every draw matched to those of the centre, then sorted by decreasing size."""
    flat = order.like_all(z.reshape(-1, z.shape[-1]), centre)
    if order.n_facets < 2:
        return flat.reshape(z.shape)
    if "albedo_area" not in jax.eval_shape(problem.constrain, flat[0], data):
        return flat.reshape(z.shape)  # a user-defined model whose facets have no size
    sizes = np.asarray(_sizes(problem, flat, data)).mean(axis=0)
    mean = sizes[-order.n_facets :]  # facets of known normal come first
    columns = order.by_size(np.arange(float(flat.shape[1])), mean).astype(int)
    return flat[:, columns].reshape(z.shape)


@partial(jax.jit, static_argnums=0)
def _sizes(problem: Problem, rows: Floats, data: Epochs) -> jax.Array:
    return jax.vmap(lambda row: problem.constrain(row, data)["albedo_area"])(jnp.asarray(rows))
