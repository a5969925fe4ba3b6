"""Shadows of convex primitives on small cells of a surface, with gradients.

What a convex primitive hides along a direction is its silhouette, whose outline consists of lines
and arcs of ellipses, all known in closed form. A cell is a small parallelogram on a surface.
The share of it that lies beyond one line of the outline is a piecewise quadratic function of the
distance (a box filter), which is exact for flat cells and straight lines. Three approximations
remain, each in the cells on an outline only: arcs are replaced by their tangents, the shares of
several lines are multiplied, and so are those of Sun and observer and of several primitives. With n
cells along each edge of a face the first two errors fall like 1/n² and the last one like 1/n where
the shadow and what is hidden from the observer have nearly the same outline, at small phase angles.

The share is continuously differentiable in directions, sizes and positions, also while an outline
crosses a cell; its derivative is that of the light that the moving outline covers.

Of two convex parts that do not intersect, one hides the other or not by which side of a plane
between them the direction points to; no distances along a ray are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.quadrature import length

NARROW = 1e-2  # smallest share of a cell's extent across a line in its two edges
NUDGE = 1e-9  # m: a line at that distance is not crossed
STEEP = 1e-5  # a cosine below it is replaced by it


class Solid(NamedTuple):
    """A primitive's sizes, in the order of `primitive_flux.KINDS`, and place in the body."""

    sizes: tuple[jax.Array, ...]
    rotation: jax.Array
    position: jax.Array


@partial(jax.tree_util.register_dataclass, data_fields=("own", "others"), meta_fields=("kinds",))
@dataclass(frozen=True)
class Blockers:
    """A part and the others, which may shade it.

    Attributes
    ----------
    kinds : tuple of str
        Of the part, then of the others.
    own : Solid
    others : tuple of Solid
    """

    kinds: tuple[str, ...]
    own: Solid
    others: tuple[Solid, ...]


class Shade(NamedTuple):
    """What may shade a part, and the number of cells along each edge of its faces."""

    blockers: Blockers
    count: int


class Cells(NamedTuple):
    """Cells on a part in its own axes: centres and two edges, (T or 1, K, 3) m."""

    centre: jax.Array
    first: jax.Array
    second: jax.Array


def lit_and_seen(blockers: Blockers, cells: Cells, sun: jax.Array, obs: jax.Array) -> jax.Array:
    """Share of each cell that no other part shades and none hides, (T, K).

    Parameters
    ----------
    blockers : Blockers
    cells : Cells
    sun, obs : (T, 3)
        Unit vectors, axes of the part.
    """
    own, fraction = blockers.own, jnp.ones(())
    for kind, other in zip(blockers.kinds[1:], blockers.others, strict=True):
        turn = own.rotation.T @ other.rotation
        offset = (own.position - other.position) @ other.rotation
        moved = Cells(cells.centre @ turn + offset, cells.first @ turn, cells.second @ turn)
        between = _between((blockers.kinds[0], own), (kind, other))
        for direction in (sun, obs):
            ahead = (direction @ own.rotation.T) @ between > 0.0
            hidden = _hidden(kind, other.sizes, moved, direction @ turn)
            fraction = fraction * (1.0 - jnp.where(ahead[:, None], hidden, 0.0))
    return jnp.broadcast_to(fraction, (sun.shape[0], cells.centre.shape[1]))


def _between(part: tuple[str, Solid], other: tuple[str, Solid]) -> jax.Array:
    """The direction, of the axes of both and the line between their positions, in which the other
    lies farthest beyond the part, (3,)."""
    offset = other[1].position - part[1].position
    axes = jnp.concatenate([part[1].rotation.T, other[1].rotation.T, offset[None]])
    axes = axes / length(axes)[:, None]
    axes = jax.lax.stop_gradient(jnp.concatenate([axes, -axes]))

    def extent(one: tuple[str, Solid], sign: float) -> jax.Array:
        return jax.vmap(partial(_support, one[0], one[1].sizes))(sign * axes @ one[1].rotation)

    return axes[jnp.argmax(axes @ offset - extent(part, 1.0) - extent(other, -1.0))]


def _support(kind: str, sizes: Sequence[jax.Array], m: jax.Array) -> jax.Array:
    """Largest m·x of a primitive, axes of its own."""
    if kind in ("box", "plate"):
        return jnp.sum(jnp.abs(m) * _half_sides(kind, sizes))
    if kind in ("sphere", "ellipsoid"):
        return length(m * _semi_axes(kind, sizes))
    low, high, radius, top = discs(kind, sizes)
    across = length(m[:2])
    return jnp.maximum(low * m[2] + radius * across, high * m[2] + top * across)


def _half_sides(kind: str, sizes: Sequence[jax.Array]) -> jax.Array:
    return 0.5 * jnp.stack([*sizes, *([jnp.zeros(())] if kind == "plate" else [])])


def _semi_axes(kind: str, sizes: Sequence[jax.Array]) -> jax.Array:
    return jnp.stack([*sizes] * 3 if kind == "sphere" else [*sizes])


def discs(kind: str, sizes: Sequence[jax.Array]) -> tuple[jax.Array, ...]:
    """Heights and radii of the two discs whose convex hull a part is: low, high, radius, top."""
    zero = jnp.zeros(())
    match kind:
        case "disc":
            return zero, zero, sizes[0], sizes[0]
        case "cylinder":
            return -0.5 * sizes[1], 0.5 * sizes[1], sizes[0], sizes[0]
        case "cone":
            return zero, sizes[1], sizes[0], zero
    return zero, sizes[2], sizes[0], sizes[1]


def _hidden(kind: str, sizes: Sequence[jax.Array], cells: Cells, d: jax.Array) -> jax.Array:
    """Share of each cell behind the silhouette of a primitive along d (T, 3), its own axes."""
    if kind in ("box", "plate"):
        return _behind_box(_half_sides(kind, sizes), kind == "plate", cells, d)
    if kind in ("sphere", "ellipsoid"):
        return _behind_ellipsoid(_semi_axes(kind, sizes), cells, d)
    return _behind_discs(discs(kind, sizes), cells, d)


def _share(level: jax.Array, cells: Cells, slope: jax.Array) -> jax.Array:
    """Share of cells on the negative side of a line, from the level at the centre and its gradient.

    The level is trapezoidally distributed over a cell; p and q are its half-ranges along the edges.
    """
    p, q = (0.5 * jnp.abs(jnp.sum(edge * slope, axis=-1)) for edge in (cells.first, cells.second))
    least = NARROW * jnp.maximum(p, q) + 1e-3 * NUDGE
    p, q, s = jnp.maximum(p, least), jnp.maximum(q, least), NUDGE - level
    total = sum(
        sign * jnp.square(jnp.maximum(s + x, 0.0))
        for sign, x in ((1.0, p + q), (-1.0, p - q), (-1.0, q - p), (1.0, -p - q))
    )
    inside = total / (8.0 * p * q)
    return jnp.where(s >= p + q, 1.0, jnp.clip(inside, 0.0, 1.0))


def _within(level: jax.Array, limit: jax.Array, cells: Cells, slope: jax.Array) -> jax.Array:
    """Share of cells between two parallel lines, |level| < limit."""
    fraction = _share(level - limit, cells, slope) + _share(-level - limit, cells, slope) - 1.0
    return jnp.maximum(fraction, 0.0)


def _behind_box(half: jax.Array, flat: bool, cells: Cells, d: jax.Array) -> jax.Array:
    """A hexagon: |d × x| < |d| × h in each of the three components."""
    fraction = jnp.ones(())
    size = jnp.abs(d)
    for k in (0, 1) if flat else (0, 1, 2):
        i, j = (k + 1) % 3, (k + 2) % 3
        slope = jnp.zeros((d.shape[0], 1, 3))
        slope = slope.at[:, 0, i].set(-d[:, j]).at[:, 0, j].set(d[:, i])
        level = jnp.sum(cells.centre * slope, axis=-1)
        limit = half[i] * size[:, j] + half[j] * size[:, i]
        fraction = fraction * _within(level, limit[:, None], cells, slope)
    return fraction


def _behind_ellipsoid(scale: jax.Array, cells: Cells, d: jax.Array) -> jax.Array:
    """|D⁻¹x − e (e·D⁻¹x)| < 1 with e along D⁻¹d.

    The mean of that length over a cell exceeds its value at the centre as the outline is curved.
    """
    e = d / scale
    e = (e / length(e)[:, None])[:, None]

    def across(x: jax.Array) -> jax.Array:
        y = x / scale
        return y - e * jnp.sum(e * y, axis=-1, keepdims=True)

    y = across(cells.centre)
    radius = length(y)
    outward = y / radius[..., None]
    along = [
        jnp.sum(jnp.square(step), axis=-1) - jnp.square(jnp.sum(step * outward, axis=-1))
        for step in (across(cells.first), across(cells.second))
    ]
    excess = (along[0] + along[1]) / (24.0 * jnp.maximum(radius, 0.5))
    return _share(radius + excess - 1.0, cells, outward / scale)


def _behind_discs(ends: tuple[jax.Array, ...], cells: Cells, d: jax.Array) -> jax.Array:
    """The convex hull of two discs is the union of those between them, at heights s. With X across
    the axis and Y along its image,

    ±Y ≤ max_s [±sσ + κ√(r(s)² − X²)],  σ = |d_⊥|, κ = |d_z|.

    The maximum is at an end, or where r/√(r² − X²) = σ/(κ |dr/ds|): on the straight line that
    touches both ellipses.
    """
    low, high, radius, top = ends
    across = length(d[:, :2])
    on_axis = (across < STEEP)[:, None]
    u = jnp.where(on_axis, jnp.array([1.0, 0.0]), d[:, :2] / across[:, None])
    zero = jnp.zeros(d.shape[0])
    e_x = jnp.stack([u[:, 1], -u[:, 0], zero], axis=1)[:, None]
    e_y = jnp.stack([-d[:, 2] * u[:, 0], -d[:, 2] * u[:, 1], across], axis=1)[:, None]
    x, y = (jnp.sum(cells.centre * e, axis=-1) for e in (e_x, e_y))
    sigma, kappa = across[:, None], jnp.maximum(jnp.abs(d[:, 2]), STEEP)[:, None]
    taper = (top - radius) / jnp.maximum(high - low, NUDGE)
    widest = jnp.maximum(radius, top)
    tau = jnp.square(sigma / (kappa * jnp.maximum(jnp.abs(taper), STEEP)))
    apart = tau > 1.0 + NUDGE  # else one ellipse lies in the other
    ratio = jnp.sqrt(jnp.where(apart, tau, 2.0) / (jnp.where(apart, tau, 2.0) - 1.0))
    touching = jnp.where(apart, jnp.abs(x) * ratio, widest)  # radius of that disc
    between = low + (touching - radius) / jnp.where(taper == 0.0, 1.0, taper)
    between = jnp.clip(between, low, high)
    fraction = _within(x, widest, cells, e_x)
    wide = [jnp.abs(jnp.sum(edge * e_x, axis=-1)) for edge in (cells.first, cells.second)]
    reach = 0.5 * (wide[0] + wide[1])
    for sign, narrows in ((1.0, taper < 0.0), (-1.0, taper > 0.0)):
        s = jnp.where(narrows, between, high if sign > 0.0 else low)
        r = radius + taper * (s - low)
        height, steep = _arc_over(jnp.abs(x), reach, r)
        slope = sign * e_y + (kappa * jnp.sign(x) * steep)[..., None] * e_x
        fraction = fraction * _share(sign * (y - s * sigma) - kappa * height, cells, slope)
    return fraction


def _arc_over(x: jax.Array, reach: jax.Array, r: jax.Array) -> tuple[jax.Array, jax.Array]:
    """√(r² − x²) over the part of [x − reach, x + reach] within [0, r], which alone may be covered:
    the mean (Simpson's rule), and minus the slope, as a share of 2 reach."""
    first = jnp.clip(x - reach, 0.0, r)
    last = jnp.clip(x + reach, 0.0, r)
    low, mean, high = (
        jnp.sqrt(jnp.maximum(r**2 - at**2, 1e-30)) for at in (last, 0.5 * (first + last), first)
    )
    return (low + 4.0 * mean + high) / 6.0, (high - low) / jnp.maximum(2.0 * reach, NUDGE)
