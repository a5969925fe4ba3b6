"""The text and figures of `lcbayes single-facet`."""

from __future__ import annotations

from typing import Any

import numpy as np

from lcbayes.analysis.light_curve_plots import runs
from lcbayes.analysis.sky_plots import mollweide, place
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import DATA, FAINT, Gallery, colour
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.separated.single_facet import SURE, Edge, SingleFacet

SIDES = {  # of laws with z towards nadir and x along the direction of flight
    "forward": [1, 0, 0],
    "aft": [-1, 0, 0],
    "nadir": [0, 0, 1],
    "zenith": [0, 0, -1],
    "the right of the flight": [0, 1, 0],
    "the left of the flight": [0, -1, 0],
}
FLYING = ("lvlh", "velocity", "ram", "ground-track")


def words(result: SingleFacet) -> list[str]:
    """The result as lines of text, without the verdict."""
    lines = remarks(result)
    start = result.seen.t.min()
    for e in [] if result.reasons else result.edges:
        seen = f" as seen from {e.site}" if e.site else ""
        lines.append(
            f"the facet {_change(e)}{seen} at t = {e.t - start:.1f} ± {e.error:.1f} s ({e.kind})"
        )
    return lines


def table(result: SingleFacet) -> Listing:
    """A row for each edge, if there are any to be trusted."""
    heads = ("time from the first point (s)", "sd (s)", "the facet", "cause", "pass", "site")
    start = result.seen.t.min()
    rows = [
        (
            f"{e.t - start:.1f}",
            f"{e.error:.1f}",
            _change(e),
            e.kind,
            str(e.one_pass + 1),
            e.site or "–",
        )
        for e in ([] if result.reasons else result.edges)
    ]
    return Listing("edges", heads, rows)


def remarks(result: SingleFacet) -> list[str]:
    """What the text says besides the edges."""
    lines = [
        f"{len(result.seen.t)} points in {len(np.unique(result.seen.one_pass))} pass(es); "
        f"chi2 {result.chi2:.1f} for {result.dof} degrees of freedom; an edge by chance: "
        f"p = {result.p_value:.3f}"
    ]
    if result.reasons:
        return lines
    lon, lat = lon_lat_deg(result.normal[None])
    lines.append(
        f"the facet's normal, body axes of {result.law}: azimuth {lon[0]:.1f} deg, latitude "
        f"{lat[0]:.1f} deg{_side(result)}; with 90 % probability within "
        f"{result.radius_deg:.1f} deg of it, in a region of "
        f"{result.area_sr * np.degrees(1.0) ** 2:.3g} square degrees"
    )
    likely = max(result.kind, key=lambda name: result.kind[name])
    sure = result.kind[likely]
    if sure >= SURE:
        lines.append(f"cause of the edges: {_kind(likely)} (probability {sure:.3f})")
    else:
        odds = ", ".join(f"{k} {v:.2f}" for k, v in result.kind.items() if v >= 0.01)
        lines.append(f"the data do not determine the cause of the edges: {odds}")
    if np.isfinite(result.albedo_area):
        lines.append(f"albedo times area {result.albedo_area:.3g} m² (Lambertian)")
    return lines


def _change(edge: Edge) -> str:
    return "appears" if edge.brightens else "disappears"


def _kind(name: str) -> str:
    return {
        "visibility": "the facet turns into or out of view (visibility)",
        "illumination": "the facet turns into or out of sunlight (illumination)",
        "both": "illumination and visibility change, one after the other",
        "none": "none, the facet is illuminated and visible throughout",
    }[name]


def _side(result: SingleFacet) -> str:
    if result.law not in FLYING:
        return ""
    angle = {k: np.degrees(np.arccos(np.clip(result.normal @ v, -1, 1))) for k, v in SIDES.items()}
    near = min(angle, key=lambda k: angle[k])
    return f" ({angle[near]:.0f} deg from {near})"


def draw(result: SingleFacet, gallery: Gallery) -> None:
    """The curve with its edges, and the region on the sphere."""
    draw_edges(result, gallery)
    draw_region(result, gallery)


def draw_edges(result: SingleFacet, gallery: Gallery) -> None:
    """Flux at unit distance with the best fit, the fit without the facet, and the edges."""
    seen = result.seen
    passes = np.unique(seen.one_pass)[:6]
    figure = gallery.figure(6.6, 3.2)
    axes = figure.subplots()
    start, size = seen.t.min(), 10.0 ** np.floor(np.log10(np.abs(seen.flux).max()))
    apart = len(passes) > 1 and np.ptp(seen.t) > 5400.0
    for k, i in enumerate(passes):
        first = seen.t[seen.one_pass == i].min() if apart else start
        _draw_pass(axes, result, i, first, size, colour(k))
    drawn = seen.flux[np.isin(seen.one_pass, passes)] / size
    margin = 0.1 * np.ptp(drawn) or 1.0  # the fit without the facet may lie far outside
    axes.set_ylim(drawn.min() - margin, drawn.max() + margin)
    axes.plot([], [], "o", ms=2.8, mfc=FAINT, mec=DATA, mew=0.5, label="observed")
    axes.plot([], [], lw=0.9, ls="--", color=FAINT, label="without the facet")
    axes.plot([], [], lw=0.8, ls=":", color=FAINT, label="edge")
    axes.set_xlabel("time since the start of the pass (s)")
    unit = "m²" if np.isfinite(result.albedo_area) else "file's unit"
    power = int(np.log10(size))
    axes.set_ylabel(
        f"flux at unit distance ($10^{{{power}}}$ {unit})"
        if power
        else f"flux at unit distance ({unit})"
    )
    figure.legend(loc="outside lower center", ncols=4)
    gallery.add(
        figure,
        "edge",
        "Light curve with the facet's edges.",
        "Flux at unit distance, the best fit, and its part without the facet.",
    )


def _draw_pass(
    axes: Any, result: SingleFacet, one: int, start: float, size: float, hue: str
) -> None:
    """Points, fit and edges of one pass, with time from ``start`` and flux in units of ``size``."""
    seen = result.seen
    here = np.flatnonzero(seen.one_pass == one)
    t = seen.t[here] - start
    edges = [e for e in result.edges if e.one_pass == one]
    site = edges[0].site if edges else ""
    name = f"site {site}" if site else f"pass {one + 1}"
    axes.plot(t, seen.flux[here] / size, "o", ms=2.8, mfc=hue, mec=DATA, mew=0.5)
    for j, run in enumerate(runs(t)):
        label = "_" if j else f"fit, {name}"
        axes.plot(t[run], result.model[here[run]] / size, lw=1.4, color=hue, label=label)
        axes.plot(t[run], result.smooth[here[run]] / size, lw=0.9, ls="--", color=hue)
    for e in edges:
        axes.axvline(e.t - start, color=hue, lw=0.8, ls=":")


def draw_region(result: SingleFacet, gallery: Gallery) -> None:
    """The region of the facet's normal, in the body axes of the law."""
    figure = gallery.figure(5.8, 3.2)
    axes = mollweide(figure)
    cloud = result.normals[result.region]
    cloud = cloud[:: max(1, len(cloud) // 4000)]
    x, y = place(*lon_lat_deg(cloud))
    axes.plot(x, y, ".", ms=3, mew=0, color=colour(0), label="90 % region", rasterized=True)
    x, y = place(*lon_lat_deg(result.normal[None]))
    axes.plot(x, y, "o", ms=13, mfc="none", mec=DATA, mew=1.2, label="best normal")
    if result.law in FLYING:
        for name, v in SIDES.items():
            x, y = place(*lon_lat_deg(np.array([v], float)))
            short = name.split()[1] if name.startswith("the ") else name
            shift = (-14, -9) if name == "aft" else (0, 8 * np.sign(y[0]) if y[0] else -9)
            axes.annotate(
                short,
                (abs(x[0]) if name == "aft" else x[0], y[0]),
                shift,
                textcoords="offset points",
                fontsize=7.5,
                color=DATA,
                ha="center",
                va="center",
                annotation_clip=False,
            )
        axes.set_yticks(np.radians([-60, -30, 30, 60]))
    figure.legend(loc="outside lower center", ncols=2, markerscale=1.5)
    gallery.add(
        figure,
        "normal",
        "Region of the facet's normal.",
        f"Possible directions of the facet normal, in the body axes of {result.law}.",
    )
