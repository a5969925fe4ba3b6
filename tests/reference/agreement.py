"""Do draws agree with known moments? Means and sds, each in its Monte-Carlo standard error.

Draws fall into groups that are independent, or very nearly: the independent runs of a sampler, or
stretches of its chains many times as long as its memory. The scatter of the groups' averages gives
the standard error without a model of the autocorrelations, and the pull, divided by it, follows
Student's t with one degree of freedom less than there are groups. Of the sd the logarithm is
compared: its errors are nearly symmetric, and do not shrink where the sd comes out small.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tests.helpers.false_alarms import EACH, limit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Moments:
    """Mean and sd of Q quantities, the standard error of the mean, and that of ln sd; (Q,) each."""

    names: tuple[str, ...]
    mean: Floats
    sd: Floats
    mean_se: Floats
    log_sd_se: Floats


@dataclass(frozen=True)
class Agreement:
    """What draws say of Q quantities beside the moments known.

    Attributes
    ----------
    bias, bias_se : (Q,) error of the mean over the known sd, and its standard error
    stretch, stretch_se : (Q,) ln of sd about the known mean over the known sd, likewise
    n_groups : that the errors rest on
    """

    bias: Floats
    bias_se: Floats
    stretch: Floats
    stretch_se: Floats
    n_groups: int

    @property
    def pulls(self) -> Floats:
        """Errors of means, then of sds, in standard errors, (2 Q,)."""
        return np.concatenate([self.bias / self.bias_se, self.stretch / self.stretch_se])

    def limit(self, false_alarm: float = EACH) -> float:
        """What the largest of these pulls exceeds with this probability, at most."""
        return limit(2 * len(self.bias), self.n_groups - 1, false_alarm)

    def finds(self, margin: float = 4.0) -> tuple[float, float]:
        """The least shift, in posterior sds, and the least ln of a wrong width, that are found out
        but for ``margin`` standard errors of bad luck, in every quantity."""
        least = self.limit() + margin
        return least * float(self.bias_se.max()), least * float(self.stretch_se.max())


def compare(draws: Floats, known: Moments, stretches: int) -> Agreement:
    """Draws (C, S, Q) of C chains, each cut into as many stretches."""
    chains, length, n = draws.shape
    length -= length % stretches
    away = (draws[:, :length] - known.mean) / known.sd
    groups = away.reshape(chains * stretches, -1, n)
    first, second = groups.mean(axis=1), np.mean(groups**2, axis=1)
    mean_square = second.mean(axis=0)
    return Agreement(
        first.mean(axis=0),
        np.hypot(error(first), known.mean_se / known.sd),
        0.5 * np.log(mean_square),
        np.hypot(0.5 * error(second) / mean_square, known.log_sd_se),
        len(groups),
    )


def error(groups: Floats) -> Floats:
    """Standard error of the mean over groups (G, Q)."""
    return groups.std(axis=0, ddof=1) / np.sqrt(len(groups))
