"""The sites of a model and their supports, traced, against the model run as it is."""

from __future__ import annotations

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro import handlers
from numpyro.distributions import biject_to

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import UniformDirection
from lcbayes.modelling.sites import reaching, sites_and_supports, zeros
from tests.helpers import small_curves


def model(data):
    """Supports that are fixed, computed from numbers, and computed from the data."""
    level = numpyro.sample("level", dist.Uniform(jnp.min(data.brightness), jnp.sqrt(900.0)))
    numpyro.sample("share", dist.Beta(2.0, 3.0))
    numpyro.sample(
        "ends", dist.Uniform(jnp.arange(3.0), jnp.exp(jnp.arange(3.0)) + 1.0).to_event(1)
    )
    numpyro.sample("direction", UniformDirection(2))
    width = numpyro.sample("width", dist.LogNormal(0.0, level))
    numpyro.deterministic("double", 2.0 * width)
    likelihood.observe(data, jnp.asarray(level) + 0.0 * data.t)


@pytest.fixture(scope="module")
def data() -> Epochs:
    return Epochs.of(small_curves.curve(9, brightness=np.full(9, 10.0), error=np.full(9, 0.1)))


def run(data: Epochs):
    return handlers.trace(handlers.seed(model, jax.random.key(0))).get_trace(data)


def test_traced_sites_and_supports_are_those_of_the_running_model(data):
    sites, supports = sites_and_supports(run, data)
    expected = run(data)
    assert {k: (v["type"], v["value"].shape) for k, v in sites.items()} == {
        k: (v["type"], v["value"].shape) for k, v in expected.items()
    }
    latent = {"level", "share", "ends", "direction", "width"}
    assert set(supports) == latent
    for name in latent:
        own, other = (biject_to(x) for x in (supports[name], expected[name]["fn"].support))
        free = other.inv(expected[name]["value"])
        np.testing.assert_allclose(own(free), expected[name]["value"], rtol=1e-12)
        np.testing.assert_allclose(own.inv(expected[name]["value"]), free, rtol=1e-12)


def test_supports_are_numbers_after_the_trace(data):
    """They are used in other programs, where traced values of this one would be an error."""
    _, supports = sites_and_supports(run, data)
    ends = jax.jit(lambda x: biject_to(supports["level"])(x))(jnp.array([-40.0, 40.0]))
    np.testing.assert_allclose(ends, [10.0, 30.0], rtol=1e-9)


def test_sites_that_a_function_depends_on():
    sites = zeros({k: jax.ShapeDtypeStruct((3,), jnp.float64) for k in "abc"})
    assert reaching(lambda s: s["a"] @ s["c"] + 0.0 * jnp.size(s["b"]), sites) == ("a", "c")
