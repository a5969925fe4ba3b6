"""The most informative schedule of measurements for a target.

Targets and measurements are jointly Gaussian and are represented by factors. With w ~ N(0, I) of
size S, the targets are B w and the noise-free measurements, over their noise, are A w. For a
linearised model, w contains the parameters in units of their uncertainties. There may be K versions
of the factors, each at a different possible truth (`known`). The criterion is then the average over
the versions.

A greedy search chooses visits one by one, each as the best given those before. It is not optimal if
much is unknown, because no single first visit is then informative about the target. The set is
therefore improved by exchange (Fedorov): each visit in turn is replaced by the best candidate,
until nothing changes. Exchange can end at a local optimum, so it starts from several sets. The
visits of the best set are sorted greedily by their gain.
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
ANY = -1  # in an order of visits: the best remaining candidate
_ROUNDS = 20  # maximum number of exchange sweeps; two to five are typical


@dataclass(frozen=True)
class Schedule:
    """Visits in greedy order of their gain.

    Attributes
    ----------
    visits : (n,) int
        Indices of the candidates.
    gain : (n,) nats
        Information on the targets that each visit adds to that of the visits before it.
    sd : (n + 1,)
        Root of the mean variance of the targets, before the first and after each visit.
    first_gain : (G,) nats
        Information that each candidate alone would add.
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
    """The n visits that are jointly most informative, by greedy search and exchange.

    Parameters
    ----------
    measured : (K, G, k, S)
        Factor A of the measurements of each candidate visit, over their noise; visits with fewer
        than k measurements are padded with rows of zeros.
    targets : (K, T, S)
        Factor B of the targets.
    n : int
        Number of visits, at most G.
    criterion : "A" or "D"
        "A": smallest mean variance of the targets. "D": largest information, ½ ln(det V/det V′).
        Both are averaged over the K versions.
    starts : arrays of n rows
        Further initial sets for the exchange, in addition to the greedy and the even set.

    References
    ----------
    Chaloner & Verdinelli 1995, Statist. Sci. 10, 273 (Bayesian A- and D-optimality); Fedorov 1972,
    Theory of Optimal Experiments, ch. 3 (exchange); Krause, Singh & Guestrin 2008, J. Mach. Learn.
    Res. 9, 235 (greedy search).
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
    """The schedule for given visits, in their order."""
    _, gain, sd = _run(measured, targets, visits, "D")
    return Schedule(np.asarray(visits), gain, sd, _alone(measured, targets))


def sd_after(measured: Floats, targets: Floats, visits: NDArray[np.intp]) -> float:
    """Root of the mean variance of the targets after all of the visits."""
    rows = measured[:, visits].reshape(len(measured), -1, measured.shape[-1])
    columns = np.swapaxes(targets, 1, 2)
    inner = np.eye(rows.shape[2]) + np.swapaxes(rows, 1, 2) @ rows
    rest = np.linalg.solve(inner, columns)
    return float(np.sqrt(np.mean(np.sum(columns * rest, axis=1))))


def even(n_candidates: int, n: int) -> NDArray[np.intp]:
    """Indices of n candidates at equal steps, (n,)."""
    return np.floor((np.arange(n) + 0.5) * n_candidates / n).astype(int)


def _padded(visits: NDArray[np.intp], filler: int) -> NDArray[np.intp]:
    """Visits padded to a power of two, so that few programs are compiled for all lengths."""
    room = max(8, 1 << (len(visits) - 1).bit_length())
    return np.concatenate([visits, np.full(room - len(visits), filler)])


def _run(
    measured: Floats, targets: Floats, order: NDArray[np.intp], criterion: str
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Visits, gain (n,) and sd (n + 1,) of `Schedule` for an order as in `_choose`."""
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
    """Factors x, y (G, k, T) of the reduction of the targets' covariance by each visit.

    The covariance decreases by Σₖ xₖ yₖᵀ, with x = A Bᵀ and y = (I + A Aᵀ)⁻¹ x.
    """
    cross = jnp.einsum("ts,gks->gkt", b, a)
    if a.shape[1] == 1:  # a division; factorising for each visit would cost fifty times as much
        return cross, cross / (1.0 + jnp.sum(a**2, axis=2, keepdims=True))
    inner = jnp.eye(a.shape[1]) + jnp.einsum("gks,gls->gkl", a, a)
    return cross, jnp.linalg.solve(inner, cross)


def _fall(a: jax.Array, b: jax.Array) -> jax.Array:
    """Decrease of the targets' mean variance by each visit, averaged over versions, (G,)."""

    def one(a: jax.Array, b: jax.Array) -> jax.Array:
        x, y = _taken(a, b)
        return jnp.sum(x * y, axis=(1, 2)) / len(b)

    return jax.vmap(one)(a, b).mean(axis=0)


@jax.jit
def _gain(a: jax.Array, b: jax.Array) -> jax.Array:
    """Information of each visit on the targets in nats, averaged over versions, (G,)."""
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
    """Choose visits one by one, and condition the factors on each of them.

    ``order`` has at least n entries: visits to take, or `ANY` for the best remaining candidate.
    """

    @jax.vmap
    def learn(row: jax.Array, a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Condition on one measurement, after which cov w = I − r rᵀ/(1 + r·r) (Potter)."""
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
        gained = _gain(a[:, chosen][:, None], b)[0]
        a, b = jax.lax.fori_loop(
            0, a.shape[2], lambda j, state: learn(state[0][:, chosen, j], *state), (a, b)
        )
        return (
            a,
            b,
            used.at[chosen].set(True),
            visits.at[i].set(chosen),
            gain.at[i].set(gained),
            variance.at[i].set(jnp.mean(jnp.sum(b**2, axis=2))),
        )

    room, used = jnp.zeros(len(order)), jnp.zeros(measured.shape[1], bool)
    start = (measured, targets, used, order, room, room)
    return jax.lax.fori_loop(0, n, visit, start)[3:]


@partial(jax.jit, static_argnames="criterion")
def _exchange(measured: jax.Array, targets: jax.Array, chosen: jax.Array, n: int, criterion: str):
    """Replace each visit in turn by the best given the others, until none changes.

    The first n entries of ``chosen`` are visits; the rest are padded with indices out of range.
    """
    eye, filled = jnp.eye(measured.shape[-1]), jnp.arange(len(chosen)) < n

    def one(i, state):
        chosen, changes = state
        others = filled & (jnp.arange(len(chosen)) != i)
        kept = jnp.where(others[:, None, None], measured[:, chosen], 0.0)
        precision = eye + jnp.einsum("vgks,vgku->vsu", kept, kept)
        # w = L⁻ᵀ w′ with L Lᵀ the precision, so that w′ ~ N(0, I) given the other visits
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
