"""Attitude laws against scipy's rotations and against their differential equations."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.laws import ConstantRate, Ephemeris, PrincipalAxis, Tabulated


def cross_matrix(w):
    x, y, z = w
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


@pytest.mark.parametrize(
    "omega", [(0.1, 0.0, 0.02), (-3.0, 2.0, 5.0), (1e-7, -2e-7, 1e-7), (0.0, 0.0, 0.0)]
)
def test_constant_rate_is_the_rotation_vector_omega_t(omega):
    t = np.array([-50.0, 0.0, 1e-3, 1.0, 100.0, 4000.0])
    result = rotations.constant_rate(jnp.asarray(t), jnp.asarray(omega))
    expected = Rotation.from_rotvec(t[:, None] * np.array(omega)).as_matrix()
    np.testing.assert_allclose(result, expected, atol=2e-12)


@pytest.mark.parametrize("omega", [(0.1, 0.0, 0.02), (-3.0, 2.0, 5.0), (1e-6, 2e-6, 0.0)])
def test_constant_rate_obeys_its_kinematics(omega):
    """Ȧ = [ω×]A, A(0) = I."""

    def at(t):
        return rotations.constant_rate(t[None], jnp.asarray(omega))[0]

    np.testing.assert_array_equal(at(jnp.float64(0.0)), np.eye(3))
    for t in (0.0, 0.3, 7.0, -20.0):
        rate = jax.jacfwd(at)(jnp.float64(t))
        np.testing.assert_allclose(rate, cross_matrix(omega) @ at(jnp.float64(t)), atol=1e-12)


@cache
def carried():
    """Vectors in the turning body by ours and by matrices, with derivatives, each compiled once."""
    t = jnp.array([-50.0, 0.0, 1e-3, 1.0, 100.0])
    sun, obs = np.random.default_rng(0).normal(size=(2, 5, 3))

    def directly(w):
        return jnp.stack(rotations.constant_rate_to_body(t, w, sun, obs))

    def by_matrices(w):
        turn = rotations.constant_rate(t, w)
        return jnp.stack([rotations.to_body(turn, jnp.asarray(v)) for v in (sun, obs)])

    kinds = (lambda f: f, jax.jacfwd, jax.jacrev, jax.hessian)
    return [(jax.jit(kind(directly)), jax.jit(kind(by_matrices))) for kind in kinds]


@pytest.mark.parametrize(
    "omega", [(0.1, 0.0, 0.02), (-3.0, 2.0, 5.0), (3e-5, -2e-5, 1e-5), (0.0, 0.0, 0.0)]
)
def test_vectors_are_carried_into_the_turning_body_with_their_derivatives(omega):
    """Against the rotation matrices, whose derivatives are automatic, both ways and twice."""
    w = jnp.asarray(omega)
    (directly, by_matrices), *derivatives = carried()
    np.testing.assert_allclose(directly(w), by_matrices(w), atol=1e-13)
    for result, expected in derivatives:
        want = expected(w)
        np.testing.assert_allclose(result(w), want, atol=1e-9 * float(np.abs(want).max()))


@pytest.mark.parametrize("kind", [jax.jacfwd, jax.jacrev])
def test_vectors_depend_on_time_and_on_their_inertial_components(kind):
    w = jnp.array([0.3, -0.1, 0.2])
    t = jnp.array([-5.0, 0.0, 1e-3, 20.0])
    vectors = jnp.asarray(np.random.default_rng(1).normal(size=(4, 3)))

    def directly(t, v, w):
        return rotations.constant_rate_to_body(t, w, v)[0]

    def by_matrices(t, v, w):
        return rotations.to_body(rotations.constant_rate(t, w), v)

    for k in range(3):
        result, want = (kind(f, argnums=k)(t, vectors, w) for f in (directly, by_matrices))
        np.testing.assert_allclose(result, want, atol=1e-12)


def test_constant_rate_is_smooth_at_rest_and_across_the_series():
    t = jnp.array([0.0, 1.0, 40.0])

    def entries(w):
        return rotations.constant_rate(t, w)

    at_rest = jax.jacrev(entries)(jnp.zeros(3))  # dA/dω_k = t [e_k×]
    expected = np.stack(
        [[tt * cross_matrix(e) for e in np.eye(3)] for tt in np.asarray(t)]
    ).transpose(0, 2, 3, 1)
    np.testing.assert_allclose(at_rest, expected, atol=1e-14)
    for size in (0.99e-4, 1.01e-4, 1.0):  # either side of where the series ends
        w = size * jnp.array([0.6, 0.0, 0.8])

        def after_a_second(w):
            return rotations.constant_rate(jnp.ones(1), w)

        steps = 1e-6 * jnp.eye(3)
        numeric = [(after_a_second(w + e) - after_a_second(w - e)) / 2e-6 for e in steps]
        exact = jax.jacfwd(after_a_second)(w)
        np.testing.assert_allclose(exact, np.stack(numeric, axis=-1), atol=2e-9)


def test_principal_axis_is_the_three_rotations():
    t = np.linspace(-1e5, 1e5, 11)
    lon, lat, period, phase0 = 1.2, -0.4, 20_744.0, 0.7
    result = rotations.principal_axis(jnp.asarray(t), lon, lat, period, phase0)
    expected = (
        Rotation.from_euler("z", lon)
        * Rotation.from_euler("y", np.pi / 2 - lat)
        * Rotation.from_rotvec(
            (phase0 + 2 * np.pi * t / period)[:, None] * np.array([0.0, 0.0, 1.0])
        )
    ).as_matrix()
    np.testing.assert_allclose(result, expected, atol=1e-12)
    pole = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    np.testing.assert_allclose(result[:, :, 2], np.tile(pole, (11, 1)), atol=1e-15)


def test_axes_are_brought_to_the_pole_by_the_least_turn():
    """Beside scipy's turn about x cross pole; z, the pole, and smooth at celestial poles."""
    rng = np.random.default_rng(8)
    poles = rng.normal(size=(20, 3))
    poles = np.concatenate([poles, np.eye(3), -np.eye(3)[1:]])
    poles /= np.linalg.norm(poles, axis=1, keepdims=True)
    for pole in poles:
        about = np.cross([1.0, 0.0, 0.0], pole)
        size = np.linalg.norm(about)
        angle = np.arctan2(size, pole[0])
        least = Rotation.from_rotvec(about * (angle / size if size else 0.0)).as_matrix()
        result = np.asarray(rotations.brought_to(jnp.asarray(pole)))
        np.testing.assert_allclose(result, least @ np.eye(3)[:, [1, 2, 0]], atol=1e-12)
        np.testing.assert_allclose(result[:, 2], pole, atol=1e-15)
    for pole in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]):
        slope = jax.jacfwd(rotations.brought_to)(jnp.asarray(pole))
        assert np.max(np.abs(slope)) < 3.0


def test_principal_axis_spins_about_its_pole():
    lon, lat, period = 0.3, 0.9, 30.0

    def at(t):
        return rotations.principal_axis(t[None], lon, lat, period, 0.1)[0]

    pole = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    t = jnp.float64(12.3)
    expected = cross_matrix(2 * np.pi / period * pole) @ at(t)
    np.testing.assert_allclose(jax.jacfwd(at)(t), expected, atol=1e-13)


def test_principal_axis_keeps_its_phase_over_decades():
    """25 years of a 5.76 h period: 4·10⁴ turns; the phase stays exact to 1e-10."""
    period = 5.761980 * 3600.0
    turns = 38_000
    late = rotations.principal_axis(jnp.array([turns * period]), 1.0, 0.2, period, 0.0)
    first = rotations.principal_axis(jnp.array([0.0]), 1.0, 0.2, period, 0.0)
    np.testing.assert_allclose(late, first, atol=1e-10)
    slope = jax.grad(
        lambda p: rotations.principal_axis(jnp.array([turns * period]), 1.0, 0.2, p, 0.0)[0, 2, 0]
    )(period)
    # d(phase)/dP = −2πt/P²; R_zx = −cos β cos(phase): at whole turns its slope is 0 to first order
    assert abs(slope) < 1e-9
    slope = jax.grad(
        lambda p: rotations.principal_axis(jnp.array([turns * period]), 1.0, 0.2, p, 0.0)[0, 2, 1]
    )(period)
    assert slope == pytest.approx(-np.cos(0.2) * 2 * np.pi * turns / period, rel=1e-9)


def test_to_body_undoes_the_attitude_and_fixed_does_nothing():
    rng = np.random.default_rng(2)
    t, v = jnp.linspace(0, 9, 7), jnp.asarray(rng.normal(size=(7, 3)))
    a = rotations.constant_rate(t, jnp.array([0.3, -0.2, 0.9]))
    there = jnp.einsum("tij,tj->ti", a, v)
    np.testing.assert_allclose(rotations.to_body(a, there), v, atol=1e-14)
    np.testing.assert_array_equal(rotations.to_body(rotations.fixed(t), v), v)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PrincipalAxis(1.0, 91.0, 2.0), "-90 to 90"),
        (lambda: PrincipalAxis(1.0, 1.0, 0.0), "period_s is 0"),
        (lambda: PrincipalAxis(1.0, 1.0, float("nan")), "finite"),
        (lambda: ConstantRate((0.0, float("inf"), 0.0)), "finite"),
    ],
)
def test_laws_of_impossible_numbers(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_the_phase_of_a_spin_is_that_at_its_epoch():
    t = jnp.array([0.0, 30.0])
    at = Ephemeris(t, jnp.zeros((2, 3)))
    spin = PrincipalAxis(40.0, -30.0, 120.0, 15.0, t0_s=30.0)
    first = PrincipalAxis(40.0, -30.0, 120.0, 15.0)
    np.testing.assert_array_equal(spin.frames(at).body[1], first.frames(at).body[0])
    assert "t0_s" not in first.settings()
    assert spin.settings()["t0_s"] == 30.0


def test_a_tabulated_attitude_is_given_back():
    axes = np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0])])
    law = Tabulated(axes)
    np.testing.assert_array_equal(law.frames(Ephemeris(jnp.zeros(2), jnp.zeros((2, 3)))).body, axes)
    assert law.settings() == {"axes": axes.tolist()}
