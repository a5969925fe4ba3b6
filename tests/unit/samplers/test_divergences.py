"""Chains whose trajectories diverge: they go on with a smaller step."""

from __future__ import annotations

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import sampling
from lcbayes.samplers.convergence import MAX_DIVERGING
from lcbayes.samplers.settings import Settings
from tests.helpers import small_curves
from tests.helpers.sampled_chains import sampled

# How often two chains diverge depends on their seed, and so on rounding; shares are over SEEDS.
SEEDS = range(6)
pytestmark = pytest.mark.usefixtures("full_optimisation")


def funnel(data: Epochs) -> None:
    """Neal's funnel, of which the brightness tells nothing: its neck is too narrow for the step
    that its mouth asks for."""
    width = numpyro.sample("log_width", dist.Normal(0.0, 1.5))
    inside = numpyro.sample("inside", dist.Normal(0.0, jnp.exp(width)).expand([4]).to_event(1))
    likelihood.observe(data, jnp.full(data.t.shape, 1.0) + 0.0 * jnp.sum(jnp.asarray(inside)))


@pytest.fixture(scope="module")
def problem():
    data = Epochs.of(small_curves.curve())
    return Problem(funnel, data), data


def run(problem, data, checkpoint=None, sampler="nuts", seed=0):
    settings = Settings(sampler=sampler, num_warmup=100, num_samples=500, num_chains=2)
    return sampled(problem, data, settings, np.zeros(problem.dim), seed, checkpoint)


def share(stats) -> float:
    return float(np.mean(stats["diverging"]))


def test_draws_begin_anew_with_half_the_step_where_too_many_diverge(problem, monkeypatch):
    z, stats, whitening, tuning = run(*problem)
    assert z.shape == (2, 500, 5)
    assert stats["diverging"].shape == (2, 500)
    halved = [stats, *(run(*problem, seed=k)[1] for k in SEEDS[1:])]
    monkeypatch.setattr(sampling, "HALVINGS", 0)
    before = [run(*problem, seed=k)[1] for k in SEEDS]
    assert share(before[0]) > MAX_DIVERGING
    assert np.mean([*map(share, halved)]) < 0.5 * np.mean([*map(share, before)])
    assert stats["num_steps"].mean() > 1.5 * before[0]["num_steps"].mean()
    inverse = np.linalg.inv(np.asarray(whitening.factor))
    for matrix in tuning["inverse_mass_matrix"]:  # of z; diagonal in whitened coordinates
        whitened = inverse @ matrix @ inverse.T
        assert np.diag(whitened).min() > 0.0
        np.testing.assert_allclose(whitened, np.diag(np.diag(whitened)), atol=1e-9)


def test_a_run_that_was_stopped_goes_on_with_the_same_step(problem, tmp_path):
    problem, data = problem
    whole, *_ = run(problem, data, Checkpoint(tmp_path / "a", {}))
    blocks = sorted((tmp_path / "a").glob("mode-0-*"))
    assert len(blocks) > 12  # of warm-up and sampling: some were dropped
    for path in blocks[7:]:
        path.unlink()
    again, *_ = run(problem, data, Checkpoint(tmp_path / "a", {}))
    np.testing.assert_array_equal(again, whole)
