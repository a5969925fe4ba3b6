"""NUTS begins in coordinates of an optimum, and goes on in those of the mean of its draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy.stats import norm

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.convergence import rhat_and_ess
from lcbayes.samplers.settings import GUIDED, NUTS, Settings
from tests.helpers import small_curves
from tests.helpers.sampled_chains import sampled

FALSE_ALARM = 1e-5
SHAPES = np.array([0.7, 1.5, 4.0])
MODE = np.log(SHAPES)


def skewed(data: Epochs) -> None:
    """Gamma variates, sampled as logarithms, whose widths at the mean and at the mode differ."""
    for i, shape in enumerate(SHAPES):
        numpyro.sample(f"x{i}", dist.Gamma(shape, 1.0))
    likelihood.observe(data, jnp.ones(data.t.shape))


def bent(data: Epochs) -> None:
    """A ring, of which the mean is empty."""
    x = jnp.asarray(numpyro.sample("x", dist.Normal(0.0, 100.0).expand([2]).to_event(1)))
    numpyro.factor("ring", -0.5 * ((jnp.linalg.norm(x) - 3.0) / 0.1) ** 2)
    likelihood.observe(data, jnp.ones(data.t.shape))


def run(model, start, guide=None, checkpoint=None):
    data = Epochs.of(small_curves.curve())
    problem = Problem(model, data)
    settings = Settings(sampler=NUTS if guide is None else GUIDED, num_samples=500, num_chains=4)
    held = None if guide is None else guide(data)
    return sampled(problem, data, settings, start, 3, checkpoint, held)


@pytest.mark.statistical(false_alarm=FALSE_ALARM)
@pytest.mark.parametrize("guided", [False, True])
def test_coordinates_are_those_of_the_mean(guided, tmp_path):
    """The draws are of the exact density, also along a guide, which is made anew at the mean."""
    at = []

    def guide(data):
        def about(z):
            at.append(np.asarray(z))
            return data

        return about

    where = tmp_path / "chains"
    z, _, whitening, _ = run(skewed, MODE, guide if guided else None, Checkpoint(where, {}))
    with np.load(where / "mode-0-0000.npz") as pilot:
        mean = pilot["z"][:, 25:].mean(axis=(0, 1))
    np.testing.assert_allclose(whitening.centre, mean)
    assert np.linalg.norm(mean - MODE) > 0.2
    if guided:
        np.testing.assert_allclose(at[1:], [mean])
    limit = norm.isf(0.5 * FALSE_ALARM / 6)
    for i, shape in enumerate(SHAPES):
        values = np.exp(z[..., i])  # gamma variates
        error = values.std() / np.sqrt(rhat_and_ess(values[..., None])[1])
        assert abs(values.mean() - shape) < limit * error
        assert error < 0.2 * shape


def level(data: Epochs) -> None:
    """A constant brightness of unknown size."""
    size = jnp.asarray(numpyro.sample("size", dist.Normal(1.0, 10.0)))
    likelihood.observe(data, size * jnp.ones(data.t.shape))


@pytest.mark.statistical(false_alarm=FALSE_ALARM)
@pytest.mark.parametrize(("factor", "followed"), [(1.0, True), (1.5, False)])
def test_a_guide_is_dropped_if_it_differs(factor, followed, tmp_path):
    curve = small_curves.curve()
    checkpoint = Checkpoint(tmp_path / "a", {})

    def guide(data):
        return lambda _: replace(data, brightness=factor * data.brightness)

    z, *_ = run(level, (1.0,), guide, checkpoint)
    assert bool(list((tmp_path / "a").glob("mode-0-exact-*"))) != followed
    assert curve.error is not None
    weight = curve.error**-2.0
    mean, sd = np.sum(weight * curve.brightness) / weight.sum(), weight.sum() ** -0.5
    error = sd / np.sqrt(rhat_and_ess(z)[1])
    assert abs(z.mean() - mean) < norm.isf(0.25 * FALSE_ALARM) * error
    again, *_ = run(level, (1.0,), guide, checkpoint)
    np.testing.assert_array_equal(again, z)


def test_they_stay_where_the_mean_is_improbable():
    z, _, whitening, _ = run(bent, (3.0, 0.0))
    np.testing.assert_allclose(whitening.centre, (3.0, 0.0))
    assert z[..., 0].min() < -2.9 < 2.9 < z[..., 0].max()


def test_a_stopped_warm_up_goes_on_the_same(tmp_path):
    whole, *_ = run(skewed, MODE, checkpoint=Checkpoint(tmp_path / "a", {}))
    for kept in (1, 2, 5):  # blocks: in the pilot, at its end and in the warm-up after it
        for path in sorted((tmp_path / "a").glob("mode-0-*"))[kept:]:
            path.unlink()
        again, *_ = run(skewed, MODE, checkpoint=Checkpoint(tmp_path / "a", {}))
        np.testing.assert_array_equal(again, whole)
