"""Result of `lcbayes.albedo_area`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from lcbayes.analysis import albedo_area_plots, albedo_area_report
from lcbayes.analysis.style import Gallery
from lcbayes.core.files import write_text
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.albedo_area.inversion import Inversion
from lcbayes.results.content import Floats, Verdict
from lcbayes.tasks.albedo_area.options import AlbedoAreaOptions
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

OPTIONS = ("n_normals", "smoothness", "facet_cost", "albedo", "bootstrap", "nulls", "seed")
FACETS = {
    "lon_deg": "normal_lon_deg",
    "lat_deg": "normal_lat_deg",
    "direction_sd_deg": "normal_sd_deg",
    "material": "material",
    "albedo_area": "albedo_area",
    "sd": "albedo_area_sd",
    "sd_bootstrap": "albedo_area_sd_bootstrap",
    "share": "share",
}


class Asked(TypedDict):
    """The options of the inversion."""

    attitude: dict[str, Any]
    options: dict[str, Any]


class AreaFit(TypedDict):
    """Goodness of fit of the facets, or of the smooth distribution."""

    chi2: float
    dof: int
    rms_relative: float
    errors: str


class CueContent(TypedDict):
    """The test of one property of a body."""

    name: str
    statistic: float
    p_value: float
    null: str
    words: str
    details: Mapping[str, Any]


class FacetContent(TypedDict):
    """A facet in the body frame; areas in m² if the light curve is calibrated."""

    normal: Floats
    lon_deg: float
    lat_deg: float
    direction_sd_deg: float
    material: int
    albedo_area: float
    share: float
    sd: float
    sd_bootstrap: float | None


class BodyContent(TypedDict):
    """The convex body of one albedo: m, m³, and moments of inertia of unit density."""

    n_faces: int
    dimensions: Floats
    dimensions_sd: Floats | None
    volume: float | None
    volume_sd: float | None
    volume_finer_facets: float | None
    moments_of_inertia: Floats
    principal_axes: Any


class DistributionContent(TypedDict):
    """The distribution on the grid: normals (n, 3), index of material, area and its sd (n,)."""

    normals: Any
    material: Any
    albedo_area: Floats
    albedo_area_sd: Floats | None


class Numbers(TypedDict):
    """Numbers of an inversion."""

    n_obs: int
    n_curves: int
    calibrated: bool
    fit: AreaFit
    unseen: float
    scales: dict[str, float]
    materials: list[str]
    cues: list[CueContent]
    facets: list[FacetContent]
    gap: float
    changed_to_close: float
    shape: BodyContent | None
    no_shape: str | None
    distribution: DistributionContent


class AlbedoAreaContent(Verdict, CurveContent, Asked, Numbers):
    """Content of the summary of `lcbayes.albedo_area`."""


class AlbedoAreaResult(DeterministicResult[Inversion, AlbedoAreaContent]):
    """Facets for a known attitude, shape cues, and the convex body if the facets close.

    Attributes
    ----------
    data : lcbayes.inversion.albedo_area.inversion.Inversion
    """

    task = "albedo-area"

    def __init__(self, inversion: Inversion, curve: LightCurve, options: AlbedoAreaOptions) -> None:
        asked: Asked = {
            "attitude": options.attitude_settings(),
            "options": {name: getattr(options, name) for name in OPTIONS},
        }
        content = {**about(curve), **asked, **_numbers(inversion, curve)}
        super().__init__(inversion, content, inversion.reasons)
        self._curve = curve

    @property
    def _unit(self) -> str:
        """Suffix of the names of columns of areas."""
        return "_m2" if self.content["calibrated"] else "_relative"

    def summary(self) -> pd.DataFrame:
        """One row per facet, largest first: normal (deg, body frame) and albedo-area (m²)."""
        import pandas as pd

        names = {
            old: new + self._unit * new.startswith("albedo_area") for old, new in FACETS.items()
        }
        return pd.DataFrame(self.content["facets"], columns=list(FACETS)).rename(columns=names)

    def lines(self) -> list[str]:
        return albedo_area_report.words(self.data, self._curve, self.content["facets"])

    def tables(self) -> dict[str, pd.DataFrame]:
        """Facets, the distribution on the grid, and the shape cues."""
        import pandas as pd

        grid = self.content["distribution"]
        lon, lat = lon_lat_deg(np.asarray(grid["normals"]))
        columns = {"normal_lon_deg": lon, "normal_lat_deg": lat, "material": grid["material"]}
        columns["albedo_area" + self._unit] = grid["albedo_area"]
        if grid["albedo_area_sd"] is not None:
            columns[f"albedo_area_sd{self._unit}"] = grid["albedo_area_sd"]
        cues = [[c.name, c.statistic, c.p_value, c.words] for c in self.data.cues]
        return {
            "facets": self.summary(),
            "distribution": pd.DataFrame(columns),
            "cues": pd.DataFrame(cues, columns=["cue", "statistic", "p_value", "description"]),
        }

    def write_files(self, folder: Path) -> None:
        """Write ``shape.obj`` and ``shape.ply``, vertices in m, if there is a shape."""
        if self.data.shape is not None:
            comment = "convex body of one albedo, lcbayes albedo-area"
            write_text(self.data.shape.obj(comment), folder / "shape.obj")
            write_text(self.data.shape.ply(comment), folder / "shape.ply")

    def draw(self, gallery: Gallery) -> None:
        albedo_area_plots.draw(self.data, gallery)

    def plot_distribution(self) -> Figure:
        """Map of the body frame: the albedo-area facing each direction, and the facets."""
        return figure_of(albedo_area_plots.draw_map, self.data)

    def plot_fit(self) -> Figure:
        """Observed against fitted flux, and residuals in units of the error."""
        return figure_of(albedo_area_plots.draw_fit, self.data)

    def plot_shape(self) -> Figure:
        """The convex body from three sides, if there is one."""
        return figure_of(albedo_area_plots.draw_shape, self.data)


def _numbers(result: Inversion, curve: LightCurve) -> Numbers:
    """Content of ``summary.json``: m², m³, m and degrees, body frame."""
    seen, best, on_grid = result.seen, result.best, result.on_grid
    calibrated = not np.all(seen.free)
    return {
        "n_obs": len(seen.flux),
        "n_curves": len(seen.free),
        "calibrated": bool(calibrated),
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
        "shape": _body(result, bool(calibrated)),
        "no_shape": result.no_shape or None,
        "distribution": {
            "normals": on_grid.normals,
            "material": on_grid.which,
            "albedo_area": on_grid.areas,
            "albedo_area_sd": result.grid_sd,
        },
    }


def _facets(result: Inversion) -> list[FacetContent]:
    facets = result.facets
    if facets is None:
        return []
    spread: Sequence[float | None] = [None] * len(facets.areas)
    if result.draws is not None:
        spread = np.linalg.norm(result.draws.vectors, axis=2).std(axis=0).tolist()
    lon, lat = lon_lat_deg(facets.normals)
    return [
        {
            "normal": facets.normals[i],
            "lon_deg": float(lon[i]),
            "lat_deg": float(lat[i]),
            "direction_sd_deg": float(np.degrees(facets.direction_sd[i])),
            "material": int(facets.which[i]),
            "albedo_area": facets.areas[i],
            "share": facets.areas[i] / facets.areas.sum(),
            "sd": facets.area_sd[i],
            "sd_bootstrap": spread[i],
        }
        for i in map(int, np.argsort(-facets.areas))
    ]


def _body(result: Inversion, calibrated: bool) -> BodyContent | None:
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
