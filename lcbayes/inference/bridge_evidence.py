"""Evidence of one solution from the draws of its chains, by bridge sampling."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcbayes.inference.label_switching import FacetOrder
from lcbayes.modelling.constrained import potentials
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import bridge
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.chains import Whitening

Floats = NDArray[np.float64]

BRIDGE_ESS = 200.0  # effective number of draws per solution in the error of its weight


def evidence(
    problem: Problem,
    data: Epochs,
    order: FacetOrder,
    whitening: Whitening,
    z: Floats,
    z0: Floats,
    rng: np.random.Generator,
    energies: Floats | None = None,
) -> LogEvidence:
    """Evidence of a solution z0 (D,) from its draws z (C, S, D), over all facet orders.

    ``energies`` (C, S) are −ln p of the draws, if they are known.
    """
    flat = z.reshape(-1, z.shape[-1])
    y = np.linalg.solve(whitening.factor, (z - whitening.centre).reshape(flat.shape).T)
    reference = order.like(z0, flat.mean(axis=0))
    potential = _potential(problem, whitening, data, order, reference)
    if energies is not None:
        inside = np.all(order.like_all(flat, reference) == flat, axis=1)
        energies = np.where(inside, energies.ravel(), np.inf).reshape(energies.shape)
    found = bridge.bridge(y.T.reshape(z.shape), potential, BRIDGE_ESS, rng, energies)
    shift = np.linalg.slogdet(whitening.factor)[1] + order.log_orders
    return LogEvidence(float(found.value + shift), found.se)


def _potential(problem: Problem, whitening, data: Epochs, order: FacetOrder, reference: Floats):
    """−ln p of whitened points whose facets are in the order of the reference (D,)."""

    def potential(y: Floats) -> Floats:
        z = whitening.centre + y @ whitening.factor.T
        inside = np.all(order.like_all(z, reference) == z, axis=1)
        return np.where(inside, potentials(problem, z, data), np.inf)

    return potential
