import itertools

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial import ConvexHull, KDTree

from lcbayes.core.errors import InputError
from lcbayes.physics.bodies import mesh, shapes
from lcbayes.physics.bodies.closure import close, closure
from lcbayes.physics.bodies.minkowski import minkowski
from tests.helpers.results_folders import fibonacci


def polygon_area(points: np.ndarray) -> float:
    return 0.5 * float(
        np.linalg.norm(np.sum(np.cross(points, np.roll(points, -1, axis=0)), axis=0))
    )


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


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
    body = minkowski(normals, areas)
    assert body.areas == pytest.approx(areas, rel=1e-8, abs=1e-7 * areas.mean())
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


GOLD = (1 + 5**0.5) / 2
SOLIDS = {
    # normals (of any length), edge of the solid with unit area per facet, its volume for edge 1
    "octahedron": (list(itertools.product([-1, 1], repeat=3)), 3**0.5 / 4, 2**0.5 / 3),
    "dodecahedron": (
        [np.roll([0, a, b * GOLD], k) for a, b, k in itertools.product([-1, 1], [-1, 1], range(3))],
        (25 + 10 * 5**0.5) ** 0.5 / 4,
        (15 + 7 * 5**0.5) / 4,
    ),
    "icosahedron": (
        [
            *itertools.product([-1, 1], repeat=3),
            *(
                np.roll([0, a / GOLD, b * GOLD], k)
                for a, b, k in itertools.product([-1, 1], [-1, 1], range(3))
            ),
        ],
        3**0.5 / 4,
        5 * (3 + 5**0.5) / 12,
    ),
}


@pytest.mark.parametrize("solid", SOLIDS)
def test_regular_solids_have_their_volume(solid):
    raw, face, volume = SOLIDS[solid]
    normals = unit(np.array(raw, float))
    body = minkowski(normals, np.ones(len(normals)))
    assert body.volume == pytest.approx(volume * face**-1.5, rel=1e-10)
    assert len({len(f) for f in body.faces}) == 1  # several facets meet in each vertex


def test_prism_that_stands_for_a_cylinder():
    n, radius, length = 300, 0.7, 2.5
    cylinder = shapes.cylinder(radius, length, n)
    body = minkowski(cylinder.normals, cylinder.areas)
    assert body.volume == pytest.approx(np.pi * radius**2 * length, rel=1e-4)
    assert body.dimensions == pytest.approx([length, 2 * radius, 2 * radius], rel=1e-3)
    moments = [radius**2 / 2, radius**2 / 4 + length**2 / 12, radius**2 / 4 + length**2 / 12]
    assert body.principal[0] == pytest.approx(moments, rel=1e-3)
    assert abs(body.principal[1][0, 2]) == pytest.approx(1.0)
    assert "property list int int" in body.ply()  # 300 corners do not fit into a byte


def polytope(seed: int, n: int) -> tuple[np.ndarray, np.ndarray, ConvexHull]:
    """Normals and areas of {x: n·x ≤ h} for random planes, and the hull of its vertices.

    Qhull and elementary geometry alone; planes that miss the body are left out.
    """
    rng = np.random.default_rng(seed)
    bounded = False
    while not bounded:
        normals, h = unit(rng.normal(size=(n, 3))), rng.uniform(0.9, 1.1, n)
        dual = ConvexHull(normals / h[:, None])
        bounded = bool(np.all(dual.equations[:, 3] < -0.05))
    corners = np.array([np.linalg.solve(normals[s], h[s]) for s in dual.simplices])
    met = dual.vertices
    areas = [
        ConvexHull(in_plane(normals[i], corners[np.any(dual.simplices == i, axis=1)])).volume
        for i in met
    ]
    return normals[met], np.array(areas), ConvexHull(corners)


def in_plane(normal: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Two coordinates in the plane with this normal."""
    return points @ np.linalg.svd(normal[None])[2][1:].T


@pytest.mark.parametrize(("seed", "n"), [(0, 5), (1, 8), (2, 20), (3, 60), (4, 200)])
def test_a_polytope_comes_back_from_its_areas(seed, n):
    normals, areas, hull = polytope(seed, n)
    body = minkowski(normals, areas)
    assert body.areas == pytest.approx(areas, rel=1e-9)
    assert body.volume == pytest.approx(hull.volume, rel=1e-10)
    # its vertices, one by one, about its own centroid
    simplices = hull.points[hull.simplices]
    origin = hull.points.mean(axis=0)
    weights = np.abs(np.linalg.det(simplices - origin))
    centroid = origin + weights @ (simplices - origin).sum(axis=1) / 4 / weights.sum()
    off, _ = KDTree(body.vertices).query(hull.points - centroid)
    assert off.max() < 1e-7
    assert len(body.vertices) == len(hull.vertices)


def test_a_plate_is_as_easy_as_a_cube():
    plate = shapes.box(100.0, 1.0, 0.01)
    body = minkowski(plate.normals, plate.areas)
    assert body.dimensions == pytest.approx([100.0, 1.0, 0.01], rel=1e-9)
    assert body.volume == pytest.approx(1.0, rel=1e-9)


def test_affine_maps_of_a_body_are_found():
    # x → M x turns area vectors by the cofactor of M: rotation or reflection, size, shear
    normals, areas, _ = polytope(5, 40)
    body = minkowski(normals, areas)
    for matrix in (
        np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0],
        3.7 * np.eye(3),
        np.array([[2.0, 0.3, 0.0], [0.0, 0.5, -0.4], [0.1, 0.0, 1.0]]),
    ):
        cofactor = abs(np.linalg.det(matrix)) * np.linalg.inv(matrix).T
        vectors = (normals * areas[:, None]) @ cofactor.T
        length = np.linalg.norm(vectors, axis=1)
        mapped = minkowski(vectors / length[:, None], length)
        off, _ = KDTree(mapped.vertices).query(body.vertices @ matrix.T)
        assert off.max() < 1e-8
        assert mapped.volume == pytest.approx(abs(np.linalg.det(matrix)) * body.volume, rel=1e-9)


@pytest.mark.parametrize("spread", [0.0, 2.0])
def test_five_hundred_facets(spread):
    normals = fibonacci(512)
    raw = np.exp(spread * np.random.default_rng(0).normal(size=512))
    areas = close(normals, raw)
    assert (areas > 0).all()
    body = minkowski(normals, areas)
    assert body.areas == pytest.approx(areas, rel=1e-8)


def test_facets_that_face_alike_share_a_face():
    normals = np.vstack([np.eye(3), -np.eye(3), [[1.0, 0, 0]]])
    body = minkowski(normals, np.array([1.0, 2, 2, 4, 2, 2, 3]))
    assert body.areas == pytest.approx([1, 2, 2, 4, 2, 2, 3], rel=1e-10)
    assert len(body.faces) == 6
    assert body.volume == pytest.approx(4.0)  # 1 × 2 × 2, its ends 2 × 2


def test_facets_of_no_area_have_no_face():
    normals = np.vstack([np.eye(3), -np.eye(3), unit(np.ones((1, 3)))])
    body = minkowski(normals, np.array([1.0, 1, 1, 1, 1, 1, 0]))
    assert 6 not in body.facet
    assert body.areas == pytest.approx([1, 1, 1, 1, 1, 1, 0], rel=1e-10)


def test_nearest_closed_areas_are_those_of_a_general_solver():
    rng = np.random.default_rng(4)
    for _ in range(5):
        normals = unit(rng.normal(size=(12, 3)))
        raw = rng.exponential(size=12) ** 2
        areas = close(normals, raw)
        assert closure(normals, areas) < 1e-12
        assert (areas >= 0).all()
        result = minimize(
            lambda a, raw=raw: np.sum((a - raw) ** 2 / raw),
            raw,
            jac=lambda a, raw=raw: 2 * (a - raw) / raw,
            bounds=[(0, None)] * 12,
            constraints={"type": "eq", "fun": lambda a, n=normals: a @ n},
            method="SLSQP",
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert areas == pytest.approx(result.x, abs=1e-5)


def test_closed_areas_are_left_alone():
    normals, areas, _ = polytope(6, 30)
    assert close(normals, areas) == pytest.approx(areas, rel=1e-12)


def test_facets_to_one_side_cannot_be_closed():
    normals = unit(np.array([[1.0, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]]))
    with pytest.raises(InputError, match="all face to one side"):
        close(normals, np.ones(4))


def test_moments_of_a_brick():
    body = minkowski(*shapes.box(3.0, 2.0, 1.0)[:2])
    moments, axes = body.principal
    assert moments == pytest.approx([5 / 12, 10 / 12, 13 / 12], rel=1e-10)
    assert np.abs(axes) == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert body.dimensions == pytest.approx([3.0, 2.0, 1.0], rel=1e-10)


def test_moments_against_points_in_the_body():
    normals, areas, _ = polytope(7, 15)
    body = minkowski(normals, areas)
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (400_000, 3)) * np.abs(body.vertices).max()
    inside = np.ones(len(points), bool)
    for face, facet in zip(body.faces, body.facet, strict=True):
        inside &= points @ normals[facet] <= body.vertices[face[0]] @ normals[facet]
    x = points[inside]
    assert np.linalg.norm(x.mean(axis=0)) < 0.01
    second = x.T @ x / len(x)
    assert body.inertia == pytest.approx(np.trace(second) * np.eye(3) - second, abs=0.01)


@pytest.mark.parametrize(
    ("normals", "areas", "message"),
    [
        (np.eye(3), np.ones(2), r"normals \(3, 3\) and areas \(2,\)"),
        (2 * np.eye(3), np.ones(3), "not of unit length"),
        (np.eye(3), np.array([1, np.nan, 1]), "not finite"),
        (np.eye(3), np.zeros(3), "no facet has an area"),
    ],
)
def test_faults_are_said_in_words(normals, areas, message):
    with pytest.raises(InputError, match=message):
        minkowski(normals, areas)


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


def test_ply_text_has_its_header_and_the_same_faces():
    body = minkowski(*shapes.box(3.0, 2.0, 1.0)[:2])
    head, _, rest = body.ply("one").partition("end_header\n")
    assert head.startswith("ply\nformat ascii 1.0\ncomment one\nelement vertex 8\n")
    assert "element face 6\nproperty list uchar int vertex_indices\n" in head
    lines = rest.splitlines()
    assert np.loadtxt(lines[:8]) == pytest.approx(body.vertices, rel=1e-8)
    assert [[int(x) for x in line.split()[1:]] for line in lines[8:]] == [
        list(f) for f in body.faces
    ]


def test_files_are_read_as_the_same_body(tmp_path):
    normals, areas, _ = polytope(8, 25)
    (tmp_path / "body.obj").write_text(minkowski(normals, areas).obj())
    back = mesh.read_body(tmp_path / "body.obj")
    assert np.sort(back.areas) == pytest.approx(np.sort(areas), rel=1e-6)
