"""The table of a survey: one row for each object and solution, and one for each failure."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas and pyarrow come without complete types)

from __future__ import annotations

import csv
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_atomic
from lcbayes.core.reasons import Finding
from lcbayes.data.catalogues.parquet import arrow
from lcbayes.results.catalogue import FAILED, NOT_TRUSTED, TRUSTED
from lcbayes.results.content import SurveyNumbers
from lcbayes.results.journal import Journal

OBJECT = ("n_obs", "n_curves", "span_days", "frame")  # columns that hold for all solutions
SOLUTION = (
    "period_h",
    "period_resolution_h",
    "pole_lon_deg",
    "pole_lat_deg",
    "period_probability",
    "probability",
    "amplitude_mag",
    "rms",
    "chi2",
)
COLUMNS: tuple[str, ...] = (
    "object",
    "status",
    "solution",
    *OBJECT,
    *SOLUTION,
    "seconds",
    "reasons",
)
INTEGERS, TEXTS = ("solution", "n_obs", "n_curves"), ("object", "status", "frame", "reasons")
NAME = "solutions"  # of the files of the table
SHORT = 10_000  # objects up to which the table is also written as CSV
GROUP = 50_000  # rows that are written at once
UNIQUE = 0.99  # probability of a period that counts as the only one
KINDS, NAMED = 1000, 8  # of failures that are distinguished, and objects that are named

Row = dict[str, Any]


def folder_name(name: str) -> str:
    """The name of an object as that of a folder."""
    return re.sub(r"[^\w.+-]+", "_", name).strip("._") or "_"


def rows_of(content: Mapping[str, Any]) -> Iterator[Row]:
    """The rows of one object of the journal; reasons are in the first."""
    reasons = "; ".join(reason["text"] for reason in content["reasons"])
    common = {"object": content["name"], "status": content["status"]}
    common |= {name: content.get(name) for name in OBJECT}
    for number, values in enumerate(content["solutions"] or [[]], 1):
        known = dict(zip(SOLUTION, values, strict=True)) if values else {}
        yield (
            common
            | known
            | {
                "solution": number if values else None,
                "seconds": content["seconds"],
                "reasons": reasons if number == 1 else "",
            }
        )


@dataclass(frozen=True)
class SurveyTable:
    """The table of a survey, read in parts from the journal or from the files of the table.

    Attributes
    ----------
    objects : function that gives the rows of every object, in the order of the catalogue
    """

    objects: Callable[[], Iterator[list[Row]]]

    def rows(self) -> Iterator[Row]:
        """Every row."""
        for rows in self.objects():
            yield from rows


def of_journal(path: Path, places: Sequence[int]) -> SurveyTable:
    """The table of the objects at these places of a journal; negative ones are not done."""

    def objects() -> Iterator[list[Row]]:
        with Journal(path, scan=False) as journal:
            for place in places:
                if place >= 0:
                    yield list(rows_of(journal.read(place)))

    return SurveyTable(objects)


def of_folder(folder: Path) -> SurveyTable:
    """The table in a results folder."""
    path = folder / "tables" / f"{NAME}.parquet"

    def objects() -> Iterator[list[Row]]:
        held: list[Row] = []
        for row in _of_parquet(path) if path.is_file() else _of_csv(path.with_suffix(".csv")):
            if held and (row["solution"] is None or row["solution"] == 1):
                yield held
                held = []
            held.append(row)
        if held:
            yield held

    return SurveyTable(objects)


def _of_parquet(path: Path) -> Iterator[Row]:
    for batch in arrow().parquet.ParquetFile(path).iter_batches(GROUP):
        for row in batch.to_pylist():
            yield row | {"reasons": row["reasons"] or ""}


def _of_csv(path: Path) -> Iterator[Row]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                yield {k: _value(k, v) for k, v in row.items()}
    except (OSError, ValueError, csv.Error) as fault:
        raise InputError(f"{path} cannot be read ({fault}); run the command again") from None


def _value(name: str, text: str) -> Any:
    if name in TEXTS:
        return text
    if not text:
        return None
    return int(text) if name in INTEGERS else float(text)


def write(table: SurveyTable, folder: Path, n_objects: int) -> None:
    """Write ``solutions.csv`` if there are few objects or no library for Parquet, and
    ``solutions.parquet`` if there is one."""
    try:
        arrow()
    except InputError:
        parquet = False
    else:
        parquet = True
        write_atomic(folder / f"{NAME}.parquet", lambda path: _write_parquet(table, path))
    if n_objects <= SHORT or not parquet:
        write_atomic(folder / f"{NAME}.csv", lambda path: _write_csv(table, path))


def _write_csv(table: SurveyTable, path: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
        writer.writeheader()
        writer.writerows(table.rows())


def _write_parquet(table: SurveyTable, path: Path) -> None:
    pyarrow = arrow()
    kinds = {name: pyarrow.float64() for name in COLUMNS}
    kinds |= {name: pyarrow.int32() for name in INTEGERS}
    kinds |= {name: pyarrow.string() for name in TEXTS}
    schema = pyarrow.schema(list(kinds.items()))
    rows = table.rows()
    with pyarrow.parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        while part := list(islice(rows, GROUP)):
            columns = [[row.get(name) for row in part] for name in COLUMNS]
            arrays = [
                pyarrow.array(column, kind)
                for column, kind in zip(columns, kinds.values(), strict=True)
            ]
            writer.write_table(pyarrow.Table.from_arrays(arrays, schema=schema))


@dataclass
class Counts:
    """What the objects of a survey have in common.

    Attributes
    ----------
    status : number of objects by status
    n_solutions : number of rows with a solution
    n_unique : number of objects whose period has a probability of at least 0.99
    seconds : time of each object
    failures : number of failures, the first object and its reason, by kind
    names : the first objects of each status
    """

    status: Counter[str] = field(default_factory=Counter[str])
    n_solutions: int = 0
    n_unique: int = 0
    seconds: array[float] = field(default_factory=lambda: array("f"))
    failures: dict[str, list[Any]] = field(default_factory=dict[str, list[Any]])
    names: dict[str, list[str]] = field(default_factory=dict[str, list[str]])

    def add(self, rows: list[Row]) -> None:
        """Count an object."""
        first = rows[0]
        self.status[first["status"]] += 1
        named = self.names.setdefault(first["status"], [])
        if len(named) < NAMED:
            named.append(first["object"])
        self.seconds.append(first["seconds"] or 0.0)
        if first["status"] == FAILED:
            # messages that differ in numbers, or in the name of the object, are of one kind
            kind = re.sub(r"\d[\d.]*", "#", first["reasons"].replace(first["object"], "#"))
            kind = kind if kind in self.failures or len(self.failures) < KINDS else "other"
            self.failures.setdefault(kind, [0, first["object"], first["reasons"]])[0] += 1
            return
        self.n_solutions += len(rows)
        self.n_unique += (first["period_probability"] or 0.0) >= UNIQUE


def summarise(
    catalogue: str | Path,
    table: SurveyTable,
    n_objects: int,
    reused: int,
    seconds: float,
    workers: str,
) -> tuple[SurveyNumbers, list[Finding]]:
    """The content of ``summary.json`` besides the verdict, and the findings against the result."""
    import numpy as np

    counts = Counts()
    for rows in table.objects():
        counts.add(rows)
    done, against = sum(counts.status.values()), []
    for code, status in (("objects-failed", FAILED), ("objects-not-trusted", NOT_TRUSTED)):
        if number := counts.status[status]:
            names = counts.names[status]
            more = f" and {number - len(names)} more" if number > len(names) else ""
            values = {"count": number, "objects": n_objects, "names": ", ".join(names) + more}
            against.append(Finding(code, values))
    if done < n_objects:
        values = {"count": n_objects - done, "objects": n_objects}
        against.append(Finding("objects-not-done", values))
    new = done - reused
    listed = sorted(counts.failures.values(), key=lambda kind: -kind[0])
    content: SurveyNumbers = {
        "catalogue": str(catalogue),
        "n_objects": n_objects,
        "n_trusted": counts.status[TRUSTED],
        "n_not_trusted": counts.status[NOT_TRUSTED],
        "n_failed": counts.status[FAILED],
        "n_unique": counts.n_unique,
        "n_solutions": counts.n_solutions,
        "n_done_before": reused,
        "seconds": seconds,
        "seconds_per_object": float(np.median(counts.seconds)) if done else None,
        "objects_per_hour": 3600.0 * new / seconds if new else None,
        "workers": workers,
        "failures": [
            {"count": number, "object": name, "text": text} for number, name, text in listed[:20]
        ],
    }
    return content, against
