"""The convex polyhedron that has given facet areas and normals (Minkowski's problem)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.errors import InputError

Floats = NDArray[np.float64]

# Facets below this fraction of the mean area are left out: they change the body by less than its
# picture can show, and make the equations stiff.
SMALLEST = 1e-4


@dataclass(frozen=True)
class Polyhedron:
    """A convex polyhedron, centroid at the origin.

    Attributes
    ----------
    vertices : (V, 3)
        In the square root of the unit of the areas.
    faces : list of (k,) int
        Indices into ``vertices``, counter-clockwise seen from outside.
    facet : (F,) int
        Which of the given facets each face is; facets of negligible area have none.
    areas : (N,)
        Areas of the faces of this body, 0 where a facet has none.
    volume : float
    """

    vertices: Floats
    faces: list[NDArray[np.integer]]
    facet: NDArray[np.integer]
    areas: Floats
    volume: float

    def obj(self, comment: str = "") -> str:
        """Wavefront OBJ text."""
        lines = [f"# {line}" for line in comment.splitlines()]
        lines += ["v {:.9g} {:.9g} {:.9g}".format(*v) for v in self.vertices]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in self.faces]
        return "\n".join(lines) + "\n"


def closure(normals: Floats, areas: Floats) -> float:
    """How far facets are from closing: |Σ Aᵢ nᵢ| / Σ Aᵢ, 0 for every closed body."""
    return float(np.linalg.norm(areas @ normals) / np.sum(areas))


def close(normals: Floats, areas: Floats) -> Floats:
    """The areas Aᵢ(1 − λ·nᵢ), of the one λ for which Σ Aᵢ nᵢ = 0; may be negative if far from it.

    It is the smallest change of the areas, each weighed by its size.
    """
    tensor = np.einsum("n,ni,nj->ij", areas, normals, normals)
    return areas * (1.0 - normals @ np.linalg.solve(tensor, areas @ normals))


def minkowski(
    normals: Floats, areas: Floats, tolerance: float = 1e-6, max_steps: int = 200
) -> Polyhedron:
    """The convex polyhedron with these outward unit normals and facet areas.

    Minimises the convex function Σ Aᵢ hᵢ − log V(h) of the support distances h by damped Newton
    steps: its gradient is A − a(h)/V(h) with a(h) the areas of the polyhedron {x: nᵢ·x ≤ hᵢ}, and
    ∂aᵢ/∂hⱼ = l_ij/sin θ_ij, ∂aᵢ/∂hᵢ = −Σⱼ l_ij cot θ_ij over the facets j that share with i an
    edge of length l_ij and enclose the angle θ_ij. At the minimum a ∝ A; a change of size does the
    rest. A step is halved until the gradient shrinks and no facet is lost, which makes the
    iteration converge from the ball. Minkowski's theorem says that the body exists and is unique
    (up to a shift) exactly when the facets close and do not lie in one plane.

    Parameters
    ----------
    normals : (N, 3)
        Outward unit normals, no two alike.
    areas : (N,)
        Not negative. They must close to 10⁻⁶ of their sum (see `close`).
    tolerance : float
        Largest error of an area allowed, relative to the mean area.
    max_steps : int
        Newton steps; a few dozen do.

    Raises
    ------
    InputError
        If no convex body has these facets.

    References
    ----------
    Minkowski 1897; Little 1983, *An iterative method for reconstructing convex polyhedra from
    extended Gaussian images*. Kitagawa, Mérigot & Thibert 2019, *Convergence of a Newton algorithm
    for semi-discrete optimal transport* (the damping). Schneider, *Convex Bodies*, ch. 8.
    """
    if np.any(areas < 0):
        raise InputError(f"an area is negative ({np.min(areas):.3g}), so no convex body has it")
    gap = closure(normals, areas)
    if not gap <= 1e-6:
        raise InputError(
            f"facets do not close: |sum(A n)| / sum(A) = {gap:.2g} exceeds 1e-6, "
            "so no convex body has them (Minkowski)"
        )
    kept = np.flatnonzero(areas > SMALLEST * np.mean(areas))
    n = normals[kept]
    if np.linalg.matrix_rank(n, tol=1e-6) < 3:
        raise InputError("facets lie in one plane, so no convex body has them (Minkowski)")
    target = close(n, areas[kept])  # the small ones left out have opened it a little
    target = target / target.sum()

    h = np.ones(len(n))
    body = _cut(n, h)
    # No facet may be lost on the way: a plane that passes the body by has no slope towards it.
    least = 0.5 * min(np.min(body.areas / body.areas.sum()), np.min(target))
    for _ in range(max_steps):
        gradient = target - body.areas / body.volume
        if np.max(np.abs(body.areas / body.areas.sum() - target)) < tolerance / len(n):
            break
        step = _newton_step(n, body, gradient)
        size = 1.0
        while size > 1e-9:
            trial = h + size * step
            if np.all(trial > 0):
                new = _cut(n, trial)
                slope = np.linalg.norm(target - new.areas / new.volume)
                if np.min(new.areas / new.areas.sum()) >= least and slope <= (
                    1.0 - 0.5 * size
                ) * np.linalg.norm(gradient):
                    break
            size *= 0.5
        else:
            break
        h = trial - n @ new.centroid  # keep the origin well inside
        body = _cut(n, h)
    error = np.max(np.abs(body.areas / body.areas.sum() - target)) * len(n)
    if error > 1e-3:
        raise InputError(f"the shape was not found: an area is off by {error:.2g} of the mean area")
    vertices, faces = _faces(n, body)
    scale = np.sqrt(areas.sum() / body.areas.sum())
    full = np.zeros(len(normals))
    full[kept] = body.areas * scale**2
    return Polyhedron(
        vertices=(vertices - body.centroid) * scale,
        faces=[f for f in faces if len(f)],
        facet=kept[[i for i, f in enumerate(faces) if len(f)]],
        areas=full,
        volume=body.volume * scale**3,
    )


@dataclass(frozen=True)
class _Cut:
    """The polyhedron {x: nᵢ·x ≤ hᵢ} and what Newton's method needs of it.

    ``corners`` (M, 3) may repeat a vertex where more than three facets meet; ``around`` (M, 3)
    are the facets that meet in each. ``jacobian`` is ∂aᵢ/∂hⱼ.
    """

    corners: Floats
    around: NDArray[np.integer]
    areas: Floats
    volume: float
    centroid: Floats
    jacobian: Floats


def _cut(normals: Floats, h: Floats) -> _Cut:
    """Cut space by the half-spaces, through the convex hull of the dual points nᵢ/hᵢ.

    A triangle of that hull is a vertex of the body, an edge of it is an edge of the body.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(normals / h[:, None])
    corners = -hull.equations[:, :3] / hull.equations[:, 3:]
    # neighbors[s, k] shares with triangle s the two dual points other than simplices[s, k]
    start = np.repeat(np.arange(len(corners)), 3)
    end = hull.neighbors.ravel()
    i = hull.simplices[:, [1, 2, 0]].ravel()
    j = hull.simplices[:, [2, 0, 1]].ravel()
    once = start < end  # each edge is met from both of its ends
    start, end, i, j = start[once], end[once], i[once], j[once]
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    start, end = np.tile(start, 2), np.tile(end, 2)

    cosine = np.sum(normals[i] * normals[j], axis=1)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 1e-15))
    length = np.linalg.norm(corners[start] - corners[end], axis=1)
    # facet i in triangles from the foot of its plane, signed by the side the edge is on
    triangle = 0.5 * length * (h[j] - h[i] * cosine) / sine
    areas = np.bincount(i, triangle, len(h))
    volume = float(areas @ h / 3)
    middle = 0.25 * (normals[i] * h[i, None] + corners[start] + corners[end])
    centroid = (triangle * h[i] / 3) @ middle / volume
    jacobian = np.zeros((len(h), len(h)))
    np.add.at(jacobian, (i, j), length / sine)
    np.add.at(jacobian, (i, i), -length * cosine / sine)
    return _Cut(corners, hull.simplices, areas, volume, centroid, jacobian)


def _newton_step(normals: Floats, body: _Cut, gradient: Floats) -> Floats:
    """The Newton step of Σ Aᵢ hᵢ − log V, in the space without the three shifts."""
    hessian = np.outer(body.areas, body.areas) / body.volume**2 - body.jacobian / body.volume
    typical = np.mean(np.diag(hessian))
    hessian += typical * (normals @ normals.T) / len(normals)  # the three shifts are flat
    return -np.linalg.solve(hessian, gradient)


def _faces(normals: Floats, body: _Cut) -> tuple[Floats, list[NDArray[np.integer]]]:
    """Distinct vertices, and for each facet its own, counter-clockwise seen from outside."""
    scale = np.max(np.abs(body.corners))
    _, first, same = np.unique(
        np.round(body.corners / scale, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    vertices, same = body.corners[first], same.ravel()
    faces = []
    for i, normal in enumerate(normals):
        face = np.unique(same[np.any(body.around == i, axis=1)])
        if len(face) < 3:
            faces.append(face[:0])
            continue
        spokes = vertices[face] - vertices[face].mean(axis=0)
        upward = np.cross(normal, spokes[0])
        faces.append(face[np.argsort(np.arctan2(spokes @ upward, spokes @ spokes[0]))])
    return vertices, faces
