"""Result of `lcbayes.look`."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from lcbayes.analysis import look_report
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin.candidates import Candidates
from lcbayes.tasks.deterministic import DeterministicResult, about, figure_of
from lcbayes.tasks.look.advice import COST, Advice
from lcbayes.tasks.look.description import Description, rows_of_passes

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

ADVICE = ("command", "answers", "suits", "why", "cost_s")
PERIODS = ("period_s", "explained", "cycles", "of_base")


class LookResult(DeterministicResult):
    """Content of a light curve, candidate periods and possible commands.

    Attributes
    ----------
    data : lcbayes.inversion.spin.candidates.Candidates or None
        Periodogram and candidate periods; None if there are too few points for a period.
    curve : LightCurve
    """

    task = "look"

    def __init__(
        self,
        curve: LightCurve,
        description: Description,
        found: Candidates | None,
        advice: list[Advice],
    ) -> None:
        content = about(curve) | description.facts
        content["passes"] = rows_of_passes(curve, description.passes)
        content["periods"] = _periods(found)
        content["commands"] = [asdict(one) for one in advice]
        content["cost_basis"] = COST
        super().__init__(found, content)
        self.curve = curve
        self._passes = description.passes

    def summary(self) -> pd.DataFrame:
        """One row per command: what it determines, whether the curve suits it, rough cost (s)."""
        import pandas as pd

        return pd.DataFrame(self.content["commands"], columns=list(ADVICE))

    def tables(self) -> dict[str, pd.DataFrame]:
        """Commands, passes, and candidate periods."""
        import pandas as pd

        listed = (self.content["periods"] or {}).get("listed", [])
        return {
            "commands": self.summary(),
            "passes": pd.DataFrame(self.content["passes"]),
            "periods": pd.DataFrame(listed, columns=list(PERIODS)),
        }

    def lines(self) -> list[str]:
        return look_report.words(self.content)

    def write_page(self, folder: Any) -> None:
        look_report.write_page(folder, self, self.draw, self.explored())

    def candidates(self) -> list[tuple[str, float]]:
        if self.data is None or not self.data.significant:
            return []
        return [(f"candidate {i}", one.period_s) for i, one in enumerate(self.data.listed, 1)]

    def draw(self, gallery: Gallery) -> None:
        look_report.draw(self.curve, self._passes, self.data, gallery)

    def plot_light_curve(self) -> Figure:
        """Brightness against time, one panel for each pass."""
        return figure_of(look_report.draw_passes, self.curve, self._passes)

    def plot_phase_angle(self) -> Figure:
        """Brightness against the phase angle."""
        return figure_of(look_report.draw_phase_angle, self.curve, self._passes)

    def plot_periodogram(self) -> Figure:
        """Part of χ² explained against the period, with the candidates."""
        return figure_of(look_report.draw_periodogram, self.data)

    def plot_folded(self) -> Figure:
        """The points folded with the best period and twice that period."""
        return figure_of(look_report.draw_folded, self.data)


def _periods(found: Candidates | None) -> dict[str, Any] | None:
    """The content of ``summary.json`` about periods."""
    if found is None:
        return None
    return {
        "significant": found.significant,
        "false_alarm_probability": found.spin.false_alarm,
        "nights_joined": found.joined,
        "longest_searched_s": 1.0 / float(found.spin.grid[0]),
        "shortest_searched_s": 1.0 / float(found.spin.grid[-1]),
        "listed": [asdict(one) for one in found.listed],
        "conditions": [vars(c) for c in found.spin.conditions],
        "notes": found.notes,
    }
