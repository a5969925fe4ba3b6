"""Priors: what they say, and that a sampler can live with them."""

from __future__ import annotations

import numpy as np
import pytest
from numpyro import handlers
from scipy import integrate, stats

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import priors
from tests.helpers.false_alarms import EACH


def factor_of(call) -> float:
    """log p of the factors that a prior adds."""
    trace = handlers.trace(handlers.seed(call, 0)).get_trace()
    return float(sum(jnp.sum(s["fn"].log_prob(s["value"])) for s in trace.values()))


def test_direction_density_is_normalised():
    """∫ p(b) d³b = ∫ p(r) 4πr² dr, up to the mass of a Gaussian ten sd below its mean."""
    one = priors.UniformDirection(1)

    def radial(r: float) -> float:
        return 4 * np.pi * r**2 * float(jnp.exp(one.log_prob(jnp.array([[0.0, 0.0, r]])))[0])

    total = integrate.quad(radial, 1e-6, 2.5, points=[1.0], limit=60, epsabs=1e-11)[0]
    np.testing.assert_allclose(total, 1.0, rtol=1e-9)


def test_density_on_the_circle_is_normalised():
    """∫ p(b) d²b = ∫ p(r) 2πr dr."""
    one = priors.UniformDirection(1, 2)

    def radial(r: float) -> float:
        return 2 * np.pi * r * float(jnp.exp(one.log_prob(jnp.array([[0.0, r]])))[0])

    total = integrate.quad(radial, 1e-6, 2.5, points=[1.0], limit=60, epsabs=1e-11)[0]
    np.testing.assert_allclose(total, 1.0, rtol=1e-9)


@pytest.mark.statistical(false_alarm=EACH)
def test_direction_density_is_the_samples_density():
    """Lengths of samples follow the radial part of the density, a Gaussian about one."""
    b = priors.UniformDirection(2).sample(jax.random.key(1), (4000,))
    length = np.linalg.norm(b, axis=-1).ravel()
    assert b.shape == (4000, 2, 3)
    assert stats.kstest(length, stats.norm(1.0, priors.RADIUS_SD).cdf).pvalue > EACH


@pytest.mark.statistical(false_alarm=EACH)
def test_directions_are_uniform():
    """Azimuth and height of uniform directions are uniform and independent of each other."""
    with handlers.seed(rng_seed=2):
        u = np.asarray(priors.directions("n", 5000))
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, rtol=1e-12)
    phi, g = np.arctan2(u[:, 1], u[:, 0]), u[:, 2]
    assert stats.kstest(phi, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > EACH / 3
    assert stats.kstest(g, stats.uniform(-1, 2).cdf).pvalue > EACH / 3
    assert stats.spearmanr(np.abs(phi), g).pvalue > EACH / 3


@pytest.mark.statistical(false_alarm=EACH)
def test_angles_are_uniform():
    def drawn(seed: int) -> float:
        with handlers.seed(rng_seed=seed):
            return float(priors.angle("phase"))

    angle = [drawn(k) for k in range(400)]
    assert stats.kstest(angle, stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > EACH


@pytest.mark.parametrize("length", [0.0, 1e-8, 0.3, 1.0, 30.0])
def test_direction_gradient_is_finite(length):
    one = priors.UniformDirection(1)
    slope = jax.grad(lambda b: one.log_prob(b).sum())(length * jnp.array([[0.6, 0.0, 0.8]]))
    assert np.all(np.isfinite(slope))


def test_normals_record_their_angles():
    trace = handlers.trace(handlers.seed(priors.normals, 3)).get_trace(4)
    phi, g = (np.asarray(trace[k]["value"]) for k in ("phi", "g"))
    s = np.sqrt(1 - g**2)
    rebuilt = np.stack([s * np.cos(phi), s * np.sin(phi), g], axis=1)
    np.testing.assert_allclose(rebuilt, trace["normals"]["value"], atol=1e-12)
    assert np.all((phi >= 0) & (phi < 2 * np.pi))


@pytest.mark.statistical(false_alarm=EACH)
def test_albedo_area_is_log_normal():
    with handlers.seed(rng_seed=4):
        area = np.asarray(priors.albedo_area(4000, 1.2, 0.5))
    assert stats.kstest(np.log(area), stats.norm(1.2, 0.5).cdf).pvalue > EACH


@pytest.mark.statistical(false_alarm=EACH)
def test_reflectances_are_uniform_over_the_triangle():
    def draw(key):
        with handlers.seed(rng_seed=key):
            result = priors.surface("blinn-phong", 1)
        return result["r_diff"][0], result["r_spec"][0]

    r_diff, r_spec = np.asarray(jax.vmap(draw)(jax.random.split(jax.random.key(5), 4000)))
    assert np.max(r_diff + r_spec) <= 1.0
    # marginals of a uniform triangle are Beta(1, 2), and 1 - r_diff - r_spec is alike
    for values in (r_diff, r_spec, 1.0 - r_diff - r_spec):
        assert stats.kstest(values, stats.beta(1, 2).cdf).pvalue > EACH / 3


def test_sparse_area_maps_to_the_papers_lambda():
    """The weight is 1/λ² of eq. (30) and 1/(2λ²) of eq. (29)."""
    area, lam = jnp.array([10.0, 20.0, 30.0]), 25.0
    eq30 = -(float(jnp.sum(area)) ** 2) / lam**2
    np.testing.assert_allclose(factor_of(lambda: priors.sparse_area(area, lam**-2)), eq30)
    np.testing.assert_allclose(factor_of(lambda: priors.sparse_area(area, lam**-2 / 2)), eq30 / 2)


def test_a_larger_weight_is_sparser():
    area = jnp.array([1.0, 2.0])
    light, heavy = (factor_of(lambda w=w: priors.sparse_area(area, w)) for w in (0.1, 10.0))
    assert heavy < light < 0


def test_angular_velocity_has_the_sd_asked_for():
    with handlers.seed(rng_seed=5):
        w = np.array([priors.angular_velocity(0.02) for _ in range(1)])
    assert w.shape == (1, 3)
    trace = handlers.trace(handlers.seed(priors.angular_velocity, 6)).get_trace(0.02)
    np.testing.assert_allclose(trace["omega"]["value"], 0.02 * trace["omega_unit"]["value"])


def test_visibility_prior_is_exact_inside_and_a_slope_outside():
    """Zero wherever each facet has one epoch with both cosines positive; −(m/s)² below."""
    # Normals along x and y: the first two components of a direction are the cosines of the facets.
    axes = jnp.eye(3)[:2]

    def factor(sun, obs, normals=axes, softness=0.02):
        sun, obs = (jnp.pad(jnp.array(v), ((0, 0), (0, 3 - len(v[0])))) for v in (sun, obs))
        return factor_of(lambda: priors.visibility_prior(sun, obs, normals, softness))

    assert factor([[-0.5, 0.2], [0.3, 0.9]], [[0.9, 0.1], [0.05, -0.2]]) == 0.0
    # Lit at one epoch and seen at another is not enough: max over epochs of the smaller.
    np.testing.assert_allclose(factor([[0.5], [-0.04]], [[-0.06], [0.5]], axes[:1]), -4.0)
    # Two cosines of −0.5 have a positive product, and yet the facet is dark (the misprint of (8)).
    np.testing.assert_allclose(factor([[-0.5]], [[-0.5]], axes[:1]), -625.0)
    # Nor is an epoch that it turns away from the best one, though its product is the largest.
    assert factor([[0.3], [-0.9]], [[0.3], [-0.9]], axes[:1]) == 0.0
    np.testing.assert_allclose(
        factor([[0.5], [-0.9]], [[-0.02], [-0.9]], axes[:1]), -1.0, rtol=1e-12
    )


def test_visibility_prior_leads_back():
    """Its slope is that of the best epoch, as finite differences see it."""
    rng = np.random.default_rng(3)
    sun, obs = rng.normal(size=(2, 7, 3)) + np.array([2.0, 0.0, 0.0])

    def log_p(normals):
        with handlers.block(), handlers.trace() as trace, handlers.seed(rng_seed=0):
            priors.visibility_prior(jnp.asarray(sun), jnp.asarray(obs), normals)
        return trace["visibility"]["fn"].log_factor

    away, towards = jnp.array([[-1.0, 0.1, 0.0]]), jnp.array([[1.0, 0.1, 0.0]])
    slope = jax.grad(log_p)(away)
    numeric = [(log_p(away + e) - log_p(away - e)) / 2e-6 for e in 1e-6 * jnp.eye(3)]
    np.testing.assert_allclose(slope[0], numeric, rtol=1e-6)
    assert float(log_p(away)) < -1.0
    assert not np.any(jax.grad(log_p)(towards))


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: priors.normals(0), "n_facets is 0"),
        (lambda: priors.spin("sideways", 0.1), "unknown spin 'sideways'"),
        (lambda: priors.spin("free", 0.0), "omega_sd is 0.0"),
        (lambda: priors.albedo_area(2, 0.0, -1.0), "log_area_sd is -1.0"),
        (lambda: priors.sparse_area(jnp.ones(2), -1.0), "sparsity is -1.0"),
    ],
)
def test_senseless_options_are_refused(call, says):
    with handlers.seed(rng_seed=0), pytest.raises(ValueError, match=says):
        call()
