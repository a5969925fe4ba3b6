"""Brightness of a faceted body: the sum over facets that are lit and seen."""

from __future__ import annotations

from collections.abc import Mapping

from lcbayes._jax import jax, jnp
from lcbayes.physics.reflectance import geometry, get_law

DIFFUSE_LAWS = ("non-lambertian", "lambertian", "lommel-seeliger-lambert")


def _kernel(law: str, mu0: jax.Array, mu: jax.Array, c: jax.Array | float) -> jax.Array:
    """f_r μ₀ μ of a facet of unit albedo, for cosines already clipped at zero."""
    if law == "non-lambertian":
        w0, w = 1.0 - (1.0 - 0.5 * mu0) ** 5, 1.0 - (1.0 - 0.5 * mu) ** 5
        return w0 * w * mu0 * mu / jnp.pi
    if law == "lambertian":
        return mu0 * mu / jnp.pi
    if law == "lommel-seeliger-lambert":
        product = mu0 * mu
        return product / jnp.maximum(mu0 + mu, 1e-12) + c * product
    raise ValueError(f"unknown diffuse law {law!r}; available: {', '.join(DIFFUSE_LAWS)}")


def flux(
    sun_body: jax.Array,
    obs_body: jax.Array,
    normals: jax.Array,
    albedo_area: jax.Array,
    law: str = "non-lambertian",
    c: jax.Array | float = 0.1,
) -> jax.Array:
    """Flux of a body of diffuse facets at unit distance under unit irradiance.

    f(t) = Σᵢ αᵢ K(μ₀ᵢ, μᵢ), with μ₀ = max(0, s·n), μ = max(0, o·n): a facet must be lit and seen.

    Parameters
    ----------
    sun_body, obs_body : (T, 3)
        Unit vectors to Sun and observer, body frame.
    normals : (N, 3)
        Outward unit normals, body frame.
    albedo_area : (N,) m²
        α = s F₀ A.
    law : str
        One of `DIFFUSE_LAWS`.
    c : float
        Weight of the Lambert term, for "lommel-seeliger-lambert" only.

    Returns
    -------
    (T,)

    References
    ----------
    Linares & Crassidis, eqs. (4), (5), with each cosine clipped at zero.
    """
    mu0 = jnp.maximum(sun_body @ normals.T, 0.0)
    mu = jnp.maximum(obs_body @ normals.T, 0.0)
    return _kernel(law, mu0, mu, c) @ albedo_area


def flux_brdf(
    sun_body: jax.Array,
    obs_body: jax.Array,
    normals: jax.Array,
    area: jax.Array,
    law: str,
    params: Mapping[str, jax.Array | float],
    u_axes: jax.Array | None = None,
) -> jax.Array:
    """Flux of a body whose facets follow any law of `reflectance.LAWS`, as in `flux`.

    f(t) = Σᵢ Aᵢ f_r(μ₀ᵢ, μᵢ, …) μ₀ᵢ μᵢ over the facets that are lit and seen.

    Parameters
    ----------
    sun_body, obs_body : (T, 3)
        Unit vectors to Sun and observer, body frame.
    normals : (N, 3)
        Outward unit normals, body frame.
    area : (N,) m²
    law : str
        One of `reflectance.LAWS`.
    params : mapping of (N,) or scalars
        The law's parameters. Give "nu" alone for an isotropic Ashikhmin-Shirley facet.
    u_axes : (N, 3) or None
        Unit vectors in each facet's plane, perpendicular to its normal; for anisotropic laws.

    Returns
    -------
    (T,)
        Flux at unit distance under unit irradiance, m².

    References
    ----------
    Hinks, Linares & Crassidis 2013, eqs. (3)-(6).
    """
    found, lit = geometry(sun_body, obs_body, normals, u_axes)
    sent = get_law(law).brdf(found, params) * found.mu0 * found.mu
    return jnp.where(lit, sent, 0.0) @ area
