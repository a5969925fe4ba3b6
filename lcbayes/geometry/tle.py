"""Two-line element sets: reading with checksums and propagation with SGP4."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from string import digits
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError, RowError
from lcbayes.core.files import read_text

if TYPE_CHECKING:
    from lcbayes.geometry.times import Times

Floats = NDArray[np.float64]

LENGTH = 69
_LINE_1 = re.compile(
    r"1 [ A-Z\d][ \d]{4}[A-Z ] .{8} [ \d]{2}[ \d]{3}\.\d{8} [ +-][.]\d{8} [ +-]\d{5}[ +-]\d "
    r"[ +-]\d{5}[ +-]\d [ \d] [ \d]{4}\d",
    re.ASCII,
)
_LINE_2 = re.compile(
    r"2 [ A-Z\d][ \d]{4} [ \d]{3}\.\d{4} [ \d]{3}\.\d{4} \d{7} [ \d]{3}\.\d{4} [ \d]{3}\.\d{4} "
    r"[ \d]{2}\.\d{8}[ \d]{5}\d",
    re.ASCII,
)


@dataclass(frozen=True)
class Tle:
    """Element sets of one object.

    Attributes
    ----------
    name : name of the file, for messages
    satellites : sgp4 records, sorted by epoch
    epochs : (E,) Julian dates, UTC
    """

    name: str
    satellites: tuple[Any, ...]
    epochs: Floats

    def teme(self, time: Times, max_age_days: float | None = None) -> Floats:
        """Positions in SGP4's frame (true equator, mean equinox), km, (T, 3).

        Raises as `states`.
        """
        return self.states(time, max_age_days)[0]

    def age_days(self, time: Times) -> Floats:
        """Days between each time and the epoch of the nearest elements, (T,)."""
        return np.min(self._ages(time), axis=1)

    def _ages(self, time: Times) -> Floats:
        jd1, jd2 = time.utc
        return np.abs((jd1[:, None] - self.epochs) + jd2[:, None])

    def states(self, time: Times, max_age_days: float | None = None) -> tuple[Floats, Floats]:
        """Positions (km) and velocities (km/s) in SGP4's frame, (T, 3) each.

        Raises
        ------
        InputError
            At some time the nearest elements are older than `max_age_days`, or SGP4 fails.
        """
        from sgp4.api import SGP4_ERRORS

        jd1, jd2 = time.utc
        age = self._ages(time)
        nearest = np.argmin(age, axis=1)
        oldest = age[np.arange(jd1.size), nearest]
        if max_age_days is not None and (oldest > max_age_days).any():
            row = int(np.argmax(oldest > max_age_days))
            what = f"are {oldest.max():.0f} days from some of the times"
            remedy = f"get elements within {max_age_days:g} days of every observation"
            raise RowError(f"the elements in {self.name}", what, row, time.text(row), remedy)
        position, velocity = np.empty((2, jd1.size, 3))
        for index in np.unique(nearest):
            rows = np.flatnonzero(nearest == index)
            code, place, motion = self.satellites[index].sgp4_array(jd1[rows], jd2[rows])
            if code.any():
                row = rows[int(np.argmax(code != 0))]
                what = f"cannot be propagated: {SGP4_ERRORS.get(int(code[code != 0][0]), 'failed')}"
                raise RowError(
                    f"the elements in {self.name}", what, int(row), time.text(row), "get newer ones"
                )
            position[rows], velocity[rows] = place, motion
        return position, velocity


def read_tle(path: str | os.PathLike[str]) -> Tle:
    """Read the element sets of one object from a file; separate lines with names are allowed.

    Raises
    ------
    InputError
        No elements, a broken line, a wrong checksum or several objects; the message names file
        and line.
    """
    file = read_text(path)
    return parse_tle(file.text, file.name)


def parse_tle(text: str, name: str) -> Tle:
    """As `read_tle`, from text; `name` identifies it in messages."""
    from sgp4.api import Satrec

    lines = [
        (number, line.rstrip())
        for number, line in enumerate(text.split("\n"), 1)
        if line[:2] in ("1 ", "2 ")
    ]
    if not lines:
        raise InputError(f"{name} holds no two-line elements; expected lines '1 …' and '2 …'")
    satellites = []
    for i in range(0, len(lines), 2):
        number, first = lines[i]
        _check(name, number, first, "1", _LINE_1)
        if i + 1 == len(lines):
            raise InputError(f"{name}, line {number}: line 2 of the elements is missing; add it")
        number, second = lines[i + 1]
        _check(name, number, second, "2", _LINE_2)
        if first[2:7] != second[2:7]:
            raise InputError(
                f"{name}, line {number}: catalogue number {second[2:7]!r} follows {first[2:7]!r}; "
                "the two lines must be of one object"
            )
        satellites.append(Satrec.twoline2rv(first, second))
    numbers = {satellite.satnum for satellite in satellites}
    if len(numbers) > 1:
        raise InputError(
            f"{name} holds elements of {len(numbers)} objects; keep those of the one observed"
        )
    satellites.sort(key=lambda s: s.jdsatepoch + s.jdsatepochF)
    epochs = np.array([s.jdsatepoch + s.jdsatepochF for s in satellites])
    return Tle(name, tuple(satellites), epochs)


def _check(name: str, number: int, line: str, kind: str, form: re.Pattern[str]) -> None:
    where = f"{name}, line {number}"
    if line[0] != kind:
        raise InputError(f"{where} starts with {line[0]!r}; expected line {kind} of the elements")
    if len(line) != LENGTH:
        raise InputError(
            f"{where} has {len(line)} characters; a line of elements has {LENGTH}: copy it again"
        )
    total = sum(int(c) if c in digits else c == "-" for c in line[:-1]) % 10
    if line[-1] != str(total):
        raise InputError(
            f"{where}: checksum is {line[-1]}, the line adds up to {total}; copy the elements again"
        )
    if not form.fullmatch(line):
        raise InputError(f"{where} is not laid out as line {kind} of elements; copy it again")
