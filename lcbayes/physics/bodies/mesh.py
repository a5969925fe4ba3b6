"""Bodies from drawings: polygons of Wavefront OBJ and STL files, and how both are written.

An OBJ file names what its faces are part of (``usemtl``, or else ``g`` or ``o``); an STL file does
where it is text, by ``solid NAME``. Faces go round counter-clockwise seen from outside. Both
formats are without a unit; a scale makes metres of their numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile, printable, read_text
from lcbayes.physics.bodies.primitives import Panels, flat
from lcbayes.physics.bodies.shapes import LARGEST_M, Body
from lcbayes.physics.bodies.solids import flat_solid, vector_area

Floats = NDArray[np.float64]

SMALLEST_PLANAR_AREA, SMALLEST_AREA = 1e-9, 1e-12  # of a face, over its extent squared
PLANAR = 1e-4  # how far a vertex may lie off its face's plane, over the face's extent
MOST_FACES = 200_000
_FACET = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
_STL_HEADER = 80  # bytes

type Face = tuple[Floats, str, str]  # polygon, label, where it stands in the file


def read_mesh(path: str | Path, scale: float = 1.0) -> Panels:
    """The faces of an OBJ or STL file (by its ending), each of which shades the others.

    Parameters
    ----------
    path : file.obj or file.stl
    scale : float
        Metres for each unit of the file.

    Returns
    -------
    Panels
        `sides` are the labels of the faces.

    Raises
    ------
    InputError
        One line with the file and the line or number of the face at fault: a face without area,
        not planar or not convex, or a number that is not finite.
    """
    faces = _faces(path)
    for polygon, _, where in faces:
        check_polygon(polygon, where)
    polygons = [scale * polygon for polygon, _, _ in faces]
    made = flat(polygons, tuple(label for _, label, _ in faces))
    return made._replace(solids=[flat_solid(p) for p in polygons], convex=False)


def read_body(path: str | Path) -> Body:
    """The faces of an OBJ or STL file as facets that do not shade each other; lengths in m.

    Faces need not be planar or convex: only their area vectors count.

    Raises
    ------
    InputError
        One line with the file and the line or number of the face at fault.
    """
    faces = _faces(path)
    for polygon, _, where in faces:
        _check_area(polygon, where, SMALLEST_AREA)
    made = flat([polygon for polygon, _, _ in faces], tuple(label for _, label, _ in faces))
    return Body(made.normals, made.areas, made.u_axes, made.sides)


def _faces(path: str | Path) -> list[Face]:
    """The faces of an OBJ or STL file; at least one."""
    name = Path(path).suffix.lower()
    if name == ".obj":
        faces = list(_obj(read_text(path)))
    elif name == ".stl":
        faces = list(_stl(Path(path)))
    else:
        raise InputError(f"{printable(path)} is neither .obj nor .stl; convert it to one of them")
    if not faces:
        raise InputError(f"{printable(path)} has no faces; give a mesh with at least one")
    if len(faces) > MOST_FACES:
        raise InputError(
            f"{printable(path)} has {len(faces):,} faces, more than {MOST_FACES:,}; decimate it"
        )
    return faces


def check_polygon(polygon: Floats, where: str) -> None:
    """Refuse a polygon (k, 3) that has no area, is not planar or is not convex."""
    unit = _check_area(polygon, where, SMALLEST_PLANAR_AREA)
    extent = float(np.ptp(polygon, axis=0).max())
    off = float(np.abs((polygon - polygon.mean(axis=0)) @ unit).max()) / extent
    if off > PLANAR:
        raise InputError(
            f"{where}: the face is not planar (a vertex lies {off:.1e} of its extent off its "
            "plane); divide it into triangles"
        )
    edges = np.roll(polygon, -1, axis=0) - polygon
    turn = np.cross(np.roll(edges, 1, axis=0), edges) @ unit
    if turn.min() < -1e-9 * extent**2 or turn.max() <= 0.0:
        raise InputError(f"{where}: the face is not convex; divide it into triangles")


def _check_area(polygon: Floats, where: str, least: float) -> Floats:
    """The unit normal (3,) of a polygon whose area exceeds ``least`` times its extent squared."""
    vector = vector_area(polygon)
    area = float(np.linalg.norm(vector))
    if not area > least * float(np.ptp(polygon, axis=0).max()) ** 2:
        raise InputError(f"{where}: the face has no area; remove it or correct its vertices")
    return vector / area


def _obj(file: TextFile) -> Iterator[Face]:
    vertices: list[list[float]] = []
    group, material = "body", ""
    for number, line in enumerate(file.text.split("\n"), 1):
        where = file.at(number)
        match line.split("#", 1)[0].split():
            case ["v", *words]:
                vertices.append(_numbers(words[:3], where))
            case ["g" | "o", *words]:
                group = " ".join(words) or "body"
            case ["usemtl", *words]:
                material = " ".join(words)
            case ["f", *words]:
                yield _corners(words, vertices, where), material or group, where


def _corners(words: Sequence[str], vertices: list[list[float]], where: str) -> Floats:
    """The corners of a face of an OBJ file, (k, 3)."""
    if len(words) < 3:
        raise InputError(f"{where}: the face has {len(words)} vertices; give three or more")
    return np.array([vertices[_index(word, len(vertices), where)] for word in words])


def _numbers(words: Sequence[str], where: str) -> list[float]:
    try:
        xyz = [float(word) for word in words]
    except ValueError:
        xyz = []
    if len(xyz) != 3 or not np.all(np.abs(xyz) <= LARGEST_M):
        raise InputError(
            f"{where}: vertex {' '.join(words)[:80]!r} is not three finite numbers of at most "
            f"{LARGEST_M:g}"
        )
    return xyz


def _index(word: str, count: int, where: str) -> int:
    """From 0; OBJ counts from 1, or backwards from the last vertex with negatives."""
    try:
        i = int(word.split("/")[0])
    except ValueError:
        i = 0
    if i == 0 or not -count <= i <= count:
        raise InputError(
            f"{where}: the face names vertex {word[:80]!r}, but {count} vertices stand above it; "
            "indices count from 1"
        )
    return i - 1 if i > 0 else count + i


def _stl(path: Path) -> Iterator[Face]:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{printable(path)} does not exist; check the path") from None
    except OSError as fault:
        raise InputError(f"{printable(path)} cannot be read ({fault.strerror})") from None
    name = printable(path)
    start = _STL_HEADER + 4
    count = int.from_bytes(data[_STL_HEADER:start], "little") if len(data) >= start else -1
    if len(data) == start + count * _FACET.itemsize:
        facets = np.frombuffer(data, _FACET, count, start)
        for i, corners in enumerate(facets["vertices"].astype(float), 1):
            if not np.all(np.abs(corners) <= LARGEST_M):
                raise InputError(f"{name}, facet {i}: a vertex is not finite or over {LARGEST_M:g}")
            yield corners, "body", f"{name}, facet {i}"
    elif data.lstrip()[:5].lower() == b"solid":
        yield from _stl_text(read_text(path))
    else:
        raise InputError(
            f"{name} is not an STL file: it has {len(data):,} bytes, not those of the {count:,} "
            "facets that its header counts, and does not begin with 'solid'"
        )


def _stl_text(file: TextFile) -> Iterator[Face]:
    label, corners, begin = "body", [], 0
    for number, line in enumerate(file.text.split("\n"), 1):
        word, *rest = line.split() or [""]
        match word.lower():
            case "solid":
                label = " ".join(rest) or "body"
            case "facet":
                corners, begin = [], number
            case "vertex":
                corners.append(_numbers(rest, file.at(number)))
            case "endfacet":
                yield _triangle(corners, file.at(begin)), label, file.at(begin)


def _triangle(corners: list[list[float]], where: str) -> Floats:
    if len(corners) != 3:
        raise InputError(f"{where}: the facet has {len(corners)} vertices; an STL facet has 3")
    return np.array(corners)


def to_obj(polygons: Sequence[Floats], labels: Sequence[str]) -> str:
    """Wavefront OBJ text, the labels as ``usemtl``."""
    lines, count, last = [], 0, None
    for polygon, label in zip(polygons, labels, strict=True):
        if label != last:
            lines.append(f"usemtl {label}")
            last = label
        lines += [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in polygon]
        lines.append("f " + " ".join(str(count + i + 1) for i in range(len(polygon))))
        count += len(polygon)
    return "\n".join(lines) + "\n"


def to_stl(polygons: Sequence[Floats], header: str = "") -> bytes:
    """Binary STL, single precision; polygons of more than three vertices as fans of triangles.

    ``header`` is ASCII text of at most 80 bytes; it may not begin with "solid".
    """
    corners = triangles(polygons)[0]
    facets = np.zeros(len(corners), _FACET)
    vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facets["normal"] = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    facets["vertices"] = corners
    start = header.encode("ascii").ljust(_STL_HEADER, b"\0")
    if len(start) > _STL_HEADER or start.startswith(b"solid"):
        raise ValueError(f"{header!r} cannot be the header of a binary STL file")
    return start + len(facets).to_bytes(4, "little") + facets.tobytes()


def triangles(polygons: Sequence[Floats]) -> tuple[Floats, NDArray[np.integer]]:
    """Fans of triangles of convex polygons, (F, 3, 3), and the polygon each is from, (F,)."""
    corners, source = [], []
    for i, polygon in enumerate(polygons):
        for k in range(1, len(polygon) - 1):
            corners.append(polygon[[0, k, k + 1]])
            source.append(i)
    return np.array(corners).reshape(-1, 3, 3), np.array(source, int)
