"""Simulated survey asteroids at real epochs: cadences of Asteroids@home inputs, bodies, noise.

Plain NumPy and SciPy, without any code of the package. The noise is that of surveys: normal errors
of one level an object, an error that all points of a night share, and a few points far off.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from _asteroids import (
    Floats,
    Surface,
    binary,
    brick,
    ellipsoid,
    flux,
    patches,
    to_body,
    unit,
    with_spot,
)
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

HEADER = 14  # lines of settings in an input file of Asteroids@home
HULL_POINTS = 400
KINDS = ("ellipsoid", "convex", "brick", "binary", "spot")
NOISE = (0.005, 0.05)  # of the flux, log-uniform
NIGHT_NOISE = 0.03  # largest sd of the error of a night
FAR, FAR_TIMES = 0.02, 5.0  # share of points with errors this many times larger


@dataclass(frozen=True)
class Cadence:
    """Epochs: t in days, Sun and Earth (T, 3) au from the asteroid, flux, and curve numbers."""

    name: str
    jd: Floats
    sun: Floats
    earth: Floats
    flux: Floats
    curve: NDArray[np.int64]


@dataclass(frozen=True)
class Simulated:
    """A simulated object: its cadence with simulated flux, and the truth."""

    data: Cadence
    kind: str
    pole: Floats
    period_h: float
    noise: float
    amplitude: float


def folder() -> Path:
    given = os.environ.get("LCBAYES_DATA")
    root = Path(given) if given else Path(__file__).parents[2] / "shared" / "data"
    return root / "sparse-survey"


def read_cadence(path: Path) -> Cadence:
    """An input file of Asteroids@home."""
    lines = path.read_text(encoding="utf-8").splitlines()[HEADER:]
    at, rows, curve = 1, [], []
    for k in range(int(lines[0].split()[0])):
        count = int(lines[at].split()[0])
        rows += [[float(x) for x in line.split()] for line in lines[at + 1 : at + 1 + count]]
        curve += [k] * count
        at += 1 + count
    table = np.array(rows)
    name = path.name.removeprefix("period_search_in_")
    return Cadence(name, table[:, 0], table[:, 2:5], table[:, 5:8], table[:, 1], np.array(curve))


def draw_convex(rng: np.random.Generator) -> Surface:
    """The convex hull of an ellipsoid with hills and hollows."""
    axes = np.array([1.0, rng.uniform(0.6, 0.95), rng.uniform(0.45, 0.75)])
    u = patches(HULL_POINTS)
    centres = unit(rng.normal(size=(8, 3)))
    height = np.exp(3.0 * (u @ centres.T - 1.0)) @ rng.normal(0.0, 0.12, 8)
    corners = u * axes * np.exp(height)[:, None]
    hull = ConvexHull(corners)
    a, b, c = (corners[hull.simplices[:, k]] for k in range(3))
    cross = 0.5 * np.cross(b - a, c - a)
    areas = np.linalg.norm(cross, axis=1)
    return Surface((a + b + c) / 3.0, hull.equations[:, :3], areas, np.ones(len(areas)))


def draw_surface(rng: np.random.Generator, kind: str) -> Surface:
    """A random body of one of `KINDS`, longest along x and shortest along the spin axis."""
    if kind == "convex":
        return draw_convex(rng)
    if kind == "brick":
        return brick(np.array([1.0, rng.uniform(0.6, 0.85), rng.uniform(0.45, 0.6)]))
    if kind == "binary":
        second = rng.uniform(0.65, 0.95)
        return binary((1.0, second), rng.uniform(0.75, 0.95) * (1.0 + second), len(patches()) // 2)
    smooth = ellipsoid(np.array([1.0, rng.uniform(0.6, 0.95), rng.uniform(0.45, 0.6)]))
    if kind == "ellipsoid":
        return smooth
    toward = np.append(unit(rng.normal(size=2)), rng.uniform(-0.4, 0.4))
    return with_spot(smooth, toward, np.radians(rng.uniform(25.0, 40.0)), rng.uniform(0.5, 0.7))


def draw_period(rng: np.random.Generator) -> float:
    """Hours: as known asteroids, near 8 h with a fifth of slow rotators."""
    if rng.uniform() < 0.2:
        return float(np.exp(rng.uniform(np.log(20.0), np.log(900.0))))
    return float(np.clip(np.exp(rng.normal(np.log(8.0), 0.5)), 2.2, 100.0))


def draw(cadence: Cadence, kind: str, seed: int) -> Simulated:
    """A body, pole, period, phase law and noise drawn anew at the epochs of a cadence."""
    rng = np.random.default_rng([20261123, KINDS.index(kind), seed])
    surface, pole, period = draw_surface(rng, kind), unit(rng.normal(size=3)), draw_period(rng)
    sun, earth = unit(cadence.sun), unit(cadence.earth)
    days = cadence.jd - cadence.jd[0]
    angle = rng.uniform(0.0, 2 * np.pi) + 2 * np.pi * 24.0 * days / period
    clean = flux(surface, to_body(sun, pole, angle), to_body(earth, pole, angle))
    amplitude = 2.5 * np.log10(clean.max() / clean.min())
    alpha = np.arccos(np.clip(np.sum(sun * earth, axis=1), -1.0, 1.0))
    a, d, k = rng.uniform(0.2, 0.6), rng.uniform(0.05, 0.15), rng.uniform(-1.0, -0.4)
    clean *= a * np.exp(-alpha / d) + k * alpha + 1.0
    noise = float(np.exp(rng.uniform(*np.log(NOISE))))
    night = np.unique(np.floor(cadence.jd), return_inverse=True)[1]
    shared = rng.uniform(0.0, NIGHT_NOISE) * rng.standard_normal(night.max() + 1)[night]
    own = noise * rng.standard_normal(days.size)
    own *= np.where(rng.uniform(size=days.size) < FAR, FAR_TIMES, 1.0)
    observed = clean * np.maximum(1.0 + own + shared, 0.05)
    data = Cadence(cadence.name, cadence.jd, cadence.sun, cadence.earth, observed, cadence.curve)
    return Simulated(data, kind, pole, period, noise, float(amplitude))
