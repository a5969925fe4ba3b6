"""The phase of a body whose rate of rotation changes slowly over the light curve.

The phase since t = 0 is ω (t + d ((t − tₘ)² − tₘ²)/2T), with tₘ the middle of the light curve, T
its length and d the relative change of the rate: see `modelling.nuisances.Rotating`. Drifts are in
units of their prior standard deviation at the rate. It keeps the phase by a drift below some
radians at any rate, so that a few drifts stand for all.
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
    """A change of the rate with a prior.

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
        """The drift of a model with the given sd, if the problem has one."""
        return cls(float(data.t_middle), float(data.t_span), sd if SITE in problem.names else 0.0)

    def units(self, spacing: float) -> Floats:
        """Drifts to try, in their sd at the rate, with phases a spacing (rad) apart or less."""
        if not self.sd:
            return np.zeros(1)
        n = int(np.ceil(FARTHEST * nuisances.MAX_DRIFT_PHASE / spacing))
        return FARTHEST * np.arange(-n, n + 1) / n

    def time(self, rate: Floats, unit: Floats, t: Floats) -> Floats:
        """Times (n, A) at which bodies of constant rates (n,) have the phases that those with
        drifts (n,) have at t (A,)."""
        if not self.sd:
            return np.broadcast_to(t, (len(rate), len(t)))
        drift = unit * np.asarray(nuisances.rate_drift_scale(self.span, rate, self.sd))
        bend = ((t - self.middle) ** 2 - self.middle**2) / (2.0 * self.span)
        return t + drift[:, None] * bend

    def phase(self, rate: Floats, unit: Floats, t: Floats) -> Floats:
        """Phases (n, A) rad since t = 0 at t (A,), of rates (n,) and drifts (n,) in their sd."""
        return np.asarray(rate)[:, None] * self.time(rate, unit, t)


NONE = Drift()
