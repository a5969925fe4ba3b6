"""Which convex solids can shade or hide which convex polygons of a body.

The polygons are grouped by the shape of their arrays, for `shadow_area`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.physics.bodies.outlines import longest_outline
from lcbayes.physics.bodies.solids import Edges, Solid, above, edges, entered, vector_area

Floats = NDArray[np.float64]


class Group(NamedTuple):
    """Polygons that receive shadows, with equally many edges and equally many solids before them.

    Attributes
    ----------
    index : (R,) int
        Which polygon of the body each one is.
    frame : (3, 3, R)
        Rows: two unit vectors in the polygon's plane and its normal, body frame.
    corners : (K, 2, R) m
        Vertices in the plane, counter-clockwise; the first is the origin, the second on the x axis.
    area : (R,) m²
    first, second : (J, E, 2, 3, R) m
        Ends of the edges of each solid (`solids.Edges`): in the plane, and height above it.
    normal_a, normal_b : (J, E, 3, R)
        In the polygon's frame.
    order : (S, R) int
        1, 2, … S, the largest number of edges of an outline.
    low, high : (J, 3, R) m
        Of each solid, in the plane and height above it.
    """

    index: NDArray[np.integer]
    frame: Floats
    corners: Floats
    area: Floats
    first: Floats
    second: Floats
    normal_a: Floats
    normal_b: Floats
    order: NDArray[np.integer]
    low: Floats
    high: Floats

    def tests(self, count: int) -> int:
        """Edges tested against edges, for one polygon with so many shadows at one epoch."""
        return _tests(len(self.corners), count, len(self.order))


class _Receiver(NamedTuple):
    index: int
    polygon: Floats
    before: list[Edges]
    size: tuple[int, int, int, int]  # see `_size`


def shadows(
    polygons: Sequence[Floats],
    parts: ArrayLike,
    solids: Sequence[Solid],
    owners: ArrayLike,
    most: float = np.inf,
) -> tuple[Group, ...] | None:
    """Which solids can shade or hide which polygons, with what of each is above the plane.

    A solid cannot where all of it lies behind the plane of the polygon, and none shades the part
    that it belongs to.

    Parameters
    ----------
    polygons : list of (k, 3) m
        Convex and planar, counter-clockwise seen from outside, body frame.
    parts : (N,) int
        Which part each polygon belongs to.
    solids : list of Solid
    owners : (S,) int
        Which part each solid belongs to; −1 for one that may shade any polygon.
    most : float
        Give up where over so many tests an epoch are needed (`tests_per_epoch`).

    Returns
    -------
    tuple of Group
        Empty where nothing can be in shadow, as for a convex body; None where it gave up.
    """
    part, owner = np.asarray(parts), np.asarray(owners)
    receivers, tests = [], 0
    for i, polygon in enumerate(polygons):
        vector = vector_area(polygon)
        normal = vector / np.linalg.norm(vector)
        others = [solid for solid, whose in zip(solids, owner, strict=True) if whose != part[i]]
        cut = [above(solid, polygon[0], normal) for solid in others]
        met = [entered(solid, polygon) for solid in cut if solid is not None]
        before = [edges(solid) for solid in met if solid is not None]
        if before:
            size = corners, count, _, outline = _size(polygon, before)
            receivers.append(_Receiver(i, polygon, before, size))
            tests += _tests(corners, 2 * count, outline)
            if tests > most:
                return None
    by_shape: dict[tuple[int, int, int, int], list[_Receiver]] = {}
    for one in receivers:
        by_shape.setdefault(one.size, []).append(one)
    return tuple(_group(members) for _, members in sorted(by_shape.items()))


def _size(polygon: Floats, before: Sequence[Edges]) -> tuple[int, int, int, int]:
    """Numbers of corners, of solids, of edges of a solid and of edges of an outline.

    So that there are few groups, corners and edges of a solid are filled up to 4, 6, 8, 12, 16, 24,
    …, and edges of an outline to an even number.
    """

    def rounded(count: int) -> int:
        power = 1 << max(2, (count - 1).bit_length())
        return 3 * power // 4 if power > 4 and count <= 3 * power // 4 else power

    slots = rounded(max(len(e.first) for e in before))
    outline = max(longest_outline(e) for e in before)
    return rounded(len(polygon)), len(before), slots, min(slots, outline + outline % 2)


def _group(members: Sequence[_Receiver]) -> Group:
    return Group(*(np.stack(x, axis=-1) for x in zip(*map(_placed, members), strict=True)))


def _placed(one: _Receiver) -> tuple[Any, ...]:
    """A polygon and the edges before it in its frame, filled up with edges of no length."""
    size, _, slots, outline = one.size
    polygon, origin = one.polygon, one.polygon[0]
    vector = vector_area(polygon)
    area = np.linalg.norm(vector)
    normal = vector / area
    u = polygon[1] - origin
    u = u - normal * (u @ normal)
    u /= np.linalg.norm(u)
    frame = np.stack([u, np.cross(normal, u), normal])
    corners = (polygon - origin) @ frame[:2].T
    corners = np.concatenate([corners, np.repeat(corners[-1:], size - len(corners), axis=0)])
    made = []
    for e in one.before:
        more = slots - len(e.first)
        point = np.broadcast_to(e.first[0, 0], (more, 2, 3))
        ends = [(np.concatenate([x, point]) - origin) @ frame.T for x in (e.first, e.second)]
        never = np.broadcast_to(e.normal_a[0], (more, 3))  # on the outline: both faces are one
        turned = [np.concatenate([x, never]) @ frame.T for x in (e.normal_a, e.normal_b)]
        points = np.concatenate(ends).reshape(-1, 3)
        made.append((*ends, *turned, points.min(axis=0), points.max(axis=0)))
    *edges_before, low, high = (np.stack(x) for x in zip(*made, strict=True))
    order = np.arange(1, outline + 1)
    return one.index, frame, corners, area, *edges_before, order, low, high


def tests_per_epoch(groups: Sequence[Group]) -> int:
    """Edges tested against edges at one epoch, if all polygons are lit and may be in shadow."""
    return sum(len(g.index) * g.tests(2 * len(g.first)) for g in groups)


def _tests(corners: int, count: int, slots: int) -> int:
    shade = count * slots
    return (corners - 2) * shade + shade * (corners + shade - slots)
