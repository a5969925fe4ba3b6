"""Brightness of a faceted body: the sum over facets that are lit and visible.

`flux` dominates the cost of every fit, so its derivative is written out instead of left to
automatic differentiation. The kernel and its two slopes are computed once per epoch and facet;
everything else is a product of these matrices with a vector and linear in the tangents. JAX can
therefore transpose it to a reverse mode of the same form, and forward mode, `vmap` and higher
derivatives work as for any function. Long light curves are processed in blocks that fit in the
cache of a core. The blocks are recomputed in the backward pass, which is faster than reading them
from memory and limits the memory use.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Literal, get_args

from lcbayes.core.blocks import in_turn
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.reflectance import geometry, get_law
from lcbayes.physics.tangents import present

DiffuseLaw = Literal["non-lambertian", "lambertian", "lommel-seeliger-lambert"]
LAMBERT_C = 0.1
"""Weight of Lambert's term beside Lommel and Seeliger's, where it is not a parameter."""
DIFFUSE_LAWS: tuple[str, ...] = get_args(DiffuseLaw)

_MANY_FACETS = 64  # with fewer, matrices are (N, T), so that the long axis is the inner one
# Epochs x facets per block: a few matrices of 128 kB each fit in the cache of a core. This matters
# most when chains run in parallel: two gradients of 1541 x 300 on two cores take half the time
# without blocks. With few facets the loop costs more than this saves.
_BLOCK, _BLOCK_FEW = 1 << 14, 1 << 18


def flux(
    sun_body: jax.Array,
    obs_body: jax.Array,
    normals: jax.Array,
    albedo_area: jax.Array,
    law: str = "non-lambertian",
    c: jax.Array | float = LAMBERT_C,
    *,
    single_slopes: bool = False,
) -> jax.Array:
    """Flux of a body of diffuse facets at unit distance under unit irradiance.

    f(t) = Σᵢ αᵢ K(μ₀ᵢ, μᵢ), with μ₀ = max(0, s·n), μ = max(0, o·n), over lit and visible facets.

    K = μ₀μ/π ("lambertian"), [1 − (1 − μ₀/2)⁵][1 − (1 − μ/2)⁵] μ₀μ/π ("non-lambertian"),
    μ₀μ/(μ₀ + μ) + c μ₀μ ("lommel-seeliger-lambert", with α = w A/4π and no phase law).

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
    single_slopes : bool
        Whether derivatives are computed in single precision, with a relative error of some 1e-6.
        With many facets a gradient then takes 0.8 times as long. The flux is always in double
        precision: a sampler that follows these derivatives and accepts by the density has no error.

    Returns
    -------
    (T,) m²

    References
    ----------
    Linares & Crassidis, eqs. (4), (5), with each cosine clipped at zero; Kaasalainen, Torppa &
    Muinonen 2001 for the last law.
    """
    if law not in DIFFUSE_LAWS:
        raise ValueError(f"unknown diffuse law {law!r}; available: {', '.join(DIFFUSE_LAWS)}")
    args = tuple(jnp.asarray(x, float) for x in (sun_body, obs_body, normals, albedo_area, c))
    epochs, facets = args[0].shape[0], args[2].shape[0]
    many = 2 * _BLOCK if single_slopes else _BLOCK
    size = many if facets >= _MANY_FACETS else _BLOCK_FEW
    if epochs * facets <= size:
        return _flux(law, single_slopes, *args)

    def part(sun: jax.Array, obs: jax.Array) -> jax.Array:
        return _flux(law, single_slopes, sun, obs, *args[2:])

    return in_turn(part, max(1, size // facets), *args[:2])


@partial(jax.custom_jvp, nondiff_argnums=(0, 1))
@partial(jax.jit, static_argnums=(0, 1))
def _flux(law, single_slopes, sun, obs, normals, albedo_area, c):  # noqa: ARG001 - of the slopes
    facets_first = normals.shape[0] < _MANY_FACETS
    kernel = diffuse_kernel(law, *_cosines(facets_first, sun, obs, normals), c)[0]
    return albedo_area @ kernel if facets_first else kernel @ albedo_area


@partial(_flux.defjvp, symbolic_zeros=True)
def _flux_jvp(law, single_slopes, primals, tangents):
    if not single_slopes:
        return _flux_and_change(law, primals, present(tangents))
    value = _flux(law, single_slopes, *primals)
    lower = jax.tree.map(lambda x: x.astype(jnp.float32), (primals, present(tangents)))
    return value, _flux_and_change(law, *lower)[1].astype(value.dtype)


@partial(jax.jit, static_argnums=0)  # traced once, not at each of the times that a model is
def _flux_and_change(law, primals, tangents):
    """The flux and its change; tangents that are zero are None."""
    sun, obs, normals, albedo_area, c = primals
    d_sun, d_obs, d_normals, d_albedo_area, d_c = tangents
    facets_first = normals.shape[0] < _MANY_FACETS
    mu0, mu = _cosines(facets_first, sun, obs, normals)
    kernel, slope0, slope = diffuse_kernel(law, mu0, mu, c)

    def total(matrix: jax.Array, weights: jax.Array) -> jax.Array:
        """Σᵢ over facets."""
        return weights @ matrix if facets_first else matrix @ weights

    def along(vectors: jax.Array, matrix: jax.Array, weights: jax.Array) -> jax.Array:
        """Σₖ vₖ(t) Σᵢ M(t, i) wₖ(i), k the three axes."""
        if facets_first:
            return jnp.sum(vectors.T * (weights.T @ matrix), axis=0)
        # With a fourth column of zeros, XLA multiplies more than twice as fast as with three.
        return jnp.sum(vectors * (matrix @ jnp.pad(weights, ((0, 0), (0, 1))))[:, :3], axis=1)

    def turned(vectors: jax.Array, matrix: jax.Array) -> jax.Array:
        """The same with wₖ = αᵢ dnₖ, for changes of the normals."""
        weights = albedo_area[:, None] * d_normals
        if facets_first:
            return along(vectors, matrix, weights)
        # One axis at a time: the transposes are row vector times matrix, the fastest form in XLA.
        return sum(vectors[:, k] * total(matrix, weights[:, k]) for k in range(3))  # pyright: ignore[reportReturnType]

    value = total(kernel, albedo_area)
    change = jnp.zeros_like(value)
    if d_albedo_area is not None:
        change += total(kernel, d_albedo_area)
    area_vectors = albedo_area[:, None] * normals
    if d_sun is not None:
        change += along(d_sun, slope0, area_vectors)
    if d_obs is not None:
        change += along(d_obs, slope, area_vectors)
    if d_normals is not None:
        change += turned(sun, slope0) + turned(obs, slope)
    if law == "lommel-seeliger-lambert" and d_c is not None:
        lambert = jnp.maximum(mu0, 0.0) * jnp.maximum(mu, 0.0)
        change += d_c * total(lambert, albedo_area)
    return value, change


def _cosines(facets_first, sun, obs, normals):
    """s·n and o·n, (N, T) for few facets, otherwise (T, N)."""
    if facets_first:
        return normals @ sun.T, normals @ obs.T
    return sun @ normals.T, obs @ normals.T


def diffuse_kernel(law, mu0, mu, c):
    """K = f_r μ₀ μ of a facet of unit albedo and its derivatives by μ₀ and μ, all zero where dark.

    Elementwise, without branches, with powers by multiplication.
    """
    if law == "lommel-seeliger-lambert":
        # A quotient for each result instead of one reciprocal for all: XLA would write the latter
        # to memory and read it back, which is slower than a division. NaN does not count as dark,
        # so it propagates.
        dark = (mu0 <= 0.0) | (mu <= 0.0)
        both = jnp.where(dark, 1.0, mu0 + mu)
        value, p, q = mu0 * mu / both + c * (mu0 * mu), mu0 / both, mu / both
        slopes = q * q + c * mu, p * p + c * mu0
        return tuple(jnp.where(dark, 0.0, x) for x in (value, *slopes))
    lit, seen = mu0 > 0.0, mu > 0.0
    mu0, mu = jnp.maximum(mu0, 0.0), jnp.maximum(mu, 0.0)
    if law == "lambertian":
        by_pi = 1.0 / jnp.pi
        return mu0 * mu * by_pi, jnp.where(lit, mu * by_pi, 0.0), jnp.where(seen, mu0 * by_pi, 0.0)
    # "non-lambertian" is a product: K = B(μ₀) B(μ)/π, B = x [1 − (1 − x/2)⁵], B'(0) = 0
    (b0, slope0), (b, slope) = _shouldered(mu0), _shouldered(mu)
    b = b * (1.0 / jnp.pi)
    return b0 * b, slope0 * b, b0 * slope * (1.0 / jnp.pi)


def _shouldered(x):
    """B = x [1 − (1 − x/2)⁵] and its derivative."""
    y = 1.0 - 0.5 * x
    y2 = y * y
    y4 = y2 * y2
    w = 1.0 - y4 * y
    return x * w, w + 2.5 * x * y4


def flux_brdf(
    sun_body: jax.Array,
    obs_body: jax.Array,
    normals: jax.Array,
    area: jax.Array,
    law: str,
    params: Mapping[str, jax.Array | float],
    u_axes: jax.Array | None = None,
    visible: jax.Array | None = None,
) -> jax.Array:
    """Flux of a body with facets that follow any law of `reflectance.LAWS`, as in `flux`.

    f(t) = Σᵢ Aᵢ vᵢ f_r(μ₀ᵢ, μᵢ, …) μ₀ᵢ μᵢ over the facets that are lit and visible.

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
        Parameters of the law. Give only "nu" for an isotropic Ashikhmin-Shirley facet.
    u_axes : (N, 3) or None
        Unit vectors in each facet's plane, perpendicular to its normal; for anisotropic laws.
    visible : (T, N) or None
        Fraction v of each facet that is neither shadowed nor hidden (`bodies.shadows`); 1 if None.

    Returns
    -------
    (T,)
        Flux at unit distance under unit irradiance, m².

    References
    ----------
    Hinks, Linares & Crassidis 2013, eqs. (3)-(6).
    """
    angles, lit = geometry(sun_body, obs_body, normals, u_axes)
    reflected = get_law(law).brdf(angles, params) * angles.mu0 * angles.mu
    if visible is not None:
        reflected = reflected * visible
    return jnp.where(lit, reflected, 0.0) @ area
