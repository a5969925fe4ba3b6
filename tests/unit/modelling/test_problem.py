"""The posterior as a function of one vector: density and Fisher information."""

from __future__ import annotations

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro.infer.util import potential_energy

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit

CASES = {
    "one facet": ({}, {"n_facets": 1, "spin": "none"}),
    "turning": ({"n_facets": 2, "spinning": True}, {"n_facets": 2}),
    "free scale": ({"free_scale": np.array([True])}, {"n_facets": 1, "spin": "none"}),
    "unknown noise": ({"error": None}, {"n_facets": 1, "spin": "none"}),
    "student-t": ({"error": None}, {"n_facets": 1, "spin": "none", "noise_law": "student-t"}),
    "sparse": ({}, {"n_facets": 1, "spin": "none", "sparsity": 0.01}),
}


@pytest.fixture(scope="module", params=CASES)
def case(request):
    light, options = CASES[request.param]
    problem, data = small_curves.posterior(small_curves.curve(12, **light), **options)
    z = small_curves.truth(problem, data, options["n_facets"])
    shift = 0.02 * jax.random.normal(jax.random.key(1), z.shape)
    return problem, data, z + shift


def test_potential_is_numpyros(case):
    problem, data, z = case
    want = jax.jit(
        lambda z, data: potential_energy(problem.model, (data,), {}, problem.unravel(z))
    )(z, data)
    np.testing.assert_allclose(jax.jit(problem.potential)(z, data), want, rtol=1e-12)


def test_fisher_is_jacobian_and_prior(case):
    """JᵀWJ + 2KᵀVK + prior precision, with whole Jacobians of mean and log sd by jacfwd."""
    problem, data, z = case
    student = problem.model.keywords.get("noise_law") == "student-t"
    w, v = (5 / 7, 4 / 7) if student else (1.0, 1.0)

    @jax.jit
    def both(z, data):
        sd = problem.moments(z, data).sd
        mean = jax.jacfwd(lambda z: problem.moments(z, data).mean)(z) / sd[:, None]
        log_sd = jax.jacfwd(lambda z: jnp.log(problem.moments(z, data).sd))(z)
        want = w * mean.T @ mean + 2 * v * log_sd.T @ log_sd + problem.prior_precision(z, data)
        return problem.fisher(z, data), want

    result, want = both(z, data)
    np.testing.assert_allclose(result, want, rtol=1e-9, atol=1e-6)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(
    "name", ["unknown noise", pytest.param("student-t", marks=pytest.mark.slow)]
)
def test_fisher_is_the_expected_curvature(name):
    """Mean over replicated data of the Hessian of −ln likelihood at the point that made them."""
    light, options = CASES[name]
    problem, data = small_curves.posterior(small_curves.curve(12, noise=0.05, **light), **options)
    z = small_curves.truth(problem, data, 1)

    def curvature(key):
        from dataclasses import replace

        y = problem.replicate(z, data, key)
        made = replace(data, brightness=y)
        return jax.hessian(lambda z: -problem.log_likelihood(z, made).sum())(z)

    n = 4000
    run = jax.jit(lambda keys: jax.lax.map(curvature, keys, batch_size=100))
    result = np.asarray(run(jax.random.split(jax.random.key(2), n)))
    likelihood = jax.jit(lambda z, d: problem.fisher(z, d) - problem.prior_precision(z, d))
    want = np.asarray(likelihood(z, data))
    error = result.std(axis=0) / np.sqrt(n)
    assert np.all(np.abs(result.mean(axis=0) - want) < limit(want.size) * error + 1e-9)


def test_prior_precision_of_gaussian_sites_is_theirs():
    problem, data = small_curves.posterior(small_curves.curve(12), n_facets=1, log_area_sd=0.5)
    z = small_curves.truth(problem, data, 1)
    index = problem.unravel(jnp.arange(float(problem.dim)))
    result = np.asarray(jax.jit(problem.prior_precision)(z, data))
    omega, area = (index[k].astype(int) for k in ("omega_unit", "log_albedo_area"))
    np.testing.assert_allclose(result[np.ix_(omega, omega)], np.eye(3), atol=1e-8)
    np.testing.assert_allclose(result[np.ix_(area, area)], [[4.0]], rtol=1e-8)
    # 1/ρ² along the radius; across it the inverse of the variance of a uniform direction, which
    # is 1/3 for each component because they share the square of one.
    base = index["normals_base"].astype(int).ravel()
    u = small_curves.NORMALS[0]
    want = 3.0 * np.eye(3) + (100.0 - 3.0) * np.outer(u, u)
    np.testing.assert_allclose(result[np.ix_(base, base)], want, rtol=1e-9, atol=1e-9)


def test_a_facet_that_no_epoch_sees_leaves_the_prior():
    """The likelihood part is singular there (misprint of eq. 28); the prior's precision is not."""
    light = small_curves.curve(12)
    problem, data = small_curves.posterior(light, n_facets=1, spin="none")
    away = {"normals_base": -jnp.asarray(small_curves.NORMALS[:1]), "log_albedo_area": jnp.zeros(1)}
    z = problem.ravel(away)
    fisher = np.asarray(jax.jit(problem.fisher)(z, data))
    np.testing.assert_allclose(fisher, jax.jit(problem.prior_precision)(z, data), atol=1e-12)
    assert np.linalg.eigvalsh(fisher)[-1] > 90


def test_ravel_and_constrain_are_inverse(case):
    problem, data, z = case
    sites = problem.constrain(z, data)
    np.testing.assert_allclose(problem.ravel(sites), z, atol=1e-12)


def test_prior_draws_have_finite_density(case):
    problem, data, _ = case

    @jax.jit
    def density(keys, data):
        def one(key):
            return jax.value_and_grad(problem.potential)(problem.prior_draw(key, data), data)

        return jax.lax.map(one, keys)

    for result in density(jax.random.split(jax.random.key(0), 50), data):
        assert np.all(np.isfinite(result))


@pytest.mark.statistical(false_alarm=EACH)
def test_replicates_have_the_moments_of_the_likelihood():
    problem, data = small_curves.posterior(small_curves.curve(6), n_facets=1, spin="none")
    z = small_curves.truth(problem, data, 1)
    keys = jax.random.split(jax.random.key(4), 4000)
    y = np.asarray(jax.jit(jax.vmap(lambda k: problem.replicate(z, data, k)))(keys))
    mean, sd = jax.jit(problem.moments)(z, data)
    most = limit(12)  # standard errors of means and sds of 6 points
    assert np.all(np.abs(y.mean(0) - mean) < most * sd / np.sqrt(4000))
    assert np.all(np.abs(y.std(0) / sd - 1) < most / np.sqrt(8000))


def no_observation(data):  # noqa: ARG001
    numpyro.sample("x", dist.Normal(0, 1))


def poisson(data):
    numpyro.sample("brightness", dist.Poisson(1.0), obs=jnp.ones(data.t.shape))


def discrete(data):
    k = numpyro.sample("k", dist.Bernoulli(0.5))
    numpyro.sample("brightness", dist.Normal(1.0 * k, 1.0), obs=data.brightness)


@pytest.mark.parametrize(
    ("model", "says"),
    [
        (no_observation, "end it with lcbayes.modelling.likelihood.observe"),
        (poisson, "expected Normal or StudentT"),
        (discrete, "'k' is discrete"),
    ],
)
def test_models_that_break_the_contract(model, says):
    with pytest.raises(InputError, match=says):
        Problem(model, Epochs.of(small_curves.curve(5)))
