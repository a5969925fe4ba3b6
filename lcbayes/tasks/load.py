"""`lcbayes.load`: load the result in a results folder."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.core.errors import InputError
from lcbayes.core.paths import as_path
from lcbayes.core.reasons import Reason
from lcbayes.results.load import read_summary
from lcbayes.results.reasons import stored
from lcbayes.results.record import Record, read_record
from lcbayes.results.result import Result
from lcbayes.results.store import RECORD

if TYPE_CHECKING:
    import pandas as pd

CLASSES = {
    "fit": "Fit",
    "compare": "Comparison",
    "scan": "Scan",
    "batch": "Batch",
    "survey": "Survey",
}


def load(folder: str | Path) -> Result[Any]:
    """Load the result in a results folder.

    Nothing outside the folder is read, and no code named in the folder is run.

    Parameters
    ----------
    folder : path
        A folder that a task wrote with ``out`` or ``-o``.

    Returns
    -------
    Result
        `Fit`, `Comparison`, `Scan`, `Batch` or `Survey`; for the other tasks a `SavedResult`, which
        has the content and the tables.

    Raises
    ------
    InputError
        The folder holds no results, results of another version, or damaged results.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> folder = tempfile.mkdtemp()
    >>> curve = lcbayes.simulate("one-facet", seed=1, out=f"{folder}/one.csv").data
    >>> short = dict(num_starts=8, num_warmup=10, num_samples=10, num_chains=2, report=False)
    >>> fit = lcbayes.fit(curve, n_facets=1, spin="none", out=f"{folder}/fit", **short)
    >>> lcbayes.load(f"{folder}/fit").summary().equals(fit.summary())
    True
    """
    folder = as_path(folder, "the folder")
    if not (folder / RECORD).is_file():
        raise InputError(f"{folder} holds no results of lcbayes; give a folder that -o named")
    record = read_record(folder / RECORD)
    content = read_summary(folder)
    if content.get("task") != record.task:
        raise InputError(
            f"summary.json and run.toml of {folder} are of different tasks; run the command again"
        )
    kind: Any = SavedResult
    if record.task in CLASSES:
        kind = getattr(import_module(f"lcbayes.tasks.{record.task}.result"), CLASSES[record.task])
    try:
        result = kind.from_folder(folder, content, stored(content), record)
    except (KeyError, TypeError, AttributeError) as fault:
        raise InputError(
            f"the results in {folder} are damaged ({type(fault).__name__}: {fault}); run the "
            "command again"
        ) from fault
    result.folder = folder
    return result


class SavedResult(Result[dict[str, Any]]):
    """A result loaded with its content and tables, but without its arrays."""

    def __init__(
        self,
        content: Mapping[str, Any],
        reasons: Sequence[Reason],
        record: Mapping[str, Any],
        tables: Mapping[str, pd.DataFrame],
    ) -> None:
        super().__init__(content, reasons, record)
        self.task = str(content["task"])  # pyright: ignore[reportAttributeAccessIssue]
        self._tables = dict(tables)

    @classmethod
    def from_folder(
        cls, folder: Path, content: Mapping[str, Any], reasons: Sequence[Reason], record: Record
    ) -> SavedResult:
        """The result in any results folder."""
        import pandas as pd

        files = sorted((folder / "tables").glob("*.csv"))
        try:
            tables = {path.stem: pd.read_csv(path) for path in files}
        except (OSError, ValueError) as fault:
            raise InputError(
                f"a table in {folder} cannot be read ({fault}); run the command again"
            ) from None
        return cls(content, reasons, record.content, tables)

    def tables(self) -> dict[str, pd.DataFrame]:
        return dict(self._tables)

    def summary(self) -> pd.DataFrame:
        """The table ``solutions`` if there is one, else the first table; without tables, the
        numbers and texts of ``summary.json``."""
        import pandas as pd

        if self._tables:
            return self._tables.get("solutions", next(iter(self._tables.values())))
        return pd.DataFrame(self._plain().items(), columns=["name", "value"])

    def lines(self) -> list[str]:
        return [f"{name}: {json.dumps(value)}" for name, value in self._plain().items()]

    def write_page(self, folder: Path) -> None:  # noqa: ARG002
        raise InputError(
            f"the figures of lcbayes {self.task} are drawn only when it runs; run it again with "
            f"lcbayes {self.task} --config {self.folder}/{RECORD} -o DIR"
        )

    def __getattr__(self, name: str) -> Any:
        if name.startswith("plot_"):
            raise InputError(
                f"a loaded result of lcbayes {self.task} has no figures; run the task again for "
                "them"
            )
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def _plain(self) -> dict[str, Any]:
        items = self._content.items()
        return {k: v for k, v in items if isinstance(v, str | int | float | bool)}
