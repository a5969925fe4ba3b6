"""Small faults of calibration, clocks and motion as parameters with priors.

Each is a sampled parameter in units of its prior standard deviation, so that its effect on the
brightness is exact, also where it is not linear, and for every noise law. A fault is modelled only
where the data can contain it: zero points if there are several calibrations, clocks if there are
several observers, a change of rate if there are several passes. Without the structure, or with a
standard deviation of zero, the model is unchanged.
"""

from __future__ import annotations

import numpyro
import numpyro.distributions as dist

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import Rotation

ZERO_POINT_SD = 0.03  # mag; between sites and nights of well-calibrated photometry
CLOCK_SD = 0.3  # s; between cameras whose clocks are set by the network
RATE_DRIFT_SD = 0.01  # relative change of the rate of rotation over the light curve
NONE = {"zero_point_sd": 0.0, "clock_sd": 0.0, "rate_drift_sd": 0.0}
"""Options of a model without these parameters, for its search."""
UNITS = {"zero_point": "mag", "clock_offset": "s", "rate_drift": ""}


def dimming(data: Epochs, sd: float = ZERO_POINT_SD) -> jax.Array | float:
    """Factor (T,) on the flux from the zero points, 10^(−0.4 z); 1 if there are none.

    The zero points z of the G calibrations (``zero_point``, mag, positive if fainter) are
    independent Normal(0, sd). That includes their mean, so the size of the body is as uncertain as
    the calibration. A point of any other calibration has a zero point drawn from the prior.
    """
    if not _on("zero_point_sd", sd) or not data.n_calibrations:
        return 1.0
    offset = _offsets("zero_point", data.n_calibrations, sd)
    return 10.0 ** (-0.4 * jnp.where(data.calibration < 0, 0.0, offset[data.calibration]))


def clock(data: Epochs, sd: float = CLOCK_SD) -> jax.Array | None:
    """Time (T,) s to be added to the recorded times; None if it is not modelled.

    The ``clock_offset`` of each observer is Normal(0, sd), independent of the others; a clock that
    is ahead has a negative offset. A common offset is included: it changes the orientation of the
    body at t = 0.
    """
    if not _on("clock_sd", sd) or data.n_observers < 2:
        return None
    return _offsets("clock_offset", data.n_observers, sd)[data.observer]


def rate_drift(data: Epochs, sd: float = RATE_DRIFT_SD) -> jax.Array | None:
    """Relative change ε ~ Normal(0, sd) of the rate over the light curve; None if not modelled.

    The body rotates as at constant rate at the time t + ε [(t − t_m)² − t_m²]/2T, with T the length
    and t_m the middle of the light curve. Its rate is ω (1 + ε (t − t_m)/T): ω is the mean.
    """
    if not _on("rate_drift_sd", sd) or data.n_segments < 2:
        return None
    unit = jnp.asarray(numpyro.sample("rate_drift_unit", dist.Normal(0.0, 1.0)))
    return jnp.asarray(numpyro.deterministic("rate_drift", sd * unit))


def disturbed(
    turned: Rotation,
    data: Epochs,
    clock_sd: float = CLOCK_SD,
    rate_drift_sd: float = RATE_DRIFT_SD,
) -> Rotation:
    """The rotation of a body with offsets of the clocks and a change of rate.

    Parameters
    ----------
    turned : callable
        ``turned(t, *vectors)``, from `lcbayes.modelling.priors.spin`.
    data : Epochs

    Returns
    -------
    callable
        ``to_body(t, sun, obs)`` for recorded times t. The directions are those of the recorded
        times, and are moved to the true ones at the rates of ``data``.
    """
    late, drift = clock(data, clock_sd), rate_drift(data, rate_drift_sd)
    if late is None and drift is None:
        return turned

    def to_body(t: jax.Array, sun: jax.Array, obs: jax.Array) -> tuple[jax.Array, ...]:
        if late is not None:
            t = t + late
            sun, obs = (
                _moved(v, late[:, None] * rate)
                for v, rate in ((sun, data.sun_rate), (obs, data.obs_rate))
            )
        if drift is not None:
            middle = data.t_middle
            t = t + drift * ((t - middle) ** 2 - middle**2) / (2.0 * data.t_span)
        return turned(t, sun, obs)

    return to_body


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
