"""Information of each single measurement of a scenario on the attitude."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data import earth_shadow
from lcbayes.data.lightcurve import LightCurve
from lcbayes.physics import photometry
from lcbayes.physics.attitude.laws import Ephemeris
from lcbayes.physics.sensitivity import (
    MAGNITUDE_PER_NEPER,
    attitude_gradient,
    magnitude_gradient,
    nullspace,
)
from lcbayes.simulation.scenarios.scenario import Scenario
from lcbayes.simulation.simulate import body_flux, in_body, predicted_flux, simulate

Floats = NDArray[np.float64]
CHUNK = 2_000_000  # facet-geometries at a time


@dataclass(frozen=True)
class Measurements:
    """The predicted light curve of a scenario without noise, and the information of each point.

    Attributes
    ----------
    curve : LightCurve
        Epochs, geometry and, in `error`, the standard deviation of each point.
    clean : (T,)
        Brightness in the curve's unit, without noise.
    flux : (T,) m²
        At unit distance under unit irradiance.
    unit : (T,)
        Factor from ``flux`` to the fluxes of the curve: Φ/r² (W/m² per m²) or 1, times the fraction
        of sunlight that reaches the body.
    mag, mag_err : (T,)
        Apparent magnitude if the range is known, otherwise −2.5 log₁₀(flux), and its standard
        deviation; NaN if dark.
    mag_gradient : (T, 3) mag/rad
        ∂m/∂δα, body frame, with the sign of Hinks (`physics.sensitivity`).
    flux_gradient : (T, 3)
        ∂(clean flux)/∂δα, the flux in the curve's unit.
    information : (T,) 1/rad²
        |∂m/∂δα|²/σ_m², the only non-zero eigenvalue of the Fisher information; identical for
        fluxes.
    nullspace : (T, 2, 3)
        Attitude errors to which the point is insensitive, Hinks (20) for one isotropic facet.
    sun_body, obs_body : (T, 3)
    """

    curve: LightCurve
    clean: Floats
    flux: Floats
    unit: Floats
    mag: Floats
    mag_err: Floats
    mag_gradient: Floats
    flux_gradient: Floats
    information: Floats
    nullspace: Floats
    sun_body: Floats
    obs_body: Floats

    @property
    def apparent(self) -> bool:
        """Whether ``mag`` is an apparent magnitude."""
        return self.curve.range_km is not None


def measure(scenario: Scenario) -> Measurements:
    """The measurements of a scenario's campaign.

    Raises
    ------
    InputError
        As for `simulate.simulate`; also if the attitude follows the orbit or if parts cast shadows
        on one another.
    """
    if scenario.attitude.needs or scenario.attitude.array:
        raise InputError(
            f"scenario {scenario.name!r}: what can be known under the law "
            f"{scenario.attitude.name!r} is not worked out; give an attitude that is fixed, "
            "constant-rate or principal-axis"
        )
    if scenario.parts is not None and scenario.parts.method != "none":
        raise InputError(
            f"scenario {scenario.name!r}: what can be known of a body whose parts shade each other "
            "is not worked out; set body.shadows = false"
        )
    curve, truth = simulate(scenario)
    clean, sd = np.asarray(truth[scenario.kind], float), np.asarray(curve.error)
    along, obs = Ephemeris(jnp.asarray(curve.t), jnp.asarray(curve.sun)), jnp.asarray(curve.obs)

    @jax.jit
    def flux_and_slope(along, obs):
        f = partial(predicted_flux, scenario, along, obs)
        return f(jnp.zeros(3)), jax.jacfwd(f)(jnp.zeros(3))

    flux, gradient = (np.asarray(x) for x in flux_and_slope(along, obs))
    unit = sunlight = earth_shadow.share(curve) * earth_shadow.irradiance(curve)
    if curve.range_km is not None:
        unit = sunlight * np.asarray(
            photometry.irradiance(jnp.ones(curve.n_obs), jnp.asarray(1e3 * curve.range_km))
        )
    bright = flux > 0.0
    safe = np.where(bright, flux, 1.0)
    if scenario.kind == "mag":
        mag, mag_err = clean, sd
    else:
        distance = 1.0 if curve.range_km is None else jnp.asarray(1e3 * curve.range_km)
        m_sun = 0.0 if curve.range_km is None else photometry.sun_magnitude(scenario.band)
        mag = np.where(
            bright, photometry.magnitude(jnp.asarray(safe * sunlight), distance, m_sun), np.nan
        )
        mag_err = np.where(bright, MAGNITUDE_PER_NEPER * sd / (safe * unit), np.nan)
    slope = np.asarray(magnitude_gradient(jnp.asarray(flux), jnp.asarray(gradient)))
    information = np.where(bright, np.sum(slope**2, axis=1) / mag_err**2, 0.0)
    bodies = tuple(np.asarray(x) for x in in_body(scenario, along, along.sun, obs))
    brightest = scenario.body.normals[np.argmax(by_facet(scenario, *bodies), axis=1)]
    return Measurements(
        curve,
        clean,
        flux,
        unit,
        mag,
        mag_err,
        slope,
        gradient * unit[:, None],
        information,
        np.asarray(nullspace(jnp.asarray(slope), jnp.asarray(brightest))),
        *bodies,
    )


def by_facet(scenario: Scenario, sun_body: Floats, obs_body: Floats) -> Floats:
    """Flux of each facet for body-frame directions (T, 3), m², (T, N)."""
    body, directions = scenario.body, (jnp.asarray(sun_body), jnp.asarray(obs_body))

    def flux(areas: jax.Array) -> jax.Array:
        return body_flux(body._replace(areas=areas), scenario.materials, *directions)

    return np.asarray(jax.jit(jax.jacfwd(flux))(jnp.asarray(body.areas))) * body.areas


def over_directions(
    scenario: Scenario, sun_body: Floats, obs_body: Floats
) -> tuple[Floats, Floats]:
    """Map of the flux and its attitude gradient over pairs of body-frame directions.

    Parameters
    ----------
    sun_body, obs_body : (G, 3)
        Unit vectors, or (3,) for a common direction.

    Returns
    -------
    flux : (G,) m²
        At unit distance under unit irradiance.
    gradient : (G, 3) m²/rad
        ∂flux/∂δα; its square over the variance of the flux is the information.
    """
    sun, obs = np.broadcast_arrays(np.atleast_2d(sun_body), np.atleast_2d(obs_body))
    size = max(1, CHUNK // len(scenario.body.areas))

    @jax.jit
    def part(sun, obs):
        return attitude_gradient(partial(body_flux, scenario.body, scenario.materials), sun, obs)

    done = [
        part(jnp.asarray(sun[i : i + size]), jnp.asarray(obs[i : i + size]))
        for i in range(0, len(sun), size)
    ]
    flux, gradient = zip(*done, strict=True)
    return np.concatenate(flux), np.concatenate(gradient)
