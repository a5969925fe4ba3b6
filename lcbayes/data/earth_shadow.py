"""Sunlight that reaches a body: its distance from the Sun, and the Earth's shadow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import AU_KM, EARTH_FLATTENING, EARTH_RADIUS_KM, SUN_RADIUS_KM
from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.earth import sun_position
from lcbayes.geometry.times import Times

Floats = NDArray[np.float64]

SCALE_KM = 7.6  # scale height of the density in the lower 40 km of air
BENDING = np.radians(1.18)  # of a ray that grazes the ground: twice the 35.4' at the horizon
RAYLEIGH = 0.098  # optical depth of the air toward the zenith, 550 nm
OZONE, OZONE_KM, OZONE_WIDTH_KM = 0.030, 22.0, 5.0  # the same for ozone, in a layer of this height
TOP_KM = 100.0
FULL = 0.99
NODES = 200  # of the integral over heights
UMBRA = 1e-4  # of sunlight, 10 mag: far below it the transmission of the air is unknown


def irradiance(curve: LightCurve) -> Floats:
    """(1 au / d)² at the points of a light curve, (T,), d the body's distance from the Sun.

    Near the Earth it varies from 0.967 in July to 1.034 in January. It is 1 if the date, the axes
    or the distance are unknown; fluxes reduced to unit distance are already corrected for it.
    """
    if curve.epoch_jd is None or curve.range_km is None or curve.frame != "icrs":
        return np.ones(curve.n_obs)
    # the observer is taken at the Earth's centre: the range can matter in the third digit, the
    # observer's position on the Earth only in the fourth
    body = -curve.range_km[:, None] * curve.obs
    away = np.linalg.norm(sun_position(Times.of(curve.epoch_jd, curve.t)) - body, axis=1)
    return (AU_KM / away) ** 2


def share(curve: LightCurve) -> Floats:
    """`sunlight` at the points of a light curve, (T,), at least `UMBRA`.

    It is 1 if the body's position is unknown.
    """
    if curve.position_km is None:
        return np.ones(curve.n_obs)
    return np.maximum(sunlight(curve.position_km, curve.sun), UMBRA)


def fully_lit(curve: LightCurve) -> LightCurve:
    """The points with a share of sunlight above `FULL`, for methods that do not model a penumbra.

    ``source["in_penumbra"]`` is the number of excluded points, if any.

    Raises
    ------
    InputError
        No point is left.
    """
    lit = share(curve) > FULL
    if lit.all():
        return curve
    if not lit.any():
        raise InputError(
            "by its orbit the object is in the Earth's shadow at all points; check the elements "
            "and the times"
        )
    kept = curve.select(lit)
    return replace(kept, source={**kept.source, "in_penumbra": str(np.sum(~lit))})


def sunlight(position_km: Floats, sun: Floats, air: bool = True) -> Floats:
    """Share of the sunlight that passes the Earth and reaches the body, (T,): 1 far from the limb.

    A ray with the lowest height h above the ground is refracted by α(h) = α₀ exp(−h/H). At the
    distance d behind the limb it arrives at the same point as a straight ray of height
    g = h − d α(h). A strip of the solar disc at the straight height g is therefore seen through the
    strip dh of air. With w(x) dx the fraction of the disc in a strip at x km from its centre, and
    g₀ the height of the straight line to the Sun's centre,

        share = ∫₀ w(g(h) − g₀) exp(−τ(h)) dh,

    where τ is the optical depth of air and ozone along the ray at 550 nm. Without air this is the
    visible fraction of the disc. The limb is that of the ellipsoid, approximated as straight over
    the width of the disc. Clouds, aerosols and limb darkening are neglected.

    Parameters
    ----------
    position_km : (T, 3)
        Geocentric, ICRS axes.
    sun : (T, 3)
        Unit vectors to the Sun.
    air : bool
        Whether the ellipsoid has an atmosphere.

    References
    ----------
    Link 1969, Eclipse Phenomena in Astronomy, ch. 2 (refraction and its dilution of light);
    Vokrouhlický, Farinella & Mignard 1993, A&A 280, 295 (for satellites).
    """
    behind = -np.sum(position_km * sun, axis=-1)  # km from the lowest point of the ray
    foot = position_km + behind[:, None] * sun
    low = np.linalg.norm(foot, axis=-1)
    height = low - EARTH_RADIUS_KM * (
        1.0 - EARTH_FLATTENING * (foot[:, 2] / np.maximum(low, 1e-9)) ** 2
    )
    radius = SUN_RADIUS_KM / AU_KM * np.maximum(behind, 0.0)  # of the solar disc at the limb
    share = np.where((behind > 0.0) & (height < -radius - BENDING * behind), 0.0, 1.0)
    near = np.flatnonzero((behind > 0.0) & (height < TOP_KM + radius) & (share > 0.0))
    for rows in np.array_split(near, max(1, near.size // 4096)):
        share[rows] = _through(height[rows], behind[rows], radius[rows], air)
    return share


def _through(height: Floats, behind: Floats, radius: Floats, air: bool) -> Floats:
    """The integral in `sunlight`, for the heights g₀ = ``height`` (T,), km."""
    node, weight = np.polynomial.legendre.leggauss(NODES)
    # g(h) increases, so the two edges of the disc bracket the heights of its rays
    ends = [
        _ray(height + sign * radius, behind) if air else np.maximum(height + sign * radius, 0.0)
        for sign in (-1.0, 1.0)
    ]
    half = 0.5 * (ends[1] - ends[0])[:, None]
    h = ends[0][:, None] + half * (1.0 + node)
    straight = h - behind[:, None] * BENDING * np.exp(-h / SCALE_KM) if air else h
    x = (straight - height[:, None]) / radius[:, None]
    chord = 2.0 / np.pi * np.sqrt(np.maximum(1.0 - x**2, 0.0)) / radius[:, None]
    passed = np.exp(-extinction(h)) if air else 1.0
    return np.minimum(np.sum(half * weight * chord * passed, axis=1), 1.0)


def _ray(straight: Floats, behind: Floats) -> Floats:
    """Height h ≥ 0 of the refracted ray that corresponds to a straight ray of height g, km."""
    low, high = np.zeros_like(straight), np.maximum(straight, 0.0) + BENDING * behind
    for _ in range(60):
        middle = 0.5 * (low + high)
        above = middle - behind * BENDING * np.exp(-middle / SCALE_KM) > straight
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return high


def extinction(height_km: Floats) -> Floats:
    """Optical depth at 550 nm along a ray through the whole atmosphere with this lowest height.

    The optical depth of the air is proportional to its density, τ_z √(2πR/H) exp(−h/H). That of
    the ozone, in a Gaussian layer, is ∫ n(r) 2r dr/√(r² − (R + h)²), by quadrature in √(r − R − h),
    which removes the singularity.
    """
    h = np.asarray(height_km)[..., None]
    rayleigh = (
        RAYLEIGH * np.sqrt(2.0 * np.pi * EARTH_RADIUS_KM / SCALE_KM) * np.exp(-h[..., 0] / SCALE_KM)
    )
    node, weight = np.polynomial.legendre.leggauss(24)
    top = np.sqrt(np.maximum(OZONE_KM + 5.0 * OZONE_WIDTH_KM - h, 0.0))
    root = 0.5 * top * (1.0 + node)
    r = EARTH_RADIUS_KM + h + root**2
    density = np.exp(-0.5 * ((h + root**2 - OZONE_KM) / OZONE_WIDTH_KM) ** 2)
    density *= OZONE / (np.sqrt(2.0 * np.pi) * OZONE_WIDTH_KM)
    # r² − (R + h)² = root² (2(R + h) + root²), and dr = 2 root d(root)
    path = 4.0 * r / np.sqrt(2.0 * (EARTH_RADIUS_KM + h) + root**2)
    return rayleigh + np.sum(0.5 * top * weight * density * path, axis=-1)
