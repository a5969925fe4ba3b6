"""Result of `lcbayes.look`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any, TypedDict

from lcbayes.analysis import look_report
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.spin.candidates import Candidates
from lcbayes.results.content import Verdict
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of
from lcbayes.tasks.look.advice import COST, Advice
from lcbayes.tasks.look.description import Description, rows_of_passes
from lcbayes.tasks.spin.conditions import ConditionContent, condition_content

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

ADVICE = ("command", "answers", "suits", "why", "cost_s")
PERIODS = ("period_s", "explained", "cycles", "of_base")


class PeriodContent(TypedDict):
    """One candidate period; ``of_base`` is its harmonic of the base period, or 0."""

    period_s: float
    explained: float
    cycles: float
    of_base: int


class PeriodsContent(TypedDict):
    """Candidate periods and the range searched."""

    significant: bool
    false_alarm_probability: float
    nights_joined: bool
    longest_searched_s: float
    shortest_searched_s: float
    listed: list[PeriodContent]
    conditions: list[ConditionContent]
    notes: list[str]


class CommandContent(TypedDict):
    """A command that could be run; ``cost_s`` is not a number if the curve does not suit it."""

    command: str
    answers: str
    suits: bool
    why: str
    cost_s: float


class Numbers(TypedDict):
    """What the light curve holds."""

    format: str
    notes: list[str]
    kind: str
    n_obs: int
    n_curves: int
    curves_of_unknown_scale: int
    n_passes: int
    span_s: float
    first_jd: float | None
    last_jd: float | None
    cadence_s: float | None
    longest_pass_s: float
    sites: dict[str, int]
    bands: dict[str, int]
    brightness_range: list[float]
    errors: dict[str, Any]
    geometry: bool
    phase_angle_range_deg: list[float] | None
    range_km: list[float] | None
    orbit: bool
    passes: list[dict[str, Any]]
    periods: PeriodsContent | None
    commands: list[CommandContent]
    cost_basis: str


class LookContent(Verdict, CurveContent, Numbers):
    """Content of the summary of `lcbayes.look`."""


class LookResult(DeterministicResult[Candidates | None, LookContent]):
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
        candidates: Candidates | None,
        advice: list[Advice],
    ) -> None:
        content: dict[str, Any] = {**about(curve), **description.facts}
        content["passes"] = rows_of_passes(curve, description.passes)
        content["periods"] = _periods(candidates)
        content["commands"] = [asdict(one) for one in advice]
        content["cost_basis"] = COST
        super().__init__(candidates, content)
        self.curve = curve
        self._passes = description.passes

    def summary(self) -> pd.DataFrame:
        """One row per command: what it determines, whether the curve suits it, rough cost (s)."""
        import pandas as pd

        return pd.DataFrame(self.content["commands"], columns=list(ADVICE))

    def tables(self) -> dict[str, pd.DataFrame]:
        """Commands, passes, and candidate periods."""
        import pandas as pd

        periods = self.content["periods"]
        listed = [] if periods is None else periods["listed"]
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


def _periods(candidates: Candidates | None) -> dict[str, Any] | None:
    """The content of ``summary.json`` about periods."""
    if candidates is None:
        return None
    return {
        "significant": candidates.significant,
        "false_alarm_probability": candidates.spin.false_alarm,
        "nights_joined": candidates.joined,
        "longest_searched_s": 1.0 / float(candidates.spin.grid[0]),
        "shortest_searched_s": 1.0 / float(candidates.spin.grid[-1]),
        "listed": [asdict(one) for one in candidates.listed],
        "conditions": [condition_content(c) for c in candidates.spin.conditions],
        "notes": candidates.notes,
    }
