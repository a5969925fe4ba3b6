"""A body of known parts as a report draws it: tiles of one material each, and what blocks light.

Tiles are small, so that sorting them by depth hides what is behind, and each is wholly in shadow or
in sunlight.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.simulation.known_bodies.body import KnownBody
from lcbayes.simulation.known_bodies.reader import read_body_text, with_shadows

Floats = NDArray[np.float64]

TILES = 900  # about as many as a page can turn and shade in a hundredth of a second
MOST_BLOCKING = 200  # polygons that are tested for each tile
TOLERANCE = 0.03  # of curved parts, where a picture needs fewer panels than a fit
LONGEST = 3.0  # length of a tile over the side of a square one


@dataclass(frozen=True)
class KnownShape:
    """Polygons in body axes, all within the unit sphere about the centre of the surface.

    Attributes
    ----------
    tiles : of (n, 3)
    material : for each tile, its index in ``names``
    names : of the materials
    blocking : of (n, 3)
        Whole faces that shade the tiles; empty if the fit has no shadows or no part shades another.
    size : m
        Radius of the unit sphere.
    """

    tiles: list[Floats]
    material: list[int]
    names: list[str]
    blocking: list[Floats]
    size: float

    def scaled(self, by: float) -> KnownShape:
        """The same body within a sphere of radius ``by``."""
        tiles, blocking = ([by * p for p in each] for each in (self.tiles, self.blocking))
        return KnownShape(tiles, self.material, self.names, blocking, self.size / by)


def known_shape(results: Results, mode: Mode) -> KnownShape | None:
    """The body of a fit of `models/body.py`, with the posterior mean of lengths that are unknown.

    Returns
    -------
    KnownShape or None
        None if the fit is of another model.
    """
    names = unknown_lengths(results)
    if names is None or not all(name in mode.draws for name in names.values()):
        return None
    return _with_lengths(results, {k: float(mode.draws[name].mean()) for k, name in names.items()})


def known_draws(results: Results, mode: Mode, rows: NDArray[np.int64]) -> list[KnownShape]:
    """The body of each draw, on one scale; a single one if all its lengths are known.

    Parameters
    ----------
    rows : (n,)
        Draws of all chains, one after the other.
    """
    names = unknown_lengths(results) or {}
    lengths = {
        key: mode.draws[name].transpose("chain", "draw").to_numpy().ravel()[rows]
        for key, name in names.items()
    }
    each = [
        _with_lengths(results, {key: float(values[i]) for key, values in lengths.items()})
        for i in range(len(rows) if lengths else 1)
    ]
    largest = max(shape.size for shape in each)
    return [shape.scaled(shape.size / largest) for shape in each]


def unknown_lengths(results: Results) -> dict[tuple[int, str], str] | None:
    """The variable of each length of the body that was fitted; None for another model."""
    text = (results.summary.get("model_options") or {}).get("body")
    if results.attrs.get("model") != "body" or not isinstance(text, str) or "\n" not in text:
        return None
    file = read_body_text(text)
    return {key: f"{file.body.names[key[0]]}_{key[1]}" for key in file.sizes}


def _with_lengths(results: Results, lengths: dict[tuple[int, str], float]) -> KnownShape:
    options = results.summary["model_options"]
    asked = bool(options.get("shadows", True))
    shaded = asked and read_body_text(options["body"]).body.assembly.shaded
    return shape_of(with_shadows(options["body"], lengths, TOLERANCE), shaded)


def shape_of(body: KnownBody, shaded: bool) -> KnownShape:
    """The tiles of a body; ``shaded``: whether its parts shade one another."""
    polygons = body.assembly.polygons
    areas = [_area(p) for p in polygons]
    centre = np.average([_middle(p) for p in polygons], axis=0, weights=areas)
    size = max(float(np.linalg.norm(p - centre, axis=1).max()) for p in polygons)
    scaled = [(p - centre) / size for p in polygons]
    edge = np.sqrt(sum(areas) / TILES) / size
    names = list(body.materials)
    tiles: list[Floats] = []
    material: list[int] = []
    for polygon, label in zip(scaled, body.assembly.body.labels, strict=True):
        parts = _tiled(polygon, edge)
        tiles += parts
        material += [names.index(label)] * len(parts)
    lone = len(body.assembly.parts) == 1 and body.assembly.parts[0].panels.convex
    blocking = scaled if shaded and not lone and len(scaled) <= MOST_BLOCKING else []
    return KnownShape(tiles, material, names, blocking, size)


def _fan(polygon: Floats) -> Floats:
    """Vectors (n, 3) along the normal, as long as twice the areas of triangles from one corner."""
    return np.cross(polygon - polygon[0], np.roll(polygon, -1, axis=0) - polygon[0])


def _area(polygon: Floats) -> float:
    return 0.5 * float(np.linalg.norm(_fan(polygon).sum(axis=0)))


def _middle(polygon: Floats) -> Floats:
    """Centre of the area of a convex polygon."""
    middles = (polygon[0] + polygon + np.roll(polygon, -1, axis=0)) / 3.0
    return np.average(middles, axis=0, weights=np.linalg.norm(_fan(polygon), axis=1))


def _tiled(polygon: Floats, edge: float) -> list[Floats]:
    """A convex polygon as quadrilaterals or triangles whose edges are about ``edge`` long."""
    if len(polygon) == 4:
        return _grid(polygon, edge)
    middle = polygon.mean(axis=0)
    following = np.roll(polygon, -1, axis=0)
    corners = [np.stack([middle, a, b]) for a, b in zip(polygon, following, strict=True)]
    return [tile for triangle in corners for tile in _bisected(triangle, 1.5 * edge)]


def _grid(corners: Floats, edge: float) -> list[Floats]:
    a, b, c, d = corners
    long = max(np.linalg.norm(b - a), np.linalg.norm(c - d))
    wide = max(np.linalg.norm(d - a), np.linalg.norm(c - b))
    if wide > long:
        return _grid(np.roll(corners, -1, axis=0), edge)
    n = max(1, round(float(wide) / edge))
    m = max(1, round(float(long * wide) / (n * edge**2)), round(float(long) / (LONGEST * edge)))
    u, v = np.linspace(0, 1, m + 1)[:, None, None], np.linspace(0, 1, n + 1)[None, :, None]
    p = (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * d + u * c)
    return [
        np.stack([p[i, j], p[i + 1, j], p[i + 1, j + 1], p[i, j + 1]])
        for i in range(m)
        for j in range(n)
    ]


def _bisected(triangle: Floats, edge: float) -> list[Floats]:
    sides = np.linalg.norm(triangle - np.roll(triangle, -1, axis=0), axis=1)
    k = int(np.argmax(sides))
    if sides[k] <= edge:
        return [triangle]
    a, b, c = np.roll(triangle, -k, axis=0)
    middle = 0.5 * (a + b)
    halves = (np.stack([a, middle, c]), np.stack([middle, b, c]))
    return [tile for half in halves for tile in _bisected(half, edge)]
