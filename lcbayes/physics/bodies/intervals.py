"""Where edges lie in convex polygons, as intervals of each edge.

A half-plane cuts an edge where its level is zero, and the sign of the change of level along the
edge says which side is left. For an edge that runs along the half-plane that sign is rounding. XLA
may compute the change twice, with two roundings, so a sign that decides by itself could decide
differently in two places. Such edges are therefore recognised by a tolerance, and lie on the side
of their middle.
"""

from __future__ import annotations

from lcbayes.core.jax_setup import jax, jnp

type Points = tuple[jax.Array, jax.Array]  # x and y
type Ends = tuple[Points, Points]  # of edges

PARALLEL = 1e-12  # sine of the angle, and length over distance from the origin, that count as zero


def in_polygons(edges: Ends, polygons: Ends) -> tuple[jax.Array, jax.Array]:
    """Where edges enter convex polygons and leave them, as shares of the edge.

    Parameters
    ----------
    edges : (A, M, P)
    polygons : (A or 1, J, E, P)
        The polygon lies on the left of its edges; an edge without length is on neither side.

    Returns
    -------
    into, out : (A, M, J, P)
        In [0, 1], but for into ≥ out where an edge misses the polygon.
    """
    (sx, sy), (ex, ey) = (tuple(x[:, :, None] for x in points) for points in edges)
    (px, py), (qx, qy) = polygons
    dx, dy = qx - px, qy - py
    length = jnp.abs(dx) + jnp.abs(dy)
    point = length <= PARALLEL * (jnp.abs(px) + jnp.abs(py))
    dx, dy = jnp.where(point, 0.0, dx), jnp.where(point, 0.0, dy)
    reach = PARALLEL * (jnp.abs(sx) + jnp.abs(sy) + jnp.abs(ex) + jnp.abs(ey))

    def halved(interval, half_plane):
        into, out = interval
        x, y, c, size = half_plane
        before = x * sy - y * sx - c
        after = x * ey - y * ex - c
        change = after - before
        level = jnp.abs(change) <= size * reach
        at = -before / jnp.where(level, 1.0, change)
        into = jnp.maximum(into, jnp.where((change > 0.0) & ~level, at, 0.0))
        beyond = jnp.where(level & (before + after < 0.0), -1.0, 1.0)
        return into, jnp.minimum(out, jnp.where((change < 0.0) & ~level, at, beyond))

    half_planes = [jnp.moveaxis(z, 2, 0) for z in (dx, dy, dx * py - dy * px, length)]
    half_planes = [z[:, :, None] for z in half_planes]  # (E, A, 1, J, P)
    shape = jnp.broadcast_shapes(sx.shape, half_planes[0].shape[1:])
    ends, _ = jax.lax.scan(
        lambda interval, half_plane: (halved(interval, half_plane), None),
        (jnp.zeros(shape), jnp.ones(shape)),
        half_planes,
    )
    return ends


def without_union(
    into: jax.Array, out: jax.Array, low: jax.Array | float = 0.0, high: jax.Array | float = 1.0
) -> tuple[jax.Array, jax.Array]:
    """∫dt and ∫t dt over [low, high] without the union of the intervals along axis 2."""
    count = into.shape[2]
    pairs = [
        (jnp.maximum(into[:, :, j], low), jnp.minimum(out[:, :, j], high)) for j in range(count)
    ]
    pairs = [(jnp.where(b > a, a, 2.0), jnp.where(b > a, b, 2.0)) for a, b in pairs]
    if count == 2:
        (a, b), (c, d) = pairs
        pairs = [
            (jnp.minimum(a, c), jnp.where(a <= c, b, d)),
            (jnp.maximum(a, c), jnp.where(a <= c, d, b)),
        ]
    elif count > 2:
        a, b = (jnp.stack(x, axis=2) for x in zip(*pairs, strict=True))
        a, b = jax.lax.sort((a, b), dimension=2, num_keys=1)
        pairs = [(a[:, :, j], b[:, :, j]) for j in range(count)]
    length = jnp.maximum(high - low, 0.0)
    moment = 0.5 * length * (high + low)
    reached = -1.0
    for a, b in pairs:
        a = jnp.maximum(a, reached)
        covered = jnp.maximum(b - a, 0.0)
        length, moment = length - covered, moment - 0.5 * covered * (a + b)
        reached = jnp.maximum(reached, b)
    return length, moment
