"""What correlated points are worth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import correlation
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, counts, limit


def autoregressive(n: int, rho: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal(n)
    noise[1:] *= np.sqrt(1 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], noise))


@pytest.mark.statistical(false_alarm=EACH)
def test_white_residuals_count_whole():
    """Each of 50 seeds gives less than 1 once in 740, binomial; less than 0.6 takes 6.7 sd."""
    group = np.repeat(np.arange(10), 40)
    result = [
        correlation.information_per_point(np.random.default_rng(s).standard_normal(400), group)
        for s in range(50)
    ]
    assert np.sum(np.array(result) < 1.0) <= counts(50, 1 / 740)[1]
    assert min(result) > 0.6


@pytest.mark.statistical(false_alarm=EACH)
def test_an_autoregressive_sequence_has_its_known_correlation_time():
    """τ = (1 + ρ)/(1 − ρ). The sum is cut at 3 √(τ/n), which leaves out 2 ρ/(1 − ρ) times as much;
    the rest is scatter, which 8 seeds tell: three comparisons by t of 7 degrees of freedom."""
    for rho in (0.3, 0.6, 0.9):
        n, group = 200_000, np.zeros(200_000, int)
        of = correlation.information_per_point
        result = [of(autoregressive(n, rho, s), group) for s in range(8)]
        tau = 1 / np.array(result)
        error = limit(3, len(tau) - 1) * tau.std(ddof=1) / np.sqrt(len(tau))
        want = (1 + rho) / (1 - rho)
        cut = 2 * 3 * np.sqrt(want / n) * rho / (1 - rho)
        assert want - cut - error < tau.mean() < want + error


def test_groups_do_not_reach_into_each_other():
    """A step between curves is their scale, not a correlation of points."""
    rng = np.random.default_rng(1)
    group = np.repeat(np.arange(200), 2)
    pairs = rng.standard_normal((200, 2))
    level = np.repeat(np.linspace(-1, 1, 200)[:, None], 2, axis=1)
    assert correlation.information_per_point(pairs.ravel(), group) == 1.0
    assert correlation.information_per_point((pairs + 3 * level).ravel(), group) < 0.6
    # The same residuals, each its own group: there is no pair to tell.
    assert correlation.information_per_point((pairs + 3 * level).ravel(), np.arange(400)) == 1.0


def test_points_that_are_copies_count_once():
    """Every point ten times over: the information is that of the points themselves, to the cut."""
    light = small_curves.curve(60)
    ten = np.repeat(np.arange(60), 10)
    copies = replace(
        light,
        **{k: getattr(light, k)[ten] for k in ("t", "brightness", "error", "sun", "obs")},
        **{k: getattr(light, k)[ten] for k in ("curve", "band", "exposure_s", "site")},
    )
    problem, data = small_curves.posterior(light, n_facets=1, spin="none")
    _, many = small_curves.posterior(copies, n_facets=1, spin="none")
    z = small_curves.truth(problem, data, 1)
    weighed = correlation.tempered(problem, np.asarray(z), many)
    assert 0.07 < float(weighed.information) < 0.15

    @jax.jit
    def likelihood(z, data):
        return problem.fisher(z, data) - problem.prior_precision(z, data)

    exact = replace(many, information=jnp.asarray(0.1))
    np.testing.assert_allclose(likelihood(z, exact), likelihood(z, data), rtol=1e-9, atol=1e-6)
    potential = jax.jit(problem.potential)
    change = [float(potential(z, d) - potential(z + 0.1, d)) for d in (data, exact)]
    np.testing.assert_allclose(*change, rtol=1e-9)
