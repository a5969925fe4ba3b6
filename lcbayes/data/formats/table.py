"""Delimited text with a header, parsed in one pass with the line and column of every value.

Numbers are converted to arrays in chunks, so that a million rows take seconds and little memory. A
chunk is searched for an invalid cell only if its conversion fails.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile

Floats = NDArray[np.float64]

CHUNK = 1 << 16
MAX_COLUMNS = 1000
MAX_CELL = 1000  # characters
MAX_TEXT = 1 << 31  # bytes of all text columns, in which every cell has the size of the longest
_META = re.compile(r"#\s*([A-Za-z_]\w*)\s*[:=]\s*(\S.*)")
_DECIMAL = "; numbers with decimal commas need semicolons between the cells"
_OTHER_MARKS = "|:"  # that are not read as delimiters
_NAMES = {"\t": "tab", ",": "comma", ";": "semicolon", " ": "space"}


@dataclass
class Table:
    """Columns of a delimited file.

    Attributes
    ----------
    file : TextFile
    numbers : column name → (T,) floats
    texts : column name → (T,) strings
    lines : (T,) int, line number of each row in the file, from 1
    labels : name used here → name in the file, if they differ
    meta : `# key: value` lines, key → (value, line)
    """

    file: TextFile
    numbers: dict[str, Floats]
    texts: dict[str, NDArray[np.str_]]
    lines: NDArray[np.int64]
    labels: dict[str, str] = field(default_factory=dict)
    meta: dict[str, tuple[str, int]] = field(default_factory=dict)

    def __len__(self) -> int:
        return self.lines.size

    def __contains__(self, name: str) -> bool:
        return name in self.numbers or name in self.texts

    def label(self, name: str) -> str:
        """The column's name in the file."""
        return self.labels.get(name, name)

    def at(self, row: int) -> str:
        """Location of a row, for messages."""
        return self.file.at(int(self.lines[row]))

    def reject(self, name: str, bad: NDArray[np.bool_], what: str, remedy: str) -> None:
        """Raise InputError with the first line if `bad` is true anywhere."""
        count = int(np.count_nonzero(bad))
        if not count:
            return
        row = int(np.argmax(bad))
        column = self.numbers.get(name, self.texts.get(name))
        value = "" if column is None else f": {column[row]}"
        raise InputError(
            f"{self.label(name)} has {count} {'value' if count == 1 else 'values'} {what} "
            f"(first in {self.at(row)}{value}); {remedy}"
        )

    def number(
        self, name: str, low: float = -np.inf, high: float = np.inf, remedy: str = ""
    ) -> Floats:
        """A numeric column; all values must be finite and between two limits."""
        values = self.numbers[name]
        self.reject(name, ~np.isfinite(values), "not finite", "drop those rows")
        outside = (values < low) | (values > high)
        self.reject(name, outside, f"outside {low:g} .. {high:g}", remedy or "correct those rows")
        return values

    def drop(self, bad: NDArray[np.bool_]) -> Table:
        """The table without the rows for which `bad` is true."""
        return self.take(np.flatnonzero(~bad))

    def take(self, rows: NDArray[np.int64]) -> Table:
        """The given rows, in that order."""
        return Table(
            self.file,
            {name: column[rows] for name, column in self.numbers.items()},
            {name: column[rows] for name, column in self.texts.items()},
            self.lines[rows],
            self.labels,
            self.meta,
        )


def comment_values(file: TextFile) -> dict[str, tuple[str, int]]:
    """The `# key: value` lines above the header; repeated keys must have equal values."""
    meta: dict[str, tuple[str, int]] = {}
    for number, line in enumerate(file.text.split("\n"), 1):
        if not line.strip():
            continue
        if not line.startswith("#"):
            break
        match = _META.match(line)
        if match is None:
            continue
        key, value = match[1].lower(), match[2].rstrip()
        if key in meta and meta[key][0] != value and key in ("frame", "epoch_jd"):
            raise InputError(
                f"{file.at(number)}: {key} is {value!r}, but line {meta[key][1]} says "
                f"{meta[key][0]!r}; give one"
            )
        meta[key] = (value, number)
    return meta


def delimiter_of(header: str) -> str:
    """The delimiter of a header line: tab, semicolon or comma, otherwise spaces."""
    bare = re.sub(r'"[^"]*"', "", header)
    return next((mark for mark in "\t;," if mark in bare), " ")


def header_of(text: str) -> tuple[int, str]:
    """Line number (from 1) and text of the first line that is neither blank nor a comment."""
    for number, line in enumerate(_lines(text), 1):
        if line.strip() and not line.startswith("#"):
            return number, line.strip("\n")
    return 0, ""


def header_labels(file: TextFile, delimiter: str | None = None) -> list[str]:
    """Names of the columns in the file."""
    number, line = header_of(file.text)
    if not line:
        return []
    cells = _cells(file, number, line, delimiter or delimiter_of(line))
    return [cell.strip() for cell in cells]


def _lines(text: str) -> Iterator[str]:
    """Lines with their \\n, not split at the other line boundaries of str.splitlines."""
    return iter(io.StringIO(text, newline="\n"))


def parse(
    file: TextFile,
    numeric: Collection[str],
    rename: dict[str, str] | None = None,
    delimiter: str | None = None,
    header: list[str] | None = None,
    may_be_empty: Collection[str] = (),
    texts: Collection[str] = (),
) -> Table:
    """Parse delimited text.

    Parameters
    ----------
    file : TextFile
    numeric : names (after renaming) of the columns that must hold numbers
    rename : name in the file → name used here
    delimiter : None: determined from the header
    header : names of the columns, if the first row of the file is data
    may_be_empty : names (after renaming) of numeric columns in which empty cells become NaN
    texts : names in lower case of text columns that have a meaning here

    Raises
    ------
    InputError
        The message names file, line and column.
    """
    rename = rename or {}
    skipped, line = header_of(file.text)
    if not line:
        raise InputError(f"{file.name} holds only comments; expected a header and rows")
    if header is None:
        delimiter = delimiter or delimiter_of(line)
        labels = header_labels(file, delimiter)
    else:
        labels, skipped = header, skipped - 1
    lines = islice(_lines(file.text), skipped, None)
    if delimiter == " ":  # otherwise a quote in a later comment would start a cell
        lines = ("\n" if line.startswith("#") else line for line in lines)
    names = [rename.get(label, label.lower()) for label in labels]
    names = [
        name if name in numeric or label in rename or name in texts else label
        for name, label in zip(names, labels, strict=True)
    ]
    _check_header(file, skipped, labels, names)
    columns: list[list] = [[] for _ in names]
    numbers_of_lines: list[NDArray[np.int64]] = []
    is_number = [name in numeric for name in names]
    widths, n_rows = [0] * len(names), 0
    for rows, at in _chunks(file, lines, delimiter or " ", skipped, len(names)):
        numbers_of_lines.append(at)
        n_rows += at.size
        for i, column in enumerate(zip(*rows, strict=True)):
            if is_number[i]:
                if names[i] in may_be_empty:
                    column = [cell if cell.strip() else "nan" for cell in column]
                if delimiter in (";", "\t"):
                    column = _with_points(column)
                columns[i].append(_floats(file, labels[i], column, at))
            else:
                cells = [cell.strip() for cell in column]
                widths[i] = max(widths[i], _longest(file, f"column {labels[i]!r}", cells, at))
                _check_memory(file, widths, n_rows)
                columns[i].append(np.array(cells, dtype=np.str_))
    if not numbers_of_lines:
        raise InputError(f"{file.name} has a header but no rows; give one row per point")
    joined = {name: np.concatenate(parts) for name, parts in zip(names, columns, strict=True)}
    return Table(
        file,
        {name: joined[name] for name in names if name in numeric},
        {name: joined[name] for name in names if name not in numeric},
        np.concatenate(numbers_of_lines),
        {name: label for name, label in zip(names, labels, strict=True) if name != label},
    )


def _check_header(file: TextFile, line: int, labels: list[str], names: list[str]) -> None:
    where = file.at(line)
    if len(labels) > MAX_COLUMNS:
        raise InputError(
            f"{where} names {len(labels)} columns; at most {MAX_COLUMNS} are read: drop those that "
            "are not needed"
        )
    _longest(file, "the header", labels, np.full(len(labels), line))
    if len(labels) == 1 and any(mark in labels[0] for mark in _OTHER_MARKS):
        raise InputError(
            f"{where} is one cell, {labels[0][:40]!r}; separate cells by commas, semicolons, tabs "
            "or spaces"
        )
    if all(_is_number(label) for label in labels):
        raise InputError(f"{where} holds numbers where names of columns are expected; add a header")
    first: dict[str, int] = {}
    for i, name in enumerate(names):
        if not name:
            raise InputError(f"{where}: column {i + 1} has no name; name it or remove it")
        if first.setdefault(name, i) != i:
            raise InputError(
                f"{where}: {labels[i]!r} names both column {first[name] + 1} and column {i + 1}; "
                "rename or remove one"
            )


def _longest(file: TextFile, where: str, cells: Sequence[str], at: NDArray[np.int64]) -> int:
    """Number of characters of the longest cell; an InputError if above `MAX_CELL`."""
    longest = max(map(len, cells))
    if longest > MAX_CELL:
        line = next(line for cell, line in zip(cells, at, strict=True) if len(cell) > MAX_CELL)
        raise InputError(
            f"{file.at(line)}, {where} holds a cell of {longest} characters; at most "
            f"{MAX_CELL} are read: shorten it, or close the quotes"
        )
    return longest


def _check_memory(file: TextFile, widths: Sequence[int], n_rows: int) -> None:
    """Raise InputError if the text columns would take more memory than `MAX_TEXT`."""
    if 4 * n_rows * sum(widths) > MAX_TEXT:
        raise InputError(
            f"{file.name}: its columns of text, of up to {max(widths)} characters in each of "
            f"{n_rows} rows or more, need over {MAX_TEXT >> 20} MiB; shorten or drop them"
        )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _cells(file: TextFile, number: int, line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader([line], **_dialect(delimiter)))
    except csv.Error as fault:
        raise InputError(f"{file.at(number)}: {fault}; close the quotes") from None


def _dialect(delimiter: str) -> dict:
    return {"delimiter": delimiter, "skipinitialspace": True, "strict": True}


def _chunks(
    file: TextFile, lines: Iterator[str], delimiter: str, skipped: int, width: int
) -> Iterator[tuple[list[list[str]], NDArray[np.int64]]]:
    """Rows of exactly `width` cells and their lines, about ten thousand at a time."""
    reader = csv.reader(lines, **_dialect(delimiter))
    rows: list[list[str]] = []
    at: list[int] = []
    last = skipped
    try:
        for row in reader:
            last = reader.line_num + skipped
            if len(row) != width:
                if not any(cell.strip() for cell in row) or row[0].startswith("#"):
                    continue
                if delimiter == " " and len(row) == width + 1 and not row[-1]:
                    row.pop()  # a space at the end of the line
                else:
                    raise InputError(
                        f"{file.at(last)} has {len(row)} {_NAMES[delimiter]}-separated cells; "
                        f"the header names {width}; correct the row, or quote cells that hold a "
                        f"{_NAMES[delimiter]}{_DECIMAL * (delimiter == ',' and len(row) > width)}"
                    )
            elif row[0].startswith("#"):
                continue
            rows.append(row)
            at.append(last)
            if len(rows) == CHUNK:
                yield rows, np.array(at)
                rows, at = [], []
    except csv.Error as fault:
        raise InputError(
            f"{file.at(last + 1)}: {fault}; close the quotes, or double those inside a cell"
        ) from None
    if rows:
        yield rows, np.array(at)


def _with_points(column: Sequence[str]) -> Sequence[str]:
    """Numbers with decimal commas converted to decimal points, unless a cell contains a point."""
    joined = "".join(column)
    if "," not in joined or "." in joined:
        return column
    return [cell.replace(",", ".") if cell.count(",") == 1 else cell for cell in column]


def _floats(
    file: TextFile, label: str, column: Sequence[str], at: NDArray[np.int64]
) -> NDArray[np.float64]:
    try:
        values = np.fromiter(map(float, column), float, len(column))
    except ValueError:
        values = None
    joined = "".join(column)
    if values is not None and joined.isascii() and "_" not in joined:
        return values
    for cell, line in zip(column, at, strict=True):
        if not _is_number(cell) or not cell.isascii() or "_" in cell:
            _longest(file, f"column {label!r}", [cell], np.array([line]))
            if not cell.strip():
                raise InputError(
                    f"{file.at(line)}, column {label!r} is empty; give a number or drop the row"
                )
            hint = "use a decimal point" if "," in cell else "give a number or drop the row"
            raise InputError(
                f"{file.at(line)}, column {label!r} holds {cell!r}; expected a number; {hint}"
            )
    raise AssertionError("unreachable")
