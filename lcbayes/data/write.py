"""`write`: a light curve to CSV or ECSV, from which `read` restores the same light curve."""

from __future__ import annotations

import csv
import io
import os
from typing import Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import write_text
from lcbayes.core.paths import as_path
from lcbayes.data.formats.ecsv import UNITS
from lcbayes.data.formats.written import columns_of, meta_of
from lcbayes.data.lightcurve import LightCurve


def write(curve: LightCurve, path: str | os.PathLike[str]) -> None:
    """Write a light curve: ECSV if the path ends in .ecsv, otherwise CSV.

    Numbers are written with full precision. Time is the column ``t``, its origin the line
    ``# epoch_jd``; columns in ``extra`` follow the others (as text in CSV, typed in ECSV). The file
    is written atomically.

    Parameters
    ----------
    curve : LightCurve
    path : file

    Raises
    ------
    InputError
        The path cannot be written, or a column of ``extra`` has a reserved name.

    Examples
    --------
    >>> import lcbayes
    >>> import tempfile
    >>> curve = lcbayes.simulate("one-facet", seed=1).data
    >>> file = tempfile.mkdtemp() + "/one-facet.csv"
    >>> lcbayes.write(curve, file)
    >>> (lcbayes.read(file).brightness == curve.brightness).all().item()
    True
    """
    if not isinstance(curve, LightCurve):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"the light curve is of type {type(curve).__name__}; give a LightCurve")
    columns, meta = columns_of(curve), meta_of(curve)
    ecsv = as_path(path, "the path").suffix.lower() == ".ecsv"
    write_text((_ecsv if ecsv else _csv)(columns, meta), path)


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
