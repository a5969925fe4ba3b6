"""The spins found by a scan, as starting points of a fit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, cast

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.variables import SPIN
from lcbayes.results.load import read_json
from lcbayes.results.record import read_record
from lcbayes.results.store import task_of


def read_scan(folder: str | Path, curve: LightCurve) -> list[dict[str, Any]]:
    """The spins that fit this light curve as well as the best one, from the folder of a scan.

    Raises
    ------
    InputError
        The folder holds no scan, a scan of another light curve, or one without constant spins.
    """
    folder = Path(folder)
    if task_of(folder) != "scan":
        raise InputError(f"{folder} holds no scan; give the folder that lcbayes scan -o wrote")
    summary = read_json(folder / "summary.json", {"solutions": list})
    _, known = read_record(folder / "run.toml").inputs.get("curve", ("", None))
    if known != curve.source.get("sha256"):
        raise InputError(
            f"the scan in {folder} is of another light curve; scan this one, then start from that"
        )
    solutions: list[Any] = summary.get("solutions") or []
    spins: list[dict[str, Any]] = [s for s in solutions if _spin(s) and s.get("near_equal")]
    if not spins:
        raise InputError(f"the scan in {folder} found no constant spin to start from")
    return spins


def _spin(solution: Any) -> bool:
    """Whether a solution is a constant spin with all the entries that a scan writes for one."""
    if not isinstance(solution, dict):
        return False
    entries = cast("dict[str, Any]", solution)
    return all(isinstance(entries.get(k), int | float) and math.isfinite(entries[k]) for k in SPIN)
