"""Spins of sparse points: cells of the sphere, periodogram, evidence, and the scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.linalg import block_diag

import lcbayes
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.time_limit import OutOfTime, time_limit
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import (
    evidence,
    maxima,
    periodogram,
    sparse,
    sphere_cells,
    survey,
    verdict,
)
from lcbayes.inversion.attitude_scan.harmonics import (
    ODD,
    ORDERS,
    SparsePoints,
    filled_size,
    fixed_prior,
    shape_columns,
)
from lcbayes.inversion.attitude_scan.shape_classes import Normal, class_priors, prior
from lcbayes.inversion.attitude_scan.spin import tilts
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


@pytest.mark.slow
def test_an_accelerator_finds_the_same_in_larger_batches(points, found, monkeypatch):
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    monkeypatch.setattr(evidence, "BATCH", (1, 300))  # a batch of one would take minutes
    monkeypatch.setattr(maxima, "BATCH", (1, 80))
    best = sparse.search(points, NARROW).spins[0]
    assert best.frequency == found.spins[0].frequency
    assert best.probability == pytest.approx(found.spins[0].probability, rel=1e-6)


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
    shape = np.asarray(shape_columns(points.bisector, points.across, tilt, points.t * frequency))
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
    row = dense_columns(points, POLE, TRUE_HZ)[k, points.fixed.shape[1] :]
    across = tilt.T @ points.across[k]
    expected = [z, z**2 - 1 / 3, z**3, z**4 - 1 / 5]
    expected += [abs(z) - 0.5, across @ across - 0.04, across[2] ** 2]
    expected += [(u**2).real, (u**2).imag, u.real, u.imag, (u * z).real, (u * z).imag]
    np.testing.assert_allclose(row[:13], expected, atol=1e-9)
    four = u**4 / abs(u) ** 2
    terms = (u**4, four, four * z, four * z**2, u**6 / abs(u) ** 4, u**8 / abs(u) ** 6)
    expected = [x for y in terms for x in (y.real, y.imag)]
    np.testing.assert_allclose(row[-12:], expected, atol=1e-9)


def test_columns_tell_their_orders(points):
    """What a turn by an angle does to each column, and a reflection in the equator."""
    tilt, turn = tilts(POLE[None])[0], 0.03
    here, there = (
        np.asarray(shape_columns(points.bisector, points.across, tilt, np.full(len(points.t), x)))
        for x in (0.0, turn)
    )
    zonal = ORDERS == 0
    np.testing.assert_allclose(here[:, zonal], there[:, zonal], atol=1e-12)
    before, after = (x[:, ~zonal][:, ::2] + 1j * x[:, ~zonal][:, 1::2] for x in (here, there))
    angle = np.exp(-2j * np.pi * turn * ORDERS[~zonal][::2])
    np.testing.assert_allclose(after, before * angle, atol=1e-9)
    flipped = tilt * np.array([1.0, 1.0, -1.0])
    mirror = np.asarray(shape_columns(points.bisector, points.across, flipped, 0.0 * points.t))
    np.testing.assert_allclose(mirror, here * np.where(ODD, -1.0, 1.0), atol=1e-12)


def test_periodogram_is_that_of_dense_least_squares(points):
    """Every entry against the normal equations of all columns together, in double precision."""
    w = periodogram.weights(points)
    mean, sd = fixed_prior(1)
    flat, covariance = periodogram.zonal_prior()
    mean = np.concatenate([mean, flat, [0, 0]])
    elongation = periodogram.ELONGATION**2
    blocks = block_diag(np.diag(sd**2), covariance, elongation * np.eye(2))
    known = np.linalg.inv(np.asarray(blocks))
    poles = sphere_cells.centres(np.array([0, 5, 11]), 0)
    apart = 0.2 / points.span
    value = periodogram.periodogram(points, poles, TRUE_HZ, apart, 5)
    half = 0.5 * (points.used.sum() + periodogram.PRIOR_POINTS)
    expected = np.empty_like(value)
    for i, j in np.ndindex(*value.shape):
        full = dense_columns(points, poles[j], TRUE_HZ + i * apart)
        n = points.fixed.shape[1]
        x = full[:, [*range(n), n + 1, n + 4, n + 6, n + 7, n + 8]]
        matrix = x.T @ (w[:, None] * x) + known
        c = np.linalg.solve(matrix, x.T @ (w * points.log_flux) + known @ mean)
        squares = np.sum(w * (points.log_flux - x @ c) ** 2) + (c - mean) @ known @ (c - mean)
        expected[i, j] = -half * np.log(squares) - 0.5 * np.linalg.slogdet(matrix)[1]
    np.testing.assert_allclose(value - value[0, 0], expected - expected[0, 0], atol=2e-3)


def test_an_outlier_has_little_weight(points, curve):
    w = periodogram.weights(points)
    assert np.argmin(w[: curve.n_obs]) == 7
    assert np.all(w[curve.n_obs :] == 0)


def log_normal(points, x, of, scale, tau):
    """ln of the normal density of the data with the covariance of coefficients, nights and points,
    and of the priors of the levels."""
    used = points.used > 0
    night, rows = points.night[used], x[used]
    covariance = scale**2 * np.eye(used.sum()) + tau**2 * night @ night.T
    covariance += rows @ np.linalg.inv(of.precision) @ rows.T
    value = stats.multivariate_normal(rows @ of.mean, covariance).logpdf(points.log_flux[used])
    noise0 = evidence.PRIOR_POINTS * points.noise**2
    value -= evidence.PRIOR_POINTS * np.log(scale) + 0.5 * noise0 / scale**2
    night0 = evidence.NIGHT_SD
    return value - evidence.PRIOR_NIGHTS * (np.log(tau) + 0.5 * (night0 / tau) ** 2)


@pytest.mark.parametrize("rounds", [2, 3])
def test_evidence_is_that_of_correlated_normal_errors(points, monkeypatch, rounds):
    """For many degrees of freedom the evidence at the noise levels found is a normal density, under
    the prior of all shapes and under that of each class."""
    monkeypatch.setattr(evidence, "NU", 1e9)
    monkeypatch.setattr(evidence, "ROUNDS", rounds)
    every, classes = prior(1), class_priors(1)
    host = jax.tree.map(jnp.asarray, points)
    gaps = []
    for f in (TRUE_HZ, 1.001 * TRUE_HZ):
        x = dense_columns(points, POLE, f)
        fit, sums = evidence._fit(host, jnp.asarray(x), every)
        scale, tau = float(fit.noise[0]), float(fit.night)
        gaps.append(float(fit.log_evidence) - log_normal(points, x, every, scale, tau))
        values, factors = evidence._classes(fit, sums, every, classes)
        for k, (value, factor) in enumerate(zip(values, factors, strict=True)):
            one = Normal(*(of[k] for of in classes))
            expected = log_normal(points, x, one, factor * scale, factor * tau)
            gaps.append(float(value) - expected)
    # neither the factors of 2 pi nor those of the prior sd of the levels are part of it
    np.testing.assert_allclose(gaps, 0.5 * points.used.sum() * np.log(2 * np.pi), atol=1e-3)


def test_the_noise_of_a_class_maximises_its_evidence(points):
    """Any other common factor of the levels gives less, once the rounds have converged."""
    fit, sums = evidence._fit(
        jax.tree.map(jnp.asarray, points),
        jnp.asarray(dense_columns(points, POLE, TRUE_HZ)),
        prior(1),
    )
    one = Normal(*(of[0] for of in class_priors(1)))
    factors = np.exp(np.linspace(-0.5, 0.5, 201))
    values = [float(evidence._log_normal(sums, one, jnp.asarray(f))[0]) for f in factors]
    found, factor = evidence._of_class(sums, one)
    assert factors[int(np.argmax(values))] == pytest.approx(float(factor), abs=0.02)
    assert max(values) - 0.05 < float(found) <= max(values) + 1e-3
    assert fit.log_evidence.shape == ()


def test_parts_of_a_cell_have_its_volume(points):
    whole = evidence.cells(points, np.array([3]), 2, np.array([TRUE_HZ]), np.array([1e-9]))
    parts = evidence.divided(points, whole)
    volume = np.log(whole.width / whole.frequency) - np.log(sphere_cells.number(2))
    assert whole.log_mass - whole.log_evidence == pytest.approx(volume)
    of_parts = parts.log_mass - parts.log_evidence
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


def test_neighbours_of_the_best_interval_come_first():
    """Spins at 0, 0.7 and 1.4 turns: the middle one is within a turn of both others, so that all
    three have the probability of the interval around it."""
    turns, shares = np.array([0.0, 0.7, 1.4, 50.0]), [0.02, 0.01, 0.03, 0.9]
    of_period = [0.06, 0.06, 0.06, 0.05]
    spins = [
        sparse.Spin(POLE, t, p, 0.0, q) for t, p, q in zip(turns, shares, of_period, strict=True)
    ]
    assert [s.frequency for s in sparse.most_probable_first(spins)] == [1.4, 0.0, 0.7, 50.0]
    assert sparse.same_period(turns, 0.7, 1.0).tolist() == [True, True, True, False]


def test_noise_has_no_probable_period():
    sphere = sparse_surveys.observed(noise=0.1, axes=np.ones(3))
    found = sparse.search(SparsePoints.of(sphere), (5.0, 6.0))
    assert found.period_probability < 0.9


def seen(flux: np.ndarray, t: np.ndarray, noise: float) -> LightCurve:
    rng = np.random.default_rng(4)
    sun, obs = sparse_surveys.directions(t)
    bright = flux / flux.mean() * np.exp(noise * rng.standard_normal(t.size))
    return LightCurve(
        t=86400.0 * t, brightness=bright, error=None, sun=sun, obs=obs, kind="flux",
        free_scale=np.array([True]), frame="ecliptic-j2000",
    )  # fmt: skip


def best_near(points: SparsePoints, frequency: float) -> float:
    """The greatest evidence of the classes within half a turn, at poles near the true one."""
    off = np.linspace(-0.5, 0.5, 65) / points.span
    level = 4
    every = sphere_cells.centres(np.arange(sphere_cells.number(level)), level)
    poles = every[every @ POLE > np.cos(np.radians(8.0))]
    tried = np.repeat(poles, len(off), axis=0)
    value = evidence.by_class(points, tried, frequency + np.tile(off, len(poles)))
    return float(value.max())


@pytest.mark.parametrize("second", [0.9, 0.75, 0.6])
def test_the_half_period_of_a_box_is_told_by_its_classes(second):
    """Four maxima a turn, alternate ones hardly different: half the period has two of them."""
    t = sparse_surveys.times(np.random.default_rng(3), n_nights=40)
    edges = np.array([1.0, second, 0.5])
    box = SparsePoints.of(seen(sparse_surveys.box_brightness(t, edges), t, 0.01))
    assert best_near(box, TRUE_HZ) > best_near(box, 2.0 * TRUE_HZ) + 5.0


@pytest.mark.parametrize("second", [0.85, 0.7])
def test_the_double_period_of_an_ellipsoid_is_told_by_its_classes(second):
    """Two maxima a turn would be four of a body that is as flat at each of its sides."""
    t = sparse_surveys.times(np.random.default_rng(3), n_nights=40)
    flux = sparse_surveys.brightness(t, np.array([1.0, second, 0.6]))
    smooth = SparsePoints.of(seen(flux, t, 0.01))
    assert best_near(smooth, TRUE_HZ) > best_near(smooth, 0.5 * TRUE_HZ) + 3.0


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
    # Too few poles were compared with the truth, so that none is trusted, however probable.
    assert len({"pole-not-calibrated", "pole-not-unique"} & codes) == 1
    assert not result.trusted
    assert any(" P " in line for line in result.lines())
    first = result.data.solutions[0]
    for share, code in ((0.9, "pole-not-unique"), (0.999, "pole-not-calibrated")):
        elsewhere = replace(first, probability=1.0 - share)
        scan = replace(
            result.data,
            solutions=[replace(first, probability=share), elsewhere],
            period_probability=1.0,
        )
        rows = [result.solutions[0], result.solutions[0] | {"relation": "pole"}]
        assert [finding.code for finding in verdict.improbable(scan, rows, curve)] == [code]
    again = lcbayes.load(tmp_path / "out")
    assert isinstance(again, Scan)
    assert again.data.period_probability == result.data.period_probability
    assert again.solutions == result.solutions


@pytest.mark.slow
def test_arrays_may_be_filled_further(curve, points, found, monkeypatch):
    """Rows and nights that only fill the arrays change nothing but the last digits."""
    monkeypatch.setattr("lcbayes.inversion.attitude_scan.harmonics.ROWS", 100)
    monkeypatch.setattr("lcbayes.inversion.attitude_scan.harmonics.NIGHTS", 45)
    wider = SparsePoints.of(curve)
    assert wider.fixed.shape[0] == 200 > points.fixed.shape[0]
    assert wider.night.shape[1] == 45 > points.night.shape[1]
    again = sparse.search(wider, NARROW)
    np.testing.assert_allclose(again.best, found.best, atol=2e-3)  # single precision
    assert len(again.spins) == len(found.spins)
    for one, other in zip(again.spins, found.spins, strict=True):
        assert one.frequency == pytest.approx(other.frequency, rel=1e-12)
        np.testing.assert_allclose(one.pole, other.pole, atol=1e-9)
        assert one.probability == pytest.approx(other.probability, abs=1e-3)
    for one, other in zip(
        sparse.linear_model(wider, again.spins),
        sparse.linear_model(points, found.spins),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-9)


def test_a_range_of_a_few_periods(points):
    """All hypotheses are listed, and none is left over."""
    resolution = PERIOD_H**2 / (points.span / 3600.0)
    limits = PERIOD_H - 0.4 * resolution, PERIOD_H + 0.4 * resolution
    found = sparse.search(points, limits)
    assert 2 <= len(found.frequencies) <= 5
    assert abs(found.spins[0].frequency - TRUE_HZ) * points.span < 0.6
    assert found.period_probability == pytest.approx(1.0)
    assert sum(s.probability for s in found.spins) == pytest.approx(1.0, abs=0.02)


def test_few_sizes_of_arrays():
    sizes = [filled_size(n, 32) for n in range(1, 2001)]
    assert len(set(sizes)) == 20
    assert all(n <= size < n + 32 or size <= 1.25 * n for n, size in enumerate(sizes, 1))


def test_the_amplitude_is_that_of_the_body(found, points):
    """An ellipsoid under geometric scattering, seen along the bisector nearest to its equator."""
    a, b, c = sparse_surveys.AXES
    used = points.used > 0
    z = points.bisector[used] @ POLE
    # brightness from the equatorial angle: the projected area along longest and middle axis
    area = [a * b * c * np.sqrt((1 - z**2) / axis**2 + z**2 / c**2) for axis in (a, b)]
    expected = float(np.max(2.5 * np.log10(area[1] / area[0])))
    amplitude, rms = sparse.linear_model(points, found.spins[:1])
    assert amplitude[0] == pytest.approx(expected, rel=0.15)
    # two per cent of noise, and one of 120 points off by ln 2
    assert rms[0] == pytest.approx(np.hypot(0.02, np.log(2.0) / np.sqrt(120)), rel=0.15)


def test_rows_of_a_survey(curve, found):
    rows, findings = survey.rows_of(curve, survey.Effort(NARROW, sparse.STEP, 3, refine=False))
    assert len(rows) == min(3, len(found.spins))
    for row, spin in zip(rows, found.spins, strict=False):
        assert row["period_h"] == pytest.approx(1.0 / (3600.0 * spin.frequency))
        lon, lat = np.radians((row["pole_lon_deg"], row["pole_lat_deg"]))
        pole = [np.cos(lon) * np.cos(lat), np.sin(lon) * np.cos(lat), np.sin(lat)]
        np.testing.assert_allclose(pole, spin.pole, atol=1e-9)
        assert row["probability"] == spin.probability
        turns = np.array([abs(s.frequency - spin.frequency) for s in found.spins])
        near = turns * float(np.ptp(curve.t)) < 1
        listed = sum(s.probability for s, same in zip(found.spins, near, strict=True) if same)
        assert listed - 0.02 <= row["period_probability"] <= 1.0
    assert rows[0]["n_obs"] == 120
    assert rows[0]["span_days"] == pytest.approx(np.ptp(curve.t) / 86400.0)
    codes = {finding.code for finding in findings}
    assert "period-not-unique" not in codes
    assert len({"pole-not-calibrated", "pole-not-unique"} & codes) == 1


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        (lambda curve: np.arange(curve.n_obs) < 8, "there are 8 points; a period needs at least"),
        (lambda curve: curve.t < curve.t[0] + 150 * 86400, "sparse points need more than 200"),
    ],
)
def test_a_survey_has_sparse_points(curve, chosen, message):
    few = curve.select(chosen(curve))
    with pytest.raises(InputError, match=message):
        survey.rows_of(few, survey.Effort(NARROW, sparse.STEP, 3, refine=False))


def test_a_search_stops_at_its_limit_of_time(points):
    with time_limit(0.0), pytest.raises(OutOfTime):
        sparse.search(points, NARROW)


def test_the_first_solution_has_the_period_that_is_most_probable():
    """Two poles of one period, together more probable than another solution, come before it."""
    span, f = 1e8, TRUE_HZ
    poles = np.array([0, 40, 100])
    share = np.array([0.3, 0.3, 0.4])
    cells = evidence.Cells(
        poles,
        np.full(3, 2),
        np.array([f, f + 0.4 / span, f + 20.0 / span]),
        np.full(3, 0.25 / span),
        np.array([5.0, 4.0, 6.0]),
        np.log(share),
    )
    spins = sparse._solutions(cells, -np.inf, span)
    assert [s.probability for s in spins] == pytest.approx([0.3, 0.3, 0.4])
    assert [s.period_probability for s in spins] == pytest.approx([0.6, 0.6, 0.4])


@pytest.mark.slow
def test_a_scan_begins_with_the_most_probable_period(curve, monkeypatch):
    """As in the search: its probability of the period is that of the first solution."""
    other = sparse.search(SparsePoints.of(curve), (6.0, 6.02)).spins[0]
    true = sparse.search(SparsePoints.of(curve), NARROW).spins[0]
    spins = [
        replace(true, probability=0.3, period_probability=0.6),
        replace(true, pole=-true.pole, probability=0.3, period_probability=0.6),
        replace(other, probability=0.4, period_probability=0.4),
    ]
    original = sparse.search
    monkeypatch.setattr(sparse, "search", lambda *given: replace(original(*given), spins=spins))
    options = {"period_range": (5.9, 7.33), "n_facets": 80, "degree": 2, "n_sky": 0}
    result = lcbayes.scan(curve, **options)
    resolution = result.data.resolution_h(PERIOD_H)
    assert result.content["period_probability"] == 0.6
    assert result.solutions[0].get("period_h") == pytest.approx(PERIOD_H, abs=resolution)
    assert [s.get("probability") for s in result.solutions] == [0.3, 0.3, 0.4]


def test_refused_options(curve):
    with pytest.raises(InputError, match="leave out --period"):
        lcbayes.scan(curve, first_stage="periodogram", period=7.3)
    brightness = curve.brightness.copy()
    brightness[3] = -0.1
    with pytest.raises(InputError, match="no positive brightness"):
        lcbayes.scan(replace(curve, brightness=brightness), period_range=NARROW)
    with pytest.raises(InputError, match="shortest and the longest"):
        lcbayes.scan(curve, period_range=(7.0, 6.0))
    with pytest.raises(InputError, match="narrower"):
        sparse.search(SparsePoints.of(curve), (0.001, 1000.0))
