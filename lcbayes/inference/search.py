"""Multi-start search for optima of the posterior: Levenberg-Marquardt with successive halving.

The step is damped Fisher scoring on the log posterior: the metric is the Fisher information of the
data plus the precision of the prior. The same routine therefore applies to every model and noise
law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.blocks import each, together
from lcbayes.core.jax_setup import jax
from lcbayes.core.levenberg_marquardt import Quadratic, levenberg_marquardt
from lcbayes.core.progress import Silent
from lcbayes.core.threads import threads
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.tempering_path import TimePath

# Rounds of successive halving: position on the tempering path (`samplers.tempering_path`), damped
# steps per start, share of the starts kept.
ROUNDS = ((1.0, 8, 0.15), (1.0, 25, 0.3), (1.0, 150, 1.0))
# With a longer time span, more spins fit nearly as well as the correct one, and the basin of
# attraction of each narrows. Adding the data in time order lets the starts follow their spin.
TIME_ORDERED_ROUNDS = (
    *((time, 5, 0.7) for time in (0.12, 0.17, 0.22, 0.27, 0.32, 0.37, 0.42, 0.47)),
    (0.6, 10, 0.5),
    (0.8, 15, 0.5),
    (1.0, 150, 1.0),
)
MIN_STARTS = 12
MIN_GAIN = 0.1  # nats, of an optimum that is better than others
IDLE = 2  # rounds of a climb without a better optimum
ACCELERATOR_SIZE = 20_000_000  # parameters times epochs times starts advanced together there
TOLERANCE = 1e-2  # gain in nats below which successive steps end a search


class SearchState(NamedTuple):
    """One start per row."""

    z: Any  # (B, D), NumPy or JAX
    potential: Any  # (B,)
    damping: Any  # (B,)
    stalled: Any  # (B,) consecutive steps with a gain below the tolerance


def init(z: NDArray | jax.Array, damping: float = 1.0) -> SearchState:
    """Initial state of a search from the starts z (B, D)."""
    n = len(z)
    return SearchState(np.asarray(z), np.full(n, np.inf), np.full(n, damping), np.zeros(n, int))


def chunk_size(problem: Problem, data: Epochs) -> int:
    """Number of starts in one call: on a CPU, more if a step is short, to keep the calls few."""
    limit = together(60_000, ACCELERATOR_SIZE) // (problem.dim * data.t.size)
    return int(np.clip(limit, 1, together(32, 2048)))


@partial(jax.jit, static_argnums=0)
def advance(
    problem: Problem, data: Epochs, state: SearchState, n_steps: int | jax.Array
) -> SearchState:
    """Take ``n_steps`` damped steps from every start; stalled starts do not move.

    The potential is recomputed for these data.
    """

    def model(z: jax.Array) -> Quadratic:
        value, gradient = jax.value_and_grad(problem.potential)(z, data)
        return Quadratic(value, gradient, problem.fisher(z, data))

    def one(row: SearchState) -> SearchState:
        end = levenberg_marquardt(
            model,
            row.z,
            num_steps=n_steps,
            tolerance=TOLERANCE,
            damping=row.damping,
            stalled=row.stalled,
        )
        return SearchState(end.position, end.model.value, end.damping, end.stalled)

    return each(one, state)


def successive_halving(
    problem: Problem,
    data: Epochs,
    starts: NDArray | jax.Array,
    workers: int,
    progress: Silent,
    path: TimePath | None = None,
    rounds: Sequence[tuple[float, int, float]] = (),
    group: NDArray[np.int64] | None = None,
) -> SearchState:
    """Optimise the starts (B, D), dropping the worst after each round; the best come first.

    With a tempering path, the data are added along it. ``rounds`` replace `ROUNDS`. With the group
    (B,) of each start, those are kept that are among the best of all or of their group.
    """
    rounds = rounds or (ROUNDS if path is None else TIME_ORDERED_ROUNDS)
    shares = _shares(len(starts), rounds)
    total = sum(n * share for (_, n, _), share in zip(rounds, shares, strict=True))
    state = init(starts)
    groups = np.zeros(len(starts), int) if group is None else group
    with (
        progress.stage("searching", total, "steps") as bar,
        threads(workers) as pool,
    ):
        for (s, n_steps, _), share in zip(rounds, shares, strict=True):
            kept = _best_of_groups(np.asarray(state.potential), groups)[:share]
            state, groups = jax.tree.map(lambda x, kept=kept: x[kept], (state, groups))
            if path is not None:
                state = init(state.z)
            at = data if path is None else path.at(data, s)
            state = _advance_all(problem, at, state, n_steps, pool, bar.advance)
    return best_first(state)


def polish(problem: Problem, data: Epochs, z: NDArray, workers: int) -> SearchState:
    """The optima near the points z (B, D), row by row."""
    with threads(workers) as pool:
        return _advance_all(problem, data, init(z, 1e-3), ROUNDS[-1][1], pool, lambda _: None)


def advanced(
    problem: Problem,
    data: Epochs,
    z: NDArray,
    n_steps: int,
    workers: int,
    report: Callable[[int], None],
) -> SearchState:
    """The points z (B, D) after some damped steps, row by row."""
    with threads(workers) as pool:
        return _advance_all(problem, data, init(z), n_steps, pool, report)


class Climb(NamedTuple):
    """How far `climbed` goes.

    Attributes
    ----------
    most : int
        Optima tried in a round, the best of those that have not been.
    rounds : int
    halving : sequence
        Rounds of successive halving of the points that are tried.
    """

    most: int
    rounds: int
    halving: Sequence[tuple[float, int, float]]


def climbed(
    problem: Problem,
    data: Epochs,
    ends: SearchState,
    neighbours: Callable[[NDArray], Iterable[NDArray]],
    climb: Climb,
    workers: int,
    progress: Silent,
) -> SearchState:
    """The end points, with better optima that are reached from near the best, best first.

    ``neighbours`` gives points to try, (D,) each, from an optimum (D,). It ends when `IDLE` rounds
    in succession find no optimum that is better than all, or when all have been tried.
    """
    ends, tried, idle = best_first(ends), np.zeros(0), 0
    for _ in range(climb.rounds):
        rows = different(ends, climb.most, tried)
        tried = np.concatenate([tried, np.asarray(ends.potential)[rows]])
        starts = [z for i in rows for z in neighbours(np.asarray(ends.z[i]))]
        if not starts:
            break
        better = successive_halving(
            problem, data, np.stack(starts), workers, progress, rounds=climb.halving
        )
        best = float(ends.potential[0])
        ends = joined(ends, better)
        idle = 0 if float(ends.potential[0]) < best - MIN_GAIN else idle + 1
        if idle == IDLE:
            break
    return ends


def different(
    ends: SearchState, most: int, tried: ArrayLike = (), gain: float = MIN_GAIN
) -> list[int]:
    """Rows of the best end points whose potentials differ by a gain (nats), without those tried."""
    rows: list[int] = []
    last = -np.inf
    for i, potential in enumerate(np.asarray(ends.potential)):
        if len(rows) == most or not np.isfinite(potential):
            break
        if potential > last + gain:
            last = potential
            if not np.any(np.abs(np.asarray(tried) - potential) < gain):
                rows.append(i)
    return rows


def _advance_all(
    problem: Problem,
    data: Epochs,
    state: SearchState,
    n_steps: int,
    pool: Executor,
    report: Callable[[int], None],
) -> SearchState:
    """`advance` for many starts, in chunks."""
    size = chunk_size(problem, data)

    def run(chunk: range) -> SearchState:
        padded = np.resize(chunk, size)  # one shape, one compilation
        out = advance(problem, data, jax.tree.map(lambda x: x[padded], state), n_steps)
        report(n_steps * len(chunk))
        return jax.tree.map(lambda x: np.asarray(x)[: len(chunk)], out)

    rows = range(len(state.z))
    parts = list(pool.map(run, (rows[i : i + size] for i in range(0, len(rows), size))))
    return jax.tree.map(lambda *x: np.concatenate(x), *parts)


def _shares(n: int, rounds: Sequence[tuple[float, int, float]]) -> list[int]:
    """Number of starts in each round."""
    counts = []
    for *_, share in rounds:
        counts.append(n)
        n = min(n, max(MIN_STARTS, round(n * share)))
    return counts


def _best_of_groups(potential: NDArray, group: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows in the order of their rank, which is that among all or, times the groups, in its own."""
    order = np.argsort(potential, kind="stable")
    rank = np.empty(len(order), int)
    rank[order] = np.arange(len(order))
    members = [order[group[order] == g] for g in np.unique(group)]
    for rows in members:
        rank[rows] = np.minimum(rank[rows], np.arange(len(rows)) * len(members))
    return np.lexsort((potential, rank))


def joined(*states: SearchState) -> SearchState:
    """The rows of all states by increasing potential."""
    return best_first(jax.tree.map(lambda *x: np.concatenate(x), *states))


def best_first(state: SearchState) -> SearchState:
    """The rows by increasing potential."""
    order = np.argsort(state.potential, kind="stable")
    return jax.tree.map(lambda x: x[order], state)
