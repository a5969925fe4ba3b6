"""Derivatives of brightness by attitude and surface: in closed form, and for any law by JAX.

The attitude error δα (rad, body frame) follows Hinks et al.: Â = exp(−[δα×]) A_true, with their A
from inertial to body. The true body-frame components of an inertial vector are therefore
exp([δα×]) times those computed with Â, and ∂(o·n)/∂δα = o × n. The A(t) of this package is the
transpose of theirs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.reflectance import geometry, log_over_sin2, shoulder

MAGNITUDE_PER_NEPER = 2.5 / np.log(10.0)
CLOSED_FORMS = ("ashikhmin-shirley", "ashikhmin-shirley-distribution")


class Sensitivities(NamedTuple):
    """Flux and its first derivatives, at unit distance under unit irradiance.

    Attributes
    ----------
    flux : (T, N) m²
        Flux of each facet; that of the body is the sum.
    attitude : (T, 3) m²/rad
        ∂(Σ flux)/∂δα, body frame.
    parameters : name → (T, N)
        ∂flux/∂p of each facet for its r_diff, r_spec, nu, nv.
    """

    flux: jax.Array
    attitude: jax.Array
    parameters: dict[str, jax.Array]


def closed_form(
    sun_body: jax.Array,
    obs_body: jax.Array,
    normals: jax.Array,
    area: jax.Array,
    law: str,
    params: Mapping[str, jax.Array | float],
    u_axes: jax.Array | None = None,
) -> Sensitivities:
    """Derivatives of the flux of an Ashikhmin-Shirley body in closed form.

    ∂f/∂δα = Σᵢ fᵢ [C₁ᵢ (o × nᵢ) + C₂ᵢ (s × nᵢ) + C_uᵢ (h × uᵢ) + C_vᵢ (h × vᵢ)],

    C₁ = (ρ_s/ρ) {z/(x_A + x_B) − ∂ ln q/∂x_A} + (5k₂/2ρ) S(x_B) (1 − x_A/2)⁴ + 1/x_A,
    C_u = 2(n_u − n_v) (ρ_s/ρ) ln(x_n) x_u x_v²/(x_u² + x_v²)², C₂ and C_v by exchange (C_v with
    opposite sign), S(x) = 1 − (1 − x/2)⁵, and q the denominator of the specular term:
    x_A + x_B − x_A x_B ("ashikhmin-shirley-distribution", as in the papers) or c·max(x_A, x_B)
    ("ashikhmin-shirley"). The latter has a kink at x_A = x_B, where the mean of both sides is
    returned.

    Parameters
    ----------
    sun_body, obs_body, normals, area, params, u_axes
        As in `brightness.flux_brdf`; without ``u_axes`` facets are isotropic and "nu" is the value
        of both exponents, as in Hinks (24).
    law : str
        One of `CLOSED_FORMS`.

    References
    ----------
    Hinks, Linares & Crassidis 2013, eqs. (17), (18), (22)-(24), with (18d) and (23a) corrected;
    Wang et al. 2025, eqs. (9)-(11).
    """
    if law not in CLOSED_FORMS:
        raise ValueError(f"no closed form for {law!r}; available: {', '.join(CLOSED_FORMS)}")
    geom, lit = geometry(sun_body, obs_body, normals, u_axes)
    xa, xb, xn = geom.mu, geom.mu0, geom.mu_h
    nu, r_diff, r_spec = (jnp.asarray(params[k]) for k in ("nu", "r_diff", "r_spec"))
    nv = jnp.asarray(params.get("nv", nu))
    log_n, by_sin2 = jnp.log(xn), log_over_sin2(xn)

    denominator, dq_a, dq_b = _denominator(law, geom.c, xa, xb)
    schlick = (1.0 - geom.c) ** 5
    fresnel = r_spec + (1.0 - r_spec) * schlick
    if geom.h_u is None or geom.h_v is None:
        log_lobe, z = nu * log_n, nu
        share_u = share_v = 0.0
    else:
        xu, xv = geom.h_u, geom.h_v
        sin2 = jnp.maximum(xu**2 + xv**2, 1e-300)
        share_u, share_v = xu**2 / sin2, xv**2 / sin2
        z = nu * share_u + nv * share_v
        log_lobe = nv * log_n + (nu - nv) * xu**2 * by_sin2
    norm = jnp.sqrt((nu + 1.0) * (nv + 1.0)) / (8.0 * jnp.pi)
    reflected = jnp.where(lit, area * xa * xb, 0.0)
    lobe = reflected * norm * jnp.exp(log_lobe) / denominator  # without the Fresnel factor
    specular = lobe * fresnel
    k = 28.0 / (23.0 * jnp.pi)
    both = reflected * k * shoulder(xa) * shoulder(xb)
    diffuse = both * r_diff * (1.0 - r_spec)
    flux = specular + diffuse

    slope = 2.5 * reflected * k * r_diff * (1.0 - r_spec)
    c1 = specular * (z / (xa + xb) - dq_a) + slope * shoulder(xb) * (1.0 - 0.5 * xa) ** 4
    c2 = specular * (z / (xa + xb) - dq_b) + slope * shoulder(xa) * (1.0 - 0.5 * xb) ** 4
    c1, c2 = c1 + flux / xa, c2 + flux / xb
    turn = jnp.cross(obs_body, c1 @ normals) + jnp.cross(sun_body, c2 @ normals)
    parameters = {
        "r_diff": both * (1.0 - r_spec),
        "r_spec": lobe * (1.0 - schlick) - both * r_diff,
    }
    if u_axes is None or geom.h_u is None or geom.h_v is None:
        parameters["nu"] = specular * (1.0 / (nu + 1.0) + log_n)
    else:
        bisector = (sun_body + obs_body) / (2.0 * geom.c)
        # ln(x_n)/(x_u² + x_v²) is smooth if the half vector is along the normal
        front = 2.0 * (nu - nv) * specular * by_sin2
        v_axes = jnp.cross(normals, u_axes)
        turn += jnp.cross(bisector, (front * geom.h_u * share_v) @ u_axes)
        turn -= jnp.cross(bisector, (front * geom.h_v * share_u) @ v_axes)
        parameters["nu"] = specular * (0.5 / (nu + 1.0) + by_sin2 * geom.h_u**2)
        parameters["nv"] = specular * (0.5 / (nv + 1.0) + by_sin2 * geom.h_v**2)
    return Sensitivities(flux, turn, parameters)


def _denominator(
    law: str, c: jax.Array, xa: jax.Array, xb: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """q of the specular term, ∂ ln q/∂x_A and ∂ ln q/∂x_B."""
    if law == "ashikhmin-shirley":
        higher_a = jnp.where(xa == xb, 0.5, xa > xb)
        return c * jnp.maximum(xa, xb), higher_a / xa, (1.0 - higher_a) / xb
    q = xa + xb - xa * xb
    return q, (1.0 - xb) / q, (1.0 - xa) / q


def attitude_gradient(
    flux: Callable[[jax.Array, jax.Array], jax.Array], sun_body: jax.Array, obs_body: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Flux and ∂flux/∂δα by forward differentiation, for any law.

    Parameters
    ----------
    flux : callable
        Body-frame Sun and observer (T, 3) -> flux (T,), independently for each point.
    sun_body, obs_body : (T, 3)

    Returns
    -------
    flux : (T,)
    gradient : (T, 3) per rad, body frame
    """
    value, push = jax.linearize(flux, sun_body, obs_body)
    columns = [push(jnp.cross(e, sun_body), jnp.cross(e, obs_body)) for e in jnp.eye(3)]
    return value, jnp.stack(columns, axis=-1)


def magnitude_gradient(flux: jax.Array, gradient: jax.Array) -> jax.Array:
    """∂m/∂x = −(2.5/ln 10) (∂f/∂x)/f, (T, P); zero where the flux is zero and m infinite."""
    bright = flux > 0.0
    by_flux = jnp.where(bright, 1.0 / jnp.where(bright, flux, 1.0), 0.0)
    return -MAGNITUDE_PER_NEPER * gradient * by_flux[:, None]


def nullspace(gradient: jax.Array, axis: jax.Array) -> jax.Array:
    """The two orthonormal directions of attitude error to which a measurement is insensitive.

    n₁ is the unit vector along ``axis`` minus its projection on the gradient g, and n₂ = ĝ × n₁.
    For one isotropic facet, the gradient of a magnitude, and ``axis`` the normal, these are Hinks'
    (20a) and (20b): n₁ = n, and n₂ along the projection of C₁ o + C₂ s on the facet's plane. If
    g = 0 (the exact centre of a glint, or a dark body), the measurement is insensitive to any
    direction: n₁ = ``axis``, and n₂ is an arbitrary direction perpendicular to it.

    Parameters
    ----------
    gradient : (T, 3)
    axis : (T, 3)
        Unit vectors, not parallel to the gradient.

    Returns
    -------
    (T, 2, 3)
    """
    length = jnp.linalg.norm(gradient, axis=-1, keepdims=True)
    seen = length > 0.0
    across = jnp.cross(axis, jnp.eye(3)[jnp.argmin(jnp.abs(axis), axis=-1)])
    across = across / jnp.linalg.norm(across, axis=-1, keepdims=True)
    g = jnp.where(seen, gradient / jnp.where(seen, length, 1.0), across)
    first = axis - g * jnp.sum(axis * g, axis=-1, keepdims=True)
    first = first / jnp.linalg.norm(first, axis=-1, keepdims=True)
    return jnp.stack([first, jnp.cross(g, first)], axis=-2)
