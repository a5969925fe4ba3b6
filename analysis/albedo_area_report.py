"""What `lcbayes albedo-area` writes: the numbers, the words, the figures and the body."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.analysis import albedo_area_plots, small_report
from lcbayes.analysis.numerals import show
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.albedo_area.inversion import Inversion

NAME = "albedo_area"
FINER = "as many facets as lower chi2 at all"
LISTED = 20  # facets, largest first
ANYWHERE = 60.0  # deg; a direction with a larger standard deviation is unconstrained
BODY = ("shape.obj", "shape.ply")


def write(
    result: Inversion, curve: LightCurve, folder: Path, about: Mapping[str, Any]
) -> dict[str, Any]:
    """Write `albedo_area.json`, `albedo_area.txt`, `figures/`, `shape.obj` and `shape.ply`.

    All are made aside and then put in place; a body of an earlier run does not outlive it.

    Parameters
    ----------
    about : mapping
        What was asked for, put into the file as it is.

    Returns
    -------
    dict
        The content of `albedo_area.json`.
    """
    content = dict(about) | numbers(result, curve)
    body = result.shape
    comment = "convex body of one albedo, lcbayes albedo-area"
    texts: dict[str, str | None] = dict.fromkeys(BODY)
    if body is not None:
        texts = {BODY[0]: body.obj(comment), BODY[1]: body.ply(comment)}
    small_report.write(
        folder,
        NAME,
        content,
        words(result, curve),
        lambda gallery: albedo_area_plots.draw(result, gallery),
        texts,
    )
    return content


def numbers(result: Inversion, curve: LightCurve) -> dict[str, Any]:
    """The content of `albedo_area.json`: m², m³, m and degrees, body frame."""
    seen, best, found = result.seen, result.best, result.on_grid
    calibrated = not np.all(seen.free)
    return {
        "n_obs": len(seen.flux),
        "n_curves": len(seen.free),
        "calibrated": bool(calibrated),
        "trusted": not result.reasons,
        "reasons": result.reasons,
        "fit": {
            "chi2": best.chi2,
            "dof": result.dof,
            "rms_relative": result.rms,
            "errors": "given" if seen.error_known else "estimated from the residuals",
        },
        "unseen": result.unseen,
        "scales": {
            name: float(s)
            for name, s, free in zip(curve.curve_names, best.scale, seen.free, strict=True)
            if free
        },
        "materials": [str(m) for m in result.materials],
        "cues": [
            {
                "name": c.name,
                "statistic": c.statistic,
                "p_value": c.p_value,
                "null": c.null,
                "words": c.words,
                "details": c.details,
            }
            for c in result.cues
        ],
        "facets": _facets(result),
        "gap": result.gap,
        "changed_to_close": result.changed,
        "shape": _body(result, calibrated),
        "no_shape": result.no_shape or None,
        "distribution": {
            "normals": found.normals,
            "material": found.which,
            "albedo_area": found.areas,
            "albedo_area_sd": result.grid_sd,
        },
    }


def _facets(result: Inversion) -> list[dict[str, Any]]:
    facets = result.facets
    if facets is None:
        return []
    spread = [None] * len(facets.areas)
    if result.draws is not None:
        spread = list(np.linalg.norm(result.draws.vectors, axis=2).std(axis=0))
    lon, lat = lon_lat_deg(facets.normals)
    return [
        {
            "normal": facets.normals[i],
            "lon_deg": lon[i],
            "lat_deg": lat[i],
            "direction_sd_deg": float(np.degrees(facets.direction_sd[i])),
            "material": int(facets.which[i]),
            "albedo_area": facets.areas[i],
            "share": facets.areas[i] / facets.areas.sum(),
            "sd": facets.area_sd[i],
            "sd_bootstrap": spread[i],
        }
        for i in np.argsort(-facets.areas)
    ]


def _listed(result: Inversion) -> list[str]:
    """A line for each of the largest facets: albedo-area, or share where no size is known, and
    where it faces."""
    found = _facets(result)
    sized = not np.all(result.seen.free)
    lines = []
    for facet in found[:LISTED]:
        unit, factor = ("m²", 1.0) if sized else ("%", 100.0 / result.best.areas.sum())
        area, sd = factor * facet["albedo_area"], factor * facet["sd"]
        off = facet["direction_sd_deg"]
        where = f"longitude {facet['lon_deg']:5.1f}, latitude {facet['lat_deg']:5.1f} deg"
        law = f"  {result.materials[facet['material']]}" if len(result.materials) > 1 else ""
        lines.append(
            f"  {show(area, sd):>6s} ± {show(sd, sd)} {unit} towards {where}, "
            f"{f'± {show(off, off)} deg' if off < ANYWHERE else 'or anywhere'}{law}"
        )
    if len(found) > LISTED:
        lines.append(f"  and {len(found) - LISTED} smaller facets")
    return lines


def _body(result: Inversion, calibrated: bool) -> dict[str, Any] | None:
    body = result.shape
    if body is None:
        return None
    moments, axes = body.principal
    size = body.dimensions
    draws = result.draws
    known = draws is not None and len(draws.volumes) > 1
    return {
        "n_faces": len(body.faces),
        "dimensions": size if calibrated else size / size.min(),
        "dimensions_sd": draws.dimensions.std(axis=0) if known and calibrated else None,  # pyright: ignore[reportOptionalMemberAccess]
        "volume": body.volume if calibrated else None,
        "volume_sd": draws.volumes.std() if known and calibrated else None,  # pyright: ignore[reportOptionalMemberAccess]
        "volume_finer_facets": result.finer_volume if calibrated else None,
        "moments_of_inertia": moments if calibrated else moments / moments.min(),
        "principal_axes": axes,
    }


def words(result: Inversion, curve: LightCurve) -> list[str]:
    """The result as text; caveats come first."""
    seen, best = result.seen, result.best
    lines = [f"{small_report.UNTRUSTED}: {reason}" for reason in result.reasons]
    kind = "facets" if result.facets is not None else "grid normals with area"
    count = int(np.sum(best.areas > 0))
    errors = "" if seen.error_known else " (errors estimated from the residuals)"
    lines += [
        f"{len(seen.flux)} points in {len(curve.curve_names)} curve(s); {count} {kind}: "
        f"chi2 {best.chi2:.1f} for {result.dof} degrees of freedom{errors}, "
        f"rms {100 * result.rms:.2f} % of the mean flux"
    ]
    if result.facets is not None:
        lines += ["albedo-areas and where they face, body axes:", *_listed(result)]
    lines += [f"{c.name:9s} p = {c.p_value:.4f}  {c.words}" for c in result.cues]
    if result.shape is None:
        return [*lines, f"no shape: {result.no_shape}"]
    body, size = result.shape, result.shape.dimensions
    if np.all(seen.free):
        extent = " : ".join(f"{x / size.min():.3g}" for x in size)
        lines.append(f"shape: {len(body.faces)} faces, extents as {extent} (size unknown)")
    else:
        extent = " x ".join(f"{x:.4g}" for x in size)
        volume = f"{body.volume:.4g}"
        if result.draws is not None and len(result.draws.volumes) > 1:
            volume += f" ± {result.draws.volumes.std():.1g}"
        lines.append(f"shape: {len(body.faces)} faces, {extent} m, volume {volume} m³")
        if result.finer_volume is not None:
            lines.append(
                f"with {FINER} the volume is {result.finer_volume:.4g} m³; the difference "
                "shows the possible effect of the number of facets, which is largest for a round "
                "body"
            )
    lines.append(
        f"areas closed to {result.gap:.2g} of their sum; {100 * result.changed:.2g} % of it was "
        "changed to close them"
    )
    return lines
