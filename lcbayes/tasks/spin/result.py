"""Result of `lcbayes.spin`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from lcbayes.analysis import spin_report
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import Gallery
from lcbayes.core.constants import HOUR_S
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.spin.sidereal import Solution, Spin
from lcbayes.results.content import Floats, Verdict
from lcbayes.results.start import candidate_periods
from lcbayes.tasks.commands import onward
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of
from lcbayes.tasks.spin.conditions import ConditionContent, condition_content

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

MOST_CANDIDATES = 4  # sidereal periods offered for folding
COLUMNS = {
    "weight": "weight",
    "pole_lon_deg": "pole_lon_deg",
    "pole_lat_deg": "pole_lat_deg",
    "radius_deg": "pole_radius_deg",
    "period_s": "sidereal_period_s",
    "period_sd_s": "sidereal_period_sd_s",
    "cycles_per_turn": "cycles_per_turn",
}


class SpinPass(TypedDict):
    """A pass with enough points."""

    name: str
    n_obs: int
    length_s: float


class LongestPass(TypedDict):
    """Mean period of the longest pass, and its drift."""

    period_s: float
    period_sd_s: float
    drift: float
    drift_sd: float


SynodicContent = TypedDict(
    "SynodicContent",
    {"t": Floats, "period_s": Floats, "period_sd_s": Floats, "pass": Any},
)


class SpinSolution(TypedDict):
    """A connected part of the 90 % region of the pole."""

    pole_lon_deg: float
    pole_lat_deg: float
    radius_deg: float
    period_h: float
    period_s: float
    period_sd_s: float
    cycles_per_turn: int
    weight: float


class Numbers(TypedDict):
    """Numbers of a spin; those of the sky are no result if a condition fails."""

    n_obs: int
    passes: list[SpinPass]
    notes: list[str]
    conditions: list[ConditionContent]
    false_alarm_probability: float
    photometric_period_s: float | None
    harmonics: list[int]
    repeatability: float | None
    longest_pass: LongestPass | None
    synodic: SynodicContent | None
    solutions: list[SpinSolution]
    region: list[SpinSolution]
    sky_fraction: float | None
    symmetry: Any
    shape_shift_deg: float | None
    chi2: float | None
    dof: int | None


class SpinContent(Verdict, CurveContent, Numbers):
    """Content of the summary of `lcbayes.spin`."""


class SpinResult(DeterministicResult[Spin, SpinContent]):
    """Sidereal periods and poles, with the conditions under which they hold.

    Attributes
    ----------
    data : lcbayes.inversion.spin.Spin
    """

    task = "spin"
    refused = spin_report.REFUSED

    def __init__(self, spin: Spin, curve: LightCurve) -> None:
        super().__init__(spin, {**about(curve), **_content(spin, curve)}, spin.reasons)
        self._curve = curve

    def summary(self) -> pd.DataFrame:
        """One row per solution: weight, pole and its radius (deg), sidereal period (s)."""
        import pandas as pd

        rows = pd.DataFrame(self.content["solutions"], columns=list(COLUMNS))
        return rows.rename(columns=COLUMNS)

    def lines(self) -> list[str]:
        return spin_report.words(self.data, self._curve) + self._onward()

    def listing(self) -> tuple[Listing, list[str]]:
        remarks = spin_report.remarks(self.data, self._curve)
        return spin_report.table(self.data), remarks + self._onward()

    def _onward(self) -> list[str]:
        return onward(self) if candidate_periods(self._content) else []

    def tables(self) -> dict[str, pd.DataFrame]:
        """Solutions, and the synodic period along the passes."""
        import pandas as pd

        synodic = self.content["synodic"] or {}
        columns = {"t": "t_s", "period_s": "period_s", "period_sd_s": "period_sd_s", "pass": "pass"}
        along = pd.DataFrame({name: synodic.get(key, ()) for key, name in columns.items()})
        return {"solutions": self.summary(), "synodic_periods": along}

    def draw(self, gallery: Gallery) -> None:
        spin_report.draw(self.data, self._curve, gallery)

    def candidates(self) -> list[tuple[str, float]]:
        base = self.content["photometric_period_s"]
        periods = [] if base is None else [("brightness repeats", base)]
        for i, one in enumerate(self.content["solutions"][:MOST_CANDIDATES], 1):
            periods.append((f"sidereal period, solution {i}", one["period_s"]))
        for i, one in enumerate(self.content["region"][:MOST_CANDIDATES], 1):
            periods.append((f"sidereal period, part {i} of the region", one["period_s"]))
        return periods

    def plot_periodogram(self) -> Figure:
        """Power against period, with the base period and its harmonics."""
        return figure_of(spin_report.draw_periodogram, self.data)

    def plot_synodic_periods(self) -> Figure:
        """Synodic period along each pass, and that of the best solution."""
        return figure_of(spin_report.draw_synodic, self.data)

    def plot_pole(self) -> Figure:
        """The 90 % region of the pole on the sky, and the solutions."""
        return figure_of(spin_report.draw_sky, self.data, self._curve)


def _content(result: Spin, curve: LightCurve) -> Numbers:
    """The content of `summary.json` besides the verdict."""
    base, sky, windows = result.base, result.sky, result.windows
    return {
        "n_obs": curve.n_obs,
        "passes": [
            {"name": p.name, "n_obs": p.t.size, "length_s": p.length} for p in result.passes
        ],
        "notes": result.notes,
        "conditions": [condition_content(c) for c in result.conditions],
        "false_alarm_probability": result.false_alarm,
        "photometric_period_s": None if base is None else 1.0 / base,
        "harmonics": result.harmonics,
        "repeatability": result.skill,
        "longest_pass": None
        if result.mean is None
        else {
            "period_s": result.mean.period,
            "period_sd_s": result.mean.period_error,
            "drift": result.mean.drift,
            "drift_sd": result.mean.drift_error,
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
        # of a pole that is refused for the size of its region alone
        "region": [_solution(s) for s in result.too_wide],
        # from the fit, if there is one; not a result if a condition fails
        "sky_fraction": None if sky is None else sky.area,
        "symmetry": None if sky is None else sky.symmetry,
        "shape_shift_deg": None if sky is None else sky.shape_deg,
        "chi2": None if sky is None else sky.chi2,
        "dof": None if sky is None else sky.freedom,
    }


def _solution(s: Solution) -> SpinSolution:
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
