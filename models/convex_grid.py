"""A convex body on a fixed grid of normals, spinning about a fixed pole: the asteroid model."""

from functools import lru_cache

import numpy as np
import numpyro
import numpyro.distributions as dist

from lcbayes import noise, priors
from lcbayes._jax import jnp
from lcbayes.epochs import Epochs
from lcbayes.physics import attitude, brightness, facets

SUMMARY = "smooth convex body on a grid of normals, principal-axis spin: pole, period, shape"
HOUR = 3600.0


@lru_cache
def grid(n_facets: int, degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (N, 3), harmonics (N, (L+1)² − 1) without the constant, and their degrees."""
    normals = facets.grid(n_facets)
    harmonics = facets.spherical_harmonics(normals, degree)[:, 1:]
    degrees = np.concatenate([np.full(2 * l + 1, l) for l in range(1, degree + 1)])
    return normals, harmonics, degrees


def model(
    data: Epochs,
    *,
    period: float,
    period_sd: float = 0.0,
    n_facets: int = 300,
    degree: int = 6,
    closure_sd: float = 0.02,
    noise_law: str = "gaussian",
    link: str = "exp",
    soft: float = 0.2,
    power: float = 2.0,
):
    """ln α(u) = smooth field on the sphere; f(t) = Σ αᵢ [μ₀μ/(μ₀+μ) + c μ₀μ]."""
    normals, harmonics, degrees = grid(n_facets, degree)
    middle = 0.5 * (data.t[0] + data.t[-1])
    pole = priors.directions("pole", 1)[0]
    lon, lat = jnp.arctan2(pole[1], pole[0]), jnp.arcsin(pole[2])
    numpyro.deterministic("pole_lon_deg", jnp.mod(jnp.rad2deg(lon), 360.0))
    numpyro.deterministic("pole_lat_deg", jnp.rad2deg(lat))
    span = data.t[-1] - data.t[0]
    alias = (period * HOUR) ** 2 / (2 * span)
    shift = numpyro.sample("period_shift", dist.Normal(0.0, 1.0))
    period_s = period * HOUR + shift * alias
    numpyro.deterministic("period_h", period_s / HOUR)
    rotation = attitude.principal_axis(data.t - middle, lon, lat, period_s, 0.0)
    roughness = jnp.exp(numpyro.sample("log_roughness", dist.Normal(jnp.log(2.0), 0.7)))
    coefficients = numpyro.sample(
        "coefficients", dist.Normal(0.0, roughness * (2 / (degrees + 1)) ** power).to_event(1)
    )
    if link == "exp":
        area = jnp.exp(harmonics @ coefficients)
    elif link == "evenodd":
        odd = degrees % 2 == 1
        e = harmonics[:, ~odd] @ coefficients[~odd]
        o = harmonics[:, odd] @ coefficients[odd]
        area = 2 * jnp.exp(e) / (1 + jnp.exp(-2 * o))
    elif link == "softplus":
        f = 1 + harmonics @ coefficients
        area = soft * jnp.logaddexp(f / soft, 0.0)
    elif link == "hyper":
        f = 1 + harmonics @ coefficients
        area = 0.5 * (f + jnp.sqrt(f**2 + soft**2))
    elif link == "square":
        area = (1 + harmonics @ coefficients) ** 2
    area = area * (1 / (0.5 * np.pi)) * (4 * np.pi / n_facets)
    numpyro.deterministic("albedo_area", area)
    closure = normals.T @ area / jnp.sum(area)
    numpyro.factor("closure", dist.Normal(0.0, closure_sd).log_prob(closure).sum())
    c = jnp.exp(numpyro.sample("log_c", dist.Normal(jnp.log(0.1), 0.5)))
    sun, obs = attitude.to_body(rotation, data.sun), attitude.to_body(rotation, data.obs)
    flux = brightness.flux(sun, obs, normals, area, "lommel-seeliger-lambert", c)
    noise.observe(data, flux, noise_law)
