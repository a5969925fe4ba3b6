"""One object of a survey, from its text to its part of the table."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from lcbayes.core.errors import InputError
from lcbayes.core.time_limit import OutOfTime, check_time, time_limit
from lcbayes.core.version import installed_version
from lcbayes.data.catalogues.entry import Entry
from lcbayes.data.lightcurve import LightCurve
from lcbayes.results.catalogue import FAILED, NOT_TRUSTED, TRUSTED
from lcbayes.results.survey_table import OBJECT, SOLUTION, folder_name
from lcbayes.tasks.scan.options import PERIODOGRAM, ScanOptions
from lcbayes.tasks.scan.options import TASK as SCAN
from lcbayes.tasks.survey.options import SurveyOptions
from lcbayes.tasks.task import execute

MOST_SHAPES = 48  # compiled at once; each uses hundreds of memory maps of the process
DIGITS = 10  # of numbers in the table

_shapes: set[tuple[int, ...]] = set()


def key_of(entry: Entry, options: SurveyOptions) -> str:
    """The identity of everything that determines the numbers of an object, 16 digits."""
    text = entry.fault if entry.file is None else entry.file.sha256
    given = {name: str(value) for name, value in options.numbers().items()}
    whole = json.dumps([entry.name, text, given, installed_version()], sort_keys=True)
    return hashlib.sha256(whole.encode()).hexdigest()[:16]


def light_curve(entry: Entry, options: SurveyOptions) -> LightCurve:
    """The light curve of an object.

    Raises
    ------
    InputError
        It cannot be read.
    """
    from lcbayes.data.plausible import check_flux_of_asteroid
    from lcbayes.data.read import read

    if entry.file is None:
        raise InputError(entry.fault)
    curve = read(
        entry.file, columns=options.columns, error=options.error, error_floor=options.error_floor
    )
    check_flux_of_asteroid(curve)
    if options.frame is not None and curve.frame == "inertial":
        curve = replace(curve, frame=options.frame)
    return curve


def search_object(shared: tuple[SurveyOptions, str], entry: Entry) -> dict[str, Any]:
    """The solutions of one object; always returns its part of the table.

    ``retry`` is true if the same computation may succeed the next time.
    """
    options, folder = shared
    begun = time.monotonic()
    try:
        with time_limit(options.time_limit):
            row = _solutions(options, folder, entry)
    except InputError as fault:
        row = failed(entry.name, str(fault), retry=False)
    except OutOfTime as fault:
        row = failed(entry.name, f"{fault} (--time-limit)")
    except Exception as fault:  # a fault in one object must not stop the others
        row = failed(
            entry.name, ": ".join([type(fault).__name__, *str(fault).strip().splitlines()[:1]])
        )
    return row | {"seconds": round(time.monotonic() - begun, 3)}


def failed(name: str, reason: str, *, retry: bool = True) -> dict[str, Any]:
    """The part of the table of an object without a result."""
    reasons = [{"code": "object-failed", "text": reason}]
    return {"name": name, "status": FAILED, "reasons": reasons, "retry": retry, "solutions": []}


def _solutions(options: SurveyOptions, folder: str, entry: Entry) -> dict[str, Any]:
    from lcbayes.inversion.attitude_scan.survey import Effort, rows_of
    from lcbayes.results.reasons import reasons

    curve = light_curve(entry, options)
    check_time()
    _forget_programs(curve)
    low, high = options.period_range
    rows, against = rows_of(
        curve, Effort((low, high), 0.5 * options.period_step, options.keep, options.refine)
    )
    page = _full(options, folder, entry.name, curve) if entry.name in options.full else None
    return {
        "name": entry.name,
        "status": NOT_TRUSTED if against else TRUSTED,
        "reasons": [reason.content for reason in reasons(against)],
        "retry": False,
        **{name: _rounded(rows[0][name]) for name in OBJECT},
        **({} if page is None else {"page": page}),
        "solutions": [[_rounded(row.get(name)) for name in SOLUTION] for row in rows],
    }


def _full(options: SurveyOptions, folder: str, name: str, curve: LightCurve) -> str:
    """Write the complete scan of an object; returns the path of its page within the folder."""
    from lcbayes.tasks.scan.run import scan

    if curve.frame != "ecliptic-j2000":
        raise InputError(
            f"a complete scan needs directions in ecliptic-j2000, and these are in {curve.frame}; "
            "leave --full out for this object"
        )
    place = f"objects/{folder_name(name)}"
    asked = ScanOptions(
        period_range=options.period_range,
        period_step=options.period_step,
        keep=options.keep,
        first_stage=PERIODOGRAM,
    )
    execute(SCAN, scan.__wrapped__, curve, asked, Path(folder) / place)
    return f"{place}/report.html"


def _rounded(value: Any) -> Any:
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value


def _forget_programs(curve: LightCurve) -> None:
    """Discard the compiled programs if there are many, before a light curve that needs others."""
    from lcbayes.core.jax_setup import jax
    from lcbayes.inversion.attitude_scan.harmonics import shape_of

    shape = shape_of(curve)
    if shape not in _shapes and len(_shapes) >= MOST_SHAPES:
        jax.clear_caches()
        _shapes.clear()
    _shapes.add(shape)
