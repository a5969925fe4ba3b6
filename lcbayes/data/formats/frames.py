"""Tables in memory as the text of a CSV file, so that they are read by the same rules."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile

NAME = "table"  # stands for the file name in messages
PARQUET = b"PAR1"
META = ("epoch_jd", "frame", "repeated_times")


def is_table(source: Any) -> bool:
    """Whether this is a table: a pandas DataFrame, an astropy Table, or a mapping of columns."""
    return isinstance(source, Mapping) or (
        hasattr(source, "columns") and hasattr(source, "__getitem__")
    )


def text_of(source: Any) -> TextFile:
    """A table as CSV; ``attrs`` or ``meta`` with ``epoch_jd`` and ``frame`` become its comments.

    Raises
    ------
    InputError
        It has no columns or no rows, columns differ in length, or one has several values per row.
    """
    columns = {str(name): _column(str(name), source[name]) for name in _names(source)}
    lengths = {len(values) for values in columns.values()}
    if not columns or lengths == {0}:
        raise InputError("the table has no rows; give one row for each point")
    if len(lengths) > 1:
        shown = ", ".join(f"{name} {len(values)}" for name, values in columns.items())
        raise InputError(f"the columns of the table differ in length ({shown}); make them equal")
    out = io.StringIO()
    about = getattr(source, "attrs", None) or getattr(source, "meta", None) or {}
    for key, value in about.items():
        if str(key).lower() in META:
            out.write(f"# {str(key).lower()}: {value}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    text = out.getvalue()
    return TextFile(Path(NAME), text, hashlib.sha256(text.encode()).hexdigest())


def _names(source: Any) -> list[Any]:
    if isinstance(source, Mapping):
        return list(source)
    names = getattr(source, "colnames", None)  # astropy
    return list(source.columns) if names is None else list(names)


def _column(name: str, values: Any) -> list[str]:
    """The cells of a column as text; floats by their shortest exact form."""
    if hasattr(values, "isot"):  # astropy.time.Time
        values = values.utc.isot
    elif hasattr(values, "unit") and hasattr(values, "value"):
        values = values.value  # a quantity; units are those of the column names
    if hasattr(values, "filled"):
        values = np.ma.filled(np.ma.asarray(values, dtype=object), "")
    if str(getattr(values, "dtype", "")).startswith("datetime64[ns, "):
        values = values.dt.tz_convert("UTC").dt.tz_localize(None)
    cells = np.asarray(values)
    if cells.ndim != 1:
        raise InputError(
            f"column {name!r} of the table has shape {cells.shape}; give one value per row"
        )
    if cells.dtype.kind == "M":
        return [f"{t}Z" for t in np.datetime_as_string(cells.astype("datetime64[ns]"))]
    return ["" if v is None or v != v else str(v) for v in cells.tolist()]


def read_parquet(path: Any) -> Any:
    """The table in a Parquet file.

    Raises
    ------
    InputError
        No library for Parquet is installed, or the file is damaged.
    """
    import pandas as pd

    try:
        return pd.read_parquet(path)
    except ImportError:
        raise InputError(
            f"{path} is a Parquet file, which needs pyarrow: pip install 'lcbayes[parquet]', or "
            "save it as CSV"
        ) from None
    except Exception as fault:  # any error of the Parquet library is caused by the file
        reason = " ".join(str(fault).split())[:120]
        raise InputError(f"{path} is a Parquet file that cannot be read ({reason})") from None
