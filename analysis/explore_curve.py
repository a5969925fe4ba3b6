"""The interactive light curve of a result without a posterior, with candidate periods."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lcbayes.analysis.numerals import SUPERSCRIPT
from lcbayes.analysis.style import colour
from lcbayes.core.constants import DAY_S
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import NIGHT, labels, split
from lcbayes.geometry.times import date

MOST_POINTS = 20_000  # of the light curve; above, the page has still pictures only


def packed(values: ArrayLike, kind: str) -> str:
    """Base64 of an array of numbers."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def payload(curve: LightCurve, candidates: Sequence[tuple[str, float]] = ()) -> Any:
    """Content of the JSON that the page explores; None if there are too many points.

    Parameters
    ----------
    curve : LightCurve
    candidates : pairs of label and period (s)
        Periods at which the page folds the light curve.
    """
    if curve.n_obs > MOST_POINTS or curve.geometry_only:
        return None
    passes = sorted(split(curve.t, labels(curve), NIGHT), key=lambda rows: curve.t[rows[0]])
    order = np.concatenate(passes)
    start = float(curve.t.min())
    label, power = _label(curve)
    sites, site = np.unique(curve.site, return_inverse=True)
    error = np.full(curve.n_obs, np.nan) if curve.error is None else curve.error
    nowhere = np.zeros((curve.n_obs, 3))
    epoch = None if curve.epoch_jd is None else curve.epoch_jd + start / DAY_S
    return {
        "magnitude": curve.kind == "mag",
        "label": label,
        "epoch": epoch,
        "power": power,
        "t": packed(curve.t[order] - start, "<f8"),
        "y": packed(curve.brightness[order] / power, "<f4"),
        "error": packed(error[order] / power, "<f4"),
        "sigma": packed(error[order] / power, "<f4"),
        "site": packed(site[order], "<u2"),
        "sites": sites.tolist(),
        "phase": packed(np.degrees(curve.phase_angle[order]), "<f4"),
        "sun": packed(nowhere[order], "<f4"),
        "obs": packed(nowhere[order], "<f4"),
        "segments": [
            {"n": rows.size, "title": _title(curve, i, rows)} for i, rows in enumerate(passes)
        ],
        "modes": [
            {
                "name": "",
                "colour": colour(0),
                "draws": 0,
                "bands": None,
                "curves": None,
                "periods": [period for _, period in candidates[:1]] or None,
                "candidates": [{"label": name, "seconds": p} for name, p in candidates],
                "attitude": None,
            }
        ],
    }


def _label(curve: LightCurve) -> tuple[str, float]:
    """The label of the axis of brightness, and the power of ten taken out of its numbers."""
    if curve.kind == "mag":
        return "magnitude", 1.0
    power = int(np.floor(np.log10(max(float(np.max(np.abs(curve.brightness))), 1e-300))))
    if -2 <= power <= 3:
        return "flux", 1.0
    return f"flux (10{str(power).translate(SUPERSCRIPT)})", 10.0**power


def _title(curve: LightCurve, number: int, rows: Any) -> str:
    parts = [f"pass {number + 1}"]
    if curve.epoch_jd is not None:
        parts.append(date(curve.epoch_jd + float(curve.t[rows[0]]) / DAY_S, clock=True))
    if site := str(curve.site[rows[0]]):
        parts.append(site)
    return " · ".join([*parts, f"{rows.size} points"])
