"""The complete search for the torque-free motion of a body of facets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.stats import norm, qmc

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent, Track
from lcbayes.core.threads import threads
from lcbayes.data.segments import PASS, split
from lcbayes.inference import search
from lcbayes.inference.search import SearchState
from lcbayes.inference.spin_search.arcs import MIN_SUNLIGHT, RESOLVED, Points, averaged
from lcbayes.inference.spin_search.bodies import clustered
from lcbayes.inference.spin_search.cells import Coverage
from lcbayes.inference.spin_search.facets import AREAS, INERTIA, NORMALS, OMEGA, climbed
from lcbayes.inference.spin_search.motions import (
    SIZE,
    Motions,
    Scale,
    Window,
    distinct,
    improved,
    moved,
    scores,
    spread,
    tensor_and_rate,
    windows,
    within,
)
from lcbayes.inference.spin_search.rotated import Rotated
from lcbayes.inference.spin_search.series import Series, precision, total_area
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import inertia_tensor
from lcbayes.modelling.problem import Problem, Sites, compiled
from lcbayes.physics.attitude.torque_free import torque_free_to_body
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import DIFFUSE_LAWS, LAMBERT_C, DiffuseLaw, diffuse_kernel

Floats = NDArray[np.float64]

MIN_POINTS = 20  # below, starts from the prior do as well
PRIOR_REACH = 4.0  # fastest spin in prior sd of a component of ω: 99.9 % of the prior
FIRST_TURN = 16.0  # rad of the fastest spin in the first window
GROWTH = 1.4  # of a window
DRAWN = 2**16  # motions that cover the prior, in the first window
COPIES = 8  # motions tried about each that survives, in the next window
SERIES_ERROR = 0.12  # of the series, relative to the rms flux
SHORTER = 4  # ratio of the sizes to which windows are padded: each size is compiled
PER_PARENT = 3  # of the motions tried about one survivor, improved
APART = 1.0  # sd between motions that are told apart


@dataclass(frozen=True)
class Stage:
    """Motions improved, steps, and the error of the series relative to `SERIES_ERROR`."""

    motions: int
    steps: int
    error: float = 1.0


FIRST = Stage(3072, 8)
GROWING = Stage(1024, 5)
LAST = Stage(320, 8, 0.5)  # on all points
NORMALS_TRIED = 250  # of the free body of a motion
BODY_ERROR = 0.03  # of that body, relative to the rms flux
CLUSTERS = 3  # bodies of N facets for each motion
# Rounds of successive halving of bodies of N facets: see `inference.search`.
ROUNDS = ((1.0, 12, 0.25), (1.0, 30, 0.3), (1.0, 150, 1.0))


def applies(problem: Problem, data: Epochs, options: Mapping[str, Any]) -> bool:
    """Whether a fit is of a body of diffuse facets in torque-free motion."""
    sites = {NORMALS, OMEGA, AREAS, INERTIA} <= set(problem.names)
    law = options.get("reflectance") in DIFFUSE_LAWS
    return sites and law and int(jnp.sum(data.sunlight > MIN_SUNLIGHT)) >= MIN_POINTS


def complete_search(
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
    workers: int,
    progress: Silent,
) -> tuple[SearchState, Coverage]:
    """Optima of the posterior over the torque-free motions that the prior allows, best first.

    1. Motions that cover the prior get the evidence of a random body in a window of the longest
       pass, so short that they are dense there (`motions`).
    2. The best are improved, and the window grows by a factor `GROWTH` at a time until it contains
       all points. About each survivor, motions are drawn that the last window did not tell apart.
    3. Bodies of N facets are optimised from the survivors with the posterior itself.

    Parameters
    ----------
    problem : Problem
    data : Epochs
    options : mapping
        Of the model, with defaults: ``omega_sd``, ``inertia_sd``, ``n_facets``, ``reflectance``.
    workers : int
    progress : Silent

    Returns
    -------
    SearchState, Coverage
    """
    law: DiffuseLaw = options["reflectance"]
    scale = Scale(float(options["omega_sd"]), float(options["inertia_sd"]))
    points, series = Points.of(data), Series.of(law)
    total = total_area(series, points.sun, points.obs, points.flux)
    run = _Search(points, Rotated.of(series), precision(series, total), scale, workers)
    found, middle, coverage = run.motions(progress)
    x = moved(found.x, -middle, scale)
    starts = run.starts(problem, data, x, total, int(options["n_facets"]))
    ends = search.successive_halving(
        problem, data, jnp.asarray(starts), workers, progress, rounds=ROUNDS
    )

    def body_axes(sites: Sites, points: Points) -> Points:
        inertia = inertia_tensor(jnp.asarray(sites[INERTIA]), scale.inertia)[0]
        arrays = (jnp.asarray(v) for v in (sites["omega"], inertia, points.sun, points.obs))
        seen = torque_free_to_body(jnp.asarray(points.t), *arrays)
        return points._replace(sun=np.asarray(seen[0]), obs=np.asarray(seen[1]))

    ends = climbed(problem, data, points, law, ends, np.zeros(0), workers, body_axes)
    return ends, coverage


@dataclass(frozen=True)
class _Search:
    """The motions that fit all points, with free bodies."""

    points: Points
    rotated: Rotated
    prior: Floats
    scale: Scale
    workers: int

    @property
    def fastest(self) -> float:
        """rad/s."""
        return PRIOR_REACH * self.scale.omega

    def motions(self, progress: Silent) -> tuple[Motions, float, Coverage]:
        """Distinct motions on all points, best first, their reference epoch, and the coverage."""
        passes = split(self.points.t, np.zeros(self.points.t.size, int), PASS)
        window = RESOLVED / self.fastest
        parts = [averaged(self.points, rows, window) for rows in passes]
        points = Points(*(np.concatenate(v) for v in zip(*parts, strict=True)))
        passes = split(points.t, np.zeros(points.t.size, int), PASS)
        rows = windows(points, FIRST_TURN / self.fastest, GROWTH, passes)
        stages = [FIRST, *[GROWING] * (len(rows) - 1), LAST]
        rng = np.random.default_rng(0)
        total = DRAWN + sum(s.motions * (COPIES + s.steps) for s in stages)
        x, middle, evaluated = prior_motions(DRAWN), 0.0, 0
        parent = np.arange(len(x))
        with progress.stage("searching motions", total, "motions") as bar:
            for i, stage in enumerate(stages):
                inside = points.at(rows[min(i, len(rows) - 1)])
                error = stage.error * SERIES_ERROR * _rms(points.flux)
                size = padded_size(inside.t.size, points.t.size)
                at = Window.of(self.rotated, inside, self.prior, error, size)
                if i:
                    x = moved(x, float(at.middle) - middle, self.scale)
                middle = float(at.middle)
                evaluated += len(x)
                found = self.survivors(at, x, parent, stage, bar)
                growing = i + 2 < len(stages)
                x = spread(found, COPIES, rng) if growing else found.x
                parent = np.arange(len(x)) % len(found.x)
        cells = float(np.median(np.sqrt(np.linalg.det(found.curvature[:50]))))
        coverage = Coverage(self.fastest, int(cells), evaluated, len(found.x), tumbling=True)
        return found, middle, coverage

    def survivors(
        self, at: Window, x: Floats, parent: NDArray[np.int64], stage: Stage, bar: Track
    ) -> Motions:
        """The best of the motions x (n, 8) about each parent (n,), improved, no two alike."""
        score = scores(self.rotated, at, self.scale, x, self.workers)
        bar.advance(len(x))
        order = np.argsort(-score, kind="stable")
        x = x[order[within(parent[order], PER_PARENT)][: stage.motions]]
        found = improved(self.rotated, at, self.scale, x, stage.steps, self.workers)
        bar.advance(len(x) * stage.steps)
        return found.at(distinct(found, stage.motions, APART))

    def starts(
        self, problem: Problem, data: Epochs, x: Floats, total_area: float, n_facets: int
    ) -> Floats:
        """Unconstrained vectors (n, D) of bodies of N facets in the motions x (m, 8) from t = 0.

        Their facets are clusters of the non-negative albedo-areas on a grid of normals that fit
        best, with a weak penalty (α/``total_area``)².
        """
        grid, points = facets.grid(NORMALS_TRIED), self.points
        error = np.hypot(points.error, BODY_ERROR * _rms(points.flux))
        target = np.concatenate([points.flux / error, np.zeros(len(grid))])
        law = self.rotated.series.law
        arrays = [jnp.asarray(v) for v in (points.t, points.sun, points.obs)]

        def free(motion: Floats) -> Floats:
            columns = np.asarray(_columns(law, grid, jnp.asarray(motion), self.scale, *arrays))
            rows = np.concatenate([columns / error[:, None], np.eye(len(grid)) / total_area])
            size = np.linalg.norm(rows, axis=0)
            return nnls(rows / size, target, maxiter=50 * len(size))[0] / size

        with threads(self.workers) as pool:
            areas = list(pool.map(free, x))
        draw = compiled(problem.constrain)(jnp.zeros(problem.dim), data)
        rest = {k: draw[k] for k in problem.names if k not in (NORMALS, OMEGA, AREAS, INERTIA)}
        rng = np.random.default_rng(0)
        found = []
        for motion, area in zip(x, areas, strict=True):
            for _ in range(CLUSTERS):
                normals, sizes = clustered(grid, area, n_facets, rng)
                found.append((motion, normals, np.log(sizes)))
        every = (jnp.asarray(np.stack(v)) for v in zip(*found, strict=True))
        return np.asarray(_rows(problem, rest, *every))


def padded_size(n: int, most: int) -> int:
    """The least of ``most``, ``most``/4, ``most``/16, … that is not below n."""
    while (shorter := -(-most // SHORTER)) >= n and shorter < most:
        most = shorter
    return most


def prior_motions(n: int) -> Floats:
    """Motions (n, 8) that cover the prior: a Sobol sequence, for n a power of two.

    Directions of ω are uniform, the inertia follows its prior, and |ω| is uniform up to
    `PRIOR_REACH`: fast motions need more of them.
    """
    u = qmc.Sobol(SIZE, seed=0).random(n)
    z, lon, rate = 2.0 * u[:, 0] - 1.0, 2.0 * np.pi * u[:, 1], PRIOR_REACH * u[:, 2]
    flat = np.sqrt(1.0 - z**2)
    direction = np.stack([flat * np.cos(lon), flat * np.sin(lon), z], axis=1)
    return np.concatenate([direction * rate[:, None], norm.ppf(u[:, 3:])], axis=1)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


@partial(jax.jit, static_argnums=0)
def _rows(problem: Problem, rest, motion, normals, areas):
    def one(motion, normals, areas):
        known = {OMEGA: motion[:3], INERTIA: motion[3:], NORMALS: normals, AREAS: areas}
        return problem.ravel(rest | known)

    return jax.vmap(one)(motion, normals, areas)


@partial(jax.jit, static_argnums=0)
def _columns(law, normals, x, scale, t, sun, obs) -> jax.Array:
    inertia, omega = tensor_and_rate(x, scale)
    sun, obs = torque_free_to_body(t, omega, inertia, sun, obs)
    return diffuse_kernel(law, sun @ normals.T, obs @ normals.T, LAMBERT_C)[0]
