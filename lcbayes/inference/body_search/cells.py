"""The first step: poles, body axes and rates, with the best phase of each arc and the best surface.

For each pole and body axis, the flux at each epoch is a periodic function of the phase, for each of
the columns of `surface`. Within an arc, the normal equations of a fit of their coefficients are
Fourier series in the phase for every rate, so that one matrix product gives them for all rates and
phases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.threads import threads
from lcbayes.inference.body_search.nodes import Nodes
from lcbayes.inference.body_search.surface import REACH, Surface, solved
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.cells import Coverage
from lcbayes.inference.spin_search.series import frame
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.bodies import facets

Floats = NDArray[np.float64]
type Waves = tuple[jax.Array, jax.Array]  # (m, N, R), (2 m, N, R)
type Table = tuple[jax.Array, jax.Array]  # Σ F_i y/σ², Σ F_i F_j/σ² with i ≤ j

POLES = 500  # over the sphere, 9° apart
AXES = 300  # directions in the body that may be along the pole, 12° apart
MANY_AXES = 30  # above which the surface has one unknown combination of reflectances
CONE_DEG = 7.5  # between such directions of a body with an axis of symmetry
STEP = 1.0  # rad: spacing of rates times the duration by which they are distinguished
PHASES = 64
HARMONICS = 15  # of the flux, so that those of its square, 30, are known from these phases
EPOCHS, MORE = 96, 384  # of an arc at least, and of all arcs together if that is more
PROBED = 100  # poles that show whether the errors are too large
SOFTNESS = 0.3  # relative error of each point: shadows, width of lobes, glints of wrong attitudes
MODEL_ERROR = 0.1  # of the cells' width, relative to the mean flux
TOO_SOFT = 0.25  # χ² of the best cell over the number of points, below which errors are reduced
CHUNK = 16  # poles at once, for one axis
KEPT = 200  # cells of a chunk that are kept
CALIBRATED_SD = 0.5  # of the scale of a body whose brightness is calibrated
ROUNDS = 3  # of phases and coefficients in turn


class Cells(NamedTuple):
    """Cells of pole, body axis and rate, best first.

    Attributes
    ----------
    gain : (n,)
        Decrease of χ² from a dark body, with the errors of the search, by the best phases.
    pole : (n, 3)
    axis : (n,) int
        Index of the orientation of the body about the pole.
    rate : (n,) rad/s
    """

    gain: Floats
    pole: Floats
    axis: NDArray[np.int64]
    rate: Floats

    def at(self, rows: NDArray[np.int64]) -> Cells:
        """Some of the cells."""
        return Cells(self.gain[rows], self.pole[rows], self.axis[rows], self.rate[rows])


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


@dataclass(frozen=True, eq=False)
class MotionSearch:
    """A light curve's arcs and a body, ready to be searched.

    Attributes
    ----------
    surface : Surface
    exact : Arcs
        With at most `EPOCHS` points each, or `MORE` together, and their own errors.
    arcs : Arcs
        The same with the errors of the search.
    nodes : Nodes
        Of the arcs.
    turns : (n, 3, 3)
        Rotations from body axes to those of the spin, whose z axis is the pole.
    allowed : Allowed
        The spins that the prior allows.
    rates : (R,) rad/s
        Those allowed that one arc tells apart.
    step : rad/s
        Between them, where they are neighbours.
    scale : float
        Typical factor s on the flux, with a standard deviation ``scale_sd``.
    """

    surface: Surface
    exact: Arcs
    arcs: Arcs
    nodes: Nodes
    turns: Floats
    allowed: Allowed
    rates: Floats
    step: float
    scale: float
    scale_sd: float

    @classmethod
    def of(
        cls, data: Epochs, surface: Surface, directions: Floats, allowed: Allowed
    ) -> MotionSearch:
        fastest = allowed.fastest
        exact = thinned(Arcs.of(Points.of(data), fastest, 0.0))
        step = STEP / max(exact.duration, STEP / fastest)
        rates: Floats = np.concatenate([_middles(*r, step) for r in allowed.ranges])
        arcs = softened(exact)
        scale, sd = 1.0, CALIBRATED_SD
        if not data.calibrated:
            weight = np.asarray(arcs.weight)
            observed = np.sqrt(float(jnp.sum(arcs.white**2)) / np.sum(weight**2))
            scale = sd = observed / surface.brightness
        turns = toward_pole(directions)
        nodes = Nodes.of(arcs)
        return cls(surface, exact, arcs, nodes, turns, allowed, rates, step, scale, sd)

    def sharper(self, best: float) -> MotionSearch | None:
        """The search with smaller errors, if those of the first leave too little of the data.

        A light curve without glints is fitted to a few per cent by many wrong motions.
        """
        inside = int(jnp.sum(self.arcs.weight > 0.0))
        left = (float(jnp.sum(self.arcs.white**2)) - best) / inside
        if left > TOO_SOFT:
            return None
        return replace(self, arcs=softened(self.exact, float(np.sqrt(max(left, 0.01)))))

    def waves(self, rates: Floats) -> list[Waves]:
        """Of each arc, Σ y h_n exp(i m r dt)/σ² and Σ h_n exp(i m r dt)/σ² over the points.

        h_n is the share of node n, and y the flux.
        """
        m = np.arange(2 * HARMONICS + 1)[:, None, None]
        found: list[Waves] = []
        rows = (np.asarray(x) for x in (self.arcs.dt, self.arcs.weight, self.arcs.white))
        for dt, weight, white, share in zip(*rows, self.nodes.share, strict=True):
            turned = np.exp(1j * m * rates * dt[:, None])
            first, second = (
                np.einsum("nl,mlr->mnr", share * w, turned[: most + 1], optimize=True)
                for w, most in ((weight * white, HARMONICS), (weight**2, 2 * HARMONICS))
            )
            found.append((jnp.asarray(first, jnp.complex64), jnp.asarray(second, jnp.complex64)))
        return found

    def run(
        self, workers: int, progress: Silent, poles: Floats | None = None
    ) -> tuple[Cells, Coverage]:
        """The best cells of all poles, or some of them, and of all axes and rates."""
        poles = facets.grid(POLES) if poles is None else poles
        total = len(self.turns) * len(poles)
        jobs = [
            (axis, poles[i : i + CHUNK])
            for axis in range(len(self.turns))
            for i in range(0, len(poles), CHUNK)
        ]
        waves = self.waves(self.rates)
        with (
            progress.stage("searching motions", total, "poles") as bar,
            threads(workers) as pool,
        ):

            def one(job: tuple[int, Floats]) -> Cells:
                cells = self.chunk(*job, waves)
                bar.advance(len(job[1]))
                return cells

            parts = list(pool.map(one, jobs))
        columns: list[Any] = [np.concatenate(x) for x in zip(*parts, strict=True)]
        merged = Cells(*columns)
        merged = merged.at(np.argsort(-merged.gain, kind="stable"))
        fine = max(1, round(self.allowed.width * float(self.arcs.span[-1]) / STEP))
        cells = total * max(fine, len(self.rates)) * PHASES
        coarse = total * len(self.rates)
        ranges = () if self.allowed.everything else self.allowed.ranges
        return merged, Coverage(self.allowed.fastest, cells, coarse, len(merged.gain), ranges)

    def chunk(self, axis: int, poles: Floats, waves: list[Waves]) -> Cells:
        """The best cells of one axis and some poles."""
        padded = jnp.asarray(np.resize(poles, (CHUNK, 3)))
        gain = np.asarray(_visited(self, padded, jnp.asarray(self.turns[axis]), waves))[
            : len(poles)
        ]
        best = np.argsort(-gain, axis=None, kind="stable")[:KEPT]
        pole, rate = np.unravel_index(best, gain.shape)
        return Cells(gain[pole, rate], poles[pole], np.full(best.size, axis), self.rates[rate])

    def distinct(self, cells: Cells, most: int) -> NDArray[np.int64]:
        """Rows of cells that are not next to a better one, best first."""
        kept: list[int] = []
        for i in range(len(cells.gain)):
            near = (
                (cells.axis[kept] == cells.axis[i])
                & (np.abs(cells.rate[kept] - cells.rate[i]) < 2.0 * self.step)
                & (cells.pole[kept] @ cells.pole[i] > np.cos(np.deg2rad(12.0)))
            )
            if not near.any():
                kept.append(i)
            if len(kept) == most:
                break
        return np.array(kept, int)

    def tables(self, poles: jax.Array, turn: jax.Array, waves: list[Waves]) -> list[Table]:
        """Normal equations of each arc, (K, P, R, phases) and (K (K + 1)/2, P, R, phases)."""
        tables: list[Table] = []
        for sun, obs, both in zip(self.nodes.sun, self.nodes.obs, waves, strict=True):
            flux = _harmonics(self.surface, poles, turn, jnp.asarray(sun), jnp.asarray(obs))
            sums = (jnp.einsum("pnmk,mnr->kprm", *x) for x in zip(flux, both, strict=True))
            cross, square = (PHASES * jnp.fft.irfft(x, PHASES, axis=-1) for x in sums)
            tables.append((cross.astype(jnp.float32), square.astype(jnp.float32)))
        return tables

    def best(self, cross: jax.Array, square: jax.Array) -> list[jax.Array]:
        """The coefficients of the columns that fit best, K arrays, within reach of the prior."""
        size = self.surface.size
        precision = self._precision
        left = [
            [square[_row(i, j, size)] + (precision[i] if i == j else 0.0) for j in range(size)]
            for i in range(size)
        ]
        right = [cross[i] + (precision[0] * self.scale if i == 0 else 0.0) for i in range(size)]
        first, *others = solved(left, right)
        first = jnp.maximum(first, 0.0)
        return [first, *(jnp.clip(x, -REACH * first, REACH * first) for x in others)]

    @property
    def _precision(self) -> list[float]:
        return [self.scale_sd**-2] + [self.scale**-2] * (self.surface.size - 1)

    def gain(
        self, x: Sequence[jax.Array], cross: jax.Array, square: jax.Array, share: float = 1.0
    ) -> jax.Array:
        """Decrease of χ², with a share of the prior, by coefficients of the columns."""
        size = len(x)
        total = jnp.zeros(())
        for i in range(size):
            own = share * self._precision[i]
            mean = own * self.scale if i == 0 else 0.0
            total += 2.0 * x[i] * (cross[i] + mean)
            total -= x[i] ** 2 * (square[_row(i, i, size)] + own)
            for j in range(i + 1, size):
                total -= 2.0 * x[i] * x[j] * square[_row(i, j, size)]
        return total - share * self._precision[0] * self.scale**2


def visited(
    run: MotionSearch, workers: int, progress: Silent
) -> tuple[MotionSearch, Cells, Coverage]:
    """The search with the errors that some poles show to be suitable, and its best cells."""
    some, _ = run.run(workers, progress, facets.grid(PROBED))
    run = run.sharper(float(some.gain.max(initial=0.0))) or run
    return run, *run.run(workers, progress)


def _middles(low: float, high: float, step: float) -> Floats:
    """Middles of equal intervals that are no longer than a step."""
    n = max(1, int(np.ceil((high - low) / step)))
    return low + (np.arange(n) + 0.5) * (high - low) / n


def _row(i: int, j: int, size: int) -> int:
    """Index of the product of two columns."""
    i, j = min(i, j), max(i, j)
    return i * size - i * (i - 1) // 2 + j - i


def thinned(arcs: Arcs, each: int = EPOCHS, together: int = MORE) -> Arcs:
    """The arcs with at most a number of points each, or a number together, evenly chosen."""
    length, most = arcs.dt.shape[1], max(each, together // len(arcs.middle))
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
    arc = jnp.arange(len(rows))[:, None]
    thin: dict[str, Any] = {
        name: getattr(arcs, name)[arc, picked] for name in ("dt", "sun", "obs", "weight", "white")
    }
    return Arcs(arcs.middle, arcs.span, **thin)


def softened(arcs: Arcs, factor: float = 1.0) -> Arcs:
    """The arcs with the errors of the search, or these times a factor."""
    weight = np.asarray(arcs.weight)
    inside = weight > 0.0
    error = 1.0 / np.where(inside, weight, 1.0)
    flux = np.asarray(arcs.white) * error
    floor = MODEL_ERROR * abs(float(flux[inside].mean()))
    soft = jnp.asarray(inside / np.sqrt(error**2 + factor**2 * ((SOFTNESS * flux) ** 2 + floor**2)))
    return replace(arcs, weight=soft, white=jnp.asarray(flux) * soft)


def at_phase(table: jax.Array, phase: jax.Array) -> jax.Array:
    """The entries (K, ...) of a table (K, ..., phases) at one phase of each cell."""
    return jnp.take_along_axis(table, phase[None, ..., None], axis=-1)[..., 0]


@partial(jax.jit, static_argnums=0)
def _visited(run: MotionSearch, poles, turn, waves) -> jax.Array:
    """The gain (P, R) by the best phase of each arc and the best coefficients of all together."""
    tables = run.tables(poles, turn, waves)
    phases = [
        jnp.argmax(run.gain(run.best(*table), *table), axis=-1).astype(jnp.int32)
        for table in tables
    ]
    return joint(run, tables, phases)[0]


def joint(
    run: MotionSearch, tables: Sequence[Table], phases: list[jax.Array], held: Sequence[int] = ()
) -> tuple[jax.Array, list[jax.Array], list[jax.Array]]:
    """Gain (...), phases and coefficients of all arcs together, in turn, from phases (...) of each.

    The phases of the arcs ``held`` stay as they are.
    """
    own = [run.best(*(at_phase(x, p) for x in t)) for t, p in zip(tables, phases, strict=True)]
    first = [own[a] for a in held or range(len(own))]
    x = [jnp.mean(jnp.stack(parts), axis=0) for parts in zip(*first, strict=True)]
    gain = jnp.zeros(())
    for _ in range(ROUNDS):
        wide = [v[..., None] for v in x]
        for a, table in enumerate(tables):
            if a not in held:
                gains = run.gain(wide, *table, share=0.0)
                phases[a] = jnp.argmax(gains, axis=-1).astype(jnp.int32)
        picked = [[at_phase(x, p) for x in t] for t, p in zip(tables, phases, strict=True)]
        cross, square = (jnp.sum(jnp.stack(parts), axis=0) for parts in zip(*picked, strict=True))
        x = run.best(cross, square)
        gain = run.gain(x, cross, square)
    return gain, phases, x


def _harmonics(surface: Surface, poles, turn, sun, obs) -> Table:
    """Fourier coefficients (P, N, m, K) in the phase of F, and of the products of two of them.

    F is smoothed by its first harmonics with Lanczos's factors, and then multiplied: the gain of a
    cell would exceed χ² if F and its products were cut off each on its own. Between nodes, products
    are interpolated too. They exceed those of the interpolated flux, so that gains are a little too
    small there and never too large.
    """
    order = jnp.arange(HARMONICS + 1)
    taper = jnp.sinc(order / (HARMONICS + 1.0))[:, None]
    phase = 2.0 * jnp.pi * jnp.arange(PHASES) / PHASES
    c, s, zero = jnp.cos(phase), jnp.sin(phase), jnp.zeros(PHASES)
    one = jnp.ones(PHASES)
    back = jnp.stack([c, s, zero, -s, c, zero, zero, zero, one], axis=1).reshape(-1, 3, 3)
    pairs = [(i, j) for i in range(surface.size) for j in range(i, surface.size)]

    def of(pole):
        axes = frame(pole)

        def turned(v):
            body = jnp.einsum("kij,nj->nki", back, v @ axes) @ turn  # (N, phases, 3)
            return body.reshape(-1, 3)

        f = surface.columns(turned(sun), turned(obs)).reshape(-1, PHASES, surface.size)
        first = jnp.fft.rfft(f, axis=1)[:, : HARMONICS + 1] * taper
        smooth = jnp.fft.irfft(first, PHASES, axis=1)
        products = jnp.stack([smooth[..., i] * smooth[..., j] for i, j in pairs], axis=-1)
        second = jnp.fft.rfft(products, axis=1)[:, : 2 * HARMONICS + 1]
        return tuple(x.astype(jnp.complex64) / PHASES for x in (first, second))

    return jax.lax.map(of, poles)
