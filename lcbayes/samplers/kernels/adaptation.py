"""Warm-up: adaptation of S, the step size, the number of steps and δ.

The phases of the warm-up, as fractions of its length in ``EDGES``, are:

- Up to 0.35, S is estimated at the end of increasingly long windows. It is the covariance of the
  draws, shrunk towards the inverse of the mean information or, without a Fisher matrix, towards a
  small multiple of the unit matrix. The shorter the window in autocorrelation lengths of the draws,
  the stronger the shrinkage.
- From 0.35 to 0.85, the candidates for δ are compared in turn, each with a separate step size. The
  trajectories are long, and every length along them is scored (`Scores`). From 0.5 on, the
  trajectories are only twice as long as the best length so far.
- After 0.85, S is estimated once more, from all draws since 0.2, and the step size is adapted for
  the best δ. The number of steps changes with the step size such that their product, the
  integration time, stays fixed.

All of these are constant after the warm-up. Step sizes are adapted by the dual averaging of
Hoffman & Gelman (2014, sec. 3.2).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from jax.scipy.linalg import solve_triangular

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import metric, trajectory
from lcbayes.samplers.kernels.metric import Scale

EDGES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.85)
COMPARE, NARROW, SETTLE = 3, 4, 5  # indices of the later edges, by the phase that begins there
FIRST_STEPS = 4  # initial number of leapfrog steps
FIRST_REACH = 24  # number of leapfrog steps when the comparison begins
INFORM_EVERY = 4  # warm-up transitions per information matrix for S
NEARLY = 0.8  # of the best efficiency; the difference is within the noise of the estimate
METRIC_COST = 3.0  # cost of one Fisher matrix and its factorisation, in gradients


class Params(NamedTuple):
    """Parameters of a transition; constant after the warm-up."""

    step_size: jax.Array
    num_steps: jax.Array
    delta: jax.Array  # width of Σ = δ²S; inf for a constant metric
    scale: Scale

    def features(self, z: jax.Array) -> jax.Array:
        sd = jnp.sqrt(jnp.sum(self.scale.root**2, axis=1))
        return trajectory.features(z, self.scale.mean, sd)


class Steps(NamedTuple):
    """Dual averaging of ln ε, one entry per candidate (K,)."""

    log_step: jax.Array
    average: jax.Array
    gap: jax.Array
    count: jax.Array
    centre: jax.Array


def steps_at(log_step: jax.Array, n: int) -> Steps:
    """Restart from the same step size for all n candidates."""
    at, zero = jnp.broadcast_to(log_step, (n,)), jnp.zeros(n)
    return Steps(at, at, zero, zero, at)


def steps_update(steps: Steps, k: jax.Array, accept: jax.Array, target: float) -> Steps:
    """One update of candidate k; γ = 0.05, t₀ = 10, κ = 0.75 as published."""
    count = steps.count[k] + 1
    gap = steps.gap[k] + (target - accept - steps.gap[k]) / (count + 10)
    log_step = steps.centre[k] - jnp.sqrt(count) / 0.05 * gap
    weight = count**-0.75
    average = weight * log_step + (1 - weight) * steps.average[k]
    return Steps(
        steps.log_step.at[k].set(log_step),
        steps.average.at[k].set(average),
        steps.gap.at[k].set(gap),
        steps.count.at[k].set(count),
        steps.centre,
    )


class Running(NamedTuple):
    """Running mean and scatter of the draws and of their jumps, and the sum of the information."""

    n: jax.Array
    last: jax.Array  # (D,), the latest draw
    mean: jax.Array  # (D,)
    scatter: jax.Array  # (D, D)
    jumps: jax.Array  # (D, D), sum of the outer products of successive differences
    n_information: jax.Array
    information: jax.Array  # (D, D)


def running(dim: int) -> Running:
    none, row, square = jnp.zeros(()), jnp.zeros(dim), jnp.zeros((dim, dim))
    return Running(none, row, row, square, square, none, square)


def running_add(r: Running, z: jax.Array) -> Running:
    """Add one draw (Welford's algorithm)."""
    n = r.n + 1
    before = z - r.mean
    mean = r.mean + before / n
    jump = jnp.where(n > 1, z - r.last, 0.0)
    return r._replace(
        n=n,
        last=z,
        mean=mean,
        scatter=r.scatter + jnp.outer(before, z - mean),
        jumps=r.jumps + jnp.outer(jump, jump),
    )


def running_inform(r: Running, information: jax.Array) -> Running:
    """Add one information matrix if it is finite."""
    good = jnp.all(jnp.isfinite(information))
    return r._replace(
        n_information=r.n_information + good,
        information=r.information + jnp.where(good, information, 0.0),
    )


def _with(
    r: Running, z: jax.Array, i: jax.Array, fisher_fn: Callable[[jax.Array], jax.Array] | None
) -> Running:
    """Add the draw of warm-up transition i and, every `INFORM_EVERY`, its information matrix."""
    r = running_add(r, z)
    if fisher_fn is None:
        return r
    wanted = i % INFORM_EVERY == 0
    return jax.lax.cond(wanted, lambda: running_inform(r, fisher_fn(z)), lambda: r)


def correlation_length(r: Running, covariance: jax.Array) -> jax.Array:
    """Transitions per independent draw along the direction that mixes most slowly, in [1, n].

    As in `efficiency`, each direction is modelled as a first-order autoregressive process with
    1 − ρ = E[(z′ − z)²] / 2 var z, here with the variances of ``covariance`` (D, D). The length is
    (1 + ρ)/(1 − ρ).
    """
    root = jnp.linalg.cholesky(covariance)
    white = solve_triangular(root, r.jumps / jnp.maximum(r.n - 1, 1), lower=True)
    white = solve_triangular(root, white.T, lower=True)
    half = jnp.clip(0.5 * jnp.linalg.eigvalsh(0.5 * (white + white.T))[0], 0.0, 1.0)
    longest = jnp.maximum(r.n, 1.0)
    return jnp.nan_to_num(jnp.minimum((2 - half) / half, longest), nan=longest, posinf=longest)


def estimate(r: Running, old: Scale, correlation: float | None = None) -> Scale:
    """S of a window: the covariance of the draws, shrunk by D + 5 pseudo-draws from a prior guess.

    The number of pseudo-draws is multiplied by ``correlation``, the autocorrelation length of the
    draws, so that they weigh as much as D + 5 independent draws. Draws that have not explored the
    posterior in some direction thus leave the guess unchanged. The guess is the inverse of the mean
    information; without one, it is 10⁻³ I, with a weight of 5.

    Parameters
    ----------
    correlation
        None to measure it by `correlation_length`.
    """
    dim = r.mean.shape[0]
    informed = r.n_information > 0
    mean_information = r.information / jnp.maximum(r.n_information, 1)
    root, _ = metric.inverse_root(jnp.where(informed, mean_information, 0.0), old.precision)
    guess = jnp.where(informed, root @ root.T, 1e-3 * jnp.eye(dim))

    def shrunk(weight: jax.Array) -> jax.Array:
        return (r.scatter + weight * guess) / (jnp.maximum(r.n - 1, 0) + weight)

    length = correlation
    if length is None:
        length = correlation_length(r, shrunk(jnp.asarray(dim + 5.0)))
    weight = jnp.where(informed, length * (dim + 5.0), 5.0)
    return metric.scale_of(r.mean, shrunk(weight), old)


class Scores(NamedTuple):
    """Sums for the expected squared jumps by δ and number of steps, and for feature variances."""

    jump: jax.Array  # (K, L, 2 D)
    count: jax.Array  # (K, L)
    total: jax.Array  # (2 D,)
    square: jax.Array  # (2 D,)


def scores(n: int, length: int, dim: int) -> Scores:
    return Scores(
        jnp.zeros((n, length, 2 * dim)),
        jnp.zeros((n, length)),
        jnp.zeros(2 * dim),
        jnp.zeros(2 * dim),
    )


def efficiency(s: Scores, cost: jax.Array) -> jax.Array:
    """Effective sample size per gradient, the minimum over all features, (K, L).

    Each feature is modelled as a first-order autoregressive process with lag-one autocorrelation
    ρ = 1 − E[(f′ − f)²] / 2 var f, so that a draw counts as (1 − ρ)/(1 + ρ) effective draws. The
    variances are at least those of a Gaussian with covariance S (1 and 2). Otherwise the short
    jumps of a chain that has hardly moved would seem long relative to its variance.
    """
    n = jnp.maximum(jnp.sum(s.count[:, 0]), 1)
    variance = s.square / n - (s.total / n) ** 2
    gaussian = jnp.repeat(jnp.array([1.0, 2.0]), variance.shape[0] // 2)
    variance = jnp.maximum(variance, gaussian)
    jump = s.jump / jnp.maximum(s.count, 1)[..., None]
    half = jnp.clip(jump / (2 * variance), 0.0, 1.9)
    return jnp.min(half / (2 - half), axis=-1) / cost


class Tuning(NamedTuple):
    """State of the adaptation; constant after the warm-up."""

    scale: Scale
    steps: Steps
    running: Running
    scores: Scores
    choice: jax.Array  # index of δ
    num_steps: jax.Array
    time: jax.Array  # step size times number of steps; 0 until it is chosen


class Tuner(NamedTuple):
    """Static settings of the warm-up.

    ``deltas`` are the candidates for δ, and ``lengths`` those for the number of steps. A step size
    or covariance given by the user is not adapted.
    """

    deltas: tuple[float, ...]
    lengths: tuple[int, ...]
    metric_cost: tuple[float, ...]  # per transition for each δ, in gradients
    target: float
    step_size: float | None
    covariance: np.ndarray | None

    @property
    def longest(self) -> int:
        return max(self.lengths)

    def init(self, z: jax.Array, information: jax.Array | None) -> Tuning:
        """Initial state of the adaptation, at z (D,)."""
        dim = z.shape[0]
        scale = metric.unit_scale(z)
        if self.covariance is not None:
            scale = metric.scale_of(z, jnp.asarray(self.covariance), scale)
        elif information is not None:
            root, _ = metric.inverse_root(information, jnp.eye(dim))
            scale = metric.scale_of(z, root @ root.T, scale)
        n = len(self.deltas)
        first = FIRST_STEPS if len(self.lengths) > 1 else self.longest
        return Tuning(
            scale,
            steps_at(jnp.log(jnp.asarray(self.step_size or 0.5)), n),
            running(dim),
            scores(n, self.longest, dim),
            jnp.array(min(1, n - 1)),
            jnp.array(first),
            jnp.zeros(()),
        )

    def params(self, t: Tuning) -> Params:
        """Parameters of the sampling phase."""
        step_size = jnp.exp(t.steps.average[t.choice])
        delta = jnp.asarray(self.deltas)[t.choice]
        return Params(step_size, self._num_steps(t, step_size), delta, t.scale)

    def trial(self, t: Tuning, i: jax.Array, num_warmup: jax.Array) -> tuple[jax.Array, Params]:
        """Index of the candidate δ and parameters of warm-up transition i."""
        comparing = (i >= _edge(COMPARE, num_warmup)) & (i < _edge(SETTLE, num_warmup))
        k = jnp.where(comparing, i % len(self.deltas), t.choice)
        step_size = jnp.exp(t.steps.log_step[k])
        delta = jnp.asarray(self.deltas)[k]
        return k, Params(step_size, self._num_steps(t, step_size), delta, t.scale)

    def _num_steps(self, t: Tuning, step_size: jax.Array) -> jax.Array:
        """Number of steps for the chosen integration time, if it has been chosen."""
        if len(self.lengths) == 1:
            return t.num_steps
        steps = jnp.round(t.time / step_size).astype(t.num_steps.dtype)
        return jnp.where(t.time > 0, jnp.clip(steps, 1, self.longest), t.num_steps)

    def update(
        self,
        t: Tuning,
        i: jax.Array,
        num_warmup: jax.Array,
        k: jax.Array,
        z: jax.Array,
        info: trajectory.Info,
        fisher_fn: Callable[[jax.Array], jax.Array] | None,
    ) -> Tuning:
        """The state after warm-up transition i, which reached z with candidate k."""
        edges = jnp.stack([_edge(j, num_warmup) for j in range(len(EDGES))])
        comparing = (i >= edges[COMPARE]) & (i < edges[SETTLE])
        if self.step_size is None:
            mean_accept = jnp.sum(info.record.accept) / t.num_steps
            accept = jnp.where(comparing, mean_accept, info.accept_prob)
            t = t._replace(steps=steps_update(t.steps, k, accept, self.target))
        t = t._replace(running=_with(t.running, z, i, fisher_fn))
        t = jax.lax.cond(comparing, lambda: self._score(t, k, z, info), lambda: t)
        done = i + 1
        t = jax.lax.cond(jnp.any(done == edges), lambda: self._turn(t, done, edges), lambda: t)
        return t

    def _score(self, t: Tuning, k: jax.Array, z: jax.Array, info: trajectory.Info) -> Tuning:
        s = t.scores
        f = Params(jnp.ones(()), jnp.ones(()), jnp.ones(()), t.scale).features(z)
        return t._replace(
            scores=Scores(
                s.jump.at[k].add(info.record.jump),
                s.count.at[k].add(jnp.arange(self.longest) < t.num_steps),
                s.total + f,
                s.square + f * f,
            )
        )

    def _turn(self, t: Tuning, done: jax.Array, edges: jax.Array) -> Tuning:
        """End of a phase: update S, restart ε and, after the comparison, choose the best δ."""
        n = len(self.deltas)
        begins = partial(jnp.equal, done)
        scale = t.scale
        if self.covariance is None:
            new = estimate(t.running, t.scale)
            # S is constant during the comparison, so that all candidates share it.
            narrow = begins(edges[NARROW])
            scale = jax.tree.map(lambda a, b: jnp.where(narrow, a, b), t.scale, new)
        fresh = jax.tree.map(jnp.zeros_like, t.running)
        keep = begins(edges[COMPARE]) | begins(edges[NARROW])
        kept = jax.tree.map(lambda a, b: jnp.where(keep, a, b), t.running, fresh)

        lengths = jnp.asarray(self.lengths)
        cost = lengths + jnp.asarray(self.metric_cost)[:, None]
        s = t.scores
        worth = efficiency(
            s._replace(jump=s.jump[:, lengths - 1], count=s.count[:, lengths - 1]), cost
        )
        # The longest of the nearly best candidates: a trajectory that is too long wastes some
        # gradients, whereas one that is too short leads to a random walk.
        near = worth >= NEARLY * jnp.max(worth)
        best = jnp.unravel_index(jnp.argmax(jnp.where(near, lengths, 0)), worth.shape)
        length = lengths[best[1]]
        settle = begins(edges[SETTLE])
        choice = jnp.where(settle, best[0], t.choice)
        num_steps = jnp.select(
            [begins(edges[COMPARE]), begins(edges[NARROW]), settle],
            [min(FIRST_REACH, self.longest), jnp.minimum(2 * length, self.longest), length],
            t.num_steps,
        )
        time = jnp.where(settle, length * jnp.exp(t.steps.average[choice]), t.time)
        steps = t.steps
        if self.step_size is None:
            again = steps_at(t.steps.average[choice], n)
            steps = jax.tree.map(lambda a, b: jnp.where(begins(edges[NARROW]), a, b), steps, again)
        return t._replace(
            scale=scale, steps=steps, running=kept, choice=choice, num_steps=num_steps, time=time
        )


def _edge(j: int, num_warmup: jax.Array) -> jax.Array:
    return jnp.floor(EDGES[j] * num_warmup).astype(num_warmup.dtype)


class Haario(NamedTuple):
    """Warm-up of a random walk, which adapts S and ε at every transition.

    S is the covariance of the draws since the last of the first three ``EDGES``, shrunk as in
    `estimate`. The proposal covariance is ε² S, and ε starts from 2.38/√D.
    """

    target: float
    step_size: float | None
    covariance: np.ndarray | None

    def init(self, z: jax.Array, information: jax.Array | None) -> Tuning:
        step_size = self.step_size or 2.38 / np.sqrt(z.shape[0])
        inner = Tuner((np.inf,), (1,), (0.0,), self.target, step_size, self.covariance)
        return inner.init(z, information)

    def params(self, t: Tuning) -> Params:
        return Params(jnp.exp(t.steps.average[0]), t.num_steps, jnp.asarray(jnp.inf), t.scale)

    def trial(self, t: Tuning, *_: jax.Array) -> tuple[jax.Array, Params]:
        params = self.params(t)
        return jnp.array(0), params._replace(step_size=jnp.exp(t.steps.log_step[0]))

    def update(
        self,
        t: Tuning,
        i: jax.Array,
        num_warmup: jax.Array,
        k: jax.Array,
        z: jax.Array,
        info: trajectory.Info,
        fisher_fn: Callable[[jax.Array], jax.Array] | None,
    ) -> Tuning:
        """Haario, Saksman & Tamminen (2001), eq. 1, with earlier draws discarded at each edge."""
        edges = jnp.stack([_edge(j, num_warmup) for j in range(3)])
        if self.step_size is None:
            t = t._replace(steps=steps_update(t.steps, k, info.accept_prob, self.target))
        t = t._replace(running=_with(t.running, z, i, fisher_fn))
        if self.covariance is None:
            # A random walk needs about 3 D transitions per independent draw.
            scale = estimate(t.running, t.scale, 3.0 * z.shape[0])
            sufficient = t.running.n > 2 * z.shape[0]
            scale = jax.tree.map(lambda a, b: jnp.where(sufficient, a, b), scale, t.scale)
            t = t._replace(scale=scale)
        fresh = jax.tree.map(jnp.zeros_like, t.running)
        forget = jnp.any(i + 1 == edges)
        kept = jax.tree.map(lambda a, b: jnp.where(forget, a, b), fresh, t.running)
        return t._replace(running=kept)
