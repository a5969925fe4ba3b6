"""Parts of bodies: their areas and normals, how finely they are divided, and where they are."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import scipy.special

from lcbayes.physics.bodies import division, primitives
from lcbayes.physics.bodies.closure import closure
from lcbayes.physics.bodies.parts import Assembly, Part, rotation_by, rotation_to
from lcbayes.physics.bodies.solids import normals, vector_area

SIZES = {
    "box": (1.0, 2.0, 3.0),
    "plate": (2.0, 3.0),
    "cylinder": (0.8, 3.0),
    "cone": (0.7, 1.5),
    "frustum": (1.0, 0.4, 0.9),
    "sphere": (0.6,),
    "ellipsoid": (1.0, 2.0, 0.5),
    "dish": (0.9, 0.3),
}
SLANT = np.hypot(0.9, 0.6)
AREAS = {
    "box": 22.0,
    "plate": 12.0,
    "cylinder": 2 * np.pi * 0.8 * 3.8,
    "cone": np.pi * 0.7 * (0.7 + np.hypot(0.7, 1.5)),
    "frustum": np.pi * (1.16 + 1.4 * SLANT),
    "sphere": 4 * np.pi * 0.36,
    # Carlson's form of the elliptic integral
    "ellipsoid": 4 * np.pi * scipy.special.elliprg(1.0 * 4.0, 1.0 * 0.25, 4.0 * 0.25),
    # surface of revolution of z = 0.3 (r/0.9)², on both sides
    "dish": 2 * np.pi / (6 * (0.3 / 0.81) ** 2) * ((1 + 4 * (0.3 / 0.9) ** 2) ** 1.5 - 1),
}
WHITE = ("lambertian", {"r_diff": 1.0})
GLOSSY = ("ashikhmin-shirley", {"r_diff": 0.3, "r_spec": 0.4, "nu": 60.0, "nv": 30.0})


def make(kind: str, n: int = 48) -> primitives.Panels:
    result = primitives.KINDS[kind]
    return result.make(*SIZES[kind], n) if result.curved else result.make(*SIZES[kind])


@pytest.mark.parametrize("kind", list(primitives.KINDS))
def test_panels_are_well_formed(kind):
    panels = make(kind)
    count = len(panels.areas)
    assert len(panels.polygons) == len(panels.sides) == count
    assert set(panels.sides) == set(primitives.KINDS[kind].sides)
    assert np.sum(panels.areas) == pytest.approx(AREAS[kind], rel=1e-3)
    assert closure(panels.normals, panels.areas) < 1e-3
    np.testing.assert_allclose(np.linalg.norm(panels.normals, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(panels.u_axes, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.sum(panels.normals * panels.u_axes, axis=1), 0.0, atol=1e-12)
    for polygon, normal, area in zip(panels.polygons, panels.normals, panels.areas, strict=True):
        vector = vector_area(polygon)
        off = polygon - polygon.mean(axis=0)
        assert np.abs(off @ vector).max() < 1e-9 * np.linalg.norm(vector)  # planar
        assert vector @ normal / np.linalg.norm(vector) > 0.98  # and as the surface is there
        assert np.linalg.norm(vector) == pytest.approx(area, rel=0.02)


@pytest.mark.parametrize("kind", [k for k in primitives.KINDS if k not in ("plate", "dish")])
def test_solids_are_closed_and_as_large_as_their_part(kind):
    panels = make(kind)
    (solid,) = panels.solids
    middle = solid.vertices.mean(axis=0)
    outward = normals(solid)
    firsts = solid.vertices[[face[0] for face in solid.faces]]
    assert np.all(np.sum(outward * (firsts - middle), axis=1) > 0)
    areas = np.array([np.linalg.norm(vector_area(solid.vertices[f])) for f in solid.faces])
    assert closure(outward, areas) < 1e-12
    # the mean shadow of a convex body is a quarter of its surface (Cauchy)
    assert areas.sum() == pytest.approx(AREAS[kind], rel=0.02)


def _phase(degrees: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions to Sun and observer at phase angles, each pair turned at random."""
    angle = np.deg2rad(degrees)
    sun = np.tile([1.0, 0.0, 0.0], (len(angle), 1))
    obs = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))], axis=1)
    turns = np.linalg.qr(np.random.default_rng(8).standard_normal((len(angle), 3, 3)))[0]
    return np.einsum("tij,tj->ti", turns, sun), np.einsum("tij,tj->ti", turns, obs)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_a_lambert_sphere_in_closed_form(tolerance):
    """f = 2/(3π) r² [sin α + (π − α) cos α] (Lommel; Seeliger 1887)."""
    degrees = np.linspace(0.0, 170.0, 200)
    sun, obs = _phase(degrees)
    panels, error = division.divide(partial(primitives.sphere, 0.6), {"side": WHITE}, tolerance)
    alpha = np.deg2rad(degrees)
    right = 2 * 0.36 / (3 * np.pi) * (np.sin(alpha) + (np.pi - alpha) * np.cos(alpha))
    off = np.abs(division.unshadowed(panels, {"side": WHITE}, sun, obs) - right).max() / right.max()
    assert off <= error <= tolerance
    assert off > 1e-3 * error


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_a_lambert_cylinder_in_closed_form(tolerance):
    """f = r L/π sin θ₀ sin θ ½ [sin δ + (π − δ) cos δ], δ the difference of azimuths."""
    rng = np.random.default_rng(9)
    v = rng.standard_normal((2, 500, 3))
    sun, obs = v / np.linalg.norm(v, axis=-1, keepdims=True)
    surfaces = {"side": WHITE, "end": ("lambertian", {"r_diff": 0.0})}
    panels, error = division.divide(partial(primitives.cylinder, 0.8, 3.0), surfaces, tolerance)
    s, o = np.hypot(*sun.T[:2]), np.hypot(*obs.T[:2])
    delta = np.arccos(np.clip(np.sum(sun[:, :2] * obs[:, :2], axis=1) / (s * o), -1, 1))
    right = 0.8 * 3.0 / np.pi * s * o * 0.5 * (np.sin(delta) + (np.pi - delta) * np.cos(delta))
    off = np.abs(division.unshadowed(panels, surfaces, sun, obs) - right).max() / right.max()
    assert off <= error <= tolerance
    assert off > 1e-3 * error


@pytest.mark.parametrize("law", [WHITE, GLOSSY], ids=["diffuse", "glossy"])
@pytest.mark.parametrize("kind", [k for k in primitives.KINDS if primitives.KINDS[k].curved])
def test_the_error_holds_against_ten_times_finer_panels(kind, law):
    surfaces = {str(side): (law[0], law[1]) for side in primitives.KINDS[kind].sides}
    shape = partial(primitives.KINDS[kind].make, *SIZES[kind])
    panels, error = division.divide(shape, surfaces, 5e-3)
    used = next(
        n for n in (16, 24, 32, 48, 64, 96, 128, 192) if len(shape(n).areas) == len(panels.areas)
    )
    v = np.random.default_rng(10).standard_normal((2, 400, 3))
    v[1, ::2] += v[0, ::2]
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    known = np.sum(v[0] * v[1], axis=1) > np.cos(np.deg2rad(division.PHASE_DEG))
    sun, obs = v[:, known]
    finer = 10 if kind in ("cylinder", "cone", "frustum") else 4  # of 16 times as many panels
    right = division.unshadowed(shape(finer * used), surfaces, sun, obs)
    off = np.abs(division.unshadowed(panels, surfaces, sun, obs) - right).max() / right.max()
    assert off <= error <= 5e-3


def test_a_mirror_is_too_glossy_for_panels():
    mirror = ("ashikhmin-shirley", {"r_diff": 0.0, "r_spec": 0.9, "nu": 1e6, "nv": 1e6})
    with pytest.raises(division.TooManyPanels, match="panels leave an error of"):
        division.divide(partial(primitives.sphere, 1.0), {"side": mirror})


def test_rotations_take_z_to_a_direction():
    rng = np.random.default_rng(11)
    for direction in [*rng.standard_normal((20, 3)), [0, 0, 2.0], [0, 0, -3.0]]:
        turn = rotation_to(direction, 30.0)
        unit = np.array(direction) / np.linalg.norm(direction)
        np.testing.assert_allclose(turn @ [0, 0, 1], unit, atol=1e-12)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    # x first: z goes to −y; then y leaves it; then z takes −y to x
    np.testing.assert_allclose(rotation_by([90, 0, 0]) @ [0, 0, 1], [0, -1, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_by([90, 0, 90]) @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_by([0, 90, 0]) @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(rotation_to([0, 0, 1], 90.0) @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_a_part_is_where_it_is_put():
    turn = rotation_to([1.0, 0.0, 0.0])
    panels = primitives.moved(primitives.cone(1.0, 2.0, 24), turn, np.array([0, 5.0, 0]))
    corners = np.concatenate(panels.polygons)
    assert corners[:, 0].min() == pytest.approx(0.0)
    assert corners[:, 0].max() == pytest.approx(2.0)
    assert corners[:, 1].mean() == pytest.approx(5.0, abs=0.1)
    part = Part("cone", {"radius": 1.0, "length": 2.0}, (0.0, 5.0, 0.0), turn, panels, 0.0)
    body = Assembly((part, part)).body
    assert body.areas.sum() == pytest.approx(2 * np.pi * (1 + np.hypot(1, 2)))
    assert body.labels.count("end") == 2
    np.testing.assert_allclose(body.normals[body.labels.index("end")], [-1, 0, 0], atol=1e-15)
