"""Torque-free motions: their evidence, their improvement, and windows of time that grow.

A motion is a vector (8,): ω over its prior sd (3) and the site ``inertia_base`` of the inertia
tensor (5), both in inertial axes at a reference epoch, at which the attitude is I. Its prior is
N(0, I) at every epoch. The body is a random field of albedo-area, which is eliminated.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import Controls, Quadratic, levenberg_marquardt
from lcbayes.core.threads import threads
from lcbayes.inference.spin_search.arcs import Points
from lcbayes.inference.spin_search.rotated import Rotated
from lcbayes.inference.spin_search.series import log_evidence
from lcbayes.modelling.priors import TRACELESS, inertia_tensor
from lcbayes.physics.attitude.torque_free import torque_free, torque_free_to_body

Floats = NDArray[np.float64]

SIZE = 8  # unknowns of a motion
SCORED = 1024  # motions in one program
IMPROVED = 32
TOLERANCE = 0.05  # nats, below which two steps in succession end an improvement
PATIENT = Controls(patience=2)
DAMPING = 0.1


class Scale(NamedTuple):
    """Prior sd of a component of ω (rad/s) and of the inertia (`modelling.priors.inertia`)."""

    omega: float
    inertia: float


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Window:
    """Points of a light curve in a window of time, padded with points of no weight.

    Attributes
    ----------
    middle : s
        Reference epoch of the motions.
    dt : (T,) s
        Time since the middle.
    rows : (T, P)
        Brightness of each harmonic at the attitude I, over the error.
    white : (T,)
        Brightness over the error.
    prior : (P,)
        Precisions of the harmonics.
    """

    middle: jax.Array
    dt: jax.Array
    rows: jax.Array
    white: jax.Array
    prior: jax.Array

    @classmethod
    def of(cls, rotated: Rotated, points: Points, prior: Floats, error: float, size: int) -> Window:
        """All points given, with an error of the series relative to the mean flux ``error``."""
        middle = 0.5 * (points.t[0] + points.t[-1])
        weight = 1.0 / np.hypot(points.error, error)
        rows = np.asarray(rotated.rows(jnp.asarray(points.sun), jnp.asarray(points.obs)))
        more = size - points.t.size

        def padded(values: Floats, constant: bool = False) -> jax.Array:
            widths = [(0, more), *[(0, 0)] * (values.ndim - 1)]
            return jnp.asarray(np.pad(values, widths, mode="edge" if constant else "constant"))

        return cls(
            jnp.asarray(middle),
            padded(points.t - middle, constant=True),
            padded(rows * weight[:, None]),
            padded(points.flux * weight),
            jnp.asarray(prior),
        )


class Motions(NamedTuple):
    """Motions in a window, best first.

    Attributes
    ----------
    x : (n, 8)
    score : (n,)
        ln evidence of the field plus ln prior of the motion, up to a constant.
    curvature : (n, 8, 8)
        Information of the motion, prior included, with the field eliminated.
    """

    x: Floats
    score: Floats
    curvature: Floats

    def at(self, rows: Any) -> Motions:
        """Some of the motions."""
        return Motions(*(x[rows] for x in self))


def tensor_and_rate(x: jax.Array, scale: Scale) -> tuple[jax.Array, jax.Array]:
    """Inertia tensor (3, 3) and ω (3,) rad/s of a motion (8,) at its reference epoch."""
    return inertia_tensor(x[3:], scale.inertia)[0], scale.omega * x[:3]


def scores(rotated: Rotated, window: Window, scale: Scale, x: Floats, workers: int) -> Floats:
    """ln evidence (n,) of motions x (n, 8), up to a constant, plus ln prior."""

    def some(rows: NDArray[np.int64]) -> Floats:
        padded = np.resize(rows, SCORED)
        return np.asarray(_scores(rotated, window, scale, jnp.asarray(x[padded])))[: rows.size]

    return np.concatenate(_in_parts(some, len(x), SCORED, workers)) - 0.5 * np.sum(x**2, axis=1)


def improved(
    rotated: Rotated, window: Window, scale: Scale, x: Floats, steps: int, workers: int
) -> Motions:
    """Local optima of field and motion by Gauss-Newton steps from x (n, 8), best first."""

    def some(rows: NDArray[np.int64]) -> Motions:
        padded = np.resize(rows, IMPROVED)
        found = _improved(rotated, window, scale, jnp.asarray(x[padded]), steps)
        return Motions(*(np.asarray(v)[: rows.size] for v in found))

    parts = _in_parts(some, len(x), IMPROVED, workers)
    found = Motions(*(np.concatenate(v) for v in zip(*parts, strict=True)))
    found = found.at(np.isfinite(found.score))
    return found.at(np.argsort(-found.score, kind="stable"))


def moved(x: Floats, dt: float, scale: Scale) -> Floats:
    """The same motions (n, 8) with a reference epoch that is later by dt (s)."""
    return np.asarray(_moved(jnp.asarray(x), jnp.asarray(dt), scale))


def distinct(found: Motions, most: int, apart: float) -> NDArray[np.int64]:
    """Rows of motions, best first, no two of which are closer than ``apart`` sd."""
    chosen: list[int] = []
    for i in range(len(found.x)):
        if len(chosen) == most:
            break
        away = found.x[chosen] - found.x[i]
        distance = np.einsum("ni,ij,nj->n", away, found.curvature[i], away)
        if not np.any(distance < apart**2):
            chosen.append(i)
    return np.array(chosen, int)


def within(group: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Rows of the first ``most`` members of each group."""
    order = np.argsort(group, kind="stable")
    _, first, size = np.unique(group[order], return_index=True, return_counts=True)
    rank = np.arange(len(group)) - np.repeat(first, size)
    return np.sort(order[rank < most])


def spread(found: Motions, copies: int, rng: np.random.Generator) -> Floats:
    """Each motion, and draws from the normal distribution of its curvature, (n copies, 8)."""
    factor = np.linalg.cholesky(found.curvature)
    z = rng.standard_normal((copies, *found.x.shape))
    z[0] = 0.0
    away = np.linalg.solve(factor.swapaxes(1, 2), z[..., None])[..., 0]
    return (found.x + away).reshape(-1, SIZE)


def _in_parts(some: Callable[..., Any], n: int, size: int, workers: int) -> list[Any]:
    rows = np.arange(n)
    with threads(workers) as pool:
        return list(pool.map(some, (rows[i : i + size] for i in range(0, n, size))))


@jax.jit
def _scores(rotated: Rotated, window: Window, scale: Scale, x: jax.Array) -> jax.Array:
    def one(x: jax.Array) -> jax.Array:
        inertia, omega = tensor_and_rate(x, scale)
        design = rotated.turned(window.rows, torque_free(window.dt, omega, inertia))
        return log_evidence(design.T @ design + jnp.diag(window.prior), design.T @ window.white)

    return jax.lax.map(one, x, batch_size=32)


@jax.jit
def _improved(rotated: Rotated, window: Window, scale: Scale, x: jax.Array, steps):
    def one(x: jax.Array):
        end = levenberg_marquardt(
            lambda y: _eliminated(rotated, window, scale, y),
            x,
            num_steps=steps,
            tolerance=TOLERANCE,
            damping=DAMPING,
            controls=PATIENT,
        )
        score = end.model.aux - 0.5 * end.position @ end.position
        return end.position, score, end.model.curvature

    return jax.lax.map(one, x, batch_size=16)


def _eliminated(rotated: Rotated, window: Window, scale: Scale, x: jax.Array) -> Quadratic:
    """Misfit, field and motion penalised by their priors, of the best field (P,).

    ``aux`` is the evidence. A change of the motion counts without the part that a change of the
    field makes up for (variable projection).
    """
    inertia, omega = tensor_and_rate(x, scale)
    attitude = torque_free(window.dt, omega, inertia)
    turns = _turns(attitude, window.dt, x, scale)
    design = rotated.turned(window.rows, attitude)
    factor = jax.scipy.linalg.cho_factor(design.T @ design + jnp.diag(window.prior))
    vector = design.T @ window.white
    field = jax.scipy.linalg.cho_solve(factor, vector)
    misfit = window.white - design @ field
    slope = jnp.einsum("tk,tkd->td", rotated.slopes(design, field), turns)
    free = slope - design @ jax.scipy.linalg.cho_solve(factor, design.T @ slope)
    value = 0.5 * (misfit @ misfit + field @ (window.prior * field) + x @ x)
    curvature = slope.T @ free
    evidence = 0.5 * vector @ field - jnp.sum(jnp.log(jnp.diagonal(factor[0])))
    return Quadratic(
        value,
        x - slope.T @ misfit,
        0.5 * (curvature + curvature.T) + jnp.eye(SIZE),
        evidence,
    )


def _turns(attitude: jax.Array, dt: jax.Array, x: jax.Array, scale: Scale) -> jax.Array:
    """Rotation (T, 3, 8) of the body, in rad about its axes, per unit of each unknown."""

    def components(x: jax.Array) -> tuple[jax.Array, ...]:
        # of the body's own axes, held in space
        inertia, omega = tensor_and_rate(x, scale)
        return torque_free_to_body(dt, omega, inertia, *(attitude[:, :, k] for k in range(3)))

    first, second, third = jax.jacfwd(components)(x)
    return jnp.stack([third[:, 1], first[:, 2], second[:, 0]], axis=1)


@jax.jit
def _moved(x: jax.Array, dt: jax.Array, scale: Scale) -> jax.Array:
    def one(x: jax.Array) -> jax.Array:
        inertia, omega = tensor_and_rate(x, scale)
        attitude = torque_free(dt[None], omega, inertia)[0]
        later = jnp.linalg.solve(attitude @ inertia @ attitude.T, inertia @ omega)
        shape = attitude @ jnp.tensordot(x[3:], jnp.asarray(TRACELESS), 1) @ attitude.T
        return jnp.concatenate([later / scale.omega, jnp.tensordot(TRACELESS, shape, 2)])

    return jax.lax.map(one, x, batch_size=64)


def windows(
    points: Points, first: float, growth: float, longest: Sequence[NDArray[np.int64]]
) -> list[NDArray[np.int64]]:
    """Rows of points in windows that grow, the last of which has all.

    The first is the part of the longest pass (one of ``longest``) with most points in ``first`` s.
    Each further window reaches beyond the last by a factor ``growth``, or to the next point.
    """
    t = points.t
    rows = max(longest, key=lambda r: t[r[-1]] - t[r[0]])
    counts = np.searchsorted(t[rows], t[rows] + first, side="right") - np.arange(rows.size)
    begin = int(np.argmax(counts))
    low, high = t[rows[begin]], t[rows[begin + counts[begin] - 1]]
    found = []
    while True:
        found.append(np.flatnonzero((t >= low) & (t <= high)))
        if found[-1].size == t.size:
            return found
        more = max((growth - 1.0) * (high - low), 1e-9)
        before, after = t[t < low], t[t > high]
        nearest = min(
            low - before[-1] if before.size else np.inf, after[0] - high if after.size else np.inf
        )
        more = max(more, nearest)
        # to the side of the nearest point first, then to the other with what is left
        up = min(more, t[-1] - high) if after.size else 0.0
        if before.size and (not after.size or low - before[-1] < after[0] - high):
            down = min(more, low - t[0])
            up = min(more - down, t[-1] - high)
        else:
            down = min(more - up, low - t[0])
        low, high = low - down, high + up
