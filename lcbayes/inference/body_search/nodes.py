"""A few points of each arc, between which the flux of the body is taken to be linear.

Sun and observer move slowly compared with the rotation. The flux in all phases is computed at the
nodes alone, and light curves are sums over them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.inference.spin_search.arcs import Arcs

Floats = NDArray[np.float64]

SPACING = np.deg2rad(6.0)  # largest change of the direction of the Sun or observer between nodes


class Nodes(NamedTuple):
    """Nodes by arc, padded to one length with nodes of no share.

    Attributes
    ----------
    sun, obs : (A, N, 3)
    share : (A, N, L)
        Of each node in the flux at each point; those of two nodes at most add to one.
    """

    sun: Floats
    obs: Floats
    share: Floats

    @classmethod
    def of(cls, arcs: Arcs, spacing: float = SPACING) -> Nodes:
        """Points that are at most a spacing (rad) apart, or neighbours."""
        inside = np.asarray(arcs.weight) > 0.0
        both = np.stack([np.asarray(arcs.sun), np.asarray(arcs.obs)], axis=2)
        each = [_of(both[a], np.flatnonzero(rows), spacing) for a, rows in enumerate(inside)]
        most = max(len(nodes) for nodes, _ in each)
        share = np.zeros((len(each), most, both.shape[1]))
        chosen = np.zeros((len(each), most), int)
        for a, (nodes, own) in enumerate(each):
            chosen[a, : len(nodes)] = nodes
            share[a, : len(nodes)] = own
        picked = both[np.arange(len(each))[:, None], chosen]
        return cls(picked[:, :, 0], picked[:, :, 1], share)


def _of(both: Floats, rows: NDArray, spacing: float) -> tuple[NDArray, Floats]:
    """Nodes (N,) of one arc, from its points (L, 2, 3) and those that count, and the shares."""
    order, path = _chain(both, rows)
    at = [0]
    while at[-1] < len(order) - 1:
        reached = int(np.searchsorted(path, path[at[-1]] + spacing, side="right")) - 1
        at.append(max(reached, at[-1] + 1))
    share = np.zeros((len(at), len(both)))
    for k, row in enumerate(order):
        j = int(np.searchsorted(at, k, side="right")) - 1
        share[j, row] = 1.0
        if k > at[j]:
            length = path[at[j + 1]] - path[at[j]]
            after = (path[k] - path[at[j]]) / length if length > 0.0 else 0.0
            share[j : j + 2, row] = 1.0 - after, after
    return order[at], share


def _chain(both: Floats, rows: NDArray) -> tuple[NDArray, Floats]:
    """The points in an order in which the directions change little, and the angle (rad) since the
    first of them: that of time for one observer, and one observer after another for several."""
    left = list(rows[1:])
    order, path = [rows[0]], [0.0]
    while left:
        cosine = np.einsum("nij,ij->ni", both[left], both[order[-1]])
        angle = np.arccos(np.clip(cosine, -1.0, 1.0)).max(axis=1)
        nearest = int(np.argmin(angle))
        path.append(path[-1] + float(angle[nearest]))
        order.append(left.pop(nearest))
    return np.array(order), np.array(path)
