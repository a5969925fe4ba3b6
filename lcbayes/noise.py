"""From the flux a model predicts to the brightness that was recorded: scale, units, noise."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro import handlers

from lcbayes._jax import jax, jnp
from lcbayes.epochs import Epochs

OBSERVED = "brightness"
FLUX = "flux"
Law = Literal["gaussian", "student-t"]
STUDENT_T_DF = 4.0
NOISE_SPREAD = 0.25  # sd of the logarithm of a curve's noise about the typical one


def curve_scales(data: Epochs, flux: jax.Array, log_sd: float = 1.0) -> jax.Array:
    """The factor of each curve, (C,): log-normal where it is unknown, 1 where it is known.

    What is sampled is the curve's mean brightness over its observed mean, ``log_level``, and the
    scale follows from the predicted ``flux``. The two differ by a shift, so the posterior is that
    of a wide log-normal scale; but the level is held by the data to σ/√n whatever the shape does,
    while the scale alone would have to follow every change of the body's size along a curve.
    """
    free = np.flatnonzero(data.free_scale)
    n_curves = len(data.free_scale)
    if not free.size:
        return jnp.ones(n_curves)
    log_level = numpyro.sample(
        "log_level", dist.Normal(0.0, log_sd).expand([free.size]).to_event(1)
    )
    total = jnp.zeros(n_curves).at[data.curve].add(flux)
    count = jnp.zeros(n_curves).at[data.curve].add(1.0)
    mean = jnp.maximum(total / count, 1e-12)[free]
    scale = jnp.ones(n_curves).at[free].set(jnp.exp(log_level) / mean)
    numpyro.deterministic("scale", scale)
    return scale


def expected(data: Epochs, flux: jax.Array, scale: jax.Array) -> jax.Array:
    """Noise-free brightness in the unit of the data, (T,).

    ``flux`` is at unit distance under unit irradiance. A magnitude is
    m = m_sun − 2.5 log₁₀(flux · scale / r²).
    """
    linear = flux * data.dilution * (scale * data.level)[data.curve]
    if data.kind == "flux":
        return linear
    # 10⁻¹² of the curve's level is 30 mag down: dark, but with a finite magnitude and gradient.
    floor = 1e-12 * (data.dilution * data.level[data.curve])
    return data.zero_point - 2.5 * jnp.log10(jnp.maximum(linear, 0.0) + floor)


def noise_levels(data: Epochs) -> jax.Array:
    """Noise of each curve, (C,), where the file gives no errors.

    ``sigma`` ~ LogNormal(ln 0.03, 1) is the typical level: relative to a curve's mean for fluxes,
    in magnitudes for magnitudes. Curves come from different nights and telescopes, so with more
    than one each has its own, ``noise`` = sigma · LogNormal(0, 0.25): otherwise the noisiest of
    them would set the weight of all.
    """
    n_curves = len(data.free_scale)
    sigma = jnp.exp(numpyro.sample("log_sigma", dist.Normal(np.log(0.03), 1.0)))
    numpyro.deterministic("sigma", sigma)
    if n_curves == 1:
        return sigma[None]
    spread = dist.Normal(0.0, 1.0).expand([n_curves]).to_event(1)
    noise = sigma * jnp.exp(NOISE_SPREAD * jnp.asarray(numpyro.sample("noise_unit", spread)))
    numpyro.deterministic("noise", noise)
    return noise


def observe(data: Epochs, flux: jax.Array, noise: Law = "gaussian") -> None:
    """Condition on the recorded brightness (site ``brightness``).

    Errors that the file gives are taken as they are; where it gives none they are inferred, see
    `noise_levels`. The likelihood is raised to the power ``data.information``.

    Parameters
    ----------
    data : Epochs
    flux : (T,)
        Predicted, unit distance and irradiance.
    noise : "gaussian" or "student-t"
        Student-t has 4 degrees of freedom: one point in fifty may lie beyond 3.7 scales.

    References
    ----------
    Linares & Crassidis, eqs. (1), (10), the normalisation to the power m.
    """
    flux = jnp.asarray(numpyro.deterministic(FLUX, flux))
    scale = curve_scales(data, flux)
    mean = expected(data, flux, scale)
    numpyro.deterministic("expected", mean)
    sd = data.error if data.has_error else (noise_levels(data) * data.noise_unit)[data.curve]
    if noise == "gaussian":
        likelihood = dist.Normal(mean, sd)
    elif noise == "student-t":
        likelihood = dist.StudentT(STUDENT_T_DF, mean, sd)
    else:
        raise ValueError(f"unknown noise {noise!r}; available: gaussian, student-t")
    with handlers.scale(scale=data.information):
        numpyro.sample(OBSERVED, likelihood, obs=data.brightness)
