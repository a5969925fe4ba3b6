"""Reflectance laws: the fraction of the incident light that a facet reflects to the observer.

Each law is a function ``law(geometry, parameters) -> f_r`` that returns the bidirectional
reflectance distribution function (BRDF, 1/sr) of facets that are lit and visible. The flux of a
facet at unit distance under unit irradiance is A f_r μ₀ μ. `LAWS` lists all laws with their
parameters and ranges.

The reflectances have the same meaning in every law. The papers weight a diffuse part of reflectance
ρ with d and a specular part of reflectance F₀ (at normal incidence) with s = 1 − d. In most laws
only the products are identifiable, so each product is a single parameter:

    r_diff = d ρ (Hinks' R_diff)        r_spec = s F₀ (Hinks' R_spec)

Linares' α = s F₀ A, the albedo-area of a "non-lambertian" facet, is r_diff times its area here.
Every law in this file is reciprocal: Sun and observer can be exchanged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Literal, NamedTuple

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.photometry import phase_law

SatelliteLaw = Literal[
    "ashikhmin-shirley",
    "ashikhmin-shirley-distribution",
    "cook-torrance",
    "blinn-phong",
    "lambertian",
    "non-lambertian",
]  # of artificial surfaces; r_diff + r_spec is the total reflectance
type Parameters = Mapping[str, jax.Array | float]


class Geometry(NamedTuple):
    """Geometry of facets that are lit and visible, the input of a law.

    Attributes
    ----------
    mu0, mu : (T, N)
        Cosines of incidence and of view, > 0.
    mu_h : (T, N)
        n·h, cosine between normal and half vector.
    h_u, h_v : (T, N) or None
        Projections of the half vector on the facet's u and v axes; None without these axes.
    c : (T, 1)
        o·h = s·h, cosine of half the phase angle.
    phase : (T, 1) rad
        Angle Sun-object-observer.
    """

    mu0: jax.Array
    mu: jax.Array
    mu_h: jax.Array
    h_u: jax.Array | None
    h_v: jax.Array | None
    c: jax.Array
    phase: jax.Array


# A facet with a cosine of incidence or of view below this value counts as dark: far below the
# sensitivity of a light curve, and high enough that no law overflows.
GRAZING = 1e-12


def geometry(
    sun_body: jax.Array,
    obs_body: jax.Array,
    normals: jax.Array,
    u_axes: jax.Array | None = None,
) -> tuple[Geometry, jax.Array]:
    """Angles between facets, Sun and observer, and which facets are both lit and visible.

    For other facets every entry is that of a facet lit and viewed face-on. Laws and their
    derivatives therefore remain finite, and the caller masks the result.

    Parameters
    ----------
    sun_body, obs_body : (T, 3)
        Unit vectors to Sun and observer, body frame.
    normals : (N, 3)
        Outward unit normals, body frame.
    u_axes : (N, 3) or None
        Unit vectors in the plane of each facet; v = n × u.

    Returns
    -------
    Geometry
    lit : (T, N) bool
        Lit and visible.
    """
    mu0, mu = sun_body @ normals.T, obs_body @ normals.T
    lit = (mu0 > GRAZING) & (mu > GRAZING)
    c, phase = half_phase(sun_body, obs_body)
    c, phase = c[:, None], phase[:, None]
    bisector = (sun_body + obs_body) / (2.0 * c)  # |s + o| = 2c
    h_u = h_v = None
    if u_axes is not None:
        h_u = jnp.where(lit, bisector @ u_axes.T, 0.0)
        h_v = jnp.where(lit, bisector @ jnp.cross(normals, u_axes).T, 0.0)
    angles = Geometry(
        mu0=jnp.where(lit, mu0, 1.0),
        mu=jnp.where(lit, mu, 1.0),
        mu_h=jnp.where(lit, (mu0 + mu) / (2.0 * c), 1.0),
        h_u=h_u,
        h_v=h_v,
        c=c,
        phase=phase,
    )
    return angles, lit


def half_phase(sun: jax.Array, obs: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Cosine of half the phase angle, and the phase angle (rad), of unit vectors (T, 3).

    Exact to rounding at every angle (no arccos), with finite derivatives at 0 and π.
    """

    def length(x: jax.Array) -> jax.Array:
        square = jnp.sum(x**2, axis=-1)
        tiny = square < 1e-24
        return jnp.where(tiny, 1e-12, jnp.sqrt(jnp.where(tiny, 1.0, square)))

    plus, minus = length(sun + obs), length(sun - obs)
    return 0.5 * plus, 2.0 * jnp.arctan2(minus, plus)


def lambertian(geom: Geometry, p: Parameters) -> jax.Array:
    """f_r = r_diff/π: equally bright in all directions.

    References
    ----------
    Linares & Crassidis, table 1, with d counted once.
    """
    return p["r_diff"] / jnp.pi * jnp.ones_like(geom.mu0)


def non_lambertian(geom: Geometry, p: Parameters) -> jax.Array:
    """f_r = (r_diff/π) [1 − (1 − μ₀/2)⁵] [1 − (1 − μ/2)⁵].

    References
    ----------
    Linares & Crassidis, eqs. (4), (5); table 1 omits the factor 1/π.
    """
    return p["r_diff"] / jnp.pi * shoulder(geom.mu0) * shoulder(geom.mu)


def ashikhmin_shirley(geom: Geometry, p: Parameters) -> jax.Array:
    """Ashikhmin-Shirley as in the 2000 report: specular denominator c·max(μ₀, μ).

    f_r = √((n_u+1)(n_v+1))/(8π) F (n·h)^z / (c max(μ₀, μ)) + diffuse part,
    F = r_spec + (1 − r_spec)(1 − c)⁵,  z = n_u cos²β + n_v sin²β,
    with β the angle in the facet's plane between its u axis and the half vector.

    References
    ----------
    Linares & Crassidis, table 1, with β as in Hinks et al. 2013, eq. (11); Ashikhmin & Shirley
    2000, UUCS-00-014.
    """
    return _as_specular(geom, p) / (geom.c * jnp.maximum(geom.mu0, geom.mu)) + _as_diffuse(geom, p)


def ashikhmin_shirley_distribution(geom: Geometry, p: Parameters) -> jax.Array:
    """Ashikhmin-Shirley in the distribution-based form: denominator μ₀ + μ − μ₀μ.

    Everything else is as in `ashikhmin_shirley`. Away from normal incidence it reflects far less: a
    sharp lobe at 60° incidence contains a third of the light of the other form.

    References
    ----------
    Hinks, Linares & Crassidis 2013, eqs. (6)-(13); Wang et al. 2025, eqs. (2)-(6).
    """
    return _as_specular(geom, p) / (geom.mu0 + geom.mu - geom.mu0 * geom.mu) + _as_diffuse(geom, p)


def cook_torrance(geom: Geometry, p: Parameters) -> jax.Array:
    """Cook-Torrance: mirror-like microfacets with Beckmann-distributed slopes, on a Lambertian.

    f_r = r_diff/π + s D G F/(4 μ₀ μ),  D = exp(−tan²ψ/m²)/(π m² cos⁴ψ),  cos ψ = n·h,
    G = min{1, 2(n·h)μ/c, 2(n·h)μ₀/c}, and F Fresnel's reflectance for the refractive index
    n = (1+√F₀)/(1−√F₀): F = (g−c)²/(2(g+c)²) {1 + [c(g+c)−1]²/[c(g−c)+1]²}, g² = n² + c² − 1.

    s = 1 − r_diff and F₀ = r_spec/s correspond to the paper's d + s = 1 with a lossless diffuse
    part, so energy is conserved if r_diff + r_spec ≤ 1.

    References
    ----------
    Linares & Crassidis, table 1 and below (D and g are misprinted there); Cook & Torrance 1982.
    """
    s = 1.0 - jnp.asarray(p["r_diff"])
    f0 = jnp.clip(p["r_spec"] / jnp.maximum(s, 1e-9), 1e-12, 1.0 - 1e-9)
    fresnel = _fresnel(geom.c, f0)
    cos2 = geom.mu_h**2
    slope2 = jnp.square(jnp.asarray(p["m"]))
    tan2 = jnp.maximum(1.0 - cos2, 0.0) / jnp.maximum(cos2, 1e-40)
    lobe = jnp.exp(-tan2 / slope2) / (jnp.pi * slope2 * jnp.maximum(cos2**2, 1e-40))
    shadow = jnp.minimum(1.0, 2.0 * geom.mu_h * jnp.minimum(geom.mu0, geom.mu) / geom.c)
    return p["r_diff"] / jnp.pi + s * lobe * shadow * fresnel / (4.0 * geom.mu0 * geom.mu)


def blinn_phong(geom: Geometry, p: Parameters) -> jax.Array:
    """Blinn-Phong, normalised to reflect r_diff + r_spec at normal incidence.

    f_r = r_diff/π + r_spec (n+2)(n+4) / (8π(n + 2^(−n/2))) (n·h)ⁿ.

    References
    ----------
    Linares & Crassidis, table 1, which omits the power n.
    """
    n = jnp.asarray(p["n"])
    scale = (n + 2.0) * (n + 4.0) / (8.0 * jnp.pi * (n + 2.0 ** (-0.5 * n)))
    return p["r_diff"] / jnp.pi + p["r_spec"] * scale * jnp.exp(n * jnp.log(geom.mu_h))


def lommel_seeliger_lambert(geom: Geometry, p: Parameters) -> jax.Array:
    """Lommel-Seeliger and Lambert with a phase law, as in asteroid light-curve inversion.

    f_r = w/(4π) P(phase) [1/(μ₀+μ) + c],  P = a exp(−phase/d) + k phase + 1,
    so that A f_r μ₀ μ = (w A/4π) P [μ₀μ/(μ₀+μ) + c μ₀μ]; w is the single-scattering albedo.

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, Icarus 153, 37; the law used for the models in DAMIT.
    """
    law = phase_law(geom.phase, p["a"], p["d"], p["k"])
    return p["w"] / (4.0 * jnp.pi) * law * (1.0 / (geom.mu0 + geom.mu) + p["c"])


def shoulder(x: jax.Array) -> jax.Array:
    """1 − (1 − x/2)⁵ by multiplication."""
    y = 1.0 - 0.5 * x
    y2 = y * y
    return 1.0 - y2 * y2 * y


def _as_diffuse(geom: Geometry, p: Parameters) -> jax.Array:
    weight = 28.0 / (23.0 * jnp.pi) * p["r_diff"] * (1.0 - jnp.asarray(p["r_spec"]))
    return weight * shoulder(geom.mu0) * shoulder(geom.mu)


def _as_specular(geom: Geometry, p: Parameters) -> jax.Array:
    """√((n_u+1)(n_v+1))/(8π) F (n·h)^z, the numerator of both forms.

    With cos²β = h_u²/(1 − (n·h)²), z ln(n·h) = n_v ln(n·h) + (n_u − n_v) h_u² L,
    L = ln(n·h)/(1 − (n·h)²): smooth at h = n, and independent of β if n_u = n_v.
    """
    nu = jnp.asarray(p["nu"])
    nv = jnp.asarray(p["nv"]) if "nv" in p else nu
    log_lobe = nv * jnp.log(geom.mu_h)
    if geom.h_u is not None:
        log_lobe += (nu - nv) * geom.h_u**2 * log_over_sin2(geom.mu_h)
    elif nv is not nu and p["nv"] is not p["nu"]:
        raise ValueError("nu and nv are both given, so facets need u_axes; give nu alone if equal")
    x = 1.0 - geom.c
    x2 = x * x
    fresnel = p["r_spec"] + (1.0 - jnp.asarray(p["r_spec"])) * x2 * x2 * x  # Schlick
    return jnp.sqrt((nu + 1.0) * (nv + 1.0)) / (8.0 * jnp.pi) * fresnel * jnp.exp(log_lobe)


def log_over_sin2(x: jax.Array) -> jax.Array:
    """ln x/(1 − x²), with the limit −1/2 at x = 1."""
    e = 1.0 - x
    near = jnp.abs(e) < 1e-4
    far_x = jnp.where(near, 0.5, x)
    series = -(1.0 + e * (1 / 2 + e * (1 / 3 + e / 4))) / (2.0 - e)
    return jnp.where(near, series, jnp.log(far_x) / (1.0 - far_x**2))


def _fresnel(c: jax.Array, f0: jax.Array) -> jax.Array:
    """Unpolarised reflectance of a dielectric with normal reflectance f0 at cos(incidence) = c."""
    root = jnp.sqrt(f0)
    n = (1.0 + root) / (1.0 - root)
    g = jnp.sqrt(n**2 + c**2 - 1.0)
    ratio = (c * (g + c) - 1.0) / (c * (g - c) + 1.0)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ratio**2)


class Parameter(NamedTuple):
    """Range and meaning of a parameter of a law; without a `default` (None) it is required."""

    lower: float
    upper: float
    meaning: str
    default: float | None = None


# Parameters that are fractions of the incident light; at these values area is albedo-area.
REFLECTANCES = {"r_diff": 1.0, "r_spec": 1.0, "w": 4.0 * math.pi}


class Law(NamedTuple):
    """A reflectance law with the properties used by models, scenarios and the command line.

    If `sum_to_one` is true, energy conservation requires r_diff + r_spec ≤ 1; for the other laws
    the bounds are sufficient. If `diffuse` is true, f_r is a factor per facet times the kernel of
    the same name in `brightness.flux`. If `layered` is true, the diffuse part is proportional to
    r_diff (1 − r_spec). If `multilinear` is true, f_r is linear in each of its `REFLECTANCES`.
    """

    brdf: Callable[[Geometry, Parameters], jax.Array]
    parameters: dict[str, Parameter]
    sum_to_one: bool = False
    diffuse: bool = False
    layered: bool = False
    multilinear: bool = True


_R_DIFF = Parameter(0.0, 1.0, "diffuse reflectance d·ρ")
_R_SPEC = Parameter(0.0, 1.0, "specular reflectance at normal incidence s·F₀")
_AS = {
    "r_diff": _R_DIFF,
    "r_spec": _R_SPEC,
    "nu": Parameter(0.0, 1e6, "exponent of the lobe along the facet's u axis"),
    "nv": Parameter(0.0, 1e6, "exponent along its v axis; the same as nu when absent"),
}

LAWS: dict[str, Law] = {
    "lambertian": Law(lambertian, {"r_diff": _R_DIFF}, diffuse=True),
    "non-lambertian": Law(non_lambertian, {"r_diff": _R_DIFF}, diffuse=True),
    "ashikhmin-shirley": Law(ashikhmin_shirley, _AS, layered=True),
    "ashikhmin-shirley-distribution": Law(ashikhmin_shirley_distribution, _AS, layered=True),
    "cook-torrance": Law(
        cook_torrance,
        {"r_diff": _R_DIFF, "r_spec": _R_SPEC, "m": Parameter(1e-3, 1.0, "rms slope")},
        sum_to_one=True,
        multilinear=False,
    ),
    "blinn-phong": Law(
        blinn_phong,
        {"r_diff": _R_DIFF, "r_spec": _R_SPEC, "n": Parameter(0.0, 1e6, "exponent of the lobe")},
        sum_to_one=True,
    ),
    "lommel-seeliger-lambert": Law(
        lommel_seeliger_lambert,
        {
            "w": Parameter(0.0, 1.0, "single-scattering albedo"),
            "a": Parameter(0.0, 1.0, "amplitude of the opposition surge", 0.0),
            "d": Parameter(1e-3, 1.0, "width of the opposition surge, rad", 0.1),
            "k": Parameter(-1 / 3.15, 0.0, "slope of the phase law, 1/rad", 0.0),
            "c": Parameter(0.0, 1.0, "weight of the Lambert term", 0.1),
        },
        diffuse=True,
    ),
}


def get_law(name: str) -> Law:
    """The law of that name; if there is none, the one-line error lists all laws."""
    try:
        return LAWS[name]
    except KeyError:
        raise ValueError(f"unknown law {name!r}; available: {', '.join(LAWS)}") from None
