"""The complete search over constant spins, against NumPy and a simulator of its own."""

from __future__ import annotations

from dataclasses import asdict
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.spin_search import arcs, bodies, states
from lcbayes.inference.spin_search import facets as facet_bodies
from lcbayes.inference.spin_search import search as complete
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.cells import Cells, Coverage, Grid
from lcbayes.inference.spin_search.drift import Drift
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.inference.spin_search.search import Stage, _Refinement, applies, complete_search
from lcbayes.inference.spin_search.series import Series, log_evidence, precision, total_area
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import KnownSpin
from lcbayes.modelling.spin_coordinates import RateAndDirection
from lcbayes.results.reasons import searched
from tests.helpers import small_curves
from tests.helpers.turning_facets import GAP, Truth, in_body_axes

LAW = "lambertian"
OMEGA_SD = 0.008


@pytest.fixture(scope="module")
def truth() -> Truth:
    return Truth()


@pytest.fixture(scope="module")
def points(truth: Truth) -> Points:
    return Points.of(Epochs.of(truth.curve))


@pytest.fixture(scope="module")
def grid(points: Points) -> Grid:
    series = Series.of(LAW)
    arcs = Arcs.of(points, 4 * OMEGA_SD, 0.15)
    prior = precision(series, total_area(series, points.sun, points.obs, points.flux))
    return Grid.of(series, arcs, prior, Allowed(((0.0, 4 * OMEGA_SD),), OMEGA_SD))


def test_a_body_in_harmonics_is_as_bright_as_its_facets():
    """A field of harmonics on 40,000 facets, turned in NumPy, against the series' quadrature."""
    rng = np.random.default_rng(0)
    series, pole = Series.of(LAW), np.array([0.36, 0.48, 0.8])
    sun, obs = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 30, 3)))
    angle = rng.uniform(0, 2 * np.pi, 30)
    rows = series.turned(series.response(jnp.asarray(pole), sun, obs), jnp.asarray(angle))
    axes = np.asarray(_frame(pole))
    i = np.arange(40000) + 0.5
    z, lon = 1 - 2 * i / 40000, np.pi * (1 + 5**0.5) * i
    normals = np.stack([np.sqrt(1 - z**2) * np.cos(lon), np.sqrt(1 - z**2) * np.sin(lon), z], 1)
    s, o = (in_body_axes(v, angle, pole) @ axes for v in (sun, obs))
    kernel = np.maximum(s @ normals.T, 0) * np.maximum(o @ normals.T, 0) / np.pi
    # 1, z, x and y are the harmonics of the first two degrees, up to their norm
    for column, field, norm in ((0, np.ones_like(z), 1.0), (1, z, 3.0), (5, normals[:, 0], 3.0)):
        value = kernel @ field * np.sqrt(norm * 4 * np.pi) / 40000
        assert np.abs(np.asarray(rows[:, column]) - value).max() < 0.02 * np.abs(value).max()


def _frame(pole: np.ndarray) -> np.ndarray:
    first = np.cross([0.0, 0.0, 1.0], pole)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(pole, first), pole], axis=1)


def test_normal_equations_turn_as_their_rows():
    rng = np.random.default_rng(1)
    series = Series.of(LAW)
    sun, obs = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 12, 3)))
    rows = series.response(jnp.array([0.0, 0.6, 0.8]), sun, obs)
    still, white = series.turned(rows, jnp.zeros(12)), rng.normal(size=12)
    later = np.asarray(series.turned(rows, jnp.full(12, 0.7)))
    matrix, vector = series.turned_normal(still.T @ still, still.T @ white, jnp.asarray(0.7))
    assert np.allclose(matrix, later.T @ later, rtol=0, atol=1e-12)
    assert np.allclose(vector, later.T @ white, rtol=0, atol=1e-12)


def test_the_evidence_is_that_of_a_gaussian_field():
    """Differences of ln N(y; 0, I + A S Aᵀ) between designs, with a dense covariance in NumPy."""
    rng = np.random.default_rng(2)
    prior, y = rng.uniform(0.5, 2.0, 6), rng.normal(size=15)
    ours, dense = [], []
    for _ in range(3):
        design = rng.normal(size=(15, 6))
        information = design.T @ design + np.diag(prior)
        ours.append(float(log_evidence(jnp.asarray(information), jnp.asarray(design.T @ y))))
        dense.append(log_density(y, design, prior))
    assert np.allclose(np.diff(ours), np.diff(dense), rtol=0, atol=1e-10)


def log_density(y: np.ndarray, design: np.ndarray, prior: np.ndarray) -> float:
    """ln N(y; 0, I + A S Aᵀ) up to a constant, with A the design and S⁻¹ = diag(prior)."""
    covariance = np.eye(len(y)) + design / prior @ design.T
    log_det = np.linalg.slogdet(covariance)[1]
    return -0.5 * y @ np.linalg.solve(covariance, y) - 0.5 * log_det


@pytest.mark.parametrize("n_arcs", [1, 2])
def test_scores_of_some_cells_are_the_evidence_of_the_arcs_in_use(grid: Grid, n_arcs):
    """Cells of three poles, a few rates each, against dense covariances of the rows in NumPy."""
    pole, row = np.array([7, 3, 7, 120, 3, 7]), np.array([5, 0, 12, 2, 12, 6])
    rate = grid.coarse[row]
    cells = Cells(pole, rate, grid.coarse_step, np.zeros(6), np.zeros(6))
    with Silent().stage("", 6, "cells") as bar:
        ours = grid.score(cells, n_arcs, 1, bar) - grid.allowed.log_prior(rate)
    arcs, dense = grid.arcs, []
    for k, w in zip(pole, rate, strict=True):
        rows = grid.series.response(jnp.asarray(grid.poles[k]), arcs.sun, arcs.obs)
        turned = grid.series.turned(rows, w * (arcs.middle[:, None] + arcs.dt))
        design = np.asarray(turned * arcs.weight[..., None])[:n_arcs].reshape(-1, grid.series.size)
        white = np.asarray(arcs.white)[:n_arcs].ravel()
        dense.append(log_density(white, design, grid.prior))
    assert np.ptp(dense) > 10.0
    assert np.allclose(np.diff(ours), np.diff(dense), rtol=0, atol=1e-6)


@pytest.mark.parametrize("n_normals", [60, 250])
def test_nonnegative_areas_are_those_of_lawson_and_hanson(truth: Truth, n_normals):
    """½ χ² on a grid of normals, whose neighbours have nearly the same brightness."""
    curve = truth.curve
    assert curve.error is not None
    assert curve.sun is not None
    assert curve.obs is not None
    s, o = (in_body_axes(v, curve.t, truth.omega) for v in (curve.sun, curve.obs))
    grid = np.random.default_rng(3).normal(size=(n_normals, 3))
    grid /= np.linalg.norm(grid, axis=1, keepdims=True)
    design = np.maximum(s @ grid.T, 0.0) * np.maximum(o @ grid.T, 0.0) / np.pi
    design, target = design / curve.error[:, None], curve.brightness / curve.error
    design = np.concatenate([design, 0.1 * np.eye(n_normals)])
    target = np.concatenate([target, np.zeros(n_normals)])
    ours = bodies._nonnegative(jnp.asarray(design.T @ design), jnp.asarray(design.T @ target))
    norm = nnls(design, target, maxiter=100 * n_normals)[1]
    assert np.all(np.asarray(ours) >= 0.0)
    misfit = 0.5 * float(np.sum((target - design @ np.asarray(ours)) ** 2))
    assert 0.0 <= misfit - 0.5 * norm**2 + 1e-9 < 2 * bodies.NNLS_TOLERANCE


def test_the_jacobian_of_rate_and_direction():
    chart, x = RateAndDirection(), jnp.array([-1.3, 0.4, -2.1])
    y = chart(x)
    numeric = np.linalg.slogdet(np.asarray(jax.jacfwd(chart)(x)))[1]
    assert float(chart.log_abs_det_jacobian(x, y)) == pytest.approx(numeric, abs=1e-12)
    assert np.allclose(chart._inverse(y), x, rtol=0, atol=1e-12)
    assert float(jnp.linalg.norm(y)) == pytest.approx(np.exp(-1.3))


def test_every_rate_lies_within_half_a_width_of_a_cell(grid: Grid):
    """Random rates up to the fastest: a cell has their phase between the arcs and coarse rate."""
    rates, width = grid.pairs()
    rate = np.random.default_rng(4).uniform(0, 4 * OMEGA_SD, 500)
    gap = (rate[:, None] - rates) * grid.gap
    phase = np.abs(np.angle(np.exp(1j * gap)))
    same = grid.index(rate)[:, None] == grid.index(rates)
    assert np.all(np.min(np.where(same, phase, np.inf), axis=1) <= 0.5 * width * grid.gap + 1e-9)


def test_the_true_cell_is_among_the_best(grid: Grid, truth: Truth):
    result, _, coverage = grid.search(1, Silent(), 60_000)
    rate = np.linalg.norm(truth.omega)
    near = grid.poles[result.pole] @ truth.omega / rate > np.cos(np.radians(9.0))
    near &= np.abs(result.rate - rate) * GAP < 1.5
    assert np.flatnonzero(near).min(initial=result.rate.size) < 0.02 * coverage.evaluated
    assert coverage.max_rate == pytest.approx(4 * OMEGA_SD)
    assert Coverage.restored(coverage.stored()) == coverage


def ranks(truth: Truth, grid: Grid, cells: Cells) -> np.ndarray:
    """Ranks of the cells near the truth: 14° of its pole, a radian at the ends."""
    rate = np.linalg.norm(truth.omega)
    near = grid.poles[cells.pole] @ truth.omega / rate > np.cos(np.radians(14.0))
    near &= np.abs(cells.rate - rate) * float(grid.arcs.span[-1]) < 2.0
    return np.flatnonzero(near)


def refinement(truth: Truth, omega_sd: float) -> _Refinement:
    points, series = Points.of(Epochs.of(truth.curve)), Series.of(LAW)
    total = total_area(series, points.sun, points.obs, points.flux)
    allowed = Allowed(((0.0, 4 * omega_sd),), omega_sd)
    arcs = Arcs.of(points, allowed.fastest, 0.15)
    grid = Grid.of(series, arcs, precision(series, total), allowed)
    return _Refinement(points, grid, LAW, total, 1)


@pytest.mark.slow
def test_whole_turns_between_two_passes_are_told_apart_by_facets():
    """Bright data tell them apart, and the evidence, which leaves out a part of the light, not."""
    truth = Truth(snr=100.0, passes=(0.0, 8 * GAP))
    run = refinement(truth, OMEGA_SD)
    found = run.grid.search(1, Silent(), 60_000)
    cells = run.aliases(run.by_facets(found.states.kept(20_000)))
    assert cells.rate.size > 10 * complete.STATES[0]
    ordered = run.by_facets(cells)
    assert ranks(truth, run.grid, ordered).min() < 20
    assert ranks(truth, run.grid, found.cells).min(initial=60_000) > 1000


@pytest.mark.slow
def test_slow_spins_are_told_apart_by_facets():
    truth = Truth(snr=100.0, period=12_000.0, passes=(0.0, GAP, 8 * GAP, 16 * GAP))
    run = refinement(truth, 0.02)
    slow = run.slow(Silent(), Checkpoint(None, {}))
    assert slow is not None
    assert slow.rate.max() < 2 * np.pi * complete.SLOW_TURNS / (16 * GAP)
    assert ranks(truth, run.grid, slow).min() > 400
    ordered = run.by_facets(slow, run.slow_rate)
    assert ranks(truth, run.grid, ordered).min() < 100


def restricted(grid: Grid, period: str, pole: str = "") -> Grid:
    """The grid for a known period (s) or pole."""
    known = KnownSpin.of(period, pole)
    assert known is not None
    ranges = known.rates(0.0) or ((0.0, 4 * OMEGA_SD),)
    allowed = Allowed(ranges, None if period else OMEGA_SD, known.pole)
    return Grid.of(grid.series, grid.arcs, grid.prior, allowed)


TRUE_POLE = "308.66,39.79,15"  # of Truth.omega


@pytest.mark.parametrize(
    ("period", "pole", "inside"),
    [
        ("280-330s", "", True),
        ("300.0+-0.2s", "", True),
        ("150s,300s", "", True),
        ("", TRUE_POLE, True),
        ("290-310s", TRUE_POLE, True),
        ("310-400s", "", False),
        ("", "100,0,30", False),
    ],
)
def test_a_search_visits_the_spins_that_are_known(grid: Grid, truth: Truth, period, pole, inside):
    """The truth is among the best cells if it is allowed; otherwise no cell is near it."""
    few = restricted(grid, period, pole)
    result, _, coverage = few.search(1, Silent(), 60_000)
    rate = np.linalg.norm(truth.omega)
    near = np.abs(few.poles[result.pole] @ truth.omega) / rate > np.cos(np.radians(9.0))
    near &= np.abs(result.rate - rate) * GAP < 1.5
    assert near.any() == inside
    if inside:
        assert np.flatnonzero(near).min() < 0.1 * coverage.evaluated
    assert coverage.evaluated < 0.5 * 2000 * few.coarse.size * (GAP * grid.coarse_step)
    assert Coverage.restored(coverage.stored()) == coverage
    if period:
        low, high = few.allowed.ranges[0]
        assert np.all(result.rate + result.width >= low)
        if len(few.allowed.ranges) == 1:
            assert np.all(result.rate - result.width <= high)
            said = searched(asdict(coverage))[0]
            assert f"with periods of {2 * np.pi / high:.5g} to {2 * np.pi / low:.5g} s" in said
    if pole:
        assert "of the sky were searched, and no others" in searched(asdict(coverage))[0]


def test_the_search_says_what_it_covers(grid: Grid):
    said = searched(asdict(grid.coverage(10, 5)))
    assert said[0].startswith(f"All spins up to {4 * OMEGA_SD:.3g} rad/s were searched: of ")


class Stopped(Checkpoint):
    """A checkpoint of a run that is killed when it saves for the nth time."""

    def __init__(self, folder: Path, n: int) -> None:
        super().__init__(folder, {})
        self.left = n

    def save(self, name: str, arrays: dict[str, np.ndarray]) -> None:
        super().save(name, arrays)
        self.left -= 1
        if self.left == 0:
            raise KeyboardInterrupt


class Counted(Grid):
    """A grid that counts its evaluations."""

    evaluations = 0

    def score(self, *args, **kwargs):
        Counted.evaluations += 1
        return super().score(*args, **kwargs)


def test_a_stopped_search_of_cells_goes_on(tmp_path, grid: Grid):
    """Three arcs, two levels: stopped after each, with the numbers of an uninterrupted search."""
    points = grid.arcs
    third = replace_arcs(points)
    allowed = Allowed(((0.019, 0.023),))
    whole = Grid.of(grid.series, third, grid.prior, allowed)
    found = whole.search(1, Silent(), 500)
    counted = Counted(**vars(whole))
    for n, again in ((1, 1), (2, 0)):
        folder = tmp_path / str(n)
        with pytest.raises(KeyboardInterrupt):
            whole.search(1, Silent(), 500, Stopped(folder, n))
        Counted.evaluations = 0
        resumed = counted.search(1, Silent(), 500, Checkpoint(folder, {}))
        assert Counted.evaluations == again
        assert resumed.coverage == found.coverage
        for a, b in zip(resumed.cells + resumed.states, found.cells + found.states, strict=True):
            np.testing.assert_array_equal(a, b)


def replace_arcs(arcs: Arcs) -> Arcs:
    """The arcs with the first once more, half a gap later."""
    every = {k: jnp.concatenate([v, v[:1]]) for k, v in vars(arcs).items()}
    every["middle"] = every["middle"].at[2].add(0.5 * GAP)
    every["span"] = every["span"].at[2].set(every["span"][1])
    return Arcs(**every)


@pytest.mark.slow
def test_a_stopped_search_ends_as_an_uninterrupted_one(tmp_path, truth: Truth, monkeypatch):
    """Stopped at every save, with few states so that it is quick."""
    monkeypatch.setattr(complete, "FREE", (Stage(0.05, 60, 2), Stage(0.02, 80, 2)))
    monkeypatch.setattr(complete, "STATES", (12, 6))
    monkeypatch.setattr(complete, "ALIASES", 4)
    monkeypatch.setattr(complete, "CELLS", 20)
    entry, data = registry.find("faceted"), Epochs.of(truth.curve)
    options = {o.name: o.default for o in entry.options.values()} | {
        "n_facets": 2,
        "period": "290-310s",
        "reflectance": LAW,
    }
    problem, _ = build_problem(entry, options | dict(entry.pooled), data)
    ends, coverage = complete_search(problem, data, options, 1, Silent())
    stops = 0
    while True:
        try:
            kept = Stopped(tmp_path / "kept", 1)
            resumed, covered = complete_search(problem, data, options, 1, Silent(), kept)
            break
        except KeyboardInterrupt:
            stops += 1
    assert stops >= 4
    assert covered == coverage
    for a, b in zip(resumed, ends, strict=True):
        np.testing.assert_array_equal(a, b)


def test_spins_that_differ_by_a_turn_between_passes_are_one_state(grid: Grid):
    turn = 2 * np.pi / grid.gap
    pole, rate = np.zeros(3, int), 0.02 + np.array([0.0, turn, 0.5 * turn])
    cells = Cells(pole, rate, 0.1 * turn, np.array([2.0, 1.0, 0.0]), np.zeros(3))
    assert list(states.representatives(grid, cells, 10)) == [0, 2]
    assert list(states.representatives(grid, cells, 10, span=GAP)) == [0, 1, 2]


def test_the_search_is_for_diffuse_facets_that_spin(truth: Truth):
    entry, data = registry.find("faceted"), Epochs.of(truth.curve)
    for spin, expected in (("free", True), ("none", False), ("torque-free", False)):
        options = {o.name: o.default for o in entry.options.values()} | {"spin": spin}
        problem, _ = build_problem(entry, options | dict(entry.pooled), data)
        assert applies(problem, data, options) is expected


@pytest.mark.slow
def test_the_search_ends_no_worse_than_at_the_truth(truth: Truth):
    entry, data = registry.find("faceted"), Epochs.of(truth.curve)
    options = {o.name: o.default for o in entry.options.values()} | {
        "n_facets": 3,
        "omega_sd": OMEGA_SD,
        "reflectance": LAW,
    }
    problem, _ = build_problem(entry, options | dict(entry.pooled), data)
    ends, _ = complete_search(problem, data, options, 2, Silent())
    body = Bodies(truth.omega[None], truth.normals[None], truth.areas[None])
    best = search.polish(problem, data, starts(problem, data, body, OMEGA_SD), 1)
    assert float(ends.potential[0]) <= float(best.potential[0]) + 0.5


def test_the_phase_of_a_rate_that_drifts_is_its_integral():
    """Against a quadrature of ω (1 + d (t − tₘ)/T), with the prior sd of d."""
    rate, unit, middle, span, sd = 0.02, -1.3, 7000.0, 14_000.0, 0.05
    drift = Drift(middle, span, sd)
    d = unit * sd / np.hypot(1.0, sd * rate * span / 8.0)
    t = np.array([0.0, 900.0, 6100.0, 13_900.0])
    phase = [quad(lambda s: rate * (1.0 + d * (s - middle) / span), 0.0, end)[0] for end in t]
    ours = drift.phase(np.array([rate]), np.array([unit]), t)
    assert np.allclose(ours, [phase], rtol=1e-9, atol=1e-9)
    steady = Drift().phase(np.array([rate]), np.array([unit]), t)
    assert np.allclose(steady, [rate * t], rtol=1e-12)


def test_points_of_two_observers_are_not_averaged(truth: Truth):
    """At one time, the directions to two observers differ, and so does the brightness."""
    one = Points.of(Epochs.of(truth.curve))
    two = one.at(np.repeat(np.arange(one.t.size), 2))
    two = two._replace(
        series=np.tile([0, 1], one.t.size),
        obs=two.obs * (1.0 - 2.0 * (np.arange(two.t.size) % 2))[:, None],
    )
    rows = np.arange(two.t.size)
    window = 3.0 * (one.t[1] - one.t[0])
    averaged = arcs._averaged(two, rows, window)
    alone = arcs._averaged(one, np.arange(one.t.size), window)
    assert averaged.t.size == 2 * alone.t.size
    for series, sign in ((0, 1.0), (1, -1.0)):
        own = averaged.series == series
        np.testing.assert_allclose(averaged.obs[own], sign * alone.obs, rtol=0, atol=1e-12)
        np.testing.assert_allclose(averaged.flux[own], alone.flux)


def test_averaged_directions_are_of_length_one(truth: Truth):
    """Also where the observer passes quickly; they lie between those of the points."""
    one = Points.of(Epochs.of(truth.curve)).at(np.arange(40))
    angle = 0.05 * np.arange(40)
    one = one._replace(obs=np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    averaged = arcs._averaged(one, np.arange(40), 3.0 * (one.t[1] - one.t[0]))
    assert averaged.t.size < 20
    for vectors in (averaged.sun, averaged.obs):
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, rtol=1e-12)
    seen = np.arctan2(averaged.obs[:, 1], averaged.obs[:, 0])
    np.testing.assert_allclose(seen, np.interp(averaged.t, one.t, angle), atol=1e-9)


def test_a_spin_with_other_turns_keeps_the_attitude_in_both_passes(truth: Truth):
    """Facets point to the same stars in the middle of two neighbouring passes, or of the first and
    the last, though the body has turned more or fewer times between them."""
    problem, data = small_curves.posterior(truth.curve, n_facets=3, omega_sd=0.5)
    middles = np.array([40.0, 900.0, 5000.0])
    omega = np.array([0.08, -0.05, 0.06])
    normals = np.random.default_rng(8).standard_normal((3, 3))
    body = Bodies(omega[None], normals[None], np.ones((1, 3)))
    (z,) = starts(problem, data, body, 0.5)
    found = [
        problem.constrain(jnp.asarray(z), data)
        for z in facet_bodies.aliases(problem, data, middles, z)
    ]
    turns = []
    for sites in found:
        new = np.asarray(sites["omega"])
        kept = [
            np.allclose(
                Rotation.from_rotvec(t * new).apply(np.asarray(sites["normals_base"])),
                Rotation.from_rotvec(t * omega).apply(normals),
                atol=1e-6,
            )
            for t in middles
        ]
        assert sum(kept) >= 2
        change = (np.linalg.norm(new) - np.linalg.norm(omega)) / (2 * np.pi)
        spans = [b - a for a, b in combinations(middles[kept], 2)]
        turns.append(round(change * max(spans)))
    assert sorted(turns) == sorted([-2, -1, 1, 2] * 3)
