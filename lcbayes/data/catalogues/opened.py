"""A catalogue of any kind: a table of points, a folder of light curves, or a pattern."""

from __future__ import annotations

import glob
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable, read_text
from lcbayes.data.catalogues.entry import Entry
from lcbayes.data.catalogues.folder import Folder
from lcbayes.data.catalogues.parquet import Parquet, is_parquet
from lcbayes.data.catalogues.rows import Rows


class Catalogue(Protocol):
    """The objects of a catalogue, read one after another."""

    def count(self) -> int:
        """The number of objects, after a check that each occurs once."""
        ...

    def objects(self) -> Iterator[Entry]:
        """The objects, in the order of the catalogue."""
        ...


def catalogue(path: str | Path, object_column: str | None = None) -> Catalogue:
    """The catalogue at a path, recognised from its content.

    Parameters
    ----------
    path : path or pattern
        A Parquet file, a folder of Parquet files or a CSV file, with a column that names the
        object; or a folder or a pattern of files with one object each.
    object_column : str, optional
        The column that names the object; common names are recognised.

    Raises
    ------
    InputError
        There is no such file, or nothing in it.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "survey.csv"
    >>> rows = "A,2460000.5,1\\nA,2460001.5,2\\nB,2460000.5,3\\n"
    >>> _ = file.write_text("object,jd,flux\\n" + rows, encoding="utf-8")
    >>> [entry.name for entry in catalogue(file).objects()]
    ['A', 'B']
    """
    where = Path(path)
    if not where.exists():
        if glob.has_magic(str(path)):
            return Folder(str(path))
        read_text(where)  # says what is wrong
    if is_parquet(where):
        return Parquet(str(path), object_column)
    if where.is_dir() or where.suffix.lower() == ".lcs":
        folder = Folder(str(path))
    else:
        return Rows(str(path), object_column)
    if object_column is not None:
        raise InputError(
            f"{printable(path)} has one file for each object; leave out --object {object_column}"
        )
    return folder
