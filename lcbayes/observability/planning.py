"""Which measurements to take next: the schedule that tells most about what is asked.

What is known and what would be measured are jointly Gaussian, written by factors: with w ~ N(0, I)
of size S, the targets are B w and the noise-free measurements, over their noise, are A w. For a
linearised model w are the parameters in units of what is known of them; for the posterior of a fit
the factors are found by regression over its draws, without any derivative (`linearised`).

Visits are chosen one after the other, each the best given those before. That alone is short-sighted
where much is unknown: the first visits learn little of the target whichever they are. So each visit
is then taken out in turn and the best of all put in its place, until nothing changes (Fedorov's
exchange); from several first sets, because that too may end at a lesser one. The best set is put
in the order in which its members are worth most.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes._jax import jax, jnp

Floats = NDArray[np.float64]
CRITERIA = ("A", "D")
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
    measured : (G, k, S)
        Factor A of the measurements of each candidate visit, over their noise; rows of zeros where
        a visit has fewer than k.
    targets : (T, S)
        Factor B of the targets.
    n : int
        At most G.
    criterion : "A" or "D"
        "A": least mean variance of the targets. "D": most information, ½ ln(det V/det V′).
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
    free = jnp.full(min(n, len(measured)), -1)
    every = np.ones(len(measured), bool)
    greedy = _run(measured, targets, free, criterion, every).visits
    ends = []
    for start in (greedy, even(len(measured), len(greedy)), *starts):
        factors = (jnp.asarray(x) for x in (measured, targets, start))
        members, _ = _exchange(*factors, criterion)
        within = np.isin(np.arange(len(measured)), np.asarray(members))
        ends.append(_run(measured, targets, free, criterion, within))
    worth = [-end.sd[-1] if criterion == "A" else end.gain.sum() for end in ends]
    return ends[int(np.argmax(worth))]


def given(measured: Floats, targets: Floats, visits: NDArray[np.intp]) -> Schedule:
    """The same account for visits that somebody else has chosen, in their order."""
    return _run(measured, targets, jnp.asarray(visits), "D", np.ones(len(measured), bool))


def sd_after(measured: Floats, targets: Floats, visits: NDArray[np.intp]) -> float:
    """Root of the mean variance of the targets after some visits, without the steps to it."""
    rows = measured[visits].reshape(-1, measured.shape[-1])
    rest = np.linalg.solve(np.eye(rows.shape[1]) + rows.T @ rows, targets.T)
    return float(np.sqrt(np.mean(np.sum(targets.T * rest, axis=0))))


def even(n_candidates: int, n: int) -> NDArray[np.intp]:
    """n of the candidates at equal steps, (n,)."""
    return np.floor((np.arange(n) + 0.5) * n_candidates / n).astype(int)


def linearised(measured: Floats, targets: Floats, draws: Floats) -> tuple[Floats, Floats]:
    """Factors by parameters instead of by draws: statistical linearisation.

    Measurements and targets are regressed on the parameters, over the draws. What of a measurement
    the regression leaves is no knowledge to be gained but lack of linearity, and counts as noise
    of its own; what it leaves of a target is not learnt from any measurement. Without this, a few
    measurements more than there are parameters would seem to settle everything.

    Parameters
    ----------
    measured : (M, N)
        Deviations of M measurements from their mean over N draws, over noise and √(N − 1).
    targets : (T, N)
        Those of the targets, over √(N − 1).
    draws : (N, D)
        The parameters.

    Returns
    -------
    measured : (M, S), targets : (T, S)
        S = D + T at most.

    References
    ----------
    Särkkä 2013, Bayesian Filtering and Smoothing, sec. 5.4 (statistical linearisation).
    """
    scale = draws.std(axis=0)
    moving = scale > 0.0
    centred = (draws[:, moving] - draws[:, moving].mean(axis=0)) / scale[moving]
    axes, size, _ = np.linalg.svd(centred, full_matrices=False)
    axes = axes[:, size > 1e-6 * size[0]]
    told = measured @ axes
    bent = np.maximum(np.sum(measured**2, axis=1) - np.sum(told**2, axis=1), 0.0)
    inside = targets @ axes
    left, length, _ = np.linalg.svd(targets - inside @ axes.T, full_matrices=False)
    told /= np.sqrt(1.0 + bent)[:, None]
    blank = np.zeros((len(measured), left.shape[1]))
    return np.hstack([told, blank]), np.hstack([inside, left * length])


def _run(
    measured: Floats, targets: Floats, order: jax.Array, criterion: str, allowed: NDArray[np.bool_]
) -> Schedule:
    visits, gain, variance, first = _choose(
        jnp.asarray(measured), jnp.asarray(targets), order, criterion, jnp.asarray(allowed)
    )
    sd = np.sqrt(np.concatenate([[np.mean(np.sum(targets**2, axis=1))], np.asarray(variance)]))
    return Schedule(np.asarray(visits), np.asarray(gain), sd, np.asarray(first))


def _weigh(a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Information on the targets (nats) and fall of their mean variance by each visit, (G,)."""
    inner = jnp.eye(a.shape[1]) + jnp.einsum("gks,gls->gkl", a, a)
    cross = jnp.einsum("ts,gks->gkt", b, a)
    taken = jnp.einsum("gkt,gku->gtu", cross, jnp.linalg.solve(inner, cross))
    now = b @ b.T
    scale = 1.0 / jnp.sqrt(jnp.maximum(jnp.diag(now), 1e-300))
    rest = (now - taken) * scale[:, None] * scale
    left = jnp.linalg.slogdet(rest)[1]
    whole = jnp.linalg.slogdet(now * scale[:, None] * scale)[1]
    return 0.5 * (whole - left), jnp.trace(taken, axis1=1, axis2=2) / len(b)


@partial(jax.jit, static_argnames="criterion")
def _choose(
    measured: jax.Array, targets: jax.Array, order: jax.Array, criterion: str, allowed: jax.Array
):
    """One loop over visits: all candidates weighed, one taken, what is known brought up to date.

    ``order`` names the visits to take, −1 for the best of those allowed.
    """

    def learn(row: jax.Array, a: jax.Array, b: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Condition on one measurement: w's covariance becomes I − r rᵀ/(1 + r·r) (Potter)."""
        square = row @ row
        safe = jnp.where(square > 0.0, square, 1.0)
        factor = jnp.where(square > 0.0, (1.0 - jax.lax.rsqrt(1.0 + square)) / safe, 0.0)
        return a - factor * jnp.einsum("gks,s,u->gku", a, row, row), b - factor * jnp.outer(
            b @ row, row
        )

    def visit(carry, wanted):
        a, b, used = carry
        gain, fall = _weigh(a, b)
        score = jnp.where(used, -jnp.inf, fall if criterion == "A" else gain)
        chosen = jnp.where(wanted < 0, jnp.argmax(score), wanted)

        def one(i, state):
            a, b = state
            return learn(a[chosen, i], a, b)

        a, b = jax.lax.fori_loop(0, a.shape[1], one, (a, b))
        told = chosen, gain[chosen], jnp.mean(jnp.sum(b**2, axis=1))
        return (a, b, used.at[chosen].set(True)), told

    first, _ = _weigh(measured, targets)
    _, (visits, gain, variance) = jax.lax.scan(visit, (measured, targets, ~allowed), order)
    return visits, gain, variance, first


@partial(jax.jit, static_argnames="criterion")
def _exchange(measured: jax.Array, targets: jax.Array, chosen: jax.Array, criterion: str):
    """Each visit replaced by the best there is given the others, in turn, until none changes."""
    n, eye = len(chosen), jnp.eye(measured.shape[-1])

    def one(i, state):
        chosen, changes = state
        kept = jnp.where((jnp.arange(n) == i)[:, None, None], 0.0, measured[chosen])
        precision = eye + jnp.einsum("gks,gku->su", kept, kept)
        # w = L⁻ᵀ w′ with L Lᵀ the precision: w′ ~ N(0, I) after what the others tell
        lower = jnp.linalg.cholesky(precision)
        turned = jnp.concatenate([measured.reshape(-1, len(eye)), targets])
        turned = jax.scipy.linalg.solve_triangular(lower, turned.T, lower=True).T
        a, b = turned[: -len(targets)].reshape(measured.shape), turned[-len(targets) :]
        gain, fall = _weigh(a, b)
        score = fall if criterion == "A" else gain
        here = score[chosen[i]]
        score = score.at[chosen].set(-jnp.inf).at[chosen[i]].set(here)
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
