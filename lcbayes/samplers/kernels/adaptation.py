"""Warm-up: finds S, the step size, the number of steps and δ, then freezes them.

Stretches, as fractions of the warm-up in ``EDGES``:

- up to 0.35, S is estimated anew at the end of ever longer windows: the covariance of the draws,
  shrunk towards the inverse of the mean information (or, without one, towards a small unit matrix);
- from 0.35 to 0.85 the candidates δ take turns with long trajectories, of which every length is
  judged (`Scores`), each δ with a step size of its own; from 0.5 on they are but twice as long as
  the best so far;
- then S is taken once more from all draws since 0.2, and the step size settles for the winner, the
  number of steps following it: what was judged is the length in time, their product.

Step sizes follow the dual averaging of Hoffman & Gelman (2014, sec. 3.2).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import metric, trajectory
from lcbayes.samplers.kernels.metric import Scale

EDGES = (0.05, 0.1, 0.2, 0.35, 0.5, 0.85)
COMPARE, NARROW, SETTLE = 3, 4, 5  # what begins at the later edges
FIRST_STEPS = 4  # leapfrog steps while nothing is known yet
FIRST_REACH = 24  # and when the comparison begins
INFORM_EVERY = 4  # warm-up transitions from one information matrix for S to the next
NEARLY = 0.8  # of the best efficiency: no worse than the noise of its estimate
METRIC_COST = 3.0  # one Fisher matrix and its factor, in gradients


class Params(NamedTuple):
    """All that a transition rests on besides its state; constant once warm-up is over."""

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
    """Start anew at one step size for all n candidates."""
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
    """Mean and scatter of draws, and the sum of the information at them."""

    n: jax.Array
    mean: jax.Array  # (D,)
    scatter: jax.Array  # (D, D)
    n_information: jax.Array
    information: jax.Array  # (D, D)


def running(dim: int) -> Running:
    square = jnp.zeros((dim, dim))
    return Running(jnp.zeros(()), jnp.zeros(dim), square, jnp.zeros(()), square)


def running_add(r: Running, z: jax.Array) -> Running:
    """One draw more (Welford)."""
    n = r.n + 1
    before = z - r.mean
    mean = r.mean + before / n
    return r._replace(n=n, mean=mean, scatter=r.scatter + jnp.outer(before, z - mean))


def running_inform(r: Running, information: jax.Array) -> Running:
    """One information matrix more, unless it is not finite."""
    good = jnp.all(jnp.isfinite(information))
    return r._replace(
        n_information=r.n_information + good,
        information=r.information + jnp.where(good, information, 0.0),
    )


def _with(
    r: Running, z: jax.Array, i: jax.Array, fisher_fn: Callable[[jax.Array], jax.Array] | None
) -> Running:
    """The draw of warm-up transition i, and now and then the information there."""
    r = running_add(r, z)
    if fisher_fn is None:
        return r
    wanted = i % INFORM_EVERY == 0
    return jax.lax.cond(wanted, lambda: running_inform(r, fisher_fn(z)), lambda: r)


def estimate(r: Running, old: Scale, correlation: float = 1.0) -> Scale:
    """S of a window: the draws' covariance shrunk by D + 5 imagined draws from the prior guess.

    Where draws hang together over ``correlation`` transitions, that many times as many.
    The guess is the inverse of the mean information, or 10⁻³ I where there is none.
    """
    dim = r.mean.shape[0]
    informed = r.n_information > 0
    mean_information = r.information / jnp.maximum(r.n_information, 1)
    root, _ = metric.inverse_root(jnp.where(informed, mean_information, 0.0), old.precision)
    guess = jnp.where(informed, root @ root.T, 1e-3 * jnp.eye(dim))
    weight = jnp.where(informed, correlation * (dim + 5.0), 5.0)
    covariance = (r.scatter + weight * guess) / (jnp.maximum(r.n - 1, 0) + weight)
    return metric.scale_of(r.mean, covariance, old)


class Scores(NamedTuple):
    """Expected squared jumps, by candidate δ and number of steps, and the features' variances."""

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
    """Smallest effective draws per gradient over all features, (K, L).

    A chain whose feature has lag-one autocorrelation ρ = 1 − E[(f′ − f)²] / 2 var f is taken to be
    of first order, so that a draw is worth (1 − ρ)/(1 + ρ). Variances count as no less than those
    of a Gaussian with covariance S (1 and 2): a chain that has hardly moved would otherwise take
    its short jumps for long ones.
    """
    n = jnp.maximum(jnp.sum(s.count[:, 0]), 1)
    variance = s.square / n - (s.total / n) ** 2
    gaussian = jnp.repeat(jnp.array([1.0, 2.0]), variance.shape[0] // 2)
    variance = jnp.maximum(variance, gaussian)
    jump = s.jump / jnp.maximum(s.count, 1)[..., None]
    half = jnp.clip(jump / (2 * variance), 0.0, 1.9)
    return jnp.min(half / (2 - half), axis=-1) / cost


class Tuning(NamedTuple):
    """State of the warm-up; constant after it."""

    scale: Scale
    steps: Steps
    running: Running
    scores: Scores
    choice: jax.Array  # index of δ
    num_steps: jax.Array
    time: jax.Array  # step size times number of steps, once it is chosen; 0 before


class Tuner(NamedTuple):
    """The static choices of a warm-up.

    ``deltas`` are the candidates for δ, ``lengths`` those for the number of steps; a step size or
    covariance that the user gave is not touched.
    """

    deltas: tuple[float, ...]
    lengths: tuple[int, ...]
    metric_cost: tuple[float, ...]  # of each δ, in gradients
    target: float
    step_size: float | None
    covariance: np.ndarray | None

    @property
    def longest(self) -> int:
        return max(self.lengths)

    def init(self, z: jax.Array, information: jax.Array | None) -> Tuning:
        """Before the first transition, at z (D,)."""
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
        """What the sampling phase uses."""
        step_size = jnp.exp(t.steps.average[t.choice])
        delta = jnp.asarray(self.deltas)[t.choice]
        return Params(step_size, self._num_steps(t, step_size), delta, t.scale)

    def trial(self, t: Tuning, i: jax.Array, num_warmup: jax.Array) -> tuple[jax.Array, Params]:
        """Candidate and parameters of warm-up transition i."""
        comparing = (i >= _edge(COMPARE, num_warmup)) & (i < _edge(SETTLE, num_warmup))
        k = jnp.where(comparing, i % len(self.deltas), t.choice)
        step_size = jnp.exp(t.steps.log_step[k])
        delta = jnp.asarray(self.deltas)[k]
        return k, Params(step_size, self._num_steps(t, step_size), delta, t.scale)

    def _num_steps(self, t: Tuning, step_size: jax.Array) -> jax.Array:
        """Those that take the chosen time, once there is one."""
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
        """After warm-up transition i with candidate k, which led to z."""
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
        """At the end of a stretch: a new S, a new start of ε, and, after the trials, the winner."""
        n = len(self.deltas)
        begins = partial(jnp.equal, done)
        scale = t.scale
        if self.covariance is None:
            new = estimate(t.running, t.scale)
            # Within the comparison one S holds, by which all candidates are measured.
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
        # Too long a trajectory costs a part of the gradients, too short a one the ballistic motion:
        # among the candidates that are nearly the best, the longest.
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
    """Warm-up of a random walk: S from all draws so far, at every transition; ε on the way.

    S_n = covariance of the draws since a fifth of the transitions so far were over, shrunk as in
    `estimate`; proposals ε² S with ε from 2.38/√D on.
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
        """Haario, Saksman & Tamminen (2001), eq. 1, the first draws forgotten at each edge."""
        edges = jnp.stack([_edge(j, num_warmup) for j in range(3)])
        if self.step_size is None:
            t = t._replace(steps=steps_update(t.steps, k, info.accept_prob, self.target))
        t = t._replace(running=_with(t.running, z, i, fisher_fn))
        if self.covariance is None:
            # A random walk needs some 3 D transitions for one independent draw.
            scale = estimate(t.running, t.scale, 3.0 * z.shape[0])
            enough = t.running.n > 2 * z.shape[0]
            scale = jax.tree.map(lambda a, b: jnp.where(enough, a, b), scale, t.scale)
            t = t._replace(scale=scale)
        fresh = jax.tree.map(jnp.zeros_like, t.running)
        forget = jnp.any(i + 1 == edges)
        kept = jax.tree.map(lambda a, b: jnp.where(forget, a, b), fresh, t.running)
        return t._replace(running=kept)
