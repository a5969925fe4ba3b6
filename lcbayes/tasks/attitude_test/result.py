"""Result of `lcbayes.attitude_test`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, TypedDict

from lcbayes.analysis import attitude_test_report
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.attitude_test import AttitudeTest
from lcbayes.results.content import Verdict
from lcbayes.tasks.attitude_test.options import AttitudeTestOptions
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

COLUMNS = (
    "law",
    "tested",
    "rejected",
    "p_value",
    "statistic",
    "expected",
    "n_pairs",
    "n_points",
    "same_as",
    "reason",
)


class LawContent(TypedDict):
    """The test of one attitude law."""

    name: str
    settings: Mapping[str, object]
    tested: bool
    rejected: bool
    reason: str
    p_value: float
    statistic: float
    expected: float
    n_pairs: int
    n_points: int
    same_as: Sequence[str]


class Asked(TypedDict):
    """The options of a test of attitudes."""

    separation_deg: float
    n_bodies: int
    seed: int


class Numbers(TypedDict):
    """Numbers of a test of attitudes."""

    n_obs: int
    n_glints_left_out: int
    level: float
    laws: list[LawContent]


class AttitudeTestContent(Verdict, CurveContent, Asked, Numbers):
    """Content of the summary of `lcbayes.attitude_test`."""


class AttitudeTestResult(DeterministicResult[AttitudeTest, AttitudeTestContent]):
    """The p-value of each attitude law.

    Attributes
    ----------
    data : lcbayes.inversion.separated.attitude_test.AttitudeTest
    """

    task = "attitude-test"

    def __init__(
        self, tested: AttitudeTest, curve: LightCurve, options: AttitudeTestOptions
    ) -> None:
        asked: Asked = {
            "separation_deg": options.separation,
            "n_bodies": options.bodies,
            "seed": options.seed,
        }
        content = {**about(curve), **asked, **_numbers(tested)}
        super().__init__(tested, content, tested.reasons)

    def summary(self) -> pd.DataFrame:
        """One row per law, highest p-value first."""
        import pandas as pd

        rows = [
            law | {"law": law["name"], "same_as": ", ".join(law["same_as"])}
            for law in self.content["laws"]
        ]
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def lines(self) -> list[str]:
        return attitude_test_report.words(self.data)

    def tables(self) -> dict[str, pd.DataFrame]:
        """The laws."""
        return {"laws": self.summary()}

    def listing(self) -> tuple[Listing, list[str]]:
        return attitude_test_report.table(self.data), attitude_test_report.remarks(self.data)

    def draw(self, gallery: Gallery) -> None:
        attitude_test_report.draw(self.data, gallery)

    def plot_laws(self) -> Figure:
        """The p-value of each tested law."""
        return figure_of(attitude_test_report.draw_laws, self.data)

    def plot_pairs(self) -> Figure:
        """Differences of flux within the pairs of the best and the worst law."""
        return figure_of(attitude_test_report.draw_pairs, self.data)


def _numbers(result: AttitudeTest) -> Numbers:
    return {
        "n_obs": result.n_obs,
        "n_glints_left_out": result.n_glints,
        "level": result.level,
        "laws": [
            {
                "name": v.name,
                "settings": v.settings,
                "tested": v.tested,
                "reason": v.reason,
                "p_value": v.p_value,
                "statistic": v.statistic,
                "expected": v.expected,
                "n_pairs": v.n_pairs,
                "n_points": v.n_points,
                "same_as": v.same_as,
                "rejected": result.rejected(v),
            }
            for v in result.verdicts
        ],
    }
