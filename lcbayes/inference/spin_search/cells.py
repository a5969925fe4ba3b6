"""Cells of pole and rate, visited from coarse to fine in time.

Turning ω by a small rotation R turns the attitude A(t) into R A(t) Rᵀ: an error of the direction of
ω remains bounded for all times, and only that of its rate grows with the time base. One grid of
poles therefore serves all times, and the cells multiply in one dimension.

Within an arc, the rate is rounded to one of a grid that the arc's duration resolves, and the normal
equations of each arc are formed once for each pole and such rate. The phase of the arc at the exact
rate turns them about the pole. Two arcs know the rate up to 2π over the time between them: the
phases between them are a few, however many turns lie between.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent, Track
from lcbayes.core.threads import threads
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.drift import NONE, Drift
from lcbayes.inference.spin_search.series import Response, Series, log_evidence
from lcbayes.physics.bodies import facets

Floats = NDArray[np.float64]

POLE_GRID = 500  # poles over the sphere, 9° apart
POLE_STEP = np.radians(9.0)
STEP = 1.0  # rad: spacing of rates times the duration by which they are distinguished
PHASE_STEP = 0.7  # rad: spacing of the phases between the first two arcs
BLOCK = 512  # cells of one pole in one program
SIZES = (16, 64, 256)  # numbers of coarse rates of one pole for which programs are compiled
BUDGET = 600_000  # most cells evaluated with the third arc; half as many with each further one
LEAST_BUDGET = 150_000  # but no fewer
MIN_KEPT = 2000  # cells divided at each level
MARGIN = 150.0  # nats below the best at which cells are dropped
STATES, CELLS, LEVEL, EVALUATED = "states", "cells", "level", "evaluated"  # in a checkpoint


class Cells(NamedTuple):
    """Cells of spin.

    Attributes
    ----------
    pole : (n,) int
        Index in the grid of poles.
    rate : (n,) rad/s
    width : rad/s
        Of the interval of rates that a cell stands for.
    score : (n,)
        ln evidence, up to a constant, plus ln of the prior density of ω.
    drift : (n,)
        In its prior sd at the rate: see `drift`.
    """

    pole: NDArray[np.int64]
    rate: Floats
    width: float
    score: Floats
    drift: Floats

    def kept(self, most: int, margin: float = MARGIN) -> Cells:
        """The best cells, best first."""
        order = np.argsort(-self.score, kind="stable")[:most]
        return self.at(order[self.score[order] > self.score[order[0]] - margin])

    def stored(self, level: int, evaluated: int) -> dict[str, NDArray]:
        """Arrays for a checkpoint, with the number of arcs and of evidences so far."""
        every = self._asdict() | {LEVEL: level, EVALUATED: evaluated}
        return {name: np.asarray(value) for name, value in every.items()}

    @classmethod
    def restored(cls, arrays: dict[str, NDArray]) -> Cells:
        """The cells of a checkpoint."""
        pole, rate, score, drift = (arrays[name] for name in ("pole", "rate", "score", "drift"))
        return cls(pole, rate, float(arrays["width"]), score, drift)

    def at(self, rows: NDArray[Any]) -> Cells:
        """Some of the cells, by index or mask."""
        pole, rate, _, score, drift = self
        return self._replace(pole=pole[rows], rate=rate[rows], score=score[rows], drift=drift[rows])


@dataclass(frozen=True)
class Coverage:
    """What a search covered.

    Attributes
    ----------
    max_rate : rad/s
        The fastest rate that was covered.
    cells : int
        Number of distinct cells of pole and rate over the whole time base.
    evaluated : int
        Number of evidences computed.
    survivors : int
        Cells left at the finest level.
    ranges : tuple of (rad/s, rad/s)
        Ranges of rates of known periods; empty if all spins up to ``max_rate`` were covered.
    sky : float
        Fraction of all poles.
    """

    max_rate: float
    cells: int
    evaluated: int
    survivors: int
    ranges: tuple[tuple[float, float], ...] = ()
    sky: float = 1.0

    def stored(self) -> dict[str, NDArray]:
        """Arrays for a checkpoint."""
        numbers = [self.max_rate, self.sky, self.cells, self.evaluated, self.survivors]
        return {"coverage": np.array([*numbers, *(x for r in self.ranges for x in r)])}

    @classmethod
    def restored(cls, arrays: dict[str, NDArray]) -> Coverage | None:
        """The coverage among the arrays of a checkpoint, from which it is removed, if there."""
        if "coverage" not in arrays:
            return None
        max_rate, sky, cells, evaluated, survivors, *ends = arrays.pop("coverage").tolist()
        ranges = tuple(zip(ends[::2], ends[1::2], strict=True))
        return cls(max_rate, int(cells), int(evaluated), int(survivors), ranges, sky)


class Found(NamedTuple):
    """What a search found.

    Attributes
    ----------
    cells : Cells
        Over the whole time base.
    states : Cells
        Over the first two arcs, in which a rate stands for all that differ by whole turns between
        these arcs. They are fewer, and reach further down in evidence.
    coverage : Coverage
    """

    cells: Cells
    states: Cells
    coverage: Coverage


@dataclass(frozen=True)
class Grid:
    """A light curve's arcs with the grids of poles and rates.

    Attributes
    ----------
    series : Series
    arcs : Arcs
    prior : (P,)
        Precisions of the harmonics.
    poles : (K, 3)
        Those allowed, and their neighbours.
    coarse : (n,) rad/s
        Rates that one arc tells apart.
    coarse_step : rad/s
        Spacing of the full grid of such rates, from the slowest allowed to the fastest.
    row : (m,) int
        Row in ``coarse`` of each rate of the full grid; for a rate that is not allowed, the nearest
        that is.
    allowed : Allowed
        The spins to visit.
    drift : Drift
    """

    series: Series
    arcs: Arcs
    prior: Floats
    poles: Floats
    coarse: Floats
    coarse_step: float
    row: NDArray[np.int64]
    allowed: Allowed
    drift: Drift = NONE

    @classmethod
    def of(
        cls, series: Series, arcs: Arcs, prior: Floats, allowed: Allowed, drift: Drift = NONE
    ) -> Grid:
        """The grids of the poles and rates that are allowed."""
        low, high = allowed.slowest, allowed.fastest
        n = max(1, int(np.ceil((high - low) * max(arcs.duration, 1e-9) / STEP)))
        step = (high - low) / n
        full = low + (np.arange(n) + 0.5) * (high - low) / n
        rows = np.flatnonzero(allowed.rates(full, 0.5 * step))
        nearest = np.abs(np.arange(n)[:, None] - rows).argmin(axis=1)
        poles = facets.grid(POLE_GRID)
        poles = poles[allowed.poles(poles, POLE_STEP)]
        return cls(series, arcs, prior, poles, full[rows], step, nearest, allowed, drift)

    @property
    def n_arcs(self) -> int:
        return self.arcs.middle.size

    def pairs(self) -> tuple[Floats, float]:
        """Rates that represent all phases between the first two arcs, and their width, rad/s."""
        if self.n_arcs == 1:
            return self.coarse, self.coarse_step  # of which all are allowed in part
        gap = self.gap
        turn = min(self.coarse_step * gap, 2 * np.pi)
        n = max(1, int(np.ceil(turn / PHASE_STEP)))
        offset = ((np.arange(n) + 0.5) / n - 0.5) * turn / gap
        rate, width = (self.coarse[:, None] + offset).ravel(), turn / gap / n
        if self.allowed.everything:
            return rate, width
        row, alias = self.aliases(rate)
        return rate[np.unique(row[self.allowed.rates(alias, 0.5 * width)])], width

    @property
    def gap(self) -> float:
        """Time between the middles of the first two arcs, s."""
        return float(abs(self.arcs.middle[1] - self.arcs.middle[0]))

    def aliases(self, rate: Floats) -> tuple[NDArray[np.int64], Floats]:
        """All rates in the coarse cell of each rate with its phase between the first two arcs.

        Returns the row of ``rate`` and the alias.
        """
        if self.n_arcs == 1 or self.coarse_step * self.gap <= 2 * np.pi:
            return np.arange(rate.size), rate
        turn = 2 * np.pi / self.gap
        n = int(np.ceil(self.coarse_step / turn))
        alias = rate[:, None] + turn * np.arange(-n, n + 1)
        centre = self.coarse[self.index(rate)]
        inside = np.abs(alias - centre[:, None]) <= 0.5 * self.coarse_step
        return np.nonzero(inside)[0], alias[inside]

    def index(self, rate: Floats) -> NDArray[np.int64]:
        """The coarse rate next to each rate."""
        full = ((rate - self.allowed.slowest) / self.coarse_step).astype(int)
        return self.row[np.clip(full, 0, self.row.size - 1)]

    def score(self, cells: Cells, n_arcs: int, workers: int, bar: Track) -> Floats:
        """Scores (n,) of cells from the first arcs."""
        pole, rate = cells.pole, cells.rate
        order = np.argsort(pole, kind="stable")
        poles, first = np.unique(pole[order], return_index=True)
        scores = np.empty(rate.size)
        middle = np.asarray(self.arcs.middle)
        # Phases count from the middle of the arcs in use: longitudes are free.
        reference = 0.5 * float(min(middle[:n_arcs]) + max(middle[:n_arcs]))
        phase = self.drift.phase(rate, cells.drift, middle) - reference * rate[:, None]

        def one(k: int, rows: NDArray[np.int64]) -> None:
            used, index = np.unique(self.index(rate[rows]), return_inverse=True)
            padded = np.resize(used, next((s for s in SIZES if s >= used.size), used.size))
            pairs = self.poles[k], self.coarse[padded], used.size, n_arcs
            tables = _tables(self.series, self.arcs, *pairs)
            for start in range(0, rows.size, BLOCK):
                part = np.arange(start, min(start + BLOCK, rows.size))
                padded = np.resize(part, BLOCK if rows.size > 64 else 64)
                at = phase[rows[padded]], index[padded]
                scored = _scores(self.series, tables, self.prior, *at, n_arcs)
                scores[rows[part]] = np.asarray(scored)[: part.size]
            bar.advance(rows.size)

        with threads(workers) as pool:
            list(pool.map(one, poles, np.split(order, first[1:])))
        return scores + self.allowed.log_prior(rate)

    def search(
        self, workers: int, progress: Silent, most: int, kept: Checkpoint | None = None
    ) -> Found:
        """The best cells over the whole time base and states of the first two arcs, best first.

        Both are saved in ``kept``, the cells of each level, from which an interrupted search goes
        on.
        """
        kept = kept or Checkpoint(None, {})
        rate, width = self.pairs()
        number = rate.size * len(self.poles)
        stored = kept.load(STATES)
        with progress.stage("searching spins", number if stored is None else 0, "cells") as bar:
            level, evaluated = min(2, self.n_arcs), number
            if stored is None:
                states = self.states(rate, width, workers, bar)
                kept.save(STATES, states.stored(level, evaluated))
            else:
                states = Cells.restored(stored)
            cells = self.with_aliases(states)
            if (stored := kept.load(CELLS)) is not None:
                level, evaluated = (int(stored[k]) for k in (LEVEL, EVALUATED))
                cells = Cells.restored(stored)
            for n_arcs in range(level + 1, self.n_arcs + 1):
                cells = self.divided(cells, n_arcs)
                bar.more(cells.rate.size)
                evaluated += cells.rate.size
                cells = cells._replace(score=self.score(cells, n_arcs, workers, bar))
                kept.save(CELLS, cells.stored(n_arcs, evaluated))
        cells = cells.kept(most)
        return Found(cells, states, self.coverage(evaluated, cells.rate.size))

    def states(self, rate: Floats, width: float, workers: int, bar: Track) -> Cells:
        """Cells of the first two arcs, in which each rate stands for all its aliases."""
        pole = np.repeat(np.arange(len(self.poles)), rate.size)
        rate = np.tile(rate, len(self.poles))
        cells = Cells(pole, rate, width, np.zeros(rate.size), np.zeros(rate.size))
        score = self.score(cells, min(2, self.n_arcs), workers, bar)
        return cells._replace(score=score).kept(_budget(2) // 2)

    def coverage(self, evaluated: int, survivors: int) -> Coverage:
        """What the cells cover."""
        allowed = self.allowed
        cells = int(len(self.poles) * allowed.width * float(self.arcs.span[-1]) / STEP)
        ranges = allowed.ranges if allowed.omega_sd is None else ()
        sky = 1.0 if allowed.pole is None else 1.0 - allowed.pole.cosine
        return Coverage(allowed.fastest, cells, evaluated, survivors, ranges, sky)

    def with_aliases(self, cells: Cells) -> Cells:
        """The best cells of the first two arcs, with every rate and drift that has their phase."""
        units = self.drift.units(PHASE_STEP) if self.n_arcs > 2 else np.zeros(1)
        number = max(1.0, self.coarse_step * self.gap / (2 * np.pi)) if self.n_arcs > 1 else 1.0
        cells = cells.kept(int(_budget(2) / (2 * number * len(units))))
        row, rate = self.aliases(cells.rate)
        cells = cells.at(np.repeat(row, len(units)))
        rate, drift = np.repeat(rate, len(units)), np.tile(units, len(rate))
        if self.drift.sd:
            between = np.diff(self.drift.phase(rate, drift, np.asarray(self.arcs.middle[:2])))
            rate = rate * rate * self.gap / np.abs(between[:, 0])
        cells = cells._replace(rate=rate, drift=drift)
        return cells.at(self.allowed.rates(cells.rate, 0.5 * cells.width))

    def divided(self, cells: Cells, n_arcs: int) -> Cells:
        """The best cells, divided into those that a further arc tells apart."""
        step = STEP / float(self.arcs.span[n_arcs - 1])
        number = max(1, int(np.ceil(cells.width / step)))
        cells = cells.kept(max(MIN_KEPT, _budget(n_arcs) // number))
        offset = ((np.arange(number) + 0.5) / number - 0.5) * cells.width
        rate = (cells.rate[:, None] + offset).ravel()
        divided = cells.at(np.repeat(np.arange(cells.rate.size), number))
        divided = divided._replace(rate=rate, width=cells.width / number)
        return divided.at(self.allowed.rates(rate, 0.5 * divided.width))


def _budget(n_arcs: int) -> int:
    """The most cells evaluated with the first arcs: the more arcs, the fewer cells can be best."""
    return max(LEAST_BUDGET, BUDGET >> max(n_arcs - 3, 0))


@jax.jit
def _tables(series: Series, arcs: Arcs, pole: jax.Array, coarse: jax.Array, n_rates, n_arcs):
    """Normal matrices (n, A, P, P) and vectors (n, A, P) of the first arcs at the first of the
    coarse rates (n,); zero elsewhere."""
    rows = series.response(pole, arcs.sun, arcs.obs)
    each = len(coarse), len(arcs.middle), series.size

    def filled(i, tables):
        matrices, vectors = tables
        rate, arc = jnp.divmod(i, n_arcs)
        response = Response(rows.cosine[arc], rows.sine[arc])
        design = series.turned(response, coarse[rate] * arcs.dt[arc]) * arcs.weight[arc, :, None]
        matrices = matrices.at[rate, arc].set(design.T @ design)
        return matrices, vectors.at[rate, arc].set(arcs.white[arc] @ design)

    empty = jnp.zeros((*each, series.size)), jnp.zeros(each)
    return jax.lax.fori_loop(0, n_rates * n_arcs, filled, empty)


@jax.jit
def _scores(series: Series, tables, prior, phase, index, n_arcs) -> jax.Array:
    matrices, vectors = tables

    def one(cell):
        phase, i = cell

        def add(k, total):
            matrix, vector = series.turned_normal(matrices[i, k], vectors[i, k], phase[k])
            return total[0] + matrix, total[1] + vector

        return log_evidence(
            *jax.lax.fori_loop(0, n_arcs, add, (jnp.diag(prior), jnp.zeros(prior.size)))
        )

    return jax.lax.map(one, (phase, index), batch_size=64)
