"""Parts of bodies in axes of their own: polygons that reflect, and convex solids that cast shadows.

Flat faces are polygons as they are. Curved faces are divided into panels, `n` of them around the
axis. A panel has the area and the normal that the surface has there (at the panel's middle), so
that the flux of a part converges with 1/n² for any law of reflectance; `division.divide` chooses n.
Its polygon, which matters for shadows alone, is a chord: a ring is drawn as a polygon of the same
area as the circle, r' = r √(x/sin x), x = 2π/n.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.physics.bodies.shapes import plane_axis
from lcbayes.physics.bodies.solids import Solid, flat_solid, vector_area

Floats = NDArray[np.float64]

GOLDEN = (1.0 + np.sqrt(5.0)) / 2.0
CIRCLE_SIDES = (16, 32)  # sides of a round end and of the solid that casts a round part's shadow
STRIPS = 64  # around the axis, each with one shadow, which are enough for `division.TOLERANCE`


class Panels(NamedTuple):
    """A part's surface.

    Attributes
    ----------
    polygons : list of (k, 3) m
        Convex and planar, counter-clockwise seen from outside.
    normals : (N, 3)
        Outward unit normals of the surface.
    areas : (N,) m²
        Areas of the surface, not of the polygons.
    u_axes : (N, 3)
        Unit vectors in each panel's plane: along the longer side of a flat face, along the axis of
        a cylinder, from base to top of a cone.
    sides : (N,)
        "side", "end", "front" or "back": what may have a material of its own.
    solids : list of Solid
        What casts the part's shadow.
    convex : bool
        No panel can shade another one.
    shared : int
        So many neighbouring panels of the round side, which are the first ones, share one shadow.
    """

    polygons: list[Floats]
    normals: Floats
    areas: Floats
    u_axes: Floats
    sides: tuple[str, ...]
    solids: list[Solid]
    convex: bool = True
    shared: int = 1

    def receivers(self) -> tuple[list[Floats], NDArray[np.integer]]:
        """Polygons that shadows fall on, and which of these each panel belongs to, (N,)."""
        m, round_side = self.shared, self.sides.count(self.sides[0])
        strips = round_side // m if m > 1 else 0
        made = []
        for i in range(strips):
            first, last = self.polygons[i * m], self.polygons[i * m + m - 1]
            made.append(np.concatenate([first[:1], last[1:3], first[3:]]))
        rest = self.polygons[strips * m :]
        whose = [np.repeat(np.arange(strips), m), strips + np.arange(len(rest))]
        return made + rest, np.concatenate(whose)


def circle_sides(tolerance: float) -> int:
    """Sides of the polygon that stands for a circle, of `CIRCLE_SIDES`.

    A regular polygon of the circle's area is within (2π/n)²/24 of its radius along the sides.
    """
    fine = (n for n in CIRCLE_SIDES if (2.0 * np.pi / n) ** 2 / 24.0 <= tolerance)
    return next(fine, CIRCLE_SIDES[-1])


def flat(polygons: list[Floats], sides: tuple[str, ...]) -> Panels:
    """Panels that are the polygons themselves, without solids."""
    vectors = np.array([vector_area(p) for p in polygons])
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / areas[:, None]
    return Panels(polygons, normals, areas, _longest_edges(polygons, normals), sides, [])


def _longest_edges(polygons: list[Floats], normals: Floats) -> Floats:
    """A unit vector along the longest edge of each polygon."""
    axes = []
    for polygon, normal in zip(polygons, normals, strict=True):
        edges = np.roll(polygon, -1, axis=0) - polygon
        longest = edges[
            np.argmax(np.linalg.norm(edges, axis=1) * (1 + 1e-9 * -np.arange(len(edges))))
        ]
        longest = longest - normal * (longest @ normal)
        axes.append(longest / np.linalg.norm(longest))
    return np.array(axes)


def box(x: float, y: float, z: float) -> Panels:
    """A box with sides x, y, z, its centre at the origin."""
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], float)
    vertices = signs * (0.5 * np.array([x, y, z]))
    faces = [(4, 6, 7, 5), (0, 1, 3, 2), (2, 3, 7, 6), (0, 4, 5, 1), (1, 5, 7, 3), (0, 2, 6, 4)]
    solid = Solid(vertices, [np.array(face) for face in faces])
    made = flat([vertices[list(face)] for face in faces], ("side",) * 6)
    return made._replace(solids=[solid])


def plate(x: float, y: float) -> Panels:
    """Both sides of a thin plate in the xy plane, its centre at the origin; its front faces +z."""
    corners = 0.5 * np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], float)
    made = flat([corners, corners[::-1]], ("front", "back"))
    return made._replace(solids=[flat_solid(corners)])


def frustum(
    radius: float, radius_top: float, length: float, n: int, end_sides: int = CIRCLE_SIDES[-1]
) -> Panels:
    """A closed frustum about z, its base at the origin and its top, which may be a point, above.

    Its ends, and the solid that casts its shadow, have ``end_sides`` sides.

    A panel of the side is 1/n of it: area π (r₀ + r₁) √(h² + (r₀ − r₁)²) / n, normal
    (h cos φ, h sin φ, r₀ − r₁) / √(h² + (r₀ − r₁)²) at the azimuth φ of its middle.
    """
    base, top = _ring(radius, 0.0, n), _ring(radius_top, length, n)
    after = np.roll(np.arange(n), -1)
    if radius_top > 0.0:
        sides = [np.stack([base[i], base[j], top[j], top[i]]) for i, j in enumerate(after)]
    else:
        sides = [np.stack([base[i], base[j], top[i]]) for i, j in enumerate(after)]
    middle = 2.0 * np.pi * (np.arange(n) + 0.5) / n
    across, slant = np.stack([np.cos(middle), np.sin(middle)], axis=1), radius - radius_top
    height = np.hypot(length, slant)
    normals = np.column_stack([length * across, np.full(n, slant)]) / height
    u_axes = np.column_stack([-slant * across, np.full(n, length)]) / height
    areas = np.full(n, np.pi * (radius + radius_top) * height / n)
    ends = [_ring(radius, 0.0, end_sides)[::-1]]
    ends += [_ring(radius_top, length, end_sides)] if radius_top > 0.0 else []
    end_normals = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])[: len(ends)]
    end_areas = np.pi * np.array([radius, radius_top])[: len(ends)] ** 2
    return Panels(
        [*sides, *ends],
        np.concatenate([normals, end_normals]),
        np.concatenate([areas, end_areas]),
        np.concatenate([u_axes, np.tile([1.0, 0.0, 0.0], (len(ends), 1))]),
        ("side",) * n + ("end",) * len(ends),
        [_frustum_solid(radius, radius_top, length, end_sides)],
        shared=n // STRIPS if n % STRIPS == 0 else 1,
    )


def _ring(radius: float, z: float, n: int) -> Floats:
    """Vertices of a regular polygon as large as a circle, counter-clockwise about z."""
    step = 2.0 * np.pi / n
    angle = step * np.arange(n)
    r = radius * np.sqrt(step / np.sin(step))
    return np.stack([r * np.cos(angle), r * np.sin(angle), np.full(n, z)], axis=1)


def _frustum_solid(radius: float, radius_top: float, length: float, n: int) -> Solid:
    i = np.arange(n)
    j = np.roll(i, -1)
    base = _ring(radius, 0.0, n)
    if radius_top == 0.0:
        faces = [i[::-1], *np.stack([i, j, np.full(n, n)], axis=1)]
        return Solid(np.concatenate([base, [[0.0, 0.0, length]]]), faces)
    faces = [i[::-1], i + n, *np.stack([i, j, j + n, i + n], axis=1)]
    return Solid(np.concatenate([base, _ring(radius_top, length, n)]), faces)


def cone(radius: float, length: float, n: int, end_sides: int = CIRCLE_SIDES[-1]) -> Panels:
    """A cone about z, its base at the origin and its apex above."""
    return frustum(radius, 0.0, length, n, end_sides)


def cylinder(radius: float, length: float, n: int, end_sides: int = CIRCLE_SIDES[-1]) -> Panels:
    """A closed cylinder about z, its centre at the origin."""
    made = frustum(radius, radius, length, n, end_sides)
    return moved(made, np.eye(3), np.array([0.0, 0.0, -0.5 * length]))


def ellipsoid(x: float, y: float, z: float, n: int) -> Panels:
    """An ellipsoid with semi-axes x, y, z about the origin.

    The panels are images of panels of the unit sphere between n/2 + 1 parallels, of which a zone
    at polar angle θ has n sin θ. The first panel of each zone begins at another azimuth, so that no
    edge of the lit part runs along edges of panels in all zones at once. A panel of the sphere
    between θ₁ and θ₂ has the area Δφ (cos θ₁ − cos θ₂); the map diag(x, y, z) takes an element of
    area n dA to xyz diag(1/x, 1/y, 1/z) n dA.
    """
    zones = max(2, n // 2)
    theta = np.pi * np.arange(zones + 1) / zones
    scale = np.array([x, y, z], float)
    polygons, normals, areas = [], [], []
    for k in range(zones):
        middle = 0.5 * (theta[k] + theta[k + 1])
        s, c = np.sin(middle), np.cos(middle)
        rim = np.column_stack([np.sin(theta[k : k + 2]), np.cos(theta[k : k + 2])])
        made, azimuth = _zone(rim, max(4, round(n * s)), k / GOLDEN)
        unit = np.column_stack([s * np.cos(azimuth), s * np.sin(azimuth), np.full(len(made), c)])
        image = unit / scale
        length = np.linalg.norm(image, axis=1)
        area = 2.0 * np.pi * (np.cos(theta[k]) - np.cos(theta[k + 1])) / len(made)
        polygons += [p * scale for p in made]
        normals.append(image / length[:, None])
        areas.append(area * scale.prod() * length)
    made = np.concatenate(normals)
    sides = ("side",) * len(made)
    u_axes = plane_axis(made)
    return Panels(polygons, made, np.concatenate(areas), u_axes, sides, [_ellipsoid(scale)])


def _zone(rim: Floats, count: int, begin: float) -> tuple[list[Floats], Floats]:
    """Panels between two circles about z, given by radius and height, (2, 2); and the azimuths of
    their middles. The first panel begins at a share ``begin`` of a full turn."""
    step = 2.0 * np.pi / count
    azimuth = 2.0 * np.pi * np.mod(begin, 1.0) + step * np.arange(count + 1)
    r, z = rim.T
    r = r * np.sqrt(step / np.sin(step))
    edge = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    circle = [np.column_stack([r[i] * edge, np.full(count + 1, z[i])]) for i in (0, 1)]
    tiny = 1e-12 * r.max()
    polygons = []
    for i in range(count):
        upper = [circle[0][i + 1], circle[0][i]] if r[0] > tiny else [circle[0][i]]
        lower = [circle[1][i], circle[1][i + 1]] if r[1] > tiny else [circle[1][i]]
        polygons.append(np.array(upper + lower))
    return polygons, azimuth[:-1] + 0.5 * step


def _ellipsoid(scale: Floats) -> Solid:
    """The solid of an ellipsoid, between 24 meridians."""
    n, parallels = 24, 12
    theta = np.pi * np.arange(1, parallels) / parallels
    widened = np.sqrt((2.0 * np.pi / n) / np.sin(2.0 * np.pi / n))
    rings = [_unit_ring(np.sin(t) * widened, np.cos(t) * widened, n) for t in theta]
    poles = np.array([[0.0, 0.0, widened], [0.0, 0.0, -widened]])
    vertices = np.concatenate([*rings, poles]) * scale
    top, last = len(vertices) - 2, len(rings) - 1
    faces: list[NDArray[np.integer]] = []
    for i in range(n):
        j = (i + 1) % n
        faces.append(np.array([i, j, top]))
        faces.append(np.array([last * n + j, last * n + i, top + 1]))
        faces += [
            np.array([k * n + j, k * n + i, (k + 1) * n + i, (k + 1) * n + j]) for k in range(last)
        ]
    return Solid(vertices, faces)


def _unit_ring(radius: float, z: float, n: int) -> Floats:
    angle = 2.0 * np.pi * np.arange(n) / n
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, z)], axis=1)


def sphere(radius: float, n: int) -> Panels:
    """A sphere about the origin."""
    return ellipsoid(radius, radius, radius, n)


def dish(radius: float, depth: float, n: int) -> Panels:
    """Both sides of a thin paraboloid about z, its vertex at the origin, open towards +z.

    z = a r², a = depth/radius². Its front is the hollow side. Rings are of equal width in r and
    have n panels each, so that there are no gaps between panels; the area within r is
    π/(6a²) [(1 + 4a²r²)^(3/2) − 1].
    """
    rings = max(2, n // 4)
    a = depth / radius**2
    r = radius * np.arange(rings + 1) / rings
    within = np.pi / (6.0 * a**2) * ((1.0 + 4.0 * a**2 * r**2) ** 1.5 - 1.0)
    polygons, normals, areas, axes = [], [], [], []
    for k in range(rings):
        middle = 0.5 * (r[k] + r[k + 1])
        rim = np.column_stack([r[k : k + 2], a * r[k : k + 2] ** 2])
        made, azimuth = _zone(rim, n, 0.0)
        c, s = np.cos(azimuth), np.sin(azimuth)
        slope, one = 2.0 * a * middle, np.ones(len(made))
        polygons += made
        normals.append(np.column_stack([-slope * c, -slope * s, one]) / np.hypot(1.0, slope))
        axes.append(np.column_stack([c, s, slope * one]) / np.hypot(1.0, slope))
        areas.append(np.full(len(made), (within[k + 1] - within[k]) / len(made)))
    front, count = np.concatenate(normals), len(polygons)
    return Panels(
        [*polygons, *(p[::-1] for p in polygons)],
        np.concatenate([front, -front]),
        np.tile(np.concatenate(areas), 2),
        np.tile(np.concatenate(axes), (2, 1)),
        ("front",) * count + ("back",) * count,
        [flat_solid(p) for p in polygons],
        convex=False,
    )


def moved(panels: Panels, rotation: Floats, position: Floats) -> Panels:
    """Panels in other axes: x → R x + p."""

    def place(points: Floats) -> Floats:
        return points @ rotation.T + position

    return panels._replace(
        polygons=[place(p) for p in panels.polygons],
        normals=panels.normals @ rotation.T,
        u_axes=panels.u_axes @ rotation.T,
        solids=[Solid(place(s.vertices), s.faces) for s in panels.solids],
    )


class Kind(NamedTuple):
    """A kind of part: how it is made, its lengths in the order of `make`, and its sides.

    If ``round_ends``, `make` takes the number of their sides.
    """

    make: Callable[..., Panels]
    sizes: tuple[str, ...]
    sides: tuple[str, ...] = ("side",)
    curved: bool = True
    round_ends: bool = False


KINDS: dict[str, Kind] = {
    "box": Kind(box, ("x", "y", "z"), curved=False),
    "plate": Kind(plate, ("x", "y"), ("front", "back"), curved=False),
    "cylinder": Kind(cylinder, ("radius", "length"), ("side", "end"), round_ends=True),
    "cone": Kind(cone, ("radius", "length"), ("side", "end"), round_ends=True),
    "frustum": Kind(frustum, ("radius", "radius_top", "length"), ("side", "end"), round_ends=True),
    "sphere": Kind(sphere, ("radius",)),
    "ellipsoid": Kind(ellipsoid, ("x", "y", "z")),
    "dish": Kind(dish, ("radius", "depth"), ("front", "back")),
}
