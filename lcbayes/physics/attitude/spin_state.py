"""The spin of an asteroid as it is published: pole, period, and rotational phase at an epoch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.core.jax_setup import jnp
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.physics.attitude import rotations

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SpinState:
    """Rotation about the body's z axis in the convention of DAMIT.

    r_inertial = R_z(λ) R_y(90° − β) R_z(φ₀ + 360° (t − JD₀)/P) r_body.

    Attributes
    ----------
    pole_lon_deg, pole_lat_deg : float
        λ and β, in the frame of the light curve (ecliptic J2000 for DAMIT files).
    period_h : float
        Sidereal period P, positive.
    epoch_jd : float
        JD₀, on the time scale of the light curve (light-time corrected for DAMIT files).
    phase0_deg : float
        φ₀, in [0, 360).

    References
    ----------
    Ďurech, Sidorin & Kaasalainen 2010, A&A 513, A46, and the documentation of DAMIT,
    https://damit.cuni.cz/projects/damit/pages/documentation.
    """

    pole_lon_deg: float
    pole_lat_deg: float
    period_h: float
    epoch_jd: float
    phase0_deg: float

    @classmethod
    def of_pole(cls, pole: ArrayLike, period_h: float, middle_jd: float) -> SpinState:
        """The spin of a body whose axes at ``middle_jd`` are `rotations.brought_to` of the pole.

        This is the convention of the model "convex-grid" and of the attitude scan. The epoch JD₀
        is ``middle_jd`` without its fraction, near which the phase is known best.

        Parameters
        ----------
        pole : (3,)
            Unit vector.
        period_h : float
        middle_jd : float
            Julian date of the middle of the data.

        Examples
        --------
        >>> SpinState.of_pole([0.0, 0.0, 1.0], 6.0, 2450000.0).pole_lat_deg
        90.0
        """
        unit = np.asarray(pole, float) / np.linalg.norm(pole)
        lon, lat = (float(x) for x in lon_lat_deg(unit))
        epoch = float(np.floor(middle_jd))
        turns = (epoch - middle_jd) * DAY_S / (period_h * HOUR_S)
        phase = float(angle_at_middle_deg(unit)) + 360.0 * turns
        return cls(lon, lat, period_h, epoch, phase % 360.0)

    def phase_deg(self, jd: ArrayLike) -> Floats:
        """The rotation angle φ₀ + 360° (t − JD₀)/P at Julian dates, in [0, 360)."""
        turns = (np.asarray(jd, float) - self.epoch_jd) * DAY_S / (self.period_h * HOUR_S)
        return (self.phase0_deg + 360.0 * np.mod(turns, 1.0)) % 360.0

    def rotation(self, jd: ArrayLike) -> Floats:
        """Body to inertial at Julian dates (T,): (T, 3, 3)."""
        t = (np.atleast_1d(np.asarray(jd, float)) - self.epoch_jd) * DAY_S
        lon, lat, phase = np.radians([self.pole_lon_deg, self.pole_lat_deg, self.phase0_deg])
        period_s = self.period_h * HOUR_S
        turned = rotations.principal_axis(jnp.asarray(t), lon, lat, period_s, phase)
        return np.asarray(turned)


def angle_at_middle_deg(poles: Floats) -> Floats:
    """The rotation angle φ of bodies whose axes are `rotations.brought_to` of their poles.

    Parameters
    ----------
    poles : (..., 3)
        Unit vectors.

    Returns
    -------
    (...) deg
    """
    return angle_about_deg(poles, meridians(poles)[0])


def meridians(poles: Floats) -> tuple[Floats, Floats]:
    """The x and y axes (..., 3) of `rotations.brought_to` of unit vectors (..., 3)."""
    x, y, z = np.moveaxis(poles, -1, 0)
    a = 1.0 / np.maximum(1.0 + x, 1e-12)
    first = np.stack([-y, 1.0 - a * y * y, -a * y * z], axis=-1)
    return first, np.cross(poles, first)


def angle_about_deg(pole: Floats, vectors: Floats) -> Floats:
    """The angle φ about a pole at which the x axis of a body points to the vectors, (...) deg.

    Parameters
    ----------
    pole : (3,) or (..., 3)
        Unit vector.
    vectors : (..., 3)
        Their component along the pole does not matter.
    """
    x, y, z = np.moveaxis(pole, -1, 0)
    lon, flat = np.arctan2(y, x), np.hypot(x, y)
    east = np.stack([-np.sin(lon), np.cos(lon), np.zeros_like(lon)], axis=-1)
    south = np.stack([np.cos(lon) * z, np.sin(lon) * z, -flat], axis=-1)
    return np.degrees(np.arctan2(np.sum(east * vectors, -1), np.sum(south * vectors, -1)))
