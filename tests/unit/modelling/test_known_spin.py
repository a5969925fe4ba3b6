"""Periods and poles that are known before the fit, as priors of an angular velocity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpyro import handlers
from scipy import integrate, stats

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import (
    SINGLE_SD,
    KnownSpin,
    Period,
    PoleRegion,
    RatePrior,
    SpinPrior,
    bisector_rate,
)
from lcbayes.modelling.problem import Problem
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH

UNIT, DRIFT = 0.1, 0.002  # rad/s


def prior_of(period: str, pole: str = "") -> SpinPrior:
    known = KnownSpin.of(period, pole)
    assert known is not None
    return SpinPrior(known, UNIT, DRIFT)


@pytest.mark.parametrize(
    ("text", "low", "high", "sd"),
    [
        ("23.7s", 23.7, 23.7, None),
        (" 1.5 min ", 90.0, 90.0, None),
        ("2h", 7200.0, 7200.0, None),
        ("1.5days", 129600.0, 129600.0, None),
        ("2.37e1s", 23.7, 23.7, None),
        ("23.70+-0.02s", 23.7, 23.7, 0.02),
        ("1min±2s", 60.0, 60.0, 2.0),
        ("20-30s", 20.0, 30.0, None),
        ("20s - 2min", 20.0, 120.0, None),
        ("1e-1-2e-1h", 360.0, 720.0, None),
    ],
)
def test_periods_are_read_with_their_units(text, low, high, sd):
    result = Period.of(text)
    assert (result.low, result.high) == pytest.approx((low, high))
    assert result.sd == (None if sd is None else pytest.approx(sd))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("23.7", "needs a unit, s, min, h or days"),
        ("20-30", "needs a unit"),
        ("3 fortnights", "needs a unit"),
        ("soon", "is not understood; give 23.7s"),
        ("-3s", "is not understood"),
        ("30-20s", "ends before it begins"),
        ("0s", "is not positive"),
        ("10+-0s", "is not positive"),
    ],
)
def test_other_periods_are_refused(text, says):
    with pytest.raises(InputError, match=says):
        KnownSpin.of(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("10,20", "give RA,DEC,RADIUS"),
        ("10,95,5", "give a Dec from -90 to 90"),
        ("10,20,0", "more than 0, up to 90"),
        ("10,20,120", "more than 0, up to 90"),
    ],
)
def test_other_poles_are_refused(text, says):
    with pytest.raises(InputError, match=says):
        KnownSpin.of("", text)


def test_a_single_period_is_log_normal():
    """Against SciPy, with a width of 1 % and the rate of the bisector, in quadrature."""
    prior = prior_of("23.7s")
    rate = 2 * np.pi / 23.7
    sd = np.hypot(SINGLE_SD, DRIFT / rate)
    for speed in (0.95 * rate, rate, 1.02 * rate):
        omega = speed * np.array([0.6, 0.0, 0.8])
        expected = stats.lognorm.logpdf(speed, sd, scale=rate) - np.log(4 * np.pi * speed**2)
        ours = float(prior.log_prob(jnp.asarray(omega / UNIT))) - 3 * np.log(UNIT)
        assert ours == pytest.approx(expected, abs=1e-9)


def test_a_given_width_is_that_of_the_sidereal_period():
    """Without a part for synodic periods."""
    assert Period.of("23.70+-0.02s").width(DRIFT) == pytest.approx(0.02 / 23.7)
    assert float(Period.of("23.70s").width(DRIFT)) > 0.01


def test_a_range_is_log_uniform_with_blurred_ends():
    """ln P is the sum of a uniform and a normal variable: SciPy's convolution by quadrature."""
    known = KnownSpin.of("20-30s,60s")
    assert known is not None
    prior = SpinPrior(known, UNIT, DRIFT)
    wide, single = (float(p.width(DRIFT)) for p in known.periods)
    low, high = np.log(20.0), np.log(30.0)

    def density(x: float) -> float:
        ends = max(low, x - 9 * wide), min(high, x + 9 * wide)  # outside, quad sees nothing
        inside = integrate.quad(stats.norm.pdf, *ends, (x, wide))[0] if ends[0] < ends[1] else 0.0
        return 0.5 * inside / (high - low) + 0.5 * stats.norm.pdf(x, np.log(60.0), single)

    for period in (19.0, 20.0, 24.0, 31.0, 59.0):
        speed = 2 * np.pi / period
        expected = np.log(density(np.log(period))) - np.log(4 * np.pi * speed**3)
        value = jnp.asarray([0.0, speed / UNIT, 0.0])
        assert float(prior.log_prob(value)) - 3 * np.log(UNIT) == pytest.approx(expected, abs=1e-6)


def test_the_region_of_poles_is_uniform_and_has_both_senses():
    prior = prior_of("", "120,-45,20")
    pole = PoleRegion(120.0, -45.0, 20.0)
    aside = np.cross(pole.centre, [0.0, 0.0, 1.0])
    aside /= np.linalg.norm(aside)

    def relative(degrees: float) -> float:
        """Density against that of the isotropic normal prior at the same rate."""
        angle = np.radians(degrees)
        omega = 1.3 * (np.cos(angle) * pole.centre + np.sin(angle) * aside)
        plain = stats.norm.logpdf(omega).sum()
        return float(np.exp(float(prior.log_prob(jnp.asarray(omega))) - plain))

    inside = 1.0 / (1.0 - np.cos(np.radians(20.0)))
    assert relative(0.0) == pytest.approx(inside, rel=0.05)
    assert relative(15.0) == pytest.approx(relative(165.0), rel=1e-12)
    assert relative(20.0) == pytest.approx(0.5 * relative(0.0), rel=0.01)
    assert relative(40.0) < 1e-9
    cosine = np.linspace(-1.0, 1.0, 40001)
    total = 0.5 * integrate.trapezoid(
        [relative(a) for a in np.degrees(np.arccos(cosine))[::20]], cosine[::20]
    )
    assert total == pytest.approx(1.0, rel=2e-3)


@pytest.mark.statistical(false_alarm=EACH)
def test_draws_follow_the_density():
    """Distribution functions of ln P and of cos θ by quadrature of the density."""
    known = KnownSpin.of("20-30s", "120,-45,20")
    assert known is not None
    assert known.pole is not None
    prior = SpinPrior(known, UNIT, DRIFT)
    z = np.asarray(prior.sample(jax.random.key(3), (2000,)))
    rate = np.linalg.norm(z, axis=1)
    x = np.log(2 * np.pi / (UNIT * rate))
    grid = np.linspace(np.log(15.0), np.log(40.0), 4001)
    width = float(known.periods[0].width(DRIFT))
    a, b = np.log(20.0), np.log(30.0)
    pdf = (stats.norm.cdf((grid - a) / width) - stats.norm.cdf((grid - b) / width)) / (b - a)
    cdf = integrate.cumulative_trapezoid(pdf, grid, initial=0.0)
    limit = EACH / 2
    assert stats.kstest(np.interp(x, grid, cdf), "uniform").pvalue > limit
    c, w = known.pole.cosine, known.pole.edge
    cosine = z @ known.pole.centre / rate
    grid = np.linspace(-1.0, 1.0, 40001)
    pdf = 1 / (1 + np.exp(-(grid - c) / w)) + 1 / (1 + np.exp(-(-grid - c) / w))
    cdf = integrate.cumulative_trapezoid(pdf, grid, initial=0.0)
    assert stats.kstest(np.interp(cosine, grid, cdf / cdf[-1]), "uniform").pvalue > limit


def test_a_rate_of_either_sign_has_the_period():
    """Each sense has half of a log-normal density of |rate|, by SciPy."""
    known = KnownSpin.of("23.70+-0.05s")
    assert known is not None
    prior = RatePrior(SpinPrior(known, UNIT, DRIFT))
    for speed in (0.26, 0.2651, 0.266):
        expected = stats.lognorm.logpdf(speed, 0.05 / 23.7, scale=2 * np.pi / 23.7) - np.log(2)
        for sign in (-1.0, 1.0):
            ours = float(prior.log_prob(jnp.asarray(sign * speed / UNIT))) - np.log(UNIT)
            assert ours == pytest.approx(expected, abs=1e-9)
    draws = UNIT * np.asarray(prior.sample(jax.random.key(5), (400,)))
    assert np.abs(2 * np.pi / np.abs(draws) - 23.7).max() < 0.3
    assert 0.35 < np.mean(draws > 0) < 0.65  # six standard deviations
    precision = np.asarray(prior.precision(jnp.asarray(-2.651)))
    assert precision == pytest.approx(np.array([[(23.7 / 0.05 / 2.651) ** 2]]), rel=1e-3)


@pytest.mark.parametrize("spin", ["flat", "free"])
def test_a_known_body_draws_the_spin_from_it(spin):
    entry, data = registry.find("body"), Epochs.of(small_curves.curve(20))
    options = entry.check({"body": "cube-satellite", "spin": spin, "period": "23.7+-0.5s"})
    with handlers.seed(rng_seed=0):
        drawn = handlers.trace(entry.bind(options)).get_trace(data)
    omega = np.asarray(drawn["omega"]["value"])
    assert 20.0 < 2 * np.pi / np.linalg.norm(omega) < 28.0


def test_the_rates_to_search_hold_the_prior():
    known = KnownSpin.of("20-30s,1min,31s")
    assert known is not None
    ranges = known.rates(DRIFT)
    assert len(ranges) == 2  # 31 s joins 20-30 s
    assert list(ranges) == sorted(ranges)
    z = SpinPrior(known, UNIT, DRIFT).sample(jax.random.key(0), (4000,))
    rate = UNIT * np.linalg.norm(np.asarray(z), axis=1)
    inside = sum((rate >= low) & (rate <= high) for low, high in ranges)
    assert np.mean(inside) > 0.99


def test_the_rate_of_the_bisector_is_that_of_the_geometry():
    """An observer who moves by 0.02 rad/s in the plane of a fixed Sun: the bisector by half."""
    t = np.linspace(0.0, 20.0, 41)
    angle = 0.3 + 0.02 * t
    obs = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    sun = np.tile([1.0, 0.0, 0.0], (41, 1))
    curve = replace(small_curves.curve(41, sun=sun, obs=obs), t=t)
    assert float(bisector_rate(Epochs.of(curve))) == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("name", ["faceted", "faceted-brdf"])
def test_the_models_draw_the_spin_from_it(name):
    entry, data = registry.find(name), Epochs.of(small_curves.curve(20))
    options = entry.check({"n_facets": 1, "period": "23.7+-0.5s", "pole": "120,-45,20"})
    with handlers.seed(rng_seed=0):
        drawn = handlers.trace(entry.bind(options)).get_trace(data)
    omega = np.asarray(drawn["omega"]["value"])
    assert 20.0 < 2 * np.pi / np.linalg.norm(omega) < 28.0
    pole = PoleRegion(120.0, -45.0, 20.0)
    assert pole.within(omega[None] / np.linalg.norm(omega), np.radians(3.0))[0]


def test_rate_and_direction_have_the_precision_of_the_prior():
    """In sampling coordinates, where ln ω of a single period is normal."""
    entry, data = registry.find("faceted"), Epochs.of(small_curves.curve(20))
    options = entry.check({"n_facets": 1, "period": "23.70+-0.05s"})
    hook = entry.hook("coordinates")
    assert hook is not None
    problem = Problem(entry.bind(options), data, hook(data, **options))
    z = problem.prior_draw(jax.random.key(2), data)
    rows = problem.rows(["omega_unit"])
    precision = np.asarray(problem.prior_precision(z, data))[np.ix_(rows, rows)]
    assert precision[0, 0] == pytest.approx((23.7 / 0.05) ** 2, rel=1e-6)
    assert np.allclose(precision[0, 1:], 0.0, atol=1e-6 * precision[0, 0])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"spin": "none", "period": "20s"}, "does not turn"),
        ({"spin": "torque-free", "pole": "1,2,3"}, "no fixed pole"),
    ],
)
def test_a_spin_that_cannot_have_them_is_named(options, says):
    entry, data = registry.find("faceted"), Epochs.of(small_curves.curve(20))
    with pytest.raises(InputError, match=says), handlers.seed(rng_seed=0):
        entry.bind(entry.check(options))(data)


def test_hours_of_an_asteroid_may_have_a_unit():
    entry = registry.find("convex-grid")
    assert entry.check({"period": 5.76})["period"] == 5.76
    assert entry.check({"period": "5.76h"})["period"] == pytest.approx(5.76)
    assert entry.check({"period": "1.5d"})["period"] == pytest.approx(36.0)
    with pytest.raises(InputError, match="is no duration"):
        entry.check({"period": "5-6h"})
