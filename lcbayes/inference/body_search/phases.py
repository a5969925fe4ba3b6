"""The second step: the motion with a free phase of each arc, and all parameters of the body.

All arcs lie at the same times in a light curve of their own, each since its middle, and a clock
offset of each arc is its phase. The number of turns between arcs then plays no part: the posterior
has no more optima than that of a single arc.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import search
from lcbayes.inference.body_search.cells import PHASES, Cells, MotionSearch, Table, joint, thinned
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.series import frame
from lcbayes.modelling.body_motion import product as product_of
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.nuisances import heavy_tailed, normal_of
from lcbayes.modelling.problem import Problem, compiled

Floats = NDArray[np.float64]

PHASE_STARTS = 8  # of a turn, for each of two arcs
STARTS = 1536
EPOCHS, MORE = 64, 192  # of an arc at least, and of all together, with the errors of the search
SHADED = 16  # optima without shadows, to which they are added
TURNED = 8  # phases of a turn by which those are then moved
EXACT = 24  # optima with the errors of the search that are followed with those of the data
ROUNDS = ((1.0, 3, 0.3), (1.0, 8, 0.3), (1.0, 25, 0.4))
SHADED_ROUNDS = ((1.0, 12, 0.3), (1.0, 30, 0.5))
EXACT_ROUNDS = ((1.0, 30, 0.5), (1.0, 100, 1.0))


class Start(NamedTuple):
    """A motion with a phase of each arc, and the surface.

    Attributes
    ----------
    attitude : (3, 3)
        Body to inertial, at the middle of the first arc.
    omega : (3,) rad/s
    late : (A,) s
        Time by which each arc is ahead of the first in phase.
    coefficients : (K,)
        Of the columns of the surface.
    cell : int
        From which it is.
    """

    attitude: Floats
    omega: Floats
    late: Floats
    coefficients: Floats
    cell: int


def starts(run: MotionSearch, cells: Cells) -> list[Start]:
    """Starts from the best distinct cells, from all pairs of phases of the two brightest arcs.

    The phases of other arcs are then the best, and so is the surface.
    """
    arcs = run.arcs
    bright = np.argsort(-np.asarray(jnp.sum(arcs.white**2, axis=1)), kind="stable")[:2]
    pairs = list(product(range(PHASE_STARTS), repeat=len(bright)))
    chosen = cells.at(run.distinct(cells, max(1, STARTS // len(pairs))))
    made: list[Start] = []
    held = tuple(int(a) for a in bright)
    given = jnp.asarray(np.array(pairs) * (PHASES // PHASE_STARTS), jnp.int32)
    for cell, (_, pole, axis, rate) in enumerate(zip(*chosen, strict=True)):
        axes, turn = np.asarray(frame(jnp.asarray(pole))), run.turns[axis]
        waves = run.waves(np.array([rate]))
        settled = _settled(run, held, jnp.asarray(pole)[None], jnp.asarray(turn), waves, given)
        phases, x = (np.asarray(v) for v in settled)
        for row in range(len(pairs)):
            angle = 2.0 * np.pi * phases[:, row] / PHASES
            about = Rotation.from_rotvec([0.0, 0.0, angle[0]]).as_matrix()
            apart = (angle - angle[0] + np.pi) % (2.0 * np.pi) - np.pi
            made.append(Start(axes @ about @ turn, rate * pole, apart / rate, x[:, row], cell))
    return made


@partial(jax.jit, static_argnums=(0, 1))
def _settled(run: MotionSearch, held: tuple[int, ...], pole, turn, waves, given) -> tuple[Any, Any]:
    """Phases (A, n) of all arcs and coefficients (K, n), for phases (n, 2) of the arcs held."""

    def wide(x: jax.Array) -> jax.Array:
        return jnp.broadcast_to(x[:, 0], (len(x), len(given), PHASES))

    tables: list[Table] = [
        (wide(cross), wide(square)) for cross, square in run.tables(pole, turn, waves)
    ]
    first = [jnp.zeros(len(given), jnp.int32)] * len(tables)
    for a, phase in zip(held, given.T, strict=True):
        first[a] = phase
    _, phases, x = joint(run, tables, first, held)
    return jnp.stack(phases), jnp.stack(x)


@dataclass(frozen=True)
class Separate:
    """The arcs of a light curve as one in which each has a phase of its own.

    Attributes
    ----------
    soft, exact : Epochs
        With the errors of the search and fewer points, and with those of the data.
    clock_sd : s
        Prior standard deviation of the offset of an arc: several turns.
    middle : (A,) s
        Of the arcs.
    """

    soft: Epochs
    exact: Epochs
    clock_sd: float
    middle: Floats

    @classmethod
    def of(cls, run: MotionSearch, unit: float) -> Separate:
        """The arcs of a search, with the flux in a unit (m²)."""
        soft = _epochs(thinned(run.arcs, EPOCHS, MORE), unit)
        exact = _epochs(run.exact, unit)
        return cls(soft, exact, 2.0 * np.pi / run.step, np.asarray(run.arcs.middle))

    @property
    def several(self) -> bool:
        """Whether there are several arcs, so that they have offsets."""
        return len(self.middle) > 1

    def offsets(self, late: Floats) -> dict[str, Floats]:
        """The site of offsets (A,) in s."""
        if not self.several:
            return {}
        return {"clock_offset_unit": np.asarray(normal_of(np.append(late, 0.0) / self.clock_sd))}

    def late(self, unit: Floats) -> Floats:
        """The offsets (A + 1,) s of a site."""
        return np.asarray(self.clock_sd * heavy_tailed(unit))


def _epochs(arcs: Arcs, unit: float) -> Epochs:
    """All arcs at the same times, each with an observer of its own."""
    weight, dt = np.asarray(arcs.weight), np.asarray(arcs.dt)
    inside = weight > 0.0
    arc = np.nonzero(inside)[0]
    order = np.argsort(dt[inside], kind="stable")
    error = 1.0 / weight[inside][order] / unit
    flux = np.asarray(arcs.white)[inside][order] * error
    sun, obs = (np.asarray(x)[inside][order] for x in (arcs.sun, arcs.obs))
    t = dt[inside][order]
    curve = LightCurve(
        t=t - t[0],
        brightness=flux,
        error=error,
        sun=sun,
        obs=obs,
        frame="icrs",
        kind="flux",
        free_scale=np.array([False]),
    )
    return replace(
        Epochs.of(curve),
        t=jnp.asarray(t),
        t_middle=jnp.asarray(0.0),
        observer=jnp.asarray(arc[order]),
        n_observers=len(arcs.middle),
        sun_rate=jnp.zeros_like(jnp.asarray(sun)),
        obs_rate=jnp.zeros_like(jnp.asarray(obs)),
    )


def rows(problem: Problem, data: Epochs, points: Sequence[Mapping[str, Any]]) -> jax.Array:
    """Unconstrained vectors (n, D) of sites; those that are missing are prior means."""
    missing = _means(problem, data, tuple(k for k in problem.names if k not in points[0]))
    every = [missing | dict(p) for p in points]
    return _raveled(problem, {k: np.array([p[k] for p in every], float) for k in problem.names})


@partial(jax.jit, static_argnums=(0, 2))
def _means(problem: Problem, data: Epochs, names: tuple[str, ...]) -> dict[str, jax.Array]:
    """Prior means of some sites."""
    trace = problem.trace({}, data)
    return {k: trace[k]["fn"].mean for k in names}


@partial(jax.jit, static_argnums=0)
def _raveled(problem: Problem, sites: Mapping[str, jax.Array]) -> jax.Array:
    return jax.vmap(problem.ravel)(dict(sites))


def turned(sites: Mapping[str, Any], by: Rotation) -> dict[str, Any]:
    """Sites of a motion after a rotation about ω."""
    moved = dict(sites)
    if "axis_base" in moved:
        moved["axis_base"] = moved["axis_base"] @ by.as_matrix().T
    else:
        quaternion = product_of(by.as_quat(scalar_first=True), moved["attitude_base"])
        moved["attitude_base"] = np.asarray(quaternion)
    return moved


def optimised(
    problem: Problem,
    separate: Separate,
    points: Sequence[Mapping[str, Any]],
    cells: NDArray[np.int64],
    workers: int,
    progress: Silent,
) -> SearchState:
    """Optima with the errors of the search, from sites, of several cells each of which has some."""
    every = rows(problem, separate.soft, points)
    return search.successive_halving(
        problem, separate.soft, every, workers, progress, rounds=ROUNDS, group=cells
    )


def with_shadows(
    problem: Problem,
    separate: Separate,
    ends: SearchState,
    images: Callable[[Floats], Floats],
    workers: int,
    progress: Silent,
) -> SearchState:
    """Optima of the body with its shadows from the best without, turned about the pole.

    Without shadows, some phases may fit nearly as well as others. ``images`` (n, D) → (n, K, D)
    are equivalent without them.
    """
    near = np.concatenate(images(np.asarray(ends.z)[search.different(ends, SHADED)]))
    moved = []
    for z in near:
        sites = dict(compiled(problem.constrain)(z, separate.soft))
        omega = np.asarray(sites["omega"])
        for k in range(TURNED):
            turn = Rotation.from_rotvec(2.0 * np.pi * k / TURNED * omega / np.linalg.norm(omega))
            moved.append(turned({n: np.asarray(sites[n]) for n in problem.names}, turn))
    every = rows(problem, separate.soft, moved)
    return search.successive_halving(
        problem, separate.soft, every, workers, progress, rounds=SHADED_ROUNDS
    )


def followed(
    problem: Problem, separate: Separate, ends: SearchState, workers: int, progress: Silent
) -> SearchState:
    """The best optima with the errors of the data."""
    near = np.asarray(ends.z)[search.different(ends, EXACT)]
    return search.successive_halving(
        problem, separate.exact, near, workers, progress, rounds=EXACT_ROUNDS
    )
