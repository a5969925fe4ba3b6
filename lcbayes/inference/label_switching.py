"""Label switching: facets are exchangeable, so a permuted body is the same solution."""

from __future__ import annotations

from collections.abc import Sequence
from math import lgamma

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]


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

    def by_size(self, z: Floats, size: Floats) -> Floats:
        """z with its facets in order of decreasing ``size`` (N,)."""
        if self.n_facets < 2:
            return z
        return self._permuted(z, np.argsort(-size, kind="stable"))
