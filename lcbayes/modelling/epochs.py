"""Light curves as models read them: arrays on the device, in the units of the physics."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S, SOLAR_FLUX_VISIBLE
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data import earth_shadow
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import Matched, direction_rates, matched, matched_nights, observers
from lcbayes.data.segments import PASS, pass_numbers, split
from lcbayes.geometry import earth
from lcbayes.geometry.times import seconds_between
from lcbayes.modelling.body_expansion import BodyExpansion
from lcbayes.modelling.ephemeris import ephemeris
from lcbayes.modelling.expansion import Expansion
from lcbayes.modelling.pass_effects import Passes
from lcbayes.physics import photometry
from lcbayes.physics.attitude.laws import Ephemeris
from lcbayes.physics.bodies.lit import Lit

Floats = NDArray[np.float64]

UNKNOWN_ERROR = 0.03  # relative, of curves without errors
PHASES = np.radians(5.0)  # range within a curve that a phase law changes, by some 0.1 mag
MIN_SUNLIGHT = 0.05  # share below which a point tells nothing of the flux in full sunlight


def _static(default):
    return field(default=default, metadata={"static": True})


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Epochs:
    """The argument of every model: ``model(data)``.

    Attributes
    ----------
    t : (T,) s
        Time since the first measurement of the fitted curve.
    t_middle, t_span : s
        Middle and length of the fitted curve. Like the origin of ``t``, they are kept for
        predictions at other epochs, so that the parameters keep their meaning.
    sun, obs : (T, 3)
        Unit vectors body→Sun and body→observer, inertial.
    phase_angle : (T,) rad
    brightness, error : (T,)
        Observed flux or magnitude and its standard deviation (NaN where unknown). Only
        `likelihood.observe` reads them.
    dilution : (T,)
        Factor on the flux at unit distance under unit irradiance: e/r² in m⁻² for magnitudes,
        Φ_sun e/r² in W/m² per m² for fluxes with a range, otherwise 1; e is
        `earth_shadow.irradiance`.
    zero_point : (T,) mag
        Magnitude at dilution · flux = 1: that of the Sun in the band of the point.
    level : (C,)
        Typical brightness of a curve of unknown scale, as a factor on the diluted flux; 1 for the
        other curves. A unit scale then corresponds to a typical body in any units of the file.
    noise_unit : (C,)
        Unit of an unknown noise level: the curve's mean brightness for fluxes, 1 mag.
    curve : (T,) int
        Group of the point.
    exposure_s : (T,) s
    orbit : Ephemeris
        Input of attitude laws at the same times; its t is ``t``.
    sunlight : (T,)
        Fraction of sunlight that the Earth does not block, `earth_shadow.share`.
    airmass : (T,)
        1 if positions or ranges are not known.
    site : (T,) int
        Index of the point's site among those of the fitted curve; ``n_sites`` for any other.
    member : (T,) int
        Index of the point's group among those of the fitted curve; ``n_members`` for any other.
        Unlike ``curve``, it denotes the same object at predicted epochs.
    passes : Passes
        Points grouped by pass; ``has_passes`` is False if each point is a separate pass.
    observer : (T,) int
        Index of the point's observer among those of the fitted curve; ``n_observers`` for any
        other. See `lcbayes.data.observers`.
    calibration : (T,) int
        Index of the zero point among those of the fitted curve; ``n_calibrations`` for any other
        calibration, −1 for a point that needs no zero point.
    night : (T,) int
        Index of the night among those of the fitted curve; ``n_nights`` for any other, −1 for a
        point that shares no fault of the motion with others.
    series : (T,) int
        Index of the series whose nights share a part of their zero points; ``n_series`` for any
        other. See `lcbayes.data.observers`.
    calibrated_together, series_together, segments, nights : Passes
        Points grouped by zero point, by series, by pass of one observer, and by night of any
        observer, in the same form as ``passes``. For nights, ``elapsed`` is the time since the
        middle, s.
    longest_night : s
    t_step : s
        Median time step within the passes of the fitted curve.
    sun_rate, obs_rate : (T, 3) 1/s
        Rates of change of ``sun`` and ``obs``; zero if unknown.
    information : scalar or (T,)
        Power to which the likelihood of a point is raised; 1 for independent errors.
    lit : Lit or None
        What shadows leave of each panel of a known body, if the model is not to compute it.
    expansion : Expansion, BodyExpansion or None
        The brightness about one solution, as a polynomial (`models.convex_grid`, `models.body`).
    kind : "flux" or "mag"
    has_error, has_exposure : bool
    free_scale : (C,) bools
        Whether the group's brightness carries an unknown factor.
    n_sites, n_members : int
        Numbers of sites and groups of the fitted curve.
    n_observers, n_calibrations, n_series, n_segments, n_nights : int
        Numbers of observers, zero points (0 if there is only one), series (0 if nights share no
        part of their zero points), passes and nights of the fitted curve.
    calibrated : bool
        Whether any group of the fitted curve has a known scale; kept for predictions like
        ``t_middle``.
    phased : tuple of int
        Groups of unknown scale in the fitted curve that cover `PHASES` of phase angle, over which
        the brightness falls by what bodies of one shape and albedo do not. Most points first.
    has_passes : bool
        Whether the fitted curve has several groups, more passes than groups, and more points than
        passes. Pass effects can then be distinguished from the noise and from group effects.
    """

    t: jax.Array
    t_middle: jax.Array
    t_span: jax.Array
    sun: jax.Array
    obs: jax.Array
    phase_angle: jax.Array
    brightness: jax.Array
    error: jax.Array
    dilution: jax.Array
    zero_point: jax.Array
    level: jax.Array
    noise_unit: jax.Array
    curve: jax.Array
    exposure_s: jax.Array
    orbit: Ephemeris
    sunlight: jax.Array
    airmass: jax.Array
    site: jax.Array
    member: jax.Array
    passes: Passes
    observer: jax.Array
    calibration: jax.Array
    calibrated_together: Passes
    series: jax.Array
    series_together: Passes
    segments: Passes
    night: jax.Array
    nights: Passes
    longest_night: jax.Array
    t_step: jax.Array
    sun_rate: jax.Array
    obs_rate: jax.Array
    information: jax.Array
    lit: Lit | None = None
    expansion: Expansion | BodyExpansion | None = None
    kind: str = _static("flux")
    has_error: bool = _static(True)
    has_exposure: bool = _static(False)
    free_scale: tuple[bool, ...] = _static(())
    n_sites: int = _static(1)
    n_members: int = _static(1)
    n_observers: int = _static(1)
    n_calibrations: int = _static(0)
    n_series: int = _static(0)
    n_segments: int = _static(1)
    n_nights: int = _static(1)
    calibrated: bool = _static(True)
    phased: tuple[int, ...] = _static(())
    has_passes: bool = _static(False)

    @classmethod
    def of(cls, curve: LightCurve, fitted: LightCurve | None = None) -> Epochs:
        """The device arrays of a light curve.

        Parameters
        ----------
        curve : LightCurve
        fitted : LightCurve, optional
            The curve whose posterior is evaluated at the epochs of ``curve``. It sets the origin
            of time, the kind of brightness, and the sites, members and passes. Default: ``curve``.
        """
        fitted = curve if fitted is None else fitted
        t, span, n = _since_first(curve, fitted), np.ptp(fitted.t), curve.n_obs
        dilution, zero_point = _dilution(curve, fitted.kind), _zero_point(curve)
        level, noise_unit = _units(curve, dilution, zero_point)
        sites = np.unique(fitted.site)
        has_passes = _has_passes(fitted)
        nights = matched_nights(t + fitted.t.min(), fitted)
        sun_rate, obs_rate = direction_rates(curve, observers(curve))
        return cls(
            t=jnp.asarray(t),
            t_middle=jnp.asarray(0.5 * span),
            t_span=jnp.asarray(span),
            sun=jnp.asarray(curve.sun),
            obs=jnp.asarray(curve.obs),
            phase_angle=jnp.asarray(curve.phase_angle),
            brightness=jnp.asarray(curve.brightness),
            error=jnp.full(n, np.nan) if curve.error is None else jnp.asarray(curve.error),
            dilution=jnp.asarray(dilution),
            zero_point=jnp.asarray(zero_point),
            level=jnp.asarray(level),
            noise_unit=jnp.asarray(noise_unit),
            curve=jnp.asarray(curve.curve),
            exposure_s=jnp.asarray(curve.exposure_s),
            orbit=ephemeris(curve)._replace(t=jnp.asarray(t)),
            sunlight=jnp.asarray(earth_shadow.share(curve)),
            airmass=jnp.asarray(_airmass(curve)),
            site=jnp.asarray(_index(curve.site, sites)),
            member=jnp.asarray(
                _index(np.array(curve.curve_names)[curve.curve], np.array(fitted.curve_names))
            ),
            passes=Passes.of(curve, fitted) if has_passes else Passes.single(n),
            **_observed_by(curve, matched(curve, t + fitted.t.min(), fitted), fitted),
            segments=Passes.of_groups(pass_numbers(curve), curve.t),
            night=jnp.asarray(nights.index),
            nights=Passes.of_groups(nights.index, curve.t)._replace(
                elapsed=jnp.asarray(nights.elapsed)
            ),
            longest_night=jnp.asarray(nights.longest),
            t_step=jnp.asarray(_typical_step(fitted)),
            sun_rate=jnp.asarray(sun_rate),
            obs_rate=jnp.asarray(obs_rate),
            information=jnp.asarray(1.0),
            kind=fitted.kind,
            has_error=curve.error is not None,
            has_exposure=bool(np.any(curve.exposure_s > 0)),
            free_scale=tuple(bool(x) for x in curve.free_scale),
            n_sites=len(sites),
            n_members=fitted.n_curves,
            n_nights=nights.number,
            calibrated=not np.all(fitted.free_scale),
            phased=_phased(fitted),
            has_passes=has_passes,
        )

    def as_flux(self) -> tuple[Floats, Floats]:
        """Brightness and its error as flux at unit distance in full sunlight, m², (T,) each.

        Curves of unknown scale are brought to a mean of one. Where a file gives no errors, they are
        a typical 3 %. A point in shadow has an infinite error.
        """
        curve, sunlight = np.asarray(self.curve), np.asarray(self.sunlight)
        unit = np.asarray(self.dilution) * np.asarray(self.level)[curve] * sunlight
        value, error = np.asarray(self.brightness), np.asarray(self.error)
        if not self.has_error:
            error = UNKNOWN_ERROR * np.asarray(self.noise_unit)[curve]
        if self.kind == "mag":
            value = 10.0 ** (-0.4 * (value - np.asarray(self.zero_point)))
            error = 0.4 * np.log(10.0) * error * value
        dark = sunlight <= MIN_SUNLIGHT
        unit = np.where(dark, 1.0, unit)
        return value / unit, np.where(dark, np.inf, error / unit)

    def without_passes(self) -> Epochs:
        """The same epochs with each point in a separate pass, independent of the other points.

        Zero points and nutation are left out, and correlated noise is independent.
        """
        return replace(
            self,
            passes=self.passes.without_passes(),
            segments=self.segments.without_passes(),
            calibration=jnp.full_like(self.calibration, -1),
            night=jnp.full_like(self.night, -1),
        )


def _observed_by(curve: LightCurve, among: Matched, fitted: LightCurve) -> dict[str, Any]:
    """The fields that depend on which points share an observer and a calibration."""
    known, groups = among.observers, among.calibrations
    return {
        "observer": jnp.asarray(among.observer),
        "calibration": jnp.asarray(among.calibration),
        "calibrated_together": Passes.of_groups(among.calibration, curve.t),
        "series": jnp.asarray(among.series),
        "series_together": Passes.of_groups(among.series, curve.t),
        "n_observers": len(known.names),
        "n_calibrations": len(groups.names),
        "n_series": len(groups.series_names),
        "n_segments": len(split(fitted.t, known.index, PASS)),
    }


def _phased(curve: LightCurve) -> tuple[int, ...]:
    free = np.flatnonzero(curve.free_scale).tolist()
    phases = {k: curve.phase_angle[curve.curve == k] for k in free}
    wide = [k for k in free if np.ptp(phases[k]) > PHASES]
    return tuple(sorted(wide, key=lambda k: -len(phases[k])))


def _typical_step(curve: LightCurve) -> float:
    """Median time between successive points of a pass, s; 1 if there are none."""
    number = pass_numbers(curve)
    order = np.lexsort((curve.t, number))
    steps = np.diff(curve.t[order])[np.diff(number[order]) == 0]
    return float(np.median(steps[steps > 0])) if np.any(steps > 0) else 1.0


def _since_first(curve: LightCurve, fitted: LightCurve) -> Floats:
    """Time since the first measurement of the fitted curve, s, (T,)."""
    t = curve.t - fitted.t.min()
    if curve.epoch_jd is None or fitted.epoch_jd is None:
        return t
    if curve.frame == "ecliptic-j2000":  # asteroid dates are on a uniform time scale
        return t + (curve.epoch_jd - fitted.epoch_jd) * DAY_S
    return t + seconds_between(fitted.epoch_jd, curve.epoch_jd)


def _airmass(curve: LightCurve) -> Floats:
    """Airmass of each point; one where the places of object and observer are not known."""
    if curve.position_km is None or curve.range_km is None:
        return np.ones(curve.n_obs)
    return earth.airmass(curve.position_km, curve.obs, curve.range_km)


def _dilution(curve: LightCurve, kind: str) -> Floats:
    if curve.range_km is None:
        return np.ones(curve.n_obs)
    solar = SOLAR_FLUX_VISIBLE if kind == "flux" else 1.0
    return solar * earth_shadow.irradiance(curve) / (1e3 * curve.range_km) ** 2


def _zero_point(curve: LightCurve) -> Floats:
    """Zero point of each point; bands without a tabulated Sun (unfiltered cameras) count as V."""
    sun_v = photometry.sun_magnitude("V")
    bands, inverse = np.unique(curve.band, return_inverse=True)
    return np.array([photometry.SUN_MAGNITUDE.get(str(b), sun_v) for b in bands])[inverse]


def _units(curve: LightCurve, dilution: Floats, zero_point: Floats) -> tuple[Floats, Floats]:
    """``level`` and ``noise_unit`` of each group, (C,)."""
    linear = curve.brightness
    if curve.kind == "mag":
        linear = 10 ** (-0.4 * (curve.brightness - zero_point))
    level, noise_unit = np.ones(curve.n_curves), np.ones(curve.n_curves)
    for i in range(curve.n_curves):
        here = curve.curve == i
        if curve.free_scale[i]:
            level[i] = np.mean(linear[here] / dilution[here])
        if curve.kind == "flux":
            noise_unit[i] = np.mean(np.abs(curve.brightness[here]))
    return level, noise_unit


def _has_passes(curve: LightCurve) -> bool:
    if curve.n_curves == 1:
        return False
    return curve.n_curves < int(pass_numbers(curve).max()) + 1 < curve.n_obs


def _index(names: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Index of each name among the known ones, or their number for an unknown name."""
    order = {str(name): i for i, name in enumerate(known)}
    labels, inverse = np.unique(names, return_inverse=True)
    return np.array([order.get(str(name), len(order)) for name in labels])[inverse]
