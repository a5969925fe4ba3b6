"""Result of `lcbayes.batch`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.analysis import batch_page, style
from lcbayes.core.reasons import Reason
from lcbayes.results.catalogue import cells, heads
from lcbayes.results.content import BatchContent
from lcbayes.results.record import Record
from lcbayes.results.result import Result

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Batch(Result[BatchContent]):
    """The results of many objects, each with a results folder ``objects/NAME``."""

    task = "batch"

    @classmethod
    def from_folder(
        cls, _: Path, content: Mapping[str, object], reasons: Sequence[Reason], record: Record
    ) -> Batch:
        """The batch in a results folder."""
        return cls(content, reasons, record.content)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The row of each object, in the order of the catalogue."""
        return self.content["objects"]

    def summary(self) -> pd.DataFrame:
        """One row per object: status, goodness of fit, spin and size of its heaviest solution."""
        import pandas as pd

        return pd.DataFrame(map(cells, self.rows), columns=heads(self.rows), dtype=object)

    def tables(self) -> dict[str, pd.DataFrame]:
        return {"objects": self.summary()}

    def lines(self) -> list[str]:
        content = self.content
        lines = [
            f"{content['n_objects']} objects: {content['n_trusted']} trusted, "
            f"{content['n_not_trusted']} not trusted, {content['n_failed']} failed"
        ]
        if content["objects_per_hour"]:
            lines.append(
                f"{content['objects_per_hour']:.0f} objects per hour, {content['workers']}"
            )
        return lines

    def write_page(self, folder: Path) -> None:
        batch_page.write_page(folder, self.content, self.record)

    def plot_objects(self) -> list[Figure]:
        """Goodness of fit and size or residuals of every object."""

        def draw(gallery: style.Gallery) -> None:
            gallery.add(batch_page.draw(self.rows, gallery), "batch", batch_page.ALT)

        return style.figures(draw)
