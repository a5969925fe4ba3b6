"""The result that every task returns: a verdict, a table, the data, and methods to write them."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import html
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_json
from lcbayes.core.reasons import Reason
from lcbayes.results import store

if TYPE_CHECKING:
    import pandas as pd

DO_NOT_TRUST = "DO NOT TRUST THIS RESULT:"


@dataclass(frozen=True)
class Page:
    """A report that a notebook shows in a frame of its own.

    Attributes
    ----------
    html : the page, without references to other files
    height : of the frame, pixels
    """

    html: str
    height: int

    def _repr_html_(self) -> str:
        page = html.escape(self.html, quote=True)
        frame = "width:100%;border:1px solid #ccc;border-radius:6px"
        return (
            f'<iframe srcdoc="{page}" style="{frame};height:{self.height}px" title="report" '
            'sandbox="allow-scripts allow-downloads"></iframe>'
        )


class Result[C: Mapping[str, object]](ABC):
    """The result of a task; its type parameter is that of ``content``.

    Parameters
    ----------
    content : mapping
        Content of ``summary.json`` besides the verdict.
    reasons : reasons not to trust the result; empty if it is trusted
    record : mapping
        Content of ``run.toml``: what is needed to repeat the run, and hashes of the files read.

    Attributes
    ----------
    task : name of the task on the command line
    folder : the folder to which the result was written or from which it was loaded; None before
    source : what the task was given, such as a light curve; None if the result was loaded
    """

    task: ClassVar[str]
    folder: Path | None = None
    source: Any = None

    def __init__(
        self, content: Mapping[str, object], reasons: Sequence[Reason], record: Mapping[str, Any]
    ) -> None:
        self._content: dict[str, Any] = dict(content)
        self.reasons = tuple(reasons)
        self.record = dict(record)

    @property
    def trusted(self) -> bool:
        """Whether there is no reason against the result."""
        return not self.reasons

    @property
    def content(self) -> C:
        """The content of ``summary.json``."""
        verdict: dict[str, Any] = {
            "schema": store.SCHEMA,
            "task": self.task,
            "trusted": self.trusted,
            "reasons": [reason.content for reason in self.reasons],
        }
        return cast(C, verdict | self._content)

    @property
    def data(self) -> Any:
        """The data behind the summary: a DataTree of draws, or what the task computed."""
        return self._content

    @abstractmethod
    def summary(self) -> pd.DataFrame:
        """The result as a table: one row per quantity or solution, with units in the columns."""

    @abstractmethod
    def lines(self) -> list[str]:
        """The result as lines of text, without the verdict."""

    def tables(self) -> dict[str, pd.DataFrame]:
        """Tables to write into ``tables/`` as CSV, by name."""
        return {}

    def write_files(self, folder: Path) -> None:  # noqa: B027 - most tasks add no files
        """Write the data files besides the summary, such as draws and shapes."""

    @abstractmethod
    def write_page(self, folder: Path) -> None:
        """Write ``report.html`` and ``figures/`` into a folder that holds the numbers."""

    def text(self) -> str:
        """The verdict if it is against the result, and the lines."""
        verdict = [DO_NOT_TRUST, *(f"  - {reason}" for reason in self.reasons)]
        return "\n".join([*(verdict if self.reasons else []), *self.lines()])

    def save(self, folder: str | Path) -> Path:
        """Write the data: ``summary.json``, ``run.toml``, ``tables/`` and files of the task.

        Raises
        ------
        InputError
            The folder cannot be written or holds results of another task.
        """
        with store.results_folder(folder, self.task) as opened:
            self.write(opened, report=False)
        return Path(folder)

    def report(self, folder: str | Path) -> Path:
        """Write the files of `save`, the figures and ``report.html``; returns its path."""
        with store.results_folder(folder, self.task) as opened:
            self.write(opened, report=True)
        return Path(folder) / "report.html"

    def write(self, folder: store.ResultsFolder, *, report: bool) -> None:
        """Write into a folder that this process has locked."""
        with folder.staging() as staging:
            self.write_numbers(staging)
            store.write_record(staging, {"task": self.task, **self.record})
            if report:
                self.write_page(staging)
        self.folder = folder.path

    def write_numbers(self, folder: Path) -> None:
        """Write ``summary.json``, ``tables/`` and the data files into a plain folder."""
        write_json(self.content, folder / store.SUMMARY)
        if tables := self.tables():
            (folder / "tables").mkdir()
        for name, table in tables.items():
            table.to_csv(folder / "tables" / f"{name}.csv", index=False, lineterminator="\n")
        self.write_files(folder)

    def write_report(self) -> Path:
        """Write the report again into the folder of the result; the data do not change."""
        if self.folder is None:
            raise InputError("the result is in no folder yet; give one to its method report")
        with (
            store.results_folder(self.folder, self.task) as opened,
            opened.staging(store.PAGE) as staging,
        ):
            self.write_page(staging)
        return self.folder / "report.html"

    def view(self, height: int = 900) -> Page:
        """The report as an object that a notebook shows, without a file on disk.

        Parameters
        ----------
        height : int
            Height of the frame, pixels.
        """
        if self.folder is not None and (self.folder / "report.html").is_file():
            return Page((self.folder / "report.html").read_text(encoding="utf-8"), height)
        before = self.folder
        with tempfile.TemporaryDirectory() as scratch:
            text = self.report(scratch).read_text(encoding="utf-8")
        self.folder = before
        return Page(text, height)

    def __repr__(self) -> str:
        verdict = "trusted" if self.trusted else "NOT to be trusted"
        return f"<{type(self).__name__}: {verdict}>\n{self.text()}"

    def _repr_html_(self) -> str:
        verdict = ""
        if self.reasons:
            items = "".join(f"<li>{html.escape(reason.text)}</li>" for reason in self.reasons)
            verdict = f"<p><b>{DO_NOT_TRUST}</b></p><ul>{items}</ul>"
        return verdict + self.summary().to_html(index=False)
