"""A search for the motion of a body of facets in which the data grow in time, from the middle.

Motions are drawn from the prior. Brightness is linear in the areas, so that the facets of each
motion follow from the data (`spin_search.pursuit`). All parameters of the best are optimised for
the data in the middle, then for more of them on both sides, and so on. The state of a tumbling body
is that in the middle, which these data fix. In each such stage the facets are chosen anew, because
an optimiser leaves a facet in a wrong place where it is. Equal optima are kept once, because copies
of the best would otherwise displace all others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import in_blocks
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

MOTIONS = 30  # drawn from the prior for each start of the first stage
PLACES = 162  # normals among which the facets are chosen
MOST_POINTS = 240  # by which they are chosen
CHUNK = 250  # motions at once
EQUAL = 0.02  # nats: optima closer than this are the same
LAST = 12  # optima with which the search ends


class Stage(NamedTuple):
    """A part of the data, and how far the motions are followed with it.

    Attributes
    ----------
    share : float
        Of the points, those next to the middle of the light curve.
    softness : float
        Error relative to the mean flux, in addition to those of the data.
    steps : int
        Steps of the optimiser before the facets are chosen anew, and as many after.
    kept : float
        Number of motions with which it begins, over that of the first stage.
    """

    share: float
    softness: float
    steps: int
    kept: float


STAGES = (
    Stage(0.45, 0.05, 6, 1.0),
    Stage(0.50, 0.05, 6, 0.75),
    Stage(0.60, 0.05, 6, 0.45),
    Stage(0.70, 0.05, 6, 0.3),
    Stage(0.85, 0.05, 8, 0.15),
    Stage(1.00, 0.03, 10, 0.075),
    Stage(1.00, 0.00, 20, 0.03),
)


@dataclass(frozen=True)
class _Growing:
    """A light curve from which facets are chosen.

    Attributes
    ----------
    problem, data, law
        As for `grown`.
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
    def of(cls, problem: Problem, data: Epochs, law: DiffuseLaw) -> _Growing:
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

    def chosen(self, z: Floats, stage: Stage, workers: int) -> tuple[Floats, Floats]:
        """The motions (n, D) with facets that fit the data of a stage, and the χ² left, (n,)."""
        points = self.points
        included = self.rank[points.epoch] < stage.share
        weight = included / np.hypot(points.error, self.softness(stage))
        fixed = (jnp.asarray(points.epoch), jnp.asarray(weight), jnp.asarray(weight * points.flux))
        shape = (self.law, self.problem, any(self.data.free_scale))

        def some(z: Floats) -> tuple[jax.Array, jax.Array]:
            return _with_facets(*shape, self.data, *fixed, jnp.asarray(z))

        with threads(workers) as pool:
            return in_blocks(some, CHUNK, z, over=pool.map)


@partial(jax.jit, static_argnums=(0, 1, 2))
def _with_facets(law, problem: Problem, relative: bool, data, epoch, weight, white, z):
    grid = jnp.asarray(facets.grid(PLACES))

    def one(z):
        sites = problem.constrain(z, data)
        mu0, mu = (sites[name][epoch] @ grid.T for name in (SUN, OBS))
        columns = diffuse_kernel(law, mu0, mu, LAMBERT_C)[0] * weight[:, None]
        chosen, areas = pursuit(columns, white, sites[AREAS].size)
        left = white - columns[:, chosen] @ areas
        size = jnp.log(areas)
        if relative:
            size += jnp.mean(sites[AREAS]) - jnp.mean(size)
        changed = {NORMALS: grid[chosen], AREAS: size}
        known = {name: changed.get(name, sites[name]) for name in problem.names}
        return problem.ravel(known), left @ left

    return jax.lax.map(one, z)


def grown(
    problem: Problem,
    data: Epochs,
    law: DiffuseLaw,
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
    number : int
        Motions with which the first stage begins, the best of `MOTIONS` times as many draws.
    key : random key
    workers : int
    progress : Silent
    """
    growing = _Growing.of(problem, data, law)
    begun = [max(LAST, round(number * stage.kept)) for stage in STAGES]
    steps = sum(2 * stage.steps * n for stage, n in zip(STAGES, begun, strict=True))
    z, left = np.zeros((0, problem.dim)), np.zeros(0)
    with progress.stage("drawing motions", MOTIONS * number, "motions") as bar:
        for each in jax.random.split(key, MOTIONS):
            draws = np.asarray(prior_draws(problem, jax.random.split(each, number), data))
            more, more_left = growing.chosen(draws, STAGES[0], workers)
            z, left = np.concatenate([z, more]), np.concatenate([left, more_left])
            best = np.argsort(left, kind="stable")[: begun[0]]
            z, left = z[best], left[best]
            bar.advance(number)
    with progress.stage("searching", steps, "steps") as bar:
        for stage, most in zip(STAGES, begun, strict=True):
            part = growing.part(stage)
            first = search.advanced(problem, part, z[:most], stage.steps, workers, bar.advance)
            anew, _ = growing.chosen(np.asarray(first.z), stage, workers)
            second = search.advanced(problem, part, anew, stage.steps, workers, bar.advance)
            both = search.joined(first, second)
            rows = search.different(both, len(both.z), gain=EQUAL)
            z = np.asarray(both.z)[rows or slice(LAST)]  # none, if no potential is finite
    return search.best_first(search.polish(problem, data, z[:LAST], workers))
