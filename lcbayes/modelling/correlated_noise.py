"""Correlated noise: an Ornstein-Uhlenbeck process in addition to independent errors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.pass_effects import Passes

MEDIAN_SD = 0.02  # of the process: mag, or relative to a curve's mean flux
STEPS, LOG_SD = (
    10.0,
    1.0,
)  # prior median of its time scale in steps between points; sd of logarithms


class Innovations(NamedTuple):
    """Residuals, responses (T,) and columns (K, T) given earlier points, and the standard deviation
    of the residuals."""

    miss: jax.Array
    response: jax.Array
    columns: jax.Array | None
    sd: jax.Array


def ornstein_uhlenbeck(
    data: Epochs,
    miss: jax.Array,
    response: jax.Array,
    sd: jax.Array,
    columns: jax.Array | None = None,
) -> Innovations:
    """Residuals given the earlier ones of the same pass, with correlated noise of unknown size.

    Sites ``correlated_sd`` ~ LogNormal(ln 0.02, 1), in magnitudes for magnitudes and relative to a
    curve's mean for fluxes, and ``correlated_time_s`` ~ LogNormal(ln 10 typical steps, 1).
    """
    log_sd = numpyro.sample("log_correlated_sd", dist.Normal(np.log(MEDIAN_SD), LOG_SD))
    median = jnp.log(STEPS * data.t_step)
    log_time = numpyro.sample("log_correlated_time_s", dist.Normal(median, LOG_SD))
    size = jnp.asarray(numpyro.deterministic("correlated_sd", jnp.exp(log_sd)))
    time = jnp.asarray(numpyro.deterministic("correlated_time_s", jnp.exp(log_time)))
    unit = data.noise_unit[data.curve]
    values = jnp.stack([miss, response, *([] if columns is None else columns)])
    left, width = innovations(data.segments, data.t, values / unit, sd / unit, size, time)
    miss, response, *rest = left * unit
    return Innovations(miss, response, jnp.stack(rest) if rest else None, width * unit)


def innovations(
    passes: Passes, t: jax.Array, values: jax.Array, sd: jax.Array, size: jax.Array, time: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Values (K, T) minus their means given earlier points of the pass, and the sd (T,) of these.

    The noise of a pass has the covariance diag σ² + a² exp(−|t − t'|/τ). With the state x of the
    process, a Kalman filter predicts x⁻ = F x⁺ and P⁻ = F² P⁺ + a² (1 − F²), F = exp(−Δt/τ), and
    updates with the gain P⁻/(P⁻ + σ²). Both recursions are associative, in P⁺ as a product of
    2 × 2 matrices and in x⁺ as a product of affine maps. They are evaluated in O(log T) parallel
    steps of O(T).

    Parameters
    ----------
    passes : Passes
    t, sd : (T,)
        Times, s, and standard deviations of the independent errors.
    values : (K, T)
    size, time : scalar
        a and τ.

    References
    ----------
    Kelly et al. 2014, ApJ 788, 33, sec. 3 (Kalman filter of such noise); Särkkä & García-Fernández
    2021, IEEE Trans. Autom. Control 66, 299 (associative scans).
    """
    order = passes.order
    start = jnp.arange(order.size) == passes.first
    times, variance, y = t[order], sd[order] ** 2, values[:, order]
    step = jnp.diff(times, prepend=times[:1])
    keep = jnp.where(start, 0.0, jnp.exp(-jnp.where(start, 0.0, step) / time))
    fresh = size**2 * (1.0 - keep**2)
    matrices = jnp.stack([variance * keep**2, variance * fresh, keep**2, fresh + variance], axis=-1)
    product = jax.lax.associative_scan(_multiplied, matrices)
    after = product[:, 1] / product[:, 3]
    before = keep**2 * _shifted(after) + fresh
    total = before + variance
    gain = before / total
    _, state = jax.lax.associative_scan(
        lambda one, two: (two[0] * one[0], two[0] * one[1] + two[1]),
        (jnp.broadcast_to((1.0 - gain) * keep, y.shape), gain * y),
        axis=1,
    )
    left = y - keep * _shifted(state)
    return (
        jnp.zeros_like(values).at[:, order].set(left),
        jnp.zeros_like(sd).at[order].set(jnp.sqrt(total)),
    )


def _multiplied(first: jax.Array, then: jax.Array) -> jax.Array:
    """The matrix product then · first of 2 × 2 matrices (..., 4), up to a factor."""
    a, b, c, d = (first[..., k] for k in range(4))
    e, f, g, h = (then[..., k] for k in range(4))
    product = jnp.stack([e * a + f * c, e * b + f * d, g * a + h * c, g * b + h * d], axis=-1)
    return product / jnp.sum(product, axis=-1, keepdims=True)


def _shifted(x: jax.Array) -> jax.Array:
    """The previous values along the last axis, from 0."""
    return jnp.concatenate([jnp.zeros_like(x[..., :1]), x[..., :-1]], axis=-1)
