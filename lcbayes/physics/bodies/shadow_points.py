"""Shadows on bodies of many faces, by points: meshes, dishes, parts with hundreds of panels.

Every polygon has points that stand for equal shares of its area, of nearly the same area on all of
the body. A point is in shadow where the line from it along the direction to the Sun, or to the
observer, meets

- a convex solid of another part: where the interval of the line in front of all of its faces (Cyrus
  & Beck 1978) reaches beyond the point; or
- a triangle of a mesh, a dish or a plate. Triangles and points are projected on the plane across
  the direction, where a grid of cells says which triangles may lie over which points.

Exact for each point; the error of a fraction is that of the points, and
`parts.Assembly.shadow_error` measures it. In NumPy and without a derivative: for simulation only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.physics.bodies.mesh import triangles
from lcbayes.physics.bodies.solids import Solid, normals, vector_area

Floats = NDArray[np.float64]

POINTS = 16_000  # on the whole body
LEAST = 4  # on each polygon
CLEARANCE = 1e-6  # of the body's extent: what is nearer does not shade


@dataclass(frozen=True)
class Points:
    """Points on the polygons that something may shade.

    Attributes
    ----------
    at : (P, 3) m
    polygon : (P,) int
        Which polygon each is on, in order.
    part : (P,) int
        Which part that belongs to.
    normals : (N, 3)
        Of all polygons, by the order of their vertices.
    solids : list of (owner, normals (F, 3), offsets (F,))
        Convex solids: n·x ≤ offset for all faces. None shades the part that owns it.
    triangles : (F, 3, 3) m
        What else casts shadows.
    extent : float
        Of the body, m.
    """

    at: Floats
    polygon: NDArray[np.integer]
    part: NDArray[np.integer]
    normals: Floats
    solids: list[tuple[int, Floats, Floats]]
    triangles: Floats
    extent: float

    def lit_and_seen(self, sun: ArrayLike, obs: ArrayLike) -> Floats:
        """Fraction of each polygon that nothing shades and nothing hides, (T, N); see
        `shadow_area.lit_and_seen`."""
        count = len(self.normals)
        directions = np.asarray(sun, float), np.asarray(obs, float)
        fraction = np.ones((len(directions[0]), count))
        total = np.bincount(self.polygon, minlength=count)
        for row, (s, o) in enumerate(zip(*directions, strict=True)):
            facing = (self.normals @ s > 0.0) & (self.normals @ o > 0.0)
            mine = np.flatnonzero(facing[self.polygon])
            for direction in (s, o):
                mine = mine[~self._behind_solids(mine, direction)]
                if len(mine) and len(self.triangles):
                    mine = mine[~self._blocked(mine, direction)]
            left = np.bincount(self.polygon[mine], minlength=count)
            known = facing & (total > 0)
            fraction[row, known] = left[known] / total[known]
        return fraction

    def _behind_solids(self, mine: NDArray[np.integer], direction: Floats) -> NDArray[np.bool_]:
        """Which of the points have a convex solid of another part along a direction."""
        blocked = np.zeros(len(mine), bool)
        for owner, faces, offsets in self.solids:
            other = np.flatnonzero((self.part[mine] != owner) & ~blocked)
            outside = faces @ self.at[mine[other]].T - offsets[:, None]  # > 0 in front of a face
            enter, leave = np.zeros(len(other)), np.full(len(other), np.inf)
            for height, rate in zip(outside, faces @ direction, strict=True):
                if rate < 0.0:
                    np.maximum(enter, height / -rate, out=enter)
                elif rate > 0.0:
                    np.minimum(leave, height / -rate, out=leave)
                else:
                    leave[height > 0.0] = -1.0
            blocked[other] = leave > enter + CLEARANCE * self.extent
        return blocked

    def _blocked(self, mine: NDArray[np.integer], direction: Floats) -> NDArray[np.bool_]:
        """Which of the points have a triangle between them and what lies along a direction."""
        helper: Floats = np.eye(3)[int(np.argmin(np.abs(direction)))]
        u: Floats = np.cross(direction, helper)
        u /= np.linalg.norm(u)
        axes: Floats = np.stack([u, np.cross(direction, u), direction])
        points: Floats = self.at[mine] @ axes.T
        corners: Floats = self.triangles @ axes.T
        low = corners[:, :, :2].min(axis=(0, 1))
        cells = max(1, int(np.sqrt(len(corners))))
        size = np.maximum((corners[:, :, :2].max(axis=(0, 1)) - low) / cells, 1e-12 * self.extent)

        def cell(xy: Floats) -> NDArray[np.integer]:
            return np.clip(((xy - low) / size).astype(int), 0, cells - 1)

        # every cell that a triangle's bounding box touches, sorted by cell
        first, last = cell(corners[:, :, :2].min(axis=1)), cell(corners[:, :, :2].max(axis=1))
        wide = last - first + 1
        which = np.repeat(np.arange(len(corners)), wide.prod(axis=1))
        step = np.arange(len(which)) - np.repeat(
            np.cumsum(wide.prod(axis=1)) - wide.prod(axis=1), wide.prod(axis=1)
        )
        x = first[which, 0] + step % wide[which, 0]
        y = first[which, 1] + step // wide[which, 0]
        key = y * cells + x
        order = np.argsort(key, kind="stable")
        key, which = key[order], which[order]
        # triangles in the cell of each point
        own = cell(points[:, :2])
        own = own[:, 1] * cells + own[:, 0]
        begin, end = np.searchsorted(key, own), np.searchsorted(key, own, side="right")
        blocked = np.zeros(len(points), bool)
        for block in np.array_split(np.arange(len(points)), 1 + int((end - begin).sum() // 2**21)):
            many = (end - begin)[block]
            point = np.repeat(block, many)
            offset = np.arange(len(point)) - np.repeat(np.cumsum(many) - many, many)
            hit = _over(points[point], corners[which[begin[point] + offset]], self.extent)
            blocked[point[hit]] = True
        return blocked


def _over(points: Floats, corners: Floats, extent: float) -> NDArray[np.bool_]:
    """Whether a triangle lies over a point along the third axis, pair by pair."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac, ap = b - a, c - a, points - a
    whole = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    edge_on = np.abs(whole) <= 1e-14 * extent**2
    whole = np.where(edge_on, 1.0, whole)
    v = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / whole
    w = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / whole
    height = v * ab[:, 2] + w * ac[:, 2] - ap[:, 2]
    inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    return inside & ~edge_on & (height > CLEARANCE * extent)


def points_on(
    polygons: Sequence[Floats],
    parts: ArrayLike,
    solids: Sequence[Solid],
    owners: ArrayLike,
    count: int = POINTS,
) -> Points | None:
    """Points on the polygons that have any part of the body before them; None where none has.

    The parameters are those of `shadows.shadows`, and the number of points.
    """
    corners = np.unique(np.concatenate([solid.vertices for solid in solids]), axis=0)
    extent = float(np.ptp(corners, axis=0).max())
    vectors = np.array([vector_area(p) for p in polygons])
    areas = np.linalg.norm(vectors, axis=1)
    outward = vectors / areas[:, None]
    receivers = [
        i
        for i, polygon in enumerate(polygons)
        if np.max((corners - polygon[0]) @ outward[i]) > CLEARANCE * extent
    ]
    if not receivers:
        return None
    share = areas[receivers] / areas[receivers].sum()
    made = [
        _lattice(polygons[i], max(LEAST, round(count * part)), i)
        for i, part in zip(receivers, share, strict=True)
    ]
    which = np.repeat(receivers, [len(p) for p in made])
    convex = []
    for solid, owner in zip(solids, np.asarray(owners).tolist(), strict=True):
        if len(solid.faces) > 2:
            unit = normals(solid)
            first = solid.vertices[[face[0] for face in solid.faces]]
            convex.append((owner, unit, np.sum(unit * first, axis=1)))
    flat, _ = triangles([solid.vertices for solid in solids if len(solid.faces) == 2])
    part = np.asarray(parts)[which]
    return Points(np.concatenate(made), which, part, outward, convex, flat, extent)


def _lattice(polygon: Floats, count: int, seed: int) -> Floats:
    """Points of equal weight on a convex polygon: a lattice on each triangle of its fan.

    The lattice of Kronecker by the plastic number (Roberts 2018), folded into the triangle, and
    shifted at random, so that errors of equal panels side by side are not the same.
    """
    shift = np.random.default_rng(seed).random((len(polygon) - 2, 2))
    fan, _ = triangles([polygon])
    areas = 0.5 * np.linalg.norm(np.cross(fan[:, 1] - fan[:, 0], fan[:, 2] - fan[:, 0]), axis=1)
    edges = np.round(count * np.concatenate([[0.0], np.cumsum(areas)]) / areas.sum()).astype(int)
    plastic = 1.32471795724474602596
    points = []
    for triangle, begin, end, (right, up) in zip(fan, edges[:-1], edges[1:], shift, strict=True):
        i = np.arange(1, end - begin + 1)
        x, y = np.mod(right + i / plastic, 1.0), np.mod(up + i / plastic**2, 1.0)
        beyond = x + y > 1.0
        x, y = np.where(beyond, 1.0 - x, x)[:, None], np.where(beyond, 1.0 - y, y)[:, None]
        points.append(
            triangle[0] + x * (triangle[1] - triangle[0]) + y * (triangle[2] - triangle[0])
        )
    return np.concatenate(points)
