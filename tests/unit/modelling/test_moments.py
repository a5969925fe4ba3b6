"""Mixed coordinates of a log-linear body against automatic and finite differences."""

from functools import partial

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import moments
from lcbayes.modelling.moments import MomentCoordinates
from lcbayes.physics.bodies import facets

N_MOMENTS, N_BASIS = 8, 15  # degrees up to 2 as moments, degree 3 as it is
NODES, WEIGHTS = facets.rings(120)
BASIS = facets.spherical_harmonics(NODES, 3)[:, 1:]
TRANSFORM = MomentCoordinates(BASIS, N_MOMENTS, np.log(WEIGHTS))


@pytest.fixture(params=[0.1, 1.0, 3.0])
def coefficients(request) -> jax.Array:
    """Nearly a sphere, a usual asteroid, one whose areas differ by decades."""
    return jnp.asarray(request.param * np.random.default_rng(1).normal(size=N_BASIS))


def test_moments_are_sums_over_the_grid(coefficients):
    area = WEIGHTS * np.exp(BASIS @ np.asarray(coefficients))
    x = np.asarray(TRANSFORM.inv(coefficients))
    np.testing.assert_allclose(x[:N_MOMENTS], (area @ BASIS / area.sum())[:N_MOMENTS], rtol=1e-12)
    np.testing.assert_array_equal(x[N_MOMENTS:], coefficients[N_MOMENTS:])


def test_round_trip(coefficients):
    back = TRANSFORM(jnp.asarray(TRANSFORM.inv(coefficients)))
    np.testing.assert_allclose(back, coefficients, rtol=1e-8, atol=1e-10)


def test_log_determinant_is_that_of_the_inverse_maps_jacobian(coefficients):
    # of the inverse, which needs no rule of our own
    expected = -np.linalg.slogdet(jax.jacfwd(TRANSFORM._inverse)(coefficients))[1]
    x = TRANSFORM.inv(coefficients)
    assert TRANSFORM.log_abs_det_jacobian(x, coefficients) == pytest.approx(expected, abs=1e-9)


def test_derivative_is_the_inverse_of_the_inverses(coefficients):
    there = jax.jacfwd(TRANSFORM._inverse)(coefficients)
    x = TRANSFORM.inv(coefficients)
    for mode in (jax.jacfwd, jax.jacrev):
        np.testing.assert_allclose(mode(TRANSFORM)(x) @ there, np.eye(N_BASIS), atol=1e-8)


def test_gradient_against_finite_differences():
    x = TRANSFORM.inv(jnp.asarray(np.random.default_rng(2).normal(size=N_BASIS)))

    def value(x):
        c = TRANSFORM(x)
        return jnp.sum(c**3) + TRANSFORM.log_abs_det_jacobian(x, c)

    step = 1e-5
    shifts = step * np.eye(N_BASIS)
    value = jax.jit(value)
    numeric = [(value(x + h) - value(x - h)) / (2 * step) for h in shifts]
    np.testing.assert_allclose(jax.grad(value)(x), numeric, rtol=1e-5, atol=1e-5)


def test_moments_beyond_any_positive_areas_are_nan():
    # More in one harmonic than even a body with a single facet has.
    x = jnp.zeros(N_BASIS).at[0].set(1.01 * np.abs(BASIS[:, 0]).max())
    assert np.isnan(np.asarray(TRANSFORM(x))[:N_MOMENTS]).all()


def test_covariance_of_the_functions_against_sums_over_the_grid(coefficients):
    area = WEIGHTS * np.exp(BASIS @ np.asarray(coefficients))
    low, p = BASIS[:, :N_MOMENTS], area / area.sum()
    mean, covariance, share = TRANSFORM.low.moments(
        coefficients[:N_MOMENTS], TRANSFORM._offset(coefficients)
    )
    np.testing.assert_allclose(share, p, rtol=1e-12)
    np.testing.assert_allclose(mean, p @ low, atol=1e-13)
    np.testing.assert_allclose(covariance, np.cov(low.T, aweights=p, ddof=0), atol=1e-13)


def test_products_of_harmonics_are_sums_of_those_up_to_twice_their_degree():
    assert TRANSFORM.low.span.shape == (len(NODES), 25)


@pytest.mark.parametrize("distance", [0.0, 0.1, 1.0])
def test_a_start_nearby_does_not_change_the_result(coefficients, distance):
    x = jnp.asarray(TRANSFORM.inv(coefficients))
    other = coefficients + distance * np.random.default_rng(3).normal(size=N_BASIS)
    start = TRANSFORM.start(jnp.asarray(TRANSFORM.inv(other)))
    np.testing.assert_allclose(TRANSFORM(x, start), coefficients, rtol=1e-8, atol=1e-10)
    near, far = (jax.jacrev(partial(TRANSFORM, start=s))(x) for s in (start, None))
    np.testing.assert_allclose(near, far, rtol=1e-6, atol=1e-8)


def test_a_start_nearby_saves_steps(monkeypatch):
    coefficients = jnp.asarray(np.random.default_rng(1).normal(size=N_BASIS))
    x = jnp.asarray(TRANSFORM.inv(coefficients))
    start = TRANSFORM.start(jnp.asarray(TRANSFORM.inv(coefficients + 0.05)))
    monkeypatch.setattr(moments, "MAX_NEWTON_STEPS", 4)
    assert np.isfinite(np.asarray(TRANSFORM(x, start))).all()
    assert np.isnan(np.asarray(TRANSFORM(x))).any()
