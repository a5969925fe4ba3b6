"""The text of `lcbayes albedo-area`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from lcbayes.analysis.numerals import show
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.inversion import Inversion

FINER = "as many facets as lower chi2 at all"
LISTED = 20  # facets, largest first
ANYWHERE = 60.0  # standard deviation (deg) above which a direction is undetermined


def _listed(result: Inversion, facets: Sequence[Mapping[str, Any]]) -> list[str]:
    """A line for each of the largest facets: albedo-area (or share if the size is unknown) and
    direction of the normal."""
    sized = not np.all(result.seen.free)
    lines = []
    for facet in facets[:LISTED]:
        unit, factor = ("m²", 1.0) if sized else ("%", 100.0 / result.best.areas.sum())
        area, sd = factor * facet["albedo_area"], factor * facet["sd"]
        off = facet["direction_sd_deg"]
        where = f"longitude {facet['lon_deg']:5.1f}, latitude {facet['lat_deg']:5.1f} deg"
        law = f"  {result.materials[facet['material']]}" if len(result.materials) > 1 else ""
        lines.append(
            f"  {show(area, sd):>6s} ± {show(sd, sd)} {unit} towards {where}, "
            f"{f'± {show(off, off)} deg' if off < ANYWHERE else 'or anywhere'}{law}"
        )
    if len(facets) > LISTED:
        lines.append(f"  and {len(facets) - LISTED} smaller facets")
    return lines


def words(result: Inversion, curve: LightCurve, facets: Sequence[Mapping[str, Any]]) -> list[str]:
    """The result as lines of text, without the verdict; facets as in `summary.json`."""
    seen, best = result.seen, result.best
    kind = "facets" if result.facets is not None else "grid normals with area"
    count = int(np.sum(best.areas > 0))
    errors = "" if seen.error_known else " (errors estimated from the residuals)"
    lines = [
        f"{len(seen.flux)} points in {len(curve.curve_names)} curve(s); {count} {kind}: "
        f"chi2 {best.chi2:.1f} for {result.dof} degrees of freedom{errors}, "
        f"rms {100 * result.rms:.2f} % of the mean flux"
    ]
    if result.facets is not None:
        lines += ["albedo-areas and where they face, body axes:", *_listed(result, facets)]
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
