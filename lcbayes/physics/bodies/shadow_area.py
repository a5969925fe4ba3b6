"""What of each convex polygon is both lit and seen, exactly.

The shadow of a convex solid on the plane of a polygon is a convex polygon, and so is what the solid
hides from the observer: its projection along the direction to the observer. Lit and seen is the
polygon P without the union of all of these, Q₁ … Q_J. Its area is a line integral (Green) over the
edges of all polygons:

    A = ½ Σ_e ± (a_e × b_e) ℓ_e

where a_e and b_e are the ends of edge e in the plane, + for the edges of P and − for those of the
Qs, and ℓ_e is the fraction of the edge that lies in P and in no Q (other than its own). A convex
polygon leaves one interval of an edge (Cyrus & Beck 1978, Comput. Graph. 3, 23), so ℓ is the length
of an interval without a union of intervals. The result is exact to rounding (1e-8 of the
polygon; see `NUDGE`).

Only pairs of a polygon and an epoch are computed in which the polygon may be in shadow: it faces
the Sun and the observer, and the shadow of the box about a solid may meet it. If at most two
shadows may, the others are left out. How many pairs there are of each kind differs, so that they
are taken from a list, some at a time.

The area is continuous in every direction and coordinate, and differentiable but where the outline
of a shadow lies along an edge; a sampler that follows gradients meets no jump. There, as at the
terminator of a facet, the derivative is that of one side. It is written out rather than left to
automatic differentiation: an outline that moves by v(t) along its edge e changes the area by

    dA = − Σ_e ∫ v × (b − a) dt,  t in the lit and seen part of the edge,

because the ends of that part are where v meets another edge, which has its own share of dA.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from jax.custom_batching import custom_vmap
from jax.custom_derivatives import SymbolicZero

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.intervals import Ends, Points, in_polygons, without_union
from lcbayes.physics.bodies.lit import Lit, Slopes
from lcbayes.physics.bodies.shadows import Group

# Every shadow is larger than it is by a share that differs from one to the next, so that no two
# edges coincide, as those of shadows of one panel do where it stands on the polygon.
NUDGE = 1e-10
GRAZING = 1e-9  # a polygon whose cosine of incidence or of view is below this counts as dark
MOST_TESTS = 1 << 14  # of edges against edges at once, in arrays that remain in cache ...
FEW = 2  # shadows of a pair, of which most have no more, for which there is a program of its own
FEWEST, MOST = 16, 512  # ... but for at least and at most so many pairs of a polygon and an epoch


def lit_and_seen(
    groups: Sequence[Group], count: int, sun_body: jax.Array, obs_body: jax.Array
) -> jax.Array:
    """Fraction of each polygon's area that no solid shades and none hides, (T, N).

    Parameters
    ----------
    groups : as `shadows.shadows` gives them
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
    >>> from lcbayes.physics.bodies.shadows import shadows
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
    fraction = jnp.ones((sun_body.shape[0], count))
    for group in groups:
        fraction = fraction.at[:, group.index].set(_fractions(group)(sun_body, obs_body))
    return fraction


def about(
    groups: Sequence[Group],
    count: int,
    sun_body: jax.Array,
    obs_body: jax.Array,
    *,
    slopes: bool = True,
) -> Lit:
    """`lit_and_seen` about the directions, to first order or fixed."""
    if not slopes:
        return Lit(lit_and_seen(groups, count, sun_body, obs_body))
    shape = len(sun_body), count
    fraction, by_sun, by_obs = jnp.ones(shape), jnp.zeros((*shape, 3)), jnp.zeros((*shape, 3))
    for group in groups:
        own = _computed(True, group, sun_body, obs_body)
        fraction, by_sun, by_obs = (
            x.at[:, group.index].set(y)
            for x, y in zip((fraction, by_sun, by_obs), own, strict=True)
        )
    return Lit(fraction, slopes=Slopes(by_sun, by_obs, sun_body, obs_body))


def _fractions(group: Group) -> Callable[[jax.Array, jax.Array], jax.Array]:
    """Directions (T, 3) to Sun and observer → fractions (T, R).

    The derivatives by the directions of an epoch are computed together with the fraction, because
    no derivative leads back through a list whose length is not known.
    """

    @jax.custom_jvp
    def fractions(sun: jax.Array, obs: jax.Array) -> jax.Array:
        return _batched(partial(_computed, False, group))(sun, obs)[0]

    @fractions.defjvp
    def push(primals, tangents):
        fraction, by_sun, by_obs = _batched(partial(_computed, True, group))(*primals)
        d_sun, d_obs = tangents
        change = jnp.einsum("trj,tj->tr", by_sun, d_sun) + jnp.einsum("trj,tj->tr", by_obs, d_obs)
        return fraction, change

    return fractions


def _batched(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of (T, 3) and (T, 3), of which a batch of arguments is as many more epochs."""
    batched = custom_vmap(function)

    @batched.def_vmap
    def flattened(size: int, is_batched, *directions):
        every = [
            x if b else jnp.broadcast_to(x, (size, *x.shape))
            for x, b in zip(directions, is_batched, strict=True)
        ]
        out = batched(*(x.reshape(-1, 3) for x in every))
        split = jax.tree.map(lambda x: x.reshape(size, -1, *x.shape[1:]), out)
        return split, jax.tree.map(lambda _: True, out)

    return batched


@partial(jax.jit, static_argnums=0)
def _computed(slopes: bool, group: Group, sun: jax.Array, obs: jax.Array) -> tuple[jax.Array, ...]:
    """Fractions (T, R), and with `slopes` their derivatives by the directions, (T, R, 3) each."""
    epochs, total = len(sun), len(sun) * len(group.index)
    over = _over(group, sun, obs).reshape(-1, total)
    number = jnp.sum(over, axis=0)
    order = jnp.argsort(number)
    # the solids of all polygons along one axis
    flat = [jnp.moveaxis(jnp.asarray(x), 0, -2) for x in _edges(group)]
    flat = [x.reshape(*x.shape[:-2], -1) for x in flat]
    out = jnp.ones(total), *([jnp.zeros((total, 3))] * (2 if slopes else 0))

    def with_shadows(fewer: int, most: int, out: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        """Fill in the pairs with more than ``fewer`` shadows and at most ``most``."""
        at_once = min(total, max(FEWEST, min(MOST, MOST_TESTS // group.tests(most))))
        begin, end = (jnp.sum(number <= n) for n in (fewer, most))

        def some(k: jax.Array, out: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
            place = begin + k * at_once + jnp.arange(at_once)
            pair = jnp.where(place < end, order.at[place].get(mode="clip"), total)
            epoch, which = pair % epochs, jnp.minimum(pair // epochs, len(group.index) - 1)
            there = jnp.take(over, pair, axis=1, mode="clip")
            chosen = _chosen(there, most) if most < len(over) else None
            fraction = partial(_fraction, group, flat, which, chosen)
            if slopes:
                value, back = jax.vjp(fraction, sun[epoch], obs[epoch])
                found = value, *back(jnp.ones_like(value))
            else:
                found = (fraction(sun[epoch], obs[epoch]),)
            return tuple(x.at[pair].set(y, mode="drop") for x, y in zip(out, found, strict=True))

        return jax.lax.fori_loop(0, -(-(end - begin) // at_once), some, out)

    for fewer, most in pairwise([0, *sorted({FEW, len(over)})]):
        out = with_shadows(fewer, most, out)
    return tuple(jnp.moveaxis(x.reshape(-1, epochs, *x.shape[1:]), 0, 1) for x in out)


def _edges(group: Group) -> list[Any]:
    """Ends and normals of the edges of all solids, (J, E, …, R)."""
    return [group.first, group.second, group.normal_a, group.normal_b]


def _over(group: Group, sun: jax.Array, obs: jax.Array) -> jax.Array:
    """Whether each shadow may lie over a polygon that faces Sun and observer, (2J, R, T).

    Those along the direction to the Sun come first. A shadow may where the rectangle about that of
    the box about the solid meets the rectangle about the polygon, all along the axes of its frame.
    """
    facing = jnp.ones((len(group.index), len(sun)), bool)
    low, high = (x[..., None] for x in (group.corners.min(axis=0), group.corners.max(axis=0)))
    near = []
    for direction in (sun, obs):
        d = jnp.einsum("ijr,tj->irt", group.frame, direction)
        facing &= d[2] > GRAZING
        slope = d[:2] / jnp.maximum(d[2], GRAZING)
        moved = [h[:, None, :, None] * slope for h in (group.low[:, 2], group.high[:, 2])]
        left = group.low[:, :2, :, None] - jnp.maximum(*moved)
        right = group.high[:, :2, :, None] - jnp.minimum(*moved)
        nudged = NUDGE * (1 + 2 * len(left)) * (right - left)
        near.append(jnp.all((right + nudged >= low) & (left - nudged <= high), axis=1))
    return facing & jnp.concatenate(near)


def _chosen(over: jax.Array, count: int) -> jax.Array:
    """Which of the shadows (2J, P) are over polygons, (count, P); 2J where there are fewer."""
    rank = jnp.cumsum(over, axis=0)
    return jnp.sum(rank[None] <= jnp.arange(count)[:, None, None], axis=1)


def _fraction(
    group: Group,
    flat: Sequence[jax.Array],
    which: jax.Array,
    chosen: jax.Array | None,
    sun: jax.Array,
    obs: jax.Array,
) -> jax.Array:
    """Of polygons ``which`` (P,) of a group, one for each epoch, which face both, with all shadows
    or those of `_chosen`."""
    frame, corners, area = (
        jnp.take(x, which, axis=-1) for x in (group.frame, group.corners, group.area)
    )
    both = [jnp.sum(frame * d.T, axis=1)[:, None] for d in (sun, obs)]  # (3, 1, P)
    count, order = len(group.first), jnp.asarray(group.order[:, :1])
    if chosen is None:
        number = jnp.arange(2 * count)[:, None]
        solids = [jnp.take(x, which, axis=-1) for x in _edges(group)]
        parts = zip(*(_outlines(solids, d, order) for d in both), strict=True)
        ax, ay, bx, by = (jnp.concatenate(x) for x in parts)
    else:
        number = chosen
        index = number % count * len(group.index) + which
        solids = [jnp.moveaxis(jnp.take(x, index, axis=-1), -2, 0) for x in flat]
        d = jnp.where(number < count, both[0], both[1])
        ax, ay, bx, by = _outlines(solids, d, order)
        there = (number < 2 * count)[:, None]  # the others have no edges
        bx, by = jnp.where(there, bx, ax), jnp.where(there, by, ay)
    outlines = _nudged((ax, ay), (bx, by), number)
    return jnp.clip(_area((corners[:, 0], corners[:, 1]), outlines) / area, 0.0, 1.0)


def _outlines(solids: Sequence[jax.Array], d: jax.Array, order: jax.Array) -> tuple[jax.Array, ...]:
    """Edges of shadows in the plane along d (3, n or 1, P), counter-clockwise seen from outside.

    A point at height h above the plane falls on (x, y) − h (d_x, d_y)/d_z. The edges of the solids
    are those of `_edges`, (n, E, …, P); ``order`` (S, 1) is that of the group.

    Returns
    -------
    a_x, a_y, b_x, b_y : (n, S, P)
        Ends of the edges.
    """
    first, second, *turned = solids
    d = d.swapaxes(0, 1)[:, None]
    facing = [jnp.sum(n * d, axis=2) > 0.0 for n in turned]  # (n, E, P)
    outer = facing[0] != facing[1]
    always = jnp.any(second[:, :, 0] != second[:, :, 1], axis=2)
    points = jnp.where(outer[:, :, None, None], first, second)
    x, y, h = (points[:, :, :, i] for i in range(3))
    slope = d[:, :, :2] / d[:, :, 2:]
    fallen = x - h * slope[:, :, :1], y - h * slope[:, :, 1:]
    start, end = (
        tuple(jnp.where(facing[0], p[:, :, one], p[:, :, other]) for p in fallen)
        for one, other in ((0, 1), (1, 0))
    )
    return _of_outline((*start, *end), outer | always, order)


def _of_outline(
    ends: tuple[jax.Array, ...], outer: jax.Array, order: jax.Array
) -> tuple[jax.Array, ...]:
    """The edges (J, E, P) that are on an outline, as (J, S, P), with edges of no length after."""
    if outer.shape[1] == len(order):
        return ends
    rank = jnp.cumsum(outer, axis=1)
    at = jnp.sum(rank[:, None] < order[None, :, None], axis=2)
    *start, x, y = (jnp.take_along_axis(z, at, axis=1, mode="clip") for z in ends)
    there = at < outer.shape[1]
    return *start, *(jnp.where(there, z, s) for z, s in zip((x, y), start, strict=True))


def _nudged(start: Points, end: Points, number: jax.Array) -> Ends:
    """Outlines enlarged about a point inside, each by a share by its number (n, P)."""
    share = NUDGE * (1.0 + number)[:, None]
    middle = [0.5 * jnp.mean(a + b, axis=1, keepdims=True) for a, b in zip(start, end, strict=True)]
    ax, ay, bx, by = (
        x + share * (x - m) for x, m in zip((*start, *end), (*middle, *middle), strict=True)
    )
    return (ax, ay), (bx, by)


@jax.custom_jvp
def _area(corners: Points, outlines: Ends) -> jax.Array:
    """Area of polygons without the union of outlines, (P,)."""
    return _area_and_parts(corners, outlines)[0]


@partial(_area.defjvp, symbolic_zeros=True)
def _area_jvp(primals, tangents):
    corners, outlines = primals
    d_corners, d_outlines = tangents
    if not all(isinstance(d, SymbolicZero) for d in d_corners):
        raise NotImplementedError("no derivative by the corners of a polygon")
    area, (length, moment) = _area_and_parts(corners, outlines)
    (ax, ay), (bx, by) = outlines
    zero = jnp.zeros_like(ax)
    (vax, vay), (vbx, vby) = (
        [zero if isinstance(v, SymbolicZero) else v for v in points] for points in d_outlines
    )
    # each edge sweeps ∫ v × (b − a) dt, v = (1 − t) v_a + t v_b
    rest = length - moment
    vx, vy = rest * vax + moment * vbx, rest * vay + moment * vby
    return area, -jnp.sum(vx * (by - ay) - vy * (bx - ax), axis=(0, 1))


@jax.jit  # traced once, not in each program
def _area_and_parts(
    corners: Points, outlines: Ends
) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
    """Area, and ∫dt and ∫t dt of the part of each outline's edge where it bounds the area.

    Edges of the polygon count as they lie in no outline; the first and the last meet the origin and
    have no moment about it. Those of an outline count as they lie in the polygon and in no other
    outline.
    """
    start, end = outlines
    count, (x, y) = len(start[0]), corners
    other = np.array([[k for k in range(count) if k != j] for j in range(count)], int)
    sides = (x[1:-1], y[1:-1]), (x[2:], y[2:])
    # an outline without edges is that of a panel seen edge-on, which hides nothing
    there = jnp.any((start[0] != end[0]) | (start[1] != end[1]), axis=1)
    into, out = in_polygons(_at(sides, None), _at(outlines, None))
    of_sides, _ = without_union(into, jnp.where(there, out, -1.0))
    around = corners, (jnp.roll(x, -1, axis=0), jnp.roll(y, -1, axis=0))
    low, high = in_polygons(outlines, _at(around, (None, None)))
    low, high = low[:, :, 0], high[:, :, 0]
    into, out = in_polygons(outlines, _at(outlines, other))
    parts = without_union(into, jnp.where(there[other][:, None], out, -1.0), low, high)
    area = jnp.sum(_cross(*sides) * of_sides[0], axis=0)
    area = 0.5 * (area - jnp.sum(_cross(start, end) * parts[0], axis=(0, 1)))
    return area, parts


def _at(ends: Ends, where: Any) -> Ends:
    return tuple(tuple(x[where] for x in points) for points in ends)  # pyright: ignore[reportReturnType]


def _cross(a: Points, b: Points) -> jax.Array:
    return a[0] * b[1] - a[1] * b[0]
