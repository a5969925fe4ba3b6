"""Small faults of calibration, clocks and motion as parameters with priors.

Zero points act linearly and are integrated out. Offsets of clocks and a change of rate are sampled
in units of their prior standard deviations, so that their effect is exact. A fault is modelled only
where the data can contain it: zero points if there are several calibrations, clocks if there are
several observers, a change of rate if there are several passes. Without the structure, or with a
standard deviation of zero, the model is unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import priors
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import KnownSpin
from lcbayes.modelling.priors import Rotation

ZERO_POINT_SD = 0.03  # mag; between sites and nights of well-calibrated photometry
CLOCK_SD = 0.3  # s; between cameras whose clocks are set by the network
RATE_DRIFT_SD = 0.01  # relative change of the rate of rotation over the light curve
MAX_DRIFT_PHASE = 1.0  # rad, in the middle of the light curve
UNMODELLED = {"clock_sd": 0.0, "rate_drift_sd": 0.0}
"""Options of a model without these parameters, for the search for solutions."""
UNITS = {"zero_point": "mag", "clock_offset": "s", "rate_drift": ""}


def zero_points(
    data: Epochs, mean: jax.Array, sd: jax.Array, h: jax.Array, prior_sd: float
) -> tuple[jax.Array, jax.Array]:
    """Mean and standard deviation (T,) of each point given the earlier ones of its calibration.

    The points of a calibration share a zero point z ~ Normal(0, s²), mag, positive if fainter. To
    first order y_k ~ N(m_k + h_k z, σ_k²), with h = 1 for magnitudes and −0.4 ln 10 m for fluxes.
    With z integrated out, the joint density of the points is N(m, diag σ² + s² h hᵀ), the product
    of

        y_k | y_1 … y_(k−1) ~ N(m_k + h_k v_k Σ_{j<k} h_j (y_j − m_j)/σ_j², σ_k² + h_k² v_k),
        1/v_k = 1/s² + Σ_{j<k} h_j²/σ_j².

    The zero points of the calibrations are independent. That includes their mean, so the size of
    the body is as uncertain as the calibration. Sites ``zero_point_mean`` and ``zero_point_sd``
    (G,) are those of z given all points, from which `drawn` draws z.

    Parameters
    ----------
    mean, sd : (T,)
        Predicted brightness without zero points, and the standard deviation of its errors, both
        given earlier points if the errors are correlated.
    h : (T,)
        `zero_point_response`, transformed in the same way.
    prior_sd : float
        s, mag.

    References
    ----------
    Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, sec. 2.7 (basis functions
    with Gaussian weights, integrated out).
    """
    if not _on("zero_point_sd", prior_sd) or not data.n_calibrations:
        return mean, sd
    groups = data.calibrated_together
    terms = jnp.stack([(h / sd) ** 2, h * (data.brightness - mean) / sd**2])
    before, weighted = groups.before(terms)
    v = 1.0 / (1.0 / prior_sd**2 + before)
    total = jnp.zeros((2, data.n_calibrations + 1)).at[:, data.calibration]
    total = total.add(data.information * terms)[:, :-1]
    whole = 1.0 / (1.0 / prior_sd**2 + total[0])
    numpyro.deterministic("zero_point_mean", whole * total[1])
    numpyro.deterministic("zero_point_sd", jnp.sqrt(whole))
    return mean + h * v * weighted, jnp.sqrt(sd**2 + h**2 * v)


def zero_point_response(data: Epochs, mean: jax.Array) -> jax.Array:
    """Change of the brightness (T,) per magnitude of its zero point; 0 if it has none."""
    each = jnp.ones_like(mean) if data.kind == "mag" else -0.4 * jnp.log(10.0) * mean
    return jnp.where(data.calibration < 0, 0.0, each)


def drawn(draws: Mapping[str, NDArray], rng: np.random.Generator) -> dict[str, NDArray]:
    """Draws of the sites of a model, with ``zero_point`` in place of its mean and sd."""
    found = {k: v for k, v in draws.items() if not k.startswith("zero_point_")}
    if "zero_point_mean" in draws:
        mean, sd = (np.asarray(draws[f"zero_point_{k}"]) for k in ("mean", "sd"))
        found["zero_point"] = mean + sd * rng.standard_normal(mean.shape)
    return found


def clock(data: Epochs, sd: float = CLOCK_SD) -> jax.Array | None:
    """Time (T,) s to be added to the recorded times; None if it is not modelled.

    The ``clock_offset`` of each observer is Normal(0, sd), independent of the others; a clock that
    is ahead has a negative offset. A common offset is included: it changes the orientation of the
    body at t = 0.
    """
    if not _on("clock_sd", sd) or data.n_observers < 2:
        return None
    return _offsets("clock_offset", data.n_observers, sd)[data.observer]


def rate_drift(data: Epochs, rate: jax.Array, sd: float = RATE_DRIFT_SD) -> jax.Array | None:
    """Relative change ε of the rate (rad/s) over the light curve; None if not modelled.

    The body rotates as at constant rate at the time t + ε [(t − t_m)² − t_m²]/2T, with T the length
    and t_m the middle of the light curve. Its rate is ω (1 + ε (t − t_m)/T): ω is the mean. The
    phase in the middle moves by φ = ε ω T/8. A change that moves it by whole turns would make every
    count of turns between passes possible: ε is Normal of sd/√(1 + (sd ω T/8φ₀)²), φ₀ = 1 rad.
    """
    if not _on("rate_drift_sd", sd) or data.n_segments < 2:
        return None
    unit = jnp.asarray(numpyro.sample("rate_drift_unit", dist.Normal(0.0, 1.0)))
    phase = sd * rate * data.t_span / (8.0 * MAX_DRIFT_PHASE)
    return jnp.asarray(numpyro.deterministic("rate_drift", sd * unit / jnp.sqrt(1.0 + phase**2)))


def rotation(
    data: Epochs,
    spin: str,
    omega_sd: float,
    inertia_sd: float,
    clock_sd: float = CLOCK_SD,
    rate_drift_sd: float = RATE_DRIFT_SD,
    known: KnownSpin | None = None,
) -> Rotation:
    """The rotation of `modelling.priors.spin` with errors of clocks and a drift of the rate.

    The prior of ω is normal with sd ``omega_sd`` (rad/s), or that of what is known of the spin.

    Returns
    -------
    callable
        ``to_body(t, sun, obs)`` for recorded times t. The directions are those of the recorded
        times, and are moved to the true ones at the rates of ``data``.
    """
    prior = None
    if known is not None:
        known.check(spin)
        prior = known.prior(omega_sd, data)
    turned, rate = priors.spin(spin, omega_sd, inertia_sd, prior)
    if spin == "none":
        return turned
    late, drift = clock(data, clock_sd), rate_drift(data, rate, rate_drift_sd)
    if late is None and drift is None:
        return turned

    def to_body(t: jax.Array, sun: jax.Array, obs: jax.Array) -> tuple[jax.Array, ...]:
        if late is not None:
            t = t + late
            sun = _moved(sun, late[:, None] * data.sun_rate)
            obs = _moved(obs, late[:, None] * data.obs_rate)
        if drift is not None:
            middle = data.t_middle
            t = t + drift * ((t - middle) ** 2 - middle**2) / (2.0 * data.t_span)
        return turned(t, sun, obs)

    return to_body


def moved(data: Epochs, late: jax.Array | None) -> Epochs:
    """The data with the directions at the true times, ``late`` (T,) s after the recorded ones."""
    if late is None:
        return data
    sun, obs = (
        _moved(v, late[:, None] * rate)
        for v, rate in ((data.sun, data.sun_rate), (data.obs, data.obs_rate))
    )
    return replace(data, sun=sun, obs=obs)


def _moved(direction: jax.Array, step: jax.Array) -> jax.Array:
    moved = direction + step
    return moved / jnp.linalg.norm(moved, axis=-1, keepdims=True)


def _offsets(name: str, n: int, sd: float) -> jax.Array:
    """Offsets (n + 1,) ~ Normal(0, sd); the last is that of a member without data."""
    unit = dist.Normal(0.0, 1.0).expand([n + 1]).to_event(1)
    offset = sd * jnp.asarray(numpyro.sample(f"{name}_unit", unit))
    numpyro.deterministic(name, offset[:n])
    return offset


def _on(name: str, sd: float) -> bool:
    if not sd >= 0:
        raise InputError(f"{name} is {sd}; give a standard deviation > 0, or 0 for none")
    return sd > 0
