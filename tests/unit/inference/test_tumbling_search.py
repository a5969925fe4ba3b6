"""The search for torque-free motion, against an integrator and brute-force sums over facets."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import sph_harm_y

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.spin_search import motions, tumbling
from lcbayes.inference.spin_search.arcs import Points, averaged
from lcbayes.inference.spin_search.cells import Coverage
from lcbayes.inference.spin_search.motions import Motions, Scale, Window
from lcbayes.inference.spin_search.rotated import Rotated
from lcbayes.inference.spin_search.series import Response, Series, precision, total_area
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import compiled
from lcbayes.results.reasons import searched

SCALE = Scale(0.01, 1.0)
TIMES = np.linspace(-200.0, 200.0, 31)
# symmetric traceless matrices in the order of the site `inertia_base`
BASIS = np.zeros((5, 3, 3))
for _k, (_i, _j) in enumerate(((0, 1), (0, 2), (1, 2))):
    BASIS[_k, _i, _j] = BASIS[_k, _j, _i] = 0.5**0.5
BASIS[3] = np.diag([1.0, -1.0, 0.0]) / 2**0.5
BASIS[4] = np.diag([1.0, 1.0, -2.0]) / 6**0.5


def inertia(x: np.ndarray) -> np.ndarray:
    """J = tr(M) I − M with M = exp S, by SciPy's eigenvectors."""
    values, axes = np.linalg.eigh(np.tensordot(x[3:], BASIS, 1))
    second = (axes * np.exp(values)) @ axes.T
    return np.trace(second) * np.eye(3) - second


def integrated(x: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Attitudes (T, 3, 3) from Ȧ = A [ω×] and Euler's equations by DOP853, A(0) = I."""
    tensor = inertia(x)
    inverse = np.linalg.inv(tensor)

    def slope(_, y):
        a, w = y[:9].reshape(3, 3), y[9:]
        cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        return np.concatenate([(a @ cross).ravel(), inverse @ np.cross(tensor @ w, w)])

    out = np.empty((len(times), 3, 3))
    start = np.concatenate([np.eye(3).ravel(), SCALE.omega * x[:3]])
    for side in (times < 0, times >= 0):
        order = np.argsort(np.abs(times[side]))
        at = times[side][order]
        if at.size == 0:
            continue
        run = solve_ivp(slope, (0.0, at[-1]), start, "DOP853", t_eval=at, rtol=1e-11, atol=1e-12)
        out[np.flatnonzero(side)[order]] = run.y[:9].T.reshape(-1, 3, 3)
    return out


def directions(n: int) -> tuple[np.ndarray, np.ndarray]:
    lon = np.linspace(0.3, 1.6, n)
    obs = np.stack([np.cos(lon), 0.8 * np.sin(lon), 0.6 * np.sin(lon)], axis=1)
    return np.tile([0.0, 0.6, 0.8], (n, 1)), obs


def harmonics(normals: np.ndarray, degree: int) -> np.ndarray:
    """Real spherical harmonics (N, P) by SciPy, in the order of `Response`."""
    polar, azimuth = np.arccos(normals[:, 2]), np.arctan2(normals[:, 1], normals[:, 0])
    pairs = [(n, m) for m in range(degree + 1) for n in range(m, degree + 1)]
    sign = {m: (-1) ** m * (2**0.5 if m else 1.0) for m in range(degree + 1)}
    values = {(n, m): sign[m] * sph_harm_y(n, m, polar, azimuth) for n, m in pairs}
    cosine = [values[p].real for p in pairs]
    sine = [values[p].imag for p in pairs if p[1]]
    return np.stack(cosine + sine, axis=1)


def design(x: np.ndarray, degree: int, n: int = 40_000) -> np.ndarray:
    """Brightness (T, P) of harmonics on n facets of a body that an integrator turned."""
    i = np.arange(n) + 0.5
    z, lon = 1 - 2 * i / n, np.pi * (1 + 5**0.5) * i
    normals = np.stack([np.sqrt(1 - z**2) * np.cos(lon), np.sqrt(1 - z**2) * np.sin(lon), z], 1)
    attitude = integrated(x, TIMES)
    sun, obs = (np.einsum("tij,ti->tj", attitude, v) for v in directions(TIMES.size))
    kernel = np.maximum(sun @ normals.T, 0) * np.maximum(obs @ normals.T, 0) / np.pi
    return kernel @ harmonics(normals, degree) * 4 * np.pi / n


@pytest.fixture(scope="module")
def rotated() -> Rotated:
    return Rotated.of(Series.of("lambertian", 2))


@pytest.fixture(scope="module")
def points() -> Points:
    sun, obs = directions(TIMES.size)
    rng = np.random.default_rng(0)
    flux = 1.0 + rng.uniform(0, 1, TIMES.size)
    series = np.zeros(TIMES.size, int)
    return Points(TIMES, sun, obs, flux, np.full(TIMES.size, 0.02), series)


@pytest.fixture(scope="module")
def window(rotated: Rotated, points: Points) -> Window:
    prior = np.linspace(0.5, 2.0, rotated.series.size)
    return Window.of(rotated, points, prior, 0.1, TIMES.size + 5)


MOTIONS = np.random.default_rng(1).normal(size=(3, 8))
TOP = np.array([1.2, 0.4, 1.5, 0.0, 0.0, 0.0, 0.0, -1.6])  # a symmetric top, prolate along z


def test_the_score_is_that_of_a_gaussian_field_on_facets(rotated, window, points):
    """Differences of ln N(y; 0, C + A S Aᵀ) for 40,000 facets turned by an integrator."""
    every = np.concatenate([MOTIONS, TOP[None]])
    ours = motions.scores(rotated, window, SCALE, every, 1) + 0.5 * np.sum(every**2, axis=1)
    dense = []
    prior = np.linspace(0.5, 2.0, rotated.series.size)
    for x in every:
        a = design(x, 2)
        covariance = np.eye(TIMES.size) * (0.02**2 + 0.1**2) + a / prior @ a.T
        log_det = np.linalg.slogdet(covariance)[1]
        dense.append(-0.5 * points.flux @ np.linalg.solve(covariance, points.flux) - 0.5 * log_det)
    assert np.ptp(dense) > 20.0
    # the series sums over 200 normals
    assert np.allclose(np.diff(ours), np.diff(dense), rtol=0, atol=0.02 * np.ptp(dense))


def test_a_symmetric_top_turns_as_the_integrator_says(rotated, points):
    """Precession, nutation and rotation of the harmonics, in the general case too."""
    rows = rotated.rows(jnp.asarray(points.sun), jnp.asarray(points.obs))
    for x in (TOP, MOTIONS[0]):
        ours = rotated.turned(rows, jnp.asarray(integrated(x, TIMES)))
        assert np.abs(np.asarray(ours) - design(x, 2)).max() < 0.01


def test_an_upright_body_is_not_singular(rotated, points):
    rows = rotated.rows(jnp.asarray(points.sun), jnp.asarray(points.obs))
    angle = jnp.linspace(0.0, 6.0, TIMES.size)
    c, s, zero = jnp.cos(angle), jnp.sin(angle), jnp.zeros(TIMES.size)
    about_z = jnp.stack([c, -s, zero, s, c, zero, zero, zero, zero + 1.0], 1).reshape(-1, 3, 3)
    expected = rotated.series.turned(_split(rotated, rows), angle)
    assert np.allclose(rotated.turned(rows, about_z), expected, rtol=0, atol=1e-12)


def _split(rotated: Rotated, rows):
    n = rotated.series.cosine.shape[1]
    return Response(rows[:, :n], rows[:, n:])


def test_the_derivatives_of_the_misfit(rotated, window):
    x = jnp.asarray(MOTIONS[1])
    value = jax.jit(lambda y: motions._eliminated(rotated, window, SCALE, y).value)
    numeric = [(value(x + 1e-5 * e) - value(x - 1e-5 * e)) / 2e-5 for e in jnp.eye(8)]
    found = motions._eliminated(rotated, window, SCALE, x)
    assert np.allclose(found.gradient, numeric, rtol=1e-5, atol=1e-5)
    assert np.linalg.eigvalsh(found.curvature).min() >= 1.0 - 1e-9  # no less than the prior's


def test_motions_are_improved_and_told_apart(rotated, window):
    found = motions.improved(rotated, window, SCALE, MOTIONS, 8, 1)
    assert np.all(np.diff(found.score) <= 0)
    again = np.concatenate([found.x[:1], found.x[:1] + 1e-4, found.x[:1] + 3.0])
    same = Motions(again, np.zeros(3), np.tile(np.eye(8), (3, 1, 1)))
    assert list(motions.distinct(same, 3, 1.0)) == [0, 2]
    assert list(motions.within(np.array([5, 2, 5, 5, 2, 7]), 2)) == [0, 1, 2, 4, 5]
    assert motions.spread(found, 4, np.random.default_rng(0)).shape == (12, 8)


def test_a_motion_is_the_same_from_a_later_epoch():
    """A(t) from the integrator, started again at 120 s."""
    x, late = MOTIONS[2], 120.0
    later = motions.moved(x[None], late, SCALE)[0]
    both = integrated(x, np.array([0.0, late, late + 70.0]))
    again = integrated(later, np.array([0.0, 70.0]))
    assert np.allclose(again[1] @ both[1], both[2], rtol=0, atol=1e-8)
    assert np.allclose(motions.moved(later[None], -late, SCALE)[0], x, rtol=0, atol=1e-10)


def test_the_first_motions_cover_the_prior():
    x = tumbling.prior_motions(2**12)
    rate = np.linalg.norm(x[:, :3], axis=1)
    assert rate.max() < tumbling.PRIOR_REACH
    assert np.allclose(np.histogram(rate, 8, (0, tumbling.PRIOR_REACH))[0], 512, atol=2)
    assert np.abs(np.mean(x[:, :3] / rate[:, None], axis=0)).max() < 0.01
    assert np.allclose(np.cov(x[:, 3:].T), np.eye(5), atol=0.05)


def test_windows_grow_from_the_longest_pass():
    t = np.concatenate([np.arange(0, 100, 10.0), 5000 + np.arange(0, 400, 10.0)])
    sun, obs = directions(t.size)
    points = Points(t, sun, obs, np.ones(t.size), np.ones(t.size), np.zeros(t.size, int))
    passes = [np.arange(10), np.arange(10, 50)]
    found = motions.windows(points, 200.0, 1.5, passes)
    assert set(found[0]) <= set(passes[1])
    assert np.ptp(t[found[0]]) == pytest.approx(200.0)
    assert all(set(a) < set(b) for a, b in itertools.pairwise(found))
    assert found[-1].size == t.size
    assert len(found) < 12


def test_windows_share_a_few_sizes():
    sizes = [tumbling.padded_size(n, 100) for n in range(1, 101)]
    assert sorted(set(sizes)) == [1, 2, 7, 25, 100]
    assert all(n <= size for n, size in enumerate(sizes, 1))


def test_points_of_two_observers_are_not_averaged(points: Points):
    both = points._replace(
        t=np.repeat(TIMES[::2], 2)[: TIMES.size], series=np.arange(TIMES.size) % 2
    )
    found = averaged(both, np.arange(TIMES.size), 1.0)
    assert found.t.size == TIMES.size
    assert np.allclose(np.linalg.norm(found.obs, axis=1), 1.0)
    assert averaged(points, np.arange(TIMES.size), 1e4).t.size == 1


def _case(seed: int = 3) -> tuple[LightCurve, np.ndarray, np.ndarray, np.ndarray]:
    """Three facets that tumble through two turns, with the motion, normals and areas."""
    t = np.linspace(0.0, 480.0, 60)
    x = np.array([0.9, -1.1, 1.4, 0.6, -0.3, 0.5, 0.9, -0.7])
    normals = np.array([[0.6, 0.0, 0.8], [-0.8, 0.6, 0.0], [0.0, -0.8, -0.6]])
    areas = np.array([2.0, 1.0, 3.0])
    attitude = integrated(x, t)
    sun, obs = directions(t.size)
    s, o = (np.einsum("tij,ti->tj", attitude, v) for v in (sun, obs))
    flux = np.maximum(s @ normals.T, 0.0) * np.maximum(o @ normals.T, 0.0) / np.pi @ areas
    error = np.full(t.size, flux.mean() / 50.0)
    noise = error * np.random.default_rng(seed).standard_normal(t.size)
    curve = LightCurve(
        t=t,
        brightness=flux + noise,
        error=error,
        kind="flux",
        sun=sun,
        obs=obs,
        free_scale=np.array([False]),
    )
    return curve, x, normals, areas


OPTIONS = {"n_facets": 3, "omega_sd": SCALE.omega, "reflectance": "lambertian"}


def _problem(curve: LightCurve, spin: str):
    entry, data = registry.find("faceted"), Epochs.of(curve)
    options = {o.name: o.default for o in entry.options.values()} | OPTIONS | {"spin": spin}
    return build_problem(entry, options | dict(entry.pooled), data)[0], data, options


def test_the_search_is_for_diffuse_facets_in_torque_free_motion():
    curve = _case()[0]
    for spin, expected in (("free", False), ("none", False), ("torque-free", True)):
        assert tumbling.applies(*_problem(curve, spin)) is expected
    rows = {k: getattr(curve, k)[::6] for k in ("t", "brightness", "error", "sun", "obs")}
    few = LightCurve(kind="flux", free_scale=np.array([False]), **rows)
    assert not tumbling.applies(*_problem(few, "torque-free"))


def test_the_sentence_on_what_was_covered():
    coverage = Coverage(0.04, 31_000_000_000, 90_208, 259, tumbling=True)
    assert Coverage.restored(coverage.stored()) == coverage
    (line,) = searched(vars(coverage))
    assert line.startswith("Torque-free motions up to 0.04 rad/s were searched")
    assert all(number in line for number in ("3e+10", "90,208", "259"))


def test_bodies_have_the_motion_and_facets_near_the_true_ones():
    curve, x, normals, areas = _case()
    problem, data, options = _problem(curve, "torque-free")
    points, series = Points.of(data), Series.of(options["reflectance"])
    total = total_area(series, points.sun, points.obs, points.flux)
    run = tumbling._Search(points, Rotated.of(series), precision(series, total), SCALE, workers=1)
    starts = run.starts(problem, data, x[None], total, 3)
    assert len(starts) == tumbling.CLUSTERS
    found = compiled(problem.constrain)(jnp.asarray(starts[0]), data)
    assert np.allclose(found["omega"], SCALE.omega * x[:3], rtol=0, atol=1e-15)
    assert np.allclose(found["inertia_base"], x[3:], rtol=0, atol=1e-12)
    misfit = (np.asarray(found["flux"]) - curve.brightness) / curve.brightness.std()
    assert np.sqrt(np.mean(misfit**2)) < 0.5
    assert (np.asarray(found["normals"]) @ normals[np.argmax(areas)]).max() > 0.9
