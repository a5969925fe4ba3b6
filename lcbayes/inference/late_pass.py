"""Late times of one pass that give the same phases as a drift of the rate of rotation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.observers import observers
from lcbayes.data.segments import PASS, split

Floats = NDArray[np.float64]

ALIKE_SD = 2.0  # uncertainties of the drift within which the phases of all passes agree
MISTAKE_SD = 100.0  # prior sd of a clock up to which a pass may be late by a mistake


class LatePass(NamedTuple):
    """A pass, counted from 1, whose recorded times are late by ``late_s`` (s; early if negative),
    and the period of rotation (s) if they are."""

    number: int
    late_s: float
    period_s: float


def instead_of_drift(
    curve: LightCurve, drift: float, drift_sd: float, rate: float, clock_sd: float
) -> list[LatePass]:
    """Each pass whose late times, at a constant rate, give the same phases as a drift of the rate.

    A relative drift ε over the light curve turns the body as far as at a constant rate ω at the
    time t + w, w = ε [(t − t_m)² − t_m²]/2T; see `modelling.nuisances.rate_drift`. At the rate
    ω (1 + b), and with times of one pass that are late by L, that time is t + a + b t, less L in
    the pass. The two are alike if a, b and L of least squares leave less of w, in the middle of
    each pass, than the uncertainty of ε. Of three passes this holds for each, whatever ε is. That
    the rate differs within passes is left out: the prior keeps drifts so small that it turns the
    body by little there, and a change of the pole does the same.

    Parameters
    ----------
    curve : LightCurve
        If it is of several observers, none is found: their clocks are parameters.
    drift, drift_sd : float
        ε and its standard deviation.
    rate : float
        ω, rad/s.
    clock_sd : float
        Prior standard deviation of a clock, s. No pass is late by more than `MISTAKE_SD` of it.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.repeat([0.0, 6000.0, 18000.0], 4) + np.tile([0.0, 50.0, 100.0, 150.0], 3)
    >>> toward = np.tile([0.0, 0.6, 0.8], (12, 1))
    >>> curve = LightCurve(t=t, brightness=np.ones(12), error=None, sun=toward, obs=toward)
    >>> for late in instead_of_drift(curve, 7e-4, 7e-6, 0.133, 0.3):
    ...     print(f"pass {late.number}: {late.late_s:.2f} s, period {late.period_s:.4f} s")
    pass 1: -2.08 s, period 47.2365 s
    pass 2: 1.39 s, period 47.2420 s
    pass 3: -4.17 s, period 47.2529 s
    """
    seen_by = observers(curve)
    passes = split(curve.t, seen_by.index, PASS)
    if len(seen_by.names) > 1 or len(passes) < 3:
        return []
    t = np.array([np.mean(curve.t[rows]) for rows in passes]) - curve.t.min()
    span = float(np.ptp(curve.t))
    moved = drift * ((t - 0.5 * span) ** 2 - (0.5 * span) ** 2) / (2.0 * span)
    line = np.stack([np.ones_like(t), t / span], axis=1)
    uncertain = ALIKE_SD * drift_sd / abs(drift) * np.abs(_left(line, moved)).max()
    found = []
    for k in range(len(t)):
        columns = np.concatenate([line, -np.eye(len(t))[:, [k]]], axis=1)
        if np.abs(_left(columns, moved)).max() > uncertain:
            continue
        _, slope, late = np.linalg.lstsq(columns, moved)[0]
        if abs(late) > MISTAKE_SD * clock_sd:
            continue
        period = 2.0 * np.pi / (rate * (1.0 + slope / span))
        found.append(LatePass(k + 1, float(late), float(period)))
    return found


def _left(columns: Floats, values: Floats) -> Floats:
    """Residuals of least squares."""
    return values - columns @ np.linalg.lstsq(columns, values)[0]
