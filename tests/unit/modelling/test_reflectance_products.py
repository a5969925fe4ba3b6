"""Products of size and reflectances as coordinates."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpyro.distributions as dist
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import compiled
from lcbayes.modelling.reflectance_products import Reflectance, ReflectanceProducts
from tests.helpers.small_curves import curve

UNIFORM = (Reflectance(0.1, 0.7, 9.0), Reflectance(0.01, 0.2, 7.0), Reflectance(0.05, 0.9, 3.0))
MIXED = (Reflectance(0.0, np.inf, 2.0), *UNIFORM, Reflectance(0.0, 0.6, 4.0))
LAYERED = (
    Reflectance(0.02, 0.5, 9.0),
    Reflectance(0.05, 0.6, 7.0),
    Reflectance(0.1, 0.7, 9.0, 0),
    Reflectance(0.01, 0.2, 7.0, 1),
    Reflectance(0.1, 0.7, 7.0),
)
PLATE = {"body": "plate", "spin": "free"}
CASES = [
    (LAYERED, 0.0),
    (LAYERED, None),
    (UNIFORM, 0.3),
    (UNIFORM, None),
    (MIXED, 0.0001),
    (MIXED, None),
    (MIXED[:1], 2.0),
]


def points(reflectances, constant, seed=0, count=40):
    size = len(reflectances) + (constant is not None)
    return 1.5 * np.random.default_rng(seed).standard_normal((count, size))


def read(reflectances, constant, y):
    """Reflectances, and ln κ."""
    bounded = np.isfinite([one.high for one in reflectances])
    sites = y if constant is None else y[1:]
    rho = np.where(bounded, sites, np.exp(sites))
    if constant is None:
        return rho, -np.log(rho[0])
    return rho, y[0] - np.log(
        constant + sum(r * one.area for r, one in zip(rho, reflectances, strict=True))
    )


@pytest.mark.parametrize(("reflectances", "constant"), CASES)
def test_points_lead_there_and_back(reflectances, constant):
    made = ReflectanceProducts(reflectances, constant)
    for x in points(reflectances, constant):
        np.testing.assert_allclose(made.inv(made(x)), x, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("reflectances", "constant"), CASES)
def test_jacobian_is_that_of_differences(reflectances, constant):
    made, step = ReflectanceProducts(reflectances, constant), 1e-6
    call = jax.jit(made)
    for x in points(reflectances, constant, seed=1):
        shifts = step * np.eye(x.size)
        slopes = [(np.asarray(call(x + d)) - np.asarray(call(x - d))) / (2 * step) for d in shifts]
        expected = np.linalg.slogdet(np.array(slopes))[1]
        assert made.log_abs_det_jacobian(x, call(x)) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize(("reflectances", "constant"), CASES)
def test_ridge_is_straight(reflectances, constant):
    """Along the first coordinate the products stay, and every reflectance is inside its range."""
    made = ReflectanceProducts(reflectances, constant)
    for x in points(reflectances, constant, seed=2, count=5):
        every = []
        for first in np.linspace(-4.0, 4.0, 9):
            rho, size = read(reflectances, constant, np.asarray(made(jnp.append(first, x[1:]))))
            low, high = (np.array([one[i] for one in reflectances]) for i in (0, 1))
            assert np.all((rho >= low) & (rho <= high))
            passed = [1.0 if one.above is None else 1.0 - rho[one.above] for one in reflectances]
            every.append((np.log(rho * passed) + size, size))
        for (products, size), (others, larger) in pairwise(every):
            np.testing.assert_allclose(others, products, atol=1e-10)
            assert larger > size


def test_all_bodies_are_reached():
    """Uniform reflectances and any size have their coordinates."""
    made, rng = ReflectanceProducts(LAYERED, 0.3), np.random.default_rng(5)
    low, high = (np.array([one[i] for one in LAYERED]) for i in (0, 1))
    for _ in range(200):
        rho = rng.uniform(low, high)
        y = np.append(rng.normal(0.0, 3.0), rho)
        x = jnp.asarray(made.inv(y))
        assert np.all(np.isfinite(x))
        np.testing.assert_allclose(made(x), y, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("free", [False, True])
def test_density_of_the_model_differs_by_the_jacobian(free):
    """From NumPyro's coordinates to these, by differences."""
    entry, data = registry.find("body"), Epochs.of(curve(12, free_scale=np.array([free])))
    plain, other = build_problem(entry, entry.check(PLATE), data)
    across = jax.jit(lambda z: other.ravel(plain.constrain(z, data)))
    for seed in range(3):
        z = np.asarray(plain.prior_draw(jax.random.key(seed), data))
        shifts = 1e-6 * np.eye(z.size)
        slopes = np.array([(across(z + d) - across(z - d)) / 2e-6 for d in shifts])
        expected = float(compiled(plain.potential)(z, data)) + np.linalg.slogdet(slopes)[1]
        assert compiled(other.potential)(across(z), data) == pytest.approx(expected, abs=1e-4)


def test_replaced_priors_keep_their_own_coordinates():
    entry, data = registry.find("body"), Epochs.of(curve(12, free_scale=np.array([False])))
    wide = entry.with_priors({"front_r_diff": dist.Beta(2.0, 5.0)})
    _, other = build_problem(wide, entry.check(PLATE), data)
    z = np.zeros(other.dim)
    z[other.rows(["front_r_diff"])] = 5.0  # outside the range of the body's file
    assert compiled(other.constrain)(z, data)["front_r_diff"] > 0.9
