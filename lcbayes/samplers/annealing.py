"""Ratio of the evidences of two solutions that a map brings near each other, by annealing.

An affine map x = M z + c takes draws of the first solution, with density p(z), to the second, with
density p(x). Particles pass through p(M⁻¹(x − c))^(1−β) p(x)^β by exact Fisher-adaptive
trajectories, up from draws of the first solution and down from draws of the second. Neither
direction finds what only the other end holds, so that they err to opposite sides: half of their
difference is an error beside the scatter of several runs.

References
----------
Del Moral, Doucet & Jasra 2006, JRSS B 68, 411; Dau & Chopin 2022, JRSS B 84, 114 (all points of the
chains are particles); Crooks 2000, Phys. Rev. E 61, 2361 (both directions).
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.threads import threads
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import tempering
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.kernels import ahmc, alternating, metric, trajectory
from lcbayes.samplers.smc import mean_evidence

Floats = NDArray[np.float64]

RUNS, PARTICLES = 4, 96  # in each direction
SHARE = 0.7  # of the particles that remains effective in a step
TRANSITIONS = (2, 6)  # of each particle at each β: more if the error would be too large
ENOUGH = 0.4  # nats
PROBES = 32  # particles whose information determines the widths
MAX_STAGES = 60


class _Between(NamedTuple):
    """The density p(M⁻¹(x − c))^(1−β) p(x)^β.

    Attributes
    ----------
    data : Epochs
    inverse : (D, D)
        M⁻¹.
    shift : (D,)
        c.
    power : β
    """

    data: Epochs
    inverse: Any
    shift: Any
    power: Any

    def first(self, x: jax.Array) -> jax.Array:
        """The point (D,) of the first solution that the map takes to x."""
        return self.inverse @ (x - self.shift)

    def potential(self, problem: Problem, x: jax.Array) -> jax.Array:
        first, second = (problem.potential(z, self.data) for z in (self.first(x), x))
        return (1.0 - self.power) * first + self.power * second

    def fisher(self, problem: Problem, x: jax.Array) -> jax.Array:
        first, second = (problem.fisher(z, self.data) for z in (self.first(x), x))
        first = self.inverse.T @ first @ self.inverse
        return (1.0 - self.power) * first + self.power * second

    def change(self, problem: Problem, x: jax.Array) -> jax.Array:
        """Derivative of the log density with respect to β."""
        return problem.potential(self.first(x), self.data) - problem.potential(x, self.data)


def log_ratio(
    problem: Problem,
    data: Epochs,
    first: Floats,
    second: Floats,
    matrix: Floats,
    shift: Floats,
    key: jax.Array,
    workers: int,
) -> LogEvidence:
    """ln of the evidence of the second solution over that of the first, with its error.

    Parameters
    ----------
    first, second : (n, D)
        Draws of the solutions in order of their chains, one chain after the other.
    matrix, shift : (D, D), (D,)
        The map M z + c. It need not make the solutions overlap, but the nearer it brings them, the
        fewer steps and the smaller the error.
    """
    up, down = (_Between(data, np.linalg.inv(matrix), shift, power) for power in (0.0, 1.0))
    ends = (up, first @ matrix.T + shift), (down, second)
    begins = [(between, part) for between, x in ends for part in np.array_split(x, RUNS)]
    stretch = float(np.linalg.slogdet(matrix)[1])
    with threads(workers) as pool:
        for transitions in TRANSITIONS:
            keys = jax.random.split(jax.random.fold_in(key, transitions), len(begins))
            run = partial(_run, problem, transitions)
            ratio = _both_ways(np.array(list(pool.map(run, *zip(*begins, strict=True), keys))))
            if ratio.se <= ENOUGH:
                break
    return LogEvidence(ratio.value + stretch, ratio.se)


def _both_ways(found: Floats) -> LogEvidence:
    """The ratio from runs in one direction and in the other (2 × `RUNS`,)."""
    if not np.all(np.isfinite(found)):
        return LogEvidence(-np.inf, np.inf)
    forth, back = (mean_evidence(runs) for runs in found.reshape(2, RUNS))
    scatter, apart = np.hypot(forth.se, back.se), abs(forth.value + back.value)
    return LogEvidence(0.5 * (forth.value - back.value), 0.5 * float(max(scatter, apart)))


def _run(problem: Problem, transitions: int, begin: _Between, x: Floats, key: jax.Array) -> float:
    """ln of the integral of the density at the other end over that where x (n, D) begin; −inf if
    the particles do not arrive."""
    between, sign = begin, 1.0 - 2.0 * float(begin.power)
    change = sign * np.asarray(_changes(problem, between, x))
    log_weights = np.full(len(x), -np.log(len(x)))
    total, way, step_size = 0.0, 0.0, alternating.FIRST_STEP
    for _ in range(MAX_STAGES):
        possible = np.isfinite(change)
        log_weights = np.where(possible, log_weights, -np.inf)
        change = np.where(possible, change, 0.0)
        new = tempering.next_step(log_weights, change[:, None], _linear, way, SHARE)
        if not new > way:
            break
        log_weights = log_weights + (new - way) * change
        total += tempering.log_sum(log_weights)
        way = new
        if way == 1.0:
            return float(total)
        between = between._replace(power=begin.power + sign * way)
        key, key_choice, key_move = jax.random.split(key, 3)
        chosen = tempering.systematic(log_weights, PARTICLES, float(jax.random.uniform(key_choice)))
        x = x[chosen]
        width = _widths(problem, between, x[:: PARTICLES // PROBES])
        passed = []
        for key_one in jax.random.split(key_move, transitions):
            keys = jax.random.split(key_one, PARTICLES)
            moved = _moved(problem, between, width, step_size, keys, x)
            x, change, accept = (np.asarray(part) for part in moved)
            gain = float(accept.mean()) - alternating.TARGET
            step_size *= float(np.exp(np.clip(gain, -0.5, 0.5)))
            passed.append((x, sign * change))
        x, change = (np.concatenate(parts) for parts in zip(*passed, strict=True))
        log_weights = np.full(len(x), -np.log(len(x)))
    return -np.inf


def _linear(way: float) -> Floats:
    return np.array([way])


@partial(jax.jit, static_argnums=0)
def _changes(problem: Problem, between: _Between, x: jax.Array) -> jax.Array:
    return jax.lax.map(partial(between.change, problem), x)


@partial(jax.jit, static_argnums=0)
def _widths(problem: Problem, between: _Between, x: jax.Array) -> jax.Array:
    """Median width (D,) of the density at points (n, D)."""
    variance = jax.lax.map(lambda x: metric.variance(between.fisher(problem, x)), x)
    return jnp.sqrt(jnp.median(variance, axis=0))


@partial(jax.jit, static_argnums=0)
def _moved(problem: Problem, between: _Between, width, step_size, keys, x):
    """Particles (n, D) after one transition; the changes and rates of acceptance (n,) there."""
    potential = partial(between.potential, problem)
    kernel = ahmc.build_kernel(potential, partial(between.fisher, problem))
    scale = metric.Scale(jnp.zeros(problem.dim), jnp.diag(width), jnp.diag(1.0 / width))

    def one(row):
        key, x = row
        here = trajectory.init(x, potential)
        here, info = alternating.trajectories(kernel, key, here, step_size, scale)
        return here.z, between.change(problem, here.z), jnp.mean(info.accept_prob)

    return jax.lax.map(one, (keys, x))
