"""Signs of a mistake in a light curve that can be read: wrong columns, units, times, sites or axes.

Impossible values are refused. Values that are merely unlikely are kept, and a note names the likely
mistake.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S, EARTH_GM, EARTH_RADIUS_KM
from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve

Floats = NDArray[np.float64]

MAGNITUDES = (3.0, 30.0)  # of asteroids
SHALLOW = 0.2  # range within a curve over its mean; magnitudes vary by less, most fluxes by more
EQUAL = 1e-3  # relative spread of the means of curves that were divided by them
PHASE_RANGE_DEG, SIGNIFICANT = 10.0, 4.0  # range of phase angles, and slope in its errors
FAINT_FLUX = 1e-3  # magnitudes that are all nearer to zero are fluxes
NOISE_LIMIT = 1.0  # median error relative to the median flux
JD_RANGE = (2.4e6, 2.5e6)  # the years 1858 .. 2132
MJD_RANGE = (4e4, 7e4)  # the years 1968 .. 2050
FEWEST_POINTS = 10  # that may not all be equal
DAYS_STEP = 0.05  # median step of times below which they may be days
BACKLIT_DEG = 170.0  # a body at this phase angle stands in front of the Sun
SUN_TOLERANCE_DEG = 2.0
NEAR_KM = 1e6  # up to here the Sun is seen in the same direction as from the Earth
GROUND_KM = 6420.0  # distance of a site from the centre of the Earth, at most
STEPS_S = (10.0, 120.0)  # steps from which a velocity is computed
FASTEST = 1.5  # speed relative to that of escape
LOWEST_KM = 0.5 * EARTH_RADIUS_KM  # perigee, for errors of the velocity
USER_COLUMNS = ("csv", "ecsv")  # formats whose units are not fixed by a specification


def check(curve: LightCurve) -> tuple[str, ...]:
    """Notes about likely mistakes.

    Raises
    ------
    InputError
        A column cannot hold what its name says.
    """
    name = curve.source.get("file") or "the table"
    _check_magnitudes(curve, name)
    _check_seconds(curve, name)
    return tuple(note for rule in _RULES if (note := rule(curve)))


def _check_magnitudes(curve: LightCurve, name: str) -> None:
    if curve.kind == "mag" and 0 < np.max(np.abs(curve.brightness)) < FAINT_FLUX:
        raise InputError(
            f"{name}: all values of mag are within {FAINT_FLUX:g} of zero (median "
            f"{np.median(curve.brightness):.3g}), as fluxes are; if they are fluxes, name the "
            "column flux (--columns flux=mag,flux_err=mag_err)"
        )


def check_flux_of_asteroid(curve: LightCurve) -> None:
    """Refuse magnitudes in a column of fluxes, of a body that becomes fainter with phase angle.

    Values in the range of magnitudes that grow with the phase angle are no fluxes of an asteroid,
    whose brightness halves within some thirty degrees.

    Raises
    ------
    InputError
    """
    angle, flux = np.degrees(curve.phase_angle), curve.brightness
    low, high = MAGNITUDES
    inside = flux.min() > low and flux.max() < high
    if curve.kind != "flux" or not inside or np.ptp(angle) < PHASE_RANGE_DEG:
        return
    x, y = angle - angle.mean(), flux - flux.mean()
    slope = float(x @ y / (x @ x))
    error = float(np.sqrt(np.sum((y - slope * x) ** 2) / max(curve.n_obs - 2, 1) / (x @ x)))
    if slope > SIGNIFICANT * error:
        raise InputError(
            f"{curve.source.get('file') or 'the table'}: flux lies in {flux.min():.4g} .. "
            f"{flux.max():.4g} and grows with the phase angle, as magnitudes do; name the column "
            "mag (--columns mag=flux,mag_err=flux_err)"
        )


def check_intensities(flux: Floats, curve: NDArray[np.int64], name: str) -> None:
    """Refuse magnitudes in place of the relative fluxes (T,) of an asteroid's curves (T,).

    Every curve has a mean in the range of magnitudes, and varies by a fraction of it that is small
    for the flux of an asteroid. The means differ, as those of fluxes over their mean do not.

    Raises
    ------
    InputError
    """
    rows = [flux[curve == index] for index in np.unique(curve)]
    means, ranges = np.array([x.mean() for x in rows]), np.array([np.ptp(x) for x in rows])
    low, high = MAGNITUDES
    inside = low < flux.min() and flux.max() < high
    equal = len(rows) > 1 and np.ptp(means) < EQUAL * means.mean()
    deepest = np.max(ranges / means)
    if not inside or equal or not 0.0 < deepest < SHALLOW:
        return
    raise InputError(
        f"{name}: the intensities of all relative curves lie in {flux.min():.4g} .. "
        f"{flux.max():.4g} and vary by at most {100 * deepest:.2g} % within a curve, as magnitudes "
        "do; give intensities, 10^(-0.4 mag). If they are intensities, divide each curve by its "
        "mean, or all by the same number"
    )


def _check_seconds(curve: LightCurve, name: str) -> None:
    if _in_days(curve, JD_RANGE):
        raise InputError(
            f"{name}: t begins at {curve.t[0]:.10g} with steps of {_step(curve):.2g}, as Julian "
            "dates do; t is in seconds: name the column jd (--columns jd=t)"
        )


def _in_days(curve: LightCurve, limits: tuple[float, float]) -> bool:
    """Whether the seconds of a curve without a date look like days."""
    low, high = limits
    inside = curve.t.min() > low and curve.t.max() < high
    return curve.epoch_jd is None and bool(inside) and 0 < _step(curve) < DAYS_STEP


def _step(curve: LightCurve) -> float:
    steps = np.diff(np.unique(curve.t))
    return float(np.median(steps)) if steps.size else 0.0


def _modified_dates(curve: LightCurve) -> str:
    if not _in_days(curve, MJD_RANGE):
        return ""
    return (
        f"t begins at {curve.t[0]:.10g} with steps of {_step(curve):.2g} s: if these are modified "
        "Julian dates, name the column mjd (--columns mjd=t)"
    )


def _constant(curve: LightCurve) -> str:
    if curve.n_obs < FEWEST_POINTS or np.ptp(curve.brightness) > 0:
        return ""
    return f"all values of {curve.kind} are {curve.brightness[0]:g}: check the column"


def _no_errors(curve: LightCurve) -> str:
    if curve.error is not None or curve.source.get("format") not in USER_COLUMNS:
        return ""
    return (
        "there are no errors, so that their size is inferred and chi2 cannot be tested: "
        f"add a column {curve.kind}_err, or give --error"
    )


def _noisy(curve: LightCurve) -> str:
    if curve.kind != "flux" or curve.error is None:
        return ""
    error, flux = float(np.median(curve.error)), float(np.median(np.abs(curve.brightness)))
    if error <= NOISE_LIMIT * flux or flux == 0:
        return ""
    return (
        f"the error is {error:.3g} and the flux {flux:.3g} (medians): check that the error is in "
        "the unit of the flux, also with --error and --error-floor"
    )


def _backlit(curve: LightCurve) -> str:
    if curve.brightness_only:
        return ""
    angle = float(np.degrees(np.median(curve.phase_angle)))
    if angle < BACKLIT_DEG:
        return ""
    return (
        f"the phase angle is {angle:.0f} deg (median), so that the object stands in front of the "
        "Sun: both vectors point away from the object, so check the signs of sun_x .. obs_z"
    )


def _sun_elsewhere(curve: LightCurve) -> str:
    """The Sun's direction from near the Earth differs from its direction on that date."""
    ranges, epoch_jd = curve.range_km, curve.epoch_jd
    if curve.frame != "icrs" or curve.brightness_only or epoch_jd is None:
        return ""
    if ranges is None or np.median(ranges) > NEAR_KM or not _dated(curve, epoch_jd):
        return ""
    from lcbayes.geometry.earth import sun_position
    from lcbayes.geometry.times import Times

    sun = sun_position(Times.of(epoch_jd, curve.t))
    cosine = np.sum(curve.sun * sun, axis=1) / np.linalg.norm(sun, axis=1)
    off = float(np.median(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))))
    if off < SUN_TOLERANCE_DEG:
        return ""
    return (
        f"sun_x .. sun_z are {off:.0f} deg from the Sun's direction on that date: check that they "
        "point toward the Sun, the frame (icrs is equatorial), and the date"
    )


def _dated(curve: LightCurve, epoch_jd: float) -> bool:
    """Whether all times are dates for which the Sun's position is known."""
    low, high = JD_RANGE
    first, last = (epoch_jd + t / DAY_S for t in (curve.t.min(), curve.t.max()))
    return bool(low < first and last < high)


def _observer(curve: LightCurve) -> Floats | None:
    """Geocentric positions of an observer on the ground, km, (T, 3)."""
    if curve.position_km is None or curve.range_km is None or curve.brightness_only:
        return None
    place = curve.position_km + curve.range_km[:, None] * curve.obs
    return place if np.max(np.linalg.norm(place, axis=1)) < GROUND_KM else None


def _daylight(curve: LightCurve) -> str:
    site = _observer(curve)
    if site is None:
        return ""
    sine = np.sum(site * curve.sun, axis=1) / np.linalg.norm(site, axis=1)
    up = np.flatnonzero(sine > 0)
    if not up.size:
        return ""
    highest = float(np.degrees(np.arcsin(np.max(sine))))
    return (
        f"the Sun is up at the observer at {up.size} of {curve.n_obs} points (highest "
        f"{highest:.0f} deg): check that times are UTC, and that longitudes are positive toward "
        "east"
    )


def _impossible_orbit(curve: LightCurve) -> str:
    """Places computed from directions and ranges do not move as on an orbit."""
    if curve.position_km is None or curve.velocity_km_s is not None:
        return ""
    if curve.source.get("format") not in USER_COLUMNS:
        return ""
    first, second = _pairs(curve)
    if first.size < 2:
        return ""
    step = (curve.t[second] - curve.t[first])[:, None]
    place = 0.5 * (curve.position_km[first] + curve.position_km[second])
    velocity = (curve.position_km[second] - curve.position_km[first]) / step
    speed, distance = np.linalg.norm(velocity, axis=1), np.linalg.norm(place, axis=1)
    escape = np.sqrt(2.0 * EARTH_GM / distance)
    perigee = float(np.median(_perigee(place, velocity)))
    if np.median(speed / escape) < FASTEST and perigee > LOWEST_KM:
        return ""
    orbit = (
        "faster than any orbit"
        if np.median(speed / escape) >= FASTEST
        else f"on an orbit that passes {EARTH_RADIUS_KM - perigee:.0f} km below the ground"
    )
    return (
        f"the directions and ranges give a satellite that moves at {np.median(speed):.3g} km/s, "
        f"{orbit}: unless the rows are of several objects, check that times are UTC, ra_deg is in "
        "degrees (not hours) and range_km in km"
    )


def _pairs(curve: LightCurve) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows of one curve and the rows that follow them after `STEPS_S`."""
    low, high = STEPS_S
    first: list[NDArray[np.int64]] = []
    second: list[NDArray[np.int64]] = []
    for index in range(curve.n_curves):
        rows = np.flatnonzero(curve.curve == index)
        t = curve.t[rows]
        after = np.minimum(np.searchsorted(t, t + low), rows.size - 1)
        use = (t[after] - t >= low) & (t[after] - t <= high)
        first.append(rows[use])
        second.append(rows[after[use]])
    return np.concatenate(first), np.concatenate(second)


def _perigee(place: Floats, velocity: Floats) -> Floats:
    """Distance of the perigee from the centre of the Earth, km, (T,)."""
    distance = np.linalg.norm(place, axis=1)
    momentum = np.linalg.norm(np.cross(place, velocity), axis=1)
    energy = 0.5 * np.sum(velocity**2, axis=1) - EARTH_GM / distance
    latus = momentum**2 / EARTH_GM
    eccentricity = np.sqrt(np.maximum(1.0 + 2.0 * energy * latus / EARTH_GM, 0.0))
    return latus / (1.0 + eccentricity)


_RULES: tuple[Callable[[LightCurve], str], ...] = (
    _modified_dates,
    _constant,
    _no_errors,
    _noisy,
    _backlit,
    _sun_elsewhere,
    _daylight,
    _impossible_orbit,
)
