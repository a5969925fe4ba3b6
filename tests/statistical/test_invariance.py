"""Does a kernel leave its target invariant? Moments against quadrature at 10⁵ effective draws.

Every exact kernel must agree within its Monte-Carlo standard errors with the numbers that
`target_densities` computes on grids, means and variances both (`far`); the published rule, under
the same test, must not.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpyro.infer import MCMC

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import AHMC, HMC, RMHMC, MetropolisHastings
from tests.helpers import many_chains, one_facet_posterior, target_densities
from tests.helpers.false_alarms import EACH, limit

CHAINS = 500

# Settings of each kernel, and draws of each chain that are worth 10⁵ independent ones in all.
EXACT = {
    ("gaussian", MetropolisHastings): ({"step_size": 1.3}, 3000),
    ("gaussian", HMC): ({"step_size": 0.7, "num_steps": 3}, 400),
    ("gaussian", AHMC): ({"step_size": 0.8, "num_steps": 3, "proposal_scale": 1.0}, 500),
    ("gaussian", RMHMC): ({"step_size": 0.7, "num_steps": 3}, 200),
    ("banana", MetropolisHastings): ({"step_size": 1.6}, 5000),
    ("banana", HMC): ({"step_size": 0.35, "num_steps": 5}, 1000),
    ("banana", AHMC): ({"step_size": 0.7, "num_steps": 3, "proposal_scale": 0.7}, 2000),
    ("banana", RMHMC): ({"step_size": 0.4, "num_steps": 4}, 700),
    ("facet", MetropolisHastings): ({"step_size": 1.2}, 4000),
    ("facet", HMC): ({"step_size": 0.7, "num_steps": 3}, 400),
    ("facet", AHMC): ({"step_size": 0.8, "num_steps": 3, "proposal_scale": 1.0}, 500),
    ("facet", RMHMC): ({"step_size": 0.4, "num_steps": 3}, 1000),
}
PUBLISHED = ({"step_size": 0.4, "num_steps": 5}, 400)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("gaussian", marks=pytest.mark.slow),
        "banana",
        pytest.param("facet", marks=pytest.mark.slow),
    ],
)
def target(request) -> target_densities.Target:
    return getattr(target_densities, request.param)()


def moments_of(target: target_densities.Target, cls, settings, draws: int, burn: int = 0):
    """Chains that start from the target itself: an exact kernel needs no burn-in."""
    if cls in (AHMC, RMHMC):
        settings = {**settings, "fisher_fn": target.fisher_fn}
    kernel = cls(potential_fn=target.potential_fn, covariance=target.moments[1], **settings)
    start = target.start(CHAINS, np.random.default_rng(1))
    return many_chains.run(
        kernel, start, target.quantities, (target.mean, target.sd), draws=draws, burn=burn, seed=2
    )


def far(result: many_chains.Moments) -> bool:
    """Whether any pull passes what Student's t of so many chains allows."""
    return bool(np.max(np.abs(result.z)) > limit(result.z.size, len(result.first) - 1))


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(
    "cls", [MetropolisHastings, HMC, AHMC, pytest.param(RMHMC, marks=pytest.mark.slow)]
)
def test_exact_kernels_agree_with_quadrature(target, cls):
    settings, draws = EXACT[target.name, cls]
    result = moments_of(target, cls, settings, draws)
    assert result.effective_draws >= 1e5
    assert not far(result)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(
    "target", ["gaussian", pytest.param("banana", marks=pytest.mark.slow)], indirect=True
)
def test_rmhmc_in_brief(target):
    """Its implicit steps cost a hundred Fisher matrices each: 10⁴ draws in the quick suite."""
    settings, draws = EXACT[target.name, RMHMC]
    result = moments_of(target, RMHMC, settings, draws // 8)
    assert result.effective_draws >= 1e4
    assert not far(result)


@pytest.mark.statistical(false_alarm=EACH)
def test_published_rule_does_not(target):
    """By tens of standard errors, except where the metric is the same everywhere."""
    settings, draws = PUBLISHED
    with pytest.warns(UserWarning, match="does not leave the posterior"):
        result = moments_of(target, AHMC, {**settings, "exact": False}, draws, burn=40)
    assert result.effective_draws >= 1e5
    assert result.accept_prob > 0.9  # nothing that a sampler reports shows it
    if target.name == "gaussian":
        assert not far(result)
    else:
        assert np.max(np.abs(result.z)) > 30
        assert np.max(np.abs(result.bias)) > 0.05


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_small_steps_of_the_published_rule_sample_another_density():
    """In one dimension: F π instead of π, whatever the acceptance (docs/sampler.md).

    π = N(0, 1) and F = 1 + x² give a variance of E[(1 + x²) x²]/E[1 + x²] = 2.
    """
    with pytest.warns(UserWarning, match="published rule"):
        kernel = AHMC(
            potential_fn=lambda x: 0.5 * x @ x,
            fisher_fn=lambda x: jnp.eye(1) + x[:, None] * x[None, :],
            exact=False,
            step_size=0.15,
            num_steps=1,
            covariance=np.eye(1),
        )
    start = np.random.default_rng(0).standard_normal((4000, 1))
    exact = (np.zeros(1), np.ones(1))
    result = many_chains.run(kernel, start, lambda x: x, exact, draws=2000, burn=1000, seed=1)
    assert result.accept_prob > 0.99
    error = result.second.std(ddof=1) / np.sqrt(len(result.second))
    assert limit() * error < 0.1
    assert np.mean(result.second) == pytest.approx(2.0, abs=0.1)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
@pytest.mark.parametrize("cls", [MetropolisHastings, HMC, AHMC, RMHMC])
def test_exact_kernels_with_their_own_warmup(cls):
    """As users run them: the model itself, warm-up on, each chain with what it found."""
    data = target_densities.facet_data()
    draws, thinning = (16_000, 8) if cls is MetropolisHastings else (1500, 1)
    mcmc = MCMC(
        cls(one_facet_posterior.MODEL),
        num_warmup=600,
        num_samples=draws,
        thinning=thinning,
        num_chains=200,
        chain_method="vectorized",
        progress_bar=False,
    )
    mcmc.run(jax.random.key(3), data)
    sites = mcmc.get_samples(group_by_chain=True)
    mean, sd = one_facet_posterior.Quadrature.of(data).moments()
    away = (
        np.stack([np.asarray(sites[k])[..., 0] for k in one_facet_posterior.NAMES], axis=-1) - mean
    )
    result = many_chains.Moments(mean, sd, away.mean(axis=1), (away**2).mean(axis=1), np.nan)
    assert result.effective_draws >= 5e4
    assert not far(result)


@pytest.mark.parametrize("make", [target_densities.gaussian, target_densities.banana])
def test_grids_agree_with_closed_forms(make):
    target = make()
    mean = {"gaussian": target_densities.GAUSSIAN_MEAN, "banana": [0.0, 0.0]}[target.name]
    sd = {
        "gaussian": target_densities.GAUSSIAN_SD,
        "banana": [1.0, np.sqrt(2 * target_densities.BEND**2 + target_densities.WIDTH**2)],
    }[target.name]
    np.testing.assert_allclose(target.mean, mean, atol=1e-9)
    np.testing.assert_allclose(target.sd, sd, rtol=1e-9)


def test_the_facet_grid_is_the_models_posterior():
    """The two sums over the epochs give the model's own density, and the grid is fine enough."""
    data = target_densities.facet_data()
    problem = one_facet_posterior.posterior(data)
    grid = one_facet_posterior.Quadrature.of(data)
    rng = np.random.default_rng(4)
    cells = rng.choice(grid.log_density.size, 40, p=grid.weights.ravel())
    index = np.unravel_index(cells, grid.log_density.shape)
    theta = np.stack([axis[i] for axis, i in zip(grid.axes, index, strict=True)], axis=1)
    run = jax.jit(jax.vmap(lambda x: one_facet_posterior.potential(problem, x, data)))
    total = np.asarray(run(jnp.asarray(theta))) + grid.log_density[index]
    np.testing.assert_allclose(total, total[0], atol=1e-9)
    coarse = one_facet_posterior.Quadrature.of(data, (120, 110, 110))
    for fine, other in zip(grid.moments(), coarse.moments(), strict=True):
        np.testing.assert_allclose(fine, other, atol=1e-6 * grid.moments()[1].min())
