"""The asteroid model: symmetries it must have, and a known ellipsoid found again."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpyro import handlers
from scipy.spatial.transform import Rotation

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import fit, search
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.solutions import Solution
from lcbayes.inversion.attitude_scan.spin import in_convention
from lcbayes.modelling import asteroids, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import convex_grid
from lcbayes.physics import brightness
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets
from lcbayes.samplers.settings import Settings
from tests.helpers.asteroids import PERIOD_H, POLE_DEG, SMALL, observed, unit


def problem(curve: LightCurve, **options) -> tuple[Problem, Epochs]:
    data = Epochs.of(curve)
    return Problem(partial(convex_grid.model, **(SMALL | options)), data), data


def start(data: Epochs, **changes):
    return convex_grid.starts(data, jax.random.key(0), **SMALL)[7] | changes


@pytest.mark.parametrize(("given", "searched"), [({}, 2.4), ({"roughness": 1.0}, 1.0)])
def test_the_search_knows_the_roughness_unless_it_is_given(given, searched):
    options = {k: v for k, v in SMALL.items() if k != "n_quadrature"} | given
    model, data = problem(observed(), **options)
    entry = registry.find("convex-grid")
    stages = fit.Stages.of(model, entry, options, Settings(), Checkpoint(None, {}), Silent())
    bound = stages.simpler(data).model
    assert isinstance(bound, partial)
    assert bound.keywords == {"n_quadrature": 300} | options | {"roughness": searched}


def test_a_sphere_is_constant_at_constant_phase_angle():
    curve = observed()
    axis = unit(*POLE_DEG)
    side = np.cross(axis, curve.sun)
    obs = curve.sun * np.cos(0.4) + np.sin(0.4) * side / np.linalg.norm(side, axis=1)[:, None]
    same = LightCurve(
        t=curve.t,
        brightness=curve.brightness,
        error=None,
        sun=curve.sun,
        obs=obs,
        curve=curve.curve,
        free_scale=curve.free_scale,
        epoch_jd=curve.epoch_jd,
        frame=curve.frame,
    )
    built, data = problem(same, n_quadrature=1000)
    flux = np.asarray(built.flux(start(data), data))
    assert np.std(flux) / np.mean(flux) < 2e-3
    bent = start(data, coefficients=jnp.zeros(15).at[4].set(1.0))
    assert np.std(built.flux(bent, data)) / np.mean(flux) > 2e-2


def test_a_sphere_in_full_light_has_unit_flux():
    curve = observed()
    full = LightCurve(
        t=curve.t,
        brightness=curve.brightness,
        error=None,
        sun=curve.sun,
        obs=curve.sun,
        curve=curve.curve,
        free_scale=curve.free_scale,
        epoch_jd=curve.epoch_jd,
        frame=curve.frame,
    )
    built, data = problem(full, n_quadrature=1000)
    flux = built.flux(start(data, log_lambert_c=jnp.array(-50.0)), data)
    np.testing.assert_allclose(flux, 1.0, rtol=5e-3)


def test_the_brightness_of_a_rough_body_does_not_depend_on_the_normals():
    """Bodies as rough as 43 Ariadne, against a sum over 12,000 normals of another kind in NumPy."""
    curve = observed()
    built, data = problem(curve, n_quadrature=600, degree=6)
    coarse, _ = problem(curve, n_quadrature=300, degree=6)
    i = np.arange(12000) + 0.5
    g, phi = 1.0 - i / 6000.0, np.pi * (3.0 - np.sqrt(5.0)) * i
    s = np.sqrt(1.0 - g * g)
    fine = np.stack([s * np.cos(phi), s * np.sin(phi), g], axis=1)
    harmonics = facets.spherical_harmonics(fine, 6)[:, 1:]
    errors, before = [], []
    for seed in range(4):
        drawn = 1.2 * np.random.default_rng(seed).normal(size=48)
        drawn[8:] *= 0.5
        sites = convex_grid.starts(data, jax.random.key(0), **(SMALL | {"degree": 6}))[7]
        sites |= {"coefficients": jnp.asarray(drawn)}
        period_s = float(built.constrain(built.ravel(sites), data)["period_h"]) * 3600.0
        pole = np.asarray(sites["pole_base"][0]) / np.linalg.norm(sites["pole_base"])
        tilt = np.asarray(rotations.brought_to(jnp.asarray(pole)))
        angle = 2.0 * np.pi * (np.asarray(data.t) - float(data.t_middle)) / period_s
        turn = tilt @ Rotation.from_euler("z", angle[:, None]).as_matrix()
        mu0, mu = (
            np.maximum(np.einsum("ti,tij->tj", np.asarray(v), turn) @ fine.T, 0.0)
            for v in (data.sun, data.obs)
        )
        kernel = mu0 * mu * (1.0 / np.maximum(mu0 + mu, 1e-300) + np.exp(sites["log_lambert_c"]))
        share = np.exp(harmonics @ drawn)
        exact = 8.0 * kernel @ (share / share.sum())
        errors.append(np.std(built.flux(sites, data) / exact - 1.0))
        before.append(np.std(coarse.flux(sites, data) / exact - 1.0))
    assert max(errors) < 1.5e-3
    assert np.mean(before) > 2.0 * np.mean(errors)


def test_turning_the_frame_changes_nothing():
    """But the axes in which the body's areas are told, about its pole."""
    curve = observed()
    turn = Rotation.from_rotvec([0.4, -0.9, 0.7]).as_matrix()
    turned = replace(curve, sun=curve.sun @ turn.T, obs=curve.obs @ turn.T)
    shape = 0.3 * np.asarray(jax.random.normal(jax.random.key(1), (15,)))
    pole = unit(40.0, 55.0)
    tilt = np.asarray(rotations.brought_to(jnp.asarray(pole)))
    built, data = problem(curve, n_quadrature=3000)
    other, turned_data = problem(turned, n_quadrature=3000)
    sites = {"coefficients": jnp.asarray(shape), "pole_base": jnp.asarray(pole)[None]}
    here = built.flux(start(data, **sites), data)
    same = in_convention(turn @ tilt, shape)[2]
    sites = {"coefficients": jnp.asarray(same), "pole_base": jnp.asarray(turn @ pole)[None]}
    there = other.flux(start(turned_data, **sites), turned_data)
    np.testing.assert_allclose(there, here, rtol=2e-3)  # the grid is not turned
    assert np.std(here) / np.mean(here) > 0.05


@pytest.mark.parametrize("lat", [90.0, -90.0])
def test_nothing_happens_as_the_pole_passes_90_degrees(lat):
    """Poles 0.02 degrees apart had light curves that differed by all of their amplitude."""
    built, data = problem(observed())
    shape = 0.3 * jax.random.normal(jax.random.key(1), (15,))

    @jax.jit
    def values(sites):
        return built.flux(sites, data), jax.grad(built.potential)(built.ravel(sites), data)

    def at(lon: float, lat: float):
        pole = jnp.asarray(unit(lon, lat))[None]
        flux, slope = values(start(data, coefficients=shape, pole_base=pole))
        return np.asarray(flux), slope

    (one, slope), (two, across) = at(0.0, 0.9999 * lat), at(180.0, 0.9999 * lat)
    assert np.sqrt(np.mean((one - two) ** 2)) < 2e-3 * np.mean(one)
    assert np.max(np.abs(slope - across)) < 0.05 * np.max(np.abs(slope))
    assert np.all(np.isfinite(at(0.0, lat)[1]))


def test_coordinates_leave_the_model_as_it_is():
    curve = observed()
    plain, data = problem(curve)
    model = partial(convex_grid.model, **SMALL)
    mixed = Problem(model, data, convex_grid.coordinates(data, **SMALL))
    sites = start(data, coefficients=0.5 * jax.random.normal(jax.random.key(1), (15,)))
    z = mixed.ravel(sites)
    np.testing.assert_allclose(
        mixed.constrain(z, data)["coefficients"], sites["coefficients"], rtol=1e-8
    )
    jacobian = jax.jit(jax.jacfwd(lambda z: plain.ravel(mixed.constrain(z, data))))(z)
    potential = compiled(plain.potential)(plain.ravel(sites), data)
    expected = potential - np.linalg.slogdet(jacobian)[1]
    assert compiled(mixed.potential)(z, data) == pytest.approx(float(expected), rel=1e-9)


def test_what_is_hardly_seen_leaves_the_moments_of_the_brightness_as_they_are():
    """Of a rough body too, whose moments over other normals are different."""
    options = SMALL | {"n_facets": 100, "n_quadrature": 300, "degree": 5}
    data = Epochs.of(observed())
    model = partial(convex_grid.model, **options)
    mixed = Problem(model, data, convex_grid.coordinates(data, **options))
    rough = 1.5 * jax.random.normal(jax.random.key(1), (35,))
    z = mixed.ravel(start(data) | {"coefficients": rough})
    normals, weights = facets.rings(300)
    harmonics = facets.spherical_harmonics(normals, 5)[:, 1:]
    high = mixed.rows(["coefficients"])[24:]

    def moments(z):
        areas = weights * np.exp(harmonics @ np.asarray(mixed.constrain(z, data)["coefficients"]))
        return areas @ harmonics[:, :24] / areas.sum()

    changed = moments(z.at[high].add(0.3))
    np.testing.assert_allclose(changed, moments(z), atol=1e-9)
    assert np.abs(moments(z.at[mixed.rows(["coefficients"])[:24]].add(0.01)) - changed).max() > 1e-3


def test_calibrated_curves_bring_size_and_phase_law():
    relative = set(problem(observed())[0].names)
    built, data = problem(observed(free_scale=False))
    calibrated = {"log_sphere_flux", "log_phase_a", "log_phase_d", "phase_k"}
    assert set(built.names) - relative == calibrated
    sites = start(data)
    assert calibrated <= sites.keys()
    s = 0.5 * np.exp(-data.phase_angle / 0.1) - 0.5 * data.phase_angle + 1
    dark = sites | {"log_phase_a": jnp.array(-60.0), "phase_k": jnp.array(0.0)}
    ratio = built.flux(sites, data) / built.flux(dark, data)
    np.testing.assert_allclose(ratio, s, rtol=1e-12)


def two_surveys() -> LightCurve:
    """Relative curves: one night, a survey of few points, and one of more."""
    curve = observed()
    n = curve.n_obs
    group = np.repeat([0, 1, 2], [n // 4, n // 4, n - 2 * (n // 4)])
    bent = np.where(group > 0, np.linspace(0.0, 0.8, n), 0.0)[:, None]
    obs = curve.obs + bent * np.cross(curve.obs, [0.0, 0.0, 1.0])
    obs /= np.linalg.norm(obs, axis=1, keepdims=True)
    sun = np.where(group[:, None] > 0, curve.sun, curve.sun[0])
    obs = np.where(group[:, None] > 0, obs, obs[0])
    names = ("night", "few", "many")
    return replace(
        curve, sun=sun, obs=obs, curve=group, curve_names=names, free_scale=np.ones(3, bool)
    )


def test_each_relative_curve_over_phase_angles_has_its_own_phase_law():
    curve = two_surveys()
    built, data = problem(curve)
    assert data.phased == (2, 1)  # more points first
    a, d, k = np.array([0.6, 0.4]), np.array([0.05, 0.1]), np.array([-0.7, -0.2])
    law = {"log_phase_a": jnp.log(a), "log_phase_d": jnp.log(d), "phase_k": jnp.asarray(k)}
    dark = {"log_phase_a": jnp.full(2, -60.0), "phase_k": jnp.zeros(2)}
    sites = start(data)
    assert sites["phase_k"].shape == (2,)
    angle = np.arccos(np.clip(np.sum(curve.sun * curve.obs, axis=1), -1.0, 1.0))
    which = np.array([0, 1, 0])[curve.curve]  # a night has the law of the first
    expected = a[which] * np.exp(-angle / d[which]) + k[which] * angle + 1.0
    ratio = built.flux(sites | law, data) / built.flux(sites | dark, data)
    np.testing.assert_allclose(ratio, expected, rtol=1e-7)
    few = curve.curve == 1  # alone, at epochs that are predicted
    with handlers.substitute(data=law):
        alone = asteroids.phase_law(Epochs.of(curve.select(few), curve))
    np.testing.assert_allclose(alone, expected[few], rtol=1e-7)


@pytest.mark.parametrize("c", [1e-6, 0.1, 0.8])
def test_flux_of_a_sphere_at_zero_phase_is_its_parameter(c):
    built, data = problem(observed(free_scale=False))
    sites = start(data, log_lambert_c=jnp.log(c))
    area = jnp.asarray(built.constrain(built.ravel(sites), data)["albedo_area"])
    normals = jnp.asarray(convex_grid.grid(len(area), 1)[0])
    towards = jnp.array([[0.6, 0.0, 0.8]])
    flux = brightness.flux(towards, towards, normals, area, asteroids.LAW, c)
    assert flux[0] == pytest.approx(float(np.mean(data.brightness)), rel=2e-3)


def test_search_finds_a_known_ellipsoid():
    built, data = problem(observed())
    rows = convex_grid.starts(data, jax.random.key(0), **SMALL)
    z = jnp.stack([built.ravel(row) for row in rows])
    best = search.successive_halving(built, data, z, 2, Silent()).z[0]
    result = built.constrain(jnp.asarray(best), data)
    pole = unit(float(result["pole_lon_deg"]), float(result["pole_lat_deg"]))
    assert np.degrees(np.arccos(pole @ unit(*POLE_DEG))) < 4.0
    assert result["period_h"] == pytest.approx(PERIOD_H, abs=3e-4)
    assert result["sigma"] == pytest.approx(0.005, rel=0.5)


@pytest.mark.parametrize(("size", "holds"), [(0.1, True), (60.0, False)])
def test_moments_are_left_where_they_do_not_give_a_body_back(size, holds):
    """Nearly all area in a few places, as of a brick: the plain coordinates are sampled there."""
    data = Epochs.of(observed())
    plain, own = build_problem(registry.find("convex-grid"), SMALL, data)
    drawn = plain.constrain(plain.prior_draw(jax.random.key(0), data), data)
    sites = {name: drawn[name] for name in plain.names}
    rng = np.random.default_rng(0)
    sites["coefficients"] = jnp.asarray(size * rng.standard_normal(drawn["coefficients"].shape))
    solution = Solution(np.asarray(plain.ravel(sites)), 0.0, 0.0, 0.0, 1)
    assert fit.hold(plain, own, [solution], data) is holds
