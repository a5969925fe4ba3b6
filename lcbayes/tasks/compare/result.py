"""Result of `lcbayes.compare`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.analysis import comparison_page, style
from lcbayes.core.reasons import Reason
from lcbayes.inference.body_kind import folder_name
from lcbayes.results.comparison import COLUMNS, of_bodies, table
from lcbayes.results.content import CandidateContent, CompareContent, RuledOutContent
from lcbayes.results.load import read_summary
from lcbayes.results.reasons import stored
from lcbayes.results.record import Record
from lcbayes.results.result import Result
from lcbayes.tasks.compare.options import CompareOptions
from lcbayes.tasks.fit.result import Fit

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


FOLDER = "facets-{}"  # of the posterior with so many facets, in the results folder


def folder_of(key: int | str) -> str:
    """The folder of the posterior of a number of facets or of a kind of body."""
    return FOLDER.format(key) if isinstance(key, int) else f"body-{folder_name(key)}"


class Comparison(Result[CompareContent]):
    """Numbers of facets or kinds of body with their evidence, and the conclusion.

    Attributes
    ----------
    fits : dict
        The posterior of each number of facets, or kind of body by name, that was sampled. Each is
        written into a folder ``facets-N`` or ``body-NAME``: ``posterior.nc``, ``summary.json``,
        tables, and with the page also the figures and the shape.
    """

    task = "compare"

    def __init__(
        self,
        content: Mapping[str, Any],
        reasons: Sequence[Reason],
        record: Mapping[str, Any],
        fits: Mapping[int | str, Fit] | None = None,
    ) -> None:
        super().__init__(content, reasons, record)
        self.fits = dict(fits or {})

    @classmethod
    def from_folder(
        cls, folder: Path, content: Mapping[str, Any], reasons: Sequence[Reason], record: Record
    ) -> Comparison:
        """The comparison in a results folder."""
        fits = {}
        for row in content["candidates"]:
            key = row.get("body") or row["n_facets"]
            within = folder / folder_of(key)
            if (within / "posterior.nc").is_file():
                summary = read_summary(within)
                fits[key] = Fit.from_folder(within, summary, stored(summary), record)
        return cls(content, reasons, record.content, fits)

    @property
    def conclusion(self) -> str:
        """The conclusion in one sentence."""
        return self.content["conclusion"]

    @property
    def probability(self) -> dict[int | str, float]:
        """Posterior probability of each number of facets, or of each kind of body."""
        rows = self._rows()
        return {row.get("body") or row["n_facets"]: float(row["probability"]) for row in rows}

    def summary(self) -> pd.DataFrame:
        """One row per number of facets or kind of body; see `results.comparison.COLUMNS`."""
        import pandas as pd

        columns = [name for name in COLUMNS if name != "body" or of_bodies(self.content)]
        return pd.DataFrame(self._rows(), columns=columns)

    def tables(self) -> dict[str, pd.DataFrame]:
        return {"candidates": self.summary()}

    def lines(self) -> list[str]:
        """The table, its notes and the conclusion."""
        return table(self.content)

    def write_files(self, folder: Path) -> None:
        for key, fit in self.fits.items():
            within = folder / folder_of(key)
            within.mkdir()
            fit.write_numbers(within)

    def write_page(self, folder: Path) -> None:
        for key, fit in self.fits.items():
            within = folder / folder_of(key)
            if within.is_dir():  # not if the page alone is written again
                fit.write_page(within)
        comparison_page.write_page(folder, self.content, self.record, CompareOptions)

    def plot_evidence(self) -> list[Figure]:
        """Posterior probability, evidence and predictive density of each number."""
        content = self.content

        def draw(gallery: style.Gallery) -> None:
            figure = comparison_page.draw(content["candidates"], gallery, content["ruled_out"])
            gallery.add(figure, "compare", comparison_page.ALT)

        return style.figures(draw)

    def _rows(self) -> list[CandidateContent | RuledOutContent]:
        every = [*self.content["candidates"], *self.content["ruled_out"]]
        if of_bodies(self.content):
            return every
        return sorted(every, key=lambda row: row["n_facets"])
