"""Tests of residuals: their false alarms, what they detect, and the amounts of alternatives."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import correlation, misfit_tests, robustness, search
from lcbayes.inference.alternatives import alternatives, names_of
from lcbayes.inference.goodness_of_fit import measure
from lcbayes.inference.misfit_tests import Projection, examine
from lcbayes.inference.solutions import completed, optimum
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.results.reasons import why
from tests.helpers import small_curves, small_faults
from tests.helpers.false_alarms import EACH, counts
from tests.helpers.small_faults import Fault

N = 120
BODY = small_faults.body(1, 2)
# clocks of two observers, whose passes are separate, and a change of rate
WITHOUT_FAULTS: dict[str, Any] = {
    "calibration_sd_unit": np.array(0.0),
    "clock_offset_unit": np.zeros(3),
    "rate_drift_unit": np.array(0.0),
}
SD = np.r_[np.full(5, 1.0), 0.02, 0.01]  # the prior determines the last two in part


def basis() -> np.ndarray:
    return np.random.default_rng(8).standard_normal((N, SD.size))


@pytest.fixture(scope="module")
def linear():
    """A flux that is linear in parameters with Gaussian priors; errors of 0.1."""
    columns = jnp.asarray(basis())

    def model(data):
        c = jnp.asarray(numpyro.sample("c", dist.Normal(0.0, jnp.asarray(SD)).to_event(1)))
        likelihood.observe(data, 10.0 + columns @ c)

    light = small_curves.curve(N, brightness=np.full(N, 10.0), error=np.full(N, 0.1))
    return Problem(model, Epochs.of(light)), light


def fits(problem, data, noise, keys):
    """The data and the best fit for truths drawn from the prior."""

    def one(key, noise):
        truth = problem.prior_draw(key, data)
        seen = replace(data, brightness=problem.moments(truth, data).mean + 0.1 * noise)
        begin = search.SearchState(
            truth[None], jnp.full(1, jnp.inf), jnp.full(1, 1e-3), jnp.zeros(1)
        )
        return seen.brightness, search.advance(problem, seen, begin, 50).z[0]

    return map(np.asarray, jax.jit(jax.vmap(one))(keys, jnp.asarray(noise)))


def test_residuals_follow_the_dense_covariance(linear):
    problem, light = linear
    data = Epochs.of(light)
    maker = Projection.of(problem, np.zeros(SD.size), data)
    whitened = basis() / 0.1
    dense = np.linalg.inv(np.eye(N) + whitened @ np.diag(SD**2) @ whitened.T)
    np.testing.assert_allclose(maker.left(np.eye(N)), dense, atol=1e-6)
    rng = np.random.default_rng(0)
    drawn = maker.residuals(rng.standard_normal((40_000, N)), rng)
    error = np.sqrt((np.outer(np.diag(dense), np.diag(dense)) + dense**2) / 40_000)
    assert np.abs((drawn.T @ drawn / 40_000 - dense) / error).max() < 6.0
    for column in whitened.T[-2:]:  # parameters that prior and data determine together
        want = column @ dense @ column
        assert np.var(drawn @ column) == pytest.approx(want, rel=6.0 * np.sqrt(2 / 40_000))


@pytest.mark.statistical(false_alarm=EACH)
def test_the_truth_is_refused_as_often_as_stated(linear):
    problem, light = linear
    data, n = Epochs.of(light), 300
    noise = np.random.default_rng(1).standard_normal((n, N))
    keys = jax.random.split(jax.random.key(1), n)
    refused = [
        bool(examine(problem, z, replace(data, brightness=jnp.asarray(y)), light).refused)
        for y, z in zip(*fits(problem, data, noise, keys), strict=True)
    ]
    least, most = counts(n, misfit_tests.FALSE_ALARM)
    assert least <= sum(refused) <= most


def test_correlated_noise_of_the_stated_size_is_not_refused(linear):
    problem, light = linear
    data, n = Epochs.of(light), 40
    rng = np.random.default_rng(2)
    root = np.linalg.cholesky(0.85 ** np.abs(np.subtract.outer(np.arange(N), np.arange(N))))
    noise = rng.standard_normal((n, N)) @ root.T
    keys = jax.random.split(jax.random.key(2), n)
    refused, tempered = 0, 0
    for y, z in zip(*fits(problem, data, noise, keys), strict=True):
        seen = correlation.tempered(problem, z, replace(data, brightness=jnp.asarray(y)))
        tempered += bool(seen.information < 1.0)
        refused += bool(examine(problem, z, seen, light).refused)
    assert tempered > 0.9 * n
    assert refused <= 4


@pytest.fixture(scope="module")
def faceted():
    light = small_faults.light_curve(BODY, n=120)
    return Problem(registry.find("faceted").bind({"n_facets": 2}), Epochs.of(light))


@pytest.fixture(scope="module")
def exact():
    """With exact clocks and zero points: faults of these are not taken up by the model."""
    light = small_faults.light_curve(BODY, n=120)
    options = {"n_facets": 2, "zero_point_sd": 0.0, "clock_sd": 0.0}
    return Problem(registry.find("faceted").bind(options), Epochs.of(light))


def best_fit(problem, light):
    sites = BODY.sites | WITHOUT_FAULTS
    data = Epochs.of(light)
    z, _ = optimum(problem, data, np.asarray(problem.ravel(sites)), np.arange(problem.dim))
    return z, correlation.tempered(problem, z, data)


@pytest.mark.parametrize(
    ("fault", "name", "says"),
    [
        (Fault(zero_point=0.5), "zero-point", "mag brighter than the model"),  # site A
        (Fault(clock=3.0), "clock", "the times of B are"),
        (Fault(nutation_deg=2.5), "nutation", "the body nutates by"),
        (Fault(lobe=0.4), "lobe", "facet 0 has a weak lobe of exponent 30"),
        (Fault(lommel_seeliger=0.5), "law", "scatters in part by the law of Lommel and Seeliger"),
        (Fault(slope=0.15), "pass-slope", "the brightness of B changes by 0.148"),
    ],
)
def test_a_gross_fault_is_refused_and_named(exact, fault, name, says):
    light = small_faults.light_curve(BODY, fault, n=120, seed=3)
    z, data = best_fit(exact, light)
    result = examine(exact, z, data, light)
    assert result.refused
    assert result.cause is not None
    assert result.cause.name == name
    assert says in why(measure(exact, data, z[None], result))


def test_a_p_value_below_all_drawn_ones_is_an_upper_limit(faceted):
    light = small_faults.light_curve(BODY, Fault(error_factor=3.0), n=120, seed=3)
    z, data = best_fit(faceted, light)
    result = examine(faceted, z, data, light)
    chi2 = next(t for t in result.tests if t.name == "chi2")
    assert chi2.upper_limit
    assert chi2.p_value == pytest.approx(1 / 4001)
    assert "(p < 0.0003)" in why(measure(faceted, data, z[None], result))
    sound = small_faults.light_curve(BODY, n=120, seed=3)
    z, data = best_fit(faceted, sound)
    assert not any(t.upper_limit for t in examine(faceted, z, data, sound).tests)


def test_errors_that_are_too_small_are_named(faceted):
    light = small_faults.light_curve(BODY, Fault(error_factor=1.5), n=120, seed=3)
    z, data = best_fit(faceted, light)
    result = examine(faceted, z, data, light)
    assert result.cause is None
    assert "the errors are 1.4 times too small" in why(measure(faceted, data, z[None], result))


def test_outliers_are_told_from_errors_that_are_too_small(faceted):
    rng = np.random.default_rng(8)
    light = small_faults.light_curve(BODY, n=120, seed=3)
    assert light.error is not None
    far = rng.choice(light.t.size, light.t.size // 20, replace=False)
    away = light.error[far] * rng.choice([-7.0, 7.0], far.size)
    brightness = light.brightness.copy()
    brightness[far] += away
    spoilt = replace(light, brightness=brightness)
    z, data = best_fit(faceted, spoilt)
    result = examine(faceted, z, data, spoilt)
    assert result.kurtosis is not None
    assert result.kurtosis > 5.0
    assert "try --noise student-t" in why(measure(faceted, data, z[None], result))
    flash = light.brightness.copy()
    flash[40:46] += 7.0 * light.error[40:46]
    together = replace(light, brightness=flash)
    z, data = best_fit(faceted, together)
    assert examine(faceted, z, data, together).kurtosis is None


@pytest.mark.parametrize("factor", [3.0, 10.0])
def test_errors_that_are_far_too_small_are_named_before_an_alternative(faceted, factor):
    """They enlarge the gain of every alternative, such as a further facet."""
    for seed in range(4):
        light = small_faults.light_curve(BODY, Fault(error_factor=factor), n=120, seed=seed)
        z, data = best_fit(faceted, light)
        result = examine(faceted, z, data, light)
        assert any(e.p_value < result.limit for e in result.explanations)
        assert result.cause is None
        says = why(measure(faceted, data, z[None], result))
        named = re.search(r"the errors are ([0-9.]+) times too small", says)
        assert named is not None
        assert float(named[1]) == pytest.approx(factor, rel=0.25)
        assert result.even == ("since the residuals are white" in says)
        assert result.kurtosis is None
    assert result.even


def test_a_fault_is_named_although_the_errors_are_too_small(exact):
    fault = Fault(error_factor=3.0, clock=6.0)
    light = small_faults.light_curve(BODY, fault, n=120, seed=3)
    z, data = best_fit(exact, light)
    result = examine(exact, z, data, light)
    assert result.cause is not None
    assert result.cause.name == "clock"
    assert not result.even


def test_a_late_pass_is_refused_and_named():
    """Three passes of one site, of which the last is late."""
    fault = Fault(late_pass_s=2.0, late_pass=2)
    light = small_faults.light_curve(BODY, fault, n=120, seed=3, n_sites=1, n_passes=3)
    problem = Problem(registry.find("faceted").bind({"n_facets": 2}), Epochs.of(light))
    z, data = best_fit(problem, light)
    result = examine(problem, z, data, light)
    assert result.cause is not None
    assert (result.cause.name, result.cause.about) == ("late-pass", "pass 3")
    assert result.cause.amount == pytest.approx(-2.0, abs=3.0 * result.cause.sd + 0.2)
    assert "the times of pass 3 are" in why(measure(problem, data, z[None], result))


@pytest.mark.parametrize(("late", "rough"), [(0.5, False), (12.0, True)])
def test_a_clock_that_is_late_by_a_large_part_of_a_turn_is_beyond_the_linear_range(
    exact, late, rough
):
    fault = Fault(clock=late)
    light = small_faults.light_curve(BODY, fault, n=120, seed=3)
    z, data = best_fit(exact, light)
    cause = examine(exact, z, data, light).cause
    assert cause is not None
    assert cause.rough == rough


@pytest.mark.slow
def test_a_model_with_the_nutation_that_the_residuals_show_explains_them(faceted):
    light = small_faults.light_curve(BODY, Fault(nutation_deg=1.0), n=120, seed=3)
    z, data = best_fit(faceted, light)
    cause = examine(faceted, z, data, light).cause
    assert cause is not None
    assert cause.name == "nutation"
    options = {"n_facets": 2, "nutation_ratio": float(cause.version.split()[0])}
    with_it = Problem(registry.find("faceted").bind(options), data)
    begin = completed(faceted, with_it, data, z[None])[0]
    z_new, _ = optimum(with_it, data, begin, np.arange(with_it.dim))
    result = with_it.constrain(jnp.asarray(z_new), data)
    # 0.3 in body axes, but for whole turns of the phase between passes 900 s apart
    phase = (float(result["nutation_ratio"]) - 0.3) * np.linalg.norm(BODY.omega) * 900.0
    assert np.cos(phase) > 0.9
    size = np.sqrt(0.5 * np.sum(np.asarray(result["nutation_mean"]) ** 2))
    assert size == pytest.approx(1.0, rel=0.3)
    assert not examine(with_it, z_new, data, light).refused


@pytest.mark.statistical(false_alarm=EACH)
def test_a_right_model_of_facets_is_refused_as_often_as_stated(faceted):
    refused, n = 0, 20
    for seed in range(n):
        light = small_faults.light_curve(BODY, n=120, seed=seed)
        z, data = best_fit(faceted, light)
        refused += bool(examine(faceted, z, data, light).refused)
    assert refused <= counts(n, misfit_tests.FALSE_ALARM)[1]


@pytest.mark.parametrize(
    ("fault", "name", "amount"),
    [
        (Fault(zero_point=0.02), "zero-point", 0.02),
        (Fault(clock=0.1), "clock", -0.1),
        (Fault(drift=0.001), "rate-drift", 0.1),
        (Fault(nutation_deg=0.05), "nutation", 0.05),
        (Fault(lobe=0.02), "lobe", 0.02),
        (Fault(slope=0.02), "pass-slope", 0.02),
    ],
)
def test_columns_are_the_changes_of_another_simulator(fault, name, amount):
    """Without noise and at the truth, the column of an alternative is the effect of the fault."""
    light = small_faults.light_curve(BODY, n=120, noise=1e-3)
    data = Epochs.of(light)
    sites = BODY.sites | WITHOUT_FAULTS
    problem = Problem(registry.find("faceted").bind({"n_facets": 2, "zero_point_sd": 0.0}), data)
    z = np.asarray(problem.ravel(sites))
    with_fault = small_faults.light_curve(BODY, fault, n=120, noise=1e-9)
    without = small_faults.light_curve(BODY, n=120, noise=1e-9)
    if fault.clock:  # the order of the points changes with their times
        return _clock_column(problem, z, data, light)
    assert light.error is not None
    effect = (with_fault.brightness - without.brightness) / light.error
    result = [a for a in alternatives(problem, z, data, names_of(light)) if a.name == name]
    chosen = next((a for a in result if a.about in ("B", "facet 0")), result[0])
    best = np.inf
    for columns in chosen.columns:
        fitted, left, *_ = np.linalg.lstsq(columns.T, effect, rcond=None)
        if left < best:
            best, size = left, np.linalg.norm(fitted)
    assert best < (0.1 if name == "nutation" else 0.01) * effect @ effect
    assert size == pytest.approx(amount, rel=0.1)
    return None


@pytest.mark.parametrize("spin", ["free", "torque-free"])
def test_the_law_of_the_model_is_no_alternative(spin):
    """The facets are where the model has them, also if its axes are inertial at another time."""
    light = small_faults.light_curve(BODY, n=120)
    data = Epochs.of(light)
    entry = registry.find("faceted")
    problem = Problem(entry.bind({"n_facets": 2, "spin": spin, "clock_sd": 3.0}), data)
    z = np.asarray(problem.prior_draw(jax.random.key(3), data))
    (law,) = [a for a in alternatives(problem, z, data, names_of(light)) if a.name == "law"]
    assert len(law.labels) == 2
    assert not any("Ashikhmin" in one for one in law.labels)


def _clock_column(problem, z, data, light):
    """The flux of the simulator at times and directions that differ by a second either way."""
    result = next(
        a
        for a in alternatives(problem, z, data, names_of(light))
        if (a.name, a.about) == ("clock", "B")
    )
    change = [
        small_faults.flux(
            BODY,
            light.t + step,
            light.sun,
            _unit(light.obs + step * np.asarray(data.obs_rate)),
            Fault(),
        )
        for step in (0.01, -0.01)
    ]
    want = np.where(light.site == "B", (change[0] - change[1]) / 0.02 / light.error, 0.0)
    np.testing.assert_allclose(result.columns[0, 0], want, atol=1e-3 * np.abs(want).max())


def _unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def test_amounts_are_those_of_a_fit_with_the_alternative(exact):
    """Least squares with the column as a further parameter, in NumPy."""
    light = small_faults.light_curve(BODY, Fault(clock=3.0), n=120, seed=3)
    z, data = best_fit(exact, light)
    result = examine(exact, z, data, light)
    one = next(e for e in result.explanations if (e.name, e.about) == ("clock", "B"))
    column = next(
        a.columns[0, 0]
        for a in alternatives(exact, z, data, names_of(light))
        if (a.name, a.about) == ("clock", "B")
    )
    maker = Projection.of(exact, z, data)
    both = np.column_stack([maker.jacobian, column])
    prior = np.zeros((both.shape[1], both.shape[1]))
    prior[:-1, :-1] = maker.prior_root @ maker.prior_root
    residuals = misfit_tests.residuals(exact, z, data)
    score = np.append(np.zeros(len(z)), column @ residuals)  # the slope vanishes at the best fit
    amount = np.linalg.solve(both.T @ both + prior, score)[-1]
    assert one.amount == pytest.approx(amount, rel=1e-3)


def test_a_result_moves_as_far_as_stated(faceted):
    """A zero point of 0.03 mag and clock of 0.1 s, against fits to data that have them."""
    exact = small_faults.light_curve(BODY, n=120, seed=5)
    z, data = best_fit(faceted, exact)
    table = {"omega_x_rad_s": 1e-4, "albedo_area[0]": 0.01, "g[1]": 0.01}
    result = robustness.shifts(faceted, z, data, exact, table)
    before = np.array([_values(faceted, z, data)[k] for k in result.quantities])
    unit = np.array([table[k] for k in result.quantities])
    moved = []
    for site in "AB":
        fainter = np.where(exact.site == site, 10 ** (-0.4 * 0.03), 1.0)
        z_new, seen = best_fit(faceted, replace(exact, brightness=exact.brightness * fainter))
        after = np.array([_values(faceted, z_new, seen)[k] for k in result.quantities])
        moved.append(np.abs(after - before) / unit)
    want = np.max(moved, axis=0)
    # the best fit is within 0.01 nats of the optimum, 0.14 sd
    np.testing.assert_allclose(result.by_fault["zero_point_0.03_mag"], want, rtol=0.1, atol=0.14)
    assert set(result.by_fault) == {
        "clock_0.1_s",
        "late_pass_0.1_s",
        "zero_point_0.03_mag",
        "rate_drift_1_percent",
        "nutation_0.3_deg",
        "errors_1.4_times",
    }
    assert np.all(result.by_fault["errors_1.4_times"] < 0.41)


def _values(problem, z, data):
    return robustness._quantities(problem, z, data)
