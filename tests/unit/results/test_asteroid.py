"""Bodies of the draws of an asteroid's posterior: dimensions, inertia, rotation."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from lcbayes.physics.bodies import facets
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.results.asteroid import (
    Asteroid,
    asteroids,
    body_content,
    tilt_warning,
    turns_about_pole,
)
from tests.helpers import occulting_ellipsoid as known


@pytest.fixture(scope="module")
def tree() -> xr.DataTree:
    return known.posterior(draws=24)


def test_solutions_of_a_fit(tree):
    result = asteroids(tree)
    assert [a.weight for a in result] == [0.5, 0.5]
    assert result[0].middle_jd == pytest.approx(known.MIDDLE_JD, abs=1e-6)
    spin = result[0].mean_spin
    assert (spin.pole_lon_deg, spin.pole_lat_deg) == pytest.approx(known.POLE, abs=0.5)
    without = tree.copy()
    without.attrs = {k: v for k, v in tree.attrs.items() if k != "epoch_jd"}
    assert asteroids(without) == []
    bare = xr.DataTree.from_dict({"posterior": xr.Dataset(), "constant_data": xr.Dataset()})
    assert asteroids(bare) == []


def test_dimensions_are_those_of_the_ellipsoids(tree):
    """Axis ratios of ellipsoids known in closed form, with the scatter of the draws."""
    content = body_content(asteroids(tree)[0])
    rows = content["quantities"]
    a, b, c = known.AXES
    assert content["n_bodies"] == 24
    assert content["n_failed"] == 0
    for name, truth in (
        ("extent_ab", a / b),
        ("extent_bc", b / c),
        ("ellipsoid_ab", a / b),
        ("ellipsoid_bc", b / c),
        ("extent_a", a / np.cbrt(a * b * c)),
        ("extent_c", c / np.cbrt(a * b * c)),
    ):
        # 24 draws of axes that scatter by 2 %, and the facets of a grid of 150
        assert rows[name]["mean"] == pytest.approx(truth, rel=0.025), name
        assert 0.005 * truth < rows[name]["sd"] < 0.05 * truth, name
        assert rows[name]["q05"] < rows[name]["q50"] < rows[name]["q95"]
    assert 0.95 < rows["volume"]["mean"] < 1.0  # an ellipsoid of 4 : 3 is nearly a sphere
    assert rows["inertia_tilt_deg"]["mean"] < 3.0
    assert not content["tilted"]
    assert tilt_warning(content) == ""


def test_a_tilted_body_is_warned_of(tree):
    """The same ellipsoids turned by 30° about the x axis of the body."""
    one = asteroids(tree)[0]
    turned = Rotation.from_euler("x", 30.0, degrees=True).apply(one.normals)
    content = body_content(Asteroid(one.draws, turned, one.middle_jd, 1.0, one.frame), 20)
    assert content["quantities"]["inertia_tilt_deg"]["q50"] == pytest.approx(30.0, abs=3.0)
    assert "the axis of largest inertia is 30° from the spin axis" in tilt_warning(content)


def test_equivalent_ellipsoid_of_a_box():
    """A box of edges p ≥ q ≥ r has the moments of the ellipsoid of axes in the same ratio."""
    edges = np.array([3.0, 2.0, 1.0])
    areas = np.tile(np.prod(edges) / edges, 2)
    body = minkowski(np.vstack([np.eye(3), -np.eye(3)]), areas)
    scale = np.cbrt(6.0 / np.pi)
    assert body.ellipsoid == pytest.approx(edges * scale, rel=1e-6)
    small = body.of_unit_diameter
    assert np.cbrt(6.0 * small.volume / np.pi) == pytest.approx(1.0)
    assert small.dimensions == pytest.approx(edges / scale / np.cbrt(6.0) * scale / scale, rel=1e-6)


def test_rotation_angle_and_its_error(tree):
    """At the middle of the data the mean spin's; later it grows with the error of the period."""
    one = asteroids(tree)[0]
    later = known.MIDDLE_JD + 20_000.0
    angles = one.rotation_angle_deg([known.MIDDLE_JD, later])
    assert angles.mean(axis=0) % 360.0 == pytest.approx(
        one.mean_spin.phase_deg([known.MIDDLE_JD, later]), abs=0.3
    )
    sd = angles.std(axis=0, ddof=1)
    assert sd[0] < 1.5  # 0.3° of the pole, and the noise of fitted harmonics
    period = one.flat("period_h")
    turns = 20_000.0 * 24.0 / period
    expected = np.hypot(sd[0], 360.0 * np.std(turns, ddof=1))
    assert sd[1] == pytest.approx(expected, rel=0.2)
    assert sd[1] > 3.0 * sd[0]


def test_turned_features_count_as_rotation():
    """Bodies turned about z by known angles: found, to a twentieth of a degree."""
    normals = facets.grid(400)
    harmonics = facets.spherical_harmonics(normals, 6)
    axes = np.array([1.6, 1.2, 1.0])
    angles = np.array([-11.0, -3.0, 0.0, 4.0, 10.0])
    rows = []
    for angle in angles:
        n = Rotation.from_euler("z", -angle, degrees=True).apply(normals)
        logs = -2.0 * np.log(np.sum((n * axes) ** 2, 1)) + 0.3 * n[:, 0]
        rows.append(np.linalg.lstsq(harmonics, logs, rcond=None)[0][1:])
    result = turns_about_pole(np.array(rows))
    assert result - result.mean() == pytest.approx(angles - angles.mean(), abs=0.1)
    # degrees 5 and 6, which light curves do not determine, hardly matter
    noisy = np.repeat(np.array(rows), 40, axis=0)
    noisy[:, 24:] += np.random.default_rng(2).normal(size=noisy[:, 24:].shape)
    noise = turns_about_pole(noisy) - np.repeat(angles, 40)
    assert noise.std() < 2.0


def test_a_body_that_does_not_close_is_counted():
    tree = known.posterior(draws=24)
    one = asteroids(tree)[0]
    areas = one.draws["albedo_area"].to_numpy().copy()
    areas[0, 0] = np.where(one.normals[:, 2] > 0.9, 1.0, 0.0)
    broken = one.draws.assign(albedo_area=(one.draws["albedo_area"].dims, areas))
    bodies, failed = Asteroid(broken, one.normals, one.middle_jd, 1.0, one.frame).bodies(5)
    assert failed == 1
    assert len(bodies) == 4
    with pytest.raises(ValueError, match=r"."):
        close(one.normals, areas[0, 0])
