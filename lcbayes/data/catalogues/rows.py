"""A CSV file with the points of many objects, one row a point, read object by object."""

from __future__ import annotations

import csv
import gzip
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import IO

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable
from lcbayes.data.catalogues.entry import Entry, Excerpt, id_column, once
from lcbayes.data.formats.table import delimiter_of

LONGEST = 1 << 20  # characters of a line


@dataclass(frozen=True)
class Rows:
    """A CSV file; the rows of an object follow one another.

    Attributes
    ----------
    path : the file, which may be compressed with gzip
    asked : column that names the objects; None to recognise it
    """

    path: str
    asked: str | None = None

    @cached_property
    def head(self) -> tuple[list[str], str, int]:
        """Lines up to the header, the delimiter, and the place of the column of names.

        Raises
        ------
        InputError
            There is no header, or no such column.
        """
        lines = []
        with _opened(self.path) as file:
            for line in file:
                lines.append(line[:LONGEST])
                if line.strip() and line[0] != "#":
                    break
            else:
                raise InputError(f"{self._where} holds only comments; expected a header and rows")
        mark = delimiter_of(lines[-1])
        labels = [cell.strip() for cell in _cells(lines[-1], mark)]
        return lines, mark, labels.index(id_column(labels, self.asked, self._where))

    @property
    def _where(self) -> str:
        return printable(self.path)

    def count(self) -> int:
        """The number of objects, each of whose rows are together.

        Raises
        ------
        InputError
            The rows of an object are apart, or there are none.
        """
        number = once((name for name, _ in groupby(n for n, _, _ in self._rows())), self._where)
        if not number:
            raise InputError(f"{self._where} has a header but no rows; give one row per point")
        return number

    def objects(self) -> Iterator[Entry]:
        """Every object with its rows below the header."""
        head = "".join(self.head[0])
        for name, rows in groupby(self._rows(), key=lambda row: row[0]):
            lines = list(rows)
            text = head + "".join(line for _, _, line in lines)
            code = hashlib.sha256(text.encode()).hexdigest()
            yield Entry(
                name, Excerpt(Path(self.path), text, code, (), name, len(self.head[0]), lines[0][1])
            )

    def _rows(self) -> Iterator[tuple[str, int, str]]:
        """Object, number and text of each line; comments and blank lines belong to the object
        above, so that all lines of an object follow one another."""
        lines, mark, place = self.head
        name = ""
        with _opened(self.path) as file:
            for number, line in enumerate(file, 1):
                if number <= len(lines):
                    continue
                if line.strip() and line[0] != "#":
                    cells = _cells(line, mark)
                    if place >= len(cells) or not cells[place].strip():
                        raise InputError(
                            f"{self._where}, line {number} names no object; name that of each row"
                        )
                    name = cells[place].strip()
                elif not name:
                    continue
                yield name, number, line if line.endswith("\n") else line + "\n"


def _cells(line: str, mark: str) -> list[str]:
    if '"' not in line:
        return line.split() if mark == " " else line.split(mark)
    try:
        return next(csv.reader([line], delimiter=mark, skipinitialspace=True))
    except csv.Error:
        return []


@contextmanager
def _opened(path: str) -> Iterator[IO[str]]:
    """The text of a file, UTF-8, with \\n as line ends."""
    where = printable(path)
    try:
        with open(path, "rb") as file:
            packed = file.read(2) == b"\x1f\x8b"
        if packed:
            with gzip.open(path, "rt", encoding="utf-8-sig") as text:
                yield text
        else:
            with open(path, encoding="utf-8-sig") as text:
                yield text
    except UnicodeDecodeError as fault:
        raise InputError(f"{where} is not UTF-8 text ({fault.reason}); save it as UTF-8") from None
    except (EOFError, gzip.BadGzipFile) as fault:
        raise InputError(f"{where} is a damaged gzip file ({fault}); get it again") from None
    except OSError as fault:
        raise InputError(f"{where} cannot be read ({fault.strerror}); check the path") from None
