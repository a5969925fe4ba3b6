"""Conversion of times in files to seconds: UTC with leap seconds, Julian dates, seconds."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.data.formats.table import Table

Floats = NDArray[np.float64]

_UTC = re.compile(
    r"(\d{4}-\d\d-\d\d)[T ]([01]\d|2[0-3]):([0-5]\d):([0-5]\d(?:\.\d*)?|60(?:\.\d*)?)"
    r"(?:Z|([+-])([01]\d|2[0-3]):?([0-5]\d))?"
)
_FIRST, _LAST = np.datetime64("1900-01-01"), np.datetime64("2100-01-01")
JD_OF_1970 = 2440587.5
MJD_ORIGIN = 2400000.5


def seconds_from_utc(table: Table, name: str) -> tuple[Floats, float]:
    """Seconds elapsed since the midnight (UTC) before the earliest time, and its Julian date.

    Leap seconds in between are counted, and 23:59:60 is a valid time.
    """
    cells = table.texts[name]
    matches = [_UTC.fullmatch(cell) for cell in cells.tolist()]
    bad = np.array([match is None for match in matches])
    table.reject(name, bad, "not written in ISO 8601, UTC", _REMEDY)
    parts = [match.groups() for match in matches if match is not None]
    days = np.array([part[0] for part in parts])
    try:
        day = days.astype("datetime64[D]")
    except ValueError:
        bad = np.array([not _is_day(text) for text in days])
        table.reject(name, bad, "not on the calendar", "correct those rows")
        raise
    table.reject(name, (day < _FIRST) | (day > _LAST), "outside 1900 .. 2100", "correct those rows")
    clock = np.array([part[1:4] for part in parts]).astype(float)
    offset = np.array([_offset_s(*part[4:]) for part in parts])
    minutes = clock[:, 0] * 60.0 + clock[:, 1]
    leap = (clock[:, 2] >= 60.0) & ~(
        (minutes == 1439) & (_leap_seconds(day + np.timedelta64(1, "D"), day) > 0)
    )
    table.reject(name, leap, "in a leap second that never was", "correct those rows")
    first = day.min()
    whole = (day - first).astype(float) * 86400.0 + _leap_seconds(day, first)
    epoch_jd = JD_OF_1970 + float(first.astype(np.int64))
    return whole + minutes * 60.0 + clock[:, 2] - offset, epoch_jd


def _offset_s(sign: str | None, hours: str | None, minutes: str | None) -> float:
    """Seconds by which the clock of a time zone is ahead of UTC."""
    if sign is None or hours is None or minutes is None:
        return 0.0
    return float(f"{sign}1") * (3600.0 * int(hours) + 60.0 * int(minutes))


def with_utc(table: Table) -> Table:
    """The table with ``utc`` in place of ``date`` and ``clock``, and ``jd`` in place of ``mjd``."""
    if "mjd" in table and "jd" not in table:
        table.numbers["jd"] = table.number("mjd", -1e5, 2e5) + MJD_ORIGIN
        table.labels["jd"] = table.label("mjd")
        del table.numbers["mjd"]
    if "date" in table and "clock" in table and "utc" not in table:
        date, clock = table.texts.pop("date"), table.texts.pop("clock")
        table.texts["utc"] = np.char.add(np.char.add(date, "T"), clock)
        table.labels["utc"] = f"{table.label('date')} with {table.label('clock')}"
    return table


_REMEDY = "write them like 2024-04-29T10:28:45.25Z"


def _is_day(text: str) -> bool:
    try:
        np.datetime64(text, "D")
    except ValueError:
        return False
    return True


def _leap_seconds(day: Any, since: Any) -> Floats:
    """Whole seconds by which UTC days between two dates exceeded 86400 s."""
    import erfa

    table = erfa.leap_seconds.get()
    starts = np.array(
        [f"{row['year']:04d}-{row['month']:02d}-01" for row in table], dtype="datetime64[D]"
    )
    offset = np.concatenate(([0.0], table["tai_utc"]))
    # before 1972 the steps were fractional and the rate differed: treated as days of 86400 s
    offset[: np.searchsorted(starts, np.datetime64("1972-01-01")) + 1] = 10.0
    at = lambda d: offset[np.searchsorted(starts, np.asarray(d), side="right")]  # noqa: E731
    return at(day) - at(since)


def seconds_from_jd(jd: Floats) -> tuple[Floats, float]:
    """Seconds since the last whole Julian date before the earliest time, 86400 per day."""
    epoch = float(np.floor(jd.min()))
    return (jd - epoch) * 86400.0, epoch


def utc_days_to_seconds(t: Floats, epoch_jd: float) -> Floats:
    """Elapsed seconds from times with 86400 s per UTC day: leap seconds in between are added."""
    days = np.floor(epoch_jd - JD_OF_1970 + t / 86400.0).astype(np.int64).astype("datetime64[D]")
    first = np.int64(np.floor(epoch_jd - JD_OF_1970)).astype("datetime64[D]")
    return t + _leap_seconds(days, first)
