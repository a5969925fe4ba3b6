"""The columns and comments with which a light curve is written, also to a pandas DataFrame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.data.formats.columns import NUMERIC, PLACE, SITE, VECTORS, VELOCITY

if TYPE_CHECKING:
    from lcbayes.data.lightcurve import LightCurve

# site columns have no meaning in addition to the vectors, and are kept unchanged
RESERVED = (NUMERIC - {*SITE}) | {"utc", "curve", "calibrated", "band", "site", "frame"}


def columns_of(curve: LightCurve) -> dict[str, Any]:
    """The columns of the file by name."""
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


def meta_of(curve: LightCurve) -> dict[str, Any]:
    """What applies to the whole file: frame, epoch, and whether times may repeat."""
    meta: dict[str, Any] = {"frame": curve.frame}
    if curve.epoch_jd is not None:
        meta["epoch_jd"] = curve.epoch_jd
    order = np.lexsort((curve.t, curve.curve))
    before, after = order[:-1], order[1:]
    same = curve.curve[before] == curve.curve[after]
    if np.any(same & (curve.t[before] == curve.t[after])):
        meta["repeated_times"] = "allowed"
    return meta
