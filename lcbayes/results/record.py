"""The record of a run: what is needed to repeat it, and the hash of every file it read."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable, read_bytes
from lcbayes.core.options import Options
from lcbayes.core.toml import Table, read_toml
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.options import ReadOptions
from lcbayes.results.store import SCHEMA

CURVE = "curve"


def record_of(task: str, options: Options, source: str, value: Any) -> dict[str, Any]:
    """The content of ``run.toml`` for a run.

    Parameters
    ----------
    options : options of the task; those that are None are omitted
    source : name of the task's first argument
    value : the light curve, whose ``source`` records its origin and how it was read; or a path

    Returns
    -------
    dict
        ``task``, ``version``, the source's path and the tables ``options``, ``reading`` and, for
        every file that was read, ``input.NAME`` (path and SHA-256).
    """
    record: dict[str, Any] = {"task": task, "version": installed_version()}
    files = options.files()
    curve = value if isinstance(value, LightCurve) else None
    if curve is not None:
        if curve.source.get("file"):
            record[source] = os.path.abspath(curve.source["file"])
    elif isinstance(value, str | Path):
        record[source] = os.path.abspath(value)
        files = {source: Path(value)} | files
    given = {name: _plain(value) for name, value in options.as_dict().items()}
    given |= {name: os.path.abspath(given[name]) for name in files if name in given}
    record["options"] = given
    if curve is not None:
        record |= _of_curve(record.get(source), curve)
    for name, path in files.items():
        if path.is_file():
            record[f"input.{name}"] = input_file(path)
    return record


def _of_curve(path: str | None, curve: LightCurve) -> dict[str, Any]:
    reading = json.loads(curve.source.get("reading", "{}"))
    entries: dict[str, Any] = {"reading": reading}
    known = {k: curve.source[k] for k in ("format", "sha256") if k in curve.source}
    if path is not None:
        entries["input.curve"] = {"path": path, **known}
    if "tle" in reading:
        entries["input.tle"] = {"path": reading["tle"], "sha256": curve.source["tle_sha256"]}
    return entries


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | list):
        return [_plain(item) for item in cast("Sequence[Any]", value)]
    return value if isinstance(value, bool | int | float) else str(value)


def input_file(path: str | Path) -> dict[str, str]:
    """Path and SHA-256 of a file that a task has read, for the table ``input.NAME``."""
    return {"path": os.path.abspath(path), "sha256": sha256(path)}


def sha256(path: str | Path) -> str:
    """SHA-256 of a file, in hexadecimal digits.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    return hashlib.sha256(read_bytes(path)).hexdigest()


@dataclass(frozen=True)
class Record:
    """The content of a ``run.toml``.

    Attributes
    ----------
    path : path of the file
    task : name of the task
    options : as given; the task checks them
    reading : options with which the light curve was read, already checked
    inputs : name -> (path, SHA-256) of every file that the run read
    content : the whole file
    """

    path: Path
    task: str
    options: dict[str, Any]
    reading: dict[str, Any]
    inputs: dict[str, tuple[str, str]]
    content: dict[str, Any]

    def source(self, name: str) -> str:
        """The path of the task's first argument.

        Raises
        ------
        InputError
            The run had it in memory.
        """
        value = self.content.get(name)
        if not isinstance(value, str) or not value or "\0" in value:
            raise InputError(f"{self.path} names no {name}; give one")
        return value

    def check_inputs(self, *left_out: str) -> None:
        """Raise an InputError if a file that the run read is missing or has changed."""
        for name, (path, digest) in self.inputs.items():
            if name in left_out:
                continue
            if not Path(path).is_file():
                raise InputError(
                    f"{printable(path)}, an input of {self.path}, is not there; put it back, or "
                    f"give the {name} on the command line"
                )
            if digest and sha256(path) != digest:
                raise InputError(
                    f"{printable(path)} has changed since {self.path} was written; to use it as "
                    f"it is now, give the {name} on the command line"
                )

    def model(self, given: str | None) -> str:
        """The model of the run: a name, or a file that the caller gives and whose hash matches.

        A results folder may come from someone else, so a model file is never run only because the
        folder names it.

        Raises
        ------
        InputError
            The model is a file and none is given, or a different file is given.
        """
        from lcbayes.modelling.registry import BUILT_IN

        known = str(self.options.get("model", ""))
        if known in BUILT_IN:
            if given not in (None, known):
                raise InputError(f"--model is {given!r}, but {self.path} is of the model {known}")
            return known
        if not known:
            raise InputError(f"{self.path} names no model; run `lcbayes fit` again")
        if given is None:
            raise InputError(
                f"the model of {self.path} is the file {printable(known)}, which is run only where "
                "you name it: give --model FILE"
            )
        digest = self.inputs.get("model", ("", ""))[1]
        if not digest or sha256(given) != digest:
            raise InputError(
                f"{printable(given)} is not the model file of {self.path}: its SHA-256 differs; "
                "give the file as it was, or run `lcbayes fit` again"
            )
        return given


def read_record(path: Path) -> Record:
    """Read a ``run.toml``.

    Raises
    ------
    InputError
        It is missing, another version wrote it, or a part of it has the wrong type.
    """
    root = read_toml(path)
    if root.values.get("schema") != SCHEMA:
        raise InputError(
            f"{path} is of another version of lcbayes (schema {root.values.get('schema')!r}, "
            f"expected {SCHEMA}); run the command again"
        )
    empty = root.blank()
    options = root.table("options", empty).values
    for name, value in options.items():
        items = cast("list[Any]", value) if isinstance(value, list) else [value]
        if not all(isinstance(item, str | int | float) for item in items):
            raise root.table("options").fault(name, "is no text and no number")
    reading = ReadOptions.of(root.table("reading", empty).values).as_dict()
    inputs = root.table("input", empty)
    files = {name: _input(inputs.table(name)) for name in inputs.keys()}  # noqa: SIM118
    return Record(path, root.text("task"), options, reading, files, root.values)


def _input(table: Table) -> tuple[str, str]:
    return table.text("path"), table.text("sha256", "")
