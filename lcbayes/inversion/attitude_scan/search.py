"""The stages of a scan: screen every hypothesis, refine the best, map the sky at one frequency."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.cluster import Run
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Track
from lcbayes.inversion.attitude_scan.grid import Grid
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.smooth import (
    PRIOR_POINTS,
    PRIOR_SQUARES,
    SmoothBody,
    Spin,
    fitted,
)
from lcbayes.inversion.attitude_scan.spin import FREE, Ends, finer, solve, spheres

Floats = NDArray[np.float64]

POLE_HELD = (0.0, 0.0, 1.0)
LARGEST_TASK, FEWEST_TASKS = 40, 16


class Effort(NamedTuple):
    """Effort per hypothesis: at most ``steps``, or until three steps gain less (nat)."""

    steps: int
    tolerance: float


SCREEN, REFINE = Effort(20, 1.0), Effort(150, 0.03)


def screen(
    points: Points,
    body: SmoothBody,
    grid: Grid,
    run: Run,
    checkpoint: Checkpoint,
    name: str,
    track: Track,
) -> Ends:
    """Fit every hypothesis of the grid from a sphere, in the order of `Grid.rows`."""
    shared = body, points.host(), FREE, SCREEN
    return _spread(_from_spheres, shared, list(grid.rows()), run, checkpoint, name, track)


def refine(
    points: Points,
    body: SmoothBody,
    ends: Ends,
    run: Run,
    checkpoint: Checkpoint,
    name: str,
    track: Track,
) -> Ends:
    """Refine hypotheses with a finer body, from their previous end points to convergence."""
    shared = body, points.host(), FREE, REFINE
    rows = list(finer(body, ends))
    return _spread(_from_bodies, shared, rows, run, checkpoint, name, track, largest=1)


def sky(
    points: Points,
    body: SmoothBody,
    poles: Floats,
    frequency: float,
    run: Run,
    checkpoint: Checkpoint,
    track: Track,
) -> Ends:
    """The best body at this frequency, with the pole fixed at each of these poles."""
    shared = body, points.host(), POLE_HELD, SCREEN
    rows = [poles, np.full(len(poles), frequency)]
    return _spread(_from_spheres, shared, rows, run, checkpoint, "sky", track)


def _from_spheres(shared: tuple, poles: Floats, frequencies: Floats) -> Ends:
    body, points, free, effort = shared
    return _solved(body, points, spheres(body, poles, frequencies), free, effort)


def _from_bodies(shared: tuple, tilt: Floats, frequency: Floats, coefficients: Floats) -> Ends:
    body, points, free, effort = shared
    return _solved(
        body, points, Spin(*map(jnp.asarray, (tilt, frequency, coefficients))), free, effort
    )


def _solved(body: SmoothBody, points: Points, starts: Any, free: Any, effort: Effort) -> Ends:
    ends = solve(body, points, starts, np.asarray(free), effort.steps, effort.tolerance)
    return Ends(*map(np.asarray, ends))


def _spread(
    function: Callable[..., Ends],
    shared: tuple,
    rows: list,
    run: Run,
    checkpoint: Checkpoint,
    name: str,
    track: Track,
    largest: int = LARGEST_TASK,
) -> Ends:
    """Apply ``function`` to all rows in tasks, reusing results of an earlier run.

    The rows of a task depend only on the total number of rows. The same program therefore processes
    the same rows for any number of workers.
    """
    rows = [np.asarray(x) for x in rows]
    count = len(rows[0])
    size = int(np.clip(-(-count // FEWEST_TASKS), 1, largest))
    tasks = [range(i, min(i + size, count)) for i in range(0, count, size)]
    parts: dict[int, Ends] = {}
    for i in range(len(tasks)):
        if (stored := checkpoint.load(f"{name}-{i}")) is not None:
            parts[i] = Ends(**stored)
            track.advance(len(tasks[i]))
    left = [i for i in range(len(tasks)) if i not in parts]
    # a partial last task is padded: one shape, one compilation
    given = [tuple(x[np.resize(tasks[i], size)] for x in rows) for i in left]
    host = jax.tree.map(np.asarray, shared)  # bodies may be on the device
    for at, ends in run(function, host, given):
        i = left[at]
        parts[i] = ends.rows(slice(0, len(tasks[i])))
        checkpoint.save(f"{name}-{i}", parts[i]._asdict())
        track.advance(len(tasks[i]), f"best rms so far {_least(parts, shared[1]):.4f}")
    return Ends.joined([parts[i] for i in range(len(tasks))]).forward()


def _least(parts: dict[int, Ends], points: Points) -> float:
    """Rms of the relative residuals of the best hypothesis, weighted by the errors."""
    best = min(parts.values(), key=lambda e: e.value.min())
    squares = best.squares[np.argmin(best.value)].sum()
    return float(np.sqrt(squares / np.sum(np.asarray(points.error) ** -2.0)))


def misfit(points: Points, squares: Floats, best: Floats) -> Floats:
    """χ² of hypotheses from their sums of squares (B, K).

    If errors are unknown, every hypothesis has its own noise levels. The χ² of the ``best`` (K,) is
    then about the number of points n, and that of another is larger by the factor exp(2Δ/n), where
    Δ is the difference of the objectives. The noise levels of the best would not do for the others:
    it may have fitted one curve too closely by chance.
    """
    if points.error_known:
        return squares.sum(axis=1)
    weight = np.asarray(points.noise).sum(axis=0) + PRIOR_POINTS
    level = best + PRIOR_SQUARES
    ratio = np.log((squares + PRIOR_SQUARES) / level) @ weight / weight.sum()
    return (best @ (weight / level)) * np.exp(ratio)


def residuals(points: Points, body: SmoothBody, ends: Ends) -> Floats:
    """Observed minus fitted flux of each row, relative, (B, T)."""
    spins = Spin(*map(jnp.asarray, ends[:3]))
    model = jax.jit(lambda p, b, s: jax.lax.map(lambda one: fitted(b, p, one), s))
    return np.asarray(points.flux - model(points, body, spins))
