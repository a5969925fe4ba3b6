"""The record of a run: what it takes to run it again, and the hash of every file it read."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve


def record_of(task: str, options: Mapping[str, Any], curve: LightCurve | None) -> dict[str, Any]:
    """What ``run.toml`` holds of a run.

    Parameters
    ----------
    options : of the task; those that are None are left out
    curve : the light curve, whose ``source`` says where it came from and how it was read

    Returns
    -------
    dict
        ``task``, ``version``, ``curve`` (path) and the tables ``options``, ``reading``,
        ``input.curve`` and ``input.tle`` (path and SHA-256).
    """
    record: dict[str, Any] = {"task": task, "version": installed_version()}
    if curve is not None and curve.source.get("file"):
        record["curve"] = os.path.abspath(curve.source["file"])
    record["options"] = {
        name: value if isinstance(value, bool | int | float | tuple) else str(value)
        for name, value in options.items()
        if value is not None
    }
    if curve is None:
        return record
    reading = json.loads(curve.source.get("reading", "{}"))
    record["reading"] = reading
    source = {k: curve.source[k] for k in ("format", "sha256") if k in curve.source}
    if "curve" in record:
        record["input.curve"] = {"path": record["curve"], **source}
    if "tle" in reading:
        record["input.tle"] = {"path": reading["tle"], "sha256": curve.source["tle_sha256"]}
    return record


def input_file(path: str | Path) -> dict[str, str]:
    """Path and SHA-256 of a file that a task has read, for a table ``input.NAME``."""
    with open(path, "rb") as file:
        digest = hashlib.file_digest(file, "sha256")
    return {"path": os.path.abspath(path), "sha256": digest.hexdigest()}
