"""Light from bodies by casting rays at their analytic surfaces: own code, without the package.

A surface gives points of equal weight with their normals, and says which rays it stops. Points lie
on a lattice of Kronecker (the R2 sequence); a point that faces Sun and observer shines where no
surface stops the ray to the one or to the other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

EPS = 1e-7
_R2 = 1.0 / np.array([1.32471795724474602596, 1.32471795724474602596**2])


def lattice(n: int) -> tuple[Floats, Floats]:
    x, y = np.mod(0.5 + np.arange(1, n + 1)[:, None] * _R2, 1.0).T
    return x, y


class Surface(Protocol):
    """Points (P, 3), normals (P, 3), the area of all of them; and which rays x + t d, t > 0, are
    stopped."""

    def points(self, n: int) -> tuple[Floats, Floats, float]: ...

    def stops(self, x: Floats, d: Floats) -> Bools: ...


@dataclass
class Rectangle:
    """One side of a rectangle: a corner and two sides, the normal along their cross product."""

    corner: tuple[float, float, float]
    a: tuple[float, float, float]
    b: tuple[float, float, float]

    def points(self, n):
        a, b = np.array(self.a), np.array(self.b)
        x, y = lattice(n)
        vector = np.cross(a, b)
        area = float(np.linalg.norm(vector))
        at = np.array(self.corner) + x[:, None] * a + y[:, None] * b
        return at, np.tile(vector / area, (n, 1)), area

    def stops(self, x, d):
        a, b = np.array(self.a), np.array(self.b)
        normal = np.cross(a, b)
        rate = d @ normal
        if abs(rate) < 1e-14:
            return np.zeros(len(x), bool)
        t = (np.array(self.corner) - x) @ normal / rate
        y = x + t[:, None] * d - np.array(self.corner)
        u, v = y @ a / (a @ a), y @ b / (b @ b)
        return (t > EPS) & (u > 0) & (u < 1) & (v > 0) & (v < 1)


def box_faces(centre, sides) -> list[Rectangle]:
    c, h = np.array(centre, float), 0.5 * np.array(sides, float)
    result = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        for sign in (1.0, -1.0):
            a, b = np.zeros(3), np.zeros(3)
            a[i], b[j] = 2 * h[i], 2 * h[j]
            corner = c - h
            corner[k] = c[k] + sign * h[k]
            result.append(Rectangle(corner, *((a, b) if sign > 0 else (b, a))))  # pyright: ignore[reportArgumentType]
    return result


@dataclass
class Round:
    """The side of a frustum about z, from radius r0 at z0 to r1 at z1 (r0 = r1: a cylinder)."""

    r0: float
    z0: float
    r1: float
    z1: float

    def points(self, n):
        x, y = lattice(n)
        # equal areas: the area below z grows like the integral of the radius
        k = self.r1 - self.r0
        s = (
            y
            if abs(k) < 1e-12
            else (np.sqrt(self.r0**2 + y * (self.r1**2 - self.r0**2)) - self.r0) / k
        )
        r, z = self.r0 + k * s, self.z0 + s * (self.z1 - self.z0)
        c, sn = np.cos(2 * np.pi * x), np.sin(2 * np.pi * x)
        h = self.z1 - self.z0
        length = np.hypot(h, k)
        normals = np.stack([h * c, h * sn, np.full(n, -k)], axis=1) / length
        area = np.pi * (self.r0 + self.r1) * length
        return np.stack([r * c, r * sn, z], axis=1), normals, float(area)

    def stops(self, x, d):
        slope = (self.r1 - self.r0) / (self.z1 - self.z0)
        r = self.r0 + slope * (x[:, 2] - self.z0)
        a = d[0] ** 2 + d[1] ** 2 - (slope * d[2]) ** 2
        b = x[:, 0] * d[0] + x[:, 1] * d[1] - r * slope * d[2]
        c = x[:, 0] ** 2 + x[:, 1] ** 2 - r**2
        return _quadric(a, b, c, x, d, lambda p: (p[:, 2] > self.z0) & (p[:, 2] < self.z1))


@dataclass
class Disc:
    """One side of a disc across z."""

    radius: float
    z: float
    up: bool

    def points(self, n):
        x, y = lattice(n)
        r = self.radius * np.sqrt(x)
        at = np.stack(
            [r * np.cos(2 * np.pi * y), r * np.sin(2 * np.pi * y), np.full(n, self.z)], axis=1
        )
        return at, np.tile([0.0, 0.0, 1.0 if self.up else -1.0], (n, 1)), np.pi * self.radius**2

    def stops(self, x, d):
        if abs(d[2]) < 1e-14:
            return np.zeros(len(x), bool)
        t = (self.z - x[:, 2]) / d[2]
        p = x + t[:, None] * d
        return (t > EPS) & (p[:, 0] ** 2 + p[:, 1] ** 2 < self.radius**2)


@dataclass
class Paraboloid:
    """One side of z = z0 + a (x² + y²) within a radius; the hollow side or the other."""

    a: float
    radius: float
    z0: float
    hollow: bool

    def points(self, n):
        x, y = lattice(n)
        whole = (1 + 4 * self.a**2 * self.radius**2) ** 1.5 - 1
        r = np.sqrt((1 + y * whole) ** (2 / 3) - 1) / (2 * self.a)
        c, s = np.cos(2 * np.pi * x), np.sin(2 * np.pi * x)
        normals = np.stack([-2 * self.a * r * c, -2 * self.a * r * s, np.ones(n)], axis=1)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        at = np.stack([r * c, r * s, self.z0 + self.a * r**2], axis=1)
        area = np.pi / (6 * self.a**2) * whole
        return at, normals if self.hollow else -normals, float(area)

    def stops(self, x, d):
        a = self.a * (d[0] ** 2 + d[1] ** 2)
        b = self.a * (x[:, 0] * d[0] + x[:, 1] * d[1]) - 0.5 * d[2]
        c = self.a * (x[:, 0] ** 2 + x[:, 1] ** 2) + self.z0 - x[:, 2]
        inside = lambda p: p[:, 0] ** 2 + p[:, 1] ** 2 < self.radius**2  # noqa: E731
        return _quadric(a, b, c, x, d, inside)


def _quadric(a, b, c, x, d, inside) -> Bools:
    """Whether a t² + 2 b t + c = 0 has a root t > 0 whose point is on the surface."""
    if abs(a) < 1e-14:
        a = 1e-14
    square = b**2 - a * c
    root = np.sqrt(np.maximum(square, 0.0))
    stopped = np.zeros(len(x), bool)
    for t in ((-b - root) / a, (-b + root) / a):
        stopped |= (square > 0) & (t > 1e-6) & inside(x + t[:, None] * d)
    return stopped


@dataclass
class Triangle:
    """One side of a triangle of a mesh."""

    corners: Floats

    def points(self, n):
        shift = 1e3 * self.corners[:2].sum(axis=0)  # else equal triangles have equal errors
        x, y = (np.mod(z + move, 1.0) for z, move in zip(lattice(n), shift, strict=False))
        beyond = x + y > 1
        x, y = np.where(beyond, 1 - x, x), np.where(beyond, 1 - y, y)
        a, b = self.corners[1] - self.corners[0], self.corners[2] - self.corners[0]
        vector = np.cross(a, b)
        area = float(np.linalg.norm(vector))
        at = self.corners[0] + x[:, None] * a + y[:, None] * b
        return at, np.tile(vector / area, (n, 1)), 0.5 * area

    def stops(self, x, d):
        """Möller & Trumbore 1997."""
        a, b = self.corners[1] - self.corners[0], self.corners[2] - self.corners[0]
        p = np.cross(d, b)
        whole = a @ p
        if abs(whole) < 1e-15:
            return np.zeros(len(x), bool)
        s = x - self.corners[0]
        u = s @ p / whole
        q = np.cross(s, a)
        v, t = q @ d / whole, q @ b / whole
        return (u >= 0) & (v >= 0) & (u + v <= 1) & (t > EPS)


def flux(shining, stopping, sun: Floats, obs: Floats, n: int) -> Floats:
    """Σ ρ A/(π n) μ₀ μ over points that are lit and seen, for directions (T, 3).

    shining : list of (surface, reflectance ρ, share of n); stopping : surfaces
    """
    made = [(*surface.points(max(1, int(n * share))), rho) for surface, rho, share in shining]
    result = np.zeros(len(sun))
    for k, (s, o) in enumerate(zip(sun, obs, strict=True)):
        for at, normals, area, rho in made:
            mu0, mu = normals @ s, normals @ o
            mine = np.flatnonzero((mu0 > 0) & (mu > 0))
            for d in (s, o):
                for surface in stopping:
                    if len(mine):
                        mine = mine[~surface.stops(at[mine], d)]
            result[k] += rho / np.pi * area / len(at) * float(mu0[mine] @ mu[mine])
    return result
