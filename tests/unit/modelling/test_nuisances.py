"""Zero points, clocks and a change of rate, against dense covariances and another simulator."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.stats import johnsonsu, multivariate_normal, norm

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import nuisances, registry, zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from tests.helpers import small_faults
from tests.helpers.small_faults import Fault

BODY = small_faults.body(1, 2)
ALONE = {"zero_point_sd": 0.0, "zero_point_spread": 0.0, "clock_sd": 0.0, "rate_drift_sd": 0.0}


def problem_of(light, **options):
    data = Epochs.of(light)
    return Problem(registry.find("faceted").bind({"n_facets": 2} | options), data), data


def at_truth(problem, **sites):
    known = {
        "normals_base": jnp.asarray(BODY.normals),
        "log_albedo_area": jnp.log(jnp.asarray(BODY.areas)),
        "omega_unit": jnp.asarray(BODY.omega / 0.1),
        "log_level": jnp.zeros(0),
    }
    return problem.ravel(known | {k: jnp.asarray(v) for k, v in sites.items()})


@pytest.fixture(scope="module")
def light():
    return small_faults.light_curve(BODY, n=32)


@pytest.mark.parametrize("kind", ["flux", "mag"])
def test_zero_points_are_integrated_out(light, kind):
    """The density is that of a Gaussian with covariance D + s² h hᵀ within each site."""
    if kind == "mag":
        m = -2.5 * np.log10(np.maximum(light.brightness, 0.02)) - 26.76
        error = np.full(32, 0.03)
        light = replace(light, kind="mag", brightness=m, error=error, range_km=np.full(32, 1e-3))
    problem, data = problem_of(light, **(ALONE | {"zero_point_sd": 0.05}))
    plain, _ = problem_of(light, **ALONE)
    z = at_truth(problem)
    mean, sd = (np.asarray(x) for x in plain.moments(z, data))
    h = np.ones(32) if kind == "mag" else -0.4 * np.log(10) * mean
    same = light.site[:, None] == light.site
    dense = multivariate_normal(mean, np.diag(sd**2) + 0.05**2 * np.outer(h, h) * same)
    result = float(jnp.sum(problem.log_likelihood(z, data)))
    assert result == pytest.approx(dense.logpdf(light.brightness), abs=1e-8)

    sites = problem.constrain(z, data)
    for g, site in enumerate(("A", "B")):
        here = light.site == site
        cross = 0.05**2 * h[here]
        gain = np.linalg.solve(dense.cov[np.ix_(here, here)], cross)
        want = gain @ (light.brightness - mean)[here]
        assert float(sites["zero_point_mean"][g]) == pytest.approx(want, abs=1e-10)
        want = np.sqrt(0.05**2 - gain @ cross)
        assert float(sites["zero_point_sd"][g]) == pytest.approx(want, rel=1e-8)


def test_half_of_the_variance_is_common_to_the_nights_of_a_site():
    """A has two nights and B one: s²/2 for each night, and s²/2 for each site."""
    light = small_faults.light_curve(BODY, n=48, spacing_s=86400.0)
    light = light.select(np.flatnonzero((light.site == "A") | (light.t < 43200.0)))
    problem, data = problem_of(light, **(ALONE | {"zero_point_sd": 0.05}))
    plain, _ = problem_of(light, **ALONE)
    z = at_truth(problem)
    mean, sd = (np.asarray(x) for x in plain.moments(at_truth(plain), data))
    h, site, night = -0.4 * np.log(10) * mean, light.site, light.t > 43200.0
    columns = h * np.array([site == "B", (site == "A") & ~night, (site == "A") & night])
    prior = 0.05**2 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.5, 1.0]])
    covariance = np.diag(sd**2) + columns.T @ prior @ columns
    want = multivariate_normal(mean, covariance)  # pyright: ignore[reportArgumentType]
    result = float(jnp.sum(problem.log_likelihood(z, data)))
    assert result == pytest.approx(want.logpdf(light.brightness), abs=1e-8)

    gain = prior @ columns @ np.linalg.inv(covariance)
    at_mean = nuisances.jointly(problem.constrain(z, data), lambda _: 0.0)
    order = [1, 2, 0]  # A, night 1; A, night 2; B
    np.testing.assert_allclose(
        at_mean.zero_point, (gain @ (light.brightness - mean))[order], atol=1e-10
    )
    root = zero_points.root(data)
    np.testing.assert_allclose(0.05**2 * root @ root.T, prior[np.ix_(order, order)], atol=1e-12)
    shared = np.array([[0.5, 0.0, 0.0], [0.0, 0.5, 0.5]]) * 0.05**2  # with B, A and A
    expected = (shared @ columns @ np.linalg.solve(covariance, light.brightness - mean))[::-1]
    np.testing.assert_allclose(at_mean.of_series, expected, atol=1e-10)


def test_sites_that_differ_in_all_nights_do_not_widen_the_nights():
    """Given ± 0.1 mag at two sites in each of two nights, the width of sites grows alone."""
    fault = Fault(zero_point=0.2)
    light = small_faults.light_curve(BODY, fault, n=96, noise=1e-3, spacing_s=86400.0)
    problem, data = problem_of(light, **(ALONE | {"zero_point_sd": 0.03, "zero_point_spread": 0.7}))
    unit = np.linspace(-2.5, 4.0, 27)
    likely = []
    for name, other in (("series_sd", "calibration_sd"), ("calibration_sd", "series_sd")):
        sites = {f"{other}_unit": 1.5 if other == "series_sd" else -1.0}
        z = [at_truth(problem, **sites, **{f"{name}_unit": u}) for u in unit]
        potential = [float(problem.potential(x, data)) for x in z]
        at_best = problem.constrain(z[int(np.argmin(potential))], data)
        likely.append(float(at_best[name]))
    of_sites, of_nights = likely
    assert of_nights < 0.03 / np.sqrt(2.0) < 0.05 < of_sites


def test_one_site_of_many_nights_has_independent_zero_points():
    """A part that all points share could not be told from the size of the body."""
    light = small_faults.light_curve(BODY, n=32, n_sites=1, spacing_s=86400.0)
    assert Epochs.of(light).n_calibrations == 2
    assert Epochs.of(light).n_series == 0


def test_the_width_of_zero_points_is_log_normal(light):
    """The density is that of zero points of sd s eᵇᵘ times that of u ~ Normal(0, 1)."""
    options = ALONE | {"zero_point_sd": 0.02}
    free, data = problem_of(light, **(options | {"zero_point_spread": 0.7}))
    known, _ = problem_of(light, **(options | {"zero_point_sd": 0.02 * np.exp(0.7 * 1.3)}))
    z = at_truth(free, calibration_sd_unit=1.3)
    sites = free.constrain(z, data)
    assert float(sites["calibration_sd"]) == pytest.approx(0.02 * np.exp(0.91))
    apart = free.potential(z, data) - known.potential(at_truth(known), data)
    assert float(apart) == pytest.approx(0.5 * 1.3**2 + 0.5 * np.log(2 * np.pi), abs=1e-9)

    expected = free.fisher(z, data)[free.rows(["calibration_sd_unit"])[0]]
    assert np.isfinite(expected).all()


def test_zero_points_that_differ_widen_what_is_expected_of_others():
    """Given zero points of ± 0.2 mag at two sites, their sd is larger than a priori."""
    widths = []
    for fault in (0.0, 0.4):
        light = small_faults.light_curve(BODY, Fault(zero_point=fault), n=64, noise=1e-3)
        problem, data = problem_of(
            light, **(ALONE | {"zero_point_sd": 0.03, "zero_point_spread": 0.7})
        )
        unit = np.linspace(-2.5, 4.0, 27)
        z = [at_truth(problem, calibration_sd_unit=u) for u in unit]
        potential = np.array([float(problem.potential(x, data)) for x in z])
        widths.append(0.03 * np.exp(0.7 * unit[np.argmin(potential)]))
    assert widths[0] < 0.03 < 0.08 < widths[1]


def test_correlated_noise_and_zero_points_are_those_of_the_dense_covariance(light):
    """D + a² exp(−|Δt|/τ) within a pass of a site, and s² h hᵀ within a site."""
    options = ALONE | {"zero_point_sd": 0.05, "correlated_noise": True}
    problem, data = problem_of(light, **options)
    plain, _ = problem_of(light, **ALONE)
    noise = {"log_correlated_sd": np.log(0.03), "log_correlated_time_s": np.log(40.0)}
    z = at_truth(problem, **noise)
    mean, sd = (np.asarray(x) for x in plain.moments(at_truth(plain), data))
    h = -0.4 * np.log(10) * mean
    same = light.site[:, None] == light.site
    apart = np.abs(light.t[:, None] - light.t)
    size = 0.03 * np.abs(light.brightness).mean()
    covariance = np.diag(sd**2) + 0.05**2 * np.outer(h, h) * same
    covariance += size**2 * np.exp(-apart / 40.0) * (same & (apart < 600.0))
    want = multivariate_normal(mean, covariance).logpdf(light.brightness)
    assert float(jnp.sum(problem.log_likelihood(z, data))) == pytest.approx(want, abs=1e-7)

    gain = 0.05**2 * (h * (light.site == "A")) @ np.linalg.inv(covariance)
    result = problem.constrain(z, data)["zero_point_mean"][0]
    assert float(result) == pytest.approx(gain @ (light.brightness - mean), abs=1e-9)

    total = jax.jit(lambda z: problem.log_likelihood(z, data).sum())
    slope = jax.jit(jax.grad(total))(z)
    step = 1e-5 * jnp.eye(len(z))
    numeric = [(total(z + e) - total(z - e)) / 2e-5 for e in step[problem.rows(noise)]]
    np.testing.assert_allclose(slope[problem.rows(noise)], numeric, rtol=1e-5)


def test_information_on_the_body_is_that_of_the_dense_covariance(light):
    """Jᵀ C⁻¹ J of magnitudes, whose zero points do not depend on the body."""
    m = -2.5 * np.log10(np.maximum(light.brightness, 0.02)) - 26.76
    error = np.full(32, 0.03)
    light = replace(light, kind="mag", brightness=m, error=error, range_km=np.full(32, 1e-3))
    problem, data = problem_of(light, **(ALONE | {"zero_point_sd": 0.05}))
    plain, _ = problem_of(light, **ALONE)
    z = at_truth(problem)
    jacobian = np.asarray(jax.jacfwd(lambda z: plain.moments(z, data).mean)(z))
    same = light.site[:, None] == light.site
    covariance = 0.03**2 * np.eye(32) + 0.05**2 * same
    want = jacobian.T @ np.linalg.solve(covariance, jacobian)
    result = problem.fisher(z, data) - problem.prior_precision(z, data)
    np.testing.assert_allclose(result, want, rtol=1e-7, atol=1e-6)


def test_drawn_zero_points_have_their_mean_and_sd():
    rng = np.random.default_rng(0)
    mean, sd = np.full((2, 5000, 1), 0.1), np.full((2, 5000, 1), 0.02)
    result = nuisances.drawn({"a": mean, "zero_point_mean": mean, "zero_point_sd": sd}, rng)
    assert sorted(result) == ["a", "zero_point"]
    assert result["zero_point"].mean() == pytest.approx(0.1, abs=1e-3)
    assert result["zero_point"].std() == pytest.approx(0.02, rel=0.03)


@pytest.mark.parametrize(
    ("fault", "site"),
    [
        (Fault(clock=0.5), {"clock_offset_unit": [0.0, np.arcsinh(-0.7 * 0.5 / 0.3) / 0.7, 0.0]}),
        (Fault(drift=0.02), {"rate_drift_unit": 2.0}),
    ],
)
def test_brightness_with_a_fault_is_that_of_another_simulator(fault, site):
    light = small_faults.light_curve(BODY, fault, n=80, noise=1e-9)
    problem, data = problem_of(light, zero_point_sd=0.0)  # their sums round at such small errors
    neutral = {"clock_offset_unit": np.zeros(3), "rate_drift_unit": 0.0}
    # the sd of the drift falls where the middle would move by a turn
    phase = 0.01 * np.linalg.norm(BODY.omega) * float(data.t_span) / 8.0
    scale = {"rate_drift_unit": np.sqrt(1.0 + phase**2)}
    shifted = {k: np.asarray(v) * scale.get(k, 1.0) for k, v in site.items()}
    result, without = (
        np.asarray(problem.constrain(at_truth(problem, **(neutral | s)), data)["expected"])
        for s in (shifted, {})
    )
    miss, effect = (np.abs(x - light.brightness).max() for x in (result, without))
    # directions are moved linearly to the true times
    assert miss < (0.03 if fault.clock else 1e-6) * effect
    assert effect > 0.005 * light.brightness.max()


@pytest.mark.parametrize("spin", ["free", "torque-free"])
@pytest.mark.parametrize("clock_sd", [0.0, 2.0])
def test_a_body_with_a_drift_moves_on_from_the_state_that_is_recorded(light, spin, clock_sd):
    """Cosines at all times, from the recorded ω, inertia and normals at t = 0 by integration."""
    problem, data = problem_of(light, spin=spin, omega_sd=0.05, clock_sd=clock_sd)
    z = problem.prior_draw(jax.random.key(3), data)
    z = z.at[problem.rows(["rate_drift_unit"])].set(2.0)
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    t, middle, span = np.asarray(data.t), float(data.t_middle), float(data.t_span)
    drift = float(sites["rate_drift"])
    assert drift * span * np.linalg.norm(sites["omega"]) / 8.0 > 0.02  # rad, in the middle
    late = sites.get("clock_offset", np.zeros(2))[np.asarray(data.observer)]
    moved = t + late + drift * ((t + late - middle) ** 2 - middle**2) / (2.0 * span)
    tensor = sites.get("inertia", np.eye(3))

    def rates(_, state):
        turn = state[:9].reshape(3, 3)
        omega = turn @ np.linalg.solve(tensor, turn.T @ (tensor @ sites["omega"]))
        return np.cross(omega, turn, axisb=0, axisc=0).ravel()

    start = np.eye(3).ravel()
    both = [
        solve_ivp(rates, (0.0, end), start, "DOP853", dense_output=True, rtol=1e-11, atol=1e-12)
        for end in (moved.min(), moved.max())
    ]
    path = [both[int(x > 0.0)].sol(x) for x in moved]
    turns = np.array(path).reshape(-1, 3, 3)
    base = sites["normals_base"] / np.linalg.norm(sites["normals_base"], axis=1, keepdims=True)
    obs = data.obs + late[:, None] * data.obs_rate
    for name, direction in (("sun_body", data.sun), ("obs_body", obs)):
        cosines = np.einsum("ti,tij,nj->tn", direction, turns, sites["normals"])
        np.testing.assert_allclose(sites[name] @ base.T, cosines, atol=1e-8)


def test_clocks_are_late_by_much_more_often_than_normal_numbers():
    """The density of offsets is that of Johnson's S_U distribution."""
    light = small_faults.light_curve(BODY, n=32)
    problem, data = problem_of(light, **(ALONE | {"clock_sd": 0.3}))
    late = np.array([-2.0, -0.4, 0.1, 1.0, 2.5])
    units = [nuisances.normal_of(x / 0.3) for x in late]
    z = [at_truth(problem, clock_offset_unit=[0.0, u, 0.0]) for u in units]
    offset = [float(problem.constrain(x, data)["clock_offset"][1]) for x in z]
    np.testing.assert_allclose(offset, late, rtol=1e-12)

    su: Any = johnsonsu(0.0, 1.0 / 0.7, scale=0.3 / 0.7)
    density = norm.logpdf(units) - np.log(np.cosh(0.7 * np.array(units)) * 0.3)  # of the offset
    np.testing.assert_allclose(density, su.logpdf(late), rtol=1e-10)
    assert 2.0 * su.sf(4.0 * 0.3) > 0.01 > 100.0 * 2.0 * norm.sf(4.0)


def test_an_offset_of_all_clocks_is_one_coordinate():
    light = small_faults.light_curve(BODY, n=32)
    plain, data = problem_of(light, **(ALONE | {"clock_sd": 0.3}))
    turned = Problem(plain.model, data, nuisances.clock_coordinates(data, 0.3))
    rows = turned.rows(["clock_offset_unit"])
    at = []
    for common in (-0.5, 0.0, 0.7):
        unit = nuisances.normal_of((np.array([0.1, -1.9, 0.0]) + common) / 0.3)
        sites = plain.constrain(at_truth(plain, clock_offset_unit=unit), data)
        at.append(np.asarray(turned.ravel(sites)))
    np.testing.assert_allclose(np.diff(np.array(at)[:, rows[1]]), 0.0, atol=1e-12)
    assert at[0][rows[1]] == pytest.approx(-2.0 / 0.3)
    y = jnp.asarray(at[2])
    z = plain.ravel(turned.constrain(y, data))
    jacobian = jax.jacfwd(lambda y: plain.ravel(turned.constrain(y, data)))(y)
    change = float(turned.potential(y, data)) - float(plain.potential(z, data))
    assert change == pytest.approx(-np.linalg.slogdet(jacobian)[1], abs=1e-8)
    assert nuisances.clock_coordinates(data, 0.0) == {}


def test_there_is_no_fault_where_the_data_cannot_contain_it():
    light = small_faults.light_curve(BODY, n=40, n_sites=1, n_passes=1)
    alone, _ = problem_of(light, **ALONE)
    default, _ = problem_of(light)
    assert default.names == alone.names
    z = at_truth(alone)
    data = Epochs.of(light)
    assert float(default.potential(z, data)) == float(alone.potential(z, data))
    two, _ = problem_of(small_faults.light_curve(BODY, n=40, n_sites=2, n_passes=1))
    faults = {"calibration_sd_unit", "clock_offset_unit", "rate_drift_unit"}
    assert set(two.names) - set(alone.names) == faults
    two, _ = problem_of(small_faults.light_curve(BODY, n=40, n_sites=1, n_passes=2))
    assert set(two.names) - set(alone.names) == {"rate_drift_unit"}


def test_replicates_follow_the_fitted_zero_points(light):
    """0.3 mag between the sites is in the replicates, although the body does not explain it."""
    fainter = light.brightness * np.where(light.site == "B", 10 ** (-0.4 * 0.3), 1.0)
    problem, data = problem_of(
        replace(light, brightness=fainter, error=light.error / 20),
        **(ALONE | {"zero_point_sd": 1.0}),
    )
    z = at_truth(problem)
    keys = jax.random.split(jax.random.key(0), 200)
    drawn = np.asarray(jax.vmap(problem.replicate, (None, None, 0))(z, data, keys))
    bright = fainter > 0.3 * fainter.max()
    ratio = (drawn.mean(axis=0) / fainter)[bright]
    assert np.all(np.abs(ratio - 1.0) < 0.15)


def test_a_negative_width_is_refused(light):
    with pytest.raises(InputError, match="clock_sd is -1"):
        problem_of(light, clock_sd=-1.0)
