"""Left-out epochs: against conjugate formulas and direct sums; stacking against a grid."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.inference.loo import Loo, log_weights, loo, stacking
from tests.helpers.false_alarms import EACH

SD = 0.5


def normal(x, mean, sd):
    return -0.5 * ((x - mean) / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi))


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("power", [1.0, 0.3])
def test_mean_of_a_normal(power):
    """y ~ N(m, 0.5²)^power, m ~ N(0, 1): without yᵢ the posterior of m is normal, and so is yᵢ.

    200,000 draws: the errors scatter by 0.002 from seed to seed where they are largest (the epochs
    beside the outlier at the low power), a fifth of the bound."""
    rng = np.random.default_rng(0)
    y = 0.4 + SD * rng.standard_normal(25)
    y[3] = 2.0  # an outlier
    weight = power / SD**2

    def posterior(data):
        precision = 1.0 + weight * len(data)
        return weight * data.sum() / precision, precision**-0.5

    mean, sd = posterior(y)
    draws = mean + sd * rng.standard_normal(200_000)
    result = loo(normal(y[None], draws[:, None], SD), power)
    for i in range(len(y)):
        centre, width = posterior(np.delete(y, i))
        assert result.elpd[i] == pytest.approx(normal(y[i], centre, np.hypot(width, SD)), abs=0.01)
    assert np.all(result.khat < 0.5)


def test_dark_epochs_count_as_they_are():
    rng = np.random.default_rng(1)
    log_likelihood = normal(0.0, 0.1 * rng.standard_normal((500, 4)), 1.0)
    log_likelihood[:, 1] = -3.25
    log_likelihood[:, 2] = 1.5 + 1e-14 * rng.standard_normal(500)  # the same but for rounding
    result = loo(log_likelihood)
    np.testing.assert_allclose(result.elpd[1:3], [-3.25, 1.5], rtol=1e-12)
    assert np.isneginf(result.khat[1:3]).all()
    assert np.isfinite(result.khat[[0, 3]]).all()


def test_nothing_but_dark_epochs():
    result = loo(np.full((100, 3), -2.0))
    np.testing.assert_allclose(result.elpd, -2.0)
    assert np.isneginf(result.khat).all()


def test_an_epoch_dark_in_most_draws():
    """Dark, it has −4 in 400 of 500 draws, and −4 is the least: all tail weights are the same."""
    log_likelihood = np.r_[np.full(400, -4.0), np.linspace(-3.0, -1.0, 100)][:, None]
    result = loo(log_likelihood)
    by_hand = -np.log(np.mean(np.exp(-log_likelihood)))  # 1 / E[1/p]
    assert result.elpd[0] == pytest.approx(by_hand, rel=1e-12)
    assert np.isneginf(result.khat[0])


def test_an_epoch_dark_in_so_many_draws_that_they_reach_into_the_tail():
    """Of 2,000 draws 100 are lit, fewer than ArviZ takes for the tail: the tail is those 100, as
    it would be of 1,112 draws."""
    rng = np.random.default_rng(6)
    lit = -4.0 - rng.exponential(0.4, 100)
    result = loo(np.r_[np.full(1900, -4.0), lit][:, None])
    fewer = loo(np.r_[np.full(1012, -4.0), lit][:, None])
    np.testing.assert_allclose(result.khat, fewer.khat)
    assert -0.5 < result.khat[0] < 0.7
    by_hand = np.log(2000) - np.log(1900 * np.exp(4.0) + np.exp(-lit).sum())
    assert result.elpd[0] == pytest.approx(by_hand, abs=1e-3)


def test_where_nothing_is_known_of_the_tail():
    """Three draws lit of 500, or 20 draws in all: the weights as they are, and k counts as bad."""
    few = np.r_[np.full(497, -4.0), -5.0, -6.0, -7.0][:, None]
    short = np.random.default_rng(7).standard_normal((20, 1))
    far = -1e4 * np.random.default_rng(8).random((500, 1))
    for given in (few, short, far):
        result = loo(given)
        assert result.khat == [np.inf]
        top = given.min()
        by_hand = top - np.log(np.mean(np.exp(top - given)))
        assert result.elpd[0] == pytest.approx(by_hand, rel=1e-9)


def test_a_few_draws_of_little_weight_are_no_tail():
    light = np.r_[np.full(497, -4.0), -4.1, -4.1, -4.2][:, None]
    result = loo(light)
    assert np.isneginf(result.khat[0])
    assert result.elpd[0] == pytest.approx(-np.log(np.mean(np.exp(-light))), rel=1e-12)


def made(elpd) -> Loo:
    return Loo(np.asarray(elpd), np.zeros(len(elpd)))


def test_stacking_of_two_against_a_grid():
    rng = np.random.default_rng(2)
    a, b = normal(0.0, rng.standard_normal((2, 80)), 0.7)
    result = stacking({3: made(a), 5: made(b)})
    w = np.linspace(0.0, 1.0, 2001)
    score = np.log(w[:, None] * np.exp(a) + (1 - w[:, None]) * np.exp(b)).sum(axis=1)
    assert result.weight[0] == pytest.approx(w[np.argmax(score)], abs=2e-3)
    assert result.weight.sum() == pytest.approx(1.0, abs=1e-6)
    diff = a - b
    assert result.diff[1 if diff.sum() > 0 else 0] == pytest.approx(-abs(diff.sum()))
    assert result.diff_se.max() == pytest.approx(np.sqrt(80 * diff.var()))


def test_stacking_of_three_against_a_grid():
    rng = np.random.default_rng(3)
    elpd = normal(0.0, rng.standard_normal((3, 60)), 0.6)
    elpd[2] -= 0.2
    result = stacking(dict(enumerate(map(made, elpd))))
    u, v = np.meshgrid(np.linspace(0, 1, 201), np.linspace(0, 1, 201))
    w = np.stack([u, v, 1 - u - v])[:, u + v <= 1]
    best = w[:, np.argmax(np.log(np.exp(elpd).T @ w).sum(axis=0))]
    np.testing.assert_allclose(result.weight, best, atol=0.02)


def test_stacking_where_exponentials_vanish():
    """A point 2,000 nats out in both models, and fluxes in a small unit: only ratios count."""
    rng = np.random.default_rng(4)
    a, b = normal(0.0, rng.standard_normal((2, 50)), 0.7)
    common = 700.0 * rng.standard_normal(50)
    common[7] = -2000.0
    plain, shifted = (
        stacking({1: made(a), 2: made(b)}),
        stacking({1: made(a + common), 2: made(b + common)}),
    )
    np.testing.assert_allclose(shifted.weight, plain.weight, atol=1e-3)
    np.testing.assert_allclose(shifted.diff, plain.diff, rtol=1e-6)


def test_a_far_better_model_takes_all():
    rng = np.random.default_rng(5)
    a = normal(0.0, rng.standard_normal(50), 1.0)
    result = stacking({1: made(a - 40.0), 2: made(a)})
    np.testing.assert_allclose(result.weight, [0.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(result.diff, [-2000.0, 0.0])


def test_one_model_has_all_the_weight():
    result = stacking({4: made([-1.0, -2.0])})
    assert [float(x[0]) for x in result] == [1.0, 0.0, 0.0]


def test_weights_are_finite_however_chains_stay_where_they_are():
    """Draws of two plateaus, a few draws many times, dark epochs, tails below rounding."""
    rng = np.random.default_rng(0)
    for _ in range(300):
        n = rng.choice([40, 100, 400, 2000])
        x = rng.standard_normal((n, 6)) * 10.0 ** rng.integers(-6, 3, 6)
        x[:, 0] = np.where(np.arange(n) < rng.integers(1, n), x[0, 0], x[1, 0])
        x[:, 1] = x[rng.integers(0, 4, n), 1]
        x[:, 2] = np.where(rng.random(n) < 0.97, -3.0, x[rng.integers(0, 3, n), 2])
        x[:, 3] = np.where(rng.random(n) < rng.random(), -700.0, x[:, 3])
        log_weight, khat = log_weights(x, rng.choice([1.0, 0.4]))
        np.testing.assert_allclose(np.logaddexp.reduce(log_weight, axis=0), 0.0, atol=1e-9)
        assert not np.isnan(khat).any()
