"""The alternating kernel samples a density whose parts have other widths and a gap between them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import norm

from lcbayes.samplers.convergence import rhat_and_ess
from lcbayes.samplers.kernels.alternating import Alternating

WEIGHT = np.array([0.3, 0.7])
MEAN = np.array([[4.0, 0.0], [-4.0, 0.0]])
SD = np.array([[0.1, 1.0], [1.0, 0.2]])
WARMUP, DRAWS, CHAINS = 100, 1500, 4
FALSE_ALARM = 1e-4  # of the whole test


def potential(z):
    each = jnp.log(WEIGHT) - jnp.sum(0.5 * ((z - MEAN) / SD) ** 2 + jnp.log(SD), axis=1)
    return -jax.nn.logsumexp(each)


def fisher(z):
    """Of the nearer part; the kernel is exact for any other too."""
    return jnp.diag(jnp.where(z[0] > 0, 1.0 / SD[0] ** 2, 1.0 / SD[1] ** 2))


def across(key, z):
    """To the same place in the other part, by the rule of Metropolis and Hastings."""
    here = jnp.where(z[0] > 0, 0, 1)
    scale = jnp.asarray(SD)[1 - here] / jnp.asarray(SD)[here]
    image = jnp.asarray(MEAN)[1 - here] + scale * (z - jnp.asarray(MEAN)[here])
    log_ratio = potential(z) - potential(image) + jnp.sum(jnp.log(scale))
    back = (image[0] > 0) != (z[0] > 0)  # else the move has no inverse
    taken = back & (jnp.log(jax.random.uniform(key)) < log_ratio)
    return jnp.where(taken, image, z)


@pytest.fixture(scope="module")
def draws():
    kernel = Alternating(potential, fisher, across)

    def chain(key):
        state = kernel.init(key, WARMUP, jnp.array([4.0, 0.0]))

        def step(state, _):
            state = kernel.sample(state, (), {})
            return state, state.z

        return jax.lax.scan(step, state, length=WARMUP + DRAWS)[1][WARMUP:]

    return np.asarray(
        jax.jit(lambda k: jax.lax.map(chain, k))(jax.random.split(jax.random.key(1), CHAINS))
    )


@pytest.mark.statistical(false_alarm=FALSE_ALARM)
def test_the_density_is_left_invariant(draws):
    right = draws[..., 0] > 0
    first, second = (draws - MEAN[0]) / SD[0], (draws - MEAN[1]) / SD[1]
    checks = {
        "weight": (right * 1.0, WEIGHT[0]),
        "square of x, right": (np.where(right, first[..., 0] ** 2, 0.0), WEIGHT[0]),
        "square of y, right": (np.where(right, first[..., 1] ** 2, 0.0), WEIGHT[0]),
        "square of x, left": (np.where(right, 0.0, second[..., 0] ** 2), WEIGHT[1]),
        "square of y, left": (np.where(right, 0.0, second[..., 1] ** 2), WEIGHT[1]),
        "x times y, left": (np.where(right, 0.0, second[..., 0] * second[..., 1]), 0.0),
    }
    limit = norm.isf(0.5 * FALSE_ALARM / len(checks))
    for name, (values, expected) in checks.items():
        error = values.std() / np.sqrt(rhat_and_ess(values[..., None])[1])
        assert abs(values.mean() - expected) < limit * error, name
        assert error < 0.05, name


def test_chains_cross_the_gap(draws):
    right = draws[..., 0] > 0
    assert np.all(np.any(right, axis=1) & np.any(~right, axis=1))
