"""A search for the motion of a body of facets with errors that shrink step by step.

Motions are drawn from the prior. Each gets one facet at random; the others are chosen by matching
pursuit, since brightness is linear in the areas (`spin_search.pursuit`). One is left to chance
because the body that fits best at a wrong motion is rarely the right one. All parameters of the
best bodies are then optimised with errors much larger than those of the data. The best of these go
on with smaller errors, and so forth. Equal optima are kept once, because copies of the best would
displace all others.

There are two kinds of search, which need not fail in the same cases. One has all data from the
beginning. In the other the data also grow in time, from the middle, where the state of a tumbling
body is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import each, in_blocks, together
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.core.threads import threads
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.arcs import Points
from lcbayes.inference.spin_search.pursuit import pursuit
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import OBS, SUN, Problem, prior_draws
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel
from lcbayes.samplers.facet_moves import AREAS, NORMALS

Floats = NDArray[np.float64]

DRAWN = 4  # motions from the prior for each start of the first stage
BLOCK = 2000  # motions drawn at once
PLACES = 162  # normals among which the facets are chosen
MOST_POINTS = 240  # by which they are chosen
CHUNK = 250, 2000  # motions at once, on a CPU and on an accelerator
EQUAL = 0.02, 0.03  # nats, and prior sd of the motion: optima that are closer are the same
LAST = 24  # optima with which the search ends


class Stage(NamedTuple):
    """The data of a stage, the errors added to them, and how many motions are optimised how far.

    Attributes
    ----------
    share : float
        Of the points, those next to the middle of the light curve.
    softness : float
        Error relative to the mean flux, in addition to those of the data.
    steps : int
        Steps of the optimiser.
    kept : float
        Number of motions with which it begins, over that of the first stage.
    """

    share: float
    softness: float
    steps: int
    kept: float


WHOLE = (
    Stage(1.0, 0.30, 4, 1.0),
    Stage(1.0, 0.30, 5, 0.375),
    Stage(1.0, 0.20, 6, 0.156),
    Stage(1.0, 0.10, 8, 0.0625),
    Stage(1.0, 0.05, 8, 0.025),
    Stage(1.0, 0.03, 10, 0.0094),
    Stage(1.0, 0.00, 20, 0.0038),
)
GROWING = (
    Stage(0.40, 0.20, 4, 1.0),
    Stage(0.50, 0.20, 5, 0.375),
    Stage(0.70, 0.15, 6, 0.156),
    Stage(0.85, 0.10, 8, 0.0625),
    *WHOLE[4:],
)


@dataclass(frozen=True)
class _Annealed:
    """A light curve from which facets are chosen.

    Attributes
    ----------
    problem, data, law
        As for `annealed`.
    points : Points
        As many as are used for it, evenly chosen.
    rank : (T,)
        Share of the data that is closer to the middle of the light curve, of each epoch.
    """

    problem: Problem
    data: Epochs
    law: DiffuseLaw
    points: Points
    rank: Floats

    @classmethod
    def of(cls, problem: Problem, data: Epochs, law: DiffuseLaw) -> _Annealed:
        every = Points.of(data)
        n = len(every.t)
        points = every.at(np.unique(np.linspace(0, n - 1, min(n, MOST_POINTS)).astype(int)))
        away = np.abs(np.asarray(data.t - data.t_middle))
        rank = np.argsort(np.argsort(away, kind="stable")) / away.size
        return cls(problem, data, law, points, rank)

    def softness(self, stage: Stage) -> float:
        """The error that a stage adds to those of the data, m²."""
        return stage.softness * abs(float(np.mean(self.points.flux)))

    def part(self, stage: Stage) -> Epochs:
        """The data of a stage: the likelihood of other points has no power."""
        variance = float(np.median(self.points.error)) ** 2
        power = (self.rank < stage.share) * variance / (variance + self.softness(stage) ** 2)
        return replace(self.data, information=jnp.asarray(power) * self.data.information)

    def chosen(
        self, z: Floats, first: NDArray[np.int64], stage: Stage, workers: int
    ) -> tuple[Floats, Floats]:
        """The motions (n, D) with facets that fit the data of a stage, and the χ² left, (n,).

        ``first`` (n,) is the row of `facets.grid` of the facet that each body has in any case.
        """
        points = self.points
        included = self.rank[points.epoch] < stage.share
        weight = included / np.hypot(points.error, self.softness(stage))
        light = (jnp.asarray(points.epoch), jnp.asarray(weight), jnp.asarray(weight * points.flux))
        shape = (self.law, self.problem, any(self.data.free_scale))

        def some(z: Floats, first: NDArray[np.int64]) -> tuple[jax.Array, jax.Array]:
            return _with_facets(*shape, self.data, light, jnp.asarray(z), jnp.asarray(first))

        with threads(workers) as pool:
            return in_blocks(some, together(*CHUNK), z, first, over=pool.map)


@partial(jax.jit, static_argnums=(0, 1, 2))
def _with_facets(law, problem: Problem, relative: bool, data, light, z, first):
    epoch, weight, white = light
    grid = jnp.asarray(facets.grid(PLACES))

    def one(given):
        z, first = given
        sites = problem.constrain(z, data)
        mu0, mu = (sites[name][epoch] @ grid.T for name in (SUN, OBS))
        columns = diffuse_kernel(law, mu0, mu, LAMBERT_C)[0] * weight[:, None]
        chosen, areas = pursuit(columns, white, sites[AREAS].size, first)
        left = white - columns[:, chosen] @ areas
        size = jnp.log(areas)
        if relative:
            size += jnp.mean(sites[AREAS]) - jnp.mean(size)
        changed = {NORMALS: grid[chosen], AREAS: size}
        known = {name: changed.get(name, sites[name]) for name in problem.names}
        return problem.ravel(known), left @ left

    return each(one, (z, first))


def annealed(
    problem: Problem,
    data: Epochs,
    law: DiffuseLaw,
    stages: Sequence[Stage],
    number: int,
    key: jax.Array,
    workers: int,
    progress: Silent,
) -> SearchState:
    """Optima of the posterior, best first.

    Parameters
    ----------
    problem : Problem
        Of a body of diffuse facets.
    data : Epochs
    law : reflectance
    stages : sequence of Stage
        `WHOLE` or `GROWING`.
    number : int
        Motions with which the first stage begins, the best of `DRAWN` times as many draws.
    key : random key
    workers : int
    progress : Silent
    """
    light = _Annealed.of(problem, data, law)
    begun = [max(LAST, round(number * stage.kept)) for stage in stages]
    z = _drawn(light, stages[0], begun[0], key, workers, progress)
    motion = problem.rows(name for name in problem.names if name not in (NORMALS, AREAS))
    steps = sum(stage.steps * n for stage, n in zip(stages, begun, strict=True))
    with progress.stage("searching", steps, "steps") as bar:
        for stage, most in zip(stages, begun, strict=True):
            part = light.part(stage)
            ends = search.advanced(problem, part, z[:most], stage.steps, workers, bar.advance)
            ends = search.best_first(ends)
            rows = _distinct(np.asarray(ends.potential), np.asarray(ends.z)[:, motion])
            z = np.asarray(ends.z)[rows or slice(LAST)]  # none, if no potential is finite
    return search.best_first(search.polish(problem, data, z[:LAST], workers))


def _drawn(
    light: _Annealed, stage: Stage, number: int, key: jax.Array, workers: int, progress: Silent
) -> Floats:
    """The best of `DRAWN` times as many motions from the prior, with facets, (number, D)."""
    problem, total = light.problem, DRAWN * number
    size = min(BLOCK, total)
    z, left = np.zeros((0, problem.dim)), np.zeros(0)
    with progress.stage("drawing motions", total, "motions") as bar:
        for each in jax.random.split(key, -(-total // size)):
            of_motion, of_facet = jax.random.split(each)
            keys = jax.random.split(of_motion, size)
            draws = np.asarray(prior_draws(problem, keys, light.data))
            first = np.asarray(jax.random.randint(of_facet, (size,), 0, PLACES))
            more, more_left = light.chosen(draws, first, stage, workers)
            z, left = np.concatenate([z, more]), np.concatenate([left, more_left])
            best = np.argsort(left, kind="stable")[:number]
            z, left = z[best], left[best]
            bar.advance(size)
    return z


def _distinct(potential: Floats, motion: Floats) -> list[int]:
    """Rows of end points that differ, of those sorted by their potential.

    Only potential and motion are compared, so that the order of the facets does not matter. Large
    errors make potentials nearly equal; the potential alone would then merge different motions.
    """
    rows: list[int] = []
    first = 0  # the rows before are too low in potential to be equal
    for i in np.flatnonzero(np.isfinite(potential)):
        while first < len(rows) and potential[rows[first]] < potential[i] - EQUAL[0]:
            first += 1
        if not np.any(np.abs(motion[rows[first:]] - motion[i]).max(axis=1, initial=0.0) < EQUAL[1]):
            rows.append(int(i))
    return rows
