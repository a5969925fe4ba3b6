"""The brightness of an asteroid expanded about one solution."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import search
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.expansion import Expansion
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import convex_grid
from lcbayes.physics.bodies import facets
from tests.helpers.asteroids import SMALL, observed

T, N = 40, 162
WIDTHS, CENTRE, LAMBERT = np.array([0.01, 0.02, 0.3]), np.array([0.0, 0.0, 0.4]), 0.15


@pytest.fixture(scope="module")
def known():
    """A brightness that is a polynomial of known coefficients, and its expansion."""
    rng = np.random.default_rng(1)
    normals = facets.grid(N)
    mean = rng.uniform(0.5, 1.5, N)
    a, c, d, q = (rng.normal(size=(T, N)) for _ in range(4))
    b = rng.normal(size=(3, T, N))
    cubic = rng.normal(size=T)

    def light(motion, area, lambert):
        m = (motion - CENTRE) / WIDTHS
        second = a + jnp.tensordot(m, b, 1) + (m[0] * m[2] - m[1] ** 2) * q
        third = cubic * (m[0] ** 2 * m[2] + m[1] ** 3 - m[0] * m[1] * m[2]) * jnp.sum(area)
        return (second + lambert * (c + m[1] * d)) @ area + third

    # as many bodies as epochs, so that all light curves are combinations of theirs
    likely = (
        CENTRE + WIDTHS * rng.normal(size=(2 * T, 3)),
        mean * (1.0 + 0.3 * rng.normal(size=(2 * T, N))),
        LAMBERT + 0.05 * rng.normal(size=2 * T),
    )
    at = (CENTRE, mean, LAMBERT)
    at, likely = jax.tree.map(jnp.asarray, (at, likely))
    return light, Expansion.of(light, at, likely, jnp.asarray(WIDTHS), jnp.eye(3), normals), mean


@pytest.mark.parametrize(
    ("motion", "lambert", "changed"),
    [
        ((1.0, -2.0, 0.7), 0.0, False),
        ((0.6, 1.5, -1.1), 0.1, False),
        ((0.0, 0.0, 0.0), 0.1, True),
        ((0.9, -0.4, 1.2), 0.0, True),
    ],
)
def test_it_is_a_polynomial_where_the_brightness_is_one(known, motion, lambert, changed):
    """Cubic in the motion and linear in c for the mean body; for others quadratic in the motion or
    linear in c."""
    light, expansion, mean = known
    m, c = jnp.asarray(CENTRE + WIDTHS * motion), LAMBERT + lambert
    area = mean
    if changed:  # by harmonics, with the same sum, on which the cubic term depends
        inner = facets.spherical_harmonics(facets.grid(N), 4)[:, 5:]
        deviation = mean[:, None] * inner
        deviation -= np.outer(mean, deviation.sum(axis=0) / mean.sum())
        area = mean + deviation @ np.random.default_rng(2).normal(size=inner.shape[1])
    right = np.asarray(light(m, jnp.asarray(area), c))
    found = np.asarray(expansion(m, jnp.asarray(area), c))
    assert np.abs(right - light(jnp.asarray(CENTRE), mean, LAMBERT)).max() > 1.0
    np.testing.assert_allclose(found, right, rtol=0.0, atol=3e-5 * np.abs(right).max())


def test_few_normals_have_fewer_harmonics(known):
    light, _, mean = known
    few = facets.grid(40)
    n = len(few)

    def part(motion, area, lambert):
        return light(motion, jnp.concatenate([area, jnp.zeros(N - n)]), lambert)

    at = (jnp.asarray(CENTRE), jnp.asarray(mean[:n]), jnp.asarray(LAMBERT))
    likely = jax.tree.map(lambda x: jnp.stack([x, 1.1 * x]), at)
    expansion = Expansion.of(part, at, likely, jnp.asarray(WIDTHS), jnp.eye(3), few)
    assert expansion.harmonics.shape == (n, 16)
    np.testing.assert_allclose(expansion(*at), part(*at), rtol=1e-9)


@pytest.fixture(scope="module")
def asteroid():
    """An ellipsoid's posterior, an optimum, draws about it, and the epochs of the guide."""
    data = Epochs.of(observed())
    options = SMALL | {"n_facets": 300, "n_quadrature": 400, "degree": 4}
    model = partial(convex_grid.model, **options)
    problem = Problem(model, data, convex_grid.coordinates(data, **options))
    starts = convex_grid.starts(data, jax.random.key(0), **options)
    near = starts[7] | {"pole_base": jnp.asarray([[0.383, 0.663, 0.643]])}
    plain = Problem(model, data)
    row = np.asarray(plain.ravel(near | {"period_shift": jnp.array(0.0)}))
    end = search.polish(plain, data, row[None], 1)
    z = np.asarray(problem.ravel(plain.constrain(jnp.asarray(end.z[0]), data)))
    root = np.linalg.cholesky(np.asarray(compiled(problem.fisher)(z, data)))
    unit = np.random.default_rng(3).normal(size=(40, z.size))
    draws = z + np.linalg.solve(root.T, unit.T).T
    assert convex_grid.guide(problem, data, **options) is None  # few points
    return problem, data, draws, guide(problem, data, options)(z)


def guide(problem, data, options):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(convex_grid, "MANY", 0)
        about = convex_grid.guide(problem, data, **options)
    assert about is not None
    return about


def errors(problem, data, draws, about) -> np.ndarray:
    value = compiled(problem.potential)
    found = [float(value(x, about)) - float(value(x, data)) for x in draws]
    return np.array([x for x in found if np.isfinite(x)])


def test_the_density_of_an_asteroid_is_nearly_that_of_its_guide(asteroid):
    problem, data, draws, about = asteroid
    found = errors(problem, data, draws, about)
    assert len(found) > 30
    assert found.std() < 0.3
    assert np.abs(found).max() < 1.5
    # Where the coordinates of the areas are inverted from does not.
    cold = replace(about, expansion=about.expansion._replace(start=None))
    np.testing.assert_allclose(errors(problem, data, draws, cold), found, rtol=0.0, atol=1e-6)
    # Both terms matter for the draws of this posterior.
    parts = about.expansion
    for name, missing in (
        ("response", parts.response.at[:].set(0.0)),
        ("cubic", parts.cubic.at[1:].set(0.0)),
    ):
        without = replace(about, expansion=parts._replace(**{name: missing}))
        assert errors(problem, data, draws, without).std() > 1.5 * found.std(), name


def test_a_guide_is_that_of_calibrated_curves_and_exposures():
    """Size and phase law are outside the expansion, and exposures inside."""
    curve = observed(free_scale=False)
    data = Epochs.of(replace(curve, exposure_s=np.full(curve.n_obs, 900.0)))
    options = SMALL | {"n_quadrature": 600}
    problem = Problem(partial(convex_grid.model, **options), data)
    sites = convex_grid.starts(data, jax.random.key(0), **options)[7]
    z = problem.ravel(sites | {"coefficients": 0.2 * jnp.ones(15)})
    about = guide(problem, data, options)(z)
    exact, guided = (np.asarray(problem.flux_at(z, x)) for x in (data, about))
    np.testing.assert_allclose(guided, exact, rtol=2e-3)
    larger = problem.ravel(problem.constrain(z, data) | {"log_sphere_flux": jnp.array(3.0)})
    exact, guided = (np.asarray(problem.flux_at(larger, x)) for x in (data, about))
    np.testing.assert_allclose(guided, exact, rtol=2e-3)
