"""One object of a catalogue, and the column that names the objects."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.core.text import closest

# Columns that name the object, in lower case; of several, the first of these.
IDS = (
    "object", "object_id", "objectid", "obj_id", "objid", "ssobjectid", "designation", "number_mp",
    "ssnamenr", "asteroid", "name", "number", "source_id", "id",
)  # fmt: skip


@dataclass(frozen=True)
class Excerpt(TextFile):
    """The rows of one object of a table, below the head of that table.

    Attributes
    ----------
    object : name of the object
    head : number of lines above the first row
    first : number of the first row, as a line of the table; 0 if the table has no lines
    """

    object: str = ""
    head: int = 0
    first: int = 0

    @property
    def name(self) -> str:
        """The table and the object."""
        return f"{super().name}, object {self.object}"

    def at(self, line: int) -> str:
        """A place in the table: its line, or the row among those of the object."""
        if self.first:
            number = line if line <= self.head else line - self.head - 1 + self.first
            return f"{super().name}, line {number}"
        return f"{self.name}, row {line - self.head}" if line > self.head else self.name


@dataclass(frozen=True)
class Entry:
    """An object of a catalogue: its name, and its light curve as text or why there is none.

    Attributes
    ----------
    name : text without line breaks
    file : the text, in a format of `lcbayes.read`; None if it cannot be had
    fault : the reason in that case
    """

    name: str
    file: TextFile | None
    fault: str = ""


def id_column(labels: Sequence[str], asked: str | None, where: str) -> str:
    """The column that names the objects.

    Parameters
    ----------
    labels : columns of the table
    asked : that of the user, or None to recognise it
    where : name of the table, for messages

    Raises
    ------
    InputError
        There is no such column.
    """
    if asked is not None:
        if asked in labels:
            return asked
        raise InputError(
            f"{where} has no column {asked!r}{closest(asked, labels)}, which --object names; it "
            f"has: {', '.join(labels[:12])}"
        )
    simple = {re.sub(r"[^a-z0-9]+", "_", label.lower()).strip("_"): label for label in labels}
    column = next((simple[name] for name in IDS if name in simple), None)
    if column is None:
        raise InputError(
            f"{where} has no column that names the objects (it has: {', '.join(labels[:12])}); "
            "name it object, or give --object COLUMN"
        )
    return column


def once(names: Iterable[str], where: str) -> int:
    """The number of objects, after a check that each occurs once.

    Raises
    ------
    InputError
        An object occurs again after another one.
    """
    seen: set[int] = set()
    for name in names:
        key = hash(name)
        if key in seen:
            raise InputError(
                f"{where}: the rows of object {name!r} are not together; sort the table by object "
                "and time"
            )
        seen.add(key)
    return len(seen)
