"""How many edges the outline of a convex solid has at most.

An edge is on the outline along a direction that one of its two faces is turned to and the other is
not. Which faces those are changes where a direction crosses the plane of a face. Planes through the
origin divide the sphere into regions; all corners of the regions lie where two planes meet, and
about a corner, the planes that meet there divide the directions into sectors.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from lcbayes.physics.bodies.solids import Edges

Floats = NDArray[np.float64]

MOST_FACES = 64  # of a solid whose regions are visited; with more, all edges count
BESIDE = 1e-5  # rad from a corner to the directions that are tried
IN_PLANE = 1e-9  # sine of an angle that counts as zero


def longest_outline(edges: Edges) -> int:
    """The largest number of slots with an edge on the outline of a solid along any direction.

    Parameters
    ----------
    edges : Edges

    Returns
    -------
    int
        Over all directions, those in the plane of a face included. The number of slots for a flat
        solid, and for one of more faces than `MOST_FACES`.
    """
    faces = _distinct(np.concatenate([edges.normal_a, edges.normal_b]))
    corners = [np.cross(a, b) for a, b in combinations(faces, 2)]
    corners = [c / np.linalg.norm(c) for c in corners if np.linalg.norm(c) > IN_PLANE]
    if not corners or len(faces) > MOST_FACES:
        return len(edges.first)
    tried = np.concatenate([_about(corner, faces) for corner in _distinct(np.array(corners))])
    facing = [tried @ n.T > IN_PLANE for n in (edges.normal_a, edges.normal_b)]
    always = np.any(edges.second[:, 0] != edges.second[:, 1], axis=1)  # one of two edges is
    return int(np.sum((facing[0] != facing[1]) | always, axis=1).max())


def _distinct(directions: Floats) -> Floats:
    """Directions (n, 3), one of each pair that is opposite or equal."""
    left, kept = directions, []
    while len(left):
        kept.append(left[0])
        left = left[np.linalg.norm(np.cross(left, left[0]), axis=1) > IN_PLANE]
    return np.array(kept)


def _about(corner: Floats, faces: Floats) -> Floats:
    """A corner of regions, and directions in each sector and on each plane about it, (n, 3)."""
    planes = faces[np.abs(faces @ corner) < IN_PLANE]
    u = planes[0]
    v = np.cross(corner, u)
    angle = np.sort(np.arctan2(planes @ v, planes @ u) % np.pi) + 0.5 * np.pi
    between = 0.5 * (angle + np.append(angle[1:], angle[0] + np.pi))
    angle = np.concatenate([angle, between])
    angle = np.concatenate([angle, angle + np.pi])[:, None]
    return corner + BESIDE * np.concatenate(
        [np.zeros((1, 3)), np.cos(angle) * u + np.sin(angle) * v]
    )
