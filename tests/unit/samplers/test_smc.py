"""Tempered particles: their parts, a posterior known in closed form, and faults told in words."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.results.reasons import reason as sentence
from lcbayes.samplers import moves, smc, tempering, tempering_path
from lcbayes.samplers.tempering_path import TimePath
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit

N, RUNS = 200, 8
PLAN = smc.Plan(oversampling=1)  # one solution: none to lose on the way


def linear(data):
    """Flux a polynomial in time with standard normal coefficients: everything is Gaussian."""
    x = jnp.asarray(numpyro.sample("x", dist.Normal(0.0, 1.0).expand([3]).to_event(1)))
    likelihood.observe(data, _basis(data.t) @ x)


def _basis(t):
    s = t / 60.0
    return jnp.stack([jnp.ones_like(s), s, s**2], axis=1)


@pytest.fixture(scope="module")
def gaussian():
    data = Epochs.of(small_curves.curve(20, noise=0.05))
    return Problem(linear, data), data


def exact(data, power=1.0):
    """ln Z, mean and covariance of the posterior whose likelihood is raised to a power.

    N(y; Bx, σ²)^k is N(y; Bx, σ²/k) times ∏ (2πσ²)^(−k/2) (2πσ²/k)^(1/2).
    """
    basis, y, sd = np.asarray(_basis(data.t)), np.asarray(data.brightness), np.asarray(data.error)
    cov = basis @ basis.T + np.diag(sd**2 / power)
    log_z = -0.5 * (y @ np.linalg.solve(cov, y) + np.linalg.slogdet(2 * np.pi * cov)[1])
    log_z += np.sum(
        0.5 * np.log(2 * np.pi * sd**2 / power) - 0.5 * power * np.log(2 * np.pi * sd**2)
    )
    precision = np.eye(3) + basis.T @ (basis * (power / sd**2)[:, None])
    gain = np.linalg.inv(precision)
    return log_z, gain @ basis.T @ (y * power / sd**2), gain


@pytest.fixture(scope="module")
def runs(gaussian):
    problem, data = gaussian
    return smc.replicate(problem, data, jax.random.key(1), N, RUNS, plan=PLAN)


@pytest.mark.statistical(false_alarm=EACH)
def test_evidence_of_a_gaussian(gaussian, runs):
    """The mean of the runs in its standard error, of 7 degrees of freedom: one nat is found out.
    Less is seen by the 24 runs of tests/statistical/test_smc.py."""
    want = exact(gaussian[1])[0]
    assert abs(runs.log_evidence - want) < limit(1, RUNS - 1) * runs.se
    assert runs.se < 0.08  # eight moves of 200 particles


@pytest.mark.statistical(false_alarm=EACH)
def test_moments_of_a_gaussian(gaussian, runs):
    """Means and variances of three quantities in their standard errors over runs."""
    _, mean, cov = exact(gaussian[1])
    away = np.array([(r.z - mean) / np.sqrt(np.diag(cov)) for r in runs.runs])
    for found in (away.mean(axis=1), np.mean(away**2, axis=1) - 1.0):
        se = found.std(axis=0, ddof=1) / np.sqrt(RUNS)
        assert np.all(np.abs(found.mean(axis=0)) < limit(6, RUNS - 1) * se)
        assert np.all(se < 0.06)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_points_of_less_weight(gaussian, runs):
    """The evidence is that of exp(−U) at the data's own information; weaker data scatter less."""
    problem, data = gaussian
    less = replace(data, information=jnp.asarray(0.3))
    found = smc.replicate(problem, less, jax.random.key(2), N, 4, plan=PLAN)
    se = runs.se * np.sqrt(RUNS / 4)
    assert abs(found.log_evidence - exact(less, 0.3)[0]) < limit(1, RUNS - 1) * se


def test_a_run_says_how_it_went(runs):
    found = runs.runs[0]
    assert found.reasons == []
    assert found.stages[-1].s == 1.0
    assert np.all(np.diff([stage.s for stage in found.stages]) > 0)
    assert np.all((found.acceptance > 0.5) & (found.acceptance <= 1.0))
    assert found.z.shape == (N * found.points, 3)
    assert found.log_likelihood.shape == (N * found.points,)
    assert found.gradients >= N * sum(s.num_moves for s in found.stages)


def test_same_key_same_numbers(gaussian, runs):
    """Whatever the number of threads."""
    problem, data = gaussian
    again = smc.run(
        problem, data, jax.random.split(jax.random.key(1), 8)[0], N, plan=PLAN, workers=1
    )
    np.testing.assert_array_equal(again.z, runs.runs[0].z)
    assert again.log_evidence == runs.runs[0].log_evidence
    assert runs.log_evidences[0] != runs.log_evidences[1]


def test_likelihoods_are_those_of_the_particles(gaussian, runs):
    problem, data = gaussian
    z, kept = runs.runs[0].z[:50], runs.runs[0].log_likelihood[:50]
    want = jax.vmap(lambda z: problem.log_likelihood(z, data).sum())(z)
    np.testing.assert_allclose(kept, want, rtol=1e-9)


def test_factors_are_all_but_prior_and_brightness():
    """U = −ln prior − ln factors − ln likelihood, the prior that of `prior_draw`."""
    problem, data = small_curves.posterior(small_curves.curve(12, 2), n_facets=2, sparsity=0.01)
    draw = jax.jit(jax.vmap(problem.prior_draw, (0, None)))
    z = draw(jax.random.split(jax.random.key(0), 30), data)
    plain, _ = small_curves.posterior(small_curves.curve(12, 2), n_facets=2)

    def parts(z):
        area = jnp.exp(problem.unravel(z)["log_albedo_area"])
        sparse = problem.log_factors(z, data) - plain.log_factors(z, data)
        return sparse, -0.01 * area.sum() ** 2, plain.log_factors(z, data)

    sparse, want, seen = jax.jit(jax.vmap(parts))(z)
    np.testing.assert_allclose(sparse, want, rtol=1e-9)
    assert np.all(seen <= 0)
    assert np.any(seen < -100)  # a facet that is never seen
    assert np.any(seen == 0)

    def prior(z):
        free = problem.unravel(z)
        areas = dist.Normal().log_prob(free["log_albedo_area"]).sum()
        spin = dist.Normal().log_prob(free["omega_unit"]).sum()
        radius = jnp.linalg.norm(free["normals_base"], axis=1)
        direction = dist.Normal(1.0, 0.1).log_prob(radius) - jnp.log(4 * jnp.pi * radius**2)
        return areas + spin + direction.sum()

    def both(z):
        rest = problem.log_factors(z, data) + problem.log_likelihood(z, data).sum()
        return -problem.potential(z, data), prior(z) + rest

    np.testing.assert_allclose(*jax.jit(jax.vmap(both))(z), rtol=1e-9)


def test_next_step_leaves_the_share_asked_for():
    rng = np.random.default_rng(0)
    log_likelihood, log_weights = -100 * rng.random((500, 3)), np.log(rng.dirichlet(np.ones(500)))

    def powers(s):  # the parts come in one after the other
        return np.clip(3 * s - np.arange(3), 0.0, 1.0)

    new = tempering.next_step(log_weights, log_likelihood, powers, 0.3, 0.6)
    assert 0.3 < new < 1
    w = np.exp(log_weights)
    change = np.exp(log_likelihood @ (powers(new) - powers(0.3)))
    np.testing.assert_allclose((w @ change) ** 2 / (w @ change**2), 0.6, rtol=0.01)
    assert tempering.next_step(log_weights, 1e-3 * log_likelihood, powers, 0.3, 0.6) == 1.0
    # Where half of the particles have no likelihood at all, 0.6 of them are never effective.
    none = np.where(np.arange(500) % 2, -np.inf, 0.0)[:, None] * np.ones(3)
    assert tempering.next_step(np.full(500, -np.log(500)), none, powers, 0.0, 0.6) == 0.0


def test_the_path_takes_in_points_in_time_and_ends_at_all_of_them(gaussian):
    problem, data = gaussian
    shuffled = jax.tree.map(lambda x: x[::-1] if x.ndim and x.shape[0] == 20 else x, data)
    for epochs in (data, shuffled):
        way = TimePath.of(epochs, problem.dim)
        powers = np.array([way.at(epochs, s).information for s in np.linspace(0, 1, 201)])
        assert np.all(powers[0] == 0.0)
        np.testing.assert_allclose(powers[-1], 1.0)
        assert np.all(np.diff(powers, axis=0) >= 0)
        np.testing.assert_allclose(powers[100], way.plateau)
        early = np.argsort(epochs.t)
        assert np.all(np.diff(powers[40][early]) <= 0)
        assert powers[40][early[0]] == way.plateau
        assert powers[40][early[-1]] == 0.0
    loud = replace(data, error=100.0 * data.error)
    assert TimePath.of(loud, problem.dim).plateau == 1.0
    unknown = replace(data, error=jnp.full(20, jnp.nan), has_error=False)
    assert 0.0 < TimePath.of(unknown, problem.dim).plateau < 1.0


def test_points_come_in_together_where_nothing_turns():
    """A flux that depends on time by itself turns; facets do if they have a spin."""
    problem, data = small_curves.posterior(small_curves.curve(12), spin="none")
    assert not tempering_path.rotates(problem, data, jax.random.key(0))
    together = TimePath.of(data, problem.dim, time_ordered=False)
    for s in np.linspace(0, 1, 11):
        assert np.ptp(together.powers(s)) == 0.0
    time_ordered = TimePath.of(data, problem.dim)
    for s in (0.0, 0.5, 0.7, 1.0):
        np.testing.assert_allclose(together.powers(s), time_ordered.powers(s))
    assert tempering_path.rotates(
        *small_curves.posterior(small_curves.curve(12), spin="free"), jax.random.key(0)
    )
    epochs = Epochs.of(small_curves.curve(20))
    assert tempering_path.rotates(Problem(linear, epochs), epochs, jax.random.key(0))


def test_systematic_choice_keeps_to_the_weights():
    rng = np.random.default_rng(0)
    weights = rng.dirichlet(np.full(60, 0.3))
    chosen = tempering.systematic(np.log(weights) + 5.0, 1000, 0.37)
    assert np.all(np.diff(chosen) >= 0)
    counts = np.bincount(chosen, minlength=60)
    assert np.all(np.abs(counts - 1000 * weights) < 1)
    # so is every run of neighbours
    assert np.all(np.abs(np.cumsum(counts) - 1000 * np.cumsum(weights)) <= 1)


def test_collapse_is_told_in_words():
    """A flux without a derivative: no trajectory ever ends anywhere."""

    def broken(data):
        x = jnp.asarray(numpyro.sample("x", dist.Normal()))
        likelihood.observe(data, x + jnp.sqrt(0.0 * x) + jnp.zeros_like(data.t))

    data = Epochs.of(small_curves.curve(10))
    with pytest.raises(smc.Collapse, match=r"0\.0% of the moves are accepted") as told:
        smc.run(Problem(broken, data), data, jax.random.key(0), 20)
    assert "\n" not in str(told.value)


def test_a_likelihood_that_cannot_be_tempered_is_refused():
    def stubborn(data):
        x = jnp.asarray(numpyro.sample("x", dist.Normal()))
        flux = jnp.asarray(numpyro.deterministic("flux", x * jnp.ones_like(data.t)))
        numpyro.sample("brightness", dist.Normal(flux, data.error), obs=data.brightness)

    data = Epochs.of(small_curves.curve(10))
    with pytest.raises(InputError, match=r"does not follow data\.information"):
        smc.run(Problem(stubborn, data), data, jax.random.key(0), 20)


def test_a_prior_without_density_is_refused():
    def nowhere(data):
        x = jnp.asarray(numpyro.sample("x", dist.Normal()))
        numpyro.factor("far", -jnp.inf * jnp.ones(()))
        likelihood.observe(data, x * jnp.ones_like(data.t))

    data = Epochs.of(small_curves.curve(10))
    with pytest.raises(InputError, match="of 80 draws from the prior"):
        smc.run(Problem(nowhere, data), data, jax.random.key(0), 20, plan=smc.Plan(max_pool=1))


def test_little_movement_is_reported(gaussian):
    problem, data = gaussian
    found = smc.run(problem, data, jax.random.key(0), 40, plan=smc.Plan(max_moves=1, length=0.05))
    assert any("the particles moved" in sentence(reason).text for reason in found.reasons)


def test_one_run_has_no_spread(gaussian):
    problem, data = gaussian
    with pytest.raises(ValueError, match="2 or more"):
        smc.replicate(problem, data, jax.random.key(0), 10, 1)


@pytest.mark.statistical(false_alarm=EACH)
def test_a_move_leaves_the_tempered_gaussian_as_it_is(gaussian):
    """20 moves of 8000 exact draws at λ = 0.1: mean and covariance stay."""
    problem, data = gaussian
    _, mean, cov = exact(data, 0.1)
    n, lam = 8000, jnp.asarray(0.1)
    z = np.random.default_rng(0).multivariate_normal(mean, cov, n)
    at, bins = replace(data, information=lam), TimePath.of(data, 3).bins
    state = moves.start(problem, at, jnp.asarray(z))
    width = jnp.sqrt(jnp.diagonal(jnp.asarray(cov)))
    tuning = moves.Tuning(0.9, 0.3, 1.5, 8, 0.5, width)
    for i in range(20):
        keys = jax.random.split(jax.random.key(i), n)
        out = moves.move(problem, at, data, bins, tuning, None, keys, state)
        state = out.state
    assert np.mean(out.accept) > 0.6
    white = np.linalg.solve(np.linalg.cholesky(cov), (np.asarray(state.z) - mean).T)
    assert np.all(np.abs(white.mean(axis=1)) < limit(9) / np.sqrt(n))
    scatter = white @ white.T / n - np.eye(3)
    assert np.all(np.abs(scatter) < limit(9) * np.sqrt((1 + np.eye(3)) / n))
    # and the particles are no longer where they were
    before = np.linalg.solve(np.linalg.cholesky(cov), (z - mean).T)
    assert np.all(np.abs(np.sum(before * white, axis=1) / n) < 0.3)
