"""Mass matrices by their inverse roots, against NumPy; momenta against the covariance claimed."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import integrators, metric
from tests.helpers.false_alarms import EACH, limit

DIMS = (1, 3, 7)


def mass(dim: int, seed: int = 0) -> np.ndarray:
    """Positive definite, condition about 10⁴, nothing diagonal about it."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.standard_normal((dim, dim)))
    return (q * np.geomspace(0.02, 200.0, dim)) @ q.T


inverse_root = jax.jit(metric.inverse_root)
scale_of = jax.jit(metric.scale_of)


@pytest.mark.parametrize("dim", DIMS)
def test_inverse_root(dim):
    """W Wᵀ = M⁻¹, W upper triangular as the integrators' solves take it to be."""
    m = mass(dim)
    root, good = inverse_root(m, np.eye(dim))
    assert bool(good)
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(m), rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(root, np.triu(root))
    np.testing.assert_allclose(metric.log_det(root), np.linalg.slogdet(m)[1], rtol=1e-10)


def test_only_the_symmetric_part_counts():
    """Rounding makes a Fisher matrix a little asymmetric; Cholesky would read one triangle."""
    m = mass(3)
    skew = np.array([[0.0, 1.0, -2.0], [-1.0, 0.0, 0.5], [2.0, -0.5, 0.0]])
    root, _ = inverse_root(m + 0.01 * skew, np.eye(3))
    np.testing.assert_allclose(root, inverse_root(m, np.eye(3))[0], rtol=1e-9, atol=1e-12)


BAD = {
    "zero": np.zeros((2, 2)),
    "one direction unknown": np.diag([1.0, 0.0]),
    "rank one": np.ones((2, 2)),
    "indefinite": np.array([[1.0, 2.0], [2.0, 1.0]]),
    "negative": -np.eye(2),
    "nan": np.array([[1.0, np.nan], [np.nan, 1.0]]),
    "nan on the diagonal": np.diag([np.nan, 1.0]),
    "infinite": np.diag([np.inf, 1.0]),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
def test_a_bad_mass_gives_way_to_the_fallback(bad):
    fallback = mass(2, seed=1)
    root, good = inverse_root(bad, fallback)
    assert not bool(good)
    np.testing.assert_allclose(root @ root.T, np.linalg.inv(fallback), rtol=1e-10)


def test_chains_side_by_side_fall_back_one_by_one():
    """Under vmap the bad ones do not spoil the good."""
    m, fallback = mass(2), mass(2, seed=1)
    batch = np.stack([m, *BAD.values(), m])
    root, good = jax.jit(jax.vmap(metric.inverse_root, (0, None)))(batch, fallback)
    np.testing.assert_array_equal(good, [True, *[False] * len(BAD), True])
    result = np.asarray(root) @ np.swapaxes(root, 1, 2)
    for i, want in enumerate([m, *[fallback] * len(BAD), m]):
        np.testing.assert_allclose(result[i], np.linalg.inv(want), rtol=1e-9)


@pytest.mark.parametrize("dim", DIMS)
def test_momenta_have_the_mass_for_covariance(dim):
    """p = W⁻ᵀv over the 2D points of a cubature that is exact for second moments: p pᵀ is M."""
    m = mass(dim)
    root, _ = inverse_root(m, np.eye(dim))
    points = np.sqrt(dim) * np.concatenate([np.eye(dim), -np.eye(dim)])
    p = np.asarray(jax.vmap(lambda v: integrators.unwhiten(root, v))(points))
    np.testing.assert_allclose(p.T @ p / len(p), m, rtol=1e-10, atol=1e-10)
    kinetic = 0.5 * np.einsum("ni,ij,nj->n", p, np.linalg.inv(m), p)
    np.testing.assert_allclose(jax.vmap(metric.kinetic)(points), kinetic, rtol=1e-8)


@pytest.mark.statistical(false_alarm=EACH)
def test_drawn_momenta_are_gaussian_with_that_covariance():
    """20 000 draws: 6 second moments, 3 means, and energies χ²₃ by Kolmogorov and Smirnov."""
    n, m = 20_000, mass(3)
    root, _ = inverse_root(m, np.eye(3))
    keys = jax.random.split(jax.random.key(0), n)
    v = jax.jit(jax.vmap(lambda k: metric.momentum(k, 3)))(keys)
    p = np.asarray(jax.vmap(lambda v: integrators.unwhiten(root, v))(v))
    error = np.sqrt((np.outer(np.diag(m), np.diag(m)) + m**2) / n)
    most = limit(10)
    assert np.all(np.abs(p.T @ p / n - m) < most * error)
    assert np.all(np.abs(p.mean(axis=0)) < most * np.sqrt(np.diag(m) / n))
    energy = 0.5 * np.einsum("ni,ij,nj->n", p, np.linalg.inv(m), p)
    assert stats.kstest(2 * energy, stats.chi2(3).cdf).pvalue > EACH / 10


@pytest.mark.parametrize("dim", DIMS)
def test_scale_of_a_covariance(dim):
    s, mean = mass(dim), np.arange(float(dim))
    scale = scale_of(mean, s, metric.unit_scale(jnp.zeros(dim)))
    np.testing.assert_array_equal(scale.mean, mean)
    np.testing.assert_allclose(scale.root, np.linalg.cholesky(s), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(scale.white @ scale.root, np.eye(dim), atol=1e-10)
    np.testing.assert_allclose(scale.precision, np.linalg.inv(s), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
def test_a_bad_covariance_leaves_the_old_scale(bad):
    old = scale_of(np.ones(2), mass(2), metric.unit_scale(jnp.zeros(2)))
    for kept, was in zip(scale_of(np.zeros(2), bad, old), old, strict=True):
        np.testing.assert_array_equal(kept, was)


def test_a_bad_mean_leaves_the_old_scale():
    old = metric.unit_scale(jnp.ones(2))
    result = scale_of(np.array([0.0, np.nan]), mass(2), old)
    for kept, was in zip(result, old, strict=True):
        np.testing.assert_array_equal(kept, was)
