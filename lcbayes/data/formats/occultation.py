"""Chords of stellar occultations by asteroids, in the format of KOALA and ADAM.

Text: the number of events; for each event the vector from the asteroid to the Earth (km, ecliptic
J2000), the velocity of the Earth relative to the asteroid (km/s), a line that is not used, the
number of chords, and a row for each chord: disappearance (JD), its error (s), place x and y (km);
appearance, error, x and y; and the kind, which is negative if no occultation was seen. Lines that
begin with # are comments. x points to the west and y to the north in the plane of the sky (see
`lcbayes.geometry.sky_plane`); places are those of the observers after the motion of the Earth
since a common instant is added. Times are those of the observer, not corrected for light time.

References
----------
Viikinkoski, Kaasalainen & Ďurech 2015, A&A 576, A8 (ADAM), and README_occultations.txt there;
Carry et al. 2010, Icarus 205, 460 (KOALA).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile, read_text

Floats = NDArray[np.float64]

LIGHT_KM_S = 299_792.458
WIDTH = 9  # cells of a chord
SLOWEST_KM_S, FASTEST_KM_S = 0.1, 100.0  # of an observer relative to the shadow
NEAREST_KM, FARTHEST_KM = 1e4, 1e10


@dataclass(frozen=True)
class Occultation:
    """One event.

    Attributes
    ----------
    to_earth_km : (3,)
        From the asteroid to the Earth, ecliptic J2000.
    velocity_km_s : (3,)
        As in the file, ecliptic J2000; not used.
    jd : (C, 2)
        Disappearance and appearance of each chord, or begin and end of a negative one.
    error_s : (C, 2)
    place_km : (C, 2, 2)
        x (west) and y (north) at both times.
    negative : (C,) bool
        Whether no occultation was seen along the chord.
    """

    to_earth_km: Floats
    velocity_km_s: Floats
    jd: Floats
    error_s: Floats
    place_km: Floats
    negative: NDArray[np.bool_]

    @property
    def body_jd(self) -> Floats:
        """Middle of each chord at the asteroid: minus the light time, (C,)."""
        light_time = float(np.linalg.norm(self.to_earth_km)) / LIGHT_KM_S
        return self.jd.mean(axis=1) - light_time / DAY_S

    @property
    def direction(self) -> Floats:
        """Unit vectors along the chords, from disappearance to appearance, (C, 2)."""
        step = self.place_km[:, 1] - self.place_km[:, 0]
        return step / np.linalg.norm(step, axis=1, keepdims=True)

    @property
    def error_km(self) -> Floats:
        """Timing errors along the chords, (C, 2): those in s times the speed of the observer."""
        length = np.linalg.norm(self.place_km[:, 1] - self.place_km[:, 0], axis=1)
        speed = length / (DAY_S * np.ptp(self.jd, axis=1))
        return self.error_s * speed[:, None]


def read_occultations(path: str | os.PathLike[str]) -> list[Occultation]:
    """Read a file of chords.

    Raises
    ------
    InputError
        One line with file, line, fault and remedy.
    """
    file = read_text(path)
    rows = [
        (number, cells)
        for number, line in enumerate(file.text.split("\n"), 1)
        if (cells := line.split("#", 1)[0].split())
    ]
    lines = iter(rows)
    events = _count(file, lines, "the number of events")
    parsed = [_event(file, lines) for _ in range(events)]
    if (extra := next(lines, None)) is not None:
        _fail(file, extra[0], "a line follows the last chord", "check the numbers of chords")
    return parsed


type Lines = Iterator[tuple[int, list[str]]]


def _event(file: TextFile, lines: Lines) -> Occultation:
    number, to_earth = _numbers(file, lines, 3, "the vector from the asteroid to the Earth (km)")
    if not NEAREST_KM < np.linalg.norm(to_earth) < FARTHEST_KM:
        _fail(file, number, "the distance of the Earth is not that of an asteroid", "give km")
    _, velocity = _numbers(file, lines, 3, "the velocity (km/s)")
    _next(file, lines, "the line that is not used")
    count = _count(file, lines, "the number of chords")
    rows = [_numbers(file, lines, WIDTH, "a chord") for _ in range(count)]
    for number, row in rows:
        _check_chord(file, number, row)
    table = np.array([row for _, row in rows])
    event = Occultation(
        to_earth_km=to_earth,
        velocity_km_s=velocity,
        jd=table[:, [0, 4]],
        error_s=table[:, [1, 5]],
        place_km=np.stack([table[:, 2:4], table[:, 6:8]], axis=1),
        negative=table[:, 8] < 0,
    )
    if np.count_nonzero(~event.negative) < 2:
        what = "fewer than two chords of this event are positive"
        _fail(file, rows[-1][0], what, "two at least are needed for size and place")
    return event


def _check_chord(file: TextFile, number: int, row: Floats) -> None:
    begin, end = row[0], row[4]
    step = np.hypot(row[6] - row[2], row[7] - row[3])
    if not (2.3e6 < begin < 2.6e6 and 2.3e6 < end < 2.6e6):
        _fail(file, number, "a time is no Julian date", "give JD, not MJD")
    if not begin < end:
        _fail(file, number, "appearance is not after disappearance", "correct the times")
    if not (row[1] > 0 and row[5] > 0):
        _fail(file, number, "a timing error is not positive", "give the errors in s")
    speed = step / (DAY_S * (end - begin))
    if not SLOWEST_KM_S < speed < FASTEST_KM_S:
        what = f"the observer moves by {speed:.3g} km/s relative to the shadow"
        _fail(file, number, what, f"give places in km; {SLOWEST_KM_S:g} to {FASTEST_KM_S:g} occur")


def _next(file: TextFile, lines: Lines, what: str) -> tuple[int, list[str]]:
    line = next(lines, None)
    if line is None:
        raise InputError(f"{file.name} ends before {what}; the file is cut short")
    return line


def _count(file: TextFile, lines: Lines, what: str) -> int:
    number, cells = _next(file, lines, what)
    if len(cells) != 1 or not cells[0].isdigit() or not 0 < int(cells[0]) < 10_000:
        _fail(file, number, f"expected {what}", "see the format of ADAM's occultation files")
    return int(cells[0])


def _numbers(file: TextFile, lines: Lines, count: int, what: str) -> tuple[int, Floats]:
    number, cells = _next(file, lines, what)
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError as fault:
        _fail(file, number, f"{what}: {fault}", "give numbers")
    if len(values) != count or not np.all(np.isfinite(values)):
        said = f"expected {count} finite numbers for {what}, found {' '.join(cells)[:60]!r}"
        _fail(file, number, said, "correct the line")
    return number, values


def _fail(file: TextFile, line: int, what: str, remedy: str) -> NoReturn:
    raise InputError(f"{file.at(line)}: {what}; {remedy}")
