"""Result of `lcbayes.survey`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.analysis import style, survey_page
from lcbayes.analysis.numerals import duration
from lcbayes.core.reasons import Reason
from lcbayes.results import survey_table
from lcbayes.results.content import SurveyContent
from lcbayes.results.record import Record
from lcbayes.results.result import Result
from lcbayes.results.survey_table import COLUMNS, TEXTS, SurveyTable

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Survey(Result[SurveyContent]):
    """The probable spins of many objects, as one table."""

    task = "survey"

    def __init__(
        self,
        content: Mapping[str, object],
        reasons: Sequence[Reason],
        record: Mapping[str, Any],
        table: SurveyTable,
    ) -> None:
        super().__init__(content, reasons, record)
        self._table = table

    @classmethod
    def from_folder(
        cls, folder: Path, content: Mapping[str, object], reasons: Sequence[Reason], record: Record
    ) -> Survey:
        """The survey in a results folder."""
        return cls(content, reasons, record.content, survey_table.of_folder(folder))

    @property
    def data(self) -> SurveyTable:
        """The table, which is read in parts."""
        return self._table

    def summary(self) -> pd.DataFrame:
        """One row for each object and solution, and one for each failure; the whole table."""
        import pandas as pd

        table = pd.DataFrame(self._table.rows(), columns=list(COLUMNS))
        kinds = {name: str if name in TEXTS else float for name in COLUMNS}
        return table.fillna(dict.fromkeys(TEXTS, "")).astype(kinds)

    def lines(self) -> list[str]:
        c = self.content
        lines = [
            f"{c['n_objects']} objects: {c['n_trusted']} trusted, {c['n_not_trusted']} not "
            f"trusted, {c['n_failed']} failed",
            f"{c['n_unique']} have a period with probability {survey_table.UNIQUE:g} or more",
        ]
        if c["objects_per_hour"]:
            took = duration(c["seconds"])
            lines.append(f"{c['objects_per_hour']:.0f} objects per hour, {c['workers']}, in {took}")
        lines += [f"failed {f['count']} times: {f['text']}" for f in c["failures"][:3]]
        return lines

    def write_files(self, folder: Path) -> None:
        (folder / "tables").mkdir(exist_ok=True)
        survey_table.write(self._table, folder / "tables", self.content["n_objects"])

    def write_page(self, folder: Path) -> None:
        survey_page.write_page(folder, self._table, self.content, self.record)

    def plot_objects(self) -> list[Figure]:
        """Periods, amplitudes and poles of all objects."""
        first = survey_page.First.of(self._table)
        return style.figures(lambda gallery: survey_page.draw(first, gallery))
