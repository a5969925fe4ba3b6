"""Figures of an albedo-area distribution: the map of directions, the fit, the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.shape_plots import STONE, draw_views
from lcbayes.analysis.sky_plots import draw_line, mollweide, nearest_pixels, place
from lcbayes.analysis.style import DATA, FAINT, Gallery, colour
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.albedo_area.inversion import Inversion

Floats = NDArray[np.float64]


def draw(result: Inversion, gallery: Gallery) -> None:
    """All figures, as SVG in the gallery's folder."""
    draw_map(result, gallery)
    draw_fit(result, gallery)
    if result.shape is not None:
        draw_shape(result, gallery)


def draw_shape(result: Inversion, gallery: Gallery) -> None:
    """The convex body from three sides."""
    body = result.shape
    assert body is not None
    reach = float(np.max(np.linalg.norm(body.vertices, axis=1)))
    faces = [body.vertices[f] / reach for f in body.faces]
    draw_views(faces, [STONE] * len(faces), gallery, "shape", "Shape from three sides.")


def draw_map(result: Inversion, gallery: Gallery) -> None:
    """Mollweide map of the body frame: density on the grid, facets as rings, the arc if any."""
    figure = gallery.figure(7.0, 3.6)
    axes = mollweide(figure)
    on_grid = result.on_grid
    count = int(np.sum(on_grid.which == 0))
    density = on_grid.areas.reshape(-1, count).sum(axis=0)
    lon_edges, lat_edges, pixels = nearest_pixels(on_grid.normals[:count])
    share = 100.0 * density / density.sum()
    # a square-root scale, so that 1 % is visible next to 50 %
    from matplotlib.colors import PowerNorm

    picture = axes.pcolormesh(
        np.radians(lon_edges),
        np.radians(lat_edges),
        share[pixels],
        cmap="Blues",
        norm=PowerNorm(0.5, 0.0, float(share.max())),
        rasterized=True,
    )
    axes.set_axisbelow(False)
    figure.colorbar(picture, ax=axes, label="share of a grid cell (%)", shrink=0.8, pad=0.03)
    for cue in result.cues:
        if cue.name == "arc" and cue.significant:
            circle = _circle(np.asarray(cue.details["pole"]))
            draw_line(axes, circle, color=DATA, lw=1.0, label="great circle of the arc")
    if result.facets is not None:
        facets = result.facets
        largest = facets.areas.max()
        for m, material in enumerate(result.materials):
            here = facets.which == m
            if not np.any(here):
                continue
            x, y = place(*lon_lat_deg(facets.normals[here]))
            axes.scatter(
                x,
                y,
                s=np.maximum(300.0 * facets.areas[here] / largest, 12.0),
                fc="none",
                ec=colour(m + 1),
                lw=1.3,
                zorder=4,
                clip_on=False,
                label=f"facets, {material.law}",
            )
        figure.legend(loc="outside lower center", ncols=3)
    gallery.add(
        figure,
        "albedo-area",
        "Map of the body frame: albedo-area that faces each direction.",
        "Albedo-area that faces each direction of the body frame, azimuth to the right, z at the "
        "top. Rings are the final facets; their size is proportional to area.",
    )


def draw_fit(result: Inversion, gallery: Gallery) -> None:
    """Observed and fitted flux, and residuals in units of the error."""
    figure = gallery.figure(7.0, 3.0)
    left, right = figure.subplots(1, 2)
    seen, fitted = result.seen, result.best.flux
    mean = np.bincount(seen.curve, seen.flux) / np.bincount(seen.curve)
    unit = np.where(mean > 0, mean, np.mean(seen.flux))[seen.curve]
    _plain(left)
    ends = [0.0, 1.05 * float(np.max(seen.flux / unit))]
    left.plot(ends, ends, color=FAINT, lw=0.8)
    left.plot(fitted / unit, seen.flux / unit, ".", ms=2.5, color=colour(0), rasterized=True)
    left.set_xlabel("fitted flux ÷ mean of the curve")
    left.set_ylabel("observed flux ÷ mean")
    residual = (seen.flux - fitted) / seen.error
    _plain(right)
    right.axhline(0.0, color=FAINT, lw=0.8)
    right.plot(residual, ".", ms=2.5, color=colour(0), rasterized=True)
    right.set_xlabel("point")
    right.set_ylabel("residual ÷ error")
    gallery.add(figure, "fit", "Observed and fitted flux, and residuals.", "Observed and fitted.")


def _plain(axes: Any) -> None:
    axes.locator_params(nbins=6)


def _circle(pole: Floats) -> Floats:
    u = np.asarray(np.cross(pole, np.eye(3)[np.argmin(np.abs(pole))]), float)
    u /= np.linalg.norm(u)
    v = np.asarray(np.cross(pole, u), float)
    turn = np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
    return np.cos(turn) * u + np.sin(turn) * v
