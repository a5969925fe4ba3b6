"""The one-facet experiment of Linares & Crassidis, secs. VII.A and B, with its exact posterior.

The parameters are θ = (log α, φ, g). The paper uses α with a log-normal prior; log α gives the same
posterior without a boundary at zero. The geometry is eq. (31): Sun and observer move in the x-y
plane, and in the second pass the observer moves in the y-z plane. (The paper's text states that the
second pass is *not* in the y-z plane, and a few lines later that it is. It must be out of the x-y
plane, because otherwise it adds no information on g.) The paper gives no rates or phases; those of
the bundled scenario ``one-facet`` are used.

The flux is linear in α, so two sums over the epochs contain all the information of the data on a
direction, and the posterior over (log α, φ, g) is computed on a grid without sampling; see
`Quadrature`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics import brightness
from lcbayes.physics.bodies import facets
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.scenarios.scenario import Scenario
from lcbayes.simulation.scenarios.viewing import Planar

Floats = NDArray[np.float64]

# The package's own model with one facet on a body that does not rotate.
MODEL = registry.find("faceted").bind({"n_facets": 1, "spin": "none"})
NAMES = ("log_albedo_area", "phi", "g")
LABELS = {
    "log_albedo_area": r"log $\alpha$",
    "albedo_area": r"albedo-area $\alpha$ (m²)",
    "phi": r"azimuth $\phi$ (rad)",
    "g": r"$g$ = cos(polar angle)",
}
SOFTNESS = 0.02  # of lcbayes.modelling.priors.visibility_prior


@dataclass(frozen=True)
class Truth:
    albedo_area: float = 10.0
    phi: float = 0.8
    g: float = 0.0  # sec. VII.A: "a true location of g = 0"


TRUTH = Truth()


def experiment(
    n_passes: int, *, truth: Truth = TRUTH, sigma: float = 0.1, step: float = 2.0
) -> Scenario:
    """One diffuse facet in one or two passes; for `lcbayes.simulation.simulate`.

    Parameters
    ----------
    n_passes : 1 or 2
    truth : Truth
    sigma : m²
        Noise of the flux at unit distance; 0.1 in sec. VII, where the peak is 3.
    step : s
        Time between points.
    """
    base = scenario.load("one-facet")
    assert isinstance(base.geometry, Planar)
    passes = tuple(replace(one, step=step) for one in base.geometry.passes[:n_passes])
    normal = np.asarray(facets.normal(jnp.array([truth.phi]), jnp.array([truth.g])))
    return replace(
        base,
        body=base.body._replace(normals=normal, areas=np.array([truth.albedo_area])),
        geometry=replace(base.geometry, passes=passes),
        noise=replace(base.noise, value=sigma),
    )


def problem_of(data: Epochs) -> Problem:
    """The posterior of `MODEL` given the data."""
    return Problem(MODEL, data)


def to_model(theta: jax.Array) -> dict[str, jax.Array]:
    """The model's sites at θ; the carrier vector of the direction has length one."""
    return {"log_albedo_area": theta[:1], "normals_base": facets.normal(theta[1:2], theta[2:3])}


def potential(problem: Problem, theta: jax.Array, data: Epochs) -> jax.Array:
    """−log p(θ | y) in the paper's coordinates, up to a constant; +∞ for |g| ≥ 1.

    The prior of the carrier b factorises into p(φ) p(g) p(|b|), where the first two are uniform, so
    at |b| = 1 the model's density of b is that of (φ, g) times a constant.
    """
    inside = jnp.abs(theta[2]) < 1.0
    safe = theta.at[2].set(jnp.where(inside, theta[2], 0.0))
    return jnp.where(inside, problem.potential(problem.ravel(to_model(safe)), data), jnp.inf)


def fisher(problem: Problem, theta: jax.Array, data: Epochs) -> jax.Array:
    """Fisher information on θ, eq. (28), plus the precision of the prior of log α; (3, 3)."""
    safe = theta.at[2].set(jnp.clip(theta[2], -0.999, 0.999))

    def mean(theta: jax.Array) -> jax.Array:
        return problem.moments(problem.ravel(to_model(theta)), data).mean

    scaled = jax.jacfwd(mean)(safe) / data.error[:, None]
    return scaled.T @ scaled + jnp.diag(jnp.array([1.0, 0.0, 0.0]))


@jax.jit
def _sums(phi: jax.Array, g: jax.Array, data: Epochs):
    """Σ y k/σ², Σ k²/σ² and log of the visibility prior for directions (n,) each."""

    def one(angles: tuple[jax.Array, jax.Array]):
        normal = facets.normal(*angles)[None]
        k = brightness.flux(data.sun, data.obs, normal, jnp.ones(1))
        seen = jnp.max(jnp.minimum(data.sun @ normal[0], data.obs @ normal[0]))
        visible = -((jnp.minimum(seen, 0.0) / SOFTNESS) ** 2)
        w = 1.0 / data.error**2
        return jnp.sum(w * k * data.brightness), jnp.sum(w * k**2), visible

    return jax.lax.map(one, (phi, g), batch_size=4096)


@dataclass(frozen=True)
class Quadrature:
    """The posterior on a grid of (log α, φ, g) with cells of equal volume.

    log π = −½ (log α)² + α Σ y k/σ² − ½ α² Σ k²/σ² + log p(φ, g) + const, where k(φ, g; t) is the
    flux of a facet of unit albedo-area. For densities that vanish at the edges of the grid, the
    midpoint rule converges faster than any power of the step.

    Attributes
    ----------
    axes : three arrays
        Centres of the cells along each of `NAMES`.
    log_density : (n_log_alpha, n_phi, n_g)
        Unnormalised, with maximum 0.
    """

    axes: tuple[Floats, Floats, Floats]
    log_density: Floats

    @classmethod
    def over(
        cls, data: Epochs, bounds: tuple[tuple[float, float], ...], shape: tuple[int, int, int]
    ) -> Quadrature:
        """The grid on a given box: ``bounds`` of log α, φ and g."""
        log_areas, azimuths, heights = (
            low + (high - low) * (np.arange(n) + 0.5) / n
            for (low, high), n in zip(bounds, shape, strict=True)
        )
        phi, g = np.meshgrid(azimuths, heights, indexing="ij")
        first, second, visible = (
            np.asarray(x).reshape(phi.shape)
            for x in _sums(jnp.asarray(phi.ravel()), jnp.asarray(g.ravel()), data)
        )
        log_alpha = log_areas[:, None, None]
        alpha = np.exp(log_alpha)
        log_density = alpha * first - 0.5 * alpha**2 * second
        log_density += visible - 0.5 * log_alpha**2
        log_density -= log_density.max()
        return cls((log_areas, azimuths, heights), log_density)

    @classmethod
    def of(
        cls, data: Epochs, shape: tuple[int, int, int] = (200, 160, 160), depth: float = 35.0
    ) -> Quadrature:
        """The grid on the smallest box of all densities above e^−depth of the maximum.

        Densities below e^−35 of the peak are omitted, which is far below the error of any sampler
        here. The box is found by repeated refinement of the whole parameter space.
        """
        bounds = ((-4.0, 7.0), (0.0, 2.0 * np.pi), (-1.0, 1.0))
        for _ in range(8):
            coarse = cls.over(data, bounds, (120, 100, 100))
            # a coarse grid can miss the peak of a sharp ridge: use a wide margin until convergence
            kept = np.nonzero(coarse.log_density > -20.0 * depth)
            steps = [axis[1] - axis[0] for axis in coarse.axes]
            new = tuple(
                (max(low, axis[i.min()] - 1.5 * step), min(high, axis[i.max()] + 1.5 * step))
                for (low, high), axis, i, step in zip(bounds, coarse.axes, kept, steps, strict=True)
            )
            settled = all(b - a > 0.9 * (d - c) for (a, b), (c, d) in zip(new, bounds, strict=True))
            bounds = new
            if settled:
                break
        coarse = cls.over(data, bounds, (200, 160, 160))
        kept = np.nonzero(coarse.log_density > -depth)
        tight = tuple(
            (axis[i.min()] - 1.5 * (axis[1] - axis[0]), axis[i.max()] + 1.5 * (axis[1] - axis[0]))
            for axis, i in zip(coarse.axes, kept, strict=True)
        )
        tight = (*tight[:2], (max(tight[2][0], -1.0), min(tight[2][1], 1.0)))
        return cls.over(data, tight, shape)

    @property
    def weights(self) -> Floats:
        """Probability of each cell."""
        w = np.exp(self.log_density)
        return w / w.sum()

    def moments(self) -> tuple[Floats, Floats]:
        """Posterior mean and sd of log α, φ, g; (3,) each."""
        w = self.weights
        marginals = [w.sum(axis=tuple(j for j in range(3) if j != i)) for i in range(3)]
        mean = np.array([p @ x for p, x in zip(marginals, self.axes, strict=True)])
        second = [p @ (x - m) ** 2 for p, x, m in zip(marginals, self.axes, mean, strict=True)]
        return mean, np.sqrt(np.array(second))

    def marginal(self, *which: str) -> Floats:
        """Marginal probability of the cells of one or two of `NAMES`, in that order."""
        index = [NAMES.index(name) for name in which]
        p = self.weights.sum(axis=tuple(i for i in range(3) if i not in index))
        return p if index == sorted(index) else p.T

    def draws(self, n: int, rng: np.random.Generator) -> Floats:
        """n draws from the piecewise-constant density, (n, 3)."""
        cell = rng.choice(self.log_density.size, size=n, p=self.weights.ravel())
        at = np.stack(np.unravel_index(cell, self.log_density.shape), axis=1)
        steps = np.array([axis[1] - axis[0] for axis in self.axes])
        centres = np.stack([axis[i] for axis, i in zip(self.axes, at.T, strict=True)], axis=1)
        return centres + steps * (rng.random((n, 3)) - 0.5)
