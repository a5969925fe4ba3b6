"""Result of `lcbayes.glints`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from lcbayes.analysis import glints_report
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.glints.attitude import Glints
from lcbayes.inversion.glints.directions import Direction, Tracking
from lcbayes.results.content import Floats, Verdict
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of
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


class GlintContent(TypedDict):
    """A glint, and the phase-angle bisector at its peak in body axes."""

    row: int
    stretch: int
    t: float
    t_error: float
    fwhm: float
    height: float
    baseline: float
    significance: float
    false_alarm: float
    resolved: bool
    bisector: Floats
    lon_deg: float
    lat_deg: float
    sharp_and_small: bool


class DirectionContent(TypedDict):
    """A direction in body axes with its 90 % ellipse; covariance in rad²."""

    vector: Floats
    lon_deg: float
    lat_deg: float
    semi_axes_90_deg: list[float]
    covariance: Any
    chi2: float
    dof: int
    p_value: float
    glints: list[int]


class PanelContent(TypedDict):
    """The offset of a Sun-tracking panel from the Sun, for all glints and for each."""

    offset_deg: float
    offset_sd_deg: float
    chi2: float
    dof: int
    p_value: float
    glint_offset_deg: Floats
    glint_offset_sd_deg: Floats
    glint_tilt_deg: Floats
    glint_sun_tilt_deg: Floats


class Asked(TypedDict):
    """The options of a search for glints."""

    attitude: dict[str, Any]
    sun_tracking: Sequence[float] | None
    alarm: float
    longest_s: float | None


class Numbers(TypedDict):
    """Numbers of a search for glints."""

    n_obs: int
    notes: list[str]
    glints: list[GlintContent]
    facets: list[DirectionContent]
    facets_of_one_glint: list[DirectionContent]
    cylinder: DirectionContent | None
    sun_tracking_panel: PanelContent | None


class GlintsContent(Verdict, CurveContent, Asked, Numbers):
    """Content of the summary of `lcbayes.glints`."""


class GlintsResult(DeterministicResult[Glints, GlintsContent]):
    """Glints, and the directions of the reflecting facets, cylinders or panels.

    Attributes
    ----------
    data : lcbayes.inversion.glints.attitude.Glints
    """

    task = "glints"
    refused = glints_report.REFUSED

    def __init__(self, analysed: Glints, curve: LightCurve, options: GlintsOptions) -> None:
        asked: Asked = {
            "attitude": options.attitude_settings(),
            "sun_tracking": options.sun_tracking,
            "alarm": options.alarm,
            "longest_s": options.longest,
        }
        content = {**about(curve), **asked, **_numbers(analysed, curve)}
        super().__init__(analysed, content, analysed.reasons)
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

    def listing(self) -> tuple[Listing, list[str]]:
        table = glints_report.table(self.data, self._curve)
        return table, glints_report.remarks(self.data, self._curve)

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


def _numbers(result: Glints, curve: LightCurve) -> Numbers:
    """Content of ``summary.json``: times in s, flux as in the data, body axes, degrees."""
    rows: list[GlintContent] = []
    for i, (one, seen) in enumerate(zip(result.glints, result.seen, strict=True)):
        lon, lat = lon_lat_deg(seen.bisector)
        rows.append(
            {
                "row": one.row,
                "stretch": one.stretch,
                "t": one.t,
                "t_error": one.t_error,
                "fwhm": one.fwhm,
                "height": one.height,
                "baseline": one.baseline,
                "significance": one.significance,
                "false_alarm": one.false_alarm,
                "resolved": one.resolved,
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


def _panel(panel: Tracking) -> PanelContent:
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


def _direction(d: Direction) -> DirectionContent:
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
    direction = _direction(d)
    longer, shorter = direction["semi_axes_90_deg"]
    axes = {"semi_major_90_deg": longer, "semi_minor_90_deg": shorter}
    return {"kind": kind, "n_glints": len(d.members), **direction, **axes}


def _panel_row(panel: Tracking) -> dict[str, Any]:
    return {"kind": "Sun-tracking panel", "n_glints": len(panel.offsets), **_panel(panel)}
