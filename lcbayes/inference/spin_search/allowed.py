"""The spins that a search visits: those that the prior allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.known_spin import KnownSpin, PoleRegion, bisector_rate

Floats = NDArray[np.float64]

PRIOR_REACH = 4.0  # fastest spin in prior sd of a component of ω: 99.9 % of the prior


@dataclass(frozen=True)
class Allowed:
    """Ranges of rates, and a region of poles.

    Attributes
    ----------
    ranges : tuple of (rad/s, rad/s)
        Ascending and disjoint.
    omega_sd : rad/s or None
        Prior sd of each component of ω; None if the ranges are those of known periods, in which
        the prior counts as flat.
    pole : PoleRegion or None
    """

    ranges: tuple[tuple[float, float], ...]
    omega_sd: float | None = None
    pole: PoleRegion | None = None

    @classmethod
    def of(cls, options: Mapping[str, Any], data: Epochs) -> Allowed:
        """The spins allowed by the options of a model, with their defaults."""
        known = KnownSpin.of(options.get("period", ""), options.get("pole", "")) or KnownSpin()
        if known.periods:
            return cls(known.rates(float(bisector_rate(data))), None, known.pole)
        omega_sd = float(options["omega_sd"])
        return cls(((0.0, PRIOR_REACH * omega_sd),), omega_sd, known.pole)

    @property
    def everything(self) -> bool:
        """Whether the rates have no limit but the fastest, at which the grid of rates ends."""
        return self.omega_sd is not None

    @property
    def slowest(self) -> float:
        """rad/s."""
        return self.ranges[0][0]

    @property
    def fastest(self) -> float:
        """rad/s."""
        return self.ranges[-1][1]

    @property
    def width(self) -> float:
        """Total length of the ranges, rad/s."""
        return sum(high - low for low, high in self.ranges)

    def up_to(self, rate: float) -> Allowed | None:
        """The slower of these spins; None if there are none."""
        ranges = tuple((low, min(high, rate)) for low, high in self.ranges if low < rate)
        return Allowed(ranges, self.omega_sd, self.pole) if ranges else None

    def rates(self, rate: Floats, margin: float = 0.0) -> NDArray[np.bool_]:
        """Which rates (n,) lie in a range, enlarged by a margin (rad/s)."""
        if self.everything:
            return np.ones(rate.shape, bool)
        inside = np.zeros(rate.shape, bool)
        for low, high in self.ranges:
            inside |= (rate >= low - margin) & (rate <= high + margin)
        return inside

    def poles(self, directions: Floats, margin: float = 0.0) -> NDArray[np.bool_]:
        """Which directions (n, 3) lie in the region of the pole, enlarged by a margin (rad)."""
        if self.pole is None:
            return np.ones(len(directions), bool)
        return self.pole.within(directions, margin)

    def log_prior(self, rate: Floats) -> Floats:
        """ln of the prior density of ω at rates (n,), up to a constant."""
        if self.omega_sd is None:
            return np.zeros(rate.shape)
        return -0.5 * (rate / self.omega_sd) ** 2
