"""Parquet files with the points of many objects: one row a point, or one row an object with lists.

In the second layout, columns hold lists, a struct of lists, or a list of structs. The files of a
folder are parts of one table.
"""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# pyright: reportMissingImports=false
# (pyarrow comes without types, and is not in every environment)

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable
from lcbayes.data.catalogues.entry import Entry, Excerpt, id_column, once
from lcbayes.data.formats.frames import META, text_of

POINTS, OBJECTS = 65_536, 256  # rows that are read at once, by layout
# Columns with one value for an object that hold for all its points, beside lists.
SHARED = ("frame", "calibrated", "band", "site", "curve", "exposure_s", "range_km")

Columns = dict[str, NDArray[Any]]


def arrow() -> Any:
    """The Parquet library.

    Raises
    ------
    InputError
        It is not installed.
    """
    try:
        import pyarrow.parquet
    except ImportError:
        raise InputError(
            "Parquet needs pyarrow; it comes with pip install 'lcbayes[parquet]'"
        ) from None
    return pyarrow


def is_parquet(path: Path) -> bool:
    """Whether this is a Parquet file, or a folder of them."""
    if path.is_dir():
        return any(path.glob("*.parquet"))
    with path.open("rb") as file:
        return file.read(4) == b"PAR1"


@dataclass(frozen=True)
class Parquet:
    """A Parquet file or a folder of Parquet files.

    Attributes
    ----------
    path : the file or folder
    asked : column that names the objects; None to recognise it
    """

    path: str
    asked: str | None = None

    @cached_property
    def files(self) -> list[Path]:
        """The files, in order of their names."""
        path = Path(self.path)
        return sorted(path.glob("*.parquet")) if path.is_dir() else [path]

    @cached_property
    def name_column(self) -> str:
        """The column that names the objects."""
        return id_column(self._opened(self.files[0]).schema_arrow.names, self.asked, self._where)

    @property
    def _where(self) -> str:
        return printable(self.path)

    def count(self) -> int:
        """The number of objects, each of whose rows are together."""
        number = once((name for name, _ in groupby(self._names())), self._where)
        if not number:
            raise InputError(f"{self._where} has no rows; give one row per point or per object")
        return number

    def objects(self) -> Iterator[Entry]:
        """Every object with its points as text."""
        parts = self._lists() if self._nested() else self._points()
        about = self._about()
        for name, columns in parts:
            yield self._entry(name, columns, about)

    def _entry(self, name: str, columns: Columns, about: Mapping[str, str]) -> Entry:
        own = {k: str(v[0]) for k, v in columns.items() if k in META and len(v)}
        points = {k: v for k, v in columns.items() if k not in META}
        try:
            made = text_of(points)
        except InputError as fault:
            return Entry(name, None, f"{self._where}, object {name}: {fault}")
        comments = "".join(f"# {key}: {value}\n" for key, value in {**about, **own}.items())
        path, head = Path(self.path), comments.count("\n") + 1
        return Entry(name, Excerpt(path, comments + made.text, made.sha256, (), name, head))

    def _opened(self, path: Path) -> Any:
        pyarrow = arrow()
        try:
            return pyarrow.parquet.ParquetFile(path, memory_map=True)
        except (pyarrow.ArrowException, OSError) as fault:
            reason = " ".join(str(fault).split())[:120]
            raise InputError(
                f"{printable(path)} is a Parquet file that cannot be read ({reason}); write it "
                "again"
            ) from None

    def _batches(self, rows: int, columns: list[str] | None = None) -> Iterator[Any]:
        for path in self.files:
            file = self._opened(path)
            try:
                yield from file.iter_batches(rows, columns=columns)
            except (arrow().ArrowException, OSError, ValueError) as fault:
                reason = " ".join(str(fault).split())[:120]
                raise InputError(
                    f"{printable(path)} is a Parquet file that cannot be read ({reason}); write "
                    "it again"
                ) from None

    def _names(self) -> Iterator[str]:
        for batch in self._batches(POINTS, [self.name_column]):
            yield from _texts(batch.column(0), self._where)

    def _nested(self) -> bool:
        types = arrow().types
        lists = (types.is_list, types.is_large_list, types.is_fixed_size_list)

        def holds_lists(kind: Any) -> bool:
            if any(is_list(kind) for is_list in lists):
                return True
            return types.is_struct(kind) and any(holds_lists(field.type) for field in kind)

        return any(holds_lists(field.type) for field in self._opened(self.files[0]).schema_arrow)

    def _about(self) -> dict[str, str]:
        """Epoch and frame from the metadata of the first file."""
        given = self._opened(self.files[0]).schema_arrow.metadata or {}
        about = {key.decode(): value.decode("utf-8", "replace") for key, value in given.items()}
        about |= json.loads(about.get("PANDAS_ATTRS", "{}"))
        return {k.lower(): str(v) for k, v in about.items() if k.lower() in META}

    def _points(self) -> Iterator[tuple[str, Columns]]:
        """Objects of a table with one row a point; at most one batch and one object are held."""
        held: list[Columns] = []
        last: str | None = None
        for batch in self._batches(POINTS):
            names = np.array(_texts(batch.column(self.name_column), self._where), dtype=object)
            columns = {k: _array(batch.column(k)) for k in batch.schema.names}
            del columns[self.name_column]
            starts = [0, *(np.flatnonzero(names[1:] != names[:-1]) + 1), len(names)]
            for begin, end in pairwise(starts):
                if last is not None and names[begin] != last:
                    yield last, _joined(held)
                    held = []
                last = str(names[begin])
                held.append({k: v[begin:end] for k, v in columns.items()})
        if last is not None:
            yield last, _joined(held)

    def _lists(self) -> Iterator[tuple[str, Columns]]:
        """Objects of a table with one row an object."""
        pyarrow = arrow()
        for batch in self._batches(OBJECTS):
            names = _texts(batch.column(self.name_column), self._where)
            table = pyarrow.Table.from_batches([batch]).drop_columns([self.name_column])
            lists, shared = _flat(table.combine_chunks(), pyarrow)
            for i, name in enumerate(names):
                columns = {k: values[at[i] : at[i + 1]] for k, (values, at) in lists.items()}
                size = max(map(len, columns.values()), default=0)
                alone = {k: v[i : i + 1] for k, v in shared.items() if v[i] is not None}
                yield name, columns | {k: np.repeat(v, size) for k, v in alone.items()}


def _flat(table: Any, pyarrow: Any) -> tuple[dict[str, tuple[Any, Any]], Columns]:
    """Lists as (values, offsets) by name, and the columns with one value for an object."""
    types, lists, shared = pyarrow.types, {}, {}
    for name, column in zip(table.column_names, table.columns, strict=True):
        column = column.combine_chunks()
        if types.is_struct(column.type):
            fields = [column.type.field(i).name for i in range(column.type.num_fields)]
            inner = pyarrow.table(column.flatten(), names=fields)
            more, alone = _flat(inner, pyarrow)
            lists |= more
            shared |= alone
            continue
        if types.is_fixed_size_list(column.type):
            column = column.cast(pyarrow.list_(column.type.value_type))
        if types.is_list(column.type) or types.is_large_list(column.type):
            sizes = pyarrow.compute.fill_null(pyarrow.compute.list_value_length(column), 0)
            at = np.concatenate([[0], np.cumsum(sizes.to_numpy(zero_copy_only=False))])
            values = column.flatten()
            if types.is_struct(values.type):
                for i in range(values.type.num_fields):
                    lists[values.type.field(i).name] = _array(values.field(i)), at
            else:
                lists[name] = _array(values), at
        elif name.lower() in (*SHARED, *META):
            shared[name] = column.to_numpy(zero_copy_only=False).astype(object)
    return lists, shared


def _array(column: Any) -> NDArray[Any]:
    """A column as an array; missing numbers are NaN, missing texts None."""
    if hasattr(column, "dictionary"):
        column = column.dictionary_decode()
    return column.to_numpy(zero_copy_only=False)


def _texts(column: Any, where: str) -> list[str]:
    """Names of objects; whole numbers stored as floats are written without a point."""
    if column.null_count:
        raise InputError(f"{where}: {column.null_count} rows name no object; name that of each row")
    if hasattr(column, "dictionary"):
        column = column.dictionary_decode()
    values = column.to_pylist()
    if values and isinstance(values[0], float):
        values = [int(v) if v.is_integer() else v for v in values]
    return [" ".join(str(v).split()) for v in values]


def _joined(parts: list[Columns]) -> Columns:
    if len(parts) == 1:
        return parts[0]
    return {k: np.concatenate([part[k] for part in parts]) for k in parts[0]}
