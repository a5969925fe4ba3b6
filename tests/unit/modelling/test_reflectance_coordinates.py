"""Coordinates of the size and the reflectances of a body."""

from __future__ import annotations

import numpy as np
import numpyro.distributions as dist
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import compiled
from lcbayes.modelling.reflectance_coordinates import Reflectance, ReflectanceCoordinates
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


def bodies(reflectances, constant, seed=0, count=40):
    """Sites of random bodies."""
    rng = np.random.default_rng(seed)
    y = []
    for one in reflectances:
        values = rng.uniform(one.low, one.high, count) if one.bounded else rng.normal(size=count)
        y.append(values)
    return np.stack([*([] if constant is None else [rng.normal(size=count)]), *y], axis=1)


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
    made = ReflectanceCoordinates(reflectances, constant)
    for y in bodies(reflectances, constant):
        x = jnp.asarray(made.inv(jnp.asarray(y)))
        np.testing.assert_allclose(made(x), y, rtol=1e-12, atol=1e-12)
        again = made.inv(jnp.asarray(made(x)))
        np.testing.assert_allclose(again, x, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("reflectances", "constant"), CASES)
def test_jacobian_is_that_of_differences(reflectances, constant):
    made, step = ReflectanceCoordinates(reflectances, constant), 1e-6
    call = jax.jit(made)
    for y in bodies(reflectances, constant, seed=1):
        x = jnp.asarray(made.inv(jnp.asarray(y)))
        shifts = step * np.eye(x.size)
        slopes = [(np.asarray(call(x + d)) - np.asarray(call(x - d))) / (2 * step) for d in shifts]
        expected = np.linalg.slogdet(np.array(slopes))[1]
        assert made.log_abs_det_jacobian(x, call(x)) == pytest.approx(expected, abs=1e-5)


def test_ridge_is_straight_but_near_its_ends():
    """x₀ + δ and all x_j − δ leave κ ρ_j (1 − r) as it is, where ρ_j is well inside its range.

    Half-way, five times the softness from both ends, dy/dx = 1 − 2 e⁻⁵ = 0.987.
    """
    made = ReflectanceCoordinates(LAYERED, 0.3)
    rho, y = np.array([0.1, 0.17, 0.26, 0.045, 0.26]), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    y[1:] = rho
    x, products = np.asarray(made.inv(jnp.asarray(y))), []
    for step in (-0.1, 0.0, 0.1):
        moved = x + np.array([step, *[-step] * 5])
        found, size = read(LAYERED, 0.3, np.asarray(made(jnp.asarray(moved))))
        passed = [1.0 if one.above is None else 1.0 - found[one.above] for one in LAYERED]
        products.append(np.log(found * passed) + size)
        assert size == pytest.approx(x[0] + step, abs=0.02)
    np.testing.assert_allclose(products[0], products[1], atol=0.02 * 0.1)
    np.testing.assert_allclose(products[2], products[1], atol=0.02 * 0.1)


@pytest.mark.parametrize(("reflectances", "constant"), CASES)
def test_every_reflectance_is_inside_its_range(reflectances, constant):
    made = ReflectanceCoordinates(reflectances, constant)
    low, high = (np.array([one[i] for one in reflectances]) for i in (0, 1))
    size = len(reflectances) + (constant is not None)
    for x in 10.0 * np.random.default_rng(2).standard_normal((40, size)):
        rho, _ = read(reflectances, constant, np.asarray(made(x)))
        assert np.all((rho >= low * (1.0 - 1e-12)) & (rho <= high * (1.0 + 1e-12)))


def test_ridge_is_straight_at_the_upper_end_of_a_range():
    """There as well, x₀ + x_j = ln κ ρ_j, up to the bend at the lower end, 0.3 e^(−ln 6.7/0.3)."""
    high = Reflectance(0.05, 0.95, 9.0), Reflectance(0.05, 0.95, 3.0)
    made, x, low = ReflectanceCoordinates(high, 0.3), np.array([0.4, -1.1, -0.4]), []
    for step in np.linspace(-1.5, 0.0, 16):
        rho, size = read(high, 0.3, np.asarray(made(jnp.asarray(x + step * np.array([1, -1, -1])))))
        np.testing.assert_allclose(size + np.log(rho), [-0.7, 0.0], atol=1e-3)
        low.append(rho[1])
    assert low[0] > 0.94
    assert low[-1] < 0.7


def test_a_reflectance_is_independent_of_the_others():
    """That of a surface that is not seen, where the others are below the ends of their ranges."""
    made = ReflectanceCoordinates(UNIFORM, 0.3)
    x = np.array([0.2, -1.4, -3.0, -1.5])
    slopes = np.asarray(jax.jacfwd(made)(jnp.asarray(x)))
    across = slopes[1:, 1:] / np.diagonal(slopes)[1:, None]
    assert np.abs(across - np.eye(3)).max() < 0.02
    assert np.all(slopes[1:, 0] == 0.0)


@pytest.mark.statistical(false_alarm=1e-5)
def test_precision_is_that_of_the_priors():
    """Within a third of the inverse variance of x over uniform reflectances."""
    made, rng = ReflectanceCoordinates(UNIFORM, 0.3), np.random.default_rng(6)
    low, high = (np.array([one[i] for one in UNIFORM]) for i in (0, 1))
    y = np.concatenate([np.zeros((2000, 1)), rng.uniform(low, high, (2000, 3))], axis=1)
    variance = np.asarray(jax.vmap(made.inv)(jnp.asarray(y)))[:, 1:].var(axis=0)
    precision = np.diagonal(np.asarray(made.precision(jnp.zeros(4))))
    assert precision[0] == 0.0
    assert np.all(np.abs(np.log(precision[1:] * variance)) < 1.0)


def test_all_bodies_are_reached():
    """Uniform reflectances and any size have their coordinates."""
    made, rng = ReflectanceCoordinates(LAYERED, 0.3), np.random.default_rng(5)
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
