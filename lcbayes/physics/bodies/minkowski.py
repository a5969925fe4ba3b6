"""The convex polyhedron with given facet areas and normals (Minkowski's problem)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.errors import InputError
from lcbayes.physics.bodies.closure import close, closure
from lcbayes.physics.bodies.polyhedron import Polyhedron

Floats = NDArray[np.float64]

# Facets below this fraction of the mean area are left out: their effect is below the sensitivity of
# any light curve, and they make the equations ill-conditioned.
SMALLEST = 1e-8
SAME_NORMAL = 1e-7  # rad; facets with closer normals are merged
MAX_CLOSURE_GAP = 1e-6  # largest |Σ A n|/Σ A of facets that count as closed
MIN_THICKNESS = 1e-10  # ratio of extreme eigenvalues of Σ A n nᵀ: below, the body is flat
AREA_TOLERANCE = 1e-10  # relative error of each area at which the iteration ends
MAX_AREA_ERROR = 1e-6  # relative to the mean area, at which the iteration counts as converged
MAX_STEPS = 200  # of Newton's method; a few dozen are usually sufficient


def minkowski(normals: ArrayLike, areas: ArrayLike) -> Polyhedron:
    """The convex polyhedron with these outward unit normals and facet areas.

    Minimises the convex function Σ Aᵢ hᵢ − log V(h) of the support distances h by damped Newton
    steps: its gradient is A − a(h)/V(h) with a(h) the areas of the polyhedron {x: nᵢ·x ≤ hᵢ}, and
    ∂aᵢ/∂hⱼ = l_ij/sin θ_ij, ∂aᵢ/∂hᵢ = −Σⱼ l_ij cot θ_ij, where the sum is over the facets j that
    share with i an edge of length l_ij, and θ_ij is the angle between the normals. At the minimum
    a ∝ A, and the body is scaled to the given areas. A step is halved until the gradient decreases
    and no facet is lost, so that the iteration converges from the ball. By Minkowski's theorem the
    body exists and is unique (up to a translation) if and only if the facets close and their
    normals do not lie in one plane.

    The equations are solved for the affine image with isotropic facets, Σ A n nᵀ ∝ 1: area vectors
    w = A n transform as w → B w, and points as x → √(det B) B⁻ᵀ x. A thin plate is therefore as
    easy as a cube. Facets with normals that agree to 10⁻⁷ rad are merged and share the area of
    their face in the given proportion. Facets below 10⁻⁸ of the mean area are left out.

    Parameters
    ----------
    normals : (N, 3)
        Outward unit normals, body frame.
    areas : (N,)
        Not negative. They must close to 10⁻⁶ of their sum (see `physics.closure.close`).

    Returns
    -------
    Polyhedron
        Each area has a relative accuracy of 10⁻¹⁰, or that at which rounding stops the iteration;
        no error exceeds 10⁻⁶ of the mean area.

    Raises
    ------
    InputError
        If no convex body has these facets.

    References
    ----------
    Minkowski 1897; Little 1983, *An iterative method for reconstructing convex polyhedra from
    extended Gaussian images*. Kitagawa, Mérigot & Thibert 2019, *Convergence of a Newton algorithm
    for semi-discrete optimal transport* (the damping). Petty 1961, *Surface area of a convex body
    under affine transformations* (the image). Schneider, *Convex Bodies*, ch. 8.
    """
    normals, given = _checked(normals, areas)
    merged, group = _merge(normals)
    area = np.bincount(group, given)
    kept = np.flatnonzero(area > SMALLEST * np.mean(area))
    closed = close(merged[kept], area[kept])  # the omitted facets leave a small gap
    vectors, back = _isotropic(merged[kept] * closed[:, None])
    target = np.linalg.norm(vectors, axis=1)
    n = vectors / target[:, None]
    total = target.sum()
    body = _solve(n, target / total)
    vertices, faces = _faces(n, body)
    back = back * np.sqrt(total / body.areas.sum())
    kept_areas = np.linalg.norm((n * body.areas[:, None]) @ _cofactor(back).T, axis=1)
    kept_faces = [i for i, f in enumerate(faces) if len(f)]
    first = np.array([np.flatnonzero(group == k)[0] for k in kept])
    face_area = np.zeros(len(merged))
    face_area[kept] = kept_areas
    return Polyhedron(
        vertices=(vertices - body.centroid) @ back.T,
        faces=[faces[i] for i in kept_faces],
        facet=first[kept_faces],
        areas=face_area[group] * given / np.where(area > 0, area, 1.0)[group],
        volume=body.volume * float(np.linalg.det(back)),
    )


def _checked(normals: ArrayLike, areas: ArrayLike) -> tuple[Floats, Floats]:
    n, a = np.asarray(normals, float), np.asarray(areas, float)
    if n.ndim != 2 or n.shape[1] != 3 or a.shape != n.shape[:1]:
        raise InputError(f"normals {n.shape} and areas {a.shape}; expected (N, 3) and (N,)")
    if not (np.all(np.isfinite(n)) and np.all(np.isfinite(a))):
        raise InputError("a facet's normal or area is not finite; remove it")
    if np.any(np.abs(np.linalg.norm(n, axis=1) - 1.0) > 1e-6):
        raise InputError("a facet's normal is not of unit length; divide normals by their lengths")
    if np.any(a < 0):
        raise InputError(f"an area is negative ({np.min(a):.3g}), so no convex body has it")
    if not np.any(a > 0):
        raise InputError("no facet has an area, so no convex body has them")
    gap = closure(n, a)
    if not gap <= MAX_CLOSURE_GAP:
        raise InputError(
            f"facets do not close: |sum(A n)| / sum(A) = {gap:.2g} exceeds {MAX_CLOSURE_GAP:g}, "
            "so no convex body has them (Minkowski)"
        )
    return n, a


def _merge(normals: Floats) -> tuple[Floats, NDArray[np.integer]]:
    """Mean normals of facets with equal normals, (M, 3), and the index of each facet, (N,)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(normals).query_pairs(SAME_NORMAL, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(normals),) * 2)
    count, group = connected_components(links, directed=False)
    mean = np.zeros((count, 3))
    np.add.at(mean, group, normals)
    return mean / np.linalg.norm(mean, axis=1, keepdims=True), group


def _isotropic(vectors: Floats) -> tuple[Floats, Floats]:
    """Area vectors (N, 3) of the affine image with Σ A n nᵀ ∝ 1, and the inverse map of points."""
    image, total = vectors, np.eye(3)
    for _ in range(100):
        length = np.linalg.norm(image, axis=1)
        tensor = 3.0 / length.sum() * (image / length[:, None]).T @ image
        values, axes = np.linalg.eigh(tensor)
        if values[0] < MIN_THICKNESS * values[2]:
            raise InputError("facets lie in one plane, so no convex body has them (Minkowski)")
        if values[2] - values[0] < 1e-3:
            break
        step = axes @ np.diag(values**-0.5) @ axes.T
        image, total = image @ step, step @ total
    return image, total.T / np.sqrt(np.linalg.det(total))


def _cofactor(matrix: Floats) -> Floats:
    """The matrix that transforms area vectors if points are transformed by ``matrix``."""
    return np.linalg.det(matrix) * np.linalg.inv(matrix).T


def _solve(n: Floats, target: Floats) -> _Cut:
    """The polyhedron, of any size, with areas proportional to ``target``, whose sum is one."""
    h = np.full(len(n), 3.0)  # the ball with Σ a = V, as at the minimum
    body = _cut(n, h)
    # No facet may be lost: the gradient vanishes for a plane that does not touch the body.
    least = 0.5 * min(np.min(body.areas / body.areas.sum()), np.min(target))
    for _ in range(MAX_STEPS):
        gradient = target - body.areas / body.volume
        if np.all(np.abs(body.areas / body.areas.sum() - target) < AREA_TOLERANCE * target):
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
        body = new.centred
    error = np.max(np.abs(body.areas / body.areas.sum() - target)) * len(n)
    if not error <= MAX_AREA_ERROR:
        raise InputError(f"the shape was not found: an area is off by {error:.2g} of the mean area")
    return body


@dataclass(frozen=True)
class _Cut:
    """The polyhedron {x: nᵢ·x ≤ hᵢ} with its quantities for Newton's method.

    ``corners`` (M, 3) may repeat a vertex at which more than three facets meet; ``around`` (M, 3)
    are the facets that meet at each corner. ``jacobian`` is ∂aᵢ/∂hⱼ.
    """

    corners: Floats
    around: NDArray[np.integer]
    areas: Floats
    volume: float
    centroid: Floats
    jacobian: Floats

    @property
    def centred(self) -> _Cut:
        """The same polyhedron with its centroid at the origin."""
        return replace(self, corners=self.corners - self.centroid, centroid=np.zeros(3))


def _cut(normals: Floats, h: Floats) -> _Cut:
    """Intersect the half-spaces by means of the convex hull of the dual points nᵢ/hᵢ.

    A triangle of that hull corresponds to a vertex of the body, and an edge to an edge.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(normals / h[:, None])
    corners = -hull.equations[:, :3] / hull.equations[:, 3:]
    # neighbors[s, k] shares with triangle s the two dual points other than simplices[s, k]
    start = np.repeat(np.arange(len(corners)), 3)
    end = hull.neighbors.ravel()
    i = hull.simplices[:, [1, 2, 0]].ravel()
    j = hull.simplices[:, [2, 0, 1]].ravel()
    once = start < end  # each edge occurs twice, once from each end
    start, end, i, j = start[once], end[once], i[once], j[once]
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    start, end = np.tile(start, 2), np.tile(end, 2)

    cosine = np.sum(normals[i] * normals[j], axis=1)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 1e-15))
    length = np.linalg.norm(corners[start] - corners[end], axis=1)
    # facet i in triangles from the foot point of its plane, with the sign of the side of the edge
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
    """The Newton step of Σ Aᵢ hᵢ − log V, orthogonal to the three translations."""
    hessian = np.outer(body.areas, body.areas) / body.volume**2 - body.jacobian / body.volume
    typical = np.mean(np.diag(hessian))
    hessian += typical * (normals @ normals.T) / len(normals)  # no curvature along the translations
    return -np.linalg.solve(hessian, gradient)


def _faces(normals: Floats, body: _Cut) -> tuple[Floats, list[NDArray[np.integer]]]:
    """Distinct vertices, and those of each facet, counter-clockwise as seen from outside."""
    scale = np.max(np.abs(body.corners))
    _, first, same = np.unique(
        np.round(body.corners / scale, 9) + 0.0, axis=0, return_index=True, return_inverse=True
    )
    vertices, same = body.corners[first], same.ravel()
    # each vertex once for each facet that meets there, by facet
    facet, vertex = np.unique(
        np.stack([body.around, np.repeat(same[:, None], 3, axis=1)], -1).reshape(-1, 2), axis=0
    ).T
    found, begin, number = np.unique(facet, return_index=True, return_counts=True)
    middle = np.add.reduceat(vertices[vertex], begin) / number[:, None]
    spokes = vertices[vertex] - np.repeat(middle, number, axis=0)
    ahead = spokes[begin]
    upward = np.cross(normals[found], ahead)
    x, y = (np.sum(spokes * np.repeat(v, number, axis=0), axis=1) for v in (ahead, upward))
    ordered = vertex[np.lexsort((np.arctan2(y, x), facet))]
    every = np.split(ordered, np.searchsorted(facet, np.arange(1, len(normals))))
    return vertices, [face if len(face) > 2 else face[:0] for face in every]
