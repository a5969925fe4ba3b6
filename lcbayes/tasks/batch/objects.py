"""The objects of a batch with their light curves, from a catalogue or a folder."""

from __future__ import annotations

import csv
import glob
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.files import TextFile, read_text
from lcbayes.core.options import declared_options
from lcbayes.core.toml import read_toml
from lcbayes.data.options import ReadOptions
from lcbayes.tasks.fit.options import FitOptions

PATHS = ("tle", "start_from")  # relative to the catalogue's folder, as are light curves
CURVES = {".csv", ".ecsv", ".lcs", ".txt", ".dat"}


@dataclass(frozen=True)
class Object:
    """One object: its light curve, and the options to read and to fit it."""

    name: str
    curve: str
    reading: ReadOptions = field(default_factory=ReadOptions)
    options: FitOptions = field(default_factory=FitOptions)


def objects(catalogue: str | Path, common: Mapping[str, Any] | None = None) -> list[Object]:
    """The objects of a catalogue, a folder of light curves, or a pattern such as ``'night/*.csv'``.

    A catalogue is a CSV file with a column ``curve``, or a TOML file with tables ``[[objects]]``
    with a key ``curve``, and a table ``[defaults]`` for all objects. Further columns or keys:
    ``name`` and the options of `lcbayes.read` and of `lcbayes.fit`; any other is an option of the
    model. Paths are relative to the catalogue's folder. Options that an object does not set are
    taken from ``common``.

    Raises
    ------
    InputError
        There are no objects, two objects have the same name, or a value has the wrong type.
    """
    path = Path(catalogue)
    if path.is_dir():
        files = sorted(p for p in path.iterdir() if p.suffix.lower() in CURVES and p.is_file())
        rows: list[tuple[str, dict[str, Any]]] = [(str(p), {"curve": str(p)}) for p in files]
        missing = f"{path} holds no light curve ({', '.join(sorted(CURVES))})"
    elif glob.has_magic(str(catalogue)) and not path.exists():
        files = sorted(glob.glob(str(catalogue)))
        rows, missing = [(p, {"curve": p}) for p in files], f"no file matches {catalogue}"
    else:
        rows = list(_toml(path) if path.suffix.lower() == ".toml" else _csv(path))
        missing = f"{path} names no object"
    if not rows:
        raise InputError(f"{missing}; give a catalogue, a folder or a pattern")
    by_name: dict[str, Object] = {}
    for where, row in rows:
        one = _object(where, dict(common or {}) | row)
        if one.name in by_name:
            raise InputError(f"{where}: two objects have the name {one.name!r}; give each its own")
        by_name[one.name] = one
    return list(by_name.values())


def _csv(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    file = read_text(path)
    kept = [(i, x) for i, x in enumerate(file.text.split("\n"), 1) if x.strip() and x[0] != "#"]
    if not kept:
        raise InputError(f"{path} holds comments alone; a catalogue has a head and rows")
    table = _rows(file, kept)
    _, heads = next(table)
    heads = [head.strip() for head in heads]
    if "curve" not in heads:
        raise InputError(
            f"{file.at(kept[0][0])}: there is no column 'curve' in {', '.join(heads)}; a catalogue "
            "names the light curve of each object in it"
        )
    for line, cells in table:
        if len(cells) > len(heads):
            raise InputError(
                f"{file.at(line)}: {len(cells)} cells under {len(heads)} heads; put cells that "
                "contain a comma in quotes"
            )
        row = {k: v.strip() for k, v in zip(heads, cells, strict=False) if v.strip()}
        yield file.at(line), _beside(path, row)


def _rows(file: TextFile, kept: list[tuple[int, str]]) -> Iterator[tuple[int, list[str]]]:
    """Line number and cells of each row."""
    table, begun = csv.reader(line for _, line in kept), 0
    try:
        for cells in table:
            yield kept[begun][0], cells
            begun = table.line_num
    except csv.Error as fault:
        raise InputError(
            f"{file.at(kept[begun][0])}: {fault}; shorten the cell, or close its quotes"
        ) from None


def _toml(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    root = read_toml(path)
    defaults = root.table("defaults", None)
    tables = root.tables("objects")
    root.done()
    for i, table in enumerate(tables, 1):
        row = ({} if defaults is None else defaults.values) | table.values
        yield f"{path}, objects[{i}]", _beside(path, row)


def _beside(path: Path, row: Mapping[str, Any]) -> dict[str, Any]:
    """The row with its paths resolved relative to the catalogue's folder."""
    at = {k: str(path.parent / str(row[k])) for k in ("curve", *PATHS) if k in row}
    if str(row.get("model", "")).endswith(".py"):
        at["model"] = str(path.parent / str(row["model"]))
    return dict(row) | at


def _object(where: str, row: dict[str, Any]) -> Object:
    if "curve" not in row:
        raise InputError(f"{where}: the object has no 'curve'; name its light-curve file")
    curve = str(row.pop("curve"))
    name = re.sub(r"[^\w.+-]+", "_", str(row.pop("name", Path(curve).stem))).strip("._")
    if not name:
        raise InputError(f"{where}: the object's name has no letter or digit; give another")
    row |= {k: os.path.abspath(row[k]) for k in PATHS if k in row}  # a worker may run elsewhere
    if str(row.get("model", "")).endswith(".py"):
        row["model"] = os.path.abspath(row["model"])
    names = declared_options(ReadOptions)
    try:
        reading = ReadOptions.of({k: v for k, v in row.items() if k in names})
        options = FitOptions.of({k: v for k, v in row.items() if k not in names})
    except InputError as fault:
        raise InputError(f"{where}: {fault}") from None
    return Object(name, os.path.abspath(curve), reading, options)
