"""A light curve seen from a body of known attitude: linear flux, and directions in its frame."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.attitude import rotations as attitude

Floats = NDArray[np.float64]

HOUR = 3600.0
ORDER = 3  # instants per exposure, Gauss-Legendre
UNKNOWN_ERROR = 0.02  # of a curve's mean flux, where the data carry no errors; a fit corrects it


class Turning(Protocol):
    """Anything that says how a body is turned."""

    def rotation(self, t: jax.Array, t_middle: jax.Array) -> jax.Array:
        """A (T, 3, 3), body to inertial, at t (s since the first point)."""
        ...


@dataclass(frozen=True)
class Attitude:
    """The attitude that is taken as known.

    Attributes
    ----------
    omega : (3,) rad/s or None
        Constant angular velocity, inertial; the body axes are the inertial ones at the first point.
    pole_lon_deg, pole_lat_deg : degrees, or None
        Pole of a spin about the body's z axis, in the frame of the light curve's vectors; the
        rotational phase is zero at the middle of the data.
    period_h : h, or None
        Sidereal period of that spin; negative for the other sense.

    With neither, the body axes stay the inertial axes.
    """

    omega: tuple[float, float, float] | None = None
    pole_lon_deg: float | None = None
    pole_lat_deg: float | None = None
    period_h: float | None = None

    def __post_init__(self) -> None:
        pole = (self.pole_lon_deg, self.pole_lat_deg, self.period_h)
        if None in pole and pole != (None, None, None):
            raise InputError("a spin needs its pole (longitude and latitude) and its period")
        if self.omega is not None and None not in pole:
            raise InputError("both an angular velocity and a pole are given; give one attitude")
        given = [x for x in (*pole, *(self.omega or ())) if x is not None]
        if not np.isfinite(given).all():
            raise InputError("an attitude is told in finite numbers")
        if self.period_h == 0 or (self.pole_lat_deg is not None and abs(self.pole_lat_deg) > 90):
            raise InputError("a period is not zero, and a pole's latitude lies in -90..90 degrees")

    def rotation(self, t: jax.Array, t_middle: jax.Array) -> jax.Array:
        """A (T, 3, 3), body to inertial, at t (s since the first point)."""
        if self.omega is not None:
            return attitude.constant_rate(t, jnp.asarray(self.omega))
        if self.pole_lon_deg is None or self.pole_lat_deg is None or self.period_h is None:
            return attitude.fixed(t)
        lon, lat = np.radians([self.pole_lon_deg, self.pole_lat_deg])
        return attitude.principal_axis(t - t_middle, lon, lat, HOUR * self.period_h, 0.0)


@dataclass(frozen=True)
class Observed:
    """What an albedo-area distribution is solved from.

    Attributes
    ----------
    flux, error : (T,)
        Linear, at unit distance and irradiance (m²; any unit for curves of free scale).
    curve : (T,) int
        Group of the point.
    free : (C,) bool
        Whether the group's flux carries an unknown factor.
    sun, obs : (E, T, 3)
        Unit vectors, body frame, at E instants of each exposure.
    weight : (E,)
        Of these instants; they sum to one.
    error_known : bool
        Whether ``error`` comes from the data.
    """

    flux: Floats
    error: Floats
    curve: NDArray[np.integer]
    free: NDArray[np.bool_]
    sun: Floats
    obs: Floats
    weight: Floats
    error_known: bool

    @classmethod
    def of(cls, curve: LightCurve, attitude: Turning) -> Observed:
        """Linear flux, see `linear_flux`, and body-frame directions of a light curve."""
        data = Epochs.of(curve)
        flux, error = linear_flux(curve, data)
        group = np.asarray(data.curve)
        offset, weight = np.zeros(1), np.ones(1)
        if data.has_exposure:
            offset, weight = np.polynomial.legendre.leggauss(ORDER)
            weight = 0.5 * weight
        sun, obs = [], []
        for x in offset:
            turn = attitude.rotation(data.t + 0.5 * x * data.exposure_s, data.t_middle)
            sun.append(np.einsum("tij,ti->tj", turn, data.sun))
            obs.append(np.einsum("tij,ti->tj", turn, data.obs))
        return cls(
            flux,
            error,
            group,
            np.asarray(data.free_scale, bool),
            np.stack(sun),
            np.stack(obs),
            weight,
            data.has_error,
        )

    def with_flux(self, flux: Floats) -> Observed:
        """The same epochs and errors with another flux."""
        return replace(self, flux=flux)

    def with_error(self, error: Floats) -> Observed:
        """The same data with other errors."""
        return replace(self, error=error)


def linear_flux(curve: LightCurve, data: Epochs) -> tuple[Floats, Floats]:
    """Flux at unit distance and irradiance and its error, (T,), of a light curve and its epochs.

    A magnitude m ± σ becomes f = 10^(−0.4 (m − m_sun)) r² with error 0.4 ln(10) f σ. Where the data
    carry no errors, they are 2 % of a curve's mean.

    Raises
    ------
    InputError
        If there is no brightness, or a curve of free scale has no flux to scale.
    """
    brightness, dilution = np.asarray(data.brightness), np.asarray(data.dilution)
    if not np.all(np.isfinite(brightness)):
        raise InputError("the light curve has no brightness, only geometry; nothing to solve")
    if data.kind == "mag":
        flux = 10.0 ** (-0.4 * (brightness - np.asarray(data.zero_point))) / dilution
        error = 0.4 * np.log(10.0) * flux * np.asarray(data.error)
    else:
        flux, error = brightness / dilution, np.asarray(data.error) / dilution
    group = np.asarray(data.curve)
    mean = np.bincount(group, flux) / np.bincount(group)
    lost = np.flatnonzero(np.asarray(data.free_scale) & ~(mean > 0))
    if len(lost):
        name = curve.curve_names[lost[0]]
        raise InputError(
            f"curve {name!r} has no flux (mean {mean[lost[0]]:.3g}), so its scale is unknown; "
            "leave it out"
        )
    if not data.has_error:
        mean = np.bincount(group, np.abs(flux)) / np.bincount(group)
        error = UNKNOWN_ERROR * mean[group]
    return flux, error
