"""ALCDEF, the exchange format of asteroid photometry: curves without directions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.data.formats.build import build
from lcbayes.data.formats.columns import Options
from lcbayes.data.formats.table import Table
from lcbayes.data.lightcurve import LightCurve

START, METADATA_END, END = "STARTMETADATA", "ENDMETADATA", "ENDDATA"
DELIMITERS = {"PIPE": "|", "TAB": "\t"}
UNCORRECTED = ("", "NONE")  # values of LTCAPP without a correction for light time


@dataclass
class Block:
    """One session.

    Attributes
    ----------
    meta : keyword → value; the first one of a repeated keyword
    rows : (line, cells) of each measurement
    """

    meta: dict[str, str] = field(default_factory=dict)
    rows: list[tuple[int, list[str]]] = field(default_factory=list)

    @property
    def band(self) -> str:
        return self.meta.get("FILTER", "") or self.meta.get("MAGBAND", "")

    @property
    def object(self) -> str:
        """Number or, without one, name or designation."""
        names = (self.meta.get(key, "") for key in ("OBJECTNUMBER", "OBJECTNAME", "MPCDESIG"))
        return next((name for name in names if name.strip("0")), "")


def is_alcdef(text: str) -> bool:
    """Whether the first line that is not a remark opens a block of metadata."""
    lines = (line.strip() for line in text[:65536].split("\n"))
    return next((line for line in lines if line and line[0] != "#"), "").upper() == START


def read_alcdef(file: TextFile, options: Options) -> LightCurve:
    """Read the photometry of an ALCDEF file, one curve of unknown zero point per block.

    The format gives directions for the middle of a session only, mostly rounded to 0.1° or 1°, and
    most files are not corrected for light time. Both are too coarse for a pole, so the curve has
    ``brightness_only``. Magnitudes of several sessions rest on different comparison stars.

    Raises
    ------
    InputError
        The file is damaged or holds several objects, or directions are required.

    References
    ----------
    Stephens, Warner & Harris 2010, Bulletin of the American Astronomical Society 42, 1035;
    ALCDEF Definition and Standards 2.2.7, 2019.
    """
    if not options.brightness_only:
        raise InputError(
            f"{file.name} is ALCDEF, which holds no directions to Sun and observer; lcbayes look "
            "finds its periods. For other commands add columns sun_x .. obs_z of an ephemeris to "
            "the table that lcbayes.read(FILE, geometry=False).to_pandas() returns"
        )
    if options.tle is not None or options.site is not None:
        raise InputError(f"{file.name} is of an asteroid; leave out --tle and --site")
    blocks = list(_blocks(file))
    objects = sorted({block.object for block in blocks})
    if len(objects) > 1:
        raise InputError(
            f"{file.name} holds several objects ({', '.join(objects[:5])}); give each its own file"
        )
    notes = ["the zero point of each ALCDEF block is free"]
    uncorrected = sum(block.meta.get("LTCAPP", "").upper() in UNCORRECTED for block in blocks)
    if uncorrected:
        notes.append(f"times of {uncorrected} of {len(blocks)} blocks include the light time")
    return build(_table(file, blocks, notes), options, "alcdef", tuple(notes))


def _blocks(file: TextFile) -> Iterator[Block]:
    """The blocks of a file, each complete."""
    block, inside = Block(), ""
    for number, raw in enumerate(file.text.split("\n"), 1):
        line = raw.strip()
        mark = line.upper()
        if not line or line[0] == "#":
            continue
        if mark in (START, METADATA_END, END):
            if inside != {START: "", METADATA_END: START, END: METADATA_END}[mark]:
                _fail(file, number, f"{mark} is out of place", "check the block above it")
            if mark == START:
                block = Block()
            elif mark == END:
                if not block.rows:
                    _fail(file, number, "the block has no DATA line", "drop the block")
                yield block
            inside = "" if mark == END else mark
            continue
        keyword, equals, value = line.partition("=")
        keyword = keyword.strip().upper()
        if not inside or not equals or (inside == METADATA_END) != (keyword == "DATA"):
            _fail(file, number, f"{line[:40]!r} is out of place", "correct or drop the line")
        if inside == START:
            block.meta.setdefault(keyword, value.strip())
        else:
            block.rows.append((number, _cells(file, number, block, value)))
    if inside:
        raise InputError(f"{file.name} ends inside a block; the file is cut short")


def _cells(file: TextFile, number: int, block: Block, value: str) -> list[str]:
    """Julian date, magnitude and, if given, its error."""
    name = block.meta.get("DELIMITER", "PIPE").upper()
    if name not in DELIMITERS:
        _fail(file, number, f"DELIMITER is {name}", f"expected one of: {', '.join(DELIMITERS)}")
    cells = [cell.strip() for cell in value.split(DELIMITERS[name])]
    if len(cells) < 2:
        _fail(file, number, "DATA needs a Julian date and a magnitude", "correct or drop the line")
    return cells


def _table(file: TextFile, blocks: list[Block], notes: list[str]) -> Table:
    """The points with lcbayes column names, by time in each block."""
    points: list[tuple[int, float, float, float, int]] = []
    for i, block in enumerate(blocks):
        rows = []
        for line, cells in block.rows:
            jd, mag = (_number(file, line, cell) for cell in cells[:2])
            error = _number(file, line, cells[2]) if len(cells) > 2 and cells[2] else np.nan
            rows.append((i, jd, mag, error, line))
        points += sorted(rows, key=lambda row: row[1])
    which, jd, mag, error, lines = (np.array(column) for column in zip(*points, strict=True))
    numbers = {"jd": jd, "mag": mag}
    known = error > 0
    if known.all():
        numbers["mag_err"] = error
    elif known.any():
        notes.append(f"{np.sum(~known)} of {known.size} points have no error: errors left out")
    bands = np.array([block.band for block in blocks])
    texts = {"curve": which.astype(str), "band": bands[which]}
    texts["calibrated"] = np.full(which.size, "0")
    labels = {"jd": "the Julian date", "mag": "the magnitude", "mag_err": "the error"}
    repeated = {"repeated_times": ("allowed", 0)}  # Julian dates are rounded
    return Table(file, numbers, texts, lines, labels, repeated)


def _number(file: TextFile, line: int, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        _fail(file, line, f"{text[:40]!r} is no number", "correct or drop the line")


def _fail(file: TextFile, line: int, what: str, remedy: str) -> NoReturn:
    raise InputError(f"{file.at(line)}: {what}; {remedy}")
