"""What `lcbayes.spin` returns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis import small_report, spin_report
from lcbayes.analysis.style import Gallery
from lcbayes.core.constants import HOUR_S
from lcbayes.core.reasons import Reason
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.spin.sidereal import Solution, Spin
from lcbayes.results.result import Result

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = {
    "weight": "weight",
    "pole_lon_deg": "pole_lon_deg",
    "pole_lat_deg": "pole_lat_deg",
    "radius_deg": "pole_radius_deg",
    "period_s": "sidereal_period_s",
    "period_sd_s": "sidereal_period_sd_s",
    "cycles_per_turn": "cycles_per_turn",
}


class SpinResult(Result):
    """Sidereal periods and poles, with the conditions under which they hold.

    Attributes
    ----------
    data : lcbayes.inversion.spin.Spin
    """

    task = "spin"

    def __init__(self, found: Spin, curve: LightCurve) -> None:
        reasons = [Reason("spin-not-determined", str(reason)) for reason in found.reasons]
        super().__init__(_content(found, curve), reasons, {})
        self._found, self._curve = found, curve

    @property
    def data(self) -> Spin:
        """Periodogram, synodic periods, map of the pole and solutions, as arrays."""
        return self._found

    def summary(self) -> pd.DataFrame:
        """One row a solution: weight, pole and its radius (deg), sidereal period (s)."""
        import pandas as pd

        rows = pd.DataFrame(self.content["solutions"], columns=list(COLUMNS))
        return rows.rename(columns=COLUMNS)

    def lines(self) -> list[str]:
        return spin_report.words(self._found, self._curve)

    def tables(self) -> dict[str, pd.DataFrame]:
        """Solutions, and the synodic period along the passes."""
        import pandas as pd

        synodic = self.content["synodic"] or {}
        columns = {"t": "t_s", "period_s": "period_s", "period_sd_s": "period_sd_s", "pass": "pass"}
        along = pd.DataFrame({name: synodic.get(key, ()) for key, name in columns.items()})
        return {"solutions": self.summary(), "synodic_periods": along}

    def write_page(self, folder: Path) -> None:
        def draw(gallery: Gallery) -> None:
            spin_report.draw(self._found, self._curve, gallery)

        small_report.write_page(folder, self, draw, spin_report.REFUSED)


def _content(result: Spin, curve: LightCurve) -> dict[str, Any]:
    """What `summary.json` holds beside the verdict."""
    base, sky, windows = result.base, result.sky, result.windows
    return {
        "curve": curve.source.get("file", ""),
        "frame": curve.frame,
        "n_obs": curve.n_obs,
        "points_in_penumbra_left_out": int(curve.source.get("in_penumbra", 0)),
        "passes": [
            {"name": p.name, "n_obs": p.t.size, "length_s": p.length} for p in result.passes
        ],
        "notes": result.notes,
        "conditions": [vars(c) for c in result.conditions],
        "false_alarm_probability": result.false_alarm,
        "photometric_period_s": None if base is None else 1.0 / base,
        "harmonics": result.harmonics,
        "repeatability": result.skill,
        "epoch_folding": None
        if result.folded is None
        else {
            "period_s": 1.0 / result.folded[0],
            "period_sd_s": result.folded[1] / result.folded[0] ** 2,
        },
        "synodic": None
        if windows is None
        else {
            "t": windows.t,
            "period_s": 1.0 / windows.frequency,
            "period_sd_s": windows.error / windows.frequency**2,
            "pass": windows.which,
        },
        "solutions": [_solution(s) for s in result.solutions],
        # of the fit, where one was made: not to be read as an answer where a condition fails
        "sky_fraction": None if sky is None else sky.area,
        "symmetry": None if sky is None else sky.symmetry,
        "shape_shift_deg": None if sky is None else sky.shape_deg,
        "chi2": None if sky is None else sky.chi2,
        "dof": None if sky is None else sky.freedom,
    }


def _solution(s: Solution) -> dict[str, Any]:
    lon, lat = lon_lat_deg(s.pole)
    return {
        "pole_lon_deg": float(lon),
        "pole_lat_deg": float(lat),
        "radius_deg": float(np.degrees(s.radius)),
        "period_h": 1.0 / s.frequency / HOUR_S,
        "period_s": 1.0 / s.frequency,
        "period_sd_s": s.error / s.frequency**2,
        "cycles_per_turn": s.multiple,
        "weight": s.weight,
    }
