"""Which measurements to take next: the schedule that tells most about what is asked.

What is known and what would be measured are jointly Gaussian, written by factors: with w ~ N(0, I)
of size S, the targets are B w and the noise-free measurements, over their noise, are A w. For a
linearised model w are the parameters in units of what is known of them. There may be K versions of
the factors, each at another place where the truth may lie (`known`): a schedule is then judged by
what it leaves on average over them.

Visits are chosen one after the other, each the best given those before. That alone is short-sighted
where much is unknown: the first visits learn little of the target whichever they are. So each visit
is then taken out in turn and the best of all put in its place, until nothing changes (Fedorov's
exchange); from several first sets, because that too may end at a lesser one. The best set is put
in the order in which its members are worth most.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp

Floats = NDArray[np.float64]
CRITERIA = ("A", "D")
ANY = -1  # in an order of visits: the best of those that are left
_ROUNDS = 20  # of exchanges; two to five are usual


@dataclass(frozen=True)
class Schedule:
    """Visits in the order in which they are worth most.

    Attributes
    ----------
    visits : (n,) int
        Rows of the candidates that were offered.
    gain : (n,) nats
        Information on the targets that each adds to those before it.
    sd : (n + 1,)
        Root of the mean variance of the targets, before and after each.
    first_gain : (G,) nats
        What each candidate alone would add to what is known.
    """

    visits: NDArray[np.intp]
    gain: Floats
    sd: Floats
    first_gain: Floats


def best(
    measured: Floats,
    targets: Floats,
    n: int,
    criterion: str = "A",
    starts: Iterable[NDArray[np.intp]] = (),
) -> Schedule:
    """The n visits that together tell most, by greed and exchange.

    Parameters
    ----------
    measured : (K, G, k, S)
        Factor A of the measurements of each candidate visit, over their noise; rows of zeros where
        a visit has fewer than k.
    targets : (K, T, S)
        Factor B of the targets.
    n : int
        At most G.
    criterion : "A" or "D"
        "A": least mean variance of the targets. "D": most information, ½ ln(det V/det V′). Both
        on average over the K versions.
    starts : arrays of n rows
        Sets from which exchange begins too, beside the greedy and the even one.

    References
    ----------
    Chaloner & Verdinelli 1995, Statist. Sci. 10, 273 (Bayesian A- and D-optimality); Fedorov 1972,
    Theory of Optimal Experiments, ch. 3 (exchange); Krause, Singh & Guestrin 2008, J. Mach. Learn.
    Res. 9, 235 (greed).
    """
    if criterion not in CRITERIA:
        raise ValueError(f"unknown criterion {criterion!r}; available: {', '.join(CRITERIA)}")
    candidates = measured.shape[1]
    n = min(n, candidates)
    greedy, *_ = _run(measured, targets, np.full(n, ANY), criterion)
    ends = []
    for start in (greedy, even(candidates, n), *starts):
        room = jnp.asarray(_padded(start, candidates))
        chosen, _ = _exchange(jnp.asarray(measured), jnp.asarray(targets), room, n, criterion)
        members = np.sort(np.asarray(chosen)[:n])
        order, gain, sd = _run(measured[:, members], targets, np.full(n, ANY), criterion)
        ends.append(Schedule(members[order], gain, sd, np.empty(0)))
    worth = [-end.sd[-1] if criterion == "A" else end.gain.sum() for end in ends]
    return replace(ends[int(np.argmax(worth))], first_gain=_alone(measured, targets))


def given(measured: Floats, targets: Floats, visits: NDArray[np.intp]) -> Schedule:
    """The same account for visits that somebody else has chosen, in their order."""
    _, gain, sd = _run(measured, targets, visits, "D")
    return Schedule(np.asarray(visits), gain, sd, _alone(measured, targets))


def sd_after(measured: Floats, targets: Floats, visits: NDArray[np.intp]) -> float:
    """Root of the mean variance of the targets after some visits, without the steps to it."""
    rows = measured[:, visits].reshape(len(measured), -1, measured.shape[-1])
    columns = np.swapaxes(targets, 1, 2)
    inner = np.eye(rows.shape[2]) + np.swapaxes(rows, 1, 2) @ rows
    rest = np.linalg.solve(inner, columns)
    return float(np.sqrt(np.mean(np.sum(columns * rest, axis=1))))


def even(n_candidates: int, n: int) -> NDArray[np.intp]:
    """n of the candidates at equal steps, (n,)."""
    return np.floor((np.arange(n) + 0.5) * n_candidates / n).astype(int)


def _padded(visits: NDArray[np.intp], filler: int) -> NDArray[np.intp]:
    """With room up to a power of two: one compiled program serves schedules of many lengths."""
    room = max(8, 1 << (len(visits) - 1).bit_length())
    return np.concatenate([visits, np.full(room - len(visits), filler)])


def _run(
    measured: Floats, targets: Floats, order: NDArray[np.intp], criterion: str
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Visits, gain (n,) and sd (n + 1,) of `Schedule` for an order as `_choose` has it."""
    n = len(order)
    room = jnp.asarray(_padded(order, ANY))
    visits, gain, variance = (
        np.asarray(x)[:n]
        for x in _choose(jnp.asarray(measured), jnp.asarray(targets), room, n, criterion)
    )
    before = np.mean(np.sum(targets**2, axis=2))
    return visits, gain, np.sqrt(np.concatenate([[before], variance]))


def _alone(measured: Floats, targets: Floats) -> Floats:
    return np.asarray(_gain(jnp.asarray(measured), jnp.asarray(targets)))


def _taken(a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Factors of what each visit takes from the targets' covariance: (G, k, T) each.

    The covariance falls by Σₖ xₖ yₖᵀ, with x = A Bᵀ and y = (I + A Aᵀ)⁻¹ x.
    """
    cross = jnp.einsum("ts,gks->gkt", b, a)
    if a.shape[1] == 1:  # a division, where a factorisation for each visit costs fifty times that
        return cross, cross / (1.0 + jnp.sum(a**2, axis=2, keepdims=True))
    inner = jnp.eye(a.shape[1]) + jnp.einsum("gks,gls->gkl", a, a)
    return cross, jnp.linalg.solve(inner, cross)


def _fall(a: jax.Array, b: jax.Array) -> jax.Array:
    """Fall of the targets' mean variance by each visit, the mean over versions, (G,)."""

    def one(a: jax.Array, b: jax.Array) -> jax.Array:
        x, y = _taken(a, b)
        return jnp.sum(x * y, axis=(1, 2)) / len(b)

    return jax.vmap(one)(a, b).mean(axis=0)


@jax.jit
def _gain(a: jax.Array, b: jax.Array) -> jax.Array:
    """Information on the targets by each visit, nats, the mean over versions, (G,)."""
    return jax.vmap(_gain_of_one)(a, b).mean(axis=0)


def _gain_of_one(a: jax.Array, b: jax.Array) -> jax.Array:
    x, y = _taken(a, b)
    now = b @ b.T
    scale = 1.0 / jnp.sqrt(jnp.maximum(jnp.diag(now), 1e-300))
    rest = (now - jnp.einsum("gkt,gku->gtu", x, y)) * scale[:, None] * scale
    left = jnp.linalg.slogdet(rest)[1]
    whole = jnp.linalg.slogdet(now * scale[:, None] * scale)[1]
    return 0.5 * (whole - left)


@partial(jax.jit, static_argnames="criterion")
def _choose(measured: jax.Array, targets: jax.Array, order: jax.Array, n: int, criterion: str):
    """One loop over visits: all candidates weighed, one taken, what is known brought up to date.

    ``order`` has room for n visits and more: those to take, `ANY` for the best that is left.
    """

    @jax.vmap
    def learn(row: jax.Array, a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Condition on one measurement: w's covariance becomes I − r rᵀ/(1 + r·r) (Potter)."""
        square = row @ row
        safe = jnp.where(square > 0.0, square, 1.0)
        factor = jnp.where(square > 0.0, (1.0 - jax.lax.rsqrt(1.0 + square)) / safe, 0.0)
        a = a - factor * jnp.einsum("gk,u->gku", a @ row, row)
        return a, b - factor * jnp.outer(b @ row, row)

    def visit(i, carry):
        a, b, used, visits, gain, variance = carry
        score = _fall(a, b) if criterion == "A" else _gain(a, b)
        best = jnp.argmax(jnp.where(used, -jnp.inf, score))
        chosen = jnp.where(order[i] == ANY, best, order[i])
        told = _gain(a[:, chosen][:, None], b)[0]
        a, b = jax.lax.fori_loop(
            0, a.shape[2], lambda j, state: learn(state[0][:, chosen, j], *state), (a, b)
        )
        return (
            a,
            b,
            used.at[chosen].set(True),
            visits.at[i].set(chosen),
            gain.at[i].set(told),
            variance.at[i].set(jnp.mean(jnp.sum(b**2, axis=2))),
        )

    room, used = jnp.zeros(len(order)), jnp.zeros(measured.shape[1], bool)
    start = (measured, targets, used, order, room, room)
    return jax.lax.fori_loop(0, n, visit, start)[3:]


@partial(jax.jit, static_argnames="criterion")
def _exchange(measured: jax.Array, targets: jax.Array, chosen: jax.Array, n: int, criterion: str):
    """Each visit replaced by the best there is given the others, in turn, until none changes.

    Of ``chosen`` the first n are visits; the rest is room, filled with numbers past the last.
    """
    eye, filled = jnp.eye(measured.shape[-1]), jnp.arange(len(chosen)) < n

    def one(i, state):
        chosen, changes = state
        others = filled & (jnp.arange(len(chosen)) != i)
        kept = jnp.where(others[:, None, None], measured[:, chosen], 0.0)
        precision = eye + jnp.einsum("vgks,vgku->vsu", kept, kept)
        # w = L⁻ᵀ w′ with L Lᵀ the precision: w′ ~ N(0, I) after what the others tell
        lower = jnp.linalg.cholesky(precision)
        turn = jax.vmap(lambda m: jax.scipy.linalg.solve_triangular(m, eye, lower=True).T)(lower)
        a, b = measured @ turn[:, None], targets @ turn
        score = _fall(a, b) if criterion == "A" else _gain(a, b)
        here = score[chosen[i]]
        score = score.at[chosen].set(-jnp.inf, mode="drop").at[chosen[i]].set(here)
        better = jnp.argmax(score)
        swap = score[better] > here + 1e-9 * jnp.abs(here)
        return chosen.at[i].set(jnp.where(swap, better, chosen[i])), changes + swap

    def again(state):
        _, changes, rounds = state
        return (changes > 0) & (rounds < _ROUNDS)

    def sweep(state):
        chosen, _, rounds = state
        chosen, changes = jax.lax.fori_loop(0, n, one, (chosen, 0))
        return chosen, changes, rounds + 1

    chosen, _, rounds = jax.lax.while_loop(again, sweep, (chosen, 1, 0))
    return chosen, rounds
