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

from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent, Track
from lcbayes.core.threads import threads
from lcbayes.inference.spin_search.arcs import Arcs
from lcbayes.inference.spin_search.series import Series, log_evidence
from lcbayes.physics.bodies import facets

Floats = NDArray[np.float64]

POLE_GRID = 500  # poles over the sphere, 9° apart
STEP = 1.0  # rad: spacing of rates times the duration they are told apart by
PHASE_STEP = 0.7  # rad: spacing of the phases between the first two arcs
BLOCK = 512  # cells of one pole in one program
BUDGET = 150_000  # cells evaluated at each level after the first
MIN_KEPT = 2000  # cells divided at each level
MARGIN = 150.0  # nats below the best at which cells are dropped


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
    """

    pole: NDArray[np.int64]
    rate: Floats
    width: float
    score: Floats

    def kept(self, most: int, margin: float = MARGIN) -> Cells:
        """The best cells, best first."""
        order = np.argsort(-self.score, kind="stable")[:most]
        order = order[self.score[order] > self.score[order[0]] - margin]
        return self._replace(pole=self.pole[order], rate=self.rate[order], score=self.score[order])


@dataclass(frozen=True)
class Coverage:
    """What a search covered.

    Attributes
    ----------
    max_rate : rad/s
        All spins up to this rate were covered.
    cells : int
        Number of distinct cells of pole and rate over the whole time base.
    evaluated : int
        Number of evidences computed.
    survivors : int
        Cells left at the finest level.
    tumbling : bool
        Whether torque-free motions were searched instead of constant spins; ``cells`` is then the
        number of motions that the data tell apart.
    """

    max_rate: float
    cells: int
    evaluated: int
    survivors: int
    tumbling: bool = False

    def stored(self) -> dict[str, NDArray]:
        """Arrays for a checkpoint."""
        return {"coverage": np.array(astuple(self), float)}

    @classmethod
    def restored(cls, arrays: dict[str, NDArray]) -> Coverage | None:
        """The coverage among the arrays of a checkpoint, from which it is removed, if there."""
        if "coverage" not in arrays:
            return None
        max_rate, *counts, tumbling = arrays.pop("coverage")
        return cls(float(max_rate), *(int(n) for n in counts), tumbling=bool(tumbling))


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
    coarse : (n,) rad/s
        Rates that one arc tells apart.
    omega_sd : rad/s
        Prior sd of each component of ω.
    """

    series: Series
    arcs: Arcs
    prior: Floats
    poles: Floats
    coarse: Floats
    omega_sd: float

    @classmethod
    def of(
        cls, series: Series, arcs: Arcs, prior: Floats, max_rate: float, omega_sd: float
    ) -> Grid:
        coarse = cls.rates(arcs, max_rate)
        return cls(series, arcs, prior, facets.grid(POLE_GRID), coarse, omega_sd)

    @staticmethod
    def rates(arcs: Arcs, max_rate: float) -> Floats:
        """Rates up to a fastest that one arc tells apart, rad/s."""
        n = max(1, int(np.ceil(max_rate * max(arcs.duration, 1e-9) / STEP)))
        return (np.arange(n) + 0.5) * max_rate / n

    @property
    def coarse_step(self) -> float:
        return 2.0 * float(self.coarse[0])

    @property
    def n_arcs(self) -> int:
        return self.arcs.middle.size

    def pairs(self) -> tuple[Floats, float]:
        """Rates that represent all phases between the first two arcs, and their width, rad/s."""
        if self.n_arcs == 1:
            return self.coarse, self.coarse_step
        gap = self.gap
        turn = min(self.coarse_step * gap, 2 * np.pi)
        n = max(1, int(np.ceil(turn / PHASE_STEP)))
        offset = ((np.arange(n) + 0.5) / n - 0.5) * turn / gap
        return (self.coarse[:, None] + offset).ravel(), turn / gap / n

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
        return np.clip((rate / self.coarse_step).astype(int), 0, self.coarse.size - 1)

    def score(
        self, pole: NDArray[np.int64], rate: Floats, n_arcs: int, workers: int, bar: Track
    ) -> Floats:
        """Scores (n,) of cells from the first arcs."""
        order = np.argsort(pole, kind="stable")
        poles, first = np.unique(pole[order], return_index=True)
        scores = np.empty(rate.size)
        middle = self.arcs.middle[:n_arcs]
        # Phases count from the middle of the arcs in use: longitudes are free.
        reference = 0.5 * float(jnp.min(middle) + jnp.max(middle))

        def one(k: int, rows: NDArray[np.int64]) -> None:
            tables = _tables(self.series, self.arcs, self.poles[k], self.coarse)
            for start in range(0, rows.size, BLOCK):
                part = rows[start : start + BLOCK]
                padded = np.resize(part, BLOCK if rows.size > 64 else 64)
                found = _scores(
                    self.series,
                    tables,
                    self.prior,
                    rate[padded],
                    self.index(rate[padded]),
                    self.arcs.middle - reference,
                    n_arcs,
                )
                scores[part] = np.asarray(found)[: part.size]
            bar.advance(rows.size)

        with threads(workers) as pool:
            list(pool.map(one, poles, np.split(order, first[1:])))
        return scores - 0.5 * (rate / self.omega_sd) ** 2

    def search(self, workers: int, progress: Silent, most: int) -> tuple[Cells, Coverage]:
        """The best cells over the whole time base, best first."""
        rate, width = self.pairs()
        pole = np.repeat(np.arange(len(self.poles)), rate.size)
        rate = np.tile(rate, len(self.poles))
        evaluated = rate.size
        with progress.stage("searching spins", rate.size, "cells") as bar:
            score = self.score(pole, rate, min(2, self.n_arcs), workers, bar)
            found = self.with_aliases(Cells(pole, rate, width, score))
            for n_arcs in range(3, self.n_arcs + 1):
                found = self.divided(found, n_arcs)
                bar.more(found.rate.size)
                evaluated += found.rate.size
                score = self.score(found.pole, found.rate, n_arcs, workers, bar)
                found = found._replace(score=score)
        fastest = float(self.coarse[-1]) + 0.5 * self.coarse_step
        cells = int(len(self.poles) * fastest * float(self.arcs.span[-1]) / STEP)
        found = found.kept(most)
        return found, Coverage(fastest, cells, evaluated, found.rate.size)

    def with_aliases(self, cells: Cells) -> Cells:
        """The best cells of the first two arcs, with every rate that has their phase."""
        number = max(1.0, self.coarse_step * self.gap / (2 * np.pi)) if self.n_arcs > 1 else 1.0
        cells = cells.kept(int(BUDGET / (2 * number)))
        row, rate = self.aliases(cells.rate)
        return cells._replace(pole=cells.pole[row], rate=rate, score=cells.score[row])

    def divided(self, cells: Cells, n_arcs: int) -> Cells:
        """The best cells, divided into those that a further arc tells apart."""
        step = STEP / float(self.arcs.span[n_arcs - 1])
        number = max(1, int(np.ceil(cells.width / step)))
        cells = cells.kept(max(MIN_KEPT, BUDGET // number))
        offset = ((np.arange(number) + 0.5) / number - 0.5) * cells.width
        rate = (cells.rate[:, None] + offset).ravel()
        score = np.repeat(cells.score, number)
        return Cells(np.repeat(cells.pole, number), rate, cells.width / number, score)


@jax.jit
def _tables(series: Series, arcs: Arcs, pole: jax.Array, coarse: jax.Array):
    """Normal matrices (n, A, P, P) and vectors (n, A, P) of the arcs at each coarse rate."""
    rows = series.response(pole, arcs.sun, arcs.obs)

    def at(rate: jax.Array):
        design = series.turned(rows, rate * arcs.dt) * arcs.weight[..., None]
        return design.swapaxes(1, 2) @ design, jnp.einsum("alp,al->ap", design, arcs.white)

    return jax.lax.map(at, coarse)


@jax.jit
def _scores(series: Series, tables, prior, rate, index, middle, n_arcs) -> jax.Array:
    matrices, vectors = tables

    def one(cell):
        rate, i = cell

        def add(k, total):
            matrix, vector = series.turned_normal(matrices[i, k], vectors[i, k], rate * middle[k])
            return total[0] + matrix, total[1] + vector

        return log_evidence(
            *jax.lax.fori_loop(0, n_arcs, add, (jnp.diag(prior), jnp.zeros(prior.size)))
        )

    return jax.lax.map(one, (rate, index), batch_size=64)
