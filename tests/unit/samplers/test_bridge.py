"""The evidence of densities that one Gaussian does not describe."""

import numpy as np
import pytest
from scipy.special import logsumexp

from lcbayes.samplers.bridge import Mixture, bridge, log_ratio

APART = 12.0  # sd between the parts of the density
SCALE = 3.0  # its integral


def draws(rng, n, dim):
    z = rng.standard_normal((4, n, dim))
    z[..., 0] += np.where(rng.random((4, n)) < 0.25, APART, 0.0)
    return z


def potential(z):
    first, second = z.copy(), z.copy()
    second[:, 0] -= APART
    each = np.stack([np.log(0.75) - 0.5 * np.sum(first**2, axis=1),
                     np.log(0.25) - 0.5 * np.sum(second**2, axis=1)])  # fmt: skip
    return (
        -np.asarray(logsumexp(each, axis=0)) + 0.5 * z.shape[1] * np.log(2 * np.pi) - np.log(SCALE)
    )


@pytest.mark.parametrize("dim", [2, 12])
def test_two_separate_parts(dim):
    rng = np.random.default_rng(dim)
    z = draws(rng, 600, dim)
    result = bridge(z, potential, 1000.0, rng)
    assert result.se < 0.1
    assert abs(result.value - np.log(SCALE)) < 4.0 * result.se
    assert len(Mixture.of(z.reshape(-1, dim), rng).mean) > 1


def test_one_gaussian_is_described_by_one():
    rng = np.random.default_rng(3)
    z = rng.standard_normal((4000, 10)) @ np.diag(np.logspace(-3, 3, 10))
    mixture = Mixture.of(z, rng)
    assert len(mixture.mean) == 1
    exact = -0.5 * np.sum((z / np.logspace(-3, 3, 10)) ** 2, axis=1)
    exact -= 5.0 * np.log(2 * np.pi) + np.log(np.logspace(-3, 3, 10)).sum()
    assert np.mean(mixture.log_density(z) - exact) == pytest.approx(0.0, abs=0.02)


def test_the_ratio_of_two_normal_densities():
    """p̃ = 5 N(0.5, 1) and q̃ = 2 N(0, 1): ln Z_p/Z_q = ln 2.5."""
    rng = np.random.default_rng(4)
    p, q = 0.5 + rng.standard_normal(4000), rng.standard_normal(4000)

    def ratio(x):
        return np.log(2.5) - 0.5 * (x - 0.5) ** 2 + 0.5 * x**2

    result = log_ratio(ratio(p), ratio(q), 4000, 4000)
    assert abs(result.value - np.log(2.5)) < 4.0 * result.se
    assert result.se < 0.02
