"""The shape: a convex polyhedron if the facets close, else each facet as a disc on a sphere; the
parts of a known body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.known_body import KnownShape, known_shape
from lcbayes.analysis.quantities import facet_normals
from lcbayes.analysis.style import FAINT, Gallery, Image, colour, hue
from lcbayes.core.errors import InputError
from lcbayes.core.text import join_words
from lcbayes.geometry.spherical import unit_vector
from lcbayes.physics.bodies.closure import close, closure
from lcbayes.physics.bodies.minkowski import minkowski
from lcbayes.physics.bodies.polyhedron import Polyhedron

Floats = NDArray[np.float64]

CLOSED = 0.1  # maximum gap |Σ A n|/Σ A of a closed body
STONE = (0.80, 0.81, 0.83)
LIGHT = np.array([-0.35, 0.45, 0.82])  # in image axes: right, up, towards the reader


@dataclass(frozen=True)
class Shape:
    """``scene`` is JSON for the viewer; ``image`` is for print."""

    mode: Mode
    image: Image
    scene: dict[str, Any]
    body: Polyhedron | None
    caption: str
    known: KnownShape | None = None


def build(results: Results, mode: Mode, gallery: Gallery) -> Shape | None:
    """The shape of a solution, from the posterior mean of its albedo-areas and normals."""
    if (known := known_shape(results, mode)) is not None:
        return _known(mode, known, gallery)
    if "albedo_area" not in mode.draws:
        return None
    areas = mode.draws["albedo_area"].mean(("chain", "draw")).to_numpy()
    normals, drawn = results.normals, facet_normals(mode)
    if drawn is not None:
        mean = drawn.mean(axis=(0, 1))
        normals = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)
    if normals is None or areas.ndim != 1:
        return None
    body, why = _polyhedron(normals, areas)
    if body is not None:
        size = float(np.max(np.linalg.norm(body.vertices, axis=1)))
        faces = [body.vertices[f] / size for f in body.faces]
        hues = [STONE] * len(faces)
        extent = _proportions(body)
        caption = (
            "The convex body whose facets have the posterior mean albedo-areas, on the assumption "
            f"that all of it reflects alike. Longest, middle and shortest extent are as {extent}."
        )
    else:
        faces, hues = _discs(normals, areas)
        caption = (
            f"{why} Each facet is drawn as a disc on a sphere, turned to where it faces, with an "
            "area in proportion to its albedo-area."
        )
    scene = {
        "polygons": _polygons(faces, hues),
        "solid": body is not None,
        "labels": [] if body is not None else np.round(1.02 * normals, 4).tolist(),
        "axis": _axis(mode) if _turns(mode) else None,
    }
    name, alt = f"shape-{mode.index + 1}", f"Shape of {mode.name.lower()} from three sides."
    image = draw_views(faces, hues, gallery, name, alt, caption, scene["labels"])
    return Shape(mode, image, scene, body, caption)


def _known(mode: Mode, known: KnownShape, gallery: Gallery) -> Shape:
    """The parts of a known body, coloured by material."""
    from matplotlib.colors import to_rgb

    caption = "The body as its file describes it."
    colours = [STONE]
    if len(known.names) > 1:
        colours = [to_rgb(colour(i)) for i in range(len(known.names))]
        materials = join_words([f"{name} ({hue(i)})" for i, name in enumerate(known.names)])
        caption = f"The body as its file describes it, coloured by material: {materials}."
    hues = [colours[i] for i in known.material]
    scene = {
        "polygons": _polygons(known.tiles, hues),
        "solid": True,
        "parts": True,
        "labels": [],
        "axis": _axis(mode),
    }
    name, alt = f"shape-{mode.index + 1}", f"The body of {mode.name.lower()} from three sides."
    image = draw_views(known.tiles, hues, gallery, name, alt, caption)
    return Shape(mode, image, scene, None, caption, known)


def _polygons(
    faces: Sequence[Floats], hues: Sequence[tuple[float, float, float]]
) -> list[dict[str, Any]]:
    return [
        {"p": np.round(f, 4).tolist(), "c": [round(float(x), 3) for x in h]}
        for f, h in zip(faces, hues, strict=True)
    ]


def _polyhedron(normals: Floats, areas: Floats) -> tuple[Polyhedron | None, str]:
    """The body, or the reason in words why there is none."""
    if len(areas) < 4:
        return None, f"{len(areas)} facet{'s' * (len(areas) > 1)} cannot enclose a body."
    gap = closure(normals, areas)
    if gap > CLOSED:
        return None, (
            f"The facets do not close (gap {gap:.2f} of their total area, at most {CLOSED} is "
            "needed), so no convex body has them."
        )
    try:
        return minkowski(normals, close(normals, areas)), ""
    except InputError as fault:
        return None, f"No convex body was constructed ({fault})."


def _proportions(body: Polyhedron) -> str:
    """Extents along the principal axes of inertia, shortest = 1."""
    extent = np.sort(body.dimensions)[::-1]
    return " : ".join(f"{x / extent[-1]:.2f}" for x in extent)


def _discs(normals: Floats, areas: Floats) -> tuple[list[Floats], list[tuple[float, float, float]]]:
    from matplotlib.colors import to_rgb

    turn = np.linspace(0, 2 * np.pi, 28, endpoint=False)
    radius = 0.62 * np.sqrt(areas / areas.max())
    discs = []
    for n, r in zip(normals, radius, strict=True):
        helper = np.eye(3)[np.argmin(np.abs(n))]
        u = np.cross(n, helper)
        u /= np.linalg.norm(u)
        v = np.cross(n, u)
        discs.append(n + r * (np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v))
    return discs, [to_rgb(colour(i)) for i in range(len(areas))]


def _turns(mode: Mode) -> bool:
    return "omega" in mode.draws or "period_h" in mode.draws


def _axis(mode: Mode) -> list[float]:
    """Spin axis in the body frame: z for a pole, else ω at t = 0, where A is the identity unless it
    is a parameter; then that of the first draw, for a body may look the same in several attitudes.
    """
    if "attitude" in mode.draws:
        first = mode.draws.isel(chain=0, draw=0)
        omega = first["attitude"].to_numpy().T @ first["omega"].to_numpy()
        return np.round(omega / max(float(np.linalg.norm(omega)), 1e-300), 4).tolist()
    if "omega" in mode.draws:
        omega = mode.draws["omega"].mean(("chain", "draw")).to_numpy()
        return np.round(omega / max(float(np.linalg.norm(omega)), 1e-300), 4).tolist()
    return [0.0, 0.0, 1.0]


def _view(lon: float, lat: float) -> Floats:
    """Unit vectors (rows) right, up and towards a reader at this longitude and latitude."""
    a, b = np.radians([lon, lat])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    towards = unit_vector(a, b)
    return np.stack([right, np.cross(towards, right), towards])


def draw_views(
    faces: list[Floats],
    hues: Sequence[tuple[float, float, float]],
    gallery: Gallery,
    name: str,
    alt: str,
    caption: str = "",
    labels: Sequence[Sequence[float]] = (),
) -> Image:
    """Three views, two from the equator and one from the pole, all with the same light.

    Faces within the unit sphere are those of a solid body. With ``labels``, the positions of the
    face numbers, the faces are discs, all of which are visible.
    """
    from matplotlib import patheffects
    from matplotlib.collections import PolyCollection

    figure = gallery.figure(6.4, 2.5)
    solid = not labels
    reach = 1.05 if solid else 1.45
    views = ((0, 0, "from longitude 0°"), (90, 0, "from longitude 90°"), (0, 90, "from the pole"))
    for axes, (lon, lat, title) in zip(figure.subplots(1, 3), views, strict=True):
        view = _view(lon, lat)
        turned = [f @ view.T for f in faces]
        normals = [_normal(f) for f in turned]
        order = [
            i
            for i in np.argsort([f[:, 2].mean() for f in turned])
            if not solid or normals[i][2] > 0
        ]
        shade = [_shade(hues[i], normals[i], 0.42 if solid else 0.8) for i in order]
        edge = "face" if solid else "#444444"
        if not solid:
            circle = np.linspace(0, 2 * np.pi, 80)
            axes.plot(np.cos(circle), np.sin(circle), color=FAINT, lw=0.7, zorder=0)
        axes.add_collection(
            PolyCollection(
                [turned[i][:, :2] for i in order], facecolors=shade, edgecolors=edge, linewidths=0.4
            )
        )
        for number, where in enumerate(labels):
            x, y, z = view @ np.array(where)
            text = axes.text(
                x,
                y,
                str(number),
                ha="center",
                va="center",
                fontsize=8,
                alpha=1.0 if z > 0 else 0.45,
            )
            text.set_path_effects([patheffects.withStroke(linewidth=2, foreground="white")])
        axes.set_xlim(-reach, reach)
        axes.set_ylim(-reach, reach)
        axes.set_aspect("equal")
        axes.axis("off")
        axes.set_title(title, fontsize=8.5)
    return gallery.add(figure, name, alt, caption)


def _normal(face: Floats) -> Floats:
    """Unit normal of a plane polygon, by Newell's formula."""
    n = np.sum(np.cross(face, np.roll(face, -1, axis=0)), axis=0)
    return n / max(float(np.linalg.norm(n)), 1e-300)


def _shade(
    hue: tuple[float, float, float], normal: Floats, dim: float
) -> tuple[float, float, float, float]:
    """Colour of a face under the light; ``dim`` is the brightness of a face turned away from it."""
    towards = normal if normal[2] > 0 else -normal
    light = dim + (1 - dim) * max(0.0, float(towards @ LIGHT / np.linalg.norm(LIGHT)))
    r, g, b = (min(1.0, light * x) for x in hue)
    return (r, g, b, 1.0 if normal[2] > 0 else 0.35)
