"""The prior of the shape of an asteroid: normalised, and centred on ellipsoids."""

import numpy as np
import pytest
from scipy import integrate, stats

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.relief import EllipsoidWithRelief
from lcbayes.physics.bodies import facets

DEGREE = 6
DEGREES = np.concatenate([np.full(2 * n + 1, n) for n in range(1, DEGREE + 1)])
PRIOR = EllipsoidWithRelief(DEGREE)


def ellipsoid(*axes: float) -> np.ndarray:
    """Harmonics of the log areas of an ellipsoid by solid angle."""
    normals = facets.grid(4000)
    log_area = -2.0 * np.log(normals**2 @ np.square(axes))
    basis = facets.spherical_harmonics(normals, DEGREE)
    return np.linalg.lstsq(basis, log_area, rcond=None)[0][1:]


def test_density_is_the_mixture_over_the_roughness():
    """Unlike the harmonics of degree 2, the others have a common scale with a prior."""
    c = 0.4 * np.random.default_rng(0).normal(size=48) * (2.0 / (DEGREES + 1.0)) ** 2
    relief = np.asarray(PRIOR.relief(jnp.asarray(c)))
    width = 2.0 * (2.0 / (DEGREES[DEGREES != 2] + 1.0)) ** 2

    def at(log_tau: float) -> float:
        tau = np.exp(log_tau)
        given = stats.norm.logpdf(relief * width, 0.0, 0.5 * tau * width).sum()
        return np.exp(given + stats.invgamma.logpdf(tau**2, 1.0, scale=4.0)) * 2.0 * tau**2

    expected = np.log(integrate.quad(at, -4.0, 6.0, limit=200)[0])
    expected += stats.norm.logpdf(c[DEGREES == 2], 0.0, 1.5).sum()
    assert float(PRIOR.log_prob(jnp.asarray(c))) == pytest.approx(expected, abs=1e-6)


def test_a_known_roughness_makes_the_relief_normal():
    known = EllipsoidWithRelief(DEGREE, 0.8)
    c = 0.4 * np.random.default_rng(0).normal(size=48) * (2.0 / (DEGREES + 1.0)) ** 2
    others = DEGREES != 2
    width = (2.0 / (DEGREES[others] + 1.0)) ** 2
    height = np.asarray(PRIOR.relief(jnp.asarray(c))) * 2.0 * width
    expected = stats.norm.logpdf(height, 0.0, 0.8 * width).sum()
    expected += stats.norm.logpdf(c[~others], 0.0, 1.5).sum()
    assert float(known.log_prob(jnp.asarray(c))) == pytest.approx(expected, abs=1e-8)
    curvature = -np.asarray(jax.hessian(known.log_prob)(jnp.zeros(48)))
    np.testing.assert_allclose(known.precision(jnp.zeros(48)), curvature, atol=1e-6)
    draws = known.sample(jax.random.key(0), (4000,))
    assert np.median(known.roughness(draws)) == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize("roughness", [-1.0, np.inf, np.nan])
def test_a_roughness_that_is_none_is_refused(roughness):
    with pytest.raises(InputError, match="roughness is"):
        EllipsoidWithRelief(DEGREE, roughness)


@pytest.mark.parametrize("axes", [(1.7, 1.5, 1.0), (2.0, 1.4, 1.0), (1.3, 1.1, 1.0)])
def test_an_ellipsoid_is_nearly_without_relief(axes):
    c = ellipsoid(*axes)
    fourth = DEGREES == 4
    left = np.asarray(PRIOR.relief(jnp.asarray(c)))[(DEGREES[DEGREES != 2] == 4)] * 2.0 * 0.16
    assert np.linalg.norm(left) < 0.12 * np.linalg.norm(c[fourth])
    assert PRIOR.roughness(jnp.asarray(c)) < 0.3


def test_flattening_costs_nothing_but_its_own_prior():
    """With one scale for all degrees it cost ten nats or more, and axis ratios shrank."""
    round_, flat = (jnp.asarray(ellipsoid(1.15 * b, b, 1.0)) for b in (1.0, 1.5))
    change = float(PRIOR.log_prob(flat) - PRIOR.log_prob(round_))
    own = [stats.norm.logpdf(c[DEGREES == 2], 0.0, 1.5).sum() for c in (flat, round_)]
    assert change == pytest.approx(own[0] - own[1], abs=1.0)


def test_draws_have_the_density():
    draws = PRIOR.sample(jax.random.key(0), (20_000,))
    assert np.std(draws[:, DEGREES == 2], axis=0) == pytest.approx(1.5, rel=0.03)
    # 4/τ² ~ Exp(1), seen through 43 standard normals: the median of τ is 2.40
    assert np.median(PRIOR.roughness(draws)) == pytest.approx(2.40, rel=0.03)
    quantile = stats.f.ppf(0.9, 43, 2)
    square = np.mean(np.asarray(PRIOR.relief(draws)) ** 2, axis=1)
    assert np.mean(square > quantile) == pytest.approx(0.1, abs=0.01)


def test_precision_is_the_curvature_on_the_ellipsoid():
    axes = 0.5 * np.random.default_rng(1).normal(size=5)
    c = np.zeros(48)
    c[DEGREES == 2] = axes
    c[DEGREES != 2] = np.asarray(PRIOR._ellipsoid(jnp.asarray(axes)))
    hessian = -jax.hessian(PRIOR.log_prob)(jnp.asarray(c))
    np.testing.assert_allclose(PRIOR.precision(jnp.asarray(c)), hessian, atol=1e-9)
