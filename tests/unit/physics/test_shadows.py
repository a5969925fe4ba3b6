"""Shadows between parts: against an independent ray caster, differences, and one another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import shadow_area, shadows
from lcbayes.physics.bodies.parts import Assembly
from lcbayes.physics.bodies.primitives import box
from lcbayes.physics.bodies.shadow_points import points_on
from lcbayes.physics.bodies.solids import Solid, above, edges, entered, flat_solid, normals
from lcbayes.simulation.simulate import body_flux
from tests.helpers import shaded_bodies as shaded

WITHIN = 1e-3  # of the largest flux
POINTS = {name: 2_500 if name == "mesh" else 10_000 for name in shaded.TEXTS}
METHODS = {
    "wings": "exact",
    "l-shape": "exact",
    "stage": "exact",
    "dish": "points",
    "fins": "exact",
}
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)


def _compare(name, folder, count, seed, tolerance, within=WITHIN):
    scenario = shaded.scenario(name, folder, tolerance)
    assert scenario.parts is not None
    assert scenario.parts.method == METHODS.get(name, "exact")
    sun, obs = shaded.attitudes(count, seed)
    ours = shaded.flux(scenario, sun, obs)
    rays = shaded.cast_flux(name, sun, obs, POINTS[name])
    whole = shaded.flux(scenario, sun, obs, shaded=False)
    assert np.max(whole - rays) > 50 * WITHIN * rays.max()  # else there is nothing to see
    assert np.max(np.abs(ours - rays)) < within * rays.max()


@pytest.mark.parametrize("name", list(shaded.TEXTS))
def test_flux_is_that_of_rays(name, tmp_path):
    _compare(name, tmp_path, 30, 1, 1e-3)


def test_flux_of_coarse_outlines_is_that_of_rays(tmp_path):
    """Where a circle has 16 sides."""
    _compare("stage", tmp_path, 100, 5, 1e-2, within=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(shaded.TEXTS))
def test_flux_is_that_of_rays_at_1000_attitudes(name, tmp_path):
    _compare(name, tmp_path, 1000, 2, 4e-4)


def _of_rotation(scenario, sun, obs):
    """Flux of one attitude as a function of a small rotation of the directions."""

    def flux(v):
        turn = rotations.constant_rate(jnp.ones(1), v)[0]
        directions = (jnp.asarray(sun)[None] @ turn.T, jnp.asarray(obs)[None] @ turn.T)
        visible = scenario.parts.lit_and_seen(*directions)
        return body_flux(scenario.body, scenario.materials, *directions, None, visible)[0]

    return flux


@pytest.mark.parametrize(
    ("name", "axes"), [("wings", 3), ("l-shape", 3), ("stage", 2), ("fins", 3)]
)
def test_gradients_are_differences(name, axes, tmp_path):
    """By rotations about x, y and z; the stage is symmetric about z."""
    scenario = shaded.scenario(name, tmp_path, 1e-2)
    sun, obs = shaded.attitudes(40, 3)
    flux = jax.jit(jax.vmap(lambda s, o, v: _of_rotation(scenario, s, o)(v)))
    slope = jax.jit(
        jax.vmap(lambda s, o: jax.grad(_of_rotation(scenario, s, o))(1e-9 * jnp.ones(3)))
    )(sun, obs)
    sizes, compared = [], 0
    for axis in range(3):
        moved = [
            np.asarray(flux(sun, obs, np.tile(h * np.eye(3)[axis], (40, 1))))
            for h in (-2e-5, -1e-5, 1e-5, 2e-5)
        ]
        near, far = (moved[2] - moved[1]) / 2e-5, (moved[3] - moved[0]) / 4e-5
        smooth = np.abs(near - far) < 1e-5  # no edge passes an edge within the step
        compared += smooth.sum()
        sizes.append(np.abs(near).max())
        assert np.abs(np.asarray(slope)[smooth, axis] - near[smooth]).max() < 2e-5
    assert compared > 100
    assert min(sizes[:axes]) > 0.1


def test_the_second_derivative_is_a_difference_of_gradients(tmp_path):
    scenario = shaded.scenario("wings", tmp_path)
    sun, obs = np.array([0.9, -0.4, 0.2]), np.array([0.8, -0.5, -0.1])
    flux = _of_rotation(scenario, sun / np.linalg.norm(sun), obs / np.linalg.norm(obs))
    at, step, along = jnp.array([1e-3, 2e-3, -1e-3]), 1e-5, jnp.array([0.6, -0.3, 0.7])
    second = jax.jit(lambda v: jax.jvp(jax.grad(flux), (v,), (along,))[1])(at)
    slope = jax.jit(jax.grad(flux))
    difference = (slope(at + step * along) - slope(at - step * along)) / (2 * step)
    assert np.abs(difference).max() > 0.1
    assert np.asarray(second) == pytest.approx(np.asarray(difference), abs=1e-4)


def test_a_shadow_that_begins_has_a_finite_slope(tmp_path):
    """The flux is continuous and its gradient finite where the box's shadow reaches a wing."""
    scenario = shaded.scenario("wings", tmp_path)
    obs = np.array([1.0, 0.0, 0.0])
    angles = np.linspace(-0.3, 0.3, 601)  # of the Sun, which crosses the plane of the wings' root
    sun = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    flux = shaded.flux(scenario, sun, np.tile(obs, (601, 1)))
    assert np.abs(np.diff(flux)).max() < 5e-3 * flux.max()
    on_edge = jax.jit(jax.grad(_of_rotation(scenario, np.array([1.0, 0.0, 0.0]), obs)))(
        jnp.zeros(3)
    )
    assert np.isfinite(on_edge).all()


@pytest.mark.parametrize("shaded_too", [True, False])
def test_a_convex_body_has_exactly_the_flux_without_shadows(shaded_too, tmp_path):
    scenario = shaded.scenario("l-shape", tmp_path)
    assert scenario.parts is not None
    alone = Assembly(scenario.parts.parts[:1], shaded_too)
    scenario = replace(scenario, parts=alone, body=alone.body)
    sun, obs = shaded.attitudes(50, 4)
    assert alone.method == "none"
    assert alone.lit_and_seen(jnp.asarray(sun), jnp.asarray(obs)) is None
    np.testing.assert_array_equal(
        shaded.flux(scenario, sun, obs), shaded.flux(scenario, sun, obs, shaded=False)
    )


def test_two_parts_that_cannot_shade_each_other():
    """A plate on each side of a plane: each lies behind the other's only lit side, or beside it."""
    polygons = [SQUARE, SQUARE[::-1] - [0, 0, 1.0]]
    solids = [flat_solid(p) for p in polygons]
    assert shadows.shadows(polygons, [0, 1], solids, [0, 1]) == ()
    assert points_on(polygons, [0, 1], solids, [0, 1]) is None


def test_points_and_clipping_agree(tmp_path):
    """At rest and at grazing angles, where outlines are long; and several solids over one face."""
    parts = shaded.scenario("wings", tmp_path).parts
    assert parts is not None
    sun, obs = shaded.attitudes(60, 5)
    sun[:20, 0] *= 1e-3
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    points = points_on(parts.polygons, *parts._blocking, 40_000)
    assert points is not None
    seen = points.lit_and_seen(sun, obs)
    exact = np.asarray(jax.jit(parts.lit_and_seen)(jnp.asarray(sun), jnp.asarray(obs)))
    lit = (sun @ parts.body.normals.T > 1e-3) & (obs @ parts.body.normals.T > 1e-3)
    assert np.abs(seen - exact)[lit].max() < 0.01
    assert np.abs(seen - exact)[lit].mean() < 5e-4


def test_shadows_of_several_solids_are_not_counted_twice():
    """Three walls over one square, two of which overlap, one of which touches the other."""
    walls = [
        np.array([[0, 0.2, 0.5], [1, 0.2, 0.5], [1, 0.5, 0.5], [0, 0.5, 0.5]]),
        np.array([[0.5, 0.4, 0.9], [1, 0.4, 0.9], [1, 0.8, 0.9], [0.5, 0.8, 0.9]]),
        np.array([[0, 0.5, 0.5], [0.5, 0.5, 0.5], [0.5, 0.6, 0.5], [0, 0.6, 0.5]]),
    ]
    up = jnp.array([[0.0, 0.0, 1.0]])
    groups = shadows.shadows([SQUARE], [0], [flat_solid(w) for w in walls], [1, 2, 3])
    assert groups
    covered = 0.3 + 0.5 * 0.4 - 0.5 * 0.1 + 0.05
    result = float(shadow_area.lit_and_seen(groups, 1, up, up)[0, 0])
    assert result == pytest.approx(1.0 - covered, abs=1e-8)


def test_a_panel_seen_edge_on_hides_nothing():
    """A wall on the edge of a square, Sun and observer in its plane, one of them, or neither."""
    wall = np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]], float)
    groups = shadows.shadows([SQUARE], [0], [flat_solid(wall)], [1])
    assert groups
    up, low, steep, away = [0, 0, 1.0], [-1, 0, 1.0], [-1, 0, 2.0], [1, 0, 1.0]
    pairs = {
        (0, 0): 1.0,
        (1, 0): 0.0,
        (0, 1): 0.0,
        (2, 0): 0.5,
        (2, 2): 0.5,
        (3, 0): 1.0,
        (3, 2): 0.5,
    }
    for (i, j), right in pairs.items():
        sun, obs = (np.array([[up, low, steep, away][k]]) for k in (i, j))
        sun, obs = (jnp.asarray(v / np.linalg.norm(v)) for v in (sun, obs))
        result = float(shadow_area.lit_and_seen(groups, 1, sun, obs)[0, 0])
        assert result == pytest.approx(right, abs=1e-8)


def test_a_solid_above_a_plane():
    made = box(2.0, 2.0, 2.0).solids[0]
    half = above(made, [0, 0, 0.25], [0, 0, 1.0])
    assert half is not None
    assert half.vertices[:, 2].min() == pytest.approx(0.25)
    assert len(half.faces) == 6
    assert len(edges(half).first) == 6
    assert above(made, [0, 0, 1.0], [0, 0, 1.0]) is None
    assert above(made, [0, 0, -1.0], [0, 0, 1.0]) is made
    corner = above(made, [0.8, 0.8, 0.8], [1, 1, 1])  # a corner: a tetrahedron
    assert corner is not None
    assert len(corner.faces) == 4
    outward = normals(corner) @ (corner.vertices.mean(axis=0))
    firsts = np.array([corner.vertices[f[0]] for f in corner.faces])
    assert np.all(np.sum(normals(corner) * firsts, axis=1) > outward)


def test_light_meets_one_face_of_a_solid_or_several():
    cube = box(2.0, 2.0, 2.0).solids[0]
    over = entered(cube, SQUARE + np.array([0, 0, 3.0]))
    assert over is not None
    assert len(over.faces) == 2  # of a flat polygon
    assert np.all(over.vertices[:, 2] == 1.0)
    assert entered(cube, SQUARE + np.array([0.5, 0, 3.0])) is cube  # beyond an edge: two faces
    flush = entered(cube, SQUARE + np.array([0.5, 0.5, 1.0]))  # partly on a face
    assert flush is cube
    flush = entered(cube, 0.5 * SQUARE + np.array([0, 0, 1.0]))
    assert flush is not None
    assert np.all(flush.vertices[:, 2] == 1.0)
    beside = entered(cube, SQUARE + np.array([1.0, 0, 1.0]))  # in its plane
    assert beside is not None
    assert np.all(beside.vertices[:, 0] == 1.0)
    assert entered(cube, 0.5 * SQUARE) is None  # inside


def test_slots_hold_one_edge_of_the_outline_at_most():
    """Outlines from slots close: their edges sum to zero, along any direction."""
    rng = np.random.default_rng(6)
    for solid in (box(1, 2, 3).solids[0], _wedge()):
        e = edges(solid)
        for d in rng.standard_normal((50, 3)):
            a, b = e.normal_a @ d > 0, e.normal_b @ d > 0
            ends = np.where((a != b)[:, None, None], e.first, e.second)
            ends = np.where(a[:, None, None], ends, ends[:, ::-1])
            np.testing.assert_allclose(np.sum(ends[:, 1] - ends[:, 0], axis=0), 0.0, atol=1e-12)


def _wedge() -> Solid:
    made = above(box(1, 2, 3).solids[0], [0.1, 0, 0], [1.0, 0.4, -0.3])
    assert made is not None
    return made


@pytest.mark.parametrize("name", ["wings", "stage", "fins"])
def test_some_at_a_time_and_batches_give_the_same(name, tmp_path, monkeypatch):
    parts = shaded.scenario(name, tmp_path, 1e-2).parts
    assert parts is not None
    sun, obs = map(jnp.asarray, shaded.attitudes(50, 7))

    def fractions(sun, obs):
        found = parts.lit_and_seen(sun, obs)
        assert found is not None
        return found

    whole = np.asarray(fractions(sun, obs))
    alone = jax.vmap(lambda s, o: fractions(s[None], o[None])[0])
    np.testing.assert_allclose(np.asarray(alone(sun, obs)), whole, rtol=0, atol=1e-12)
    one = np.asarray(jax.vmap(lambda s: fractions(s[None], obs[:1])[0])(sun))
    both = np.asarray(fractions(sun, jnp.tile(obs[:1], (50, 1))))
    np.testing.assert_allclose(one, both, rtol=0, atol=1e-12)
    monkeypatch.setattr(shadow_area, "MOST_TESTS", 1)
    monkeypatch.setattr(shadow_area, "FEWEST", 7)  # as many pairs at once
    some = np.asarray(fractions(sun[:49], obs[:49]))  # another size is traced again
    np.testing.assert_allclose(some, whole[:49], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["wings", "l-shape", "stage", "fins"])
def test_what_is_in_shadow_is_never_left_out(name, tmp_path, monkeypatch):
    """The shadows that rectangles keep, against all on polygons that face both directions."""
    parts = shaded.scenario(name, tmp_path, 1e-2).parts
    assert parts is not None
    sun, obs = map(jnp.asarray, shaded.attitudes(301, 8))
    kept = np.asarray(parts.lit_and_seen(sun, obs))

    def facing(group, *directions):
        cosines = [jnp.einsum("jr,tj->rt", group.frame[2], d) for d in directions]
        lit = jnp.minimum(*cosines) > shadow_area.GRAZING
        return jnp.broadcast_to(lit, (2 * len(group.first), *lit.shape))

    monkeypatch.setattr(shadow_area, "_over", facing)
    jax.clear_caches()
    np.testing.assert_allclose(kept, np.asarray(parts.lit_and_seen(sun, obs)), rtol=0, atol=1e-12)
    jax.clear_caches()
