"""Result of `lcbayes.attitude_test`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lcbayes.analysis import attitude_test_report
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.attitude_test import AttitudeTest
from lcbayes.tasks.attitude_test.options import AttitudeTestOptions
from lcbayes.tasks.deterministic import DeterministicResult, about, figure_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

LAWS = (
    "name",
    "settings",
    "tested",
    "reason",
    "p_value",
    "statistic",
    "expected",
    "n_pairs",
    "n_points",
    "same_as",
)
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


class AttitudeTestResult(DeterministicResult):
    """The p-value of each attitude law.

    Attributes
    ----------
    data : lcbayes.inversion.separated.attitude_test.AttitudeTest
    """

    task = "attitude-test"

    def __init__(
        self, found: AttitudeTest, curve: LightCurve, options: AttitudeTestOptions
    ) -> None:
        asked = {
            "separation_deg": options.separation,
            "n_bodies": options.bodies,
            "seed": options.seed,
        }
        content = about(curve) | asked | _numbers(found)
        super().__init__(found, content, found.reasons)

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

    def draw(self, gallery: Gallery) -> None:
        attitude_test_report.draw(self.data, gallery)

    def plot_laws(self) -> Figure:
        """The p-value of each tested law."""
        return figure_of(attitude_test_report.draw_laws, self.data)

    def plot_pairs(self) -> Figure:
        """Differences of flux within the pairs of the best and the worst law."""
        return figure_of(attitude_test_report.draw_pairs, self.data)


def _numbers(result: AttitudeTest) -> dict[str, Any]:
    return {
        "n_obs": result.n_obs,
        "n_glints_left_out": result.n_glints,
        "level": result.level,
        "laws": [
            {k: getattr(v, k) for k in LAWS} | {"rejected": result.rejected(v)}
            for v in result.verdicts
        ],
    }
