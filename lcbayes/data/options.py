"""Options for reading a light curve."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.options import Options, option


@dataclass(frozen=True)
class ReadOptions(Options):
    """Options of `lcbayes.read`."""

    format: str | None = option(None, help="format of the file; recognised from its content")
    tle: Path | None = option(None, metavar="FILE", help="two-line elements of the object")
    columns: str | None = option(
        None,
        metavar="NAME=COLUMN,...",
        help='names of the columns in the file, as mag=V,mag_err=err,utc="Date/Time (UTC)"',
    )
    site: str | None = option(
        None, metavar="LAT,LON,H", help="observer: degrees north, degrees east, metres"
    )
    error: float | None = option(None, metavar="SD", help="one error for all points, mag or flux")
    error_floor: float | None = option(
        None, metavar="SD", help="smallest error, mag or flux; smaller ones are raised to it"
    )
    average: str | None = option(
        None,
        metavar="auto|S",
        help="average consecutive points: over S seconds, or auto, as many as the change of "
        "brightness allows",
    )
