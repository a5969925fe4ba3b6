"""Simulated light curves of asteroids that a convex body of uniform albedo does not describe.

Plain NumPy, without any code of the package: a brick with flat faces, a contact binary of two
overlapping spheres that shade each other, and an ellipsoid with a dark spot. Asteroid and Earth
move on circular orbits, and the file is that of DAMIT: dense relative curves without errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

N_CURVES, N_POINTS = 6, 50  # nights, and points of each
NIGHT_H = 7.0
NOISE = 0.01  # of the flux
LAMBERT = 0.1  # weight of the Lambert term beside Lommel and Seeliger's
MAX_PHASE = np.radians(25.0)
EARTH_YEAR = 365.25636  # days
N_PATCHES = 1500  # of a sphere
BODIES = ("ellipsoid", "brick", "binary", "spot")


@dataclass(frozen=True)
class Sphere:
    """A part that shades others: centre (3,) and radius."""

    centre: Floats
    radius: float


@dataclass(frozen=True)
class Surface:
    """Flat patches of a body: centres and outward normals (N, 3), areas and albedos (N,)."""

    centres: Floats
    normals: Floats
    areas: Floats
    albedo: Floats
    shading: tuple[Sphere, ...] = ()


@dataclass(frozen=True)
class Case:
    """A simulated set of curves with its truth; t in days, vectors in au, ecliptic."""

    t: Floats
    flux: Floats
    sun: Floats
    earth: Floats
    curve: NDArray[np.int64]
    pole: Floats
    period_h: float
    given_period_h: float


def patches(n: int = N_PATCHES) -> Floats:
    """Directions (n, 3) that share a sphere equally (a Fibonacci lattice)."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    angle = np.pi * (3.0 - np.sqrt(5.0)) * i
    flat = np.sqrt(1.0 - z * z)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def ellipsoid(axes: Floats, n: int = N_PATCHES) -> Surface:
    """Semi-axes (3,); patches are images of those of a sphere.

    A patch of the unit sphere with normal u becomes one with normal ∝ u/axes and the area
    a b c |u/axes| times its own.
    """
    u = patches(n)
    stretched = u / axes
    length = np.linalg.norm(stretched, axis=1)
    areas = 4.0 * np.pi / n * np.prod(axes) * length
    return Surface(u * axes, stretched / length[:, None], areas, np.ones(n))


def brick(sizes: Floats) -> Surface:
    """A rectangular block with edges (3,)."""
    normals = np.vstack([np.eye(3), -np.eye(3)])
    areas = np.tile(np.prod(sizes) / sizes, 2)
    return Surface(0.5 * normals * sizes, normals, areas, np.ones(6))


def binary(radii: tuple[float, float], distance: float, n: int = N_PATCHES) -> Surface:
    """Two spheres on the x axis; what lies inside the other sphere is left out."""
    spheres = (
        Sphere(np.array([0.0, 0.0, 0.0]), radii[0]),
        Sphere(np.array([distance, 0.0, 0.0]), radii[1]),
    )
    u = patches(n)
    parts = []
    for one, other in (spheres, spheres[::-1]):
        at = one.centre + one.radius * u
        out = np.linalg.norm(at - other.centre, axis=1) > other.radius
        area = np.full(int(out.sum()), 4.0 * np.pi * one.radius**2 / n)
        parts.append((at[out], u[out], area))
    centres, normals, areas = (np.concatenate(x) for x in zip(*parts, strict=True))
    return Surface(centres, normals, areas, np.ones(areas.size), spheres)


def with_spot(surface: Surface, direction: Floats, radius: float, albedo: float) -> Surface:
    """The surface with another albedo on the patches within an angle of a direction (3,)."""
    toward = surface.centres / np.linalg.norm(surface.centres, axis=1, keepdims=True)
    inside = toward @ (direction / np.linalg.norm(direction)) > np.cos(radius)
    return Surface(
        surface.centres,
        surface.normals,
        surface.areas,
        np.where(inside, albedo, surface.albedo),
        surface.shading,
    )


def free(surface: Surface, toward: Floats) -> NDArray[np.bool_]:
    """Whether the ray from each patch in the direction (3,) meets no sphere, (N,)."""
    clear = np.ones(len(surface.areas), bool)
    for sphere in surface.shading:
        away = surface.centres - sphere.centre
        along = away @ toward
        distance2 = np.sum(away * away, axis=1) - along**2
        outside = np.sum(away * away, axis=1) > (sphere.radius * (1.0 + 1e-9)) ** 2
        clear &= ~((distance2 < sphere.radius**2) & (along < 0.0) & outside)
    return clear


def flux(surface: Surface, sun: Floats, obs: Floats, c: float = LAMBERT) -> Floats:
    """Flux (T,) for unit vectors (T, 3) in the body frame: Σ w A [μ₀μ/(μ₀ + μ) + c μ₀μ]."""
    result = np.zeros(len(sun))
    for k, (s, o) in enumerate(zip(sun, obs, strict=True)):
        mu0, mu = surface.normals @ s, surface.normals @ o
        seen = (mu0 > 0) & (mu > 0)
        if surface.shading:
            seen &= free(surface, s) & free(surface, o)
        mu0, mu = mu0[seen], mu[seen]
        law = mu0 * mu / (mu0 + mu) + c * mu0 * mu
        result[k] = np.sum((surface.albedo * surface.areas)[seen] * law)
    return result


def unit(v: Floats) -> Floats:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def to_body(vectors: Floats, pole: Floats, angle: Floats) -> Floats:
    """Components (T, 3) in the frame of a body turned by the angles (T,) about its pole (3,)."""
    lon, lat = np.arctan2(pole[1], pole[0]), np.arcsin(pole[2])
    x = np.array([np.sin(lat) * np.cos(lon), np.sin(lat) * np.sin(lon), -np.cos(lat)])
    y = np.array([-np.sin(lon), np.cos(lon), 0.0])
    a, b = vectors @ x, vectors @ y
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([cos * a + sin * b, cos * b - sin * a, vectors @ pole], axis=1)


def draw_surface(rng: np.random.Generator, kind: str) -> Surface:
    """A random body of one of `BODIES`, longest along x and shortest along the spin axis."""
    if kind == "brick":
        return brick(np.array([1.0, rng.uniform(0.6, 0.85), rng.uniform(0.45, 0.6)]))
    if kind == "binary":
        second = rng.uniform(0.65, 0.95)
        return binary((1.0, second), rng.uniform(0.75, 0.95) * (1.0 + second))
    smooth = ellipsoid(np.array([1.0, rng.uniform(0.65, 0.9), rng.uniform(0.5, 0.65)]))
    if kind == "ellipsoid":
        return smooth
    angle, height = rng.uniform(0.0, 2 * np.pi), rng.uniform(-0.4, 0.4)
    toward = np.array([np.cos(angle), np.sin(angle), height])
    return with_spot(smooth, toward, np.radians(rng.uniform(25.0, 40.0)), rng.uniform(0.5, 0.7))


def orbits(rng: np.random.Generator):
    """Functions of time in days: heliocentric asteroid and Earth, (T, 3) au each."""
    a, tilt = rng.uniform(2.2, 3.0), np.radians(rng.uniform(3.0, 12.0))
    node, start, earth_start = rng.uniform(0.0, 2 * np.pi, 3)

    def asteroid(t: Floats) -> Floats:
        u = start + 2 * np.pi * t / (EARTH_YEAR * a**1.5)
        x, y = np.cos(u), np.sin(u) * np.cos(tilt)
        cos, sin = np.cos(node), np.sin(node)
        return a * np.stack([cos * x - sin * y, sin * x + cos * y, np.sin(u) * np.sin(tilt)], 1)

    def earth(t: Floats) -> Floats:
        u = earth_start + 2 * np.pi * t / EARTH_YEAR
        return np.stack([np.cos(u), np.sin(u), 0.0 * u], axis=1)

    return asteroid, earth


def draw_case(kind: str, seed: int) -> Case:
    """A random body, pole, period and orbit, on six nights of some six years.

    The nights are random ones at phase angles below 25°, at least 20 days apart. The period that
    the user knows is wrong by a third of the difference of neighbouring solutions.
    """
    rng = np.random.default_rng([20240202, BODIES.index(kind), seed])
    surface = draw_surface(rng, kind)
    asteroid, earth = orbits(rng)
    pole = unit(rng.normal(size=3))
    period = rng.uniform(4.0, 12.0)
    days = np.arange(0.0, 6 * EARTH_YEAR)
    toward_sun, toward_earth = unit(-asteroid(days)), unit(earth(days) - asteroid(days))
    good = days[np.sum(toward_sun * toward_earth, axis=1) > np.cos(MAX_PHASE)]
    nights: list[float] = []
    for day in rng.permutation(good):
        if all(abs(day - other) > 20.0 for other in nights):
            nights.append(float(day))
        if len(nights) == N_CURVES:
            break
    nights.sort()
    t = np.concatenate([n + np.sort(rng.uniform(0, NIGHT_H / 24.0, N_POINTS)) for n in nights])
    position = asteroid(t)
    sun, to_earth = -position, earth(t) - position
    angle = rng.uniform(0.0, 2 * np.pi) + 2 * np.pi * 24.0 * (t - t[0]) / period
    bright = flux(surface, to_body(unit(sun), pole, angle), to_body(unit(to_earth), pole, angle))
    bright *= 1.0 + NOISE * rng.standard_normal(t.size)
    step = period**2 / (2 * 24.0 * np.ptp(t))
    given = period + step * rng.uniform(-1 / 3, 1 / 3)
    curve = np.repeat(np.arange(len(nights)), N_POINTS)
    return Case(t, bright, sun, to_earth, curve, pole, period, given)


def write(case: Case, path: Path) -> None:
    """The curves in DAMIT's format: relative, with Sun and Earth seen from the asteroid in au."""
    numbers = np.unique(case.curve)
    lines = [str(len(numbers))]
    for k in numbers:
        rows = np.flatnonzero(case.curve == k)
        lines.append(f"{len(rows)} 0")
        level = case.flux[rows].mean()
        for i in rows:
            vectors = " ".join(f"{x:.10f}" for x in (*case.sun[i], *case.earth[i]))
            lines.append(f"{2451545.0 + case.t[i]:.8f} {case.flux[i] / level:.8f} {vectors}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
