"""Photometry in CCSDS tracking data messages (TDM) in keyword = value notation (KVN)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.data.formats.build import build
from lcbayes.data.formats.columns import Options
from lcbayes.data.formats.table import Table
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import Tle, parse_tle

Floats = NDArray[np.float64]

MAX_APART_DEG = 3.0  # between the lines of sight in the message and from its elements
_MARK = re.compile(r"^\s*(META|DATA)[_ ]START\s*$", re.MULTILINE)
_PAIR = re.compile(r"([A-Z][A-Z0-9_]*)\s*=\s*(.*)")
_TIME = re.compile(r"(\d{4})-(\d{3}|\d\d-\d\d)T(\d\d:\d\d:\d\d(?:\.\d*)?)Z?")
FRAMES = ("EME2000", "ICRF", "GCRF", "J2000")


def is_tdm(text: str) -> bool:
    """Whether a text is a tracking data message, with or without its header."""
    start = text[:65536]
    return start.lstrip().startswith("CCSDS_TDM_VERS") or (
        _MARK.search(start) is not None and "DATA" in start
    )


@dataclass
class Segment:
    """One metadata section with its data section.

    Attributes
    ----------
    meta : keyword → value
    data : keyword → {time as in the file: (number, line)}
    """

    meta: dict[str, str] = field(default_factory=dict)
    data: dict[str, dict[str, tuple[float, int]]] = field(default_factory=dict)


def read_tdm(file: TextFile, options: Options) -> LightCurve:
    """Read the magnitudes of a message, one curve per segment.

    Directions come from elements (``--tle``, otherwise ``COMMENT FIRSTLINE=`` and ``SECONDLINE=``)
    or, if the message contains them, from right ascension, declination and range. The site comes
    from ``--site`` or ``COMMENT SITE=lat,lon,height``. If both elements and angles are present,
    they must agree to 3°. Spellings without underscore (``META START``) and angles equal to ``nan``
    are accepted. Magnitudes without a stated photometric error (``COMMENT AVG_PHOTOMETRIC_RMS``)
    are treated as instrumental: their scale is free.

    Raises
    ------
    InputError
        The message names file and line.

    References
    ----------
    CCSDS 503.0-B-2, Tracking Data Message, 2020, sec. 3 and annex D.
    """
    segments, comments = _parsed(file)
    table, notes = _table(file, segments, options)
    rms = _number(comments.get("AVG_PHOTOMETRIC_RMS", "nan"))
    table.texts["calibrated"] = np.full(len(table), "1" if np.isfinite(rms) else "0")
    if np.isfinite(rms):
        table.numbers["mag_err"] = np.full(len(table), rms)
    else:
        notes.append("magnitudes have no zero point in the message: their scale is free")
    if options.site is None and "SITE" in comments:
        options = replace(options, site=comments["SITE"])
    angles = {name: table.numbers.pop(name) for name in ("ra_deg", "dec_deg") if name in table}
    elements = _elements(file, comments) if options.tle is None else None
    if elements is not None:
        options = replace(options, tle=elements)
        notes.append("elements of the message were used")
    if options.tle is None and angles:
        if "range_km" not in table:
            raise InputError(
                f"{file.name} gives angles without RANGE and without elements; add --tle FILE"
            )
        table.numbers |= angles
    if options.tle is None and not angles:
        raise InputError(f"{file.name} gives neither angles nor elements; add --tle FILE")
    if options.tle is not None:
        table.numbers.pop("range_km", None)
    curve = build(table, options, "tdm", tuple(notes))
    if options.tle is not None and angles:
        _check_angles(table, curve, angles)
    return _with_age(curve, elements)


def _parsed(file: TextFile) -> tuple[list[Segment], dict[str, str]]:
    """Segments, and the comments of the form key = value."""
    segments: list[Segment] = []
    comments: dict[str, str] = {}
    inside = ""
    for number, raw in enumerate(file.text.split("\n"), 1):
        line = raw.strip()
        mark = line.replace(" ", "_")
        if mark in ("META_START", "DATA_START"):
            inside = mark[:4]
            if inside == "META" or not segments:
                segments.append(Segment())
            continue
        if mark in ("META_STOP", "DATA_STOP"):
            inside = ""
            continue
        if line.startswith("COMMENT"):
            pair = _PAIR.match(line.removeprefix("COMMENT").strip())
            if pair is not None:
                comments.setdefault(pair[1], pair[2].strip())
            continue
        pair = _PAIR.match(line)
        if pair is None:
            if line:
                _fail(file, number, f"{line[:40]!r} is no 'KEYWORD = value'")
            continue
        if inside == "META":
            segments[-1].meta[pair[1]] = pair[2].strip()
        elif inside == "DATA":
            _add(file, number, segments[-1], pair[1], pair[2])
    if not any("MAG" in segment.data for segment in segments):
        raise InputError(
            f"{file.name} is a tracking data message without MAG; it has no brightness"
        )
    return segments, comments


def _add(file: TextFile, line: int, segment: Segment, keyword: str, value: str) -> None:
    cells = value.split()
    if len(cells) != 2:
        _fail(file, line, f"{keyword} has {len(cells)} values where a time and a number belong")
    try:
        number = float(cells[1])
    except ValueError:
        _fail(file, line, f"{keyword} is {cells[1]!r}, which is no number")
    segment.data.setdefault(keyword, {})[cells[0]] = (number, line)


def _table(file: TextFile, segments: list[Segment], options: Options) -> tuple[Table, list[str]]:
    """Table of the points with a magnitude, with lcbayes column names, by time in each segment."""
    times: list[str] = []
    lines: list[int] = []
    curve: list[str] = []
    columns: dict[str, list[float]] = {"mag": [], "ra_deg": [], "dec_deg": [], "range_km": []}
    missing = 0
    for i, segment in enumerate(segments):
        system = segment.meta.get("TIME_SYSTEM", "UTC")
        if system != "UTC":
            raise InputError(
                f"{file.name}: TIME_SYSTEM is {system}; expected UTC: convert the times"
            )
        names = _angle_names(file, segment)
        for time, (magnitude, line) in sorted(segment.data.get("MAG", {}).items()):
            if not np.isfinite(magnitude) and not options.geometry_only:
                missing += 1
                continue
            times.append(_iso(file, line, time))
            lines.append(line)
            curve.append(str(i))
            columns["mag"].append(magnitude)
            for column, keyword in names.items():
                entry = segment.data.get(keyword, {}).get(time)
                columns[column].append(np.nan if entry is None else entry[0])
    if not times:
        raise InputError(f"{file.name}: no magnitude is a number; nothing is left to read")
    given = {
        name: np.array(values)
        for name, values in columns.items()
        if name == "mag" or (len(values) == len(times) and np.isfinite(values).all())
    }
    if ("ra_deg" in given) != ("dec_deg" in given):
        given = {k: v for k, v in given.items() if k not in ("ra_deg", "dec_deg")}
    texts = {"utc": np.array(times), "curve": np.array(curve)}
    notes = [f"{missing} points without a magnitude left out"] if missing else []
    labels = {"mag": "MAG", "utc": "the time of MAG", "range_km": "RANGE"}
    return Table(file, given, texts, np.array(lines), labels), notes


def _angle_names(file: TextFile, segment: Segment) -> dict[str, str]:
    """Keywords of the columns provided by a segment."""
    names = {"range_km": "RANGE"}
    if segment.meta.get("RANGE_UNITS", "km") != "km":
        raise InputError(f"{file.name}: RANGE_UNITS is {segment.meta['RANGE_UNITS']}; expected km")
    if segment.meta.get("ANGLE_TYPE") != "RADEC":
        return names
    frame = segment.meta.get("REFERENCE_FRAME", "EME2000")
    if frame not in FRAMES:
        raise InputError(
            f"{file.name}: REFERENCE_FRAME is {frame}; expected one of: {', '.join(FRAMES)}"
        )
    return names | {"ra_deg": "ANGLE_1", "dec_deg": "ANGLE_2"}


def _iso(file: TextFile, line: int, text: str) -> str:
    """A calendar or ordinal time as ISO 8601 in UTC."""
    match = _TIME.fullmatch(text)
    if match is None:
        _fail(file, line, f"the time is {text!r}; expected one like 2023-03-23T18:40:43.08")
    year, day, clock = match.groups()
    if len(day) == 3:
        try:
            date = datetime(int(year), 1, 1, tzinfo=UTC) + timedelta(days=int(day) - 1)
        except (ValueError, OverflowError):
            _fail(file, line, f"the time {text!r} is not on the calendar")
        day = f"{date:%m-%d}"
    return f"{year}-{day}T{clock}"


def _elements(file: TextFile, comments: dict[str, str]) -> Tle | None:
    if not {"FIRSTLINE", "SECONDLINE"} <= comments.keys():
        return None
    text = f"{comments['FIRSTLINE']}\n{comments['SECONDLINE']}"
    return parse_tle(text, f"{file.name}, COMMENT FIRSTLINE and SECONDLINE")


def _check_angles(table: Table, curve: LightCurve, angles: dict[str, Floats]) -> None:
    ra, dec = np.radians(angles["ra_deg"]), np.radians(angles["dec_deg"])
    seen = np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], -1)
    apart = np.degrees(np.arccos(np.clip(-np.sum(seen * curve.obs, axis=-1), -1.0, 1.0)))
    table.reject(
        "mag",
        apart > MAX_APART_DEG,
        f"at angles that the elements contradict by over {MAX_APART_DEG:g} deg",
        "check that the elements are of this object and date, and the site",
    )


def _with_age(curve: LightCurve, elements: Tle | None) -> LightCurve:
    """The curve with a note on the age of the elements in the message."""
    if elements is None or curve.epoch_jd is None:
        return curve
    first, rest = Times.of(curve.epoch_jd, curve.t[-1:]).utc
    age = float(np.min(np.abs(first[0] + rest[0] - elements.epochs)))
    note = f"the nearest elements are {age:.1f} days from the last point"
    notes = "; ".join(filter(None, [curve.source.get("notes", ""), note]))
    return replace(curve, source=dict(curve.source) | {"notes": notes})


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _fail(file: TextFile, line: int, what: str) -> NoReturn:
    raise InputError(f"{file.at(line)}: {what}; correct or drop the line")
