"""Levenberg-Marquardt against SciPy, in both loops, and its stopping rules."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import (
    NIELSEN,
    Controls,
    Quadratic,
    gauss_newton,
    levenberg_marquardt,
    of_residuals,
)

STARTS = np.array([[-1.2, 1.0], [0.3, -2.0], [3.0, 3.0]])
OFFSET = np.array([0.3, -0.2, 0.5])


def residuals(p, offset):
    """Rosenbrock's function with a third residual, so that the minimum is not zero."""
    return jnp.stack([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0], p[0] * p[1]]) + offset


def host_model(p) -> Quadratic:
    r = np.array([10.0 * (p[1] - p[0] ** 2), 1.0 - p[0], p[0] * p[1]]) + OFFSET
    return gauss_newton(r, np.array([[-20.0 * p[0], 10.0], [-1.0, 0.0], [p[1], p[0]]]), aux=r)


def compiled(starts, **options):
    model = of_residuals(residuals, jnp.asarray(OFFSET))
    return jax.jit(jax.vmap(lambda p: levenberg_marquardt(model, p, **options)))(
        jnp.asarray(starts)
    )


@pytest.mark.parametrize("controls", [Controls(), NIELSEN])
def test_reaches_the_minimum_of_scipy(controls):
    ends = compiled(STARTS, num_steps=500, tolerance=1e-16, controls=controls)
    for i, start in enumerate(STARTS):
        best = least_squares(lambda p: np.asarray(residuals(p, OFFSET)), start, xtol=1e-12)
        np.testing.assert_allclose(ends.model.value[i], best.cost, rtol=1e-8)
        np.testing.assert_allclose(ends.position[i], best.x, atol=1e-4)
        np.testing.assert_allclose(ends.model.gradient[i], 0.0, atol=1e-4)


@pytest.mark.parametrize("controls", [Controls(), NIELSEN])
def test_python_loop_takes_the_steps_of_the_compiled_loop(controls):
    options = {"num_steps": 12, "tolerance": 0.0, "damping": 0.1, "controls": controls}
    ends = compiled(STARTS, **options)
    for i, start in enumerate(STARTS):
        end = levenberg_marquardt(host_model, start, **options)
        np.testing.assert_allclose(end.position, ends.position[i], rtol=1e-9)
        np.testing.assert_allclose(end.damping, ends.damping[i], rtol=1e-6)
        np.testing.assert_allclose(end.model.aux @ end.model.aux, 2.0 * end.model.value)
        assert (end.steps, end.stalled) == (ends.steps[i], ends.stalled[i])


def test_ends_after_a_number_of_steps_with_small_gain():
    options = {"num_steps": 100, "tolerance": 1e-3}
    one = compiled(STARTS, **options, controls=Controls(patience=1))
    three = compiled(STARTS, **options, controls=Controls(patience=3))
    assert np.all(one.stalled == 1)
    assert np.all(three.stalled == 3)
    assert np.all(three.steps >= one.steps + 2)
    assert np.all(three.model.value <= one.model.value)
    later = compiled(STARTS, **options, stalled=3)
    np.testing.assert_array_equal(later.position, STARTS)
    assert np.all(later.steps == 0)
    assert np.all(np.isfinite(later.model.value))


def test_a_start_without_a_finite_value_does_not_move():
    starts = STARTS.copy()
    starts[1] = np.nan
    ends = compiled(starts, num_steps=200, tolerance=1e-9)
    assert np.isinf(ends.model.value[1])
    assert np.all(np.isfinite(ends.model.value[::2]))
    assert np.all(np.isnan(ends.position[1]))


def test_a_parameter_without_effect_does_not_move():
    model = of_residuals(lambda p: jnp.stack([p[0] - 1.0, p[0] + p[2]]))
    end = levenberg_marquardt(
        model, jnp.asarray([0.0, 5.0, 2.0]), num_steps=60, tolerance=1e-30, damping=1e-3
    )
    np.testing.assert_allclose(end.position, [1.0, 5.0, -1.0], atol=1e-7)


def test_position_may_be_of_any_type():
    """A rotation in the plane, whose step is an angle: nearest to a given direction."""
    target = jnp.asarray([0.6, 0.8])

    def model(u):
        return gauss_newton(u - target, jnp.stack([-u[1], u[0]])[:, None])

    def turned(u, step):
        cos, sin = jnp.cos(step[0]), jnp.sin(step[0])
        return jnp.stack([cos * u[0] - sin * u[1], sin * u[0] + cos * u[1]])

    end = levenberg_marquardt(
        model, jnp.asarray([1.0, 0.0]), num_steps=50, tolerance=1e-20, move=turned
    )
    np.testing.assert_allclose(end.position, target, atol=1e-7)
