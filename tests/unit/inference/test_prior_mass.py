"""The mass that factors leave of a prior: against spherical geometry and a factor known."""

from __future__ import annotations

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.prior_mass import log_prior_mass
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit

EDGE = 0.02 * np.sqrt(np.pi) / 2  # what the soft edge of `priors.visibility_prior` adds, rad


def test_a_constant_factor():
    def model(data):
        x = jnp.asarray(numpyro.sample("x", dist.Normal()))
        numpyro.factor("less", -2.0)
        likelihood.observe(data, x * jnp.ones_like(data.t))

    data = Epochs.of(small_curves.curve(10))
    result = log_prior_mass(Problem(model, data), data, jax.random.key(0))
    assert result.value == pytest.approx(-2.0, abs=1e-12)
    assert result.se < 1e-12


@pytest.mark.statistical(false_alarm=EACH)
def test_a_gaussian_factor():
    """∫ N(x; 0, 1) exp(−4x²) dx = 1/3."""

    def model(data):
        x = jnp.asarray(numpyro.sample("x", dist.Normal()))
        numpyro.factor("narrow", -4.0 * x**2)
        likelihood.observe(data, x * jnp.ones_like(data.t))

    data = Epochs.of(small_curves.curve(10))
    result = log_prior_mass(Problem(model, data), data, jax.random.key(0))
    assert abs(result.value - np.log(1 / 3)) < limit() * result.se
    assert result.se <= 0.01


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(
    "n_facets",
    [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow)],
)
def test_facets_in_a_lune(n_facets):
    """Sun and observer at 60°: a normal is lit and seen in a lune of 120°, a third of the sphere,
    whose two edges of length π are soft; facets are independent."""
    n = 4
    sun = np.tile([1.0, 0.0, 0.0], (n, 1))
    obs = np.tile([0.5, np.sqrt(0.75), 0.0], (n, 1))
    light = small_curves.curve(n, sun=sun, obs=obs)
    problem, data = small_curves.posterior(light, n_facets=n_facets, spin="none")
    result = log_prior_mass(problem, data, jax.random.key(1))
    seen = 1 / 3 + 2 * np.pi * EDGE / (4 * np.pi)
    assert abs(result.value - n_facets * np.log(seen)) < limit() * result.se
    assert result.se <= 0.01
