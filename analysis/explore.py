"""The data of the interactive part of a report: points, bands, draws, bodies and attitudes.

Arrays are base64 of little-endian numbers, the large ones as 16-bit integers with an offset and a
step, so that 3,000 points with forty draws of two solutions take about a megabyte.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis import light_curve_plots, shape_plots
from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.explore_curve import MOST_POINTS, packed
from lcbayes.analysis.known_body import known_draws, unknown_lengths
from lcbayes.analysis.quantities import facet_normals
from lcbayes.analysis.style import colour
from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import variables
from lcbayes.modelling.ephemeris import frames
from lcbayes.modelling.facet_list import ARRAY, facet_list
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.attitude.torque_free import torque_free_to_body
from lcbayes.physics.bodies.closure import close
from lcbayes.physics.bodies.minkowski import minkowski

Floats = NDArray[np.float64]

DRAWS, SOLID_DRAWS = 40, 16  # of a solution; a convex body of each takes a tenth of a second
MOST_NUMBERS = 600_000  # draws × points
MOST_DIRECTIONS = 30_000  # draws × points of bodies that tumble
PERIODS = 200  # draws of the period


def payload(results: Results, modes: list[Mode], shapes: list[shape_plots.Shape]) -> Any:
    """Content of the JSON that the page explores; None if there are too many points."""
    if results.t.size > MOST_POINTS:
        return None
    segments = light_curve_plots.segments(results)
    order = np.concatenate([s.points for s in segments])
    sites, site = np.unique(
        results.labels.get("site", np.full(results.t.size, "")), return_inverse=True
    )
    label, power = light_curve_plots.plain_label(results)
    sigma = light_curve_plots.sigmas(results, results.modes[0])[order]
    return {
        "magnitude": results.is_magnitude,
        "label": label,
        "epoch": results.attrs.get("epoch_jd"),
        "power": power,
        "t": packed(results.t[order], "<f8"),
        "y": packed(results.brightness[order] / power, "<f4"),
        "error": packed(results.error[order] / power, "<f4"),
        "sigma": packed(sigma / power, "<f4"),
        "site": packed(site[order], "<u2"),
        "sites": sites.tolist(),
        "phase": packed(results.phase_angle_deg[order], "<f4"),
        "sun": packed(results.constant["sun"].to_numpy()[order], "<f4"),
        "obs": packed(results.constant["obs"].to_numpy()[order], "<f4"),
        "segments": [
            {"n": s.points.size, "title": light_curve_plots.segment_title(results, s)}
            for s in segments
        ],
        "modes": [_mode(results, m, order, power, shapes) for m in modes],
    }


def quantised(values: Floats) -> dict[str, Any]:
    """16-bit integers with offset and step, for values (…, T)."""
    low, high = float(np.min(values)), float(np.max(values))
    step = max((high - low) / 65535.0, 1e-300)
    return {"low": low, "step": step, "q": packed(np.round((values - low) / step), "<u2")}


def _mode(
    results: Results,
    mode: Mode,
    order: NDArray[np.integer],
    power: float,
    shapes: list[shape_plots.Shape],
) -> dict[str, Any]:
    shape = next((s for s in shapes if s.mode is mode), None)
    solid = shape is not None and shape.body is not None
    many = SOLID_DRAWS if solid or unknown_lengths(results) else DRAWS
    most = min(many, max(2, MOST_NUMBERS // max(order.size, 1)))
    if "inertia" in mode.draws:
        most = min(most, max(4, MOST_DIRECTIONS // max(order.size, 1)))
    rows, curves = _curves(results, mode, most)
    bands = light_curve_plots.bands(mode)
    content: dict[str, Any] = {
        "name": mode.name,
        "colour": colour(mode.index),
        "draws": len(rows),
        "bands": None if bands is None else quantised(bands[:, order] / power),
        "curves": None if curves is None else quantised(curves[:, order] / power),
        "periods": _periods(mode),
        "attitude": _attitude(mode, rows, results, order),
    }
    if shape is not None:
        content |= {"axis": shape.scene["axis"], "solid": solid}
        if shape.known is not None:
            content["bodies"] = _known(results, mode, rows)
        else:
            content["bodies"] = _bodies(results, mode, rows, solid)
    return content


def _stacked(mode: Mode, name: str) -> Floats:
    """Draws of a variable, (S, …), all chains concatenated."""
    values = mode.draws[name].transpose("chain", "draw", ...).to_numpy()
    return values.reshape(-1, *values.shape[2:]).astype(float)


def _curves(results: Results, mode: Mode, most: int) -> tuple[NDArray[np.int64], Floats | None]:
    """Rows of the draws shown, the best first, among all chains; their curves, sorted by time."""
    sizes = mode.draws.sizes
    total = sizes["chain"] * sizes["draw"]
    stored = mode.curves
    if stored is not None:  # a file may have been cut to fewer draws
        kept = (stored["chain_of"] < sizes["chain"]) & (stored["draw_of"] < sizes["draw"])
        stored = stored.isel(curve_draw=kept.to_numpy())
    if stored is None or not stored.sizes["curve_draw"]:
        return np.unique(np.linspace(0, total - 1, min(most, total)).round().astype(int)), None
    count = stored.sizes["curve_draw"]
    shown = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
    some = stored.isel(curve_draw=shown).sel(time=results.constant["time"])
    rows = some["chain_of"].to_numpy() * sizes["draw"] + some["draw_of"].to_numpy()
    return rows, some["expected"].to_numpy()


def _periods(mode: Mode) -> list[float] | None:
    """Rotation periods of some draws, s, ascending; None if the body has none, or tumbles."""
    if "inertia" in mode.draws or "inertia_ratio" in mode.draws:
        return None
    if "period_h" in mode.draws:
        values = HOUR_S * _stacked(mode, "period_h")
    elif "omega" in mode.draws:
        values = 2 * np.pi / np.maximum(np.linalg.norm(_stacked(mode, "omega"), axis=1), 1e-300)
    else:
        return None
    rows = np.linspace(0, values.size - 1, min(PERIODS, values.size)).round().astype(int)
    return np.sort(values[rows]).tolist()


def _attitude(
    mode: Mode, rows: NDArray[np.int64], results: Results, order: NDArray[np.integer]
) -> dict[str, Any] | None:
    """What gives the orientation of each draw: an angular velocity, a pole and a period, or, for a
    body that tumbles or obeys an attitude law, the directions to Sun and observer in its frame."""
    names = set(map(str, mode.draws.data_vars))
    if {"inertia", "omega"} <= names:
        return _tumbling(mode, rows, results, order)
    if results.light_curve is not None:
        return _by_law(results, results.light_curve, order)
    if "inertia_ratio" in names:
        return None  # not a rotation that the page can compute
    if "omega" in names:
        return _constant_rate(mode, rows, results)
    if {"pole_lon_deg", "pole_lat_deg", "period_h"} <= names:
        lon, lat, period = (
            _stacked(mode, k)[rows] for k in ("pole_lon_deg", "pole_lat_deg", "period_h")
        )
        middle = 0.5 * float(results.t.min() + results.t.max())
        values = np.stack([np.radians(lon), np.radians(lat), HOUR_S * period], axis=1)
        return {"kind": "pole", "pole": packed(values, "<f8"), "middle": middle}
    if results.attrs.get("model") in ("faceted", "faceted-brdf"):
        return {"kind": "fixed"}
    return None


def _by_law(
    results: Results, curve: LightCurve, order: NDArray[np.integer]
) -> dict[str, Any] | None:
    """Directions in the axes of the attitude law, the same for each draw, and the axes of facets
    that are fixed to others."""
    options = results.summary.get("model_options") or {}
    law = catalogue.parse(str(options.get("law") or "yaw-steering"))
    curve = replace(curve, t=curve.t - curve.t.min())  # as the model counts
    rows = np.argsort(curve.t, kind="stable")[order]
    body = np.asarray(frames(law, curve).body)[rows]
    mobile: dict[str, list[int]] = {}
    for i, facet in enumerate(facet_list(str(options.get("facets") or ""))):
        if facet.where:
            mobile.setdefault(facet.where, []).append(i)

    def axes(where: str) -> Floats:
        """(T, 3, 3), the axes of an array or another law in those of the body, as columns."""
        array = frames(law, curve).array
        other = array if where == ARRAY else frames(catalogue.parse(where), curve).body
        return np.einsum("tij,tik->tjk", body, np.asarray(other)[rows])

    return {
        "kind": "directions",
        "shared": True,
        **{
            name: packed(np.round(32000 * np.einsum("tij,ti->tj", body, of[rows])), "<i2")
            for name, of in (("sun", curve.sun), ("obs", curve.obs))
        },
        "mobile": [
            {"facets": which, "axes": packed(np.round(32000 * axes(where)), "<i2")}
            for where, which in mobile.items()
        ],
    }


def _constant_rate(mode: Mode, rows: NDArray[np.int64], results: Results) -> dict[str, Any]:
    """The mean angular velocity of each draw, with its drift and the attitude at t = 0 if these are
    parameters."""
    content: dict[str, Any] = {
        "kind": "rate",
        "omega": packed(_stacked(mode, "omega")[rows], "<f8"),
        "middle": 0.5 * float(results.t.min() + results.t.max()),
        "span": results.span_s,
    }
    if "rate_drift" in mode.draws:
        content["drift"] = packed(_stacked(mode, "rate_drift")[rows], "<f8")
    if "attitude" in mode.draws:
        content["attitude"] = packed(_stacked(mode, "attitude")[rows], "<f8")
    return content


def _tumbling(
    mode: Mode, rows: NDArray[np.int64], results: Results, order: NDArray[np.integer]
) -> dict[str, Any]:
    """Directions to Sun and observer in the frame of each draw, as 16-bit integers."""
    t = jnp.asarray(results.t)
    sun, obs = (jnp.asarray(results.constant[k].to_numpy()) for k in ("sun", "obs"))

    def turned(tensor: Any, omega: Any) -> Any:
        return jnp.stack(torque_free_to_body(t, omega, tensor, sun, obs))

    states = tuple(jnp.asarray(_stacked(mode, k)[rows]) for k in ("inertia", "omega"))
    directions = np.asarray(jax.lax.map(lambda state: turned(*state), states))[:, :, order]
    return {
        "kind": "directions",
        "sun": packed(np.round(32000 * directions[:, 0]), "<i2"),
        "obs": packed(np.round(32000 * directions[:, 1]), "<i2"),
    }


def _bodies(results: Results, mode: Mode, rows: NDArray[np.int64], solid: bool) -> dict[str, Any]:
    """The body of each draw: faces, or a normal and an area for each facet; their uncertainty."""
    areas = _stacked(mode, "albedo_area")
    known = facet_normals(mode)
    grid = results.normals
    normals = grid if known is None else known.reshape(-1, *known.shape[2:])
    assert normals is not None
    spread = areas.std(axis=0) / np.maximum(areas.mean(axis=0), 1e-300)
    content: dict[str, Any] = {"uncertainty": np.round(spread, 4).tolist()}
    if not solid:
        chosen = np.broadcast_to(normals, (len(areas), *normals.shape[-2:]))[rows]
        content["normals"] = packed(chosen, "<f4")
        content["areas"] = packed(areas[rows], "<f4")
        return content
    content["solids"] = [
        _solid(normals[r] if normals.ndim == 3 else normals, areas[r]) for r in rows
    ]
    return content


def _known(results: Results, mode: Mode, rows: NDArray[np.int64]) -> dict[str, Any]:
    """The tiles of a known body and the faces that shade them, of each draw if the lengths of the
    body are unknown, and otherwise once."""
    shapes = known_draws(results, mode, rows)
    sites = [variables.albedo_area(name) for name in shapes[0].names]
    areas = np.stack([_stacked(mode, site) for site in sites], axis=1)
    spread = areas.std(axis=0) / np.maximum(areas.mean(axis=0), 1e-300)
    return {
        "uncertainty": np.round(spread, 4).tolist(),
        "names": shapes[0].names,
        "solids": [_polygons(s.tiles, s.material) for s in shapes],
        "blocking": [_polygons(s.blocking, [0] * len(s.blocking)) for s in shapes],
    }


def _polygons(polygons: list[Floats], facet: list[int]) -> dict[str, Any]:
    """Polygons within the unit sphere, as `_solid` gives a body."""
    corners = np.concatenate([np.zeros((0, 3)), *polygons])
    return {
        "vertices": packed(np.round(corners * 32000), "<i2"),
        "faces": packed(np.arange(len(corners)), "<u2"),
        "sizes": packed([len(p) for p in polygons], "<u1"),
        "facet": packed(facet, "<u2"),
    }


def _solid(normals: Floats, areas: Floats) -> dict[str, Any] | None:
    """The convex body of one draw; None if its facets enclose none."""
    try:
        body = minkowski(normals, close(normals, areas))
    except InputError:
        return None
    size = float(np.max(np.linalg.norm(body.vertices, axis=1)))
    return {
        "vertices": packed(np.round(body.vertices / size * 32000), "<i2"),
        "faces": packed(np.concatenate(body.faces), "<u2"),
        "sizes": packed([len(f) for f in body.faces], "<u1"),
        "facet": packed(body.facet, "<u2"),
    }
