"""ECSV: delimited text with a YAML description of the columns in its `#` header."""

from __future__ import annotations

import math
import warnings
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile
from lcbayes.data.formats.build import build
from lcbayes.data.formats.columns import NUMERIC, TEXTS, Options
from lcbayes.data.formats.names import renamed
from lcbayes.data.formats.table import Table, header_labels, header_of, parse
from lcbayes.data.formats.times import with_utc
from lcbayes.data.lightcurve import LightCurve

UNITS = {"jd": "d", "t": "s", "mag": "mag", "mag_err": "mag", "exposure_s": "s"} | {
    name: unit
    for ending, unit in (("_deg", "deg"), ("_km_s", "km / s"), ("_km", "km"), ("_m", "m"))
    for name in NUMERIC
    if name.endswith(ending)
}

MAX_NODES = 100_000  # of the header's YAML with its aliases expanded
HEEDED = ("epoch_jd", "frame", "repeated_times")  # keys of the meta data used by `build`


def is_ecsv(text: str) -> bool:
    """Whether the first line identifies an ECSV file."""
    return text.startswith("# %ECSV")


def read_ecsv(file: TextFile, options: Options) -> LightCurve:
    """Read an ECSV file: as CSV, with a check of column units and with its meta data."""
    header_line, _ = header_of(file.text)
    comments = file.text.split("\n")[: max(header_line - 1, 0)]
    yaml = [line[2:] for line in comments if line.startswith("# ") and not _is_magic(line)]
    try:
        columns, delimiter, meta = _said(yaml)
    except Exception as fault:  # any error of the YAML parser is caused by the file
        reason = _short(f"{type(fault).__name__} {fault}")
        raise InputError(
            f"{file.at(1)}: the ECSV header cannot be read ({reason}); write it with astropy, or "
            "remove the '# %ECSV' line to read plain CSV"
        ) from None
    labels = header_labels(file, delimiter)
    rename, notes = renamed(file, labels, options.columns, brightness=not options.geometry_only)
    table = parse(file, NUMERIC, rename, delimiter, texts=TEXTS)
    given = {table.label(name) for name in (*table.numbers, *table.texts)}
    if given != set(columns):
        odd = _short(", ".join(sorted(given ^ set(columns))))
        raise InputError(
            f"{file.at(header_line)}: the row of names and the YAML header differ ({odd}); make "
            "them agree"
        )
    _check_units(table, columns)
    table.meta = {key: (value, 1) for key, value in meta.items()}
    return build(with_utc(table), options, "ecsv", notes)


def _said(yaml: list[str]) -> tuple[dict[str, dict], str, dict[str, str]]:
    """Columns by name, delimiter, and the meta data in use, from the header's YAML."""
    from astropy.io.misc.yaml import AstropyLoader
    from astropy.table import meta

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if _size(AstropyLoader("\n".join(yaml)).get_single_node(), {}) > MAX_NODES:
            raise ValueError("its aliases stand for too much")
        header = meta.get_header_from_yaml(yaml)
    delimiter = header.get("delimiter", " ")
    if delimiter not in (" ", ","):
        raise ValueError("the delimiter is neither a space nor a comma")
    values = header.get("meta") or {}
    if not isinstance(values, dict):
        raise ValueError("its meta has no keys")
    heeded = {str(key).lower(): value for key, value in values.items()}
    heeded = {key: heeded[key] for key in HEEDED if key in heeded}
    for key, value in heeded.items():
        if not isinstance(value, str | int | float):
            raise ValueError(f"{key} in its meta is neither a text nor a number")
    columns = {str(column["name"]): dict(column) for column in header["datatype"]}
    return columns, delimiter, {key: str(value) for key, value in heeded.items()}


def _size(node: Any, sizes: dict[int, float]) -> float:
    """Number of nodes of a YAML tree with its aliases expanded, inf if it contains itself.

    Nested aliases take few nodes in a file but can exhaust the memory when copied or printed.
    """
    if id(node) not in sizes:
        sizes[id(node)] = math.inf
        parts = node.value if isinstance(node.value, list) else []
        pairs = (part if isinstance(part, tuple) else (part,) for part in parts)
        sizes[id(node)] = 1 + sum(_size(child, sizes) for pair in pairs for child in pair)
    return sizes[id(node)]


def _short(text: str) -> str:
    """The text in one line, truncated if long."""
    return " ".join(text.split())[:200]


def _is_magic(line: str) -> bool:
    return line.startswith(("# %ECSV", "# ---"))


def _check_units(table: Table, columns: dict[str, dict]) -> None:
    for name in table.numbers:
        unit = columns[table.label(name)].get("unit")
        expected = UNITS.get(name)
        if unit is not None and expected is not None and str(unit) != expected:
            raise InputError(
                f"{table.file.name}: column {table.label(name)!r} is in {_short(str(unit))}; "
                f"expected {expected}: convert it"
            )
