"""What further nights would bring: the predicted points, nights that tell nothing, and whether the
predicted probability comes true."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import evidence, nights, sparse
from lcbayes.inversion.attitude_scan.harmonics import (
    SparsePoints,
    fixed_prior,
    shape_columns,
)
from lcbayes.inversion.attitude_scan.shape_classes import shape_prior
from lcbayes.inversion.attitude_scan.spin import tilts
from tests.helpers import sparse_surveys
from tests.helpers.sparse_surveys import PERIOD_H

NARROW = (7.25, 7.35)
AFTER = np.array([8.0, 9.6, 11.1])  # days after the last point, at which nights begin
ERROR_MAG = 0.02


def geometry(curve: LightCurve, times: np.ndarray) -> LightCurve:
    """Epochs (days) and directions without brightness."""
    sun, obs = sparse_surveys.directions(times)
    return LightCurve(
        t=86400.0 * times,
        brightness=np.full(times.size, np.nan),
        error=None,
        sun=sun,
        obs=obs,
        kind=curve.kind,
        frame=curve.frame,
    )


def hours_after(curve: LightCurve, n_points: int = 20) -> np.ndarray:
    """Times (days) of three nights of six hours."""
    begins = curve.t.max() / 86400.0 + AFTER
    return np.concatenate([b + np.linspace(0.0, 0.25, n_points) for b in begins])


@pytest.fixture(scope="module")
def searched():
    curve = sparse_surveys.observed(noise=0.16)
    points = SparsePoints.of(curve)
    return curve, points, sparse.search(points, NARROW)


def test_points_are_predicted_as_by_the_joint_normal(searched):
    """Conditioning the joint normal of old and new points, without any coefficients."""
    curve, points, _ = searched
    pole, frequency = sparse_surveys.POLE[None], np.array([1.0 / (3600.0 * PERIOD_H)])
    fit = evidence.fits(points, pole, frequency)
    mean, covariance = nights._coefficients(points, fit, pole, frequency)
    spins = nights.Draws(pole, frequency, np.ones(1), mean, covariance, np.asarray(fit.night))
    (night, *_) = nights._nights(curve, geometry(curve, hours_after(curve, 7)))
    variance = 0.03**2
    predicted, factor = nights.predicted(night, spins, variance)

    rows = points.used > 0
    (tilt,) = tilts(pole)
    before = np.asarray(shape_columns(points.bisector, points.across, tilt, points.t * frequency))
    after = np.asarray(shape_columns(night.bisector, night.across, tilt, night.t * frequency))
    n_old, n_new = int(rows.sum()), len(night.t)
    n_offsets = points.group.shape[1]
    # columns: offset and phase law of the data, offset of the night, phase law and shape of both
    old = np.concatenate([points.fixed[rows], np.zeros((n_old, 1)), before[rows]], axis=1)
    new = np.concatenate([np.zeros((n_new, n_offsets)), night.phase], axis=1)
    new = np.concatenate([new, np.ones((n_new, 1)), after], axis=1)
    (first, sd), (of_shape, spread_of_shape) = fixed_prior(n_offsets), shape_prior()
    prior_mean = np.concatenate([first, [0.0], of_shape])
    spread = np.asarray(block_diag(np.diag(np.append(sd, 1.0) ** 2), spread_of_shape))
    x = np.concatenate([old, new])
    joint = x @ spread @ x.T
    shared = np.zeros((n_old + n_new, points.night.shape[1] + 1))
    shared[:n_old, :-1], shared[n_old:, -1] = points.night[rows], 1.0
    joint += float(fit.night[0]) ** 2 * shared @ shared.T
    level = (points.error * (points.group @ fit.noise[0]))[rows] ** 2 / fit.weight[0][rows]
    joint += np.diag(np.concatenate([level, np.full(n_new, variance)]))
    gain = np.linalg.solve(joint[:n_old, :n_old], joint[:n_old, n_old:]).T
    expected = new @ prior_mean + gain @ (points.log_flux[rows] - old @ prior_mean)
    spread = joint[n_old:, n_old:] - gain @ joint[:n_old, n_old:]
    np.testing.assert_allclose(predicted[0], expected, atol=1e-8)
    np.testing.assert_allclose(factor[0] @ factor[0].T, spread, atol=1e-8)


def test_single_points_tell_nothing_and_long_nights_tell_most(searched):
    curve, points, found = searched
    begins = curve.t.max() / 86400.0 + AFTER
    ask = nights.Further(geometry(curve, begins), ERROR_MAG)
    alone = nights.outlook(points, found, curve, ask)
    assert 0.02 < alone["now"] < 0.6
    for row in alone["nights"]:  # a zero point of its own takes what a single point says
        assert row["probability"] == pytest.approx(alone["now"], abs=0.02)
        assert row["n_points"] == 1
    long = nights.outlook(
        points, found, curve, nights.Further(geometry(curve, hours_after(curve)), ERROR_MAG)
    )
    assert [row["n_points"] for row in long["nights"]] == [20, 20, 20]
    assert [row["hours"] for row in long["nights"]] == pytest.approx([6.0, 6.0, 6.0])
    assert min(row["probability"] for row in long["nights"]) > alone["now"] + 0.1
    reached = [row["probability"] for row in long["together"]]
    assert reached == sorted(reached)
    assert reached[-1] <= 1.0
    assert "3 nights:" in "\n".join(nights.words(long)) or len(reached) < 3


def test_nights_in_other_axes_are_refused(searched):
    curve, points, found = searched
    other = replace(geometry(curve, hours_after(curve)), frame="icrs")
    with pytest.raises(InputError, match="the nights are in icrs and the light curve in ecliptic"):
        nights.outlook(points, found, curve, nights.Further(other, ERROR_MAG))


@pytest.mark.slow
def test_the_predicted_probability_comes_true():
    """Ellipsoids with random axes and poles: the mean probability of the true period once the night
    is observed and all points are searched again, against the predicted one, within 3.3 standard
    errors (0.1 %)."""
    predicted, came = [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        b = rng.uniform(0.6, 0.95)
        pole = rng.standard_normal(3)
        body = {
            "axes": np.array([1.0, b, rng.uniform(0.6, 1.0) * b]),
            "pole": pole / np.linalg.norm(pole),
        }
        curve = sparse_surveys.observed(noise=0.05, seed=100 + seed, **body)
        points = SparsePoints.of(curve)
        found = sparse.search(points, NARROW)
        times = hours_after(curve)[:20]
        further = nights.Further(geometry(curve, times), ERROR_MAG)
        (row,) = nights.outlook(points, found, curve, further, seed)["nights"]
        predicted.append(row["probability"])
        noise = ERROR_MAG * np.log(10.0) / 2.5 * rng.standard_normal(20)
        night = sparse_surveys.brightness(times, **body) * np.exp(noise)
        sun, obs = sparse_surveys.directions(times)
        both = LightCurve(
            t=np.concatenate([curve.t, 86400.0 * times]),
            brightness=np.concatenate([curve.brightness, night / night.mean()]),
            error=None,
            sun=np.concatenate([curve.sun, sun]),
            obs=np.concatenate([curve.obs, obs]),
            kind="flux",
            curve=np.repeat([0, 1], [curve.n_obs, 20]),
            free_scale=np.array([True, True]),
            frame=curve.frame,
        )
        again = SparsePoints.of(both)
        spins = sparse.search(again, NARROW).spins
        true = 1.0 / (3600.0 * PERIOD_H)
        near = [s for s in spins if abs(s.frequency - true) * again.span < sparse.SAME_PERIOD]
        came.append(sum(s.probability for s in near))
    apart = np.array(came) - np.array(predicted)
    assert abs(apart.mean()) < 3.3 * apart.std(ddof=1) / np.sqrt(len(apart)), (predicted, came)
