"""Brightness of a faceted body: the sum over facets that are lit and seen."""

from __future__ import annotations

from functools import partial

from lcbayes._jax import jax, jnp

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
    return _flux(law, sun_body, obs_body, normals, albedo_area, jnp.asarray(c, dtype=float))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _flux(law, sun, obs, normals, area, c):
    mu0 = jnp.maximum(sun @ normals.T, 0.0)
    mu = jnp.maximum(obs @ normals.T, 0.0)
    return _kernel(law, mu0, mu, c) @ area


def _flux_jvp(law, primals, tangents):
    sun, obs, normals, area, c = primals
    d_sun, d_obs, d_normals, d_area, d_c = tangents
    mu0 = jnp.maximum(sun @ normals.T, 0.0)
    mu = jnp.maximum(obs @ normals.T, 0.0)
    kernel = partial(_kernel, law)
    ones = jnp.ones_like(mu0)
    k, k0 = jax.jvp(lambda x: kernel(x, mu, c), (mu0,), (ones,))
    _, k1 = jax.jvp(lambda x: kernel(mu0, x, c), (mu,), (ones,))
    out = jnp.zeros(sun.shape[0])
    zero = jax.custom_derivatives.SymbolicZero
    lit = (mu0 > 0) & (mu > 0)
    k0 = jnp.where(lit, k0, 0.0)
    k1 = jnp.where(lit, k1, 0.0)
    if not isinstance(d_area, zero):
        out += k @ d_area
    if not isinstance(d_c, zero):
        out += d_c * (jax.jvp(lambda x: kernel(mu0, mu, x), (c,), (jnp.ones(()),))[1] @ area)
    if not isinstance(d_sun, zero):
        out += jnp.sum(((k0 * area) @ normals) * d_sun, axis=1)
    if not isinstance(d_obs, zero):
        out += jnp.sum(((k1 * area) @ normals) * d_obs, axis=1)
    if not isinstance(d_normals, zero):
        out += jnp.sum((k0 * area) * (sun @ d_normals.T) + (k1 * area) * (obs @ d_normals.T), axis=1)
    return k @ area, out


_flux.defjvp(_flux_jvp, symbolic_zeros=True)
