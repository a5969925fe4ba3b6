"""Light reflected by an ellipsoid: an integral over the lit and visible lune of the unit sphere.

The ellipsoid x = D y, D = diag(x, y, z), is the image of the unit sphere: n = D⁻¹y/ν,
dA = |D| ν dω, ν = |D⁻¹y|. It is lit where y·D⁻¹s > 0 and visible where y·D⁻¹o > 0.
"""

from __future__ import annotations

from functools import partial

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.coverage import Cells, Shade, lit_and_seen
from lcbayes.physics.bodies.quadrature import (
    KINKED,
    Nodes,
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


def over_lune(
    law: str,
    parameters: Parameters,
    sun: jax.Array,
    obs: jax.Array,
    scale: jax.Array | None,
    count: int,
    shade: Shade | None = None,
) -> jax.Array:
    """∫ f_r μ₀ μ dA over the part of an ellipsoid that is lit and visible, m², (T,).

    Parameters
    ----------
    law, parameters
        Of `reflectance.LAWS`; scalars.
    sun, obs : (T, 3)
        Unit vectors, axes of the ellipsoid.
    scale : (3,) m or None
        Semi-axes; None for the unit sphere with an isotropic law, whose flux depends on the phase
        angle alone.
    count : int
        Nodes of each smooth interval, in each of the two angles.
    shade : Shade or None
        What may shade the part.
    """

    def of(sun: jax.Array, obs: jax.Array) -> jax.Array:
        if scale is None:
            (sun, obs), rule = _quarter(law, parameters, sun, obs, count)
        else:
            rule = _lune(law, parameters, sun, obs, scale, count)
        size = jnp.ones(3) if scale is None else scale
        values = sun, obs, size, parameters, shade and shade.blockers
        return integral(partial(_on_ellipsoid, law), values, rule)

    return in_blocks(of, sun, obs, (4 if scale is None else 12) * count**2)


def _quarter(law, parameters, sun, obs, count):
    """Directions at the same phase angle, symmetric about x in the xy plane; and a rule on a
    quarter of the lune, four times as heavy, as every law is reciprocal."""
    cosine, phase = half_phase(sun, obs)
    zero = jnp.zeros_like(phase)
    sine = jnp.sin(0.5 * phase)
    sun, obs = (jnp.stack([cosine, sign * sine, zero], axis=1) for sign in (-1.0, 1.0))
    exponent = lobe_exponent(law, jax.lax.stop_gradient(parameters))
    inner = [] if exponent is None else [reach(exponent) + zero]
    psi = nodes_between(zero, 0.5 * (jnp.pi - phase), inner, count)
    rule = _on_sphere(psi, nodes_between(zero, zero + 0.5 * jnp.pi, inner, count))
    return (sun, obs), rule._replace(weights=4.0 * rule.weights)


def _on_sphere(psi: Nodes, beta: Nodes) -> Rule:
    """The product of rules for longitudes and latitudes: points y, and middles and two edges of
    their cells, (T, K, 12)."""
    psi = Nodes(*(x[:, :, None] for x in psi))
    beta = Nodes(*(x[:, None, :] for x in beta))

    def radial(psi: jax.Array, beta: jax.Array) -> list[jax.Array]:
        return [jnp.cos(beta) * jnp.cos(psi), jnp.cos(beta) * jnp.sin(psi), jnp.sin(beta)]

    wide, high = psi.weight * jnp.cos(beta.cell), beta.weight
    parts = radial(psi.at, beta.at) + radial(psi.cell, beta.cell)
    parts += [-jnp.sin(psi.cell) * wide, jnp.cos(psi.cell) * wide, 0.0 * wide]
    parts += [high * x for x in radial(psi.cell, beta.cell + 0.5 * jnp.pi)]
    weight = psi.weight * beta.weight * jnp.cos(beta.at)
    points = jnp.stack([part + 0.0 * weight for part in parts], axis=-1)
    epochs = len(weight)
    return Rule(points.reshape(epochs, -1, 12), weight.reshape(epochs, -1))


def _on_ellipsoid(law, values, points):
    """f_r μ₀ μ dA/dω at points of the unit sphere, each with its cell."""
    sun, obs, scale, parameters, blockers = values
    points, middle, first, second = jnp.split(points, 4, axis=-1)
    image = points / scale
    stretch = length(image)
    normal = image / stretch[..., None]
    c, phase = half_phase(sun, obs)
    mu0, mu = (jnp.einsum("tki,ti->tk", normal, d) for d in (sun, obs))
    if "nv" in parameters:  # the u axis is horizontal
        h = (sun + obs) / (2.0 * c[:, None])
        across = length(normal[..., :2])
        h_u = (normal[..., 0] * h[:, None, 1] - normal[..., 1] * h[:, None, 0]) / across
        radial = normal[..., 0] * h[:, None, 0] + normal[..., 1] * h[:, None, 1]
        h_v = across * h[:, None, 2] - normal[..., 2] * radial / across
    else:
        h_u = h_v = jnp.zeros_like(mu0)
    light = reflected(law, parameters, mu0, mu, (c, phase), (h_u, h_v))
    if blockers is not None:
        cells = Cells(middle * scale, first * scale, second * scale)
        light = light * lit_and_seen(blockers, cells, sun, obs)
    return jnp.prod(scale) * stretch * light


def _lune(law, parameters, sun, obs, scale, count) -> Rule:
    """Nodes on the lit and visible lune of the unit sphere.

    y = cos β (cos ψ e₁ + sin ψ e₂) + sin β e₃ with e₁ along D⁻¹s and D⁻¹o at ψ = δ in the plane of
    e₁ and e₂: the lune is δ − π/2 < ψ < π/2 at all β.
    """
    s, o = sun / scale, obs / scale
    frame, delta = _lune_axes(s, o)
    high = jnp.full_like(delta, 0.5 * jnp.pi)
    fixed = jax.lax.stop_gradient((s, o, frame, delta, scale))
    inner, inner_beta = [], []
    exponent = lobe_exponent(law, jax.lax.stop_gradient(parameters))
    if exponent is not None:
        inner, inner_beta = _highlight(exponent, sun, obs, fixed)
        if law in KINKED:
            inner.append(_equal_cosines(fixed))
    psi, beta = (
        nodes_between(delta - high, high, inner, count),
        nodes_between(-high, high, inner_beta, count),
    )
    local = _on_sphere(psi, beta)
    turned = local.points.reshape(len(delta), -1, 3) @ frame
    return Rule(turned.reshape(local.points.shape), local.weights)


def _lune_axes(s: jax.Array, o: jax.Array) -> tuple[jax.Array, jax.Array]:
    """e₁, e₂, e₃ (T, 3, 3) in rows, and the angle (T,) from s to o."""
    e1 = s / length(s)[:, None]
    cross = jnp.cross(e1, o / length(o)[:, None])
    sine = length(cross)
    aligned = sine < 1e-10
    least = jnp.argmin(jnp.abs(jax.lax.stop_gradient(e1)), axis=1)
    other = jnp.cross(e1, jnp.eye(3)[least])
    cross = jnp.where(aligned[:, None], other, cross)
    e3 = cross / length(cross)[:, None]
    cosine = jnp.sum(e1 * o, axis=1) / length(o)
    delta = jnp.arctan2(jnp.where(aligned, 0.0, sine), cosine)
    return jnp.stack([e1, jnp.cross(e3, e1), e3], axis=1), delta


def _equal_cosines(fixed) -> jax.Array:
    """ψ with μ₀ = μ: |D⁻¹s| cos ψ = |D⁻¹o| cos(ψ − δ)."""
    s, o, _, delta, _ = fixed
    first, second = length(s), length(o)
    return jnp.arctan2(first - second * jnp.cos(delta), second * jnp.sin(delta))


def _highlight(exponent, sun, obs, fixed):
    """ψ and β, (T,) each, between which the highlight lies; its centre y ∝ D h has the normal h.

    A step dy along the sphere turns the normal by dn = (1 − h hᵀ) D⁻¹ dy/ν. With M = JᵀJ of this
    map in (cos β dψ, dβ), the lobe exp(−z |dn|²/2) has the covariance M⁻¹/z.
    """
    _, _, frame, _, scale = fixed
    h = jax.lax.stop_gradient((sun + obs) / length(sun + obs)[:, None])
    y = scale * h
    y = y / length(y)[:, None]
    y1, y2, y3 = jnp.einsum("tij,tj->it", frame, y)
    psi, beta = jnp.arctan2(y2, y1), jnp.arctan2(y3, length(jnp.stack([y1, y2], axis=1)))
    zero = jnp.zeros_like(psi)
    steps = [
        jnp.stack([-jnp.sin(psi), jnp.cos(psi), zero], axis=1),
        jnp.stack([-y3 * jnp.cos(psi), -y3 * jnp.sin(psi), jnp.cos(beta)], axis=1),
    ]
    turned = []
    for step in steps:
        dn = jnp.einsum("ti,tij->tj", step, frame) / scale / length(y / scale)[:, None]
        turned.append(dn - h * jnp.sum(h * dn, axis=1)[:, None])
    (a, b, c) = (jnp.sum(turned[i] * turned[j], axis=1) for i, j in ((0, 0), (0, 1), (1, 1)))
    determinant = jnp.maximum(a * c - b**2, 1e-30)
    wide = reach(exponent * determinant / c * jnp.maximum(jnp.cos(beta), 0.05) ** 2)
    high = reach(exponent * determinant / a)
    return [psi - wide, psi + wide], [beta - high, beta + high]
