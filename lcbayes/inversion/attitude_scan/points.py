"""The data of a scan: linear flux and inertial directions, on the device."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.observed import ORDER, linear_flux
from lcbayes.inversion.attitude_scan.harmonics import phase_columns
from lcbayes.modelling.epochs import PHASES, Epochs

Floats = NDArray[np.float64]
FEWEST = 3  # points of a curve that a factor with a phase law would fit whatever they are


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Points:
    """The data of a scan. Every curve is divided by its mean or, if calibrated, by the mean of all
    calibrated curves, so that residuals are relative.

    Attributes
    ----------
    t : (E, T) s
        Time since the middle of the data, at E instants of each exposure.
    instant : (E,)
        Weights of these instants; they sum to one.
    sun, obs : (T, 3)
        Unit vectors, inertial.
    flux, error : (T,)
        Relative.
    scale : (T, C)
        One where a point belongs to a group with a common factor. Each curve of free scale is a
        group; all calibrated curves form one group.
    phased : (T, M)
        One where a point belongs to a curve whose factor depends on the phase angle: a curve of an
        asteroid with its own factor that covers more than `PHASES`.
    laws : (T, 2)
        The functions of the phase angle that this factor contains besides a constant; zero for
        other curves.
    noise : (T, K)
        One where a point belongs to a group with a common noise level.
    span : s
        Length of the data.
    error_known : bool
        Whether ``error`` comes from the data. If not, each noise group has its own noise level, and
        ``error`` is the expected value.
    """

    t: jax.Array
    instant: jax.Array
    sun: jax.Array
    obs: jax.Array
    flux: jax.Array
    error: jax.Array
    scale: jax.Array
    phased: jax.Array
    laws: jax.Array
    noise: jax.Array
    span: jax.Array
    error_known: bool = field(default=True, metadata={"static": True})

    @classmethod
    def of(
        cls,
        curve: LightCurve,
        *,
        phase_law_known: bool = True,
        common_noise: bool = False,
        phase_laws: bool = False,
    ) -> Points:
        """The points of a light curve.

        Parameters
        ----------
        curve : LightCurve
        phase_law_known : bool
            If False, the reflection law does not determine the dependence of the brightness on the
            phase angle, and each calibrated curve has its own scale.
        common_noise : bool
            For unknown errors: one relative noise level for all points, not one per curve.
        phase_laws : bool
            Whether curves with their own scale that cover phase angles have a phase law as well.
        """
        data = Epochs.of(curve)
        flux, error = linear_flux(curve, data)
        group = np.asarray(data.curve)
        own = np.asarray(data.free_scale, bool) | (not phase_law_known)
        number = np.where(own, np.arange(len(own)), len(own))
        scale = np.unique(number, return_inverse=True)[1][group]
        unit = (np.bincount(scale, np.abs(flux)) / np.bincount(scale))[scale]
        middle, offset, instant = np.asarray(data.t - data.t_middle), np.zeros(1), np.ones(1)
        if data.has_exposure:
            offset, weight = np.polynomial.legendre.leggauss(ORDER)
            instant = 0.5 * weight
        t = middle + 0.5 * offset[:, None] * np.asarray(data.exposure_s)
        # a group with a common scale must have one noise level, which the scale solution assumes
        noise = np.zeros_like(scale) if common_noise or data.has_error else scale
        phased, laws = _phase_laws(curve, own & phase_laws)
        return cls(
            jnp.asarray(t),
            jnp.asarray(instant),
            data.sun,
            data.obs,
            jnp.asarray(flux / unit),
            jnp.asarray(error / unit),
            jnp.asarray(_members(scale)),
            jnp.asarray(phased),
            jnp.asarray(laws),
            jnp.asarray(_members(noise)),
            jnp.asarray(max(float(data.t_span), 1e-6)),
            data.has_error,
        )

    @property
    def n_factors(self) -> int:
        """Unknown multiples in the factors of all curves."""
        return self.scale.shape[1] + self.laws.shape[1] * self.phased.shape[1]

    def host(self) -> Points:
        """The same data as NumPy arrays, for transfer to other processes."""
        return jax.tree.map(np.asarray, self)

    def with_flux(self, flux: Floats) -> Points:
        """The same epochs with a different flux."""
        return replace(self, flux=jnp.asarray(flux))


def _members(group: NDArray[np.integer]) -> Floats:
    return (group[:, None] == np.arange(group.max() + 1)).astype(float)


def _phase_laws(curve: LightCurve, own: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """`Points.phased` and `Points.laws`, for the curves that may have their ``own`` phase law.

    Their factors are combinations of 1, α and exp(−α/0.09), with α the phase angle. These are
    orthogonalised, because α and exp(−α/0.09) are nearly proportional far from opposition.
    """
    phase, laws = curve.phase_angle, np.zeros((curve.n_obs, 2))
    members = [np.flatnonzero(curve.curve == k) for k in np.flatnonzero(own)]
    wide = [rows for rows in members if len(rows) > FEWEST and np.ptp(phase[rows]) > PHASES]
    phased = np.zeros((curve.n_obs, len(wide)))
    for k, rows in enumerate(wide):
        phased[rows, k] = 1.0
        terms = np.column_stack([np.ones(len(rows)), phase_columns(phase[rows])])
        laws[rows] = np.linalg.qr(terms)[0][:, 1:]
    return phased, laws
