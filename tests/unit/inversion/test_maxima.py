"""Maxima of the evidence of sparse points: slopes, the way uphill, and what a search finds."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from numpy.linalg import slogdet
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inversion.attitude_scan import evidence, grid, maxima, sparse, sphere_cells
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints, shape_columns
from lcbayes.inversion.attitude_scan.shape_classes import prior
from lcbayes.inversion.attitude_scan.spin import tilts
from tests.helpers import sparse_surveys
from tests.helpers.sparse_surveys import PERIOD_H, POLE

TRUE_HZ = np.array([1.0 / (3600.0 * PERIOD_H)])
NARROW = (7.27, 7.33)


@pytest.fixture(scope="module")
def points():
    return SparsePoints.of(sparse_surveys.observed())


@pytest.fixture(scope="module")
def fit(points):
    return evidence.fits(points, POLE[None], TRUE_HZ)


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v)


def near_truth(rng: np.random.Generator, points: SparsePoints, number: int):
    """Spins within some ten degrees and a tenth of a turn over the data."""
    poles = np.array([unit(POLE + 0.1 * rng.standard_normal(3)) for _ in range(number)])
    return poles, TRUE_HZ + 0.1 * rng.standard_normal(number) / points.span


def columns(points: SparsePoints, pole: np.ndarray, frequency: float) -> np.ndarray:
    tilt = tilts(pole[None])[0]
    shape = shape_columns(points.bisector, points.across, tilt, points.t * frequency)
    return np.concatenate([points.fixed, np.asarray(shape)], axis=1)[points.used > 0]


def covariance(points: SparsePoints, fit: evidence.Fits) -> np.ndarray:
    """Of the points: their own errors, those of nights, and outliers as larger errors."""
    used = points.used > 0
    level = points.error[used] * (points.group[used] @ fit.noise[0])
    night = points.night[used]
    return np.diag(level**2 / fit.weight[0, used]) + fit.night[0] ** 2 * night @ night.T


def test_the_density_is_that_of_normal_errors(points, fit):
    """Against the dense covariance of the data, with that of the coefficients."""
    poles, frequencies = near_truth(np.random.default_rng(1), points, 4)
    noise = maxima.Noise.of(points, fit).rows(np.zeros(4, int))
    value = maxima.density(points, poles, frequencies, noise)
    every, of_points = prior(1), covariance(points, fit)
    expected = []
    for pole, f in zip(poles, frequencies, strict=True):
        x = columns(points, pole, f)
        whole = of_points + x @ np.linalg.inv(every.precision) @ x.T
        less = points.log_flux[points.used > 0] - x @ every.mean
        expected.append(-0.5 * less @ np.linalg.solve(whole, less) - 0.5 * slogdet(whole)[1])
    np.testing.assert_allclose(value - value[0], np.array(expected) - expected[0], atol=1e-4)


def test_slopes_are_those_of_differences(points, fit):
    """Gradient and curvature with the coefficients eliminated, from dense NumPy matrices."""
    poles, frequencies = near_truth(np.random.default_rng(2), points, 1)
    noise = jax.tree.map(lambda x: jnp.asarray(x[0]), maxima.Noise.of(points, fit))
    spin = jnp.asarray(tilts(poles)[0]), jnp.asarray(frequencies[0])
    given = jax.tree.map(jnp.asarray, points)
    found = maxima._model(given, noise, prior(1), spin)
    inverse, every = np.linalg.inv(covariance(points, fit)), prior(1)
    used = points.used > 0

    def turned(step):
        """Columns after two rotations and a change of frequency."""
        turn = Rotation.from_rotvec([step[0], step[1], 0.0]).as_matrix()
        turns = points.t * (frequencies[0] + 0.5 * step[2] / points.span)
        given = points.bisector, points.across, tilts(poles)[0] @ turn, turns
        return np.concatenate([points.fixed, shape_columns(*given)], axis=1)[used]

    x, y = turned(np.zeros(3)), points.log_flux[used]
    root = np.linalg.inv(x.T @ inverse @ x + every.precision)
    c = root @ (x.T @ inverse @ y + every.precision @ every.mean)
    steps = 1e-5 * np.eye(3)
    rows = np.stack([(turned(s) - turned(-s)) @ c / 2e-5 for s in steps], axis=1)
    np.testing.assert_allclose(found.gradient, -rows.T @ inverse @ (y - x @ c), rtol=1e-5)
    own = inverse - inverse @ x @ root @ x.T @ inverse
    np.testing.assert_allclose(found.curvature, rows.T @ own @ rows, rtol=1e-5, atol=1e-3)


def test_a_maximum_is_the_one_that_a_simplex_finds(points, fit):
    """Nelder and Mead's method on the penalised squares of dense NumPy matrices."""
    inverse, every = np.linalg.inv(covariance(points, fit)), prior(1)
    y = points.log_flux[points.used > 0]

    def misfit(step):
        pole = unit(POLE + tilts(POLE[None])[0][:, :2] @ step[:2])
        x = columns(points, pole, TRUE_HZ[0] + step[2] / points.span)
        matrix = x.T @ inverse @ x + every.precision
        c = np.linalg.solve(matrix, x.T @ inverse @ y + every.precision @ every.mean)
        less = y - x @ c
        return less @ inverse @ less + (c - every.mean) @ every.precision @ (c - every.mean)

    end = minimize(misfit, np.zeros(3), method="Nelder-Mead", options={"fatol": 1e-3})
    expected = unit(POLE + tilts(POLE[None])[0][:, :2] @ end.x[:2])
    poles, frequencies = near_truth(np.random.default_rng(3), points, 6)
    noise = maxima.Noise.of(points, fit).rows(np.zeros(6, int))
    poles, frequencies = maxima.ascended(points, poles, frequencies, noise)
    assert np.degrees(np.arccos(np.clip(poles @ expected, -1, 1))).max() < 1.0
    off = np.abs(frequencies - TRUE_HZ) * points.span - abs(end.x[2])
    assert np.abs(off).max() < 0.02


def test_targets_are_distinct_and_cover_their_surroundings(points):
    """Two ends at one maximum make one target; a maximum that is too low makes none."""
    poles = np.array([POLE, unit(POLE + 0.02), -POLE, unit(np.array([1.0, 0, 0]))])
    f = np.full(4, TRUE_HZ[0])
    value = np.array([10.0, 9.0, 8.0, -31.0])
    targets = maxima._targets(points, poles, f, value, 0.25 / points.span, -30.0)
    assert len(targets.cell) == 2 * 5
    assert np.all(targets.level == maxima.TARGET_LEVEL)
    off = np.degrees(np.arccos(np.abs(targets.pole @ POLE)))
    assert off[:2].max() < 1.5  # as wide as these cells
    np.testing.assert_allclose(off[2:], maxima.AROUND, atol=1.5)


def test_half_of_a_double_period_is_tried(monkeypatch):
    """A true period of 19.678458 h, whose maximum is too narrow to be seen from a coarse cell.

    Two aliases lie 0.75 turns over the data on either side. Twice one of them leads to twice the
    true period, with more evidence than both, and its half to the true one, with more again.
    """
    monkeypatch.syspath_prepend(str(Path(__file__).parents[3] / "benchmarks"))
    late_curves = import_module("late_curves")
    data, period_h, _ = late_curves.drawn(6014, "late")
    points = SparsePoints.of(late_curves.curve(data))
    apart, number = 0.25 / points.span, sphere_cells.number(2)
    first, count = grid.frequencies((19.0, 41.0), apart)
    frequencies = first + apart * np.arange(count)
    aliases = 1.0 / (3600.0 * np.array([19.6838, 19.6733]))
    near = frequencies[np.argmin(np.abs(frequencies[:, None] - aliases), axis=0)]
    cell, f = np.tile(np.arange(number), 2), near.repeat(number)
    coarse = evidence.cells(points, cell, 2, f, np.full(len(f), apart))
    found = maxima.divided_at_maxima(points, coarse, frequencies, apart, 2)
    best = found.frequency[np.argmax(found.log_evidence)]
    assert abs(best - 1.0 / (3600.0 * period_h)) * points.span < 0.1
    twice = np.abs(found.frequency - 0.5 * best) * points.span < 0.25
    assert coarse.log_evidence.max() < found.log_evidence[twice].max() - 10.0
    assert found.log_evidence[twice].max() < found.log_evidence.max() - 10.0


@pytest.mark.slow
def test_a_search_finds_the_maximum_at_the_true_pole():
    """A case where the cells of the periodogram lead to a pole 150 degrees off, and the parts of
    those at the true one are not looked at without the way uphill."""
    rng = np.random.default_rng(3)
    pole = unit(rng.standard_normal(3))
    axes = np.array([1.0, 0.7, 0.5])
    sharp = sparse_surveys.observed(noise=0.004, seed=3, pole=pole, axes=axes)
    points = SparsePoints.of(sharp)
    noise = maxima.Noise.of(points, evidence.fits(points, pole[None], TRUE_HZ))
    top = evidence.by_class(points, *maxima.ascended(points, pole[None], TRUE_HZ, noise))[0]
    found = sparse.search(points, NARROW)
    assert found.cells.log_evidence.max() > top - 0.5
    assert found.spins[0].pole @ pole > np.cos(np.radians(10.0))
