"""What a light curve holds: points, passes, cadence, ranges and errors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import NIGHT, labels, split
from lcbayes.inversion.spin.detrended import noise_of

Rows = NDArray[np.integer]
FEWEST_FOR_NOISE = 8  # points of a pass from whose differences the scatter is estimated


@dataclass(frozen=True)
class Description:
    """The content of a light curve.

    Attributes
    ----------
    passes : rows of each pass or night, by time
    facts : mapping
        Content of ``summary.json`` about the file.
    """

    passes: list[Rows]
    facts: dict[str, Any]


def describe(curve: LightCurve) -> Description:
    """Passes, spans, cadence, ranges and errors of a light curve."""
    passes = sorted(split(curve.t, labels(curve), NIGHT), key=lambda rows: curve.t[rows[0]])
    steps = np.concatenate([np.diff(curve.t[rows]) for rows in passes])
    steps = steps[steps > 0]
    facts = {
        "format": curve.source.get("format", ""),
        "notes": [n for n in curve.source.get("notes", "").split("; ") if n],
        "kind": curve.kind,
        "n_obs": curve.n_obs,
        "n_curves": curve.n_curves,
        "curves_of_unknown_scale": int(np.sum(curve.free_scale)),
        "n_passes": len(passes),
        "span_s": float(np.ptp(curve.t)),
        "first_jd": _jd(curve, float(curve.t.min())),
        "last_jd": _jd(curve, float(curve.t.max())),
        "cadence_s": float(np.median(steps)) if steps.size else None,
        "longest_pass_s": max(float(np.ptp(curve.t[rows])) for rows in passes),
        "sites": _counts(curve.site),
        "bands": _counts(curve.band),
        "brightness_range": None
        if curve.geometry_only
        else [float(curve.brightness.min()), float(curve.brightness.max())],
        "errors": _errors(curve, passes),
        "geometry": not curve.brightness_only,
        "phase_angle_range_deg": _range(np.degrees(curve.phase_angle)),
        "range_km": None if curve.range_km is None else _range(curve.range_km),
        "orbit": curve.position_km is not None,
    }
    return Description(passes, facts)


def rows_of_passes(curve: LightCurve, passes: list[Rows]) -> list[dict[str, Any]]:
    """One row for each pass: start, duration, points, cadence, ranges."""
    table = []
    for number, rows in enumerate(passes, 1):
        t, y = curve.t[rows], curve.brightness[rows]
        steps = np.diff(t)
        steps = steps[steps > 0]
        angle = _range(np.degrees(curve.phase_angle[rows])) or [np.nan, np.nan]
        table.append(
            {
                "pass": number,
                "curve": curve.curve_names[int(curve.curve[rows[0]])],
                "site": str(curve.site[rows[0]]),
                "band": str(curve.band[rows[0]]),
                "start_s": float(t[0]),
                "start_jd": _jd(curve, float(t[0])),
                "duration_s": float(np.ptp(t)),
                "n_obs": rows.size,
                "cadence_s": float(np.median(steps)) if steps.size else np.nan,
                f"lowest_{curve.kind}": float(np.min(y)),
                f"highest_{curve.kind}": float(np.max(y)),
                "phase_angle_from_deg": angle[0],
                "phase_angle_to_deg": angle[1],
            }
        )
    return table


def _jd(curve: LightCurve, t: float) -> float | None:
    return None if curve.epoch_jd is None else curve.epoch_jd + t / DAY_S


def _counts(values: NDArray[np.str_]) -> dict[str, int]:
    names, counts = np.unique(values, return_counts=True)
    return {str(n): int(c) for n, c in zip(names, counts, strict=True) if n}


def _range(values: NDArray[np.float64]) -> list[float] | None:
    return None if np.isnan(values).all() else [float(values.min()), float(values.max())]


def _errors(curve: LightCurve, passes: list[Rows]) -> dict[str, Any]:
    """The errors of the file, and the scatter between neighbouring points of a pass.

    The scatter comes from third differences, which a smooth curve does not affect. It is in the
    unit of the brightness for magnitudes, and relative to the mean of the pass for fluxes.
    """
    scatter = None
    dense = [rows for rows in passes if rows.size >= FEWEST_FOR_NOISE]
    if dense and not curve.geometry_only:
        of_mean = curve.kind == "flux"
        scatter = float(
            np.median(
                [
                    noise_of(curve.brightness[rows])
                    / (max(abs(float(np.mean(curve.brightness[rows]))), 1e-300) if of_mean else 1.0)
                    for rows in dense
                ]
            )
        )
    median = None if curve.error is None else float(np.median(curve.error))
    return {"given": curve.error is not None, "median": median, "scatter": scatter}
