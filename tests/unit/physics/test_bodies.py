"""Built-in bodies, OBJ files, grids and harmonics on the sphere."""

import numpy as np
import pytest
import scipy.special

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies import facets, mesh, shapes
from lcbayes.physics.bodies.closure import closure

CUBE = """# a unit cube
o box
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
vn 0 0 1
f 1 4 3 2
f 5 6 7 8
usemtl panel
f 1/1 2/1 6/1 5/1
f 2//1 3//1 7//1 6//1
g other
f -6 -5 -1 -2
f 4 1 5 8 # the last
"""


@pytest.mark.parametrize("name", list(shapes.SHAPES))
def test_bodies_close_and_are_well_formed(name):
    b = shapes.shape(name)
    n = len(b.areas)
    assert b.normals.shape == b.u_axes.shape == (n, 3)
    assert len(b.labels) == n
    assert np.all(b.areas > 0.0)
    np.testing.assert_allclose(np.linalg.norm(b.normals, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(b.u_axes, axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(np.sum(b.normals * b.u_axes, axis=1), 0.0, atol=1e-14)
    assert closure(b.normals, b.areas) < 1e-14


def test_areas_are_those_of_the_bodies():
    assert shapes.cube(2.0).areas.sum() == pytest.approx(24.0)
    assert shapes.tetrahedron(2.0).areas.sum() == pytest.approx(np.sqrt(3.0) * 4.0)
    assert shapes.cylinder(0.5, 2.0).areas.sum() == pytest.approx(2 * np.pi * 0.5 * 2.5)
    assert shapes.sphere(0.5, 300).areas.sum() == pytest.approx(np.pi)
    assert shapes.plate(2.0, 3.0).areas.sum() == pytest.approx(12.0)
    wing = shapes.box_wing((1.0, 2.0, 3.0), (4.0, 0.5), cant_deg=30.0)
    assert wing.areas.sum() == pytest.approx(22.0 + 4.0)
    np.testing.assert_allclose(
        wing.normals[wing.labels.index("panel")], [np.sqrt(0.75), 0, -0.5], atol=1e-15
    )
    assert closure(np.eye(3), np.ones(3)) == pytest.approx(np.sqrt(3) / 3)


def test_sphere_areas_stay_nearly_equal():
    areas = shapes.sphere(1.0, 200).areas
    assert np.ptp(areas) < 0.02 * areas.mean()


def test_unknown_shape_or_size():
    with pytest.raises(InputError, match="unknown shape 'cone'; available: cube, tetrahedron"):
        shapes.shape("cone")
    with pytest.raises(InputError, match="shape 'cube' cannot be made with"):
        shapes.shape("cube", radius=1.0)


def test_reads_obj_with_polygons_negative_indices_and_materials(tmp_path):
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    b = mesh.read_body(path)
    np.testing.assert_allclose(b.areas, 1.0)
    np.testing.assert_allclose(
        b.normals, [[0, 0, -1], [0, 0, 1], [0, -1, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0]], atol=1e-15
    )
    assert b.labels == ("box", "box", "panel", "panel", "panel", "panel")
    assert closure(b.normals, b.areas) < 1e-15


def test_facets_of_an_obj_file_by_hand(tmp_path):
    rng = np.random.default_rng(1)
    vertices = rng.normal(size=(5, 3))
    path = tmp_path / "body.obj"
    points = ["v " + " ".join(map(repr, v)) for v in vertices.tolist()]
    path.write_text("\n".join([*points, "f 1 2 3", "f 1 3 4 5", ""]))
    first = mesh.read_body(path)
    cross = np.cross(vertices[1] - vertices[0], vertices[2] - vertices[0])
    assert first.areas[0] == pytest.approx(np.linalg.norm(cross) / 2, rel=1e-14)
    np.testing.assert_allclose(first.normals[0], cross / np.linalg.norm(cross), atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0\n", "line 1: vertex '0 0' is not three finite numbers"),
        ("v 0 0 x\n", "line 1: vertex '0 0 x'"),
        ("v 0 0 nan\n", "line 1: vertex '0 0 nan'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4: the face names vertex '4', but 3"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "line 4: the face names vertex '0'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 a\n", "line 4: the face names vertex 'a'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n", "line 4: the face has 2 vertices"),
        ("v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "line 4: the face has no area"),
        ("v 0 0 0\n", "has no faces"),
        ("", "is empty"),
        ("v 0 0 0\nv 1e200 0 0\nv 0 1e200 0\nf 1 2 3\n", "line 2: vertex '1e200 0 0' is not"),
    ],
)
def test_damaged_obj_names_the_line(tmp_path, text, message):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        mesh.read_body(path)
    assert "bad.obj" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_obj(tmp_path):
    with pytest.raises(InputError, match=r"none\.obj does not exist"):
        mesh.read_body(tmp_path / "none.obj")


def test_normal_and_angles_are_inverse():
    phi, g = jnp.array([0.0, 1.0, 3.0, 6.2]), jnp.array([-0.9, 0.0, 0.5, 0.99])
    n = facets.normal(phi, g)
    np.testing.assert_allclose(jnp.linalg.norm(n, axis=1), 1.0, atol=1e-15)
    back_phi, back_g = facets.angles(n)
    np.testing.assert_allclose(back_phi, phi, atol=1e-14)
    np.testing.assert_allclose(back_g, g, atol=1e-15)
    np.testing.assert_allclose(facets.normal(jnp.float64(0.3), jnp.float64(1.0)), [0, 0, 1])
    for pole in (1.0, -1.0, 0.0):
        slopes = jax.jacrev(facets.normal, (0, 1))(jnp.float64(0.3), jnp.float64(pole))
        assert all(np.all(np.isfinite(s)) for s in slopes)


def test_sphere_grid_is_even():
    n = facets.grid(500)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=1e-14)
    nearest = np.sort(np.arccos(np.clip(n @ n.T, -1, 1)) + 9 * np.eye(500), axis=1)[:, 0]
    assert nearest.min() > 0.8 * np.sqrt(4 * np.pi / 500)
    # as a quadrature: second moments of the sphere
    np.testing.assert_allclose(n.T @ n / 500, np.eye(3) / 3, atol=2e-4)


def test_harmonics_are_orthonormal():
    """Gauss-Legendre in cos θ and equal steps in φ integrate products up to degree 16 exactly."""
    mu, w = np.polynomial.legendre.leggauss(10)
    phi = 2 * np.pi * np.arange(20) / 20
    z, p = (a.ravel() for a in np.meshgrid(mu, phi, indexing="ij"))
    s = np.sqrt(1 - z**2)
    y = facets.spherical_harmonics(np.stack([s * np.cos(p), s * np.sin(p), z], axis=1), 8)
    weight = np.repeat(w, 20) * 2 * np.pi / 20
    np.testing.assert_allclose((y.T * weight) @ y, np.eye(81), atol=1e-12)


def test_harmonics_agree_with_scipy():
    rng = np.random.default_rng(2)
    v = rng.normal(size=(20, 3))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    theta, phi = np.arccos(v[:, 2]), np.arctan2(v[:, 1], v[:, 0])
    y = facets.spherical_harmonics(v, 6)
    for degree in range(7):
        for m in range(degree + 1):
            complex_y = (-1) ** m * scipy.special.sph_harm_y(degree, m, theta, phi)
            centre, root = degree**2 + degree, np.sqrt(2.0) if m else 1.0
            np.testing.assert_allclose(y[:, centre + m], root * complex_y.real, atol=1e-13)
            if m:
                np.testing.assert_allclose(y[:, centre - m], root * complex_y.imag, atol=1e-13)


def test_harmonics_at_the_poles_and_by_hand():
    y = facets.spherical_harmonics([[0, 0, 1], [1, 0, 0]], 1)
    unit0, unit1 = np.sqrt(1 / (4 * np.pi)), np.sqrt(3 / (4 * np.pi))
    np.testing.assert_allclose(y, [[unit0, 0, unit1, 0], [unit0, 0, 0, unit1]], atol=1e-15)
