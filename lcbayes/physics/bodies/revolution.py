"""Light reflected by surfaces of revolution with straight generators: cylinder, cone, frustum.

With the half-angle γ of the cone, the normal at the azimuth φ is
n = (cos γ cos φ, cos γ sin φ, sin γ), the same along each generator. Lit is one arc of azimuths,
visible another, and their intersection is up to two arcs.
"""

from __future__ import annotations

from functools import partial

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.coverage import Cells, Shade, discs, lit_and_seen
from lcbayes.physics.bodies.quadrature import (
    KINKED,
    TINY,
    Rule,
    in_blocks,
    integral,
    length,
    lobe_exponent,
    nodes_between,
    reach,
    reflected,
)
from lcbayes.physics.reflectance import Parameters, half_phase


def around_axis(
    law: str,
    parameters: Parameters,
    sun: jax.Array,
    obs: jax.Array,
    tilt: tuple[jax.Array, jax.Array] | None,
    count: int,
    shade: Shade | None = None,
) -> jax.Array:
    """∫ f_r μ₀ μ dφ over the azimuths that are lit and visible, (T,).

    Parameters
    ----------
    law, parameters
        Of `reflectance.LAWS`; scalars.
    sun, obs : (T, 3)
        Unit vectors, the axis of revolution along z.
    tilt : (cos γ, sin γ) or None
        None for a cylinder, γ = 0, where one arc and one kink are all there are.
    count : int
        Nodes of each smooth interval.
    shade : Shade or None
        What may shade the part.
    """
    tilted = tilt is not None
    tilt = tilt or (jnp.ones(()), jnp.zeros(()))
    intervals = 10 if tilted else 4  # at most

    def of(sun: jax.Array, obs: jax.Array) -> jax.Array:
        rule = _azimuths(law, parameters, sun, obs, tilt, tilted, count)
        values = sun, obs, tilt, parameters, shade and shade.blockers
        return integral(partial(_on_revolution, law, cells), values, rule)

    cells = shade.count if shade else 0
    return in_blocks(of, sun, obs, count * intervals * max(1, cells))


def _on_revolution(law, cells, values, points):
    """f_r μ₀ μ at azimuths, given as (cos φ, sin φ), each with the middle and width of its cell."""
    sun, obs, (cos_tilt, sin_tilt), parameters, blockers = values

    def normal_part(d: jax.Array) -> jax.Array:
        radial = points[..., 0] * d[:, None, 0] + points[..., 1] * d[:, None, 1]
        return cos_tilt * radial + sin_tilt * d[:, None, 2]

    c, phase = half_phase(sun, obs)
    h = (sun + obs) / (2.0 * c[:, None])
    radial = points[..., 0] * h[:, None, 0] + points[..., 1] * h[:, None, 1]
    h_u = cos_tilt * h[:, None, 2] - sin_tilt * radial
    h_v = points[..., 1] * h[:, None, 0] - points[..., 0] * h[:, None, 1]
    mu0, mu = normal_part(sun), normal_part(obs)
    light = reflected(law, parameters, mu0, mu, (c, phase), (h_u, h_v))
    return light if blockers is None else light * _uncovered(blockers, cells, sun, obs, points)


def _uncovered(blockers, count, sun, obs, points):
    """Share of each generator that is lit and seen, (T, K), by cells along it."""
    low, high, radius, top = discs(blockers.kinds[0], blockers.own.sizes)
    along = (jnp.arange(count) + 0.5) / count
    r, z = radius + (top - radius) * along, low + (high - low) * along
    zero = jnp.zeros(points.shape[:2])
    across = jnp.stack([points[..., 2], points[..., 3], zero], axis=-1)
    around = jnp.stack([-points[..., 3], points[..., 2], zero], axis=-1)
    axis = jnp.array([0.0, 0.0, 1.0])
    second = ((top - radius) * across + (high - low) * axis) / count
    around, across, width = around[:, :, None], across[:, :, None], points[:, :, None, 4:]
    centre = r[:, None] * across + z[:, None] * axis
    edges = centre, r[:, None] * width * around, jnp.broadcast_to(second[:, :, None], centre.shape)
    cells = Cells(*(x.reshape(len(sun), -1, 3) for x in edges))
    seen = lit_and_seen(blockers, cells, sun, obs).reshape(len(sun), -1, count)
    return seen @ (r / jnp.sum(r))


def _azimuths(law, parameters, sun, obs, tilt, tilted, count) -> Rule:
    """Nodes on the arcs that are lit and visible.

    In azimuths from that of the Sun the lit arc is [−a, a], the visible one [d − b, d + b], and
    this one again a full turn away.
    """
    centre, a = _arc(sun, tilt)
    other, b = _arc(obs, tilt)
    d = _wrapped(other - centre, 2.0 * jnp.pi)
    turns = (0.0, -2.0 * jnp.pi * jnp.where(d >= 0.0, 1.0, -1.0)) if tilted else (0.0,)
    special = _special_azimuths(law, parameters, sun, obs, tilt, tilted)
    parts = []
    for turn in turns:
        low, high = jnp.maximum(-a, d + turn - b), jnp.minimum(a, d + turn + b)
        low = jnp.minimum(low, high)
        middle = jax.lax.stop_gradient(0.5 * (low + high))
        about = jax.lax.stop_gradient(centre) + middle
        inner = [middle + _wrapped(x - about, period) for x, period in special]
        parts.append(nodes_between(low, high, inner, count))
    x, weights, cells = (jnp.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    phi, cells = centre[:, None] + x, centre[:, None] + cells
    points = [jnp.cos(phi), jnp.sin(phi), jnp.cos(cells), jnp.sin(cells), weights]
    return Rule(jnp.stack(points, axis=-1), weights)


def _wrapped(angle: jax.Array, period: float) -> jax.Array:
    """In [−period/2, period/2]."""
    return angle - period * jax.lax.stop_gradient(jnp.round(angle / period))


def _arc(direction: jax.Array, tilt: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
    """Azimuth of the centre and half the width of the arc with n·d > 0, (T,) each."""
    x, y, z = direction.T
    across = length(direction[:, :2])
    on_axis = across <= TINY
    azimuth = jnp.arctan2(jnp.where(on_axis, 0.0, y), jnp.where(on_axis, 1.0, x))
    return azimuth, _arc_width(tilt[0] * across, tilt[1] * z)


def _arc_width(amplitude: jax.Array, constant: jax.Array) -> jax.Array:
    """Half the width of the arc with A cos φ + B > 0: from 0 to π."""
    ratio = constant / jnp.maximum(amplitude, TINY)
    inside = jnp.abs(ratio) < 1.0
    half = jnp.arccos(-jnp.where(inside, ratio, 0.0))
    return jnp.where(inside, half, jnp.where(ratio > 0.0, jnp.pi, 0.0))


def _special_azimuths(law, parameters, sun, obs, tilt, tilted):
    """Azimuths with μ₀ = μ and at the reach of a highlight, (T,), each with its period."""
    sun, obs, tilt, parameters = jax.lax.stop_gradient((sun, obs, tilt, parameters))
    exponent = lobe_exponent(law, parameters)
    if exponent is None:
        return []
    bisector = (sun + obs) / length(sun + obs)[:, None]
    azimuth, _ = _arc(bisector, tilt)
    amplitude, constant = tilt[0] * length(bisector[:, :2]), tilt[1] * bisector[:, 2]
    # ln(n·h) = ln(A + B) − (φ − φ*)² A/(A + B)/2 + …
    width = reach(exponent * amplitude / jnp.maximum(amplitude + constant, 0.5))
    special = [(azimuth - width, 2.0 * jnp.pi), (azimuth + width, 2.0 * jnp.pi)]
    if law in KINKED:
        azimuth, half = _arc(sun - obs, tilt)
        if tilted:
            special += [(azimuth - half, 2.0 * jnp.pi), (azimuth + half, 2.0 * jnp.pi)]
        else:
            special += [(azimuth + 0.5 * jnp.pi, jnp.pi)]
    return special
