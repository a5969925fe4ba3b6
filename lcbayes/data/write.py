"""`write`: a light curve to CSV or ECSV, from which `read` restores the same light curve."""

from __future__ import annotations

import csv
import io
import os
from pathlib import Path
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_text
from lcbayes.data.formats.columns import NUMERIC, PLACE, SITE, VECTORS, VELOCITY
from lcbayes.data.formats.ecsv import UNITS
from lcbayes.data.lightcurve import LightCurve

# site columns have no meaning in addition to the vectors, and are kept unchanged
RESERVED = (NUMERIC - {*SITE}) | {"utc", "curve", "calibrated", "band", "site", "frame"}


def write(curve: LightCurve, path: str | os.PathLike[str]) -> None:
    """Write a light curve: ECSV if the path ends in .ecsv, otherwise CSV.

    Numbers are written with full precision. Time is the column ``t``, its origin the line
    ``# epoch_jd``; columns in ``extra`` follow the others (as text in CSV, typed in ECSV). The file
    is written atomically.

    Raises
    ------
    InputError
        The path cannot be written, or a column of ``extra`` has a reserved name.
    """
    columns, meta = _columns(curve), _meta(curve)
    ecsv = Path(path).suffix.lower() == ".ecsv"
    write_text((_ecsv if ecsv else _csv)(columns, meta), path)


def _columns(curve: LightCurve) -> dict[str, Any]:
    columns: dict[str, Any] = {"t": curve.t}
    if not curve.geometry_only:
        columns[curve.kind] = curve.brightness
    if curve.error is not None:
        columns[f"{curve.kind}_err"] = curve.error
    if not curve.brightness_only:
        both = np.concatenate([curve.sun, curve.obs], axis=1)
        columns |= dict(zip(VECTORS, both.T, strict=True))
    if curve.range_km is not None:
        columns["range_km"] = curve.range_km
    for names, vectors in ((PLACE, curve.position_km), (VELOCITY, curve.velocity_km_s)):
        if vectors is not None:
            columns |= dict(zip(names, vectors.T, strict=True))
    plain = curve.curve_names == ("0",) and not np.any(curve.free_scale)
    if not plain:
        index = curve.curve
        columns["curve"] = np.array(curve.curve_names)[index]
        columns["calibrated"] = (~curve.free_scale)[index].astype(int)
    for name in ("band", "site"):
        if np.any(getattr(curve, name) != ""):
            columns[name] = getattr(curve, name)
    if np.any(curve.exposure_s != 0):
        columns["exposure_s"] = curve.exposure_s
    taken = {name.lower() for name in curve.extra} & RESERVED
    if taken:
        raise InputError(
            f"extra column {min(taken)!r} has the name of a column with a meaning; rename it"
        )
    for name, values in curve.extra.items():
        if values.ndim != 1:
            raise InputError(f"extra column {name!r} has shape {values.shape}; write one per point")
        columns[name] = values
    return columns


def _meta(curve: LightCurve) -> dict[str, Any]:
    meta: dict[str, Any] = {"frame": curve.frame}
    if curve.epoch_jd is not None:
        meta["epoch_jd"] = curve.epoch_jd
    order = np.lexsort((curve.t, curve.curve))
    before, after = order[:-1], order[1:]
    same = curve.curve[before] == curve.curve[after]
    if np.any(same & (curve.t[before] == curve.t[after])):
        meta["repeated_times"] = "allowed"
    return meta


def _csv(columns: dict[str, Any], meta: dict[str, Any]) -> str:
    out = io.StringIO()
    for key, value in meta.items():
        out.write(f"# {key}: {value}\n")
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    cells = [np.asarray(column).tolist() for column in columns.values()]
    writer.writerows(zip(*cells, strict=True))  # a float is written by repr: shortest exact form
    return out.getvalue()


def _ecsv(columns: dict[str, Any], meta: dict[str, Any]) -> str:
    from astropy.table import Table  # pyright: ignore[reportMissingTypeStubs]

    units = {name: unit for name, unit in UNITS.items() if name in columns}
    table: Any = Table(columns, meta=meta, units=units)
    out = io.StringIO()
    table.write(out, format="ascii.ecsv", delimiter=",")
    return out.getvalue()
