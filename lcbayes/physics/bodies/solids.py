"""Convex polyhedra that cast shadows: their faces, the part above a plane, their silhouettes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

FLAT = 1e-9  # of a body's extent: lengths below it count as zero


class Solid(NamedTuple):
    """A convex polyhedron, or a flat polygon seen from both sides.

    Attributes
    ----------
    vertices : (V, 3) m
    faces : list of (k,) int
        Indices into `vertices`, counter-clockwise seen from outside. A flat polygon has two faces,
        one the reverse of the other.
    """

    vertices: Floats
    faces: list[NDArray[np.integer]]


class Edges(NamedTuple):
    """Edges that can be on the outline of a solid, two to a slot where never both are.

    An edge is on the outline seen along a direction d where one of its two faces is turned towards
    d and the other is not. Two edges that share a face A, with other faces B and −B, exclude each
    other, so that a slot holds both. Of a slot without a second edge, ``second`` is a point.

    Attributes
    ----------
    first, second : (E, 2, 3) m
        Ends of the edges, in the order in which the face A has them.
    normal_a, normal_b : (E, 3)
        Outward normals of face A and of the other face of the first edge.
    """

    first: Floats
    second: Floats
    normal_a: Floats
    normal_b: Floats


def vector_area(polygon: ArrayLike) -> Floats:
    """½ Σ vᵢ × vᵢ₊₁, along the normal of a polygon (k, 3), as long as its area (Newell)."""
    v = np.asarray(polygon, float)
    v = v - v.mean(axis=0)
    return 0.5 * np.cross(v, np.roll(v, -1, axis=0)).sum(axis=0)


def flat_solid(polygon: ArrayLike) -> Solid:
    """A convex polygon (k, 3) that blocks light from both sides."""
    vertices = np.asarray(polygon, float)
    order = np.arange(len(vertices))
    return Solid(vertices, [order, order[::-1]])


def normals(solid: Solid) -> Floats:
    """Outward unit normals of the faces, (F, 3)."""
    vectors = np.array([vector_area(solid.vertices[face]) for face in solid.faces])
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def above(solid: Solid, point: ArrayLike, normal: ArrayLike) -> Solid | None:
    """What of a solid lies in the half-space n·(x − p) ≥ 0; None where it has no extent in it.

    Each face is cut in turn, and the cut closed by a face of its own (Sutherland & Hodgman 1974,
    Commun. ACM 17, 32). Vertices within `FLAT` of the plane count as on it.
    """
    n = np.asarray(normal, float)
    height = (solid.vertices - np.asarray(point, float)) @ n
    tolerance = FLAT * float(np.ptp(solid.vertices, axis=0).max())
    height[np.abs(height) <= tolerance] = 0.0
    if height.max() <= 0.0:
        return None
    if height.min() >= 0.0:
        return solid
    flat = len(solid.faces) == 2
    corners = [_cut(solid.vertices[face], height[face]) for face in solid.faces]
    if flat:
        return flat_solid(corners[0])
    kept = [face for face in corners if len(face) >= 3]
    origin = np.asarray(point, float)
    on_plane = np.concatenate([face[np.abs((face - origin) @ n) <= tolerance] for face in kept])
    lid = _hull_in_plane(on_plane, -n, tolerance)
    return _joined([*kept, *([lid] if len(lid) >= 3 else [])], tolerance)


def entered(solid: Solid, polygon: ArrayLike) -> Solid | None:
    """What of a solid light meets first on its way to a convex polygon (k, 3) outside.

    A ray to a point of the polygon enters a convex solid by a face that this point lies in front
    of, or on which it lies. If that can only be one face, its shadow on the polygon is that of the
    solid. None where it can be none.
    """
    corners = np.asarray(polygon, float)
    tolerance = FLAT * float(np.ptp(solid.vertices, axis=0).max())
    front = []
    for face, normal in zip(solid.faces, normals(solid), strict=True):
        ring = solid.vertices[face]
        height = (corners - ring[0]) @ normal
        touches = np.abs(height).max() <= tolerance and _overlap(ring, corners, normal, tolerance)
        if height.max() > tolerance or touches:
            front.append(ring)
    if not front:
        return None
    return flat_solid(front[0]) if len(front) == 1 else solid


def _overlap(a: Floats, b: Floats, normal: Floats, tolerance: float) -> bool:
    """Whether two convex polygons (k, 3) in one plane have common points inside.

    If not, a line along an edge of one of them separates them (Gottschalk et al. 1996, SIGGRAPH,
    171).
    """
    across = np.cross(normal, np.concatenate([np.roll(x, -1, axis=0) - x for x in (a, b)]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = [x @ across.T for x in (a, b)]
    gap = np.maximum(
        along[0].min(axis=0) - along[1].max(axis=0), along[1].min(axis=0) - along[0].max(axis=0)
    )
    return bool(gap.max() < -tolerance)


def _cut(polygon: Floats, height: Floats) -> Floats:
    """The part of a convex polygon whose heights are not negative."""
    corners = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if height[i] >= 0.0:
            corners.append(polygon[i])
        if height[i] * height[j] < 0.0:
            corners.append(
                polygon[i] + height[i] / (height[i] - height[j]) * (polygon[j] - polygon[i])
            )
    return np.array(corners).reshape(-1, 3)


def _hull_in_plane(points: Floats, normal: Floats, tolerance: float) -> Floats:
    """Vertices of a convex polygon in a plane, counter-clockwise about the normal, each once."""
    distinct: list[Floats] = []
    for point in points:
        if all(np.abs(point - other).max() > tolerance for other in distinct):
            distinct.append(point)
    if len(distinct) < 3:
        return np.zeros((0, 3))
    corners = np.array(distinct)
    offset = corners - corners.mean(axis=0)
    u = offset[0] / np.linalg.norm(offset[0])
    return corners[np.argsort(np.arctan2(offset @ np.cross(normal, u), offset @ u))]


def _joined(polygons: Sequence[Floats], tolerance: float) -> Solid:
    """A solid of faces that share vertices; a face that has shrunk to a line is left out."""
    vertices: list[Floats] = []
    faces = []
    for polygon in polygons:
        face: list[int] = []
        for point in polygon:
            near = (i for i, v in enumerate(vertices) if np.abs(v - point).max() <= 4 * tolerance)
            index = next(near, len(vertices))
            if index == len(vertices):
                vertices.append(point)
            if index not in face:
                face.append(index)
        if len(face) >= 3:
            faces.append(np.array(face))
    return Solid(np.array(vertices), faces)


def edges(solid: Solid) -> Edges:
    """The edges of a solid in slots: 6 for a box, 2n for a prism of n sides, k for a polygon.

    Edges between faces that are coplanar are left out, as they are never on the outline.
    """
    unit, vertices = normals(solid), solid.vertices
    cosines = unit @ unit.T
    opposite = [int(np.argmin(row)) if row.min() < -1.0 + 1e-12 else -1 for row in cosines]
    face_of = {
        (int(a), int(b)): f
        for f, face in enumerate(solid.faces)
        for a, b in zip(face, np.roll(face, -1), strict=True)
    }
    # ends of each edge by its two faces, in the order in which the first has them
    between = {
        (f, face_of[b, a]): (a, b)
        for (a, b), f in face_of.items()
        if cosines[f, face_of[b, a]] < 1.0 - 1e-12
    }
    if len(solid.faces) == 2:  # all edges are between the same two faces
        first = np.array([vertices[list(ends)] for ends in face_of if face_of[ends] == 0])
        count = len(first)
        point = np.repeat(first[:, :1], 2, axis=1)
        return Edges(first, point, np.tile(unit[0], (count, 1)), np.tile(unit[1], (count, 1)))
    slots: list[tuple[Floats, Floats, Floats, Floats]] = []
    done: set[tuple[int, int]] = set()
    for f, g in between:
        if (f, g) in done:
            continue
        done |= {(f, g), (g, f)}
        for a, b in ((f, g), (g, f)):
            mate = (a, opposite[b])
            if mate in between and mate not in done:
                done |= {mate, (mate[1], mate[0])}
                second = vertices[list(between[mate])]
                break
        else:
            a, b = f, g
            second = vertices[[between[f, g][0]] * 2]
        slots.append((vertices[list(between[a, b])], second, unit[a], unit[b]))
    return Edges(*(np.array(x) for x in zip(*slots, strict=True)))
