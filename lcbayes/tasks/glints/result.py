"""Result of `lcbayes.glints`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis import glints_report
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.glints.attitude import Glints
from lcbayes.inversion.glints.directions import Direction, Tracking
from lcbayes.tasks.deterministic import DeterministicResult, about, figure_of
from lcbayes.tasks.glints.options import GlintsOptions

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

GLINTS = {
    "t": "t_s",
    "t_error": "t_sd_s",
    "stretch": "pass",
    "fwhm": "fwhm_s",
    "height_over_baseline": "height_over_baseline",
    "significance": "significance_sd",
    "false_alarm": "false_alarm",
    "resolved": "resolved",
    "sharp_and_small": "sharp_and_small",
    "lon_deg": "bisector_lon_deg",
    "lat_deg": "bisector_lat_deg",
}
DIRECTIONS = (
    "kind",
    "lon_deg",
    "lat_deg",
    "semi_major_90_deg",
    "semi_minor_90_deg",
    "chi2",
    "dof",
    "p_value",
    "n_glints",
)


class GlintsResult(DeterministicResult):
    """Glints, and the directions of the reflecting facets, cylinders or panels.

    Attributes
    ----------
    data : lcbayes.inversion.glints.attitude.Glints
    """

    task = "glints"
    refused = glints_report.REFUSED

    def __init__(self, found: Glints, curve: LightCurve, options: GlintsOptions) -> None:
        asked = {
            "attitude": options.attitude_settings(),
            "sun_tracking": options.sun_tracking,
            "alarm": options.alarm,
            "longest_s": options.longest,
        }
        content = about(curve) | asked | _numbers(found, curve)
        super().__init__(found, content, found.reasons)
        self._curve = curve

    def summary(self) -> pd.DataFrame:
        """One row per facet, cylinder or panel determined by several glints; angles in degrees."""
        import pandas as pd

        rows = [_row("facet", d) for d in self.data.facets]
        rows += [_row("cylinder", d) for d in [self.data.cylinder] if d is not None]
        if self.data.panel is not None:
            rows.append(_panel_row(self.data.panel))
        return pd.DataFrame(rows, columns=[*DIRECTIONS, "offset_deg", "offset_sd_deg"])

    def lines(self) -> list[str]:
        return glints_report.words(self.data, self._curve)

    def tables(self) -> dict[str, pd.DataFrame]:
        """Glints in order of time, and the directions."""
        import pandas as pd

        glints = pd.DataFrame(
            [
                g | {"height_over_baseline": g["height"] / g["baseline"]}
                for g in self.content["glints"]
            ],
            columns=list(GLINTS),
        )
        return {"glints": glints.rename(columns=GLINTS), "directions": self.summary()}

    def draw(self, gallery: Gallery) -> None:
        glints_report.draw(self.data, gallery)

    def plot_glints(self) -> Figure:
        """The light curve with the baseline and numbered glints."""
        return figure_of(glints_report.draw_curve, self.data)

    def plot_directions(self) -> Figure:
        """Bisectors at the glints on the sky, and the 90 % regions of the directions."""
        return figure_of(glints_report.draw_sky, self.data)

    def plot_panel(self) -> Figure:
        """Offset of a Sun-tracking panel at each glint, and the height of the glints."""
        return figure_of(glints_report.draw_panel, self.data)


def _numbers(result: Glints, curve: LightCurve) -> dict[str, Any]:
    """Content of ``summary.json``: times in s, flux as in the data, body axes, degrees."""
    rows = []
    for i, (one, seen) in enumerate(zip(result.glints, result.seen, strict=True)):
        lon, lat = lon_lat_deg(seen.bisector)
        rows.append(
            vars(one)
            | {
                "bisector": seen.bisector,
                "lon_deg": float(lon),
                "lat_deg": float(lat),
                "sharp_and_small": glints_report.wire_like(result, i),
            }
        )
    return {
        "n_obs": curve.n_obs,
        "notes": result.notes,
        "glints": rows,
        "facets": [_direction(f) for f in result.facets],
        "facets_of_one_glint": [_direction(f) for f in result.single],
        "cylinder": None if result.cylinder is None else _direction(result.cylinder),
        "sun_tracking_panel": None if result.panel is None else _panel(result.panel),
    }


def _panel(panel: Tracking) -> dict[str, Any]:
    return {
        "offset_deg": np.degrees(panel.mean),
        "offset_sd_deg": np.degrees(panel.error),
        "chi2": panel.chi2,
        "dof": panel.freedom,
        "p_value": panel.p_value,
        "glint_offset_deg": np.degrees(panel.offsets),
        "glint_offset_sd_deg": np.degrees(panel.errors),
        "glint_tilt_deg": np.degrees(panel.tilt),
        "glint_sun_tilt_deg": np.degrees(panel.sun),
    }


def _direction(d: Direction) -> dict[str, Any]:
    lon, lat = lon_lat_deg(d.vector)
    longer, shorter = d.ellipse
    return {
        "vector": d.vector,
        "lon_deg": float(lon),
        "lat_deg": float(lat),
        "semi_axes_90_deg": [np.degrees(longer), np.degrees(shorter)],
        "covariance": d.covariance,
        "chi2": d.chi2,
        "dof": d.freedom,
        "p_value": d.p_value,
        "glints": list(d.members),
    }


def _row(kind: str, d: Direction) -> dict[str, Any]:
    found = _direction(d)
    longer, shorter = found["semi_axes_90_deg"]
    axes = {"semi_major_90_deg": longer, "semi_minor_90_deg": shorter}
    return {"kind": kind, "n_glints": len(d.members), **found, **axes}


def _panel_row(panel: Tracking) -> dict[str, Any]:
    return {"kind": "Sun-tracking panel", "n_glints": len(panel.offsets), **_panel(panel)}
