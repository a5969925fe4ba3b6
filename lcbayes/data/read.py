"""`read`: a light curve from a file, with its format recognised from the content."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile, read_bytes, read_text
from lcbayes.data.averaging import averaged
from lcbayes.data.formats import satellites
from lcbayes.data.formats.alcdef import is_alcdef, read_alcdef
from lcbayes.data.formats.build import build
from lcbayes.data.formats.columns import NUMERIC, TEXTS, Options
from lcbayes.data.formats.damit import is_damit, is_period_search, read_damit
from lcbayes.data.formats.ecsv import is_ecsv, read_ecsv
from lcbayes.data.formats.frames import PARQUET, is_table, read_parquet, text_of
from lcbayes.data.formats.names import mapping_of, renamed
from lcbayes.data.formats.table import comment_values, header_labels, parse
from lcbayes.data.formats.tdm import is_tdm, read_tdm
from lcbayes.data.formats.times import with_utc
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.options import ReadOptions
from lcbayes.data.plausible import check
from lcbayes.geometry.tle import LENGTH


def _read_csv(file: TextFile, options: Options) -> LightCurve:
    _refuse_other_kinds(file)
    meta = comment_values(file)
    rename, notes = renamed(
        file, header_labels(file), options.columns, brightness=not options.geometry_only
    )
    table = parse(file, NUMERIC, rename, texts=TEXTS)
    table.meta = meta
    return build(with_utc(table), options, "csv", notes)


def _refuse_other_kinds(file: TextFile) -> None:
    """Refuse texts that are confused with a light curve."""
    lines = file.text.split("\n", 3)[:3]
    if any(line.startswith("1 ") and len(line.rstrip()) == LENGTH for line in lines):
        raise InputError(
            f"{file.name} holds two-line elements; give a light curve, and the elements with --tle"
        )
    if file.path.suffix.lower() == ".toml":
        raise InputError(
            f"{file.name} is a TOML file; give a light curve (lcbayes simulate makes one from a "
            "scenario)"
        )
    if file.text.lstrip()[:1] in ("{", "["):
        raise InputError(f"{file.name} is JSON; give a table with one row per point, such as CSV")


_READERS: dict[str, Callable[[TextFile, Options], LightCurve]] = {
    "csv": _read_csv,
    "ecsv": read_ecsv,
    "damit": read_damit,
    "mmt9": satellites.read_mmt9,
    "score": satellites.read_score,
    "pomenis": satellites.read_pomenis,
    "tdm": read_tdm,
    "alcdef": read_alcdef,
}
FORMATS = tuple(_READERS)
WITH_COLUMNS = ("csv", "ecsv")


def recognise(file: TextFile) -> str:
    """The format of a file from its content; for damaged content, the extension `.lcs` is used."""
    if is_ecsv(file.text):
        return "ecsv"
    if is_damit(file.text) or is_period_search(file.text) or file.path.suffix.lower() == ".lcs":
        return "damit"
    if is_tdm(file.text):
        return "tdm"
    if is_alcdef(file.text):
        return "alcdef"
    return satellites.dialect_of(file.text) or "csv"


def read(
    path: str | os.PathLike[str] | Any,
    *,
    format: str | None = None,
    tle: str | os.PathLike[str] | None = None,
    site: str | Sequence[float] | None = None,
    error_floor: float | None = None,
    error: float | None = None,
    columns: str | Mapping[str, str] | None = None,
    average: str | float | None = None,
    geometry: bool = True,
) -> LightCurve:
    """Read a light curve.

    Parameters
    ----------
    path : file, or a table
        A table is a pandas DataFrame, an astropy Table or a mapping of columns, with the names
        of the columns of a CSV file. The text of a file may also be given, as a `TextFile`.
    format : one of `FORMATS`; None: recognised from the content
    tle : file with two-line elements of the object, for data without directions
    site : latitude, longitude and height of the observer in degrees (north, east) and metres, as
        three numbers or as text with commas, for files that do not contain it
    error_floor : smallest standard deviation, in the unit of the brightness; smaller values are
        raised to it
    error : a standard deviation for all points, which replaces those in the file
    columns : names of the columns in the file, as ``{"mag": "V", "mag_err": "err"}`` or as
        ``"mag=V,mag_err=err"``; common names are recognised automatically. ``ignore`` names a
        column to be ignored
    average : seconds over which consecutive points are averaged, or "auto" for as many points as
        the change of brightness allows; see `lcbayes.data.averaging.averaged`
    geometry : whether directions to Sun and observer are required; if False, a CSV, ECSV or
        ALCDEF file without them gives a curve with ``brightness_only``, which only `lcbayes.look`
        accepts

    Returns
    -------
    LightCurve
        ``source`` contains the options it was read with (``reading``, JSON) and what was left out
        or assumed (``notes``).

    Raises
    ------
    InputError
        A one-line message that names the error, the file, the line and the remedy.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> file = tempfile.mkdtemp() + "/one-facet.csv"
    >>> simulated = lcbayes.simulate("one-facet", seed=1, out=file)
    >>> curve = lcbayes.read(file)
    >>> curve.n_obs, curve.kind
    (102, 'flux')
    """
    mapping = mapping_of(columns)
    given = {"format": format, "tle": tle, "error": error, "error_floor": error_floor}
    if isinstance(site, tuple | list):
        site = ",".join(map(str, site))
    if isinstance(average, int | float):
        average = str(average)
    asked = ReadOptions.of({**given, "site": site, "average": average})
    options = Options(
        _path(asked.tle),
        asked.site,
        asked.error,
        asked.error_floor,
        brightness_only=not geometry,
        columns=mapping,
    )
    curve = _read(path, format, options)
    if curve.n_obs < 2:
        where = path.name if isinstance(path, TextFile) else path
        raise InputError(f"{where} holds one point; a light curve needs at least two")
    if asked.average is not None:
        curve = averaged(curve, asked.average)
    reading = {name: value for name, value in asked.as_dict().items() if name != "tle"}
    if is_table(path):
        curve = replace(curve, source={**curve.source, "file": ""})
    if mapping:
        reading["columns"] = ",".join(f'{name}="{label}"' for name, label in mapping.items())
    source = dict(curve.source)
    source |= _notes(source.get("notes", ""), *check(curve))
    if tle is not None:
        reading["tle"] = os.path.abspath(tle)
        source["tle_sha256"] = hashlib.sha256(read_bytes(tle)).hexdigest()
    return replace(curve, source=source | {"reading": json.dumps(reading)})


def read_geometry(
    path: str | os.PathLike[str],
    *,
    format: str | None = None,
    tle: str | os.PathLike[str] | None = None,
    site: str | None = None,
    columns: str | Mapping[str, str] | None = None,
) -> LightCurve:
    """Read only epochs and geometry, for predictions: as `read`, with the brightness all NaN.

    Columns of brightness and its error are not required. If present, their values are ignored and
    their kind is kept; otherwise the kind is "mag".
    """
    asked = ReadOptions.of({"format": format, "tle": tle, "site": site})
    options = Options(_path(asked.tle), asked.site, geometry_only=True, columns=mapping_of(columns))
    return _read(path, format, options)


def _notes(*notes: str) -> dict[str, str]:
    joined = "; ".join(filter(None, notes))
    return {"notes": joined} if joined else {}


def _path(path: str | os.PathLike[str] | None) -> str | None:
    return None if path is None else os.fspath(path)


def _read(path: str | os.PathLike[str], format: str | None, options: Options) -> LightCurve:
    if format is not None and format not in _READERS:
        raise InputError(f"unknown format {format!r}; available: {', '.join(FORMATS)}")
    if isinstance(path, TextFile):
        file = path
    elif is_table(path):
        file, format = text_of(path), format or "csv"
    elif not isinstance(path, str | os.PathLike):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"the path is of type {type(path).__name__}; give the path of a file, or a table"
        )
    elif _is_parquet(path):
        file, format = replace(text_of(read_parquet(path)), path=Path(path)), format or "csv"
    else:
        file = read_text(path)
    kind = format or recognise(file)
    if options.columns and kind not in WITH_COLUMNS:
        raise InputError(f"{file.name} is {kind}, whose columns are fixed; leave out --columns")
    return _READERS[kind](file, options)


def _is_parquet(path: str | os.PathLike[str]) -> bool:
    try:
        with Path(path).open("rb") as file:
            return file.read(len(PARQUET)) == PARQUET
    except (OSError, ValueError):  # `read_text` says what is wrong
        return False
