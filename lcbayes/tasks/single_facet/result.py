"""Result of `lcbayes.single_facet`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis import single_facet_report
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.separated.single_facet import SingleFacet
from lcbayes.tasks.deterministic import DeterministicResult, about, figure_of

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


class SingleFacetResult(DeterministicResult):
    """The normal of a facet with its 90 % region, and the edges that determine it.

    Attributes
    ----------
    data : lcbayes.inversion.separated.single_facet.SingleFacet
    """

    task = "single-facet"

    def __init__(self, found: SingleFacet, curve: LightCurve) -> None:
        super().__init__(found, about(curve) | _numbers(found), found.reasons)

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


def _numbers(result: SingleFacet) -> dict[str, Any]:
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
        "edges": [vars(e) for e in result.edges],
    }
