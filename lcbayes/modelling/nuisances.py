"""Small faults of calibration, clocks and motion as parameters with priors.

Zero points and small nutation act linearly and are integrated out. Offsets of clocks and a change
of rate are sampled in units of their prior standard deviations, so that their effect is exact. A
fault is modelled only where the data can contain it: zero points if there are several calibrations,
clocks if there are several observers, a change of rate if there are several passes. Without the
structure, or with a standard deviation of zero, the model is unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import nutation, priors
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import KnownSpin
from lcbayes.modelling.priors import Spin
from lcbayes.modelling.zero_points import modelled
from lcbayes.physics import photometry
from lcbayes.physics.attitude import rotations

CLOCK_SD = 0.3  # s; between cameras whose clocks are set by the network
CLOCK_TAIL = 0.7  # of `heavy_tailed`: one clock in a hundred is late by more than 4 sd
RATE_DRIFT_SD = 0.01  # relative change of the rate of rotation over the light curve
MAX_DRIFT_PHASE = 1.0  # rad, in the middle of the light curve
UNMODELLED = {
    "zero_point_spread": 0.0,
    "clock_sd": 0.0,
    "rate_drift_sd": 0.0,
    "nutation_sd": 0.0,
}
"""Options of a model without these parameters, for the search for solutions."""
OF_SERIES = "series_zero_point"
INTEGRATED_OUT = ("zero_point_", "nutation_mean", "nutation_root")
# beginnings of the names of the moments of what is integrated out, given the data


class Faults(NamedTuple):
    """Draws of what a model integrates out: zero points (..., G) and their parts of series (..., S)
    in mag, and nutation (..., nights, 4) in deg."""

    zero_point: Any
    of_series: Any
    nutation: Any


def jointly(sites: Mapping[str, Any], normal: Callable[[str], Any]) -> Faults:
    """Draws given the data: of the nutation, and of the zero points given what is drawn before.

    Parameters
    ----------
    sites : mapping
        Sites of the model; arrays of NumPy or JAX, with any leading axes.
    normal : callable
        Standard normal numbers of the shape of a named site.
    """
    zero_point = of_series = wobble = None
    if "nutation_mean" in sites:
        root = sites["nutation_root"]
        wobble = sites["nutation_mean"] + (root @ normal("nutation_mean")[..., None])[..., 0]
    if "zero_point_mean" in sites:
        mean = sites["zero_point_mean"]
        if wobble is not None:
            night = (sites["zero_point_night"][..., None] == np.arange(wobble.shape[-2])) * 1.0
            mean = mean - (sites["zero_point_slope"] * (night @ wobble)).sum(axis=-1)
        if "zero_point_series_mean" in sites:
            of_series = sites["zero_point_series_mean"]
            sd = sites["zero_point_series_sd"]
            of_series = of_series + sd * normal("zero_point_series_mean")
            own = sites["zero_point_series"][..., None] == np.arange(of_series.shape[-1])
            own = ((own * 1.0) @ of_series[..., None])[..., 0]
            mean = mean + (1.0 - sites["zero_point_share"]) * own
        zero_point = mean + sites["zero_point_sd"] * normal("zero_point_mean")
    return Faults(zero_point, of_series, wobble)


def drawn_jointly(sites: Mapping[str, jax.Array], key: jax.Array) -> Faults:
    """`jointly` with a key of JAX."""
    further = ("nutation_mean", "zero_point_series_mean")
    keys = {name: jax.random.fold_in(key, k) for k, name in enumerate(further, 1)}
    keys["zero_point_mean"] = key
    return jointly(sites, lambda name: jax.random.normal(keys[name], sites[name].shape))


def drawn(draws: Mapping[str, NDArray], rng: np.random.Generator) -> dict[str, NDArray]:
    """Draws of the sites of a model, with draws of what it integrates out in place of its moments.

    ``nutation_deg`` is the angle by which nutation turns the body, as a root mean square over a
    nutation period, in the night in which it is largest.
    """
    completed = {k: v for k, v in draws.items() if not k.startswith(INTEGRATED_OUT)}
    faults = jointly(draws, lambda name: rng.standard_normal(np.shape(draws[name])))
    if faults.zero_point is not None:
        completed["zero_point"] = faults.zero_point
    if faults.of_series is not None:
        completed[OF_SERIES] = faults.of_series
    if faults.nutation is not None:
        completed[nutation.AMOUNTS] = faults.nutation
        angle = np.sqrt(0.5 * np.sum(faults.nutation**2, axis=-1))
        completed["nutation_deg"] = angle.max(axis=-1)
    return completed


def clock_offsets(data: Epochs, sd: float = CLOCK_SD) -> jax.Array | None:
    """Offset of each observer and of any other, s; None if they are not modelled.

    The ``clock_offset`` of each observer is sd times a `heavy_tailed` normal number, independent of
    the others; a clock that is ahead has a negative offset. A common offset is included: it changes
    the orientation of the body at t = 0.
    """
    if not _clocks_differ(data, sd):
        return None
    normal = dist.Normal(0.0, 1.0).expand([data.n_observers + 1]).to_event(1)
    unit = jnp.asarray(numpyro.sample("clock_offset_unit", normal))
    offset = sd * heavy_tailed(unit)
    numpyro.deterministic("clock_offset", offset[:-1])  # the last has no data
    return offset


def _clocks_differ(data: Epochs, sd: float) -> bool:
    return modelled("clock_sd", sd) and data.n_observers > 1


def late(data: Epochs, offsets: jax.Array | None) -> jax.Array | None:
    """Time (T,) s to be added to the recorded times, of `clock_offsets`."""
    return None if offsets is None else offsets[data.observer]


def heavy_tailed(unit: Any) -> Any:
    """sinh(b u)/b, b = `CLOCK_TAIL`: near 0 as u, and large more often than a normal number.

    For a normal u it has Johnson's S_U distribution.

    References
    ----------
    Johnson 1949, Biometrika 36, 149.
    """
    return jnp.sinh(CLOCK_TAIL * unit) / CLOCK_TAIL


def normal_of(heavy: Any) -> Any:
    """The inverse of `heavy_tailed`."""
    return jnp.arcsinh(CLOCK_TAIL * heavy) / CLOCK_TAIL


class ClockDifferences(Transform):
    """(u₀, h₁ − h₀ …, u_K) ↔ (u₀, u₁ …, u_K), h the `heavy_tailed` value of u.

    The data fix how much the clocks of observers differ, and an offset common to all hardly. The
    last number, of any other observer, has no data.
    """

    domain = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    codomain = constraints.real_vector  # pyright: ignore[reportAssignmentType]

    def __call__(self, x: jax.Array) -> jax.Array:
        return x.at[1:-1].set(normal_of(x[1:-1] + heavy_tailed(x[0])))

    def _inverse(self, y: jax.Array) -> jax.Array:
        heavy = heavy_tailed(y[:-1])
        return y.at[1:-1].set(heavy[1:] - heavy[0])

    def log_abs_det_jacobian(self, x: jax.Array, y: jax.Array, intermediates=None) -> jax.Array:  # noqa: ARG002
        """Σ ln du/dh = −½ Σ ln (1 + b² h²), but for the first and the last."""
        heavy = heavy_tailed(y[1:-1])
        return -0.5 * jnp.sum(jnp.log1p((CLOCK_TAIL * heavy) ** 2))

    def tree_flatten(self):
        return (), ((), {})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ClockDifferences)

    def __hash__(self) -> int:
        return hash(ClockDifferences)


def clock_coordinates(data: Epochs, sd: float) -> dict[str, ClockDifferences]:
    """Coordinates of the sampler for `clock_offsets`, if they are modelled."""
    return {"clock_offset_unit": ClockDifferences()} if _clocks_differ(data, sd) else {}


def rate_drift(data: Epochs, rate: jax.Array, sd: float = RATE_DRIFT_SD) -> jax.Array | None:
    """Relative change ε of the rate (rad/s) over the light curve; None if not modelled.

    The body rotates as at constant rate at the time t + ε [(t − t_m)² − t_m²]/2T, with T the length
    and t_m the middle of the light curve. Its rate is ω (1 + ε (t − t_m)/T): ω is the mean. The
    phase in the middle moves by φ = ε ω T/8. A change that moves it by whole turns would make every
    count of turns between passes possible: ε is Normal of sd/√(1 + (sd ω T/8φ₀)²), φ₀ = 1 rad.
    """
    if not modelled("rate_drift_sd", sd) or data.n_segments < 2:
        return None
    unit = jnp.asarray(numpyro.sample("rate_drift_unit", dist.Normal(0.0, 1.0)))
    drift = unit * rate_drift_scale(data.t_span, rate, sd)
    return jnp.asarray(numpyro.deterministic("rate_drift", drift))


def rate_drift_scale(span: float | jax.Array, rate: Any, sd: float) -> jax.Array:
    """Prior standard deviation of `rate_drift` at rates (rad/s), over a time span (s)."""
    return sd / jnp.sqrt(1.0 + (sd * rate * span / (8.0 * MAX_DRIFT_PHASE)) ** 2)


@dataclass(frozen=True)
class Rotating:
    """The rotation of a body, with errors of clocks and a drift of the rate.

    Attributes
    ----------
    data : Epochs
    spin : Spin
        Rotation since ``origin``; ω is the mean if the rate drifts.
    late : (T,) s, optional
        To be added to the recorded times.
    drift : scalar, optional
        Relative change of the rate.
    origin : scalar, s
        True time at which body axes and inertial axes coincide; 0 by default.
    start : (3, 3), optional
        Attitude at t = 0, body to inertial, unless the axes coincide then.
    """

    data: Epochs
    spin: Spin
    late: jax.Array | None = None
    drift: jax.Array | None = None
    origin: jax.Array | float = 0.0
    start: jax.Array | None = None

    def __call__(self, t: jax.Array, sun: jax.Array, obs: jax.Array) -> tuple[jax.Array, ...]:
        """Body components of the directions at recorded times t.

        The directions are those of the recorded times. That to the observer is moved to the true
        time at the rate of ``data``, to first order: in 2 s it turns by 0.02 rad at most, which
        leaves its length right to 2e-4. The Sun moves by 1e-6 rad and is left where it is.
        """
        if self.late is None:
            return self.spin.to_body(self.time(t), sun, obs)
        # The rate is rotated with the directions, so that its gradient needs no rotation back.
        sun, obs, rate = self.spin.to_body(self.time(t), sun, obs, self.data.obs_rate)
        return sun, obs + self.late[:, None] * rate

    def time(self, t: jax.Array) -> jax.Array:
        """Time (T,) since ``origin`` at which a body of constant rate has the attitude of recorded
        times t."""
        return self.elapsed(t if self.late is None else t + self.late)

    def elapsed(self, t: jax.Array) -> jax.Array:
        """As `time`, for true times t."""
        elapsed = t - self.origin
        if self.drift is None:
            return elapsed
        since, start = t - self.data.t_middle, self.origin - self.data.t_middle
        return elapsed + self.drift * (since**2 - start**2) / (2.0 * self.data.t_span)


def expected(
    data: Epochs,
    turned: Rotating,
    flux: Callable[[jax.Array, jax.Array], jax.Array],
    spin: str,
    nutation_sd: float,
    nutation_ratio: float,
) -> tuple[jax.Array, nutation.Wobble | None]:
    """Flux (T,) averaged over the exposures, and its changes by small nutation, if modelled.

    Parameters
    ----------
    flux : callable
        Flux (T,) from body components of the directions to Sun and observer, each (T, 3).
    spin : str
        As of `rotation`.
    nutation_sd, nutation_ratio
        As of `nutation.response`.
    """
    if nutation_ratio and spin != "free":
        raise InputError(
            f"nutation_ratio is {nutation_ratio:g}, but --spin {spin} has no constant rate about "
            "which the body could nutate; leave it out, or choose --spin free"
        )

    nutates = nutation.on(nutation_sd, nutation_ratio)

    def instant(t: jax.Array) -> jax.Array:
        directions = turned(t, data.sun, data.obs)
        return nutation.with_torque(flux, *directions) if nutates else flux(*directions)

    average = photometry.exposed(instant, data.exposure_s) if data.has_exposure else instant
    averaged = average(data.t)
    if not nutates:
        return averaged, None
    motion = turned.spin.omega, turned.time
    return averaged[0], nutation.response(data, *motion, averaged[1:], nutation_sd, nutation_ratio)


def rotation(
    data: Epochs,
    spin: str,
    omega_sd: float,
    inertia_sd: float,
    clock_sd: float = CLOCK_SD,
    rate_drift_sd: float = RATE_DRIFT_SD,
    known: KnownSpin | None = None,
) -> Rotating:
    """The rotation of `modelling.priors.spin` with errors of clocks and a drift of the rate.

    The prior of ω is normal with sd ``omega_sd`` (rad/s), or that of what is known of the spin.
    That of a torque-free body is ω in the middle of the light curve, where its axes coincide with
    the inertial axes: the data fix the attitude best there, and the posterior is rounder than that
    of the state at t = 0. The latter is recorded: ω (3,) and the inertia tensor (3, 3), both in
    inertial axes. Likewise, axes coincide at a time of the first observer's clock, so that an
    offset of all clocks, which the data hardly fix, leaves them alone.

    Returns
    -------
    Rotating
        ``to_body(t, sun, obs)`` for recorded times t.
    """
    prior = None
    if known is not None:
        known.check(spin)
        prior = known.prior(omega_sd, data)
    body = priors.spin(spin, omega_sd, inertia_sd, prior)
    if spin == "none":
        return Rotating(data, body)
    rate = jnp.sqrt(jnp.sum(body.omega**2) + 1e-30)
    offsets, drift = clock_offsets(data, clock_sd), rate_drift(data, rate, rate_drift_sd)
    first = 0.0 if offsets is None else offsets[0]
    if spin == "torque-free":
        rotating = Rotating(data, body, late(data, offsets), drift, data.t_middle + first)
        state = body.state(rotating.elapsed(jnp.zeros(())))
        numpyro.deterministic("omega", state.omega)
        numpyro.deterministic("inertia", state.inertia)
        return replace(rotating, start=state.attitude)
    rotating = Rotating(data, body, late(data, offsets), drift, first)
    if offsets is None:
        return rotating
    since = rotating.elapsed(jnp.zeros(1))
    return replace(rotating, start=rotations.constant_rate(since, body.omega)[0])


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
