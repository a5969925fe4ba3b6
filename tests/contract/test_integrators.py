"""Every integrator keeps its contract: reversible, volume-preserving, of second order in energy."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import integrators, metric
from lcbayes.samplers.kernels.trajectory import Dynamics, Point

DIM = 3
SHAPE = jnp.array([[2.0, 0.6, -0.3], [0.6, 1.0, 0.2], [-0.3, 0.2, 0.7]])


def potential(z):
    """Neither quadratic nor separable."""
    return 0.5 * z @ SHAPE @ z + 0.1 * jnp.sum(z**4) + 0.3 * jnp.sin(z[0] * z[1]) + 0.2 * z[2]


def mass(z):
    """Positive definite everywhere, and nowhere constant."""
    tilt = jnp.array([1.0, 0.4, -0.2]) * jnp.sin(z) + jnp.array([0.2, 0.1, 0.3])
    return SHAPE + jnp.outer(tilt, tilt) + jnp.diag(0.3 * z**2)


value_and_grad = jax.value_and_grad(potential)


class Contract(ABC):
    """What every integrator promises; a subclass brings its own tolerances."""

    reversal: ClassVar[float]
    volume: ClassVar[float]
    step_size: ClassVar[float] = 0.15

    @abstractmethod
    def dynamics(self) -> Dynamics: ...

    @abstractmethod
    def point(self, z: jax.Array, v: jax.Array) -> Point: ...

    @pytest.fixture
    def start(self) -> Point:
        rng = np.random.default_rng(5)
        return self.point(*(jnp.asarray(x) for x in 0.7 * rng.standard_normal((2, DIM))))

    def flow(self, point: Point, step_size: float, n: int) -> Point:
        return _flow(type(self))(point, step_size, n)

    def test_it_moves(self, start):
        end = self.flow(start, self.step_size, 5)
        assert bool(end.solved)
        assert jnp.linalg.norm(end.z - start.z) > 0.2

    def test_reversible(self, start):
        """With the momentum turned round, the same steps lead back."""
        end = self.flow(start, self.step_size, 5)
        back = self.flow(self.point(end.z, -end.v), self.step_size, 5)
        np.testing.assert_allclose(back.z, start.z, atol=self.reversal, rtol=0)
        np.testing.assert_allclose(-back.v, start.v, atol=self.reversal, rtol=0)

    def test_volume_preserving(self, start):
        """|det ∂(z′, v′)/∂(z, v)| = 1, by central differences through two steps."""
        h = 1e-4

        def flow(x):
            end = self.flow(self.point(x[:DIM], x[DIM:]), self.step_size, 2)
            return np.concatenate([end.z, end.v])

        x = jnp.concatenate([start.z, start.v])
        basis = jnp.eye(2 * DIM)
        jacobian = np.stack([(flow(x + h * e) - flow(x - h * e)) / (2 * h) for e in basis], axis=1)
        assert abs(jacobian - np.eye(2 * DIM)).max() > 0.1  # the map is far from the identity
        assert abs(np.linalg.det(jacobian)) == pytest.approx(1.0, abs=self.volume)

    def test_energy_error_is_of_second_order(self, start):
        """Over the same time, half the step size leaves a quarter of the energy error."""
        energy = self.dynamics().energy
        before = energy(start)
        ends = [self.flow(start, 0.6 / n, n) for n in (8, 16, 32, 64)]
        errors = [abs(float(energy(end) - before)) for end in ends]
        order = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
        assert errors[0] > 1e-6
        np.testing.assert_allclose(order, 2.0, atol=0.2)


@functools.cache
def _flow(contract: type[Contract]):
    """n steps of a contract's integrator, compiled once."""
    step = contract().dynamics().step

    def flow(point, step_size, n):
        return jax.lax.fori_loop(0, n, lambda _, x: step(x, step_size), point)

    return jax.jit(flow)


class TestLeapfrog(Contract):
    reversal, volume = 1e-12, 1e-6
    root = metric.inverse_root(SHAPE, SHAPE)[0]

    def dynamics(self):
        return Dynamics(
            integrators.leapfrog(value_and_grad, self.root),
            lambda p: p.potential + metric.kinetic(p.v),
        )

    def point(self, z, v):
        return Point(z, v, *value_and_grad(z), jnp.array(True))


class TestLeapfrogWithSpring(TestLeapfrog):
    """The move of the exact AHMC: a spring to a point that is held."""

    centre = jnp.array([0.5, -0.2, 0.1])
    spring = 4.0 * jnp.linalg.inv(SHAPE)

    def dynamics(self):
        def energy(p):
            away = p.z - self.centre
            return p.potential + 0.5 * away @ self.spring @ away + metric.kinetic(p.v)

        return Dynamics(
            integrators.leapfrog(value_and_grad, self.root, self.centre, self.spring), energy
        )


class TestGeneralisedLeapfrog(Contract):
    reversal, volume = 1e-7, 1e-5
    manifold = integrators.Manifold(mass, SHAPE)

    def dynamics(self):
        return Dynamics(
            integrators.generalised_leapfrog(value_and_grad, self.manifold), self.manifold.energy
        )

    def point(self, z, v):
        here = self.manifold.at(z, jnp.array(0))
        return Point(z, v, *value_and_grad(z), jnp.array(True), here)

    def test_constant_metric_is_leapfrog(self, start):
        """With a metric that does not move, both integrators take the same step."""
        manifold = integrators.Manifold(lambda z: SHAPE + 0.0 * z[0], SHAPE)
        here = manifold.at(start.z, jnp.array(0))
        implicit = integrators.generalised_leapfrog(value_and_grad, manifold)(
            start._replace(extra=here), jnp.asarray(0.2)
        )
        explicit = integrators.leapfrog(value_and_grad, here.root)(
            start._replace(v=here.root.T @ start.v), jnp.asarray(0.2)
        )
        np.testing.assert_allclose(implicit.z, explicit.z, atol=1e-8)
        np.testing.assert_allclose(here.root.T @ implicit.v, explicit.v, atol=1e-8)

    def test_energy_is_the_one_it_differentiates(self, start):
        """∂H/∂z of the definition, against the change the kick makes to first order."""

        def hamiltonian(z, p):
            m = mass(z)
            kinetic = 0.5 * p @ jnp.linalg.solve(m, p) + 0.5 * jnp.linalg.slogdet(m)[1]
            return potential(z) + kinetic

        assert float(self.dynamics().energy(start)) == pytest.approx(
            float(hamiltonian(start.z, start.v)), rel=1e-12
        )
        tiny = 1e-6
        end = self.flow(start, tiny, 1)
        dz, dp = jax.grad(hamiltonian, argnums=(0, 1))(start.z, start.v)
        np.testing.assert_allclose((end.z - start.z) / tiny, dp, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose((end.v - start.v) / tiny, -dz, rtol=1e-4, atol=1e-5)

    def test_a_step_too_long_is_not_solved(self, start):
        """The fixed point is lost; the step says so rather than returning something."""
        assert not bool(self.flow(start, 6.0, 1).solved)

    def test_a_failed_step_stays_failed(self, start):
        end = self.flow(start._replace(solved=jnp.array(False)), self.step_size, 1)
        assert not bool(end.solved)
