"""Maps of directions: facets on the body, spin axes on the sky."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.numerals import FRAMES
from lcbayes.analysis.quantities import constant_axis, facet_normals, readable, spin
from lcbayes.analysis.style import DATA, FAINT, Gallery, Image, colour
from lcbayes.geometry.spherical import lon_lat_deg, unit_vector

Floats = NDArray[np.float64]
CLOUD = 400


def frame_words(results: Results) -> str:
    return FRAMES.get(results.frame, results.frame)


def mollweide(figure: Any, position: Any = 111) -> Any:
    """An equal-area map with longitude 0 in the middle, east to the right, in degrees."""
    axes = figure.add_subplot(position, projection="mollweide")
    axes.grid(color="#d5d8dd", lw=0.5)
    axes.set_axisbelow(True)
    axes.set_longitude_grid_ends(90)
    ticks = np.arange(-120, 121, 60)
    axes.set_xticks(np.radians(ticks), [f"{t % 360}°" for t in ticks], fontsize=7.5, color=FAINT)
    axes.set_yticks(np.radians([-60, -30, 0, 30, 60]))
    axes.tick_params(axis="y", labelsize=7.5, labelcolor=FAINT)
    return axes


def place(lon: Floats, lat: Floats) -> tuple[Floats, Floats]:
    """Degrees converted to the map's radians, longitude in [−π, π)."""
    return np.radians((np.asarray(lon) + 180.0) % 360.0 - 180.0), np.radians(lat)


def draw_line(axes: Any, vectors: Floats, **how: Any) -> None:
    """A closed line through directions (N, 3), broken at the map's edge."""
    lon, lat = place(*lon_lat_deg(vectors))
    across = np.abs(np.diff(lon, append=lon[0])) > np.pi
    axes.plot(np.where(across, np.nan, lon), lat, **how)


def _some(array: Floats) -> Floats:
    """About `CLOUD` draws at most, evenly spaced, chains concatenated: (S, ...)."""
    flat = array.reshape(-1, *array.shape[2:])
    return flat[:: max(1, len(flat) // CLOUD)]


def draw_facets(results: Results, mode: Mode, gallery: Gallery) -> list[Image]:
    """Directions of the facet normals with uncertainty, or a colour map for a fixed grid."""
    if "albedo_area" not in mode.draws:
        return []
    areas = mode.draws["albedo_area"].transpose("chain", "draw", ...).to_numpy()
    normals = facet_normals(mode)
    if normals is None and results.normals is not None:
        return _draw_grid(results, mode, areas, gallery)
    if normals is None:
        return []
    figure = gallery.figure(5.4, 2.9)
    axes = mollweide(figure)
    largest = float(np.mean(areas, axis=(0, 1)).max())
    for i in range(areas.shape[-1]):
        hue = colour(i)
        lon, lat = place(*lon_lat_deg(_some(normals[:, :, i])))
        axes.plot(lon, lat, ".", ms=2.2, color=hue, alpha=0.35, mew=0, rasterized=True)
    for i in range(areas.shape[-1]):
        middle = normals[:, :, i].mean(axis=(0, 1))
        lon, lat = place(*lon_lat_deg(middle))
        size = 330 * float(np.mean(areas[..., i])) / largest
        axes.scatter(
            lon, lat, s=max(size, 20), fc="none", ec=colour(i), lw=1.4, zorder=4, clip_on=False
        )
        _number(axes, float(lon), float(lat), str(i))
    name = f"facets-{mode.index + 1}"
    caption = (
        f"{_prefix(results, mode)}Directions of the facet normals in the body frame (azimuth to "
        "the right, pole of the body axes at the top). A cloud shows the posterior draws; the area "
        "of a ring is the mean albedo-area of the facet, numbered as in posterior.nc."
    )
    alt = f"Map of the body frame with draws of {areas.shape[-1]} facet normals."
    return [gallery.add(figure, name, alt, caption)]


def _number(axes: Any, lon: float, lat: float, text: str) -> None:
    from matplotlib import patheffects

    label = axes.text(lon, lat, text, ha="center", va="center", fontsize=9, weight="bold", zorder=5)
    label.set_path_effects([patheffects.withStroke(linewidth=2.5, foreground="white")])


def _prefix(results: Results, mode: Mode) -> str:
    return f"{mode.name}. " if len(results.modes) > 1 else ""


def nearest_pixels(grid: Floats) -> tuple[Floats, Floats, NDArray[np.integer]]:
    """Edges of a map's pixels in longitude and latitude (deg), and the normal nearest to each."""
    from scipy.spatial import KDTree

    lon_edges, lat_edges = np.linspace(-180, 180, 181), np.linspace(-90, 90, 91)
    lon, lat = np.meshgrid(
        np.radians(0.5 * (lon_edges[1:] + lon_edges[:-1])),
        np.radians(0.5 * (lat_edges[1:] + lat_edges[:-1])),
    )
    pixels = unit_vector(lon, lat)
    return lon_edges, lat_edges, np.asarray(KDTree(grid).query(pixels)[1])


def _draw_grid(results: Results, mode: Mode, areas: Floats, gallery: Gallery) -> list[Image]:
    grid = results.normals
    assert grid is not None
    lon_edges, lat_edges, nearest = nearest_pixels(grid)
    mean = areas.mean(axis=(0, 1))
    spread = areas.std(axis=(0, 1)) / np.maximum(mean, 1e-300)
    images = []
    maps = (
        (
            "mean",
            mean / mean.mean(),
            "albedo-area ÷ mean facet",
            "viridis",
            "Albedo-area facing each direction of the body frame, posterior mean; the spin axis is "
            "at the top. Broad sides of the body are bright here.",
        ),
        (
            "sd",
            100 * spread,
            "standard deviation (%)",
            "magma_r",
            "How well each of them is known: its standard deviation in per cent of its mean.",
        ),
    )
    for key, values, label, cmap, caption in maps:
        figure = gallery.figure(5.4, 2.55)
        axes = mollweide(figure)
        picture = axes.pcolormesh(
            np.radians(lon_edges),
            np.radians(lat_edges),
            values[nearest],
            cmap=cmap,
            rasterized=True,
        )
        axes.tick_params(axis="x", labelcolor="white")
        figure.colorbar(picture, ax=axes, label=label, shrink=0.85, pad=0.03)
        name = f"facets-{mode.index + 1}-{key}"
        alt = f"Map of the body frame, {len(grid)} facets coloured by {label}."
        images.append(gallery.add(figure, name, alt, _prefix(results, mode) + caption))
    return images


def draw_sky(results: Results, gallery: Gallery) -> list[Image]:
    """Axes of all solutions on one map of the sky, and each solution enlarged."""
    clouds = []
    for mode in results.modes:
        known = {q.name: q for q in spin(results, mode)}
        for pair in (("pole_lon_deg", "pole_lat_deg"), ("axis_lon", "axis_lat")):
            if pair[0] in known and pair[1] in known:
                clouds.append((mode, known[pair[0]], known[pair[1]], known))
                break
    if not clouds:
        return []
    several = len(results.modes) > 1
    figure = gallery.figure(5.4, 3.2 if several else 2.8)
    axes = mollweide(figure)
    for mode, lon, lat, _ in clouds:
        x, y = place(_some(lon.values), _some(lat.values))
        axes.plot(x, y, ".", ms=3, color=colour(mode.index), alpha=0.4, mew=0, rasterized=True)
        x, y = place(np.array(lon.mean), np.array(lat.mean))
        axes.plot(
            x,
            y,
            "o",
            ms=11,
            mfc="none",
            mec=colour(mode.index),
            mew=1.4,
            clip_on=False,
            label=mode.name,
        )
    if several:
        figure.legend(loc="outside lower center", ncols=3)
    axis = constant_axis(results.modes[0].draws)
    caption = (
        f"Directions of the {axis} on the sky, {frame_words(results)}, longitude to the right. "
        "Clouds are draws; rings mark their means."
    )
    images = [gallery.add(figure, "spin-sky", f"Map of the sky with the {axis}.", caption)]
    images += [_enlarge(gallery, several, *cloud) for cloud in clouds[:4]]
    return images


def _enlarge(
    gallery: Gallery, several: bool, mode: Mode, lon: Any, lat: Any, known: dict[str, Any]
) -> Image:
    """The draws of one solution, with its rotation rate."""
    figure = gallery.figure(5.4, 2.7)
    left, right = figure.subplots(1, 2)
    figure.get_layout_engine().set(wspace=0.09)
    hue = colour(mode.index)
    dots = {"ms": 3, "color": hue, "alpha": 0.4, "mew": 0, "rasterized": True}
    left.plot(_some(lon.values), _some(lat.values), ".", **dots)
    left.plot(lon.mean, lat.mean, "+", ms=9, color=DATA)
    left.set_xlabel(f"{lon.words.split(', ')[-1]} (deg)")
    left.set_ylabel(f"{lat.words.split(', ')[-1]} (deg)")
    left.locator_params(nbins=5)
    speed = known.get("period_h") or known["rate"]
    centre, size, shift = readable(speed)
    values = (speed.values.ravel() - centre) / size
    right.hist(values, bins=40, color=hue, alpha=0.75, histtype="stepfilled")
    right.set_xlabel(f"{speed.words} {shift}".strip())
    right.set_yticks([])
    right.spines["left"].set_visible(False)
    right.locator_params(axis="x", nbins=5)
    who = f"{mode.name}, enlarged" if several else "Enlarged"
    axis = constant_axis(mode.draws)
    caption = f"{who}: direction of the {axis} and {speed.words}."
    alt = f"Draws of the {axis} and {speed.words} of {mode.name.lower()}."
    return gallery.add(figure, f"spin-{mode.index + 1}", alt, caption)
