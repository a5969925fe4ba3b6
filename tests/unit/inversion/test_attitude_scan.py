"""Spins and smooth bodies of an attitude scan: derivatives, conventions, names, hypotheses."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.cluster import worker_pool
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inversion.attitude_scan import grid, search, solutions
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.smooth import (
    SmoothBody,
    Spin,
    brightness,
    fitted,
    normal_equations,
)
from lcbayes.inversion.attitude_scan.spin import Ends, in_convention, tilts
from lcbayes.physics import brightness as physics
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets
from lcbayes.tasks.scan.options import ScanOptions
from lcbayes.tasks.survey.options import SurveyOptions
from tests.helpers import spinning_bodies

POLE = np.array([0.48, -0.6, 0.64])
UNIT = 1e-7


def log_likelihood(residuals: np.ndarray, curve: np.ndarray) -> float:
    """Of normal errors with the most likely sd of each curve."""
    parts = (residuals[curve == k] for k in np.unique(curve))
    return sum(float(norm.logpdf(r, scale=np.sqrt(np.mean(r**2))).sum()) for r in parts)


def test_hypotheses_of_unknown_errors_are_compared_at_their_own_noise_levels(curve):
    """A quiet curve and a noisy one, each fitted better by another hypothesis."""
    rng = np.random.default_rng(0)
    number = np.repeat([0, 1], [800, 200])
    first = np.where(number == 0, 0.01, 0.2) * rng.standard_normal(1000)
    second = first * np.where(number == 0, 1.4, 0.8)
    group = np.stack([number == 0, number == 1], axis=1).astype(float)
    points = replace(Points.of(curve), noise=jnp.asarray(group), error_known=False)
    squares = np.stack([(r / 0.02) ** 2 @ group for r in (first, second)])
    one, other = search.misfit(points, squares, squares[0])
    assert one == pytest.approx(1000, rel=0.01)
    gain = log_likelihood(first, number) - log_likelihood(second, number)
    assert 1000 * np.log(other / one) == pytest.approx(2 * gain, rel=0.01)


def a_spin(degree: int = 3, frequency: float = 5e-5) -> Spin:
    return Spin(
        jnp.asarray(tilts(POLE[None])[0]),
        jnp.asarray(frequency),
        jnp.asarray(spinning_bodies.shape(degree)),
    )


@pytest.fixture(scope="module")
def curve():
    return spinning_bodies.geometry(4, 9)


def points_of(
    curve, *, known: bool = False, exposure_s: float = 0.0, phase_laws: bool = False
) -> Points:
    rng = np.random.default_rng(2)
    n = curve.n_obs
    full = replace(
        curve,
        brightness=rng.uniform(0.5, 1.5, n),
        exposure_s=np.full(n, exposure_s),
        error=rng.uniform(0.02, 0.05, n) if known else None,
        free_scale=np.array([True, False, False, True]),
    )
    if phase_laws:  # the first and the last curve cover a range of phase angles
        towards = full.obs + np.linspace(0.0, 1.5, n)[:, None] * np.array([0.0, 0.0, 1.0])
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        full = replace(full, obs=towards, curve=np.repeat(np.arange(4), [14, 4, 4, 14]))
    return Points.of(full, phase_laws=phase_laws)


@pytest.mark.parametrize(
    ("law", "exposure_s"),
    [("lambertian", 0.0), ("non-lambertian", 900.0), (spinning_bodies.LAW, 0.0)],
)
def test_jacobian_is_that_of_automatic_differentiation(curve, law, exposure_s):
    body, points = SmoothBody.of(80, 3, law), points_of(curve, exposure_s=exposure_s)
    spin = a_spin()

    def at(step):
        return brightness(body, points, spin.moved(step, jnp.asarray(UNIT))).flux

    expected = jax.jit(jax.jacfwd(at))(jnp.zeros(3 + len(spin.coefficients)))
    result = jax.jit(brightness)(body, points, spin).jacobian
    result = result * jnp.ones(result.shape[1]).at[2].set(UNIT)
    assert np.max(np.abs(result - expected)) < 1e-12 * np.max(np.abs(expected)) + 1e-14


def test_brightness_is_that_of_the_models(curve):
    """Against `brightness.flux` under the model's attitude, an independent path."""
    body, points, spin = SmoothBody.of(150, 3, spinning_bodies.LAW), points_of(curve), a_spin()
    turned = rotations.spinning(points.t[0], rotations.brought_to(jnp.asarray(POLE)), 1.0 / 5e-5)
    share = jax.nn.softmax(body.harmonics @ spin.coefficients)
    expected = physics.flux(
        rotations.to_body(turned, points.sun),
        rotations.to_body(turned, points.obs),
        body.normals,
        share,
        spinning_bodies.LAW,
    )
    np.testing.assert_allclose(brightness(body, points, spin).flux, expected, rtol=1e-11)


@pytest.mark.parametrize("phase_laws", [True, False])
@pytest.mark.parametrize("known", [True, False])
def test_gradient_is_that_of_automatic_differentiation(curve, known, phase_laws):
    body, points, spin = (
        SmoothBody.of(80, 3, spinning_bodies.LAW),
        points_of(curve, known=known, phase_laws=phase_laws),
        a_spin(),
    )
    unit = jnp.asarray(UNIT)

    def at(step):
        return normal_equations(body, points, spin.moved(step, unit), unit).value

    expected = jax.jit(jax.grad(at))(jnp.zeros(3 + len(spin.coefficients)))
    result = jax.jit(normal_equations)(body, points, spin, unit).gradient
    np.testing.assert_allclose(result, expected, rtol=1e-9, atol=1e-9 * float(np.abs(result).max()))


def test_factors_are_those_of_linear_least_squares(curve):
    """Against NumPy, with the functions written out; a dark curve has none."""
    body, points = SmoothBody.of(80, 3, spinning_bodies.LAW), points_of(curve, phase_laws=True)
    spin = a_spin()
    flux = np.asarray(brightness(body, points, spin).flux)
    angle = np.arccos(np.sum(np.asarray(points.sun) * np.asarray(points.obs), axis=1))
    found, error = np.asarray(fitted(body, points, spin)), np.asarray(points.error)
    for rows, phased in ((slice(0, 14), True), (slice(14, 22), False), (slice(22, 36), True)):
        functions = (
            [np.ones_like(angle), angle, np.exp(-angle / 0.09)] if phased else [1.0 + 0 * angle]
        )
        columns = np.stack(functions, axis=1)[rows] * flux[rows, None]
        factors = np.linalg.lstsq(
            columns / error[rows, None], np.asarray(points.flux)[rows] / error[rows], rcond=None
        )[0]
        np.testing.assert_allclose(found[rows], columns @ factors, rtol=1e-8)
    assert points.n_factors == 7
    unseen = replace(points, obs=points.obs.at[:14].set(-points.sun[:14]))
    assert np.all(np.isfinite(fitted(body, unseen, spin)))


@pytest.mark.parametrize("phase_laws", [True, False])
def test_curvature_is_exact_where_nothing_is_left(curve, phase_laws):
    """Where residuals vanish Gauss and Newton's matrix is the Hessian, scales solved for."""
    body = SmoothBody.of(80, 3, "lambertian", closed=False, roughness=1e6)
    points = points_of(curve, known=True, phase_laws=phase_laws)
    spin, unit = a_spin(), jnp.asarray(UNIT)
    points = points.with_flux(np.asarray(fitted(body, points, spin)))

    def at(step):  # another test holds the gradient itself
        return normal_equations(body, points, spin.moved(step, unit), unit).gradient

    zero = jnp.zeros(3 + len(spin.coefficients))
    expected = np.asarray(jax.jit(jax.jacfwd(at))(zero))
    result = np.asarray(jax.jit(normal_equations)(body, points, spin, unit).curvature)
    size = np.sqrt(np.diag(expected))
    # facets that turn away have no second derivative there, and none is counted: both sides agree
    assert np.max(np.abs(result - expected) / size / size[:, None]) < 1e-9


def test_single_precision_finds_the_same_minimum():
    curve = spinning_bodies.observed(spinning_bodies.geometry(), POLE, 5.0, 0.01)
    points = Points.of(curve, phase_law_known=False)
    starts = (POLE + np.array([0.1, 0.1, 0.0]))[None]
    ends = {}
    for kind in (np.float64, np.float32):
        body = SmoothBody.of(120, 3, spinning_bodies.LAW, dtype=kind)
        rows = [starts / np.linalg.norm(starts), np.array([1.0 / (5.0 * 3600)])]
        shared = body, points.host(), (1.0, 1.0, 1.0), search.Effort(60, 0.01)
        ends[kind] = search._from_spheres(shared, *rows)
    double, single = ends[np.float64], ends[np.float32]
    assert single.value[0] == pytest.approx(double.value[0], abs=0.05)
    assert np.degrees(np.arccos(min(1.0, double.pole[0] @ single.pole[0]))) < 0.05


def log_areas(coefficients, directions):
    degree = round(np.sqrt(len(coefficients) + 1)) - 1
    return facets.spherical_harmonics(directions, degree)[:, 1:] @ coefficients


def test_a_body_is_the_same_in_the_models_convention():
    """What faces an inertial direction at the middle of the data does not depend on the axes."""
    rng = np.random.default_rng(4)
    tilt = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    tilt[:, 0] *= np.sign(np.linalg.det(tilt))
    shape = rng.normal(size=15)
    lon, lat, turned = in_convention(tilt, shape)
    own = np.asarray(rotations.brought_to(jnp.asarray(tilt[:, 2])))
    axis = [np.cos(lon) * np.cos(lat), np.sin(lon) * np.cos(lat), np.sin(lat)]
    np.testing.assert_allclose(axis, tilt[:, 2], atol=1e-12)
    faced = spinning_bodies.directions(rng, 40)
    expected = log_areas(shape, faced @ tilt)
    np.testing.assert_allclose(log_areas(turned, faced @ own), expected, atol=1e-12)


def test_backward_spins_are_turned_over():
    rng = np.random.default_rng(5)
    shape, frequency = rng.normal(size=(2, 24)), np.array([-2e-3, 3e-3])
    ends = Ends(tilts(spinning_bodies.directions(rng, 2)), frequency, shape, *np.zeros((3, 2)))
    over = ends.forward()
    assert np.all(over.frequency == [2e-3, 3e-3])
    faced = spinning_bodies.directions(rng, 30)
    for i, f in enumerate(frequency):
        for t in (0.0, 123.0):
            before = rotations.principal_axis(jnp.array([t]), 0.0, np.pi / 2, 1.0 / f, 0.0)[0]
            after = rotations.principal_axis(jnp.array([t]), 0.0, np.pi / 2, 1.0 / abs(f), 0.0)[0]
            np.testing.assert_allclose(
                log_areas(shape[i], faced @ ends.tilt[i] @ np.asarray(before)),
                log_areas(over.coefficients[i], faced @ over.tilt[i] @ np.asarray(after)),
                atol=1e-12,
            )


def test_hypotheses_are_a_step_apart():
    """43 Ariadne's nine thousand days: as many periods as the usual program tries."""
    span = 9014.1 * 86400
    result = grid.grid(10, span, None, (5.75, 5.775))
    assert len(result.frequencies) == 408
    step = np.diff(result.frequencies) * span
    np.testing.assert_allclose(step, 0.4, rtol=1e-6)
    assert result.frequencies[0] == pytest.approx(1.0 / (5.775 * 3600))
    poles, frequencies = result.rows()
    assert poles.shape == (4080, 3)
    assert len(np.unique(frequencies[:10])) == 1


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((0, 1.0, 5.0), "--n-poles is 0"),
        ((4, 1.0), "give the sidereal period with --period HOURS"),
        ((4, 1.0, -2.0), "--period is -2; give hours"),
        ((4, 1.0, None, (5.0, 6.0), 0.0), "--period-step is 0"),
        ((4, 1e12, None, (5.0, 6.0)), "give a narrower range"),
    ],
)
def test_faults_of_hypotheses_are_said(given, message):
    with pytest.raises(InputError, match=message):
        grid.grid(*given)


@pytest.mark.parametrize("options", [ScanOptions, SurveyOptions])
@pytest.mark.parametrize("ends", [(6.0, 5.0), (0.0, 5.0)])
def test_a_range_of_periods_is_checked_before_anything_runs(options, ends):
    low, high = ends
    said = f"--period-range is {low:g},{high:g}; give the shortest and the longest period, hours"
    with pytest.raises(InputError, match=re.escape(said)):
        options(period_range=ends)


def test_spins_are_named_by_what_makes_them_look_alike():
    points = Points.of(
        spinning_bodies.geometry(6, 5, days=2000.0, flat=0.05), phase_law_known=False
    )
    geometry = solutions.Geometry.of(points)
    normal = geometry.normal
    assert normal is not None
    assert abs(normal[2]) > 0.99
    best, f, span = POLE, 5e-5, geometry.span
    half = next(x for x in geometry.separations if x < 0.9 * span)

    def name(pole, frequency):
        return geometry.relation(pole, frequency, best, f)[0]

    assert name(best, f) == solutions.SAME
    assert name(np.array([-0.48, 0.6, 0.64]), f + 0.1 / span) == solutions.MIRROR
    assert name(-best, f) == solutions.REVERSED
    assert name(np.array([0.0, 0.0, 1.0]), f) == solutions.POLE
    assert name(best, 2.0 * f) == solutions.HALF
    assert name(best, 0.5 * f) == solutions.TWICE
    assert name(best, f + 0.5 / half) == solutions.ALIAS
    assert geometry.relation(best, f + 0.5 / half, best, f)[1].startswith(
        "period alias: half a turn"
    )
    assert name(best, 1.37 * f) == solutions.PERIOD
    open_sky = solutions.Geometry.of(
        Points.of(spinning_bodies.geometry(6, 5, flat=1.5), phase_law_known=False)
    )
    assert open_sky.normal is None


def test_ends_that_are_one_solution_are_counted_once():
    poles = np.array([[0.0, 0, 1], [0.05, 0, 1], [0, 1, 0], [0, 0, 1]])
    poles /= np.linalg.norm(poles, axis=1, keepdims=True)
    frequency = np.array([1.0, 1.0 + 1e-4, 1.0, 1.1])
    ends = Ends(
        tilts(poles),
        frequency,
        np.zeros((4, 3)),
        np.array([5.0, 4.0, 6.0, np.nan]),
        np.zeros((4, 1)),
        np.zeros(4),
    )
    kept, hits = solutions.distinct(ends, 100.0, 9)
    assert kept.value.tolist() == [4.0, 6.0]
    assert hits.tolist() == [2, 1]
    assert len(solutions.distinct(ends, 100.0, 1)[1]) == 1


def test_what_was_done_is_not_done_again(curve, tmp_path):
    points = Points.of(spinning_bodies.observed(curve, POLE, 5.0, 0.02), phase_law_known=False)
    body = SmoothBody.of(60, 2, spinning_bodies.LAW)
    tried = grid.Grid(facets.grid(3), np.array([1.0, 1.01]) / (5.0 * 3600))
    with worker_pool() as run, Silent().stage("", 1, "") as track:
        whole = search.screen(points, body, tried, run, Checkpoint(None, {}), "screen", track)
        first = Checkpoint(tmp_path / "checkpoint", {"run": 1})

        def dying(function, shared, tasks):
            done = run(function, shared, tasks)
            for _ in range(4):
                yield next(done)
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            search.screen(points, body, tried, dying, first, "screen", track)
        left = []

        def counting(function, shared, tasks):
            left.append(len(tasks))
            return run(function, shared, tasks)

        again = Checkpoint(tmp_path / "checkpoint", {"run": 1})
        resumed = search.screen(points, body, tried, counting, again, "screen", track)
    assert left == [2]
    for a, b in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(a, b)
