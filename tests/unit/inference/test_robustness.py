"""How far a result moves with the place of the site and of the object: against refits.

The orbit and the brightness are those of other code; the light curve is observed from a displaced
site, or the object is ahead on its orbit, while the file has the directions of the assumed places.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcbayes.core.constants import SOLAR_FLUX_VISIBLE
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import alternatives, robustness
from lcbayes.inference.solutions import optimum
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from tests.helpers import small_faults
from tests.helpers.low_earth_orbit import DAY, Orbit

N, ERROR = 90, 1e-6  # relative to the mean: shifts are many sd, so that refits determine them
BODY = small_faults.body(1, 2)
QUANTITIES = ("omega_x_rad_s", "omega_y_rad_s", "albedo_area[0]", "albedo_area[1]", "g[0]", "g[1]")


def passing() -> tuple[Orbit, np.ndarray]:
    """An orbit that rises to 17° over the site, and times within the pass."""
    sun = np.array([0.36, 0.48, 0.8])
    return Orbit(7200.0, 1.2, 0.0, 0.3, 0.15, 0.35, sun), np.linspace(-240.0, 240.0, N)


def brightness(orbit: Orbit, t, ahead_s=0.0, site_km=(0.0, 0.0, 0.0)):
    """Flux, direction and range; the site's displacement turns with the Earth."""
    satellite, _ = orbit.place(t + ahead_s)
    _, site = orbit.place(t)
    angle = 2.0 * np.pi * t / DAY
    x, y, z = site_km
    cos, sin = np.cos(angle), np.sin(angle)
    line = site + np.stack([cos * x - sin * y, sin * x + cos * y, z + 0 * t], 1) - satellite
    distance = np.linalg.norm(line, axis=1)
    sun = np.tile(orbit.sun, (t.size, 1))
    seen = small_faults.flux(BODY, t - t[0], sun, line / distance[:, None], small_faults.Fault())
    return SOLAR_FLUX_VISIBLE * seen / (1e3 * distance) ** 2, line / distance[:, None], distance


@pytest.fixture(scope="module")
def fitted():
    orbit, t = passing()
    flux, obs, distance = brightness(orbit, t)
    light = LightCurve(
        t=t,
        brightness=flux,
        error=np.full(N, ERROR * flux.mean()),
        sun=np.tile(orbit.sun, (N, 1)),
        obs=obs,
        range_km=distance,
        position_km=orbit.place(t)[0],
        velocity_km_s=np.gradient(orbit.place(t)[0], t, axis=0),
        kind="flux",
        frame="icrs",
        free_scale=np.array([False]),
    )
    data = Epochs.of(light)
    problem = Problem(registry.find("faceted").bind({"n_facets": 2}), data)
    return problem, light, refit(problem, np.asarray(problem.ravel(BODY.sites)), light)


def refit(problem, z, light):
    for _ in range(3):
        z, _ = optimum(problem, Epochs.of(light), z, np.arange(problem.dim))
    return z


def values(problem, z, light):
    result = robustness._quantities(problem, z, Epochs.of(light))
    return np.array([result[k] for k in QUANTITIES])


def shift(fitted, ahead_s=0.0, site_km=(0.0, 0.0, 0.0)):
    """Half the difference of fits with displacements of either sign."""
    problem, light, z = fitted
    orbit, t = passing()
    after = []
    for sign in (1.0, -1.0):
        flux = brightness(orbit, t, sign * ahead_s, sign * np.array(site_km))[0]
        moved = replace(light, brightness=flux)
        after.append(values(problem, refit(problem, z, moved), moved))
    return np.abs(after[0] - after[1]) / 2.0


@pytest.mark.parametrize("fault", ["site_100_m", "elements_1_day"])
def test_the_shift_is_that_of_a_fit_to_what_is_seen_from_elsewhere(fitted, fault):
    problem, light, z = fitted
    assert light.error is not None
    wider = replace(light, error=100.0 * light.error)  # the derivatives are less exact otherwise
    result = robustness.shifts(problem, z, Epochs.of(wider), wider, dict.fromkeys(QUANTITIES, 1.0))
    stated = result.by_fault[fault][[result.quantities.index(k) for k in QUANTITIES]]
    if fault == "site_100_m":
        want = np.max([shift(fitted, site_km=0.1 * axis) for axis in np.eye(3)], axis=0)
    else:
        orbit, t = passing()
        speed = np.linalg.norm(np.diff(orbit.place(t)[0], axis=0)[0]) / (t[1] - t[0])
        want = shift(fitted, ahead_s=1.0 / speed)
    np.testing.assert_allclose(stated, want, rtol=0.05)


def nutating(light: LightCurve, p, q, ratio: float) -> np.ndarray:
    """Flux (T,) of the body turned by e = p cos θ + q sin θ in its axes, θ from mid-pass; SciPy."""
    theta = ratio * np.linalg.norm(BODY.omega) * (light.t - 0.5 * np.ptp(light.t))
    e = np.cos(theta)[:, None] * p + np.sin(theta)[:, None] * q
    turn = Rotation.from_rotvec(light.t[:, None] * BODY.omega) * Rotation.from_rotvec(e)
    mu0, mu = (turn.inv().apply(v) @ BODY.normals.T for v in (light.sun, light.obs))
    return small_faults.diffuse(mu0, mu) @ BODY.areas


def test_the_shift_by_nutation_is_that_of_fits_to_the_worst_phase(monkeypatch):
    """At a half of the rate, of which 0.3° rms are √2 · 0.3° of amplitude."""
    monkeypatch.setattr(alternatives, "MAX_FREQUENCIES", 1)
    light = small_faults.light_curve(BODY, n=N, noise=1e-4, seed=5, n_sites=1, n_passes=1)
    pole = small_faults.unit(BODY.omega)
    first = small_faults.unit(np.cross(pole, [0.3, 0.5, 0.8]))
    axes, none = (first, np.cross(pole, first)), np.zeros(3)
    exact = replace(light, brightness=nutating(light, none, none, 0.5))
    problem = Problem(registry.find("faceted").bind({"n_facets": 2}), Epochs.of(exact))
    z = refit(problem, np.asarray(problem.ravel(BODY.sites)), exact)
    result = robustness.shifts(problem, z, Epochs.of(exact), exact, dict.fromkeys(QUANTITIES, 1.0))
    stated = result.by_fault["nutation_0.3_deg"][[result.quantities.index(k) for k in QUANTITIES]]
    moved, step = [], np.radians(0.03)
    for p, q in [(axis, none) for axis in axes] + [(none, axis) for axis in axes]:
        seen = (
            replace(light, brightness=nutating(light, s * p, s * q, 0.5)) for s in (-step, step)
        )
        before, after = (values(problem, refit(problem, z, curve), curve) for curve in seen)
        moved.append((after - before) / 2.0)
    want = 10.0 * np.sqrt(2.0) * np.linalg.norm(moved, axis=0)  # in any phase, of 0.3°
    np.testing.assert_allclose(stated, want, rtol=0.05)


def test_the_shift_of_a_late_pass_is_that_of_fits_to_such_times():
    """Another simulator; the sites of both passes are one, so no clock is a parameter."""

    def seen(late_s: float = 0.0, which: int = 0) -> LightCurve:
        fault = small_faults.Fault(late_pass_s=late_s, late_pass=which)
        return small_faults.light_curve(BODY, fault, n=N, noise=1e-4, seed=5, n_sites=1)

    exact = seen()
    problem = Problem(registry.find("faceted").bind({"n_facets": 2}), Epochs.of(exact))
    truth: dict[str, Any] = BODY.sites | {"rate_drift_unit": np.array(0.0)}
    z = refit(problem, np.asarray(problem.ravel(truth)), exact)
    result = robustness.shifts(problem, z, Epochs.of(exact), exact, dict.fromkeys(QUANTITIES, 1.0))
    stated = result.by_fault["late_pass_0.1_s"][[result.quantities.index(k) for k in QUANTITIES]]
    moved = []
    for which in (0, 1):
        curves = [seen(s, which) for s in (-0.1, 0.1)]
        before, after = (values(problem, refit(problem, z, light), light) for light in curves)
        moved.append(np.abs(after - before) / 2.0)
    np.testing.assert_allclose(stated, np.max(moved, axis=0), rtol=0.05)
    assert "clock_0.1_s" not in result.by_fault
