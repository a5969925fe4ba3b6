"""OBJ and STL files: read and written, against own readers; and what is wrong with others."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.physics.bodies import mesh
from lcbayes.physics.bodies.primitives import box, frustum

TETRAHEDRON = """solid {name}
facet normal 0 0 -1
 outer loop
  vertex 0 0 0
  vertex 0 1 0
  vertex 1 0 0
 endloop
endfacet
facet normal 0 -1 0
 outer loop
  vertex 0 0 0
  vertex 1 0 0
  vertex 0 0 1
 endloop
endfacet
facet normal -1 0 0
 outer loop
  vertex 0 0 0
  vertex 0 0 1
  vertex 0 1 0
 endloop
endfacet
facet normal 1 1 1
 outer loop
  vertex 1 0 0
  vertex 0 1 0
  vertex 0 0 1
 endloop
endfacet
endsolid
"""
SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 {z}\n"


def own_obj(text: str) -> list[tuple[str, np.ndarray]]:
    """Faces of an OBJ file: label and corners."""
    vertices, result, label = [], [], ""
    for line in text.splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(w) for w in words[1:4]])
        elif words[:1] == ["usemtl"]:
            label = words[1]
        elif words[:1] == ["f"]:
            result.append(
                (label, np.array([vertices[int(w.split("/")[0]) - 1] for w in words[1:]]))
            )
    return result


def own_stl(data: bytes) -> np.ndarray:
    """Normals and corners of a binary STL file, (F, 4, 3)."""
    (count,) = struct.unpack_from("<I", data, 80)
    rows = [struct.unpack_from("<12fH", data, 84 + 50 * i)[:12] for i in range(count)]
    assert len(data) == 84 + 50 * count
    return np.array(rows).reshape(count, 4, 3)


def test_what_is_written_as_obj_is_read_by_others_and_again(tmp_path):
    panels = frustum(1.0, 0.4, 2.0, 12)
    text = mesh.to_obj(panels.polygons, panels.sides)
    for (label, corners), side, polygon in zip(
        own_obj(text), panels.sides, panels.polygons, strict=True
    ):
        assert label == side
        np.testing.assert_array_equal(corners, polygon)
    path = tmp_path / "frustum.obj"
    path.write_text(text)
    again = mesh.read_mesh(path)
    assert again.sides == panels.sides
    for mine, theirs in zip(again.polygons, panels.polygons, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert not again.convex
    assert len(again.solids) == len(panels.polygons)


def test_what_is_written_as_stl_is_read_by_others_and_again(tmp_path):
    panels = box(1.0, 2.0, 3.0)
    data = mesh.to_stl(panels.polygons)
    seen = own_stl(data)
    assert len(seen) == 12
    vectors = 0.5 * np.cross(seen[:, 2] - seen[:, 1], seen[:, 3] - seen[:, 1])
    np.testing.assert_allclose(
        vectors / np.linalg.norm(vectors, axis=1)[:, None], seen[:, 0], atol=1e-6
    )
    assert np.linalg.norm(vectors, axis=1).sum() == pytest.approx(22.0)
    path = tmp_path / "box.STL"
    path.write_bytes(data)
    again = mesh.read_mesh(path, scale=0.5)
    assert again.areas.sum() == pytest.approx(22.0 / 4)
    np.testing.assert_allclose(np.array(again.polygons), 0.5 * seen[:, 1:], atol=1e-12)


def test_text_stl_and_its_solids(tmp_path):
    path = tmp_path / "t.stl"
    path.write_text(TETRAHEDRON.format(name="tank") + TETRAHEDRON.format(name=""))
    panels = mesh.read_mesh(path)
    assert panels.sides == ("tank",) * 4 + ("body",) * 4
    np.testing.assert_allclose(
        panels.normals[:4], [[0, 0, -1], [0, -1, 0], [-1, 0, 0], 3 * [3**-0.5]], atol=1e-12
    )
    np.testing.assert_allclose(panels.areas[:4], [0.5, 0.5, 0.5, np.sqrt(3) / 2])


def test_groups_and_materials_of_an_obj_file(tmp_path):
    path = tmp_path / "g.obj"
    path.write_text(
        SQUARE.format(z=0) + "g bus\nf 1 2 3 4\nusemtl panel\nf 1/5 2/6 3/7\nf -4//1 -3//1 -1//1\n"
    )
    panels = mesh.read_mesh(path)
    assert panels.sides == ("bus", "panel", "panel")
    np.testing.assert_allclose(panels.areas, [1.0, 0.5, 0.5])


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (SQUARE.format(z=0.1) + "f 1 2 3 4", r"b.obj, line 5: the face is not planar .* triangles"),
        (SQUARE.format(z=0) + "f 1 2 3 5", "b.obj, line 5: the face names vertex '5', but 4"),
        (SQUARE.format(z=0) + "f 1 2", "line 5: the face has 2 vertices; give three"),
        (SQUARE.format(z=0) + "f 1 2 1", "line 5: the face has no area"),
        (SQUARE.format(z=0) + "f 1 3 2 4", "line 5: the face (is not convex|has no area)"),
        (SQUARE.format(z=0) + "v 0.9 0.1 0\nf 1 2 3 5", None),
        (SQUARE.format(z=0) + "v 0.2 0.6 0\nf 1 2 5 4", "line 6: the face is not convex"),
        ("v 0 0 inf\n", "line 1: vertex '0 0 inf' is not three finite numbers"),
        ("v 0 0\n", "line 1: vertex '0 0' is not three finite numbers"),
        ("# nothing\n", "b.obj has no faces"),
    ],
)
def test_faults_of_obj_files(text, fault, tmp_path):
    path = tmp_path / "b.obj"
    path.write_text(text)
    if fault is None:
        text = text.replace("v 0.9 0.1 0", "v 0.5 1.5 0").replace("f 1 2 3 5", "f 1 2 3 5 4")
        path.write_text(text)
        assert len(mesh.read_mesh(path).areas) == 1
        return
    with pytest.raises(InputError, match=fault) as caught:
        mesh.read_mesh(path)
    assert "\n" not in str(caught.value)


def test_faults_of_stl_files(tmp_path):
    path = tmp_path / "b.stl"
    good = mesh.to_stl(box(1, 1, 1).polygons)
    faults = {
        good[:-7]: "is not an STL file: it has 677 bytes, not those of the 12 facets",
        b"\0\1\2": "is not an STL file: it has 3 bytes",
        good[:96] + struct.pack("<f", np.nan) + good[100:]: r"facet 1: a vertex is not finite",
        good[:96] + 36 * b"\0" + good[132:]: r"facet 1: the face has no area",
        b"solid x\nfacet\nvertex 0 0 0\nvertex 0 1 0\nendfacet\n": "line 2: the facet has 2",
        b"solid x\nendsolid\n": "has no faces",
    }
    for data, fault in faults.items():
        path.write_bytes(data)
        with pytest.raises(InputError, match=fault):
            mesh.read_mesh(path)
    with pytest.raises(InputError, match=r"no.stl does not exist"):
        mesh.read_mesh(tmp_path / "no.stl")
    with pytest.raises(InputError, match=r"b.ply is neither .obj nor .stl"):
        mesh.read_mesh(tmp_path / "b.ply")


def test_a_body_is_read_from_obj_and_stl_alike(tmp_path):
    """Without shadows a face may be bent or concave: its area vector counts."""
    polygons = box(2, 1, 3).polygons
    (tmp_path / "b.obj").write_text(mesh.to_obj(polygons, ["side"] * 6))
    (tmp_path / "b.stl").write_bytes(mesh.to_stl(polygons))
    faces, triangles = (mesh.read_body(tmp_path / f"b.{kind}") for kind in ("obj", "stl"))
    np.testing.assert_allclose(faces.areas, triangles.areas.reshape(6, 2).sum(axis=1), rtol=1e-6)
    np.testing.assert_allclose(faces.normals, triangles.normals[::2], atol=1e-6)
    bent = "v 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 0\nf 1 2 3 4\n"
    (tmp_path / "bent.obj").write_text(bent)
    (normal,) = mesh.read_body(tmp_path / "bent.obj").normals
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0.5], [0, 1, 0]])
    vector = np.cross(corners[2] - corners[0], corners[3] - corners[1])
    np.testing.assert_allclose(normal, vector / np.linalg.norm(vector), atol=1e-15)
    with pytest.raises(InputError, match="the face is not planar"):
        mesh.read_mesh(tmp_path / "bent.obj")
