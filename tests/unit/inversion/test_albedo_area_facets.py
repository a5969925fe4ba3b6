"""From the grid to few facets, and how well they are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.data.earth_shadow import fully_lit
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area import bootstrap
from lcbayes.inversion.albedo_area.distribution import Distribution, grid, smooth, solve, typical
from lcbayes.inversion.albedo_area.facets import Facets, explain, linear, refine, select_facets
from lcbayes.inversion.albedo_area.inversion import InversionSettings, invert
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, Material, columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import ConstantRate, Fixed
from lcbayes.physics.bodies import shapes
from lcbayes.results.reasons import reason as sentence
from lcbayes.simulation.scenarios.scenario import load
from lcbayes.simulation.simulate import simulate
from tests.helpers.false_alarms import EACH, limit, squares
from tests.helpers.known_bodies import curve_of, directions, lambertian

pytestmark = pytest.mark.usefixtures("full_optimisation")

BRICK = shapes.box(2.0, 1.4, 0.8)
ONE = (LAMBERTIAN,)


def facets_in(seen: Observed, materials=ONE, n: int = 200) -> tuple[Distribution, Facets]:
    normals, which = grid(n, materials)
    matrix = columns(seen, normals, which, materials)
    coarse = solve(seen, normals, which, matrix)
    fine = refine(seen, coarse, matrix, materials)
    assert fine.chi2 < coarse.chi2
    return fine, select_facets(seen, fine, materials)


def matched(estimate: Distribution, normals: np.ndarray) -> np.ndarray:
    """Index of the facet nearest to each of these normals; all different and within 3 degrees."""
    cosine = normals @ estimate.normals.T
    index = cosine.argmax(axis=1)
    assert len(set(index)) == len(normals)
    assert np.degrees(np.arccos(np.minimum(cosine.max(axis=1), 1.0))).max() < 3.0
    return index


@pytest.fixture(scope="module")
def brick() -> tuple[Observed, Distribution, Facets]:
    seen = Observed.of(curve_of(BRICK), Fixed())
    return seen, *facets_in(seen)


@pytest.mark.statistical(false_alarm=EACH)
def test_a_brick_has_six_facets(brick):
    seen, fine, estimate = brick
    assert len(estimate.areas) == 6 < len(fine.areas)
    index = matched(estimate, BRICK.normals)
    assert estimate.areas[index] == pytest.approx(BRICK.areas, rel=0.02)
    off = (estimate.areas[index] - BRICK.areas) / estimate.area_sd[index]
    assert np.abs(off).max() < limit(7)
    low, high = squares(300 - 18, 7)
    assert low < estimate.chi2 < high
    assert np.sum(((seen.flux - estimate.flux) / seen.error) ** 2) == pytest.approx(estimate.chi2)


def test_facets_are_at_a_minimum(brick):
    seen, _, estimate = brick
    vectors = estimate.areas[:, None] * estimate.normals
    _, jacobian, residual = linear(seen, vectors, estimate.which, estimate.scale, ONE)
    step = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ residual)
    assert np.abs(step).max() < 1e-4


@pytest.mark.parametrize("free", [False, True])
def test_jacobian_of_facets_is_that_of_differences(brick, free):
    seen = brick[0]
    seen = Observed(
        seen.flux,
        seen.error,
        np.arange(300) // 100,
        np.array([free, False, free]),
        seen.sun,
        seen.obs,
        seen.weight,
        True,
    )
    vectors = directions(np.random.default_rng(0), 4) * [[0.5], [1.0], [2.0], [3.0]]
    which, scale = np.zeros(4, int), np.array([1.3, 1.0, 0.7]) if free else np.ones(3)
    _, jacobian, _ = linear(seen, vectors, which, scale, ONE)
    assert jacobian.shape == (300, 12 + 2 * free)
    change = 1e-6 * np.random.default_rng(1).normal(size=jacobian.shape[1])
    moved = scale.copy()
    moved[seen.free] += change[12:]
    either = [
        linear(
            seen, vectors + s * change[:12].reshape(4, 3), which, scale + s * (moved - scale), ONE
        )[0].flux
        for s in (1.0, -1.0)
    ]
    difference = (either[0] - either[1]) / 2 / seen.error
    assert jacobian @ change == pytest.approx(difference, abs=1e-7 * np.abs(jacobian).max())


def test_a_facet_costs_what_it_is_reported(brick):
    seen, fine, estimate = brick
    assert len(select_facets(seen, fine, ONE, cost=0.0).areas) > 6
    assert len(select_facets(seen, fine, ONE, cost=1e7).areas) < 6
    assert len(select_facets(seen, fine, ONE, cost=3 * np.log(300)).areas) == len(estimate.areas)


@pytest.mark.parametrize("seed", [1, 2])  # a phantom of 38,000 m²; a singular matrix
def test_no_facet_is_found_that_no_epoch_shows(seed):
    curve = fully_lit(simulate(load("box-wing"), seed)[0])
    material = Material.parse("non-lambertian")
    attitude = ConstantRate((0.012, -0.020, 0.018))
    result = invert(
        curve, attitude, [material], settings=InversionSettings(n_bootstrap=0, n_null=0)
    )
    assert result.reasons == []
    assert result.facets is not None
    assert len(result.facets.areas) == 6
    assert result.facets.areas.max() == pytest.approx(3.24, rel=0.02)
    matrix = columns(result.seen, result.facets.normals, result.facets.which, [material])
    assert matrix.max(axis=0).min() > 0.01


def from_above(n_below: int = 0) -> LightCurve:
    """A brick that few epochs show from below."""
    rng = np.random.default_rng(0)
    sun, obs = directions(rng, 300), directions(rng, 300)
    for v in (sun, obs):
        v[:, 2] = np.where(np.arange(300) < n_below, -1.0, 1.0) * np.abs(v[:, 2])
    flux = lambertian(sun, obs, BRICK)
    error = np.full(300, 0.003 * flux.mean())
    return replace(
        curve_of(BRICK),
        sun=sun,
        obs=obs,
        error=error,
        brightness=flux + error * rng.normal(size=300),
    )


def test_a_dark_facet_takes_no_other_with_it():
    """Were facets weighed by their areas, those in the light would be negligible beside it."""
    seen = Observed.of(from_above(), Fixed())
    below = BRICK.normals[:, 2] < -0.9
    areas, which = np.where(below, 1e8, BRICK.areas), np.zeros(6, int)
    flux = columns(seen, BRICK.normals, which) @ areas
    estimate = select_facets(seen, Distribution(BRICK.normals, which, areas, np.ones(1), flux, 0.0))
    assert len(estimate.areas) == 5
    index = matched(estimate, BRICK.normals[~below])
    assert estimate.areas[index] == pytest.approx(BRICK.areas[~below], rel=0.02)


def test_an_area_that_one_point_tells_is_in_doubt():
    """One number has no say in two of the three of an area vector: large variances, not none."""
    result = invert(from_above(1), Fixed(), settings=InversionSettings(n_bootstrap=0, n_null=0))
    assert result.facets is not None
    below = result.facets.normals[:, 2] < -0.3
    assert below.any()
    assert (result.facets.area_sd[below] > result.facets.areas[below]).all()
    assert (result.facets.area_sd[~below] < 0.1 * result.facets.areas[~below]).all()
    assert any(
        "the flux does not constrain the areas of" in sentence(why).text for why in result.reasons
    )


def test_a_shiny_panel_on_a_dull_brick():
    materials = (LAMBERTIAN, Material.parse("blinn-phong:n=20"))
    seen = Observed.of(curve_of(BRICK, 500), Fixed())
    normals = np.vstack([BRICK.normals, [[0.6, 0.0, 0.8]]])
    areas, which = np.append(BRICK.areas, 1.0), np.array([0] * 6 + [1])
    flux = columns(seen, normals, which, materials) @ areas
    error = np.full(500, 0.01 * flux.mean())
    noise = np.random.default_rng(0).normal(size=500)
    seen = seen.with_error(error).with_flux(flux + error * noise)
    _, estimate = facets_in(seen, materials)
    assert list(np.bincount(estimate.which)) == [6, 1]
    for m in (0, 1):
        here = estimate.which == m
        part = Distribution(
            estimate.normals[here],
            estimate.which[here],
            estimate.areas[here],
            estimate.scale,
            estimate.flux,
            0.0,
        )
        index = matched(part, normals[which == m])
        assert part.areas[index] == pytest.approx(areas[which == m], rel=0.05)


@pytest.mark.parametrize(
    ("n_curves", "least"), [(2, 1), pytest.param(6, 4, marks=pytest.mark.slow)]
)
def test_a_material_that_is_not_there_is_left_out(n_curves, least):
    """A facet of it may still lower chi2 by more than its cost: by chance, in few curves."""
    materials = (LAMBERTIAN, Material.parse("blinn-phong:n=50"))
    normals, which = grid(60, materials)
    exact = 0
    for seed in range(n_curves):
        seen = Observed.of(curve_of(BRICK, 70, seed=seed), Fixed())
        matrix = columns(seen, normals, which, materials)
        coarse = solve(seen, normals, which, matrix)
        _, estimate = explain(seen, coarse, matrix, materials)
        diffuse = estimate.which == 0
        assert estimate.areas[~diffuse].sum() < 0.01 * estimate.areas.sum()
        exact += len(estimate.areas) == 6
    assert exact >= least


def test_curves_of_unknown_scale_give_the_proportions():
    group = np.arange(400) // 40
    curve = curve_of(BRICK, 400, curve=group, free_scale=np.ones(10, bool))
    scale = np.linspace(0.5, 2.0, 10)
    seen = Observed.of(curve, Fixed())
    seen = seen.with_flux(scale[group] * seen.flux).with_error(scale[group] * seen.error)
    _, estimate = facets_in(seen)
    assert estimate.scale.mean() == pytest.approx(1.0)
    assert estimate.scale == pytest.approx(scale / scale.mean(), rel=0.01)
    index = matched(estimate, BRICK.normals)
    share = estimate.areas[index] / estimate.areas[index].sum()
    assert share == pytest.approx(BRICK.areas / BRICK.areas.sum(), rel=0.03)


def test_curves_are_drawn_whole_where_there_are_many():
    seen = Observed.of(curve_of(BRICK, 120, curve=np.arange(120) // 10), Fixed())
    weight = bootstrap.weights(seen, 30, 0)
    assert weight.shape == (30, 120)
    assert (weight.reshape(30, 12, 10).std(axis=2) == 0).all()
    assert weight.sum(axis=1) == pytest.approx(120)


def test_blocks_are_drawn_where_there_are_few_curves():
    seen = Observed.of(curve_of(BRICK, 125), Fixed())
    weight = bootstrap.weights(seen, 30, 0)
    changes = np.sum(np.diff(weight, axis=1) != 0, axis=1)
    assert changes.max() <= 24  # 25 blocks of five
    assert changes.mean() > 10
    assert weight.sum(axis=1) == pytest.approx(125, rel=0.4)


def test_spread_of_facets_agrees_with_the_curvature(brick):
    seen, _, estimate = brick
    weight = bootstrap.weights(seen, 200, 0)
    draws = bootstrap.facets(seen, estimate, ONE, weight)
    spread = np.linalg.norm(draws.vectors, axis=2).std(axis=0)
    assert np.mean(spread / estimate.area_sd) == pytest.approx(1.0, abs=0.2)
    assert len(draws.volumes) == 200
    assert abs(draws.volumes.mean() - 2.24) < 5 * draws.volumes.std()
    assert draws.dimensions.mean(axis=0) == pytest.approx([2.0, 1.4, 0.8], rel=0.02)


def test_resampled_distributions_are_those_of_the_resampled_data(brick):
    seen = brick[0]
    normals, which = grid(60)
    matrix = columns(seen, normals, which)
    estimate = solve(seen, normals, which, matrix)
    weight = bootstrap.weights(seen, 3, 0)
    draws = bootstrap.distributions(seen, estimate, matrix, weight)
    for w, areas in zip(weight, draws, strict=True):
        here = w > 0
        part = Observed(
            seen.flux[here],
            seen.error[here] / np.sqrt(w[here]),
            seen.curve[here],
            seen.free,
            seen.sun[:, here],
            seen.obs[:, here],
            seen.weight,
            True,
        )
        again = solve(part, normals, which, matrix[here])
        model = matrix[here] @ areas
        chi2 = np.sum(((part.flux - model) / part.error) ** 2)
        assert chi2 == pytest.approx(again.chi2, rel=1e-8)
    # a penalty counts once, whatever is drawn
    rows = [smooth(normals, which, 1e9, typical(seen, matrix))]
    flat = bootstrap.distributions(seen, estimate, matrix, weight, rows)
    assert np.ptp(flat, axis=1).max() < 0.1 * flat.mean()


def test_the_whole_way_from_a_curve_to_a_brick():
    result = invert(
        curve_of(BRICK, seed=3),
        Fixed(),
        settings=InversionSettings(n_normals=200, n_bootstrap=20, n_null=0),
    )
    assert result.reasons == []
    assert result.cues == []
    assert result.shape is not None
    assert result.draws is not None
    assert result.shape.volume == pytest.approx(2.24, rel=0.02)
    assert result.shape.dimensions == pytest.approx([2.0, 1.4, 0.8], rel=0.02)
    assert result.changed < 0.01
    assert result.unseen == 0.0
    assert result.grid_sd is not None
    assert result.grid_sd.shape == (200,)


def test_a_common_albedo_sets_the_size():
    curve = curve_of(BRICK, seed=3)
    bright, dark = (
        invert(
            curve,
            Fixed(),
            settings=InversionSettings(n_normals=150, n_bootstrap=0, n_null=0, albedo=a),
        ).shape
        for a in (1.0, 0.25)
    )
    assert bright is not None
    assert dark is not None
    assert dark.dimensions == pytest.approx(2.0 * bright.dimensions, rel=1e-9)


def test_errors_that_are_not_given_are_estimated():
    result = invert(
        curve_of(BRICK, error=None), Fixed(), settings=InversionSettings(n_bootstrap=0, n_null=0)
    )
    assert not result.seen.error_known
    truth = 0.01 * result.seen.flux.mean()
    assert result.rms == pytest.approx(0.01, rel=0.2)
    assert 0.5 * truth < result.seen.error.mean() < 3.0 * truth
    assert result.shape is not None
    assert result.shape.volume == pytest.approx(2.24, rel=0.05)


def test_a_wrong_attitude_is_not_trusted():
    result = invert(
        curve_of(BRICK),
        ConstantRate((0.1, 0.2, 0.3)),
        settings=InversionSettings(n_bootstrap=0, n_null=0),
    )
    assert (
        "no convex body of material lambertian with this attitude"
        in sentence(result.reasons[0]).text
    )
    assert "--material non-lambertian" in sentence(result.reasons[0]).text


def test_an_open_surface_has_no_shape():
    plate = shapes.body([[0, 0, 1.0], [0.6, 0, 0.8]], [2.0, 1.0])
    result = invert(
        curve_of(plate, 400), Fixed(), settings=InversionSettings(n_bootstrap=0, n_null=0)
    )
    assert result.shape is None
    assert "facets do not close: |sum(A n)| / sum(A) = 0.9" in result.no_shape
    assert "so no convex body of one albedo has them" in result.no_shape


def test_directions_never_lit_are_reported():
    curve = curve_of(BRICK, 300)
    up = np.array([0.0, 0.0, 1.0])
    near = curve.obs + 3.0 * up
    near /= np.linalg.norm(near, axis=1, keepdims=True)
    lit = curve_of(BRICK, 300)
    object.__setattr__(lit, "obs", near)
    object.__setattr__(lit, "sun", near)
    result = invert(lit, Fixed(), settings=InversionSettings(n_bootstrap=0, n_null=0))
    assert any("never lit and seen at once" in sentence(reason).text for reason in result.reasons)
    assert "or facets are missing" in result.no_shape


def test_options_that_make_no_sense():
    with pytest.raises(InputError, match="at least 50 normals"):
        invert(curve_of(BRICK), Fixed(), settings=InversionSettings(n_normals=10))
