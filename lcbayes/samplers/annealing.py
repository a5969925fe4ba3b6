"""Evidence of one motion: bodies of the prior, annealed to the posterior at that motion.

The motion begins with a normal density q about that of given draws, all else with the prior p.
Particles pass through p q^(1−β) L^β, β = 0 → 1, by moves of single facets and exact Fisher-adaptive
trajectories. Where β is small, facets cross the sphere freely, so that the particles divide among
the arrangements by their shares of the posterior. Other motions are out of reach at any β.
Several independent runs give the error.

References
----------
Del Moral, Doucet & Jasra 2006, JRSS B 68, 411; Dau & Chopin 2022, JRSS B 84, 114 (all points of the
chains are particles).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.threads import threads
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import tempering
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.facet_moves import FacetMoves
from lcbayes.samplers.kernels import ahmc, alternating, metric, trajectory
from lcbayes.samplers.smc import mean_evidence

Floats = NDArray[np.float64]

SITES = ("omega_unit", "inertia_base")  # as far as the model has them
RUNS, PARTICLES = 4, 96
POOL = 8  # draws of the prior, over the number of particles
SHARE = 0.7  # of the particles that remains effective in a step
TRANSITIONS = 2  # of each particle at each β
WIDER = 2.0  # covariance of q over that of the posterior
PROBES = 32  # particles whose information determines the widths
MAX_STAGES = 300
TOGETHER = 8  # particles whose facets are moved in one batch, which halves the cost


class Motion(NamedTuple):
    """The normal density q of the M unconstrained values of `SITES`.

    Attributes
    ----------
    mean : (M,)
    root : (M, M)
        Cholesky factor of the covariance.
    """

    mean: Any
    root: Any

    @classmethod
    def of(cls, problem: Problem, draws: Floats) -> Motion:
        """About the motion of draws (n, D) of the posterior."""
        part = draws[:, problem.rows(_sites(problem))]
        return cls(part.mean(axis=0), np.linalg.cholesky(WIDER * np.cov(part.T)))

    def log_density(self, part: jax.Array) -> jax.Array:
        """ln q of values (M,)."""
        white = jnp.linalg.solve(self.root, part - self.mean)
        log_det = jnp.sum(jnp.log(jnp.diagonal(self.root)))
        return -0.5 * white @ white - log_det - 0.5 * part.size * np.log(2.0 * np.pi)

    @property
    def precision(self) -> jax.Array:
        """Inverse of the covariance, (M, M)."""
        inverse = jnp.linalg.inv(self.root)
        return inverse.T @ inverse


class _Annealed(NamedTuple):
    """The density p q^(1−β) L^β.

    Attributes
    ----------
    data : Epochs
    moves : FacetMoves
    motion : Motion
    power : β
    """

    data: Epochs
    moves: FacetMoves
    motion: Motion
    power: Any

    @property
    def at(self) -> Epochs:
        """The data with the likelihood raised to the power."""
        return replace(self.data, information=self.power * self.data.information)

    def potential(self, problem: Problem, z: jax.Array) -> jax.Array:
        log_q = self.motion.log_density(z[problem.rows(_sites(problem))])
        return problem.potential(z, self.at) - (1.0 - self.power) * log_q

    def fisher(self, problem: Problem, z: jax.Array) -> jax.Array:
        rows = problem.rows(_sites(problem))
        more = (1.0 - self.power) * self.motion.precision
        return problem.fisher(z, self.at).at[np.ix_(rows, rows)].add(more)

    def change(self, problem: Problem, z: jax.Array) -> jax.Array:
        """Derivative of the log density with respect to β."""
        points = problem.log_likelihood(z, self.data)
        log_q = self.motion.log_density(z[problem.rows(_sites(problem))])
        return jnp.sum(self.data.information * points) - log_q


def log_evidence(
    problem: Problem,
    data: Epochs,
    moves: FacetMoves,
    draws: Floats,
    key: jax.Array,
    workers: int,
) -> LogEvidence:
    """ln of the integral of the posterior at the motion of ``draws`` (n, D), with its error.

    All orders of the facets are counted.
    """
    density = _Annealed(data, moves, Motion.of(problem, draws), 0.0)
    with threads(workers) as pool:
        found = list(pool.map(partial(_run, problem, density), jax.random.split(key, RUNS)))
    if not np.all(np.isfinite(found)):
        return LogEvidence(-np.inf, np.inf)
    value, se = mean_evidence(np.array(found))
    # Few runs: twice the error holds 95 % of Student's distribution, as it does of the normal one.
    return LogEvidence(value, se * float(stats.t.ppf(0.975, RUNS - 1) / stats.norm.ppf(0.975)))


def _run(problem: Problem, density: _Annealed, key: jax.Array) -> float:
    """ln of the evidence from one population; −inf if it does not reach the posterior."""
    key, key_draw = jax.random.split(key)
    n_pool = POOL * PARTICLES
    z, log_weights, change = _host(_drawn(problem, density, jax.random.split(key_draw, n_pool)))
    # Draws without a likelihood have no weight at any β > 0.
    possible = np.isfinite(log_weights) & np.isfinite(change)
    log_weights, change = np.where(possible, log_weights, -np.inf), np.where(possible, change, 0.0)
    total = tempering.log_sum(log_weights) - float(np.log(n_pool))
    log_weights = tempering.normalised(log_weights)
    power, step_size = 0.0, alternating.FIRST_STEP
    for _ in range(MAX_STAGES):
        new = tempering.next_step(log_weights, change[:, None], _linear, power, SHARE)
        if not new > power:
            break
        log_weights = log_weights + (new - power) * change
        total += tempering.log_sum(log_weights)
        power, density = new, density._replace(power=new)
        if power == 1.0:
            return float(total)
        key, key_choice, key_move = jax.random.split(key, 3)
        chosen = tempering.systematic(log_weights, PARTICLES, float(jax.random.uniform(key_choice)))
        z = z[chosen]
        width = _widths(problem, density, z[:: PARTICLES // PROBES])
        passed = []
        for key_one in jax.random.split(key_move, TRANSITIONS):
            keys = jax.random.split(key_one, PARTICLES)
            z, change, accept = _host(_moved(problem, density, width, step_size, keys, z))
            gain = float(accept.mean()) - alternating.TARGET
            step_size *= float(np.exp(np.clip(gain, -0.5, 0.5)))
            passed.append((z, change))
        z, change = (np.concatenate(x) for x in zip(*passed, strict=True))
        log_weights = np.full(len(z), -np.log(len(z)))
    return -np.inf


def _sites(problem: Problem) -> list[str]:
    return [name for name in SITES if name in problem.names]


def _linear(power: float) -> Floats:
    return np.array([power])


def _host(tree: Any) -> Any:
    return jax.tree.map(np.asarray, tree)


@partial(jax.jit, static_argnums=0)
def _drawn(problem: Problem, density: _Annealed, keys: jax.Array):
    """Draws with the motion from q: z (n, D), ln weights and changes (n,) at β = 0."""
    rows, motion = problem.rows(_sites(problem)), density.motion

    def one(key: jax.Array):
        key_prior, key_motion = jax.random.split(key)
        part = motion.mean + motion.root @ jax.random.normal(key_motion, motion.mean.shape)
        z = problem.prior_draw(key_prior, density.data).at[rows].set(part)
        log_weight = problem.log_factors(z, density.data)
        log_weight += sum(problem.log_density(k, z, density.data) for k in _sites(problem))
        return z, log_weight, density.change(problem, z)

    return jax.lax.map(one, keys)


@partial(jax.jit, static_argnums=0)
def _widths(problem: Problem, density: _Annealed, z: jax.Array) -> jax.Array:
    """Median width (D,) of the density at points (n, D)."""
    variance = jax.lax.map(lambda z: metric.variance(density.fisher(problem, z)), z)
    return jnp.sqrt(jnp.median(variance, axis=0))


@partial(jax.jit, static_argnums=0)
def _moved(problem: Problem, density: _Annealed, width, step_size, keys, z):
    """Particles (n, D) after one transition; the changes and rates of acceptance (n,) there."""
    potential = partial(density.potential, problem)
    kernel = ahmc.build_kernel(potential, partial(density.fisher, problem))
    scale = metric.Scale(jnp.zeros(problem.dim), jnp.diag(width), jnp.diag(1.0 / width))
    moves, at = density.moves.tempered(density.power), density.at
    keys = jax.vmap(jax.random.split)(keys)
    z = jax.lax.map(lambda row: moves(row[0], row[1], at), (keys[:, 0], z), batch_size=TOGETHER)

    def one(row):
        key, z = row
        here = trajectory.init(z, potential)
        here, info = alternating.trajectories(kernel, key, here, step_size, scale)
        return here.z, density.change(problem, here.z), jnp.mean(info.accept_prob)

    return jax.lax.map(one, (keys[:, 1], z))
