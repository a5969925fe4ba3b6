"""The fit of one object of a batch, from its files to its row of the table."""

from __future__ import annotations

import hashlib
import json
import time
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_json
from lcbayes.core.version import installed_version
from lcbayes.modelling.variables import SPIN, is_albedo_area
from lcbayes.results.catalogue import FAILED, NOT_TRUSTED, TRUSTED
from lcbayes.results.draws import weighted_draws
from lcbayes.tasks.batch.objects import Object
from lcbayes.tasks.fit.options import TASK
from lcbayes.tasks.task import execute

if TYPE_CHECKING:
    from lcbayes.tasks.fit.result import Fit

MARK = "object.json"  # in an object's folder: its row and its identity


def done_before(folder: Path, one: Object) -> dict[str, Any] | None:
    """The row of an object that was already fitted with the same files and options."""
    try:
        mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
        same = mark["identity"] == identity(one) and (folder / "summary.json").is_file()
        return mark["row"] if same else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def identity(one: Object) -> str:
    """The identity of everything that determines an object's result."""
    named = {**one.reading.files(), **one.options.files()}
    given = [{k: str(v) for k, v in o.as_dict().items()} for o in (one.reading, one.options)]
    digest = hashlib.sha256(json.dumps([*given, installed_version()], sort_keys=True).encode())
    for path in (Path(one.curve), *named.values()):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def fit_object(shared: tuple[str, bool], one: Object) -> dict[str, Any]:
    """Fit one object in its own folder of a batch; always returns its row."""
    from lcbayes.data.read import read
    from lcbayes.tasks.fit.run import fit

    where, with_report = shared
    folder = Path(where) / one.name
    begun = time.monotonic()
    try:
        curve = read(one.curve, **one.reading.as_dict())
        result = execute(TASK, fit.__wrapped__, curve, one.options, folder, with_report)
    except InputError as fault:
        return failed(one, str(fault), time.monotonic() - begun)
    except Exception as fault:  # a fault in one object must not stop the others
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")
        message = ": ".join([type(fault).__name__, *str(fault).strip().splitlines()[:1]])
        return failed(one, f"{message}; see {folder / 'error.txt'}", time.monotonic() - begun)
    row = _row(one, result, time.monotonic() - begun)
    row["page"] = f"objects/{one.name}/report.html" if with_report else None
    write_json({"identity": identity(one), "row": row}, folder / MARK)
    return row


def failed(one: Object, reason: str, seconds: float | None = None) -> dict[str, Any]:
    """The row of an object without a result."""
    return {
        "name": one.name,
        "curve": one.curve,
        "status": FAILED,
        "reasons": [{"code": "object-failed", "text": reason}],
        "seconds": seconds,
    }


def _row(one: Object, result: Fit, seconds: float) -> dict[str, Any]:
    """The row of a fit, with numbers of its heaviest solution."""
    summary = result.content
    parameters = summary["parameters"]
    row = {
        "name": one.name,
        "curve": one.curve,
        "status": TRUSTED if result.trusted else NOT_TRUSTED,
        "reasons": summary["reasons"],
        "seconds": seconds,
        "model": summary["model"],
        "n_facets": summary["n_facets"],
        "n_obs": summary["n_obs"],
        "n_solutions": len(summary["modes"]),
        "weight": summary["modes"][0]["weight"],
        "chi2": summary["fit"]["chi2"],
        "dof": summary["fit"]["dof"],
        "rms": summary["fit"]["rms"],
        "rms_unit": summary["fit"]["rms_unit"],
        "max_rhat": summary["max_rhat"],
        "min_ess_bulk": summary["min_ess_bulk"],
    }
    for key in SPIN:
        if key in parameters:
            row[key], row[f"{key}_sd"] = parameters[key]["mean"], parameters[key]["sd"]
    if areas := [name for name in result.posterior if is_albedo_area(str(name))]:
        drawn = weighted_draws(result.posterior, seed=summary["seed"])[areas]
        own = (x.sum([d for d in x.dims if d not in ("chain", "draw")]) for x in drawn.values())
        total = np.sum([x.to_numpy() for x in own], axis=0)
        row["albedo_area_m2"], row["albedo_area_m2_sd"] = float(total.mean()), float(total.std())
    return row
