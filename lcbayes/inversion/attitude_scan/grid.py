"""The hypotheses of a scan: poles over the whole sky and equally spaced frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.physics.bodies import facets

Floats = NDArray[np.float64]

STEP = 0.8  # of half a turn over the data, as in common period scans of asteroids
MOST = 5_000_000  # hypotheses; a safeguard against input errors


@dataclass(frozen=True)
class Grid:
    """All combinations of poles and frequencies.

    Attributes
    ----------
    poles : (N, 3)
    frequencies : (M,) Hz, ascending
    """

    poles: Floats
    frequencies: Floats

    @property
    def size(self) -> int:
        return len(self.poles) * len(self.frequencies)

    def rows(self) -> tuple[Floats, Floats]:
        """Poles and frequencies of all hypotheses, grouped by frequency."""
        n, m = len(self.poles), len(self.frequencies)
        return np.tile(self.poles, (m, 1)), np.repeat(self.frequencies, n)


def frequencies(range_h: tuple[float, float], apart: float) -> tuple[float, int]:
    """The lowest frequency (Hz) of a range of periods (h), and the number at a spacing (Hz)."""
    low, high = range_h
    first = 1.0 / (HOUR_S * high)
    return first, int((1.0 / (HOUR_S * low) - first) / apart) + 1


def grid(
    n_poles: int,
    span: float,
    period_h: float | None = None,
    range_h: tuple[float, float] | None = None,
    step: float = STEP,
) -> Grid:
    """Poles on an equal-area grid, with one period or all periods of a range.

    The frequency spacing is ``step`` × 1/(2 span). Between adjacent frequencies, the rotation over
    the whole span differs by less than half a turn, so a search from either reaches the values in
    between. The corresponding period spacing is ΔP = step × P²/(2 span).

    Parameters
    ----------
    n_poles : int
    span : s
        Length of the data.
    period_h : h
    range_h : (h, h)
    step : float

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, sec. 3.1 (the step).
    """
    if n_poles < 1:
        raise InputError(f"--n-poles is {n_poles}; give a whole number >= 1")
    if (period_h is None) == (range_h is None):
        raise InputError(
            "give the sidereal period with --period HOURS, or those to try with "
            "--period-range FROM,TO (hours)"
        )
    poles = facets.grid(n_poles)
    if period_h is not None:
        if not (np.isfinite(period_h) and period_h > 0):
            raise InputError(f"--period is {period_h:g}; give hours, greater than 0")
        return Grid(poles, np.array([1.0 / (HOUR_S * period_h)]))
    assert range_h is not None
    low, high = range_h
    if not 0 < step <= 2:
        raise InputError(f"--period-step is {step:g}; give a number in 0..2, such as {STEP}")
    apart = step * 0.5 / span
    first, count = frequencies(range_h, apart)
    if count * n_poles > MOST:
        raise InputError(
            f"--period-range {low:g},{high:g} has {count} periods to tell apart in data "
            f"{span / 86400:.4g} days long, {count * n_poles} hypotheses in all; give a narrower "
            "range, or fewer poles"
        )
    return Grid(poles, np.asarray(first + apart * np.arange(count), np.float64))
