"""Prior of the shapes of asteroids for sparse points, from bodies simulated for this purpose.

    python benchmarks/shapes.py        writes lcbayes/inversion/attitude_scan/shapes.json

Bodies of four classes are drawn, and the linear model of `harmonics` is fitted to the brightness of
each from directions all around. The mean and the covariance of the coefficients over the bodies of
a class, and over all longitudes, are its prior. The bodies share no code and no distribution with
those of `_surveys`, which test the probabilities.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, HalfspaceIntersection
from scipy.special import sph_harm_y

from lcbayes.inversion.attitude_scan import harmonics

Floats = NDArray[np.float64]

N_BODIES, N_DIRECTIONS, N_POINTS = 150, 1500, 1200  # of a class; directions; corners of a body
SEED = 20261124
MAX_PHASE = 0.5  # rad
FILE = Path(__file__).parents[1] / "lcbayes" / "inversion" / "attitude_scan" / "shapes.json"
CLASSES = ("smooth", "cut", "boxy", "bilobed", "variegated")
PARTS = ("round", "medium", "elongated")


class Facets(NamedTuple):
    """Centres and outward normals (N, 3), areas and albedos (N,)."""

    centre: Floats
    normal: Floats
    area: Floats
    albedo: Floats


def unit(v: Floats) -> Floats:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def random_axes(rng: np.random.Generator) -> Floats:
    """Semi-axes, longest first: asteroids are rarely flatter than 2 : 1 or longer than 2.5 : 1."""
    b = np.clip(1.0 - abs(rng.normal(0.0, 0.28)), 0.4, 1.0)
    return np.array([1.0, b, b * rng.uniform(0.55, 1.0)])


def random_field(rng: np.random.Generator, u: Floats, degrees: range, fall: float) -> Floats:
    """A Gaussian random field on the sphere, variance of degree l as l^-fall, rms one."""
    theta, phi = np.arccos(np.clip(u[:, 2], -1, 1)), np.arctan2(u[:, 1], u[:, 0])
    field, total = np.zeros(len(u)), 0.0
    for degree in degrees:
        variance = degree**-fall
        total += variance
        for m in range(degree + 1):
            c = rng.normal(size=2) * np.sqrt(4 * np.pi * variance / (2 * degree + 1))
            y = sph_harm_y(degree, m, theta, phi) * (np.sqrt(2.0) if m else 1.0)
            field += c[0] * y.real + (c[1] * y.imag if m else 0.0)
    return field / np.sqrt(total)


def hull(corners: Floats) -> Facets:
    """The convex hull, in the axes of its inertia: shortest along z, longest along x."""
    found = ConvexHull(corners)
    a, b, c = (corners[found.simplices[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    outward = found.equations[:, :3]
    volume = np.abs(np.einsum("ij,ij->i", a, cross)) / 6.0
    volume *= np.sign(np.einsum("ij,ij->i", a, outward))
    middle = volume @ (a + b + c) / 4.0 / volume.sum()
    second = sum(
        np.einsum("i,ij,ik->jk", volume, p, q) * (2.0 if p is q else 1.0)
        for p in (a, b, c)
        for q in (a, b, c)
    ) / 20.0 / volume.sum() - np.outer(middle, middle)
    turn = np.linalg.eigh(second)[1][:, ::-1]
    turn[:, 2] *= np.sign(np.linalg.det(turn))
    centre = ((a + b + c) / 3.0 - middle) @ turn
    area = 0.5 * np.linalg.norm(cross, axis=1)
    return Facets(centre, outward @ turn, area, np.ones(len(area)))


def smooth(rng: np.random.Generator) -> Facets:
    """An ellipsoid with the relief of a Gaussian random field, without its hollows."""
    u = unit(rng.normal(size=(N_POINTS, 3)))
    relief = rng.uniform(0.0, 0.1) * random_field(rng, u, range(2, 9), 2.5)
    return hull(u * random_axes(rng) * np.exp(relief)[:, None])


def boxy(rng: np.random.Generator) -> Facets:
    """A superellipsoid, between an ellipsoid and a brick."""
    u = unit(rng.normal(size=(N_POINTS, 3)))
    power = np.exp(rng.uniform(np.log(4.0), np.log(40.0)))
    radius = np.sum(np.abs(u) ** power, axis=1) ** (-1.0 / power)
    return hull(u * radius[:, None] * random_axes(rng))


def cut(rng: np.random.Generator) -> Facets:
    """An ellipsoid cut by planes."""
    normal = unit(rng.normal(size=(rng.integers(8, 16), 3)))
    normal = np.vstack([normal, -np.eye(3), np.eye(3)])
    far = rng.uniform(0.75, 1.0, len(normal))
    far[-6:] = 1.15
    corners = HalfspaceIntersection(np.column_stack([normal, -far]), np.zeros(3)).intersections
    return hull(corners * random_axes(rng))


def variegated(rng: np.random.Generator) -> Facets:
    """A smooth body with albedo that varies on large scales, and a bright or dark area."""
    body = smooth(rng)
    u = unit(body.centre)
    albedo = np.exp(rng.uniform(0.0, 0.12) * random_field(rng, u, range(1, 5), 1.0))
    inside = u @ unit(rng.normal(size=3)) > np.cos(np.radians(rng.uniform(15.0, 60.0)))
    return body._replace(albedo=albedo * np.where(inside, np.exp(rng.normal(0.0, 0.35)), 1.0))


def facets_flux(body: Facets, sun: Floats, obs: Floats, lambert: float) -> Floats:
    """Brightness (T,) under Lommel and Seeliger's law with a Lambert term."""
    mu0, mu = (np.maximum(v @ body.normal.T, 0.0) for v in (sun, obs))
    both = mu0 * mu
    return (both / np.maximum(mu0 + mu, 1e-9) + lambert * both) @ (body.area * body.albedo)


def bilobed_flux(rng: np.random.Generator, sun: Floats, obs: Floats, lambert: float) -> Floats:
    """Two ellipsoids that touch or overlap along x, with shadows and occultations."""
    ratio = rng.uniform(0.5, 1.0)
    lobes = [
        np.array([1.0, rng.uniform(0.75, 1.0), rng.uniform(0.7, 0.95)]) * size
        for size in (1.0, ratio)
    ]
    apart = rng.uniform(0.65, 1.0) * (1.0 + ratio)
    centres = [np.zeros(3), np.array([apart, 0.0, 0.0])]
    total = np.zeros(len(sun))
    for k in range(2):
        u = unit(rng.normal(size=(700, 3)))
        normal = unit(u / lobes[k])
        area = np.prod(lobes[k]) * np.linalg.norm(u / lobes[k], axis=1)
        start = (u * lobes[k] + centres[k] - centres[1 - k]) / lobes[1 - k]
        out = np.sum(start**2, axis=1) > 1.0
        start, normal, area = start[out], normal[out], area[out]
        mu0, mu = (np.maximum(v @ normal.T, 0.0) for v in (sun, obs))
        for toward in (sun, obs):
            ray = toward / lobes[1 - k]
            along, length = ray @ start.T, np.sum(ray**2, axis=1)[:, None]
            meets = along**2 > length * (np.sum(start**2, axis=1) - 1.0)
            mu0[meets & (along < 0.0)] = 0.0
        both = mu0 * mu
        total += (both / np.maximum(mu0 + mu, 1e-9) + lambert * both) @ area
    return total


def directions(rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Unit vectors to Sun and observer in the body frame, with bisectors all around."""
    bisector = unit(rng.normal(size=(N_DIRECTIONS, 3)))
    across = unit(np.cross(bisector, rng.normal(size=bisector.shape)))
    half = 0.5 * rng.uniform(0.03, MAX_PHASE, N_DIRECTIONS)[:, None]
    along, aside = np.cos(half) * bisector, np.sin(half) * across
    return along + aside, along - aside


def log_flux(rng: np.random.Generator, kind: str, sun: Floats, obs: Floats) -> Floats:
    lambert = rng.uniform(0.0, 0.3)
    if kind == "bilobed":
        return np.log(bilobed_flux(rng, sun, obs, lambert))
    body = {"smooth": smooth, "cut": cut, "boxy": boxy, "variegated": variegated}[kind](rng)
    return np.log(facets_flux(body, sun, obs, lambert))


def coefficients(kind: str, number: int) -> Floats:
    """Coefficients (N, Q) of the columns of `harmonics.shape_columns` for bodies of a class."""
    found = []
    for i in range(number):
        rng = np.random.default_rng([SEED, CLASSES.index(kind), i])
        sun, obs = directions(rng)
        alpha = np.arccos(np.clip(np.sum(sun * obs, axis=1), -1.0, 1.0))
        shape = harmonics.shape_columns(unit(sun + obs), sun - obs, np.eye(3), np.zeros(len(sun)))
        fixed = np.column_stack([np.ones(len(sun)), harmonics.phase_columns(alpha)])
        columns = np.column_stack([fixed, np.asarray(shape)])
        y = log_flux(rng, kind, sun, obs)
        found.append(np.linalg.lstsq(columns, y, rcond=None)[0][fixed.shape[1] :])
    return np.array(found)


def moments(found: Floats) -> dict[str, list]:
    """Mean and covariance of a class over all longitudes and both senses of the z axis.

    Coefficients of different orders are then uncorrelated, as are those of even and odd powers of
    z. The real and the imaginary part of a complex coefficient have the same covariance, half the
    mean product of the coefficients.
    """
    orders, odd = harmonics.ORDERS, harmonics.ODD
    size, zonal = len(orders), orders == 0
    mean = np.where(zonal & ~odd, found.mean(axis=0), 0.0)
    less = found - mean
    covariance = np.zeros((size, size))
    rows = np.flatnonzero(zonal)
    covariance[np.ix_(rows, rows)] = less[:, rows].T @ less[:, rows] / len(found)
    real = np.flatnonzero(~zonal)[::2]
    complex_ = less[:, real] + 1j * less[:, real + 1]
    product = 0.5 * (complex_.T @ complex_.conj()).real / len(found)
    for part in (real, real + 1):
        covariance[np.ix_(part, part)] = product
    covariance[(orders[:, None] != orders) | (odd[:, None] != odd)] = 0.0
    return {"mean": _rounded(mean), "covariance": [_rounded(row) for row in covariance]}


def _rounded(row: Floats) -> list[float]:
    return [float(f"{x:.4g}") for x in row]


def parts(found: Floats) -> list[Floats]:
    """The bodies of a class by their elongation, in three equal parts."""
    u2 = int(np.flatnonzero(harmonics.ORDERS == 2)[0])
    order = np.argsort(np.hypot(found[:, u2], found[:, u2 + 1]))
    return [found[rows] for rows in np.array_split(order, len(PARTS))]


if __name__ == "__main__":
    number = int(sys.argv[1]) if len(sys.argv) > 1 else N_BODIES
    classes = {
        f"{kind}, {part}": moments(found)
        for kind in CLASSES
        for part, found in zip(PARTS, parts(coefficients(kind, number)), strict=True)
    }
    FILE.write_text(json.dumps(classes, indent=None) + "\n", encoding="utf-8")
    for kind, found in classes.items():
        sd = np.sqrt(np.diag(found["covariance"]))
        print(kind, np.round(sd, 3), np.round(found["mean"][:7], 3))
