"""Writing of TOML, and reading with messages that name file, line, key and expected value."""

from __future__ import annotations

import difflib
import json
import math
import re
import sys
import tomllib
from collections.abc import Collection, Mapping
from datetime import UTC, date, datetime, time
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable, read_bytes

type Place = tuple[str | int, ...]

REQUIRED: Any = object()
MAX_BYTES = 16 << 20
LARGEST = 1e30  # largest absolute value, so that squares and quotients do not overflow
FIRST_YEAR, LAST_YEAR = 1900, 2099  # range of dates, as in light curves
_HEADER = re.compile(r"\s*(\[\[?)([^\[\]]+)\]\]?\s*(#.*)?$")
_KEY = re.compile(r"""\s*([A-Za-z0-9_\-."']+)\s*=""")


def read_toml(path: str | Path) -> Table:
    """The root table of a TOML file.

    Raises
    ------
    InputError
        The file is missing, is not UTF-8 text or is not TOML; the message has line and column.
    """
    name = printable(path)
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise InputError(f"{name}: byte {fault.start} is not UTF-8; save it as UTF-8") from None
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as fault:
        what, _, where = str(fault).rpartition(" (at ")
        where = where.removesuffix(")")
        raise InputError(f"{name}, {where}: not TOML ({what}); correct that line") from None
    except RecursionError:
        raise InputError(f"{name}: arrays or tables lie too deep in one another") from None
    except ValueError:  # Python's limit on the number of digits of an int
        most = sys.get_int_max_str_digits()
        long = re.search(rf"[\d_]{{{most + 1}}}", text, re.ASCII)
        line = f", line {text.count(chr(10), 0, long.start()) + 1}" if long else ""
        raise InputError(f"{name}{line}: a number of over {most} digits; shorten it") from None
    return Table(Path(path), data, (), _lines_of(text))


def _lines_of(text: str) -> dict[Place, int]:
    """Line of each table and key, as far as a single line identifies it."""
    lines: dict[Place, int] = {}
    counts: dict[Place, int] = {}
    here: Place = ()
    for number, line in enumerate(text.splitlines(), 1):
        header, key = _HEADER.match(line), _KEY.match(line)
        if header:
            here = ()
            names = [part.strip().strip("\"'") for part in header[2].split(".")]
            for depth, name in enumerate(names):
                here = (*here, name)
                if header[1] == "[[" and depth == len(names) - 1:
                    counts[here] = counts.get(here, -1) + 1
                if here in counts:
                    here = (*here, counts[here])
                lines.setdefault(here, number)
        elif key:
            dotted = [part.strip("\"'") for part in key[1].split(".")]
            for depth in range(len(dotted)):
                lines.setdefault((*here, *dotted[: depth + 1]), number)
    return lines


class Table:
    """One table of a TOML file with typed access to its keys; every fault is an InputError.

    Call `done` after all keys have been read: it rejects unused keys, so that a misspelt option is
    not silently ignored.
    """

    def __init__(
        self, path: Path, data: dict[str, Any], place: Place, lines: dict[Place, int]
    ) -> None:
        self.path, self._data, self._place, self._lines = path, data, place, lines
        self._asked: set[str] = set()

    @property
    def values(self) -> dict[str, Any]:
        """The content of the table as Python objects, for files written by this package."""
        return dict(self._data)

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def keys(self) -> list[str]:
        """The keys of the table, in the order of the file."""
        return list(self._data)

    def fault(self, key: str | None, what: str) -> InputError:
        """An error about a key (or about the table), with file and line."""
        place = self._place if key is None else (*self._place, key)
        known = place
        while known and known not in self._lines:
            known = known[:-1]
        line = f", line {self._lines[known]}" if known else ""
        return InputError(f"{printable(self.path)}{line}: {_dotted(place)} {what}")

    def _absent(self, key: str, default: Any, expected: str) -> bool:
        """Whether the default applies; raises InputError if there is no default."""
        self._asked.add(key)
        if key in self._data:
            return False
        if default is REQUIRED:
            near = difflib.get_close_matches(key, self._data, 1)
            hint = f" (there is {near[0]!r})" if near else ""
            raise self.fault(None, f"has no {key!r}{hint}; give {expected}")
        return True

    def number(
        self,
        key: str,
        default: Any = REQUIRED,
        low: float = -LARGEST,
        high: float = LARGEST,
        above: float = -math.inf,
    ) -> Any:
        """A number with low <= number <= high, number > above and |number| <= `LARGEST`."""
        low, high = max(low, -LARGEST), min(high, LARGEST)
        least = f"> {above:g}" if above >= low else f">= {low:g}"
        expected = f"a number {least} and <= {high:g}"
        if self._absent(key, default, expected):
            return default
        value = self._data[key]
        if not _is_number(value) or not low <= value <= high or not value > above:
            raise self.fault(key, f"is {_shown(value)}; expected {expected}")
        return float(value)

    def vector(
        self, key: str, length: int = 3, default: Any = REQUIRED, limit: float = LARGEST
    ) -> Any:
        """A list of ``length`` numbers with absolute values up to ``limit``, as a tuple."""
        expected = f"a list of {length} numbers from {-limit:g} to {limit:g}"
        if self._absent(key, default, expected):
            return default
        value = self._data[key]
        fits = isinstance(value, list) and len(value) == length and all(map(_is_number, value))
        if not fits or max(map(abs, value)) > limit:
            raise self.fault(key, f"is {_shown(value)}; expected {expected}")
        return tuple(map(float, value))

    def text(
        self, key: str, default: Any = REQUIRED, choices: Collection[str] | None = None
    ) -> Any:
        """A string; one of `choices` if these are given."""
        expected = f"one of: {', '.join(choices)}" if choices else "a string"
        if self._absent(key, default, expected):
            return default
        value = self._data[key]
        if not isinstance(value, str) or (choices and value not in choices):
            raise self.fault(key, f"is {_shown(value)}; expected {expected}")
        if "\0" in value:
            raise self.fault(key, f"is {_shown(value)}; expected a text without null bytes")
        return value

    def flag(self, key: str, default: Any = REQUIRED) -> Any:
        """A Boolean."""
        if self._absent(key, default, "true or false"):
            return default
        value = self._data[key]
        if not isinstance(value, bool):
            raise self.fault(key, f"is {_shown(value)}; expected true or false")
        return value

    def instant(self, key: str, default: Any = REQUIRED) -> Any:
        """A date and time in UTC, from a TOML date-time or an ISO 8601 string."""
        expected = f"an instant in UTC, {FIRST_YEAR} .. {LAST_YEAR}, such as 2026-03-01T19:30:00Z"
        if self._absent(key, default, expected):
            return default
        value = self._data[key]
        try:
            if isinstance(value, str):
                moment = datetime.fromisoformat(value)
            elif isinstance(value, date) and not isinstance(value, datetime):
                moment = datetime.combine(value, time())
            elif isinstance(value, datetime):
                moment = value
            else:
                raise ValueError
            utc = moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)
            if not FIRST_YEAR <= utc.year <= LAST_YEAR:
                raise ValueError
        except (ValueError, OverflowError):
            raise self.fault(key, f"is {_shown(value)}; expected {expected}") from None
        return utc

    def table(self, key: str, default: Any = REQUIRED) -> Any:
        """A table inside this one."""
        if self._absent(key, default, f"a table [{_dotted((*self._place, key), '')}]"):
            return default
        value = self._data[key]
        if not isinstance(value, dict):
            raise self.fault(key, f"is {_shown(value)}; expected a table of keys and values")
        return Table(self.path, value, (*self._place, key), self._lines)

    def tables(self, key: str) -> list[Table]:
        """The tables [[key]], possibly none."""
        self._asked.add(key)
        value = self._data.get(key, [])
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            name = _dotted((*self._place, key), "")
            raise self.fault(key, f"is not a list of tables; write each as [[{name}]]")
        return [
            Table(self.path, item, (*self._place, key, i), self._lines)
            for i, item in enumerate(value)
        ]

    def blank(self) -> Table:
        """An empty table at the place of this one."""
        return Table(self.path, {}, self._place, self._lines)

    def under(self, outer: Table, keys: Collection[str]) -> Table:
        """This table, with its missing keys among ``keys`` taken from an outer table."""
        inherited = {key: outer._data[key] for key in keys if key in outer._data}
        outer._asked |= set(inherited)
        lines = dict(self._lines)
        for key in inherited.keys() - self._data.keys():
            if (*outer._place, key) in lines:
                lines[(*self._place, key)] = lines[(*outer._place, key)]
        return Table(self.path, inherited | self._data, self._place, lines)

    def done(self) -> None:
        """Reject keys that have not been read."""
        for key in self._data:
            if key not in self._asked:
                near = difflib.get_close_matches(key, self._asked, 1)
                known = ", ".join(sorted(self._asked))
                hint = f"did you mean {near[0]!r}?" if near else f"known here: {known}"
                raise self.fault(key, f"is not a key that is known here; {hint}")


def _is_number(value: object) -> bool:
    try:
        return type(value) in (int, float) and math.isfinite(value)  # type: ignore[arg-type]
    except OverflowError:  # an int too large for a float
        return False


def _shown(value: object) -> str:
    """A value as shown in messages, truncated if it is long."""
    try:
        text = str(value) if isinstance(value, date) else repr(value)
    except ValueError:  # a hexadecimal number with too many decimal digits for Python
        return "a number too long to show"
    return text if len(text) <= 100 else f"{text[:100]}…"


def _dotted(place: Place, root: str = "the file") -> str:
    """A dotted name such as `body.facets[2].normal`; tables of a list are numbered from 1."""
    text = ""
    for part in place:
        text += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if text else part
    return text or root


def to_toml(content: Mapping[str, Any]) -> str:
    """TOML text of a mapping of scalars, arrays and one level of tables."""
    lines = [f"{k} = {_toml_value(v)}" for k, v in content.items() if not isinstance(v, Mapping)]
    for name, table in content.items():
        if isinstance(table, Mapping):
            lines += ["", f"[{name}]", *(f"{k} = {_toml_value(v)}" for k, v in table.items())]
    return "\n".join(lines) + "\n"


def _toml_value(value: Any) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    return json.dumps(printable(str(value)), ensure_ascii=False)
