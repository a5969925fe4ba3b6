"""A convex polyhedron: volume, dimensions, moments of inertia; its OBJ, PLY and STL files."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from lcbayes.physics.bodies.mesh import to_stl

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Polyhedron:
    """A convex polyhedron, centroid at the origin.

    Attributes
    ----------
    vertices : (V, 3)
        In the square root of the unit of the areas (m for m²), body frame.
    faces : list of (k,) int
        Indices into ``vertices``, counter-clockwise as seen from outside.
    facet : (F,) int
        Index of the given facet for each face; facets with negligible area have no face.
    areas : (N,)
        Areas of the given facets on this body, 0 for facets without a face.
    volume : float
    """

    vertices: Floats
    faces: list[NDArray[np.integer]]
    facet: NDArray[np.integer]
    areas: Floats
    volume: float

    @cached_property
    def inertia(self) -> Floats:
        """Inertia tensor about the centroid per unit mass, for uniform density, (3, 3) m².

        I/M = tr(C) 1 − C with C = ∫ x xᵀ dV / V. A tetrahedron from the origin over the triangle
        (a, b, c) has ∫ x xᵀ dV = v/20 (a aᵀ + b bᵀ + c cᵀ + s sᵀ), s = a + b + c, v its volume.
        """
        corners = self.vertices[self.triangles]
        volumes = np.linalg.det(corners) / 6.0
        corners = np.concatenate([corners, corners.sum(axis=1, keepdims=True)], axis=1)
        second = np.einsum("f,fki,fkj->ij", volumes / 20.0, corners, corners) / volumes.sum()
        return np.trace(second) * np.eye(3) - second

    @cached_property
    def principal(self) -> tuple[Floats, Floats]:
        """Principal moments per unit mass in ascending order, (3,) m², and axes, rows of (3, 3).

        The rows form a right-handed triad in the body frame. The first axis is the long axis of the
        body.
        """
        moments, axes = np.linalg.eigh(self.inertia)
        axes = axes.T
        axes *= np.sign(axes[np.arange(3), np.argmax(np.abs(axes), axis=1)])[:, None]
        return moments, axes * [[1.0], [1.0], [np.linalg.det(axes)]]

    @property
    def dimensions(self) -> Floats:
        """Extents along the principal axes of inertia, in their order, (3,) m."""
        return np.ptp(self.vertices @ self.principal[1].T, axis=0)

    @property
    def ellipsoid(self) -> Floats:
        """Axes of the dynamically equivalent ellipsoid of equal volume, (3,) m, longest first.

        The homogeneous ellipsoid whose principal moments have the ratios of those of the body:
        a² ∝ I_b + I_c − I_a for moments I_a ≤ I_b ≤ I_c. Axes are full lengths, not semi-axes.
        """
        moments = self.principal[0]
        axes = np.sqrt(moments.sum() - 2.0 * moments)
        return axes * np.cbrt(6.0 * self.volume / (np.pi * np.prod(axes)))

    @property
    def of_unit_diameter(self) -> Polyhedron:
        """The body in units of its volume-equivalent diameter (6V/π)^⅓."""
        diameter = np.cbrt(6.0 * self.volume / np.pi)
        return Polyhedron(
            self.vertices / diameter,
            self.faces,
            self.facet,
            self.areas / diameter**2,
            np.pi / 6.0,
        )

    @cached_property
    def triangles(self) -> NDArray[np.integer]:
        """The faces as fans of triangles: indices into ``vertices``, (F, 3)."""
        fans = [face[[0, i, i + 1]] for face in self.faces for i in range(1, len(face) - 1)]
        return np.array(fans, int).reshape(-1, 3)

    def obj(self, comment: str = "") -> str:
        """Wavefront OBJ text."""
        lines = [f"# {line}" for line in comment.splitlines()]
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*v) for v in self.vertices]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in self.faces]
        return "\n".join(lines) + "\n"

    def ply(self, comment: str = "") -> str:
        """Stanford PLY text (ASCII 1.0) with a list of vertex indices for each face."""
        lines = ["ply", "format ascii 1.0"]
        lines += [f"comment {line}" for line in comment.splitlines()]
        lines += [f"element vertex {len(self.vertices)}"]
        lines += [f"property double {axis}" for axis in "xyz"]
        count = "uchar" if max(map(len, self.faces)) < 256 else "int"
        lines += [f"element face {len(self.faces)}", f"property list {count} int vertex_indices"]
        lines += ["end_header"]
        lines += ["{:.9g} {:.9g} {:.9g}".format(*v) for v in self.vertices]
        lines += [f"{len(face)} " + " ".join(map(str, face)) for face in self.faces]
        return "\n".join(lines) + "\n"

    def stl(self, header: str = "") -> bytes:
        """Binary STL; ``header`` is the text of its first 80 bytes."""
        return to_stl([self.vertices[t] for t in self.triangles], header)
