"""Kernel, non-negative least squares, and the distribution on a grid."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area import nnls
from lcbayes.inversion.albedo_area.distribution import grid, smooth, solve, typical
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, Material, columns, slopes
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics import brightness, photometry
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.laws import ConstantRate, Fixed, PrincipalAxis
from lcbayes.physics.bodies import facets, shapes
from tests.helpers.known_bodies import curve_of, directions, lambertian

BRICK = shapes.box(2.0, 1.4, 0.8)
LAWS = (
    "lambertian",
    "non-lambertian",
    "lommel-seeliger-lambert:c=0.2",
    "blinn-phong:n=30",
    "ashikhmin-shirley:nu=20",
    "ashikhmin-shirley-distribution:nu=20",
    "cook-torrance:m=0.3",
)


def seen_of(n: int = 40, seed: int = 0, **fields) -> Observed:
    return Observed.of(curve_of(BRICK, n, seed=seed, **fields), Fixed())


@pytest.mark.parametrize("text", LAWS)
def test_columns_are_the_flux_of_unit_facets(text):
    material, seen = Material.parse(text), seen_of()
    normals = facets.grid(130)  # more than one padded block
    areas = np.linspace(0.1, 1.0, 130)
    result = columns(seen, normals, np.zeros(130, int), (material,)) @ areas
    expected = brightness.flux_brdf(
        jnp.asarray(seen.sun[0]),
        jnp.asarray(seen.obs[0]),
        jnp.asarray(normals),
        jnp.asarray(areas),
        material.law,
        material.unit,
    )
    assert result == pytest.approx(np.asarray(expected), rel=1e-12)


def test_a_lambertian_column_by_hand():
    seen = seen_of()
    result = columns(seen, BRICK.normals, np.zeros(6, int)) @ BRICK.areas
    assert result == pytest.approx(lambertian(seen.sun[0], seen.obs[0], BRICK), rel=1e-13)


@pytest.mark.parametrize("text", LAWS)
def test_slopes_are_differences_of_columns(text):
    material, seen = Material.parse(text), seen_of()
    normals, which = facets.grid(12), np.zeros(12, int)
    value, slope = slopes(seen, normals, which, (material,))
    assert value == pytest.approx(columns(seen, normals, which, (material,)), rel=1e-13)
    step = 1e-6
    for axis in range(3):
        either = [
            columns(seen, normals + sign * step * np.eye(3)[axis], which, (material,))
            for sign in (1.0, -1.0)
        ]
        difference = (either[0] - either[1]) / (2 * step)
        away = np.min(np.abs([seen.sun[0] @ normals.T, seen.obs[0] @ normals.T]), axis=0) > 0.01
        scale = np.abs(slope).max()
        assert slope[..., axis][away] == pytest.approx(difference[away], abs=1e-6 * scale)


def test_specular_and_diffuse_columns_stand_side_by_side():
    seen, normals = seen_of(), facets.grid(60)
    materials = (LAMBERTIAN, Material.parse("blinn-phong:n=50"))
    both, which = grid(60, materials)
    matrix = columns(seen, both, which, materials)
    for m, material in enumerate(materials):
        own = columns(seen, normals, np.zeros(60, int), (material,))
        assert np.array_equal(matrix[:, which == m], own)
    assert materials[1].unit == {"r_diff": 0.0, "r_spec": 1.0, "n": 50.0}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("chalk", "unknown law 'chalk'; available: lambertian"),
        ("blinn-phong", r"give n \(exponent of the lobe\)"),
        ("blinn-phong:n", "'n' is not NAME=NUMBER"),
        ("blinn-phong:n=many", "'n=many' is not NAME=NUMBER"),
        ("blinn-phong:n=5,r_spec=0.4", "r_spec is what is solved for"),
        ("blinn-phong:m=5", "unknown parameter 'm'; blinn-phong has n"),
        ("ashikhmin-shirley:nu=5,nv=9", "unknown parameter 'nv'"),
        ("cook-torrance:m=7", r"m \(rms slope\) lies in 0.001..1"),
    ],
)
def test_materials_that_make_no_sense(text, message):
    with pytest.raises(InputError, match=message):
        Material.parse(text)


def test_magnitudes_become_flux():
    flux = np.array([3.0, 0.2])
    mag = photometry.magnitude(jnp.asarray(flux), 7e5, photometry.sun_magnitude("V"))
    x = np.array([[1.0, 0, 0]] * 2)
    curve = LightCurve(
        t=np.arange(2.0),
        brightness=np.asarray(mag),
        error=np.full(2, 0.01),
        sun=x,
        obs=x,
        kind="mag",
        range_km=np.full(2, 700.0),
        band=np.array(["V", "V"]),
    )
    seen = Observed.of(curve, Fixed())
    assert seen.flux == pytest.approx(flux, rel=1e-12)
    assert seen.error == pytest.approx(flux * 0.01 * np.log(10) * 0.4, rel=1e-12)


def test_attitudes_turn_directions_as_the_models_do():
    curve = curve_of(BRICK, 50)
    middle = 0.5 * np.ptp(curve.t)
    spin = PrincipalAxis(40.0, -30.0, 36.0, t0_s=middle)
    turn = rotations.principal_axis(
        jnp.asarray(curve.t - middle), np.radians(40.0), np.radians(-30.0), 36.0, 0.0
    )
    expected = np.asarray(rotations.to_body(turn, jnp.asarray(curve.sun)))
    assert Observed.of(curve, spin).sun[0] == pytest.approx(expected, abs=1e-12)
    omega = ConstantRate((0.0, 0.0, 0.01))
    result = Observed.of(curve, omega).obs[0][30]
    c, s = np.cos(0.3), np.sin(0.3)
    assert result == pytest.approx(np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ curve.obs[30])
    assert np.array_equal(Observed.of(curve, Fixed()).sun[0], curve.sun)


def test_exposures_are_averaged():
    curve = curve_of(BRICK, 20, exposure_s=np.full(20, 30.0))
    spin = ConstantRate((0.01, 0.0, 0.02))
    result = columns(Observed.of(curve, spin), BRICK.normals, np.zeros(6, int))
    many = []
    for shift in (np.arange(200) + 0.5) / 200 - 0.5:
        turn = rotations.constant_rate(
            jnp.asarray(curve.t + 30.0 * shift), jnp.asarray(spin.omega_rad_s)
        )
        sun, obs = (
            np.asarray(rotations.to_body(turn, jnp.asarray(v))) for v in (curve.sun, curve.obs)
        )
        many.append(np.maximum(sun @ BRICK.normals.T, 0) * np.maximum(obs @ BRICK.normals.T, 0))
    # facets that turn on or off within an exposure are not smooth, hence the tolerance
    assert result == pytest.approx(np.mean(many, axis=0) / np.pi, abs=0.004)


def problems():
    """Systems that are over- and underdetermined, dense, sparse, with a column of zeros."""
    rng = np.random.default_rng(0)
    for t, n in ((80, 30), (40, 90)):
        seen = seen_of(t)
        matrix = columns(seen, facets.grid(n), np.zeros(n, int)) / seen.error[:, None]
        yield matrix, seen.flux / seen.error
        yield np.abs(rng.normal(size=(t, n))), rng.normal(size=t)
    matrix = rng.normal(size=(50, 20))
    matrix[:, 4] = 0.0
    yield matrix, rng.normal(size=50)
    matrix[:, 7] = matrix[:, 6]
    yield matrix, np.ones(50)
    yield np.eye(3), -np.ones(3)


@pytest.mark.parametrize("index", range(7))
def test_least_squares_agree_and_are_optimal(index):
    matrix, target = list(problems())[index]
    x = nnls.exact(matrix, target)
    gradient = matrix.T @ (matrix @ x - target)
    size = np.linalg.norm(target) * np.linalg.norm(matrix, axis=0).max()
    assert (x >= 0).all()
    assert gradient.min() > -1e-9 * size
    assert np.abs(gradient[x > 0]).max(initial=0.0) < 1e-9 * size
    gram, moment = matrix.T @ matrix, matrix.T @ target
    y = np.asarray(nnls.batched(jnp.asarray(gram)[None], jnp.asarray(moment)[None]))[0]
    assert (y >= 0).all()
    exact, other = (float(np.sum((matrix @ v - target) ** 2)) for v in (x, y))
    assert other == pytest.approx(exact, abs=1e-9 * float(target @ target))
    if np.linalg.matrix_rank(matrix) == matrix.shape[1]:
        assert y == pytest.approx(x, abs=1e-5 * max(x.max(), 1.0))


def test_weighted_least_squares_are_those_of_repeated_rows():
    matrix, target = next(problems())
    count = np.random.default_rng(1).integers(0, 3, (4, len(target)))
    result = nnls.weighted(jnp.asarray(matrix), jnp.asarray(target), jnp.asarray(count * 1.0), 2)
    for w, x in zip(count, np.asarray(result), strict=True):
        rows, values = np.repeat(matrix, w, axis=0), np.repeat(target, w)
        expected = nnls.exact(rows, values)
        best = np.sum((rows @ expected - values) ** 2)
        assert np.sum((rows @ x - values) ** 2) == pytest.approx(best, rel=1e-9)


def test_distribution_of_a_body_on_the_grid_is_found():
    normals, which = grid(60)
    truth = np.zeros(60)
    truth[[3, 20, 41, 55]] = [1.0, 0.5, 2.0, 0.3]
    seen = seen_of(300)
    matrix = columns(seen, normals, which)
    seen = seen.with_flux(matrix @ truth)
    result = solve(seen, normals, which, matrix)
    assert result.areas == pytest.approx(truth, abs=1e-8)
    assert result.chi2 < 1e-8


def relative(n_curves: int = 6, n: int = 240, noise: float = 0.01) -> tuple[Observed, np.ndarray]:
    """Curves of unknown scale, and their scales."""
    scale = np.linspace(0.4, 2.3, n_curves)
    group = np.arange(n) * n_curves // n
    curve = curve_of(BRICK, n, noise, curve=group, free_scale=np.ones(n_curves, bool))
    seen = Observed.of(curve, Fixed())
    seen = seen.with_error(scale[group] * seen.error)
    return seen.with_flux(scale[group] * seen.flux), scale


def test_scales_of_curves_are_found_with_the_areas():
    seen, scale = relative(noise=1e-5)
    normals, which = BRICK.normals, np.zeros(6, int)
    result = solve(seen, normals, which, columns(seen, normals, which))
    assert result.scale.mean() == pytest.approx(1.0)
    assert result.scale == pytest.approx(scale / scale.mean(), rel=1e-4)
    assert result.areas == pytest.approx(BRICK.areas * scale.mean(), rel=1e-4)


def test_free_scales_are_at_a_minimum():
    seen, _ = relative(noise=0.1)
    normals, which = grid(80)
    matrix = columns(seen, normals, which)
    result = solve(seen, normals, which, matrix)
    # from here, no change of scales followed by the best areas for them helps
    rng = np.random.default_rng(0)
    for _ in range(5):
        scale = result.scale * np.exp(1e-3 * rng.normal(size=6))
        of = (scale[seen.curve] / seen.error)[:, None]
        areas = nnls.exact(of * matrix, seen.flux / seen.error)
        chi2 = np.sum((seen.flux / seen.error - (of * matrix) @ areas) ** 2)
        assert chi2 > result.chi2


def test_a_calibrated_curve_among_free_ones_sets_the_size():
    seen, scale = relative(noise=1e-5)
    group = seen.curve
    free = np.array([True] * 5 + [False])
    factor = np.where(group == 5, 1.0 / scale[5], 1.0)
    seen = Observed(
        seen.flux * factor, seen.error * factor, group, free, seen.sun, seen.obs, seen.weight, True
    )
    normals, which = BRICK.normals, np.zeros(6, int)
    result = solve(seen, normals, which, columns(seen, normals, which))
    assert result.areas == pytest.approx(BRICK.areas, rel=1e-4)
    assert result.scale == pytest.approx([*scale[:5], 1.0], rel=1e-4)


def test_smoothing_is_the_penalty_it_says():
    seen, (normals, which) = seen_of(200), grid(100)
    matrix = columns(seen, normals, which)
    unit = typical(seen, matrix)
    rows = smooth(normals, which, 4.0, unit)
    # by hand: each normal against its six neighbours
    a = np.random.default_rng(0).uniform(size=100)
    near = np.argsort(-(normals @ normals.T), axis=1)[:, 1:7]
    expected = 4.0 * np.sum((a - a[near].mean(axis=1)) ** 2) / unit**2
    assert np.sum((rows.matrix @ a) ** 2) == pytest.approx(expected)
    rough, even = (solve(seen, normals, which, matrix, p) for p in ([], [rows]))
    assert even.chi2 > rough.chi2
    assert np.sum((rows.matrix @ even.areas) ** 2) < np.sum((rows.matrix @ rough.areas) ** 2)


def test_a_body_that_is_always_dark_is_refused():
    sun = directions(np.random.default_rng(0), 5)
    curve = LightCurve(t=np.arange(5.0), brightness=np.ones(5), error=np.ones(5), sun=sun, obs=-sun)
    seen = Observed.of(curve, Fixed())
    normals, which = grid(50)
    with pytest.raises(InputError, match="dark at every epoch"):
        typical(seen, columns(seen, normals, which))


def test_geometry_alone_is_refused():
    curve = curve_of(BRICK, 5)
    empty = LightCurve(
        t=curve.t, brightness=np.full(5, np.nan), error=None, sun=curve.sun, obs=curve.obs
    )
    with pytest.raises(InputError, match="no brightness"):
        Observed.of(empty, Fixed())
