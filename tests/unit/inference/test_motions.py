"""Attitudes agree with integrated equations of motion, and equal motions are recognised."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jnp
from lcbayes.inference.motions import SAME_ATTITUDE, attitudes, motion, same_motion
from lcbayes.modelling.priors import inertia_tensor
from tests.helpers import small_curves

T = np.linspace(0.0, 60.0, 20)
OMEGA = np.array([0.06, -0.05, 0.08])


def integrated(omega: np.ndarray, tensor: np.ndarray, origin: float = 0.0) -> np.ndarray:
    """Attitudes (T, 3, 3) from Euler's equations; body axes are inertial at the origin."""

    def slope(t, y):  # noqa: ARG001
        w, turn = y[:3], y[3:].reshape(3, 3)
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        change = np.linalg.solve(tensor, -np.cross(w, tensor @ w))
        return np.concatenate([change, (-cross @ turn).ravel()])

    start = np.concatenate([omega, np.eye(3).ravel()])
    found = np.empty((T.size, 3, 3))
    for rows, end in ((origin > T, 0.0), (origin <= T, T[-1])):
        if rows.any():
            path = solve_ivp(slope, (origin, end), start, dense_output=True, rtol=1e-11, atol=1e-12)
            found[rows] = path.sol(T[rows])[3:].T.reshape(-1, 3, 3)
    return found


@pytest.mark.parametrize("spin", ["free", "torque-free"])
def test_attitudes_are_those_of_the_equations_of_motion(spin):
    curve = small_curves.curve(20, spinning=True)
    problem, data = small_curves.posterior(curve, n_facets=1, spin=spin, omega_sd=0.1)
    z = np.random.default_rng(4).standard_normal(problem.dim)
    z[problem.rows(["omega_unit"])] = OMEGA / 0.1
    tensor, origin = np.eye(3), 0.0
    if spin == "torque-free":
        origin = 0.5 * T[-1]
        free = jnp.asarray(z[problem.rows(["inertia_base"])])
        tensor = np.asarray(inertia_tensor(free, 1.0)[0])
    found = attitudes(problem, data, z)
    np.testing.assert_allclose(found, integrated(OMEGA, tensor, origin), atol=1e-7)
    np.testing.assert_allclose(motion(problem, data, z), found, atol=1e-12)  # evenly spaced data


def turned(rate: float, axis: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(-T[:, None] * rate * axis).as_matrix()


def test_motions_that_differ_by_their_body_axes_are_the_same():
    one = integrated(OMEGA, np.diag([1.0, 1.5, 2.0]))
    axes = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
    assert same_motion(one, axes @ one)
    assert not same_motion(one, one @ axes)  # other inertial axes are another motion


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_constant_rates_are_the_same_within_a_phase_at_the_ends(share):
    pole = np.array([0.0, 0.6, 0.8])
    change = 2.0 * SAME_ATTITUDE * share / T[-1]
    assert same_motion(turned(0.3, pole), turned(0.3 + change, pole)) == (share < 1.0)


def test_a_tumbler_is_not_a_spin_with_its_angular_velocity():
    tumbling = integrated(OMEGA, np.diag([1.0, 1.5, 2.0]))
    assert not same_motion(tumbling, integrated(OMEGA, np.eye(3)))
