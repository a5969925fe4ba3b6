"""Shapes by phase angle and brightness: distances by definition, matches on simulated truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated import ensemble
from lcbayes.inversion.separated.reduced import reduce
from lcbayes.inversion.separated.shape_match import (
    PhaseSample,
    Surface,
    candidates,
    correlated,
    reflected_flux,
    shape_match,
    turned,
)
from lcbayes.inversion.separated.two_samples import Reference
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.bodies import shapes
from lcbayes.results.reasons import reason as sentence
from tests.helpers.false_alarms import EACH, counts, limit
from tests.helpers.simulated_passes import measured, passes

FEW_SHAPES = ("cube", "plate", "tetrahedron")


def seen(name: str, n: int = 200, noise: float = 0.02, seed: int = 0) -> LightCurve:
    """A candidate in random orientations, each point for itself."""
    rng = np.random.default_rng(seed)
    sun, obs = turned(np.radians(rng.uniform(20.0, 140.0, n)), rng)
    flux = reflected_flux(candidates()[name], Surface(), sun, obs)
    error = np.full(n, noise * np.median(flux[flux > 0]))
    return LightCurve(
        t=1000.0 * np.arange(float(n)),
        brightness=flux + error * rng.normal(size=n),
        error=error,
        sun=sun,
        obs=obs,
    )


def some(*names: str) -> dict[str, shapes.Body]:
    return {name: candidates()[name] for name in names}


def test_distances_are_those_of_their_definitions():
    """Against sums over all pairs and quadrants; the tables cost less than the samples' noise."""
    rng = np.random.default_rng(1)
    draws, sample = rng.normal(size=(2000, 2)), rng.normal([0.3, -0.2], size=(90, 2))
    low, high = np.full(2, -5.0), np.full(2, 5.0)
    reference = Reference(draws, low, high)
    (kolmogorov,), (energy,) = reference.distances([sample])

    def mean(a, b):
        return np.mean(np.linalg.norm(a[:, None] - b[None], axis=2))

    n = len(sample)
    expected = 2 * mean(sample, draws) - mean(sample, sample) * n / (n - 1) - mean(draws, draws)
    assert energy == pytest.approx(expected, abs=0.01)

    def largest(about):
        out = 0.0
        for x, y in about:
            for sx in (1, -1):
                for sy in (1, -1):
                    share = [
                        np.mean(
                            np.where(v[:, 0] == x, 0.5, sx * v[:, 0] < sx * x)
                            * np.where(v[:, 1] == y, 0.5, sy * v[:, 1] < sy * y)
                        )
                        for v in (sample, draws)
                    ]
                    out = max(out, abs(share[0] - share[1]))
        return out

    origins = draws[::10]
    assert kolmogorov == pytest.approx(0.5 * (largest(sample) + largest(origins)), abs=0.01)
    padded = reference.distances([sample, rng.normal(size=(150, 2))])
    assert padded[0][0] == pytest.approx(kolmogorov, abs=1e-12)
    assert padded[1][0] == pytest.approx(energy, abs=1e-12)


@pytest.mark.statistical(false_alarm=EACH)
def test_orientations_are_uniform_and_of_that_phase():
    rng = np.random.default_rng(2)
    phase = np.full(20_000, 1.1)
    sun, obs = turned(phase, rng)
    np.testing.assert_allclose(np.arccos(np.sum(sun * obs, axis=1)), 1.1, atol=1e-9)
    for v in (sun, obs, np.cross(sun, obs) / np.sin(1.1)):
        assert stats.kstest(v[:, 2], "uniform", args=(-1, 2)).pvalue > EACH / 3


@pytest.mark.statistical(false_alarm=EACH)
def test_the_mean_over_orientations_is_that_of_a_sphere():
    """Cauchy: a convex Lambertian body sends on average what a sphere of its surface sends."""
    surface = Surface(r_diff=0.3, r_spec=0.0)
    made = PhaseSample(shapes.cube(), surface)
    for degrees in (30, 90, 120):
        phase = np.radians(degrees)
        near = made.flux[degrees]
        sphere = 0.3 * 6.0 / 4 * 2 / (3 * np.pi) * (np.sin(phase) + (np.pi - phase) * np.cos(phase))
        sphere /= np.pi
        error = near.std() / np.sqrt(near.size)
        assert abs(near.mean() - sphere) < limit(3) * error
    assert quad(lambda a: np.sin(a) + (np.pi - a) * np.cos(a), 0, np.pi)[0] == pytest.approx(4.0)


def test_the_true_shape_is_kept_and_others_rejected():
    result = shape_match(seen("cube"), some(*FEW_SHAPES), n_nulls=99, n_draws=4000)
    by_name = {m.name: m for m in result.matches}
    assert by_name["cube"].p_value > by_name["plate"].p_value
    assert by_name["plate"].p_value < 0.05
    assert result.matches[0].name == "cube"
    assert not result.reasons
    curve = seen("cube")
    assert curve.error is not None
    large = replace(curve, brightness=40.0 * curve.brightness, error=40.0 * curve.error)
    again = shape_match(large, some("cube"), n_nulls=99, n_draws=4000)
    assert again.matches[0].energy == pytest.approx(by_name["cube"].energy, abs=1e-9)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_p_values_of_the_true_shape_are_uniform():
    """60 objects of three shapes; Kolmogorov-Smirnov on each of two p-values."""
    p = []
    for seed in range(60):
        name = FEW_SHAPES[seed % 3]
        result = shape_match(
            seen(name, 150, seed=seed), some(name), n_nulls=79, n_draws=4000, seed=seed
        )
        p.append((result.matches[0].p_kolmogorov, result.matches[0].p_energy))
    for column in np.array(p).T:
        assert stats.kstest(column, "uniform").pvalue > EACH / 2


def test_points_that_follow_each_other_are_thinned():
    curve = seen("cube", 200)
    assert correlated(reduce(curve)) < 1.5
    assert curve.error is not None
    held = curve.select(np.repeat(np.arange(200), 5))
    held = replace(
        held,
        t=np.arange(1000.0),
        brightness=held.brightness
        + np.repeat(curve.error, 5) * np.random.default_rng(0).normal(size=1000),
    )
    result = shape_match(held, some("plate"), n_nulls=40, n_draws=2000)
    assert 3.0 < result.correlation < 8.0
    assert len(result.phase) <= 1000 / 3.0


def spinning_box(geometry: LightCurve, seed: int, noise: float = 0.05) -> LightCurve:
    """A Lambertian box of 1 × 1 × 3 m about a fixed axis, written down once more."""
    rng = np.random.default_rng(seed)
    to_body, axis = (np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(2))
    turn = 2 * np.pi * geometry.t / rng.uniform(5.0, 60.0)
    c, s = np.cos(turn), np.sin(turn)

    def body(v):
        x, y, z = axis @ v.T
        return np.stack([c * x + s * y, c * y - s * x, z], axis=1) @ to_body

    normals = np.concatenate([np.eye(3), -np.eye(3)])
    areas = np.tile([3.0, 3.0, 1.0], 2)
    light = np.maximum(body(geometry.sun) @ normals.T, 0) * np.maximum(
        body(geometry.obs) @ normals.T, 0
    )
    flux = 0.3 / np.pi * light @ areas
    error = np.full(len(flux), noise * np.median(flux[flux > 0]))
    return replace(geometry, brightness=flux + error * rng.normal(size=len(flux)), error=error)


@pytest.mark.statistical(false_alarm=EACH)
def test_a_body_that_spins_about_a_fixed_axis_is_kept_and_not_called_stabilised():
    """Its orientations are not random: the pole decides how bright it gets."""
    whole = passes(550.0, 53.0, days=28, step=30.0)
    geometry = whole.select(np.linspace(0, whole.n_obs - 1, 250).astype(int))
    box = {"box": shapes.box(1.0, 1.0, 3.0)}
    kept, stable = 0, 0
    for seed in range(12):
        result = shape_match(
            spinning_box(geometry, seed),
            box,
            surface=Surface(0.3, 0.0),
            n_nulls=79,
            n_draws=2000,
            seed=seed,
        )
        kept += bool(result.consistent)
        stable += any(r.code == "stabilised" for r in result.reasons)
    assert kept >= 12 - counts(12, 0.05)[1]  # the level
    assert stable == 0


def test_a_stabilised_object_is_said_to_be_one():
    geometry = passes(550.0, 53.0, days=28, step=120.0)
    law = catalogue.find("lvlh")
    bodies = ensemble.draw(8, np.random.default_rng(0))
    result = shape_match(
        measured(geometry, law, bodies, 0.05, 0), some("cube"), n_nulls=40, n_draws=2000
    )
    assert any("looks stabilised" in sentence(reason).text for reason in result.reasons)


def test_conditions_that_are_not_met_are_said():
    few = shape_match(seen("cube", 60), some("cube"), n_nulls=40, n_draws=2000)
    assert [r.code for r in few.reasons] == ["too-few-independent-points"]
    narrow = seen("sphere", 150)
    keep = np.abs(narrow.phase_angle - 1.2) < 0.2
    reasons = shape_match(narrow.select(keep), some("sphere"), n_nulls=40, n_draws=2000).reasons
    assert any("phase angles span" in sentence(r).text for r in reasons)
    curve = seen("cube", 60)
    mixed = replace(curve, band=np.where(np.arange(60) % 2, "V", "R"))
    with pytest.raises(InputError, match=r"has 2 scales .* needs one; give one of them"):
        shape_match(mixed)
    with pytest.raises(InputError, match=r"sum is at most 1"):
        Surface(0.7, 0.7)
    with pytest.raises(InputError, match=r"n_nulls >= 40 to reject at the level 0.05"):
        shape_match(curve, n_nulls=39)
    with pytest.raises(InputError, match=r"the level is 0.0001; expected 0.001 <= level"):
        shape_match(curve, level=0.0001)


def test_a_shape_can_be_rejected_at_any_level():
    """p = 2/(1 + n) at the least, and a shape is rejected below the level."""
    result = shape_match(seen("cube"), some("plate"), level=0.005, n_draws=4000)
    assert result.matches[0].p_value < 0.005
    assert not result.consistent


def test_a_last_point_that_no_draw_would_show():
    """Its error is so large that no orientation of a candidate is bright enough there."""
    curve = seen("cube")
    typical = float(np.median(curve.brightness))
    assert curve.error is not None
    flux, error = curve.brightness.copy(), curve.error.copy()
    flux[-1], error[-1] = 60.0 * typical, 15.0 * typical
    result = shape_match(
        replace(curve, brightness=flux, error=error), some("cube"), n_nulls=40, n_draws=2000
    )
    assert result.n_obs == 200
    assert 0.0 < result.matches[0].p_value <= 1.0
