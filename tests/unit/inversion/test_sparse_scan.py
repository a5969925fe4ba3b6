"""Spins of sparse points: cells of the sphere, periodogram, evidence, and the scan."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inversion.attitude_scan import evidence, periodogram, sparse, sphere_cells, verdict
from lcbayes.inversion.attitude_scan.harmonics import (
    ELONGATION,
    ZONAL,
    SparsePoints,
    fixed_prior,
    shape_columns,
    shape_prior,
)
from lcbayes.inversion.attitude_scan.spin import tilts
from lcbayes.results.reasons import reason
from lcbayes.tasks.scan.result import Scan
from tests.helpers import sparse_surveys
from tests.helpers.sparse_surveys import PERIOD_H, POLE

TRUE_HZ = 1.0 / (3600.0 * PERIOD_H)
NARROW = (7.27, 7.33)


@pytest.fixture(scope="module")
def curve():
    return sparse_surveys.observed()


@pytest.fixture(scope="module")
def points(curve):
    return SparsePoints.of(curve)


@pytest.fixture(scope="module")
def found(points):
    return sparse.search(points, NARROW)


def test_cells_are_those_of_healpix():
    """Górski et al. 2005: rings of cos(theta), and longitudes, of the twelve base cells."""
    z = np.repeat([2 / 3, 0.0, -2 / 3], 4)
    lon = np.radians([45, 135, 225, 315, 0, 90, 180, 270, 45, 135, 225, 315])
    flat = np.sqrt(1 - z * z)
    expected = np.stack([flat * np.cos(lon), flat * np.sin(lon), z], 1)
    np.testing.assert_allclose(sphere_cells.centres(np.arange(12), 0), expected, atol=1e-15)


@pytest.mark.parametrize("level", [1, 2])
def test_cells_are_equal_and_divide_into_four(level):
    n = sphere_cells.number(level)
    centres = sphere_cells.centres(np.arange(n), level)
    rng = np.random.default_rng(1)
    random = rng.normal(size=(400 * n, 3))
    nearest = np.argmax(random @ centres.T, axis=1)
    # cells are no Voronoi cells, but have nearly their areas
    assert np.all(np.abs(np.bincount(nearest, minlength=n) / 400 - 1) < 0.45)
    parts = sphere_cells.centres(np.arange(4 * n), level + 1).reshape(n, 4, 3)
    assert len(np.unique(np.round(parts.reshape(-1, 3), 9), axis=0)) == 4 * n
    middle = parts.sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    assert np.sum(middle * centres, axis=1).min() > np.cos(0.25 * np.sqrt(4 * np.pi / n))


def dense_columns(points: SparsePoints, pole: np.ndarray, frequency: float) -> np.ndarray:
    tilt = tilts(pole[None])[0]
    shape = np.asarray(shape_columns(points.bisector, tilt, points.t * frequency))
    return np.concatenate([points.fixed, shape], axis=1)


def test_columns_are_harmonics_of_the_body_frame(points):
    """u and z from an explicit rotation matrix about the pole."""
    tilt = tilts(POLE[None])[0]
    k = 5
    angle = 2 * np.pi * TRUE_HZ * points.t[k]
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    x, y, z = (tilt @ turn).T @ points.bisector[k]
    u = x + 1j * y
    row = np.asarray(shape_columns(points.bisector, tilt, points.t * TRUE_HZ))[k]
    expected = [z, z**2 - 1 / 3, z**3, z**4 - 1 / 5, (u**2).real, (u**2).imag]
    expected += [u.real, u.imag, (u * z).real, (u * z).imag]
    np.testing.assert_allclose(row[:10], expected, atol=1e-9)
    four = u**4 / abs(u) ** 2
    expected = [x for y in (u**4, four, four * z, four * z**2) for x in (y.real, y.imag)]
    np.testing.assert_allclose(row[-8:], expected, atol=1e-9)


def test_periodogram_is_that_of_dense_least_squares(points):
    """Every entry against the normal equations of all columns together, in double precision."""
    w = periodogram.weights(points)
    mean, sd = fixed_prior(1)
    mean = np.concatenate([mean, [ZONAL[1][1], 0, 0]])
    sd = np.concatenate([sd, [ZONAL[1][2], ELONGATION, ELONGATION]])
    poles = sphere_cells.centres(np.array([0, 5, 11]), 0)
    apart = 0.2 / points.span
    value = periodogram.periodogram(points, poles, TRUE_HZ, apart, 5)
    half = 0.5 * (points.used.sum() + periodogram.PRIOR_POINTS)
    expected = np.empty_like(value)
    for i, j in np.ndindex(*value.shape):
        full = dense_columns(points, poles[j], TRUE_HZ + i * apart)
        n = points.fixed.shape[1]
        x = full[:, [*range(n), n + 1, n + 4, n + 5]]
        matrix = x.T @ (w[:, None] * x) + np.diag(sd**-2.0)
        c = np.linalg.solve(matrix, x.T @ (w * points.log_flux) + mean / sd**2)
        squares = np.sum(w * (points.log_flux - x @ c) ** 2) + np.sum(((c - mean) / sd) ** 2)
        expected[i, j] = -half * np.log(squares) - 0.5 * np.linalg.slogdet(matrix)[1]
    np.testing.assert_allclose(value - value[0, 0], expected - expected[0, 0], atol=2e-3)


def test_an_outlier_has_little_weight(points, curve):
    w = periodogram.weights(points)
    assert np.argmin(w[: curve.n_obs]) == 7
    assert np.all(w[curve.n_obs :] == 0)


@pytest.mark.parametrize("rounds", [2, 3])
def test_evidence_is_that_of_correlated_normal_errors(points, monkeypatch, rounds):
    """For many degrees of freedom the evidence at the noise levels found is a normal density with
    the covariance of coefficients, nights and points."""
    monkeypatch.setattr(evidence, "NU", 1e9)
    monkeypatch.setattr(evidence, "ROUNDS", rounds)
    mean, sd = (np.concatenate(x) for x in zip(fixed_prior(1), shape_prior(), strict=True))
    used = points.used > 0
    gaps = []
    for f in (TRUE_HZ, 1.001 * TRUE_HZ):
        x = dense_columns(points, POLE, f)
        host = jax.tree.map(jnp.asarray, points)
        fit = evidence._fit(host, jnp.asarray(x), jnp.asarray(mean), jnp.asarray(sd))
        scale, tau = float(fit.noise[0]), float(fit.night)
        night, rows = points.night[used], x[used]
        covariance = scale**2 * np.eye(used.sum()) + tau**2 * night @ night.T
        covariance += (rows * sd**2) @ rows.T
        normal = stats.multivariate_normal(rows @ mean, covariance)
        expected = normal.logpdf(points.log_flux[used])
        noise0 = evidence.PRIOR_POINTS * points.noise**2
        expected -= evidence.PRIOR_POINTS * np.log(scale) + 0.5 * noise0 / scale**2
        night0 = evidence.NIGHT_SD
        expected -= evidence.PRIOR_NIGHTS * (np.log(tau) + 0.5 * (night0 / tau) ** 2)
        gaps.append(float(fit.log_evidence) - expected)
    # neither the factors of 2 pi nor those of the prior sd of the levels are part of it
    np.testing.assert_allclose(gaps, 0.5 * used.sum() * np.log(2 * np.pi), atol=1e-4)


def test_parts_of_a_cell_have_its_volume(points):
    whole = evidence.cells(points, np.array([3]), 2, np.array([TRUE_HZ]), np.array([1e-9]))
    parts = evidence.divided(points, whole)
    volume = np.log(whole.width / whole.frequency) - np.log(sphere_cells.number(2))
    assert whole.log_mass - evidence.INFORMATION * whole.log_evidence == pytest.approx(volume)
    of_parts = parts.log_mass - evidence.INFORMATION * parts.log_evidence
    assert np.log(np.exp(of_parts).sum()) == pytest.approx(volume[0], abs=1e-6)
    np.testing.assert_allclose(np.abs(parts.frequency - TRUE_HZ), 0.25e-9, rtol=1e-5)
    assert set(parts.cell) == {12, 13, 14, 15}


def test_a_spin_is_found_with_its_probability(found, points):
    best = found.spins[0]
    assert abs(best.frequency - TRUE_HZ) * points.span < 0.5
    assert abs(POLE @ best.pole) > np.cos(np.radians(15.0)) or len(found.spins) > 1
    assert any(POLE @ s.pole > np.cos(np.radians(15.0)) for s in found.spins)
    assert found.period_probability > 0.99
    total = sum(s.probability for s in found.spins)
    assert 0.99 < total <= 1.0 + 1e-9


def test_noise_has_no_probable_period():
    sphere = sparse_surveys.observed(noise=0.1, axes=np.ones(3))
    found = sparse.search(SparsePoints.of(sphere), (5.0, 6.0))
    assert found.period_probability < 0.9


def test_half_and_double_periods_are_candidates(points):
    """Cells at 2f and f/2 of every listed frequency that lies in the range."""
    apart = 0.25 / points.span
    frequencies = 0.4 * TRUE_HZ + apart * np.arange(int(2.0 * TRUE_HZ / apart))
    at = np.argmin(np.abs(frequencies - TRUE_HZ))
    listed = evidence.cells(points, np.array([7]), 2, frequencies[[at]], np.array([apart]))
    also = sparse._doubled(points, listed, frequencies, apart)
    assert also is not None
    ratio = np.sort(also.frequency / TRUE_HZ)
    np.testing.assert_allclose(ratio, [0.5] * 3 + [2.0] * 3, atol=1e-4)
    assert set(also.cell) == {7}


def test_sparse_curves_are_recognised(curve):
    assert sparse.is_sparse(curve)
    assert not sparse.is_sparse(curve.select(curve.t < curve.t[0] + 150 * 86400))
    night = replace(curve, t=np.sort(curve.t[0] + 1e5 * np.floor(np.arange(curve.n_obs) / 20)))
    assert not sparse.is_sparse(night)
    assert not sparse.is_sparse(replace(curve, frame="icrs"))


def test_scan_of_sparse_points(curve, found, tmp_path):
    options = {"period_range": NARROW, "n_facets": 80, "degree": 2, "n_sky": 0, "keep": 2}
    result = lcbayes.scan(curve, out=tmp_path / "out", report=False, **options)
    content = result.content
    assert content["period_probability"] == pytest.approx(found.period_probability)
    assert content["n_hypotheses"] == found.n_ranked
    best = result.solutions[0]
    assert best.get("probability") == pytest.approx(found.spins[0].probability)
    resolution = result.data.resolution_h(PERIOD_H)
    assert best.get("period_h") == pytest.approx(PERIOD_H, abs=0.5 * resolution)
    assert best["rms"] < 0.15  # with the outlier; the phase law alone is larger
    codes = {reason["code"] for reason in content["reasons"]}
    assert "period-not-unique" not in codes
    assert "multiple-of-period" not in codes  # they lie outside the range
    assert any(" P " in line for line in result.lines())
    again = lcbayes.load(tmp_path / "out")
    assert isinstance(again, Scan)
    assert again.data.period_probability == result.data.period_probability
    assert again.solutions == result.solutions


@pytest.mark.parametrize(
    ("probability", "limits_h", "named"),
    [
        (0.995, None, True),
        (0.995, (2.0, 1.9 * PERIOD_H), True),
        (0.995, (0.6 * PERIOD_H, 2.1 * PERIOD_H), True),
        (0.995, (0.6 * PERIOD_H, 1.9 * PERIOD_H), False),
        (0.98, None, False),  # not unique in any case
    ],
)
def test_half_and_twice_a_unique_period_are_not_excluded(probability, limits_h, named):
    best = SimpleNamespace(frequency=1.0 / (3600.0 * PERIOD_H), probability=probability)
    scan = SimpleNamespace(
        period_probability=probability,
        solutions=[best],
        t=np.array([0.0, 1e8]),
        settings=SimpleNamespace(period_range_h=limits_h, period_step=0.5),
        resolution_h=lambda period: period**2 * 3600.0 / 1e8,
    )
    findings = {f.code: f for f in verdict._improbable(scan, [{}])}  # type: ignore[arg-type]
    assert ("multiple-of-period" in findings) == named
    if named:
        text = reason(findings["multiple-of-period"]).text
        assert f"{PERIOD_H / 2:.7g} and {2 * PERIOD_H:.7g} h, are not excluded" in text


def test_refused_options(curve):
    with pytest.raises(InputError, match="leave out --period"):
        lcbayes.scan(curve, first_stage="periodogram", period=7.3)
    brightness = curve.brightness.copy()
    brightness[3] = -0.1
    with pytest.raises(InputError, match="no positive brightness"):
        lcbayes.scan(replace(curve, brightness=brightness), period_range=NARROW)
    with pytest.raises(InputError, match="shortest and the longest"):
        sparse.search(SparsePoints.of(curve), (7.0, 6.0))
    with pytest.raises(InputError, match="narrower"):
        sparse.search(SparsePoints.of(curve), (0.001, 1000.0))
