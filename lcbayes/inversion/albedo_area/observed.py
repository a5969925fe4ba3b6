"""A light curve of a body of known attitude: linear flux, and directions in the body frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.attitude.laws import Attitude

Floats = NDArray[np.float64]

ORDER = 3  # instants per exposure, Gauss-Legendre
UNKNOWN_ERROR = 0.02  # of a curve's mean flux if errors are missing; corrected by the fit


@dataclass(frozen=True)
class Observed:
    """Data for the inversion to an albedo-area distribution.

    Attributes
    ----------
    flux, error : (T,)
        Linear, at unit distance and irradiance (m²; any unit for curves of free scale).
    curve : (T,) int
        Group of each point.
    free : (C,) bool
        Whether the flux of each group has an unknown factor.
    sun, obs : (E, T, 3)
        Unit vectors, body frame, at E instants of each exposure.
    weight : (E,)
        Weights of these instants; they sum to one.
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
    def of(cls, curve: LightCurve, attitude: Attitude) -> Observed:
        """Linear flux, see `linear_flux`, and body-frame directions of a light curve.

        The time of the attitude starts at the first point. During an exposure only the time of the
        attitude advances: Sun, observer and orbit are fixed.
        """
        data = Epochs.of(curve)
        flux, error = linear_flux(curve, data)
        group = np.asarray(data.curve)
        offset, weight = np.zeros(1), np.ones(1)
        if data.has_exposure:
            offset, weight = np.polynomial.legendre.leggauss(ORDER)
            weight = 0.5 * weight
        sun, obs = [], []
        for x in offset:
            instant = data.orbit._replace(t=data.t + 0.5 * x * data.exposure_s)
            turn = attitude.frames(instant).body
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

    A magnitude m ± σ becomes f = 10^(−0.4 (m − m_sun)) r² with error 0.4 ln(10) f σ. If the data
    have no errors, they are set to 2 % of the mean of a curve.

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
