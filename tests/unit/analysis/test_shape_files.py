"""Exports of an asteroid, read back by an independent reader."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from lcbayes.analysis import shape_files
from lcbayes.analysis.shape_files import DamitModel
from lcbayes.core.jax_setup import jnp
from lcbayes.data.formats.damit_model import Scattering
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.models import convex_grid
from lcbayes.physics.attitude.spin_state import SpinState
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski
from tests.helpers import damit_model
from tests.helpers.results_folders import fibonacci

FACETS, DEGREE, EPOCH = 80, 4, 2451234.75


def curve(free_scale: bool) -> LightCurve:
    """Forty points over twenty years, directions all over the sky."""
    rng = np.random.default_rng(2)
    t = np.sort(rng.uniform(0.0, 20 * 365.25 * 86400.0, 40))
    sun = fibonacci(40)
    obs = Rotation.from_rotvec(rng.normal(0.0, 0.3, (40, 3))).apply(sun)
    return LightCurve(
        t=t,
        brightness=np.ones(40),
        error=np.full(40, 0.01),
        sun=sun,
        obs=obs,
        free_scale=np.array([free_scale]),
        epoch_jd=EPOCH,
        frame="ecliptic-j2000",
    )


@pytest.mark.parametrize(
    ("pole", "free_scale"),
    [
        ((272.0, 52.2), True),
        ((70.3, -16.1), False),
        ((10.0, -89.9), True),
        ((179.9, 0.05), True),
    ],
)
def test_triangles_give_the_brightness_of_the_model(tmp_path, pole, free_scale):
    """Rotated by the convention of DAMIT, the exported body is as bright as the fitted one."""
    light = curve(free_scale)
    data = Epochs.of(light)
    options = {"period": 8.4006, "n_facets": FACETS, "n_quadrature": FACETS, "degree": DEGREE}
    problem = Problem(partial(convex_grid.model, **options), data)
    normals, harmonics, log_weights = convex_grid.grid(FACETS, DEGREE)
    degrees = np.concatenate([np.full(2 * n + 1, n) for n in range(1, DEGREE + 1)])
    rng = np.random.default_rng(7)
    coefficients = rng.normal(size=len(degrees)) * (2.0 / (degrees + 1.0)) ** 2

    def closure(low):  # harmonics of degree 1 that close the body
        areas = np.exp(harmonics @ np.concatenate([low, coefficients[3:]]) + log_weights)
        return areas @ normals / areas.sum()

    coefficients[:3] = root(closure, coefficients[:3], tol=1e-12).x
    lon, lat = np.radians(pole)
    axis = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    sites = {
        "pole_base": jnp.asarray(axis)[None],
        "period_shift": jnp.array(0.3),
        "coefficients": jnp.asarray(coefficients),
        "log_lambert_c": jnp.log(0.17),
        "log_level": jnp.zeros(sum(data.free_scale)),
    }
    # a relative curve has a phase law as well, since it covers more than 5 degrees
    sites |= {"log_phase_a": jnp.log(0.6), "log_phase_d": jnp.log(0.12)}
    sites |= {"phase_k": jnp.array(-0.4)}
    if not free_scale:
        sites |= {"log_sphere_flux": jnp.array(0.4)}
    known = problem.constrain(problem.ravel(sites), data)
    flux = np.asarray(problem.flux({k: known[k] for k in problem.names}, data))

    area = np.asarray(known["albedo_area"])
    body = minkowski(normals, close(normals, area))
    middle = EPOCH + (light.t.min() + 0.5 * np.ptp(light.t)) / 86400.0
    spin = SpinState.of_pole(axis, float(known["period_h"]), middle)
    law = {k: float(known[f"phase_{k}"]) for k in "adk"}
    scattering = Scattering(float(known["lambert_c"]), **law)
    shape_files.write_body(tmp_path, body, "", "a test", DamitModel(spin, scattering))

    model = damit_model.read(tmp_path)
    result = model.flux(EPOCH + light.t / 86400.0, light.sun, light.obs)
    np.testing.assert_allclose(result, flux, rtol=1e-6)
    model.phi0 += 0.01  # a hundredth of a degree is seen
    wrong = model.flux(EPOCH + light.t / 86400.0, light.sun, light.obs)
    assert np.max(np.abs(wrong / flux - 1.0)) > 1e-5


def test_obj_and_stl_hold_the_same_body_and_its_spin(tmp_path):
    normals = fibonacci(30)
    body = minkowski(normals, close(normals, np.exp(0.3 * np.sin(3.0 * normals[:, 0]))))
    spin = SpinState(272.123456, -5.5, 8.400603123456, 2449000.0, 359.1234564)
    shape_files.write_body(tmp_path, body, "-2", "a\nb", DamitModel(spin, Scattering(0.1)))
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "shape-2.obj",
        "shape-2.stl",
        "shape-2.txt",
        "spin-2.txt",
    ]
    corners = damit_model.read(tmp_path, "-2").corners
    np.testing.assert_allclose(damit_model.read_obj(tmp_path / "shape-2.obj"), corners, atol=1e-8)
    header, single = damit_model.read_stl(tmp_path / "shape-2.stl")
    np.testing.assert_allclose(single, corners, atol=1e-6)
    assert header == ("ecl J2000 272.123 -5.500 deg P 8.400603123 h JD0 2449000.0 phi0 359.123 deg")
    comments = [x for x in (tmp_path / "shape-2.obj").read_text().split("\n") if x[:1] == "#"]
    assert comments[:2] == ["# a", "# b"]
    assert "# JD0 2449000.000000 (light-time corrected), phi0 359.123456 deg" in comments


def test_a_long_stl_header_is_refused():
    body = minkowski(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6))
    with pytest.raises(ValueError, match="cannot be the header"):
        body.stl("x" * 81)
    with pytest.raises(ValueError, match="cannot be the header"):
        body.stl("solid thing")


def test_without_a_spin_there_is_no_damit_model(tmp_path):
    body = minkowski(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6))
    shape_files.write_body(tmp_path, body, "", "a box", None)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["shape.obj", "shape.stl"]


def test_phase_of_a_spin_state():
    spin = SpinState(100.0, 30.0, 6.0, 2450000.0, 350.0)
    assert spin.phase_deg([2450000.0, 2450000.125, 2450000.5]) == pytest.approx([350.0, 170.0, 350])
