"""Result of `lcbayes.predict`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis import style
from lcbayes.core.files import write_text
from lcbayes.core.reasons import Reason
from lcbayes.results.content import Verdict
from lcbayes.results.result import Result

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class PredictContent(Verdict):
    """Content of the summary of `lcbayes.predict`."""

    notes: list[str]


class Prediction(Result[PredictContent]):
    """Predicted brightness: mean and central 50 % and 90 % intervals at each epoch.

    It is trusted if the fit is trusted; ``notes`` explain the numbers.
    """

    task = "predict"

    def __init__(
        self, columns: Mapping[str, Any], notes: Sequence[str], reasons: Sequence[Reason]
    ) -> None:
        super().__init__({"notes": list(notes)}, reasons, {})
        self.notes = tuple(notes)
        self._columns = {k: np.asarray(v) for k, v in columns.items()}
        size = len(next(iter(self._columns.values())))
        self._columns["trusted"] = np.full(size, "true" if self.trusted else "false")

    @property
    def data(self) -> dict[str, Any]:
        """The columns of the table as arrays (T,)."""
        return self._columns

    def summary(self) -> pd.DataFrame:
        """One row per epoch: time (JD or s), curve, brightness (mag or W/m²), trusted."""
        import pandas as pd

        return pd.DataFrame(self._columns).assign(trusted=self.trusted)

    def tables(self) -> dict[str, pd.DataFrame]:
        return {"brightness": self.summary()}

    def lines(self) -> list[str]:
        kind = next(name for name in self._columns if name.endswith("_mean"))
        return [
            *(f"note: {note}" for note in self.notes),
            f"{kind.removesuffix('_mean')} predicted at {len(self._columns[kind])} epochs",
        ]

    def save(self, folder: str | Path) -> Path:
        """Write the table as a CSV file with this path."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self._columns)
        cells = [column.tolist() for column in self._columns.values()]
        writer.writerows(zip(*cells, strict=True))  # floats as repr, the shortest exact form
        write_text(text.getvalue(), folder)
        return Path(folder)

    def write_page(self, folder: Path) -> None:
        from lcbayes.analysis import small_report

        def draw(gallery: style.Gallery) -> None:
            gallery.add(self._figure(gallery), "brightness", "Predicted brightness.")

        small_report.write_page(folder, self, draw)

    def plot_light_curve(self) -> list[Figure]:
        """The predicted brightness with its intervals."""

        def draw(gallery: style.Gallery) -> None:
            gallery.add(self._figure(gallery), "brightness", "")

        return style.figures(draw)

    def _figure(self, gallery: style.Gallery) -> Figure:
        columns = self._columns
        name = next(k for k in columns if k.endswith("_mean")).removesuffix("_mean")
        time = columns.get("jd", columns.get("t"))
        figure = gallery.figure(8.0, 3.3)
        axes = figure.subplots()
        for low, high, alpha in (("q05", "q95", 0.2), ("q25", "q75", 0.35)):
            ends = (columns[f"{name}_{q}"] for q in (low, high))
            axes.vlines(time, *ends, color=style.colour(0), alpha=alpha, lw=3)
        axes.plot(time, columns[f"{name}_mean"], ".", ms=4, color=style.INK)
        if name == "mag":
            axes.invert_yaxis()
        axes.set_xlabel("Julian date (UTC)" if "jd" in columns else "t (s)")
        axes.set_ylabel("magnitude" if name == "mag" else "flux")
        return figure
