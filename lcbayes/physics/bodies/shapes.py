"""Faceted bodies: built-in shapes for scenarios."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.errors import InputError
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.facets import grid

Floats = NDArray[np.float64]

SMALLEST_M, LARGEST_M = 1e-6, 1e6  # range of lengths


class Body(NamedTuple):
    """Facets of a body, body frame.

    Attributes
    ----------
    normals : (N, 3)
        Outward unit normals.
    areas : (N,) m²
    u_axes : (N, 3)
        Unit vectors in the plane of each facet, along its longer side if there is one.
    labels : (N,)
        Part to which each facet belongs, for example "bus" or "panel".
    """

    normals: Floats
    areas: Floats
    u_axes: Floats
    labels: tuple[str, ...]


def plane_axis(normals: ArrayLike) -> Floats:
    """A unit vector in the plane of each facet: horizontal (⊥ z), or x if the normal is along z."""
    n = np.atleast_2d(np.asarray(normals, float))
    u = np.stack([-n[:, 1], n[:, 0], np.zeros(len(n))], axis=1)
    length = np.linalg.norm(u, axis=1, keepdims=True)
    flat = length[:, 0] < 1e-9
    u = u / np.where(flat[:, None], 1.0, length)
    u[flat] = [1.0, 0.0, 0.0]
    return u


def body(
    normals: ArrayLike,
    areas: ArrayLike,
    labels: str | tuple[str, ...] = "body",
    u_axes: ArrayLike | None = None,
) -> Body:
    """A body from its normals (of any length) and areas."""
    n = np.asarray(normals, float)
    n = n / np.linalg.norm(n, axis=1, keepdims=True)
    axes = plane_axis(n) if u_axes is None else np.asarray(u_axes, float)
    names = (labels,) * len(n) if isinstance(labels, str) else labels
    return Body(n, np.asarray(areas, float), axes, names)


def join(*parts: Body) -> Body:
    """One body from several parts; facets do not shadow each other."""
    return Body(
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.areas for p in parts]),
        np.concatenate([p.u_axes for p in parts]),
        sum((p.labels for p in parts), ()),
    )


def box(x: float, y: float, z: float, label: str = "body") -> Body:
    """Six faces of a box with sides x, y, z (m); u along the longer side of each face."""
    eye = np.eye(3)
    sides = np.array([x, y, z], float)
    normals, areas, axes = [], [], []
    for i in range(3):
        j, k = (a for a in range(3) if a != i)
        for sign in (1.0, -1.0):
            normals.append(sign * eye[i])
            areas.append(sides[j] * sides[k])
            axes.append(eye[j] if sides[j] >= sides[k] else eye[k])
    return body(normals, areas, label, axes)


def cube(side: float = 1.0) -> Body:
    """A cube with sides of `side` m."""
    return box(side, side, side)


def tetrahedron(side: float = 1.0) -> Body:
    """A regular tetrahedron with edges of `side` m."""
    normals = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    return body(normals, np.full(4, np.sqrt(3.0) / 4.0 * side**2))


def cylinder(radius: float = 0.5, length: float = 2.0, n: int = 24) -> Body:
    """A prism of n sides about z with the lateral and end areas of the cylinder."""
    angle = 2 * np.pi * np.arange(n) / n
    zero = np.zeros(n)
    side = body(
        np.stack([np.cos(angle), np.sin(angle), zero], axis=1),
        np.full(n, 2 * np.pi * radius * length / n),
        "side",
        np.tile([0.0, 0.0, 1.0], (n, 1)),
    )
    return join(side, body([[0, 0, 1], [0, 0, -1]], np.full(2, np.pi * radius**2), "end"))


def sphere(radius: float = 0.5, n: int = 200) -> Body:
    """n facets of a sphere, with areas adjusted so that they close."""
    normals = grid(n)
    areas = close(normals, np.full(n, 1.0 / n))
    return body(normals, 4.0 * np.pi * radius**2 * areas / areas.sum())


def plate(x: float = 1.0, y: float = 1.0) -> Body:
    """Both sides of a thin plate in the xy plane."""
    axis = [1.0, 0.0, 0.0] if x >= y else [0.0, 1.0, 0.0]
    return body([[0, 0, 1], [0, 0, -1]], [x * y, x * y], ("front", "back"), [axis, axis])


def box_wing(
    bus: tuple[float, float, float] = (1.5, 1.2, 2.0),
    wing: tuple[float, float] = (6.0, 1.2),
    cant_deg: float = 0.0,
) -> Body:
    """A box bus ("bus") and a solar wing along y ("panel" in front, "back" behind).

    The wing's front faces +x at zero cant; a positive cant rotates it about y towards −z.
    """
    cant = np.deg2rad(cant_deg)
    front = np.array([np.cos(cant), 0.0, -np.sin(cant)])
    along = [0.0, 1.0, 0.0]
    area = wing[0] * wing[1]
    return join(
        box(*bus, label="bus"),
        body([front, -front], [area, area], ("panel", "back"), [along, along]),
    )


def rocket_body(radius: float = 1.2, length: float = 8.0, n: int = 24) -> Body:
    """An upper stage about z: cylinder ("side"), flat dome ("end"), nozzle opening ("nozzle")."""
    stage = cylinder(radius, length, n)
    return stage._replace(labels=("side",) * n + ("end", "nozzle"))


SHAPES: dict[str, Callable[..., Body]] = {
    "cube": cube,
    "tetrahedron": tetrahedron,
    "cylinder": cylinder,
    "sphere": sphere,
    "plate": plate,
    "box-wing": box_wing,
    "rocket-body": rocket_body,
}


def shape(name: str, **sizes: float) -> Body:
    """A built-in body by its name.

    Raises
    ------
    InputError
        If the shape is unknown, or has no such size.
    """
    if name not in SHAPES:
        raise InputError(f"unknown shape {name!r}; available: {', '.join(SHAPES)}")
    try:
        return SHAPES[name](**sizes)
    except TypeError as fault:
        raise InputError(f"shape {name!r} cannot be made with {sizes}: {fault}") from None
