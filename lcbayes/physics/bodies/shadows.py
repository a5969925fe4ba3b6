"""Shadows of convex solids on convex polygons: what of each polygon is both lit and seen, exactly.

The shadow of a convex solid on the plane of a polygon is a convex polygon, and so is what the solid
hides from the observer: its projection along the direction to the observer. Lit and seen is the
polygon P without the union of all of these, Q₁ … Q_J. Its area is a line integral (Green) over the
edges of all polygons:

    A = ½ Σ_e ± (a_e × b_e) ℓ_e

where a_e and b_e are the ends of edge e in the plane, + for the edges of P and − for those of the
Qs, and ℓ_e is the fraction of the edge that lies in P and in no Q (other than its own). A convex
polygon leaves one interval of an edge (Cyrus & Beck 1978, Comput. Graph. 3, 23), so ℓ is the length
of an interval without a union of intervals. Nothing branches: the shapes of all arrays are fixed,
and the result is exact to rounding (1e-8 of the polygon; see `NUDGE`).

The area is continuous in every direction and coordinate, and differentiable but where the outline
of a shadow lies along an edge; a sampler that follows gradients meets no jump. There, as at the
terminator of a facet, the derivative is that of one side. It is written out rather than left to
automatic differentiation: an outline that moves by v(t) along its edge e changes the area by

    dA = − Σ_e ∫ v × (b − a) dt,  t in the lit and seen part of the edge,

because the ends of that part are where v meets another edge, which has its own share of dA.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jax.custom_derivatives import SymbolicZero
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.intervals import (
    Ends,
    Points,
    in_polygons,
    in_rectangle,
    without_union,
)
from lcbayes.physics.bodies.solids import Edges, Solid, above, edges, entered, vector_area

Floats = NDArray[np.float64]

# Every shadow is larger than it is by a share that differs from one to the next, so that no two
# edges coincide, as those of shadows of one panel do where it stands on the polygon.
NUDGE = 1e-10
GRAZING = 1e-9  # a polygon whose cosine of incidence or of view is below this counts as dark
MOST_TESTS = 1 << 18  # of edges against edges at once, in arrays that remain in cache


class Group(NamedTuple):
    """Polygons that receive shadows, with equally many edges and equally many solids before them.

    Of two polygons with opposite normals, such as the sides of a panel or opposite faces of a box,
    one at most is lit: they are S = 2 sides of one receiver and cost as much as one. For others,
    S = 1.

    Attributes
    ----------
    index : (R, S) int
        Which polygon of the body each side is.
    frame : (R, S, 3, 3)
        Rows: two unit vectors in the polygon's plane and its normal, body frame.
    corners : (R, S, K, 2) m
        Vertices in the plane, counter-clockwise; the first is the origin, the second on the x axis.
    area : (R, S) m²
    first, second : (R, S, J, E, 2, 3) m
        Ends of the edges of each solid (`solids.Edges`): in the plane, and height above it.
    normal_a, normal_b : (R, S, J, E, 3)
        In the polygon's frame.
    rectangles : bool
        All polygons are rectangles.
    """

    index: NDArray[np.integer]
    frame: Floats
    corners: Floats
    area: Floats
    first: Floats
    second: Floats
    normal_a: Floats
    normal_b: Floats
    rectangles: bool


class _Receiver(NamedTuple):
    index: int
    polygon: Floats
    part: int
    before: list[Edges]


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
            receivers.append(_Receiver(i, polygon, int(part[i]), before))
            tests += _tests(*_size(receivers[-1]))
            if tests > 2 * most:  # opposite polygons count as one
                return None
    by_shape: dict[tuple[Any, ...], list[list[_Receiver]]] = {}
    for sides in _paired(receivers):
        by_shape.setdefault((_size(sides[0]), len(sides)), []).append(sides)
    groups = tuple(_group(key[0], members) for key, members in sorted(by_shape.items()))
    return groups if tests_per_epoch(groups) <= most else None


def _size(one: _Receiver) -> tuple[int, int, int, bool]:
    """Few sizes of groups: corners and edges of a solid are filled up to 4, 6, 8, 12, 16, 24, …"""

    def rounded(count: int) -> int:
        power = 1 << max(2, (count - 1).bit_length())
        return 3 * power // 4 if power > 4 and count <= 3 * power // 4 else power

    slots = max(len(e.first) for e in one.before)
    return rounded(len(one.polygon)), len(one.before), rounded(slots), _rectangle(one.polygon)


def _rectangle(polygon: Floats) -> bool:
    """Whether a polygon (k, 3) is one, to rounding."""
    if len(polygon) != 4:
        return False
    a, b = polygon[1] - polygon[0], polygon[3] - polygon[0]
    tolerance = 1e-12 * max(np.linalg.norm(a), np.linalg.norm(b))
    closes = np.abs(polygon[2] - polygon[0] - a - b).max() < tolerance
    return bool(closes and abs(a @ b) < tolerance**2 * 1e12)


def _paired(receivers: list[_Receiver]) -> list[list[_Receiver]]:
    """Two and two with opposite normals, where their groups are of one size."""
    pairs: list[list[_Receiver]] = []
    alone: dict[tuple[Any, ...], list[list[_Receiver]]] = {}
    for one in receivers:
        vector = vector_area(one.polygon)
        normal = np.round(vector / np.linalg.norm(vector), 12) + 0.0
        waiting = alone.get((_size(one), *(0.0 - normal).tolist()))
        if waiting:
            waiting.pop().append(one)
        else:
            pairs.append([one])
            alone.setdefault((_size(one), *normal.tolist()), []).append(pairs[-1])
    return pairs


def _group(size: tuple[int, int, int, bool], members: list[list[_Receiver]]) -> Group:
    corners, _, slots, rectangles = size
    rows = [[_placed(one, corners, slots) for one in sides] for sides in members]
    arrays = [np.array([[side[k] for side in sides] for sides in rows]) for k in range(8)]
    return Group._make([*arrays, rectangles])


def _placed(one: _Receiver, size: int, slots: int) -> tuple[Any, ...]:
    """A polygon and the edges before it in its frame, filled up with edges of no length."""
    polygon, origin = one.polygon, one.polygon[0]
    vector = vector_area(polygon)
    area = float(np.linalg.norm(vector))
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
        turned = [
            np.concatenate([x, np.broadcast_to(x[0], (more, 3))]) @ frame.T
            for x in (e.normal_a, e.normal_b)
        ]
        made.append((*ends, *turned))
    return one.index, frame, corners, area, *(np.stack(x) for x in zip(*made, strict=True))


def tests_per_epoch(groups: Sequence[Group]) -> int:
    """Edges tested against edges at one epoch: what `lit_and_seen` costs."""
    total = 0
    for g in groups:
        corners, (solids, slots) = g.corners.shape[2], g.first.shape[2:4]
        total += len(g.index) * _tests(corners, solids, slots, g.rectangles)
    return total


def _tests(corners: int, solids: int, slots: int, rectangle: bool) -> int:
    shade = 2 * solids * slots
    around = 2 if rectangle else corners
    return (corners - 2) * shade + shade * (around + shade - slots)


def lit_and_seen(
    groups: Sequence[Group], count: int, sun_body: jax.Array, obs_body: jax.Array
) -> jax.Array:
    """Fraction of each polygon's area that no solid shades and none hides, (T, N).

    Parameters
    ----------
    groups : as `shadows` gives them
    count : int
        N, the number of polygons of the body.
    sun_body, obs_body : (T, 3)
        Unit vectors to Sun and observer, body frame.

    Returns
    -------
    (T, N)
        In [0, 1]; 1 for a polygon that is turned away from the Sun or the observer, as its flux is
        zero by its cosines. Error below 1e-8.

    Examples
    --------
    A wall of the same size on one side of a square; the Sun 45° above the horizon throws its
    shadow over all of the square:

    >>> import numpy as np
    >>> from lcbayes.physics.bodies.solids import flat_solid
    >>> square = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    >>> wall = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], float)
    >>> groups = shadows([square], [0], [flat_solid(wall)], [1]) or ()
    >>> sun = jnp.array([[-1.0, 0, 1.0], [-1.0, 0, 2.0], [1.0, 0, 1.0]])
    >>> sun = sun / jnp.linalg.norm(sun, axis=1, keepdims=True)
    >>> above = jnp.array([[0.0, 0.0, 1.0]] * 3)
    >>> lit_and_seen(groups, 1, sun, above)[:, 0].round(6).tolist()
    [0.0, 0.5, 1.0]
    """
    fraction = jnp.ones((count, sun_body.shape[0]))
    for group in groups:
        fractions = _in_blocks(group, sun_body, obs_body)
        fraction = fraction.at[group.index.T].set(fractions)
    return fraction.T


def _in_blocks(group: Group, sun: jax.Array, obs: jax.Array) -> jax.Array:
    """(S, R, T), in blocks of epochs where the arrays would be large."""
    epochs = sun.shape[0]
    block = max(1, MOST_TESTS // tests_per_epoch([group]))
    if epochs <= block:
        return _fraction(group, sun, obs)
    blocks = -(-epochs // block)
    padded = [jnp.pad(x, ((0, blocks * block - epochs), (0, 0)), mode="edge") for x in (sun, obs)]
    cut = tuple(x.reshape(blocks, block, 3) for x in padded)
    fractions = jax.lax.map(lambda both: _fraction(group, *both), cut)
    return jnp.moveaxis(fractions, 0, 2).reshape(*group.index.T.shape, -1)[..., :epochs]


def _fraction(group: Group, sun: jax.Array, obs: jax.Array) -> jax.Array:
    """(S, R, T)"""
    sides = group.index.shape[1]
    front = jnp.einsum("rj,tj->rt", group.frame[:, 0, 2], sun) > 0.0

    def side(x: Floats) -> jax.Array:
        """Of the side that is lit, with an axis of epochs at the end."""
        if sides == 1:
            return jnp.asarray(x[:, 0, ..., None])
        chosen = jnp.expand_dims(front, tuple(range(1, x.ndim - 1)))
        return jnp.where(chosen, x[:, 0, ..., None], x[:, 1, ..., None])

    frame = side(group.frame)
    both = [jnp.sum(frame * d.T[None, None], axis=2) for d in (sun, obs)]  # (R, 3, T)
    facing = (both[0][:, 2] > GRAZING) & (both[1][:, 2] > GRAZING)
    both = [jnp.where(facing[:, None], d, np.array([0.0, 0.0, 1.0])[:, None]) for d in both]
    ends, normals = ([side(x) for x in two] for two in (group[4:6], group[6:8]))
    outlines = _nudged(*_outlines(*ends, *normals, directions=both))
    corners = side(group.corners)
    area = _area(group.rectangles, (corners[:, :, 0], corners[:, :, 1]), outlines)
    fraction = jnp.clip(area / side(group.area), 0.0, 1.0)
    lit = [facing & (front if k == 0 else ~front) for k in range(sides)]
    return jnp.where(jnp.stack(lit), fraction, 1.0)


def _outlines(first, second, normal_a, normal_b, directions: Sequence[jax.Array]) -> Ends:
    """Edges of the shadows in the plane, counter-clockwise seen from outside.

    A point at height h above the plane falls on (x, y) − h (d_x, d_y)/d_z.

    Returns
    -------
    Ends
        Arrays (R, 2J, E, T): the solids along the first direction, then along the second.
    """
    edges = []
    for d in directions:
        toward = d[:, None, None]
        facing = [jnp.sum(n * toward, axis=3) > 0.0 for n in (normal_a, normal_b)]
        x, y, h = (
            jnp.where((facing[0] != facing[1])[:, :, :, None], first[..., i, :], second[..., i, :])
            for i in range(3)
        )
        d = d[:, :, None, None, None, :]
        fallen = (x - h * (d[:, 0] / d[:, 2]), y - h * (d[:, 1] / d[:, 2]))
        start = tuple(jnp.where(facing[0], p[..., 0, :], p[..., 1, :]) for p in fallen)
        end = tuple(jnp.where(facing[0], p[..., 1, :], p[..., 0, :]) for p in fallen)
        edges.append((*start, *end))
    ax, ay, bx, by = (jnp.concatenate(x, axis=1) for x in zip(*edges, strict=True))
    return (ax, ay), (bx, by)


def _nudged(start: Points, end: Points) -> Ends:
    """Outlines enlarged about a point inside, each by a share of its own."""
    share = NUDGE * (1.0 + jnp.arange(start[0].shape[1]))[None, :, None, None]
    middle = [0.5 * jnp.mean(a + b, axis=2, keepdims=True) for a, b in zip(start, end, strict=True)]
    ax, ay, bx, by = (
        x + share * (x - m) for x, m in zip((*start, *end), (*middle, *middle), strict=True)
    )
    return (ax, ay), (bx, by)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _area(rectangles: bool, corners: Points, outlines: Ends) -> jax.Array:
    """Area of polygons without the union of outlines, (R, T)."""
    return _area_and_parts(rectangles, corners, outlines)[0]


@partial(_area.defjvp, symbolic_zeros=True)
def _area_jvp(rectangles, primals, tangents):
    corners, outlines = primals
    d_corners, d_outlines = tangents
    if not all(isinstance(d, SymbolicZero) for d in d_corners):
        raise NotImplementedError("no derivative by the corners of a polygon")
    area, (length, moment) = _area_and_parts(rectangles, corners, outlines)
    (ax, ay), (bx, by) = outlines
    zero = jnp.zeros_like(ax)
    (vax, vay), (vbx, vby) = (
        [zero if isinstance(v, SymbolicZero) else v for v in points] for points in d_outlines
    )
    # each edge sweeps ∫ v × (b − a) dt, v = (1 − t) v_a + t v_b
    rest = length - moment
    vx, vy = rest * vax + moment * vbx, rest * vay + moment * vby
    return area, -jnp.sum(vx * (by - ay) - vy * (bx - ax), axis=(1, 2))


def _area_and_parts(
    rectangles: bool, corners: Points, outlines: Ends
) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    """Area, and ∫dt and ∫t dt of the part of each outline's edge where it bounds the area.

    Edges of the polygon count as they lie in no outline; the first and the last meet the origin and
    have no moment about it. Those of an outline count as they lie in the polygon and in no other
    outline.
    """
    start, end = outlines
    count, (x, y) = start[0].shape[1], corners
    other = np.array([[k for k in range(count) if k != j] for j in range(count)])
    whole = slice(None)
    sides = (x[:, 1:-1], y[:, 1:-1]), (x[:, 2:], y[:, 2:])
    # an outline without edges is that of a panel seen edge-on, which hides nothing
    there = jnp.any((start[0] != end[0]) | (start[1] != end[1]), axis=2)
    into, out = in_polygons(_at(sides, (whole, None)), _at(outlines, (whole, None)))
    of_sides, _ = without_union(into, jnp.where(there[:, None, None], out, -1.0))
    if rectangles:
        low, high = in_rectangle(outlines, (x[:, None, None, 2], y[:, None, None, 2]))
    else:
        around = corners, (jnp.roll(x, -1, axis=1), jnp.roll(y, -1, axis=1))
        low, high = in_polygons(outlines, _at(around, (whole, None, None)))
        low, high = low[:, :, :, 0], high[:, :, :, 0]
    into, out = in_polygons(outlines, _at(outlines, (whole, other)))
    parts = without_union(into, jnp.where(there[:, other][:, :, None], out, -1.0), low, high)
    area = jnp.sum(_cross(*sides) * of_sides[:, 0], axis=1)
    area = 0.5 * (area - jnp.sum(_cross(start, end) * parts[0], axis=(1, 2)))
    return area, parts


def _at(ends: Ends, where: Any) -> Ends:
    return tuple(tuple(x[where] for x in points) for points in ends)  # pyright: ignore[reportReturnType]


def _cross(a: Points, b: Points) -> jax.Array:
    return a[0] * b[1] - a[1] * b[0]
