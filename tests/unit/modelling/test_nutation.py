"""Small nutation, against the exact motion of a rigid body and dense covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import nuisances, nutation, registry
from lcbayes.modelling.constrained import constrain_draws
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics import brightness
from lcbayes.results.posterior import dataset
from lcbayes.tasks.predict.brightness import predicted
from tests.helpers import small_faults

BODY = small_faults.body(1, 2)
ALONE = {"zero_point_sd": 0.0, "zero_point_spread": 0.0, "clock_sd": 0.0, "rate_drift_sd": 0.0}
RATIO = 0.6
MOMENTS = {"flat": (0.8, 1.1, 1.7), "long": (1.1, 0.9, 0.35)}  # the third is that of the spin


def problem_of(light, **options):
    data = Epochs.of(light)
    chosen = {"n_facets": 2, "nutation_ratio": RATIO} | options
    return Problem(registry.find("faceted").bind(chosen), data), data


def at_truth(problem, **more):
    known = {
        "normals_base": jnp.asarray(BODY.normals),
        "log_albedo_area": jnp.log(jnp.asarray(BODY.areas)),
        "omega_unit": jnp.asarray(BODY.omega / 0.1),
        "nutation_ratio_unit": jnp.array(0.0),
    }
    return problem.ravel(known | {k: jnp.asarray(v) for k, v in more.items()})


@pytest.mark.parametrize("spin", ["none", "torque-free"])
def test_nutation_without_a_constant_rate_is_refused(light, spin):
    with pytest.raises(InputError, match=f"nutation_ratio is 0.6, but --spin {spin} has no"):
        problem_of(light, spin=spin)


@pytest.fixture(scope="module")
def light():
    """Two nights of two sites, 24 points."""
    return small_faults.light_curve(BODY, n=24, spacing_s=86400.0)


def exact(t, moments, axes, tilt_deg):
    """Attitudes (T, 3, 3), body to inertial, of a free rigid body; axes (3, 3) are columns.

    The angular momentum is along the third axis of ``axes``, and about ``tilt_deg`` from that of
    the body.
    """
    rate, moments = np.linalg.norm(BODY.omega), np.array(moments)
    omega = rate * np.array([*(np.radians(tilt_deg) * np.array([0.6, -0.8])), 1.0])

    def motion(_t, state):
        turn, spin = Rotation.from_quat(state[:4]), state[4:]
        change = np.cross(moments * spin, spin) / moments
        x, y, z, w = turn.as_quat()
        vector = 0.5 * (w * spin + np.cross([x, y, z], spin))
        return np.concatenate([vector, [-0.5 * np.dot([x, y, z], spin)], change])

    momentum = moments * omega / np.linalg.norm(moments * omega)
    # the shortest rotation that takes the angular momentum to the third axis
    upright = Rotation.from_quat([momentum[1], -momentum[0], 0.0, 1.0 + momentum[2]])
    begin = np.concatenate([upright.as_quat(), omega])
    result = solve_ivp(motion, (0.0, t[-1]), begin, t_eval=t, rtol=1e-11, atol=1e-12)
    return np.array([axes @ Rotation.from_quat(q).as_matrix() @ axes.T for q in result.y[:4].T])


def flux(attitude, light):
    sun, obs = (np.einsum("tji,tj->ti", attitude, v) for v in (light.sun, light.obs))
    return small_faults.diffuse(sun @ BODY.normals.T, obs @ BODY.normals.T) @ BODY.areas


@pytest.mark.parametrize("kind", ["flat", "long"])
def test_the_response_is_that_of_the_exact_motion_to_first_order(kind):
    """The error is quadratic in the amplitude, for a spin about either stable axis."""
    light = small_faults.light_curve(BODY, n=60, n_sites=1, n_passes=1)
    i1, i2, i3 = MOMENTS[kind]
    ratio = float(np.sqrt((i3 - i1) * (i3 - i2) / (i1 * i2)))
    problem, data = problem_of(light, **ALONE, nutation_ratio=ratio)
    pole = small_faults.unit(BODY.omega)
    first = small_faults.unit(np.cross(pole, [0.3, 0.5, 0.8]))
    axes = np.stack([first, np.cross(pole, first), pole], axis=1)
    steady = flux(exact(light.t, MOMENTS[kind], axes, 0.0), light)
    known = problem.constrain(at_truth(problem), data)
    sites = {k: known[k] for k in problem.names}
    response = np.asarray(known["nutation_response"])
    misses, effects = [], []
    for tilt in (0.1, 0.2, 0.4):
        seen = flux(exact(light.t, MOMENTS[kind], axes, tilt), light)
        amounts = np.linalg.lstsq(response.T, seen - steady, rcond=None)[0]
        inserted = sites | {"nutation": jnp.stack([jnp.asarray(amounts), jnp.zeros(4)])}
        misses.append(np.abs(np.asarray(problem.flux(inserted, data)) - seen).max())
        effects.append(np.abs(seen - steady).max())
    np.testing.assert_allclose(np.asarray(known["flux"]), steady, rtol=1e-6, atol=1e-9)
    assert misses[0] < 0.01 * effects[0]
    np.testing.assert_allclose(np.divide(misses[1:], misses[:-1]), 4.0, rtol=0.15)
    np.testing.assert_allclose(np.divide(effects[1:], effects[:-1]), 2.0, rtol=0.1)


def test_the_response_is_averaged_over_the_exposures():
    """The mean of three instants with the weights of Gauss and Legendre, 5 : 8 : 5."""
    light = small_faults.light_curve(BODY, n=20, n_sites=1, n_passes=1)
    exposed, data = problem_of(replace(light, exposure_s=np.full(20, 6.0)), **ALONE)
    z = at_truth(exposed)
    sites = exposed.constrain(z, data)
    body = jnp.asarray(BODY.normals), jnp.asarray(BODY.areas)

    def instant(elapsed):
        sun, obs = (
            Rotation.from_rotvec(-(light.t + elapsed)[:, None] * BODY.omega).apply(v)
            for v in (light.sun, light.obs)
        )
        return nutation.with_torque(lambda s, o: brightness.flux(s, o, *body), sun, obs)

    step = 3.0 * np.sqrt(0.6)
    mean = (5 * instant(-step) + 8 * instant(0.0) + 5 * instant(step)) / 18
    pole = small_faults.unit(BODY.omega)
    first = small_faults.unit(np.cross(pole, np.eye(3)[np.argmin(np.abs(pole))]))
    along = np.radians(1.0) * np.stack([first, np.cross(pole, first)]) @ mean[1:]
    angle = RATIO * np.linalg.norm(BODY.omega) * np.asarray(data.nights.elapsed)
    want = np.concatenate([np.cos(angle) * along, np.sin(angle) * along])
    np.testing.assert_allclose(sites["flux"], mean[0], rtol=1e-9)
    np.testing.assert_allclose(sites["nutation_response"], want, rtol=1e-7, atol=1e-12)


def dense(light, sd, zero_point_sd):
    """Plain moments, zero-point columns (G, T), nutation columns (nights · 4, T)."""
    problem, data = problem_of(
        light, **(ALONE | {"zero_point_sd": zero_point_sd, "nutation_sd": sd})
    )
    plain, _ = problem_of(light, **ALONE, nutation_sd=0.0)
    z = at_truth(problem)
    mean, width = (np.asarray(x) for x in plain.moments(at_truth(plain), data))
    sites = problem.constrain(z, data)
    change = np.asarray(sites["nutation_response"])
    night = light.t > 43200.0
    wobble = np.concatenate([np.where(night == k, change, 0.0) for k in (False, True)])
    groups = [(light.site == s) & (night == k) for s in "AB" for k in (False, True)]
    return problem, data, z, sites, mean, width, -0.4 * np.log(10.0) * mean * groups, wobble


def test_zero_points_and_nutation_are_integrated_out(light):
    """The density and all moments are those of D + s² h hᵀ + u² Cᵀ C, dense."""
    problem, data, z, sites, mean, width, groups, wobble = dense(light, 0.8, 0.05)
    columns = np.concatenate([0.05 * groups, 0.8 * wobble])
    covariance = np.diag(width**2) + columns.T @ columns
    normal = multivariate_normal(mean, covariance)  # pyright: ignore[reportArgumentType]
    want = normal.logpdf(light.brightness)
    assert float(jnp.sum(problem.log_likelihood(z, data))) == pytest.approx(want, abs=1e-8)

    scale = np.r_[np.full(4, 0.05), np.full(8, 0.8)]
    gain = scale[:, None] * columns @ np.linalg.inv(covariance)
    expected = gain @ (light.brightness - mean)
    spread = np.diag(scale**2) - gain @ (columns * scale[:, None]).T

    def result(name=None, index=()):
        """Zero points and nutation with zeros for the normal numbers, but for one of them."""

        def normal(site):
            values = np.zeros(np.shape(sites[site]))
            if site == name:
                values[index] = 1.0
            return jnp.asarray(values)

        both = nuisances.jointly(sites, normal)
        return np.concatenate([np.ravel(both.zero_point), np.ravel(both.nutation)])

    np.testing.assert_allclose(result(), expected, atol=1e-9)
    numbers = [("zero_point_mean", (k,)) for k in range(4)]
    numbers += [("nutation_mean", (n, k)) for n in range(2) for k in range(4)]
    root = np.array([result(*one) - result() for one in numbers])
    np.testing.assert_allclose(root.T @ root, spread, atol=1e-9)


def test_correlated_noise_and_nutation_are_those_of_the_dense_covariance(light):
    """D + a² exp(−|Δt|/τ) within a pass of a site, and u² Cᵀ C within a night."""
    _, _, _, _, mean, width, groups, wobble = dense(light, 1.0, 0.05)
    problem, data = problem_of(light, **(ALONE | {"zero_point_sd": 0.05, "correlated_noise": True}))
    noise = {"log_correlated_sd": np.log(0.03), "log_correlated_time_s": np.log(40.0)}
    z = at_truth(problem, **noise)
    columns = np.concatenate([0.05 * groups, wobble])
    apart = np.abs(light.t[:, None] - light.t)
    covariance = np.diag(width**2) + columns.T @ columns
    size = 0.03 * np.abs(light.brightness).mean()
    together = (light.site[:, None] == light.site) & (apart < 600.0)
    covariance += size**2 * np.exp(-apart / 40.0) * together
    normal = multivariate_normal(mean, covariance)  # pyright: ignore[reportArgumentType]
    want = normal.logpdf(light.brightness)
    assert float(jnp.sum(problem.log_likelihood(z, data))) == pytest.approx(want, abs=1e-7)


@pytest.mark.parametrize(
    ("option", "says"),
    [({"nutation_sd": -1.0}, "nutation_sd is -1"), ({"nutation_ratio": 1.2}, "ratio between 0")],
)
def test_values_that_no_body_has_are_refused(light, option, says):
    with pytest.raises(InputError, match=says):
        problem_of(light, **option)


def test_without_a_ratio_there_is_no_nutation(light):
    with_it, data = problem_of(light, nutation_ratio=0.0)
    without, _ = problem_of(light, nutation_sd=0.0)
    assert with_it.names == without.names
    z = jnp.linspace(-1.0, 1.0, with_it.dim)
    assert float(with_it.potential(z, data)) == float(without.potential(z, data))


def test_predictions_contain_the_drawn_nutation():
    fault = small_faults.Fault(nutation_deg=2.0)
    light = small_faults.light_curve(BODY, fault, n=40, n_sites=1, n_passes=1)
    problem, data = problem_of(light, nutation_ratio=0.3)
    z = np.tile(np.asarray(at_truth(problem)), (1, 4, 1))
    draws = nuisances.drawn(constrain_draws(problem, z, data), np.random.default_rng(0))
    posterior = dataset(draws)
    assert posterior["nutation"].dims == ("chain", "draw", "night", "nutation_component")
    options = {"n_facets": 2, "nutation_ratio": 0.3}
    chi2 = []
    assert light.error is not None
    for known in (posterior, posterior.drop_vars("nutation")):
        result, _ = predicted(known, light, light, "faceted", options)
        chi2.append(np.sum(((light.brightness - result["flux_mean"]) / light.error) ** 2))
    assert chi2[0] < 60.0 < 100.0 < chi2[1]
