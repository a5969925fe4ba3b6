import itertools

import numpy as np
import pytest
from results_folders import fibonacci

from lcbayes.errors import InputError
from lcbayes.shape import close, closure, minkowski


def polygon_area(points: np.ndarray) -> float:
    return 0.5 * float(
        np.linalg.norm(np.sum(np.cross(points, np.roll(points, -1, axis=0)), axis=0))
    )


def ellipsoid(normals: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Area of surface per solid angle of normals: the inverse Gaussian curvature."""
    return np.prod(axes) ** 2 / np.linalg.norm(normals * axes, axis=1) ** 4


def test_box_of_known_areas_has_known_edges():
    normals = np.vstack([np.eye(3), -np.eye(3)])
    body = minkowski(normals, np.array([6.0, 3.0, 2.0] * 2))
    assert np.ptp(body.vertices, axis=0) == pytest.approx([1.0, 2.0, 3.0], rel=1e-6)
    assert body.volume == pytest.approx(6.0, rel=1e-6)
    assert len(body.vertices) == 8
    assert [len(f) for f in body.faces] == [4] * 6


def test_regular_tetrahedron():
    normals = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3)
    edge = 2.0
    body = minkowski(normals, np.full(4, np.sqrt(3) / 4 * edge**2))
    pairs = itertools.combinations(body.vertices, 2)
    assert [np.linalg.norm(a - b) for a, b in pairs] == pytest.approx([edge] * 6, rel=1e-6)


@pytest.mark.parametrize("spread", [0.0, 0.5, 1.5])
def test_faces_have_the_areas_and_normals_asked_for(spread):
    normals = fibonacci(120)
    rng = np.random.default_rng(3)
    raw = ellipsoid(normals, np.array([1.6, 1.0, 0.7])) * np.exp(spread * rng.normal(size=120))
    areas = close(normals, raw)
    assert closure(normals, areas) < 1e-12
    assert (areas > 0).all()
    body = minkowski(normals, areas)
    large = areas > 1e-3 * areas.mean()
    assert body.areas[large] == pytest.approx(areas[large], rel=1e-3)
    # the faces themselves, from their corners: areas, and outward and anti-clockwise
    for face, facet in zip(body.faces, body.facet, strict=True):
        points = body.vertices[face]
        assert polygon_area(points) == pytest.approx(body.areas[facet], rel=1e-6, abs=1e-9)
        across = np.cross(points[1] - points[0], points[2] - points[1])
        assert across @ normals[facet] > 0
        assert points.mean(axis=0) @ normals[facet] > 0


def test_grid_of_an_ellipsoid_gives_back_its_volume():
    axes = np.array([1.5, 1.1, 0.9])
    normals = fibonacci(400)
    areas = ellipsoid(normals, axes) * 4 * np.pi / 400
    body = minkowski(normals, close(normals, areas))
    assert body.volume == pytest.approx(4 / 3 * np.pi * np.prod(axes), rel=0.02)
    assert np.ptp(body.vertices, axis=0) == pytest.approx(2 * axes, rel=0.05)


def test_facets_that_do_not_close_are_refused():
    with pytest.raises(InputError, match=r"do not close.*= 0\.33"):
        minkowski(np.vstack([np.eye(3), -np.eye(3)]), np.array([1.0, 1, 2, 1, 1, 0]))


def test_negative_areas_are_refused():
    with pytest.raises(InputError, match="negative"):
        minkowski(np.vstack([np.eye(3), -np.eye(3)]), np.array([1.0, 1, -1, 1, 1, -1]))


def test_facets_in_a_plane_are_refused():
    turn = np.linspace(0, 2 * np.pi, 5, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    with pytest.raises(InputError, match="one plane"):
        minkowski(ring, np.ones(5))


def test_obj_text_lists_vertices_and_faces():
    body = minkowski(np.vstack([np.eye(3), -np.eye(3)]), np.ones(6))
    text = body.obj("one\ntwo")
    lines = text.splitlines()
    assert lines[:2] == ["# one", "# two"]
    assert sum(x.startswith("v ") for x in lines) == 8
    corners = [int(i) for x in lines if x.startswith("f ") for i in x.split()[1:]]
    assert sorted(corners) == sorted(list(range(1, 9)) * 3)
