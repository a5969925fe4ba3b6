"""Result of `lcbayes.single_facet`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from lcbayes.analysis import single_facet_report
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.separated.single_facet import SingleFacet
from lcbayes.results.content import Floats, Verdict
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

COLUMNS = {
    "lon_deg": "normal_lon_deg",
    "lat_deg": "normal_lat_deg",
    "albedo_area_m2": "albedo_area_m2",
    "share": "share_of_flux",
    "p_no_edge": "p_no_edge",
    "chi2": "chi2",
    "dof": "dof",
}
EDGES = {
    "one_pass": "pass",
    "site": "site",
    "t": "t_s",
    "error": "t_sd_s",
    "kind": "kind",
    "brightens": "brightens",
}


class NormalRegion(TypedDict):
    """The 90 % region of a normal; ``normals`` (n, 3) in body axes."""

    probability: float
    area_deg2: float
    farthest_deg: float
    normals: Any


class EdgeContent(TypedDict):
    """A crossing of the facet's edge in a pass."""

    one_pass: int
    site: str
    t: float
    error: float
    kind: str
    brightens: bool


class Numbers(TypedDict):
    """Numbers of a single facet, in body axes of the law."""

    n_obs: int
    law: str
    normal: Floats
    lon_deg: float
    lat_deg: float
    region: NormalRegion
    albedo_area_m2: float
    share: float
    kind: dict[str, float]
    p_no_edge: float
    chi2: float
    dof: int
    edges: list[EdgeContent]


class SingleFacetContent(Verdict, CurveContent, Numbers):
    """Content of the summary of `lcbayes.single_facet`."""


class SingleFacetResult(DeterministicResult[SingleFacet, SingleFacetContent]):
    """The normal of a facet with its 90 % region, and the edges that determine it.

    Attributes
    ----------
    data : lcbayes.inversion.separated.single_facet.SingleFacet
    """

    task = "single-facet"

    def __init__(self, analysed: SingleFacet, curve: LightCurve) -> None:
        super().__init__(analysed, {**about(curve), **_numbers(analysed)}, analysed.reasons)

    def summary(self) -> pd.DataFrame:
        """One row: normal (deg, body axes of the law), its region, albedo-area (m²)."""
        import pandas as pd

        content = self.content
        row = {new: content[old] for old, new in COLUMNS.items()}
        region = content["region"]
        row |= {
            "region_90_deg2": region["area_deg2"],
            "region_90_radius_deg": region["farthest_deg"],
        }
        return pd.DataFrame([{"law": content["law"], **row}])

    def lines(self) -> list[str]:
        return single_facet_report.words(self.data)

    def listing(self) -> tuple[Listing, list[str]]:
        return single_facet_report.table(self.data), single_facet_report.remarks(self.data)

    def tables(self) -> dict[str, pd.DataFrame]:
        """The normal, the edges, and the normals of the 90 % region."""
        import pandas as pd

        edges = pd.DataFrame(self.content["edges"], columns=list(EDGES)).rename(columns=EDGES)
        lon, lat = lon_lat_deg(self.data.normals[self.data.region])
        region = pd.DataFrame({"normal_lon_deg": lon, "normal_lat_deg": lat})
        return {"normal": self.summary(), "edges": edges, "region": region}

    def draw(self, gallery: Gallery) -> None:
        single_facet_report.draw(self.data, gallery)

    def plot_edges(self) -> Figure:
        """The light curve with the best fit, the fit without the facet, and the edges."""
        return figure_of(single_facet_report.draw_edges, self.data)

    def plot_normal(self) -> Figure:
        """The 90 % region of the normal on the sphere in body axes."""
        return figure_of(single_facet_report.draw_region, self.data)


def _numbers(result: SingleFacet) -> Numbers:
    """Content of ``summary.json``: body axes of the law, degrees, s, m²."""
    lon, lat = lon_lat_deg(result.normal[None])
    return {
        "n_obs": len(result.seen.t),
        "law": result.law,
        "normal": result.normal,
        "lon_deg": float(lon[0]),
        "lat_deg": float(lat[0]),
        "region": {
            "probability": 0.9,
            "area_deg2": result.area_sr * np.degrees(1.0) ** 2,
            "farthest_deg": result.radius_deg,
            "normals": result.normals[result.region],
        },
        "albedo_area_m2": result.albedo_area,
        "share": result.share,
        "kind": result.kind,
        "p_no_edge": result.p_value,
        "chi2": result.chi2,
        "dof": result.dof,
        "edges": [
            {
                "one_pass": e.one_pass,
                "site": e.site,
                "t": e.t,
                "error": e.error,
                "kind": e.kind,
                "brightens": e.brightens,
            }
            for e in result.edges
        ],
    }
