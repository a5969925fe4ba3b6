"""Result of `lcbayes.scan`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis import scan_page, scan_plots, style
from lcbayes.core.reasons import Reason
from lcbayes.core.text import probability
from lcbayes.inversion.attitude_scan import nights
from lcbayes.inversion.attitude_scan.result import AttitudeScan, written_period
from lcbayes.results.content import ScanContent, ScanSolution
from lcbayes.results.record import Record
from lcbayes.results.result import Result
from lcbayes.results.scan_file import load_scan, save_scan
from lcbayes.tasks.commands import onward
from lcbayes.tasks.scan.options import ScanOptions

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

FILE = "scan.nc"
COLUMNS = {
    "law": "law",
    "pole_lon_deg": "pole_lon_deg",
    "pole_lat_deg": "pole_lat_deg",
    "period_h": "sidereal_period_h",
    "chi2": "chi2",
    "rms": "rms",
    "near_equal": "near_equal",
    "probability": "probability",
    "words": "relation",
}


class Scan(Result[ScanContent]):
    """Solutions of an attitude scan, best first."""

    task = "scan"

    def __init__(
        self,
        scan: AttitudeScan,
        content: Mapping[str, object],
        reasons: Sequence[Reason],
        record: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(content, reasons, record or {})
        self._scan = scan

    @classmethod
    def from_folder(
        cls, folder: Path, content: Mapping[str, object], reasons: Sequence[Reason], record: Record
    ) -> Scan:
        """The scan in a results folder."""
        return cls(load_scan(folder / FILE), content, reasons, record.content)

    @property
    def data(self) -> AttitudeScan:
        """Every hypothesis and every solution, as arrays."""
        return self._scan

    @property
    def solutions(self) -> list[ScanSolution]:
        """Solutions, best first: pole and period or law, chi2, rms, and relation to the best."""
        return self.content["solutions"]

    def summary(self) -> pd.DataFrame:
        """One row per solution: law, pole (deg), sidereal period (h), chi2, rms, relation."""
        import pandas as pd

        known = [c for c in COLUMNS if c != "probability" or "probability" in self.solutions[0]]
        return pd.DataFrame(self.solutions).reindex(columns=known).rename(columns=COLUMNS)

    def tables(self) -> dict[str, pd.DataFrame]:
        """Solutions, every hypothesis with its chi2, and nights that could be observed."""
        import pandas as pd

        heads, rows = self._scan.table()
        tables = {"solutions": self.summary(), "hypotheses": pd.DataFrame(rows, columns=heads)}
        if (ahead := self.content.get("nights")) is not None:
            tables["nights"] = pd.DataFrame(ahead["nights"])
        return tables

    def lines(self) -> list[str]:
        content = self.content
        lines = [
            f"{content['n_hypotheses']} hypotheses: {content['n_periods']} periods, "
            f"{content['n_laws']} laws; the best of them:",
            "     lon      lat         period        chi2     rms",
        ]
        for i, s in enumerate(self.solutions, start=1):
            what = f"{s['law']:29s}"
            if (period := s.get("period_h")) is not None:
                shown = written_period(period, s.get("period_resolution_h", 0.0))
                lon, lat = s.get("pole_lon_deg", np.nan), s.get("pole_lat_deg", np.nan)
                what = f"{lon:6.1f}  {lat:+6.1f}  {shown:>13s}"
            mark = "=" if s["near_equal"] else " "
            p = f"  P {s['probability']:5.3f}" if "probability" in s else ""
            fit = f"{s['chi2']:10.5g}  {s['rms']:6.4f}"
            lines.append(f"{i:2d}{mark}{what}  {fit}{p}  {s['words']}")
        if (chance := content["period_probability"]) is None:
            limit = content["fit"]["chi2_near_equal"]
            lines.append(
                f"= fits as well as the best: chi2 up to {limit:.5g} is noise, or 5 % of residuals"
            )
        else:
            lines.append(
                f"= one of these with probability 0.99; the period of 1: {probability(chance)}"
            )
        if (ahead := content.get("nights")) is not None:
            lines += nights.words(ahead)
        spins = any(s["near_equal"] and "period_h" in s for s in self.solutions)
        return lines + (onward(self) if spins else [])

    def write_files(self, folder: Path) -> None:
        save_scan(self._scan, folder / FILE)

    def write_page(self, folder: Path) -> None:
        scan_page.write_page(folder, self._scan, self.content, self.record, ScanOptions)

    def plot_light_curve(self) -> list[Figure]:
        """Observed brightness with the best solution."""
        return style.figures(lambda g: scan_plots.draw_fit(self._scan, g))

    def plot_sky(self) -> list[Figure]:
        """Goodness of fit of poles over the whole sky at the best period."""
        return style.figures(lambda g: scan_plots.draw_sky(self._scan, g))

    def plot_periods(self) -> list[Figure]:
        """Goodness of fit of the trial periods."""
        return style.figures(lambda g: scan_plots.draw_periods(self._scan, g))

    def plot_laws(self) -> list[Figure]:
        """Goodness of fit of the stabilised attitudes."""
        return style.figures(lambda g: scan_plots.draw_laws(self._scan, g))

    def plot_body(self) -> list[Figure]:
        """The body of the best solution, if its facets close."""
        body = scan_page.body_of(self._scan)
        return [] if body is None else style.figures(lambda g: scan_plots.draw_shape(body, g))
