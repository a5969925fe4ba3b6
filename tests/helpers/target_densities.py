"""Densities whose moments are known without any sampling, for tests of the kernels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.simulation.simulate import simulate
from tests.helpers import one_facet_posterior

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """A density exp(−U) on R^D.

    Attributes
    ----------
    potential_fn, fisher_fn : z (D,) → U, and a positive definite matrix (D, D)
    quantities : z → (Q,) whose moments are known
    names : of the quantities
    mean, sd : (Q,) by quadrature
    start : n, rng → n draws (n, D), exact but for the cells of a grid
    """

    name: str
    potential_fn: Callable[[jax.Array], jax.Array]
    fisher_fn: Callable[[jax.Array], jax.Array]
    quantities: Callable[[jax.Array], jax.Array]
    names: tuple[str, ...]
    mean: Floats
    sd: Floats
    start: Callable[[int, np.random.Generator], Floats]

    @property
    def moments(self) -> tuple[jax.Array, jax.Array]:
        """Mean (D,) and covariance (D, D) of z, from 4000 draws: for constant metrics."""
        z = self.start(4000, np.random.default_rng(0))
        return jnp.asarray(z.mean(axis=0)), jnp.asarray(np.cov(z.T))


def grid_moments(
    potential_fn: Callable[[jax.Array], jax.Array],
    bounds: tuple[tuple[float, float], ...],
    n: int,
) -> tuple[Floats, Floats]:
    """Mean and sd of each coordinate by the midpoint rule on a box, n points along each axis."""
    axes = [a + (b - a) * (np.arange(n) + 0.5) / n for a, b in bounds]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes))
    run = jax.jit(lambda z: jax.lax.map(potential_fn, z, batch_size=1 << 15))
    u = np.asarray(run(jnp.asarray(points)))
    w = np.exp(u.min() - u)
    mean = w @ points / w.sum()
    return mean, np.sqrt(w @ (points - mean) ** 2 / w.sum())


GAUSSIAN_MEAN = np.array([1.0, -2.0, 0.5])
GAUSSIAN_SD = np.array([1.0, 0.1, 5.0])
GAUSSIAN_CORRELATION = np.array([[1.0, 0.9, -0.5], [0.9, 1.0, -0.6], [-0.5, -0.6, 1.0]])


def gaussian() -> Target:
    """Three correlated coordinates of unequal scales."""
    covariance = GAUSSIAN_CORRELATION * np.outer(GAUSSIAN_SD, GAUSSIAN_SD)
    precision = jnp.asarray(np.linalg.inv(covariance))
    centre = jnp.asarray(GAUSSIAN_MEAN)

    def potential(z: jax.Array) -> jax.Array:
        return 0.5 * (z - centre) @ precision @ (z - centre)

    bounds = tuple((m - 8 * s, m + 8 * s) for m, s in zip(GAUSSIAN_MEAN, GAUSSIAN_SD, strict=True))
    return Target(
        "gaussian",
        potential,
        lambda z: precision,  # noqa: ARG005
        lambda z: z,
        ("x", "y", "z"),
        *grid_moments(potential, bounds, 120),
        lambda n, rng: rng.multivariate_normal(GAUSSIAN_MEAN, covariance, n),
    )


BEND, WIDTH = 0.4, 0.6


def banana() -> Target:
    """x ~ N(0, 1), y ~ N(b (x² − 1), c²): the sum of squares of two residuals r, metric JᵀJ."""

    def residuals(z: jax.Array) -> jax.Array:
        return jnp.stack([z[0], (z[1] - BEND * (z[0] ** 2 - 1.0)) / WIDTH])

    def potential(z: jax.Array) -> jax.Array:
        return 0.5 * jnp.sum(residuals(z) ** 2)

    def fisher(z: jax.Array) -> jax.Array:
        j = jax.jacfwd(residuals)(z)
        return j.T @ j

    def start(n: int, rng: np.random.Generator) -> Floats:
        x, e = rng.standard_normal((2, n))
        return np.stack([x, BEND * (x**2 - 1.0) + WIDTH * e], axis=1)

    moments = grid_moments(potential, ((-9.0, 9.0), (-6.0, 40.0)), 1200)
    return Target("banana", potential, fisher, lambda z: z, ("x", "y"), *moments, start)


FACET_TRUTH = one_facet_posterior.Truth(g=0.15)
FACET_SIGMA = 0.7  # the peak is 2.9: a posterior that is far from Gaussian


def facet_data(seed: int = 1) -> Epochs:
    """One facet, two passes of 11 points each."""
    what = one_facet_posterior.experiment(2, truth=FACET_TRUTH, sigma=FACET_SIGMA, step=10.0)
    return Epochs.of(simulate(what, seed)[0])


def facet() -> Target:
    """The model ``faceted``, one facet: z holds log α and the vector that carries the normal."""
    data = facet_data()
    problem = one_facet_posterior.posterior(data)
    grid = one_facet_posterior.Quadrature.of(data)

    def start(n: int, rng: np.random.Generator) -> Floats:
        theta = jnp.asarray(grid.draws(n, rng))
        radius = jnp.asarray(1.0 + 0.1 * rng.standard_normal(n))

        def one(theta: jax.Array, radius: jax.Array) -> jax.Array:
            sites = one_facet_posterior.to_model(theta)
            return problem.ravel({**sites, "normals_base": radius * sites["normals_base"]})

        return np.asarray(jax.vmap(one)(theta, radius))

    return Target(
        "facet",
        lambda z: problem.potential(z, data),
        lambda z: problem.fisher(z, data),
        lambda z: one_facet_posterior.from_model(problem, z, data),
        one_facet_posterior.NAMES,
        *grid.moments(),
        start,
    )
