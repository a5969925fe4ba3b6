"""DAMIT `.lcs`: asteroid light curves with the directions to Sun and Earth.

The input of Asteroids@home's period search has the same curves below 14 lines of settings.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.data.formats.build import unit
from lcbayes.data.formats.columns import Options
from lcbayes.data.formats.times import seconds_from_jd
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.plausible import check_flux_of_asteroid, check_intensities

WIDTH = 8  # JD, intensity, asteroid→Sun (3), asteroid→Earth (3)
SETTINGS = 14  # lines of settings in an input of Asteroids@home


def is_damit(text: str) -> bool:
    """Whether the first lines are a number of curves, `npoints flag`, and a row of 8 numbers."""
    lines = [line.split() for line in text[:4096].split("\n", 4)[:4] if line.strip()]
    return (
        len(lines) >= 2
        and len(lines[0]) == 1
        and _integer(lines[0][0]) is not None
        and len(lines[1]) == 2
        and all(_integer(cell) is not None for cell in lines[1])
    )


def is_period_search(text: str) -> bool:
    """Whether the text is an input of Asteroids@home's period search: a range of periods, further
    settings, and the number of curves on line 15."""
    lines = [line.split() for line in text[:8192].split("\n", SETTINGS + 3)[: SETTINGS + 3]]
    if len(lines) < SETTINGS + 3 or len(lines[0]) < 4 or len(lines[SETTINGS]) != 1:
        return False
    head, row = lines[SETTINGS + 1], lines[SETTINGS + 2]
    return (
        all(_number(cell) for cell in lines[0][:4])
        and _integer(lines[SETTINGS][0]) is not None
        and len(head) >= 2
        and _integer(head[0]) is not None
        and head[1] in ("0", "1")
        and len(row) == WIDTH
    )


def read_damit(file: TextFile, options: Options) -> LightCurve:
    """Read a DAMIT file.

    Curves with flag 0 are relative: their intensities are divided by their mean, and their scale is
    free; an error given as an option is in the resulting unit. Curves with flag 1 are calibrated
    (reduced to unit distances) and kept unchanged. The times are light-time corrected Julian dates,
    converted to seconds since the last whole date before the first time, without other changes.
    Axes are ecliptic J2000; vectors in au become directions. All curves of the file are read, even
    if there are more than line 1 states. Equal times, a result of rounding, are kept. Settings of
    an input of Asteroids@home, remarks behind its flags and lines below its curves are not used.

    Raises
    ------
    InputError
        The message names file and line.
    """
    if options.tle is not None or options.site is not None:
        raise InputError(f"{file.name} has directions of its own; leave out --tle and --site")
    rows, lines, curve, flags, announced = _parse(file)
    table = np.array(rows)
    jd, brightness, sun, obs = table[:, 0], table[:, 1].copy(), table[:, 2:5], table[:, 5:8]
    curve = np.array(curve)
    back = np.concatenate(([False], (np.diff(curve) == 0) & (jd[1:] < jd[:-1])))
    for bad, what in (
        (~np.isfinite(table).all(axis=1), "a value is not finite"),
        ((jd < 2.3e6) | (jd > 2.6e6), "the first cell is no Julian date"),
        (~np.any(sun != 0, axis=1), "the vector asteroid→Sun has length zero"),
        (~np.any(obs != 0, axis=1), "the vector asteroid→Earth has length zero"),
        (brightness <= 0, "the intensity is not positive"),
        (back, "the time is earlier than that of the row before"),
    ):
        if bad.any():
            _fail(file, lines[int(np.argmax(bad))], what, "correct or drop the row")
    free = np.array([flag == 0 for flag in flags])
    if not options.geometry_only and any(free):
        check_intensities(brightness[free[curve]], curve[free[curve]], file.name)
    mean = np.bincount(curve, brightness) / np.bincount(curve)
    brightness /= np.where(free, mean, 1.0)[curve]
    t, epoch = seconds_from_jd(jd)
    notes = file.notes
    if len(flags) != announced:
        notes += (f"line 1 announces {announced} curves, the file holds {len(flags)}: all read",)
    source = {"file": file.name, "format": "damit", "sha256": file.sha256}
    if options.geometry_only:
        brightness = np.full(t.size, np.nan)
    found = LightCurve(
        t=t,
        brightness=brightness,
        error=options.errors(None, t.size, file.name),
        sun=unit(sun),
        obs=unit(obs),
        curve=curve,
        free_scale=free,
        epoch_jd=epoch,
        frame="ecliptic-j2000",
        source=source | ({"notes": "; ".join(notes)} if notes else {}),
    )
    calibrated = ~free[curve]
    if calibrated.any() and not options.geometry_only:
        check_flux_of_asteroid(found.select(calibrated))
    return found


def _parse(
    file: TextFile,
) -> tuple[list[list[float]], list[int], list[int], list[int], int]:
    """Rows, their lines, their curves; the flag of each curve; the number of curves in the header.

    Memory is allocated for the rows present, not for the numbers stated in a header.
    """
    filled = [
        (number, cells)
        for number, line in enumerate(file.text.split("\n"), 1)
        if (cells := line.split())
    ]
    remarks = is_period_search(file.text)
    if remarks:
        filled = [(number, cells) for number, cells in filled if number > SETTINGS]
    announced = _integer(filled[0][1][0]) if len(filled[0][1]) == 1 else None
    if announced is None or announced < 1:
        _fail(file, filled[0][0], "expected the number of curves", "see the DAMIT format")
    rows: list[list[float]] = []
    lines: list[int] = []
    curve: list[int] = []
    flags: list[int] = []
    at = 1
    while at < len(filled) and not (remarks and len(flags) == announced):
        number, cells = filled[at]
        points = _integer(cells[0]) or 0
        short = len(cells) < 2 if remarks else len(cells) != 2
        if short or points < 1 or cells[1] not in ("0", "1"):
            what = "expected `npoints flag` with flag 0 or 1, as the curve before is complete"
            _fail(file, number, what, "check npoints above")
        remaining = len(filled) - at - 1
        if points > remaining:
            what = f"{points} points are announced, but only {remaining} lines follow"
            _fail(file, number, what, "the file is cut short or the count is wrong")
        for line, row in filled[at + 1 : at + 1 + points]:
            rows.append(_row(file, line, row))
            lines.append(line)
        curve += [len(flags)] * points
        flags.append(int(cells[1]))
        at += 1 + points
    if len(flags) < announced:
        what = f"{announced} curves are announced, but the file holds {len(flags)}"
        _fail(file, filled[0][0], what, "the file is cut short or the count is wrong")
    return rows, lines, curve, flags, announced


def _row(file: TextFile, number: int, cells: list[str]) -> list[float]:
    if len(cells) != WIDTH:
        what = f"{len(cells)} cells where a row has {WIDTH} (JD, intensity, two vectors)"
        _fail(file, number, what, "check the row, and npoints above it")
    try:
        return [float(cell) for cell in cells]
    except ValueError as fault:
        _fail(file, number, f"{fault}", "give numbers")


def _integer(text: str) -> int | None:
    return int(text) if len(text) < 20 and text.isascii() and text.isdigit() else None


def _number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _fail(file: TextFile, line: int, what: str, remedy: str) -> NoReturn:
    raise InputError(f"{file.at(line)}: {what}; {remedy}")
