"""The search for the motion of a body of known shape.

The unknowns are the pole, the rate, the phase and, unless the spin is flat, which axis of the body
is along the pole. All are visited:

1. For each pole and body axis, the flux at each epoch is a periodic function of the phase. Within
   an arc, the sums over epochs that a fit with free scale needs are Fourier series in the phase for
   every rate, so that one matrix product gives them for all rates and phases. The best phases of
   all arcs together are an upper bound for a constant spin.
2. The cells of pole, axis and rate with the largest bounds are divided into the rates and phases
   that all arcs tell apart together.
3. The best of these start an optimisation of the posterior with all parameters, for a coarser body
   without shadows (`models.body`). The best end points are moved with the body and its shadows.

Unknown parameters of the surface have their prior medians in the first two steps, and the scale is
free. The directions of the pole and of the axis need a grid of fixed width, because turning ω turns
the attitudes of all epochs alike (`spin_search.cells`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.threads import threads
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.cells import Coverage
from lcbayes.inference.spin_search.series import frame
from lcbayes.modelling.body_motion import product
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.physics.bodies import facets

Floats = NDArray[np.float64]
type Flux = Callable[[jax.Array, jax.Array], jax.Array]

POLES = 500  # over the sphere, 9° apart
AXES = 300  # directions in the body that may be along the pole, 12° apart
CONE_DEG = 7.5  # between such directions of a body with an axis of symmetry
STEP = 1.0  # rad: spacing of rates times the duration by which they are distinguished
PHASES = 64
HARMONICS = 15  # of the flux, so that those of its square, 30, are known from these phases
EPOCHS, MORE = 96, 384  # of an arc at least, and of all arcs together if that is more
MODEL_ERROR = 0.1  # of the cells' width, shadows and unknown surface, relative to the mean flux
CHUNK = 16  # poles at once, for one axis
FAINTEST = 30.0  # a body that is fainter by this factor than in random attitudes is not expected
ATTITUDES, STRIDE = 32, 8  # random ones, at every so many epochs
REFINED = 12  # end points of the coarser body
HELD, HELD_STEPS = 4, 20  # times that shadows are moved, and steps after each
MARGIN = 100.0  # of χ² above three times that of the best cell, at which cells are dropped
LOOKUPS = 4e7  # of the second step, for each chunk
PER_CELL = 4  # rates of a cell that are kept
KEPT = 400  # cells of a chunk that are kept
STARTS = 96
# Added between arcs: half turns, too, after which many bodies look nearly the same.
TURNS = (-8, -5, -3, -2, -1.5, -1, -0.5, 0.5, 1, 1.5, 2, 3, 5, 8)
# Optima of which turns are added or taken away.
CLIMB = search.Climb(most=4, rounds=4, halving=((1.0, 12, 0.3), (1.0, 100, 1.0)))
ROUNDS = ((1.0, 10, 0.3), (1.0, 25, 0.4), (1.0, 150, 1.0))


class Motions(NamedTuple):
    """Candidate motions, best first.

    Attributes
    ----------
    gain : (n,)
        Decrease of χ² from a dark body, with the errors of the search.
    pole : (n, 3)
    axis : (n,) int
        Index of the orientation of the body about the pole.
    rate : (n,) rad/s
    phase : (n,) rad
        In the middle of the light curve.
    scale : (n,)
        The best factor on the flux.
    """

    gain: Floats
    pole: Floats
    axis: NDArray[np.int64]
    rate: Floats
    phase: Floats
    scale: Floats

    def at(self, rows: NDArray[np.int64]) -> Motions:
        gain, pole, axis, *others = self
        return Motions(gain[rows], pole[rows], axis[rows], *(x[rows] for x in others))


def toward_pole(directions: Floats) -> Floats:
    """Rotations (n, 3, 3) that take unit vectors of the body to the z axis of the spin."""
    return np.stack([np.asarray(frame(jnp.asarray(d))).T for d in directions])


def directions_of(
    flat_axis: Floats | None, symmetry_axis: Floats | None, rotations: Floats
) -> Floats:
    """Body directions (n, 3) that may be along the pole, one of each that look the same.

    Parameters
    ----------
    flat_axis : (3,) or None
        The only one of a flat spin, with its opposite.
    symmetry_axis : (3,) or None
        An axis about which any rotation changes nothing.
    rotations : (G, 3, 3)
        That change nothing.
    """
    if flat_axis is not None:
        every = np.stack([flat_axis, -flat_axis])
        flips = any(g @ flat_axis @ flat_axis < -1.0 + 1e-6 for g in rotations)
        return every[:1] if flips else every
    if symmetry_axis is not None:
        flips = any(g @ symmetry_axis @ symmetry_axis < -1.0 + 1e-6 for g in rotations)
        largest = 90.0 if flips else 180.0
        n = int(np.ceil(largest / CONE_DEG))
        angle = np.deg2rad((np.arange(n) + 0.5) * largest / n)[:, None]
        across = facets.across(symmetry_axis)[0]
        return np.cos(angle) * symmetry_axis + np.sin(angle) * across
    grid = facets.grid(AXES)
    generic = np.array([0.83, 0.41, 0.19])
    height = np.stack([grid @ g.T @ generic for g in rotations])
    return grid[height[0] >= height.max(axis=0) - 1e-12]


@dataclass(frozen=True)
class MotionSearch:
    """A light curve's arcs and a body, ready to be searched.

    Attributes
    ----------
    flux : (sun_body, obs_body) → flux (T,)
    arcs : Arcs
        With at most `EPOCHS` points each, or `MORE` together.
    turns : (n, 3, 3)
        Rotations from body axes to those of the spin, whose z axis is the pole.
    allowed : Allowed
        The spins that the prior allows.
    rates : (R,) rad/s
        Those allowed that one arc tells apart.
    step : rad/s
        Between them, where they are neighbours.
    middle : s
        At which the phases count.
    weak : float
        Information on the scale without data. A body that is dark would need an endless scale.
    """

    flux: Flux
    arcs: Arcs
    turns: Floats
    allowed: Allowed
    rates: Floats
    step: float
    middle: float
    weak: float

    @classmethod
    def of(cls, data: Epochs, flux: Flux, directions: Floats, allowed: Allowed) -> MotionSearch:
        fastest = allowed.fastest
        arcs = thinned(Arcs.of(Points.of(data), fastest, MODEL_ERROR))
        n = max(1, int(np.ceil(fastest * max(arcs.duration, 1e-9) / STEP)))
        step = fastest / n
        rates: Floats = np.asarray((np.arange(n) + 0.5) * step, float)
        rates = rates[allowed.rates(rates, 0.5 * step)]
        any_turn = jnp.asarray(Rotation.random(ATTITUDES, rng=np.random.default_rng(0)).as_matrix())
        sun, obs = (v[:, ::STRIDE].reshape(-1, 3) for v in (arcs.sun, arcs.obs))
        seen = jax.jit(lambda turn: flux(sun @ turn, obs @ turn))
        square = float(jnp.mean(jax.lax.map(seen, any_turn) ** 2) * jnp.sum(arcs.weight**2))
        middle = float(data.t_middle)
        weak = square / FAINTEST**2
        return cls(flux, arcs, toward_pole(directions), allowed, rates, step, middle, weak)

    @property
    def fine(self) -> Floats:
        """Rates that all arcs together tell apart, within a step, rad/s."""
        span = float(self.arcs.span[-1])
        n = max(1, int(np.ceil(self.step * span / STEP)))
        return ((np.arange(n) + 0.5) / n - 0.5) * self.step

    def least(self, best: float) -> float:
        """The gain at which a cell is dropped, given the best one."""
        left = float(jnp.sum(self.arcs.white**2)) - best
        return best - 2.0 * left - MARGIN

    @cached_property
    def waves(self) -> list[NDArray[np.complex64]]:
        """exp(i m r dt) of each arc, (m, L, R)."""
        m = np.arange(2 * HARMONICS + 1)[:, None, None]
        return [
            np.exp(1j * m * (self.rates * np.asarray(dt)[:, None])).astype(np.complex64)
            for dt in self.arcs.dt
        ]

    def run(self, workers: int, progress: Silent) -> tuple[Motions, Coverage]:
        """The best motions over all poles, axes, rates and phases."""
        poles = facets.grid(POLES)
        jobs = [
            (axis, poles[i : i + CHUNK])
            for axis in range(len(self.turns))
            for i in range(0, POLES, CHUNK)
        ]
        best = [0.0]
        parts: list[Motions] = []
        with (
            progress.stage("searching motions", len(jobs) * CHUNK, "poles") as bar,
            threads(workers) as pool,
        ):

            def one(job: tuple[int, Floats]) -> Motions:
                motions = self.chunk(*job, self.least(best[0]))
                best[0] = max(best[0], float(motions.gain.max(initial=0.0)))
                bar.advance(len(job[1]))
                return motions

            parts = list(pool.map(one, jobs))
        columns: list[Any] = [np.concatenate(x) for x in zip(*parts, strict=True)]
        merged = Motions(*columns)
        order = np.argsort(-merged.gain, kind="stable")
        merged = merged.at(order[merged.gain[order] > self.least(best[0])])
        fine = int(self.allowed.rates(self.rates[:, None] + self.fine).sum())
        cells = len(jobs) * CHUNK * fine * PHASES
        coarse = len(jobs) * CHUNK * len(self.rates)
        ranges = () if self.allowed.everything else self.allowed.ranges
        return merged, Coverage(self.allowed.fastest, cells, coarse, len(merged.gain), ranges)

    def chunk(self, axis: int, poles: Floats, least: float) -> Motions:
        """The best cells of one axis and some poles with a gain that may exceed ``least``."""
        n = len(poles)
        padded = np.resize(poles, (CHUNK, 3))
        tables = [
            _tables(self, padded, jnp.asarray(self.turns[axis]), a)
            for a in range(len(self.arcs.middle))
        ]
        each = self.weak / len(tables)
        bound = np.sum([_gain(*t, each).max(axis=2) for t in tables], axis=0)[:n]
        fine = self.fine
        most = max(16, int(LOOKUPS / (fine.size * PHASES * len(tables))))
        order = np.argsort(-bound, axis=None, kind="stable")[:most]
        order = order[bound.ravel()[order] > least]
        pole, rate = np.unravel_index(order, bound.shape)
        if not order.size:
            nothing = np.zeros(0)
            return Motions(
                nothing, np.zeros((0, 3)), nothing.astype(int), nothing, nothing, nothing
            )
        gain, scale, which, phase = self._divided(tables, pole, rate, fine)
        keep = np.argsort(-gain, axis=None, kind="stable")[:KEPT]
        cell, column = np.unravel_index(keep, gain.shape)
        rates = self.rates[rate[cell]] + fine[which[cell, column]]
        return Motions(
            gain[cell, column],
            poles[pole[cell]],
            np.full(keep.size, axis),
            rates,
            2.0 * np.pi * phase[cell, column] / PHASES,
            scale[cell, column],
        )

    def _divided(self, tables, pole, rate, fine) -> tuple[NDArray, ...]:
        """Gain, scale, index in ``fine`` and phase of the best rates of cells, (n, `PER_CELL`)."""
        middle = np.asarray(self.arcs.middle) - self.middle
        parts: list[tuple[NDArray, ...]] = []
        k = np.arange(PHASES)
        mixed = 1.0 + 1e-3 * np.random.default_rng(0).uniform(-1.0, 1.0, fine.size)
        block = max(1, int(2e6 / (fine.size * PHASES)))
        for start in range(0, pole.size, block):
            p, r = pole[start : start + block], rate[start : start + block]
            exact = self.rates[r][:, None] + fine
            cross = np.zeros((p.size, fine.size, PHASES), np.float32)
            square = np.zeros_like(cross)
            for (fy, ff), t in zip(tables, middle, strict=True):
                shift = np.rint(exact * t * PHASES / (2.0 * np.pi)).astype(int)
                index = (k + shift[..., None]) % PHASES
                cross += np.take_along_axis(fy[p, r][:, None], index, axis=2)
                square += np.take_along_axis(ff[p, r][:, None], index, axis=2)
            gain = _gain(cross, square, self.weak)
            gain[~self.allowed.rates(exact)] = -np.inf
            phase = gain.argmax(axis=2)
            top = np.take_along_axis(gain, phase[..., None], axis=2)[..., 0]
            # Rates that differ by whole turns between arcs have the same gain.
            which = np.argsort(-top * mixed, axis=1, kind="stable")[:, :PER_CELL]
            chosen = np.take_along_axis(phase, which, axis=1)
            rows = np.arange(p.size)[:, None]
            scale = cross[rows, which, chosen] / (square[rows, which, chosen] + self.weak)
            parts.append((np.take_along_axis(top, which, axis=1), scale, which, chosen))
        return tuple(np.concatenate(x) for x in zip(*parts, strict=True))


def thinned(arcs: Arcs) -> Arcs:
    """The arcs with at most `EPOCHS` points each, or `MORE` together, evenly chosen."""
    length, most = arcs.dt.shape[1], max(EPOCHS, MORE // len(arcs.middle))
    if length <= most:
        return arcs
    rng = np.random.default_rng(0)
    rows = []
    for weight in np.asarray(arcs.weight):
        inside = np.flatnonzero(weight > 0.0)
        n = min(most, inside.size)
        at = (np.arange(n) + rng.uniform(0.2, 0.8, n)) * inside.size / n
        chosen = inside[at.astype(int)]
        dark = np.flatnonzero(weight == 0.0)
        spare = dark[: most - n] if dark.size else chosen[:0]
        rows.append(np.concatenate([chosen, spare]))
    width = min(len(r) for r in rows)
    picked = jnp.asarray(np.stack([r[:width] for r in rows]))
    each = jnp.arange(len(rows))[:, None]
    thin: dict[str, Any] = {
        name: getattr(arcs, name)[each, picked] for name in ("dt", "sun", "obs", "weight", "white")
    }
    return Arcs(arcs.middle, arcs.span, **thin)


def _gain(cross, square, weak: float):
    """Decrease of χ² by the best scale, which is not negative."""
    return np.maximum(cross, 0.0) ** 2 / (np.maximum(square, 0.0) + weak)


def _tables(run: MotionSearch, poles: Floats, turn: jax.Array, a: int) -> tuple[NDArray, NDArray]:
    """Σ F y/σ² and Σ F²/σ² of an arc for each pole, rate and phase at its middle, (P, R, K)."""
    arcs = run.arcs
    first, second = (
        np.asarray(x)
        for x in _harmonics(
            run.flux, jnp.asarray(poles), turn, arcs.sun[a], arcs.obs[a], arcs.weight[a]
        )
    )
    white = np.asarray(arcs.white[a], np.float32)
    wave = run.waves[a]
    tables = []
    for series, factor in ((first, white), (second, np.ones_like(white))):
        weighted = np.ascontiguousarray((series * factor[:, None]).transpose(2, 0, 1))  # (m, P, L)
        total = np.matmul(weighted, wave[: len(weighted)]).transpose(1, 2, 0)  # (P, R, m)
        tables.append(PHASES * np.fft.irfft(total, PHASES, axis=2).astype(np.float32))
    return tables[0], tables[1]


@partial(jax.jit, static_argnums=0)
def _harmonics(flux: Flux, poles, turn, sun, obs, weight):
    """Fourier coefficients (P, L, m) in the phase of F/σ and (F/σ)².

    F is smoothed by its first harmonics with Lanczos's factors, and then squared: the gain of a
    cell would exceed χ² if F and its square were cut off each on its own.
    """
    order = jnp.arange(HARMONICS + 1)
    taper = jnp.sinc(order / (HARMONICS + 1.0))
    phase = 2.0 * jnp.pi * jnp.arange(PHASES) / PHASES
    c, s, zero = jnp.cos(phase), jnp.sin(phase), jnp.zeros(PHASES)
    one = jnp.ones(PHASES)
    back = jnp.stack([c, s, zero, -s, c, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)

    def of(pole):
        axes = frame(pole)

        def turned(v):
            body = jnp.einsum("kij,lj->lki", back, v @ axes) @ turn  # (L, K, 3)
            return body.reshape(-1, 3)

        f = flux(turned(sun), turned(obs)).reshape(-1, PHASES) * weight[:, None]
        smooth = jnp.fft.rfft(f, axis=1)[:, : HARMONICS + 1] * taper
        square = jnp.fft.rfft(jnp.fft.irfft(smooth, PHASES, axis=1) ** 2, axis=1)
        series = smooth, square[:, : 2 * HARMONICS + 1]
        return tuple(x.astype(jnp.complex64) / PHASES for x in series)

    return jax.lax.map(of, poles)


def attitudes(run: MotionSearch, motions: Motions) -> Floats:
    """Attitudes (n, 3, 3), body to inertial, in the middle of the light curve."""
    made = []
    for pole, axis, phase in zip(motions.pole, motions.axis, motions.phase, strict=True):
        c, s = np.cos(phase), np.sin(phase)
        about = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        made.append(np.asarray(frame(jnp.asarray(pole))) @ about @ run.turns[axis])
    return np.array(made)


def distinct(motions: Motions, span: float, most: int) -> NDArray[np.int64]:
    """Rows of motions that are not next to a better one, best first."""
    kept: list[int] = []
    for i in range(len(motions.gain)):
        near = [
            j
            for j in kept
            if motions.axis[i] == motions.axis[j]
            and abs(motions.rate[i] - motions.rate[j]) * span < 2.0 * STEP
            and motions.pole[i] @ motions.pole[j] > np.cos(np.deg2rad(12.0))
        ]
        if not near:
            kept.append(i)
        if len(kept) == most:
            break
    return np.array(kept, int)


def optimised(
    problem: Problem,
    data: Epochs,
    sites: Sequence[Mapping[str, Any]],
    run: MotionSearch,
    workers: int,
    progress: Silent,
) -> SearchState:
    """Optima of the posterior from starts; sites that a start lacks have their prior means.

    A rate may be wrong by turns, or half turns, in one of the gaps between arcs; such turns are
    added to the best optima, as long as that leads to a better one and the rate is allowed.
    """
    trace = problem.trace({}, data)
    others = {name: trace[name]["fn"].mean for name in problem.names if name not in sites[0]}
    rows = [
        problem.ravel({k: jnp.asarray(v, float) for k, v in (others | dict(s)).items()})
        for s in sites
    ]
    ends = search.successive_halving(
        problem, data, jnp.stack(rows), workers, progress, rounds=ROUNDS
    )
    turned = partial(_aliases, problem, data, run)
    return search.climbed(problem, data, ends, turned, CLIMB, workers, progress)


def refined(problem: Problem, data: Epochs, ends: SearchState, workers: int) -> SearchState:
    """The best end points for a coarser body, at optima of the posterior."""
    near = np.asarray(ends.z)[search.different(ends, REFINED)]
    return search.best_first(search.polish(problem, data, near, workers))


def with_shadows(
    problem: Problem,
    data: Epochs,
    ends: SearchState,
    held: Callable[[Floats], Epochs],
    images: Callable[[Floats], Floats],
    workers: int,
    progress: Silent,
) -> SearchState:
    """The best end points for a coarser body without shadows, near optima of the posterior.

    ``images`` (n, D) -> (n, K, D) are equivalent without shadows. ``held`` gives the epochs with
    the shadows of a point (D,), which are fixed while it is moved, a few times.
    """
    near = np.concatenate(images(np.asarray(ends.z)[search.different(ends, REFINED)]))
    potential = compiled(problem.potential)

    def one(z: Floats) -> SearchState:
        row = search.init(z[None])
        for _ in range(HELD):
            start = search.init(row.z, 1e-3)
            row = search.advance(problem, held(np.asarray(row.z[0])), start, HELD_STEPS)
            track.advance(HELD_STEPS)
        return row._replace(potential=potential(row.z[0], data)[None])

    total = len(near) * HELD * HELD_STEPS
    with progress.stage("adding shadows", total, "steps") as track, threads(workers) as pool:
        return search.joined(*pool.map(one, near))


def _aliases(problem: Problem, data: Epochs, run: MotionSearch, z: Floats) -> Iterator[Floats]:
    """Unconstrained vectors with turns added in a gap, and the attitude at its start unchanged."""
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    omega = sites["omega"]
    rate = float(np.linalg.norm(omega))
    for start, gap in gaps_between(run.arcs):
        for turns in TURNS:
            change = 2.0 * np.pi * turns / gap
            moved_rate = np.array([rate + change])
            if moved_rate[0] <= 0.0 or not run.allowed.rates(moved_rate).all():
                continue
            turn = -omega / rate * change * (start - float(data.t_middle))
            moved = {k: sites[k] for k in problem.names}
            for name in {"rate_unit", "omega_unit"} & moved.keys():
                moved[name] = moved[name] * (1.0 + change / rate)
            if "axis_base" in moved:
                moved["axis_base"] = moved["axis_base"] @ Rotation.from_rotvec(turn).as_matrix().T
            else:
                by = Rotation.from_rotvec(turn).as_quat(scalar_first=True)
                moved["attitude_base"] = np.asarray(product(by, moved["attitude_base"]))
            yield np.asarray(problem.ravel({k: jnp.asarray(v) for k, v in moved.items()}))


def gaps_between(arcs: Arcs) -> Floats:
    """Start and length (s) of the gaps between the middles of arcs, and of all together, (n, 2)."""
    middle = np.sort(np.asarray(arcs.middle))
    gaps = [(a, b - a) for a, b in pairwise(middle)]
    if len(gaps) > 1:
        gaps.append((middle[0], middle[-1] - middle[0]))
    return np.array(gaps).reshape(-1, 2)
