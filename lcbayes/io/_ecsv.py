"""ECSV: delimited text whose `#` header says, in YAML, what the columns are."""

from __future__ import annotations

import warnings

from lcbayes._files import TextFile
from lcbayes.errors import InputError
from lcbayes.io._build import build
from lcbayes.io._columns import NUMERIC, Options
from lcbayes.io._table import Table, header_of, parse
from lcbayes.lightcurve import LightCurve

UNITS = {"jd": "d", "t": "s", "mag": "mag", "mag_err": "mag", "exposure_s": "s"} | {
    name: unit
    for ending, unit in (("_deg", "deg"), ("_km_s", "km / s"), ("_km", "km"), ("_m", "m"))
    for name in NUMERIC
    if name.endswith(ending)
}


def is_ecsv(text: str) -> bool:
    """Whether the first line is that of an ECSV file."""
    return text.startswith("# %ECSV")


def read_ecsv(file: TextFile, options: Options) -> LightCurve:
    """Read an ECSV file: as CSV, with the units of its columns checked and its meta heeded."""
    from astropy.table import meta

    header_line, _ = header_of(file.text)
    comments = file.text.split("\n")[: max(header_line - 1, 0)]
    yaml = [line[2:] for line in comments if line.startswith("# ") and not _is_magic(line)]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            header = meta.get_header_from_yaml(yaml)
        columns = {str(column["name"]): column for column in header["datatype"]}
    except Exception as fault:  # whatever the YAML parser meets is a fault of the file
        reason = " ".join(f"{type(fault).__name__} {fault}".split())
        raise InputError(
            f"{file.at(1)}: the ECSV header cannot be read ({reason}); write it with astropy, or "
            "remove the '# %ECSV' line to read plain CSV"
        ) from None
    table = parse(file, NUMERIC, delimiter=header.get("delimiter", " "))
    given = {table.label(name) for name in (*table.numbers, *table.texts)}
    if given != set(columns):
        odd = ", ".join(sorted(given ^ set(columns)))
        raise InputError(
            f"{file.at(header_line)}: the row of names and the YAML header differ ({odd}); make "
            "them agree"
        )
    _check_units(table, columns)
    values = header.get("meta") or {}
    table.meta = {str(key).lower(): (str(value), 1) for key, value in dict(values).items()}
    return build(table, options, "ecsv")


def _is_magic(line: str) -> bool:
    return line.startswith(("# %ECSV", "# ---"))


def _check_units(table: Table, columns: dict[str, dict]) -> None:
    for name in table.numbers:
        unit = columns[table.label(name)].get("unit")
        expected = UNITS.get(name)
        if unit is not None and expected is not None and str(unit) != expected:
            raise InputError(
                f"{table.file.name}: column {table.label(name)!r} is in {unit}; expected "
                f"{expected}: convert it"
            )
