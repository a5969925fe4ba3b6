"""One object of a survey: its most probable spins, as rows of a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.constants import DAY_S
from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.core.reasons import Finding
from lcbayes.core.time_limit import check_time
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import engine, sparse, verdict
from lcbayes.inversion.attitude_scan.contradiction import compared
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints
from lcbayes.inversion.attitude_scan.limits import unsuited
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution
from lcbayes.inversion.attitude_scan.solutions import Geometry


@dataclass(frozen=True)
class Effort:
    """What is computed for an object of a survey; see `lcbayes.survey`.

    period_range_h : (h, h)
    step : between frequencies, in turns over the data
    keep : largest number of solutions
    refine : whether a convex body is fitted to each of them
    """

    period_range_h: tuple[float, float]
    step: float
    keep: int
    refine: bool


def rows_of(curve: LightCurve, effort: Effort) -> tuple[list[dict[str, Any]], list[Finding]]:
    """The most probable spins of an object, and the reasons against the first.

    Returns
    -------
    rows : list of dict
        ``period_h``, ``period_resolution_h``, ``pole_lon_deg``, ``pole_lat_deg``, ``frame``,
        ``period_probability`` (whatever the pole), ``probability`` (of pole and period),
        ``amplitude_mag``, ``rms``, and ``n_obs``, ``n_curves``, ``span_days``; ``chi2`` and
        ``rms`` of the body, if it is refined. Solutions of the most probable period come first.
    findings : list of Finding
        None if the result can be trusted.

    Raises
    ------
    InputError
        The points are no sparse points.
    OutOfTime
        The limit of `core.time_limit` has passed.
    """
    if why := unsuited(curve):
        raise InputError(why)
    few = SparsePoints.of(curve)
    found, against = compared(few, sparse.search(few, effort.period_range_h, effort.step))
    spins = found.spins[: effort.keep]
    scan = _scan(curve, effort, found)
    scan.contradiction = against
    points = engine.points_of(curve, scan.settings)
    amplitude, rms = sparse.linear_model(few, spins)
    if effort.refine:
        none = Checkpoint(None, {})
        with Silent().stage("", 0, "") as track:
            points, _ = engine.refined(points, few, spins, scan.settings, scan, _here, none, track)
    else:
        empty = np.zeros(0)
        scan.solutions = [
            Solution(
                "constant-rate", np.nan, float(r), empty, np.zeros((0, 3)), empty, 1,
                s.pole, s.frequency, probability=s.probability,
            )
            for s, r in zip(spins, rms, strict=True)
        ]  # fmt: skip
    engine.relate(scan, Geometry.of(points))
    described = [verdict.row(s, scan, False) for s in scan.solutions]
    rows = []
    for row, s, a in zip(described, spins, amplitude, strict=True):
        known = {k: row[k] for k in ("period_h", "period_resolution_h", *_POLE)}
        known |= {
            "frame": curve.frame,
            "period_probability": s.period_probability,
            "probability": s.probability,
            "amplitude_mag": float(a),
            "rms": row["rms"],
            "n_obs": curve.n_obs,
            "n_curves": curve.n_curves,
            "span_days": float(np.ptp(curve.t)) / DAY_S,
        }
        rows.append(known | ({"chi2": row["chi2"]} if effort.refine else {}))
    findings = list(verdict.improbable(scan, described, curve))
    if rows[0]["rms"] > verdict.LOOSE:
        misfit = f"residuals are {100 * rows[0]['rms']:.0f} % of the mean flux"
        findings.insert(0, Finding("no-hypothesis-explains-data", {"misfit": misfit, "to": ""}))
    return rows, findings


_POLE = ("pole_lon_deg", "pole_lat_deg")


def _scan(curve: LightCurve, effort: Effort, found: sparse.SparseSearch) -> AttitudeScan:
    settings = engine.Settings(
        None, effort.period_range_h, (), engine.SMOOTH_LAW, 1, 2.0 * effort.step, 500, 3,
        effort.keep, 0, False, True,
    )  # fmt: skip
    return AttitudeScan(
        settings, [], curve.n_obs, curve.n_obs, curve.error is not None, curve.frame, curve.t,
        curve.curve, np.zeros(0), period_probability=found.period_probability,
    )  # fmt: skip


def _here(
    function: Callable[..., Any], shared: Any, tasks: Iterable[tuple]
) -> Iterator[tuple[int, Any]]:
    """Tasks one after another in this thread, within its limit of time."""
    for i, task in enumerate(tasks):
        check_time()
        yield i, function(shared, *task)
