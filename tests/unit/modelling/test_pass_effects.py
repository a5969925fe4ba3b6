"""What the points of one pass share is integrated out, and whole passes are outliers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro import handlers
from scipy import integrate, stats
from scipy.special import logsumexp

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data import segments
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import goodness_of_fit
from lcbayes.modelling import likelihood, pass_effects
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from tests.helpers.false_alarms import EACH, counts

NUMBER = np.array([2, 0, 0, 1, 2, 2, 0, 3])  # out of order, and one pass of one point
T = np.array([5.0, 1.0, 0.0, 3.0, 4.0, 6.0, 2.0, 7.0])
ORDER = np.array([2, 1, 6, 3, 4, 0, 5, 7])
FIRST, LAST = np.array([0, 0, 0, 3, 4, 4, 4, 7]), np.array([2, 2, 2, 3, 6, 6, 6, 7])
X = T - np.array([5.0, 1.0, 1.0, 3.0, 5.0, 5.0, 1.0, 7.0])
TOGETHER = pass_effects.Passes(*map(jnp.asarray, (ORDER, FIRST, LAST, X)))


def curve(n_each: int = 3) -> LightCurve:
    """Two satellites, two passes each, a day apart, one of them from two sites."""
    n = 4 * n_each
    unit = np.tile([0.0, 0.6, 0.8], (n, 1))
    day = np.repeat([0.0, 86400.0, 0.0, 86400.0], n_each).astype(float)
    t = np.asarray(day + np.tile(30.0 * np.arange(n_each), 4), float)
    site = np.full(n, "north")
    site[-1] = "south"
    return LightCurve(
        t=t,
        brightness=np.linspace(5.0, 6.0, n),
        error=np.full(n, 0.1),
        kind="mag",
        sun=unit,
        obs=unit,
        curve=np.repeat([0, 1], 2 * n_each),
        curve_names=("a", "b"),
        free_scale=np.zeros(2, bool),
        site=site,
        range_km=np.full(n, 1e-3),
    )


def test_passes_are_of_one_group_and_site_without_a_gap():
    assert segments.pass_numbers(curve()).tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 4]
    in_turn = curve().select([0, 6, 1, 7, 3, 9, 4, 11])  # rows of the two satellites
    assert segments.pass_numbers(in_turn).tolist() == [0, 2, 0, 2, 1, 3, 1, 4]
    assert Epochs.of(curve()).has_passes
    one = curve().select(np.arange(6))
    assert not Epochs.of(one).has_passes  # one satellite
    assert not Epochs.of(curve().select([0, 1, 2, 6, 7, 8])).has_passes  # one pass each
    assert not Epochs.of(curve().select([0, 3, 6, 9])).has_passes  # one point each


def test_sums_over_passes():
    x = np.arange(1.0, 9.0)
    before = [sum(x[(NUMBER[k] == NUMBER) & (T[k] > T)]) for k in range(8)]
    np.testing.assert_allclose(TOGETHER.before(jnp.asarray(x)), before)
    total = [x[number == NUMBER].sum() for number in NUMBER]
    np.testing.assert_allclose(TOGETHER.total(jnp.asarray(x)), total)
    assert TOGETHER.of_first(jnp.asarray(x)).tolist() == [5, 3, 3, 4, 5, 5, 3, 8]


def drawn(seed: int = 0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=8), rng.normal(size=8), rng.uniform(0.1, 0.5, 8)


def test_innovations_make_up_the_joint_density():
    """Beside the normal law of the whole covariance, diag σ² + τ² + υ² x x' in blocks."""
    y, mean, sd = drawn()
    loc, scale = pass_effects.innovations(TOGETHER, *map(jnp.asarray, (y, mean, sd, 0.7, 0.4)))
    whole = np.diag(sd**2) + (0.49 + 0.16 * np.outer(X, X)) * (NUMBER[:, None] == NUMBER)
    want = stats.multivariate_normal(mean, whole).logpdf(y)
    assert float(stats.norm.logpdf(y, loc, scale).sum()) == pytest.approx(want, rel=1e-12)
    alone = pass_effects.innovations(
        TOGETHER.without_passes(), *map(jnp.asarray, (y, mean, sd, 0.7, 0.4))
    )
    np.testing.assert_allclose(alone[0], mean)
    np.testing.assert_allclose(alone[1], np.sqrt(np.diag(whole)))


def test_innovations_are_the_integral_over_the_offset():
    """One pass without drift, by quadrature over its offset."""
    y, mean, sd = drawn(1)
    three = NUMBER == 2
    inside = lambda b: np.prod(stats.norm.pdf(y, mean + b, sd)[three]) * stats.norm.pdf(b, 0, 0.7)  # noqa: E731
    want = np.log(integrate.quad(inside, -8, 8, points=[0.0], epsabs=0, epsrel=1e-10)[0])
    loc, scale = pass_effects.innovations(TOGETHER, *map(jnp.asarray, (y, mean, sd, 0.7, 1e-7)))
    assert float(stats.norm.logpdf(y, loc, scale)[three].sum()) == pytest.approx(want, rel=1e-8)


def test_whole_passes_are_outliers():
    """Σ ln p is that of the mixture of each pass; the probability is Bayes' rule for it."""
    y, mean, sd = drawn(2)
    law = likelihood.Contaminated(mean, sd, 0.1, 6.0, TOGETHER)
    log_prob, outlier = np.asarray(law.log_prob(y)), np.asarray(law.outlier(y))
    for number in range(4):
        here = number == NUMBER
        near = np.log(0.9) + stats.norm.logpdf(y, mean, sd)[here].sum()
        far = np.log(0.1) + stats.norm.logpdf(y, mean, 6.0 * sd)[here].sum()
        assert log_prob[here].sum() == pytest.approx(logsumexp([near, far]), rel=1e-12)
        np.testing.assert_allclose(outlier[here], np.exp(far - logsumexp([near, far])), rtol=1e-9)


@pytest.mark.statistical(false_alarm=EACH)
def test_outliers_come_by_the_pass():
    """Of 4000 draws: all points of a pass or none, and as often as the share says, binomial."""
    law = likelihood.Contaminated(jnp.zeros(8), jnp.full(8, 1e-3), 0.2, 1e9, TOGETHER)
    far = np.abs(np.asarray(law.sample(jax.random.key(0), (4000,)))) > 1.0
    lead = np.asarray(TOGETHER.of_first(jnp.arange(8.0)), int)
    np.testing.assert_array_equal(far, far[:, lead])
    low, high = counts(16_000, 0.2)
    assert low <= far[:, [5, 2, 3, 7]].sum() <= high


@pytest.mark.parametrize("law", ["gaussian", "mixture", "student-t"])
def test_observing_with_passes(law):
    """The flux's brightness is expected, the noise is about what the pass has shown so far."""
    data = Epochs.of(curve())
    model = handlers.seed(likelihood.observe, 0)
    trace = handlers.trace(model).get_trace(data, jnp.ones(12), law, 0.3, True)
    fn, spread = trace["brightness"]["fn"], trace["pass_sd"]["value"]
    sd = np.hypot(0.1, trace["sigma"]["value"])
    mean = trace["expected"]["value"]
    first = np.array([0, 3, 6, 9, 11])
    np.testing.assert_allclose(np.asarray(fn.loc)[first], mean[first])
    x = np.asarray(data.passes.elapsed)
    np.testing.assert_allclose(x, [-1, 0, 1, -1, 0, 1, -1, 0, 1, -0.5, 0.5, 0])
    wide = np.sqrt(sd**2 + spread**2 + (x * trace["pass_drift_sd"]["value"]) ** 2)
    np.testing.assert_allclose(np.asarray(fn.scale)[first], wide[first])
    rest = np.setdiff1d(np.arange(12), first)
    assert np.all(np.asarray(fn.scale)[rest] < wide[rest])
    apart = handlers.trace(model).get_trace(data.without_passes(), jnp.ones(12), law, 0.3, True)
    np.testing.assert_allclose(apart["brightness"]["fn"].loc, mean)
    np.testing.assert_allclose(apart["brightness"]["fn"].scale, wide)


def test_what_passes_share_of_fluxes_is_relative_to_their_curve():
    """In W/m² as in units of the mean: offsets of 0.2 W/m² on fluxes of 1e-10 had made NaN."""
    light = replace(curve(), kind="flux", brightness=np.linspace(0.8, 1.2, 12))
    model = handlers.seed(likelihood.observe, 0)

    def moments(size: np.ndarray):
        each = size[light.curve]
        here = replace(light, brightness=each * light.brightness, error=0.1 * each)
        trace = handlers.trace(model).get_trace(
            Epochs.of(here), jnp.asarray(each * 1e-6 / 455.0), "gaussian", 0.3, True
        )  # at 1 m
        fn = trace["brightness"]["fn"]
        return np.asarray(fn.loc) / each, np.asarray(fn.scale) / each

    ordinary, faint = moments(np.ones(2)), moments(np.array([1e-10, 3e-12]))
    np.testing.assert_allclose(faint[0], ordinary[0], rtol=1e-9)
    np.testing.assert_allclose(faint[1], ordinary[1], rtol=1e-9)


def test_a_pass_without_weight_does_not_matter():
    """As where it is left out, if the power of its points is next to none."""
    light = curve()
    data = Epochs.of(light)
    keep = segments.pass_numbers(light) != 1
    data = replace(data, information=jnp.where(keep, 1.0, 1e-300))
    model = handlers.seed(likelihood.observe, 0)
    whole = handlers.trace(model).get_trace(data, jnp.ones(12), "mixture", 0.3, True)["brightness"]
    part = Epochs.of(light.select(keep), light)
    left = handlers.trace(model).get_trace(part, jnp.ones(9), "mixture", 0.3, True)["brightness"]
    total = lambda s: float(jnp.sum(s["fn"].log_prob(s["value"]) * s["scale"]))  # noqa: E731
    assert total(whole) == pytest.approx(total(left), rel=1e-12)


@pytest.mark.parametrize("together", [None, TOGETHER])
def test_the_slope_of_a_mixtures_cdf_is_its_density(together):
    """Also of each point given the earlier ones of its pass."""
    law = likelihood.Contaminated(jnp.arange(8.0), jnp.linspace(0.5, 2.0, 8), 0.2, 5.0, together)
    y = law.sample(jax.random.key(1))
    slope = jnp.diagonal(jax.jacfwd(law.cdf)(y))
    np.testing.assert_allclose(jnp.log(slope), law.log_prob(y), rtol=1e-9)


def test_chi2_knows_of_what_passes_share():
    """Passes of a few points, each 1 mag off as the model says it may be."""
    light = curve()

    def model(data):
        m = numpyro.sample("m", dist.Normal(0.0, 1.0))
        likelihood.observe(data, jnp.full(data.t.shape, 10.0 ** (-0.4 * m)), passes=True)

    rng = np.random.default_rng(5)
    shared = np.repeat([1.0, -1.0, -1.0, 1.0], 3)
    zero = np.asarray(Epochs.of(light).zero_point)
    data = Epochs.of(replace(light, brightness=zero + rng.normal(shared, 0.1)))
    problem = Problem(model, data)
    spreads = {"log_pass_sd": jnp.log(1.0), "log_pass_drift_sd": jnp.log(1e-3)}
    z = problem.ravel({"m": jnp.asarray(0.0)} | spreads)
    assert (
        2.0 < goodness_of_fit.chi2(problem, np.asarray(z), data) < 36.0
    )  # of 12 points, 5 of them the first
