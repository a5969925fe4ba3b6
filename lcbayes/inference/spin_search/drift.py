"""The phase of a body whose rate of rotation drifts slowly over the light curve.

The phase since t = 0 is ω (t + d ((t − tₘ)² − tₘ²)/2T), with tₘ the middle of the light curve, T
its length and d the relative change of the rate: see `modelling.nuisances.Rotating`. Drifts are in
units of their prior standard deviation at the rate. That prior keeps the phase due to a drift below
some radians at any rate, so that a few drifts stand for all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.modelling import nuisances
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

Floats = NDArray[np.float64]

SITE = "rate_drift_unit"
FARTHEST = 2.5  # prior sd


@dataclass(frozen=True)
class Drift:
    """A drift of the rate with a normal prior.

    Attributes
    ----------
    middle, span : s
        Middle and length of the light curve.
    sd : float
        Prior sd of the relative change of a slow rate over the light curve; 0: the rate is
        constant.
    """

    middle: float = 0.0
    span: float = 1.0
    sd: float = 0.0

    @classmethod
    def of(cls, data: Epochs, problem: Problem, sd: float) -> Drift:
        """A drift of the given sd if the problem has one."""
        return cls(float(data.t_middle), float(data.t_span), sd if SITE in problem.names else 0.0)

    def units(self, spacing: float) -> Floats:
        """Drifts to try, in their sd at the rate, with phases a spacing (rad) apart or less."""
        if not self.sd:
            return np.zeros(1)
        n = int(np.ceil(FARTHEST * nuisances.MAX_DRIFT_PHASE / spacing))
        return FARTHEST * np.arange(-n, n + 1) / n

    def bend(self, rate: Floats, since: Floats) -> Floats:
        """Phases (n, A) rad due to a drift of one sd, at times (A,) s since the middle."""
        if not self.sd:
            return np.zeros((len(rate), len(since)))
        scale = np.asarray(nuisances.rate_drift_scale(self.span, rate, self.sd))
        return (rate * scale)[:, None] * since**2 / (2.0 * self.span)

    def phase(self, rate: Floats, unit: Floats, t: Floats) -> Floats:
        """Phases (n, A) rad since t = 0 at t (A,), of rates (n,) and drifts (n,) in their sd."""
        start = np.array([-self.middle])
        bend = self.bend(rate, t - self.middle) - self.bend(rate, start)
        return rate[:, None] * t + unit[:, None] * bend


NONE = Drift()
