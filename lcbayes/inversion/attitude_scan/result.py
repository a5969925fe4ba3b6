"""What a scan found."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import HOUR_S
from lcbayes.geometry.spherical import lon_lat_deg

Floats = NDArray[np.float64]

SHORTEST_H = 0.2  # a shorter period is given in seconds


@dataclass(frozen=True)
class Solution:
    """A hypothesis after refinement.

    Attributes
    ----------
    law : str
        "constant-rate", or that of the catalogue.
    chi2, rms : float
        Σ r²/σ², and the rms of residuals relative to the mean of their curve.
    residual : (T,)
        Observed minus fitted, relative.
    normals, areas : (N, 3), (N,)
        The body; areas sum to one.
    hits : int
        Searches that ended here.
    pole, frequency : (3,), Hz; None for laws
        The frequency is positive: the pole says the sense.
    coefficients : (P,) or None
        Harmonics of the log-areas in the body's axes, which at the middle of the data are
        `attitude.brought_to` of the pole, as the model "convex-grid" has it; None for facets.
    relation, words : str
        To the best solution; see `solutions.Geometry`.
    """

    law: str
    chi2: float
    rms: float
    residual: Floats
    normals: Floats
    areas: Floats
    hits: int = 1
    pole: Floats | None = None
    frequency: float | None = None
    coefficients: Floats | None = None
    relation: str = ""
    words: str = ""

    @property
    def n_fitted(self) -> int:
        """Numbers of body and spin that were fitted, the body's size aside."""
        body = np.count_nonzero(self.areas) - 1
        if self.coefficients is not None:
            body = len(self.coefficients)
        return int(body) + (0 if self.pole is None else 3)

    def spin(self) -> dict[str, float]:
        """Pole and period by their names in files; nothing for laws."""
        if self.pole is None or self.frequency is None:
            return {}
        lon, lat = map(float, lon_lat_deg(self.pole))
        omega = 2.0 * np.pi * self.frequency * self.pole
        return {
            "pole_lon_deg": lon,
            "pole_lat_deg": lat,
            "period_h": 1.0 / (HOUR_S * self.frequency),
            **{f"omega_{axis}_rad_s": float(x) for axis, x in zip("xyz", omega, strict=True)},
        }


@dataclass
class Table:
    """The constant spins that were screened, in the order in which they were tried.

    start, pole : (B, 3); frequency, chi2 : (B,); steps : (B,)
        χ² at the noise levels of the best of them, with the coarse body.
    tried : (B,) Hz
        The frequency each was started with.
    """

    start: Floats
    tried: Floats
    pole: Floats
    frequency: Floats
    chi2: Floats
    steps: NDArray[np.integer]


@dataclass
class Found:
    """Everything a scan found.

    Attributes
    ----------
    settings : Settings
    solutions : list of Solution
        The best first.
    screened : Table or None
    n_laws, n_periods : int
    left_out : mapping
        Laws that were asked for with "all" but cannot be judged, and why.
    sky : (M, 3) and (M,), or None
        Poles, and χ² of the coarse body with each held at the period of the best solution.
    n_obs, dof : int
    error_known : bool
    frame : str
    t, curve, flux : (T,)
        Of the points: s, group, and flux over the mean of its curve; for figures.
    timing : mapping of seconds
    """

    settings: Any
    solutions: list[Solution]
    n_obs: int
    dof: int
    error_known: bool
    frame: str
    t: Floats
    curve: NDArray[np.integer]
    flux: Floats
    screened: Table | None = None
    n_laws: int = 0
    n_periods: int = 0
    left_out: dict[str, str] = field(default_factory=dict)
    sky: tuple[Floats, Floats] | None = None
    timing: dict[str, float] = field(default_factory=dict)

    def resolution_h(self, period_h: float) -> float:
        """P²/T: periods that are closer turn the body by less than once more over the data."""
        return period_h**2 / (float(np.ptp(self.t)) / HOUR_S)

    @property
    def n_hypotheses(self) -> int:
        return self.n_laws + (0 if self.screened is None else len(self.screened.chi2))

    def table(self) -> tuple[list[str], Iterable[list[str]]]:
        """Heads and rows of ``tables/hypotheses.csv``."""
        heads = [
            "law",
            "start_lon_deg",
            "start_lat_deg",
            "start_period_h",
            "pole_lon_deg",
            "pole_lat_deg",
            "period_h",
            "chi2",
            "steps",
        ]
        rows = []
        if self.screened is not None:
            s = self.screened
            for i in range(len(s.chi2)):
                angles = (*lon_lat_deg(s.start[i]), *lon_lat_deg(s.pole[i]))
                a, b, c, d = (f"{x:.4f}" for x in angles)
                tried, period = (f"{1.0 / (HOUR_S * f):.9g}" for f in (s.tried[i], s.frequency[i]))
                rows.append(
                    [
                        "constant-rate",
                        a,
                        b,
                        tried,
                        c,
                        d,
                        period,
                        f"{s.chi2[i]:.6g}",
                        str(s.steps[i]),
                    ]
                )
        rows += [
            [s.law, *[""] * 6, f"{s.chi2:.6g}", ""]
            for s in self.solutions
            if s.law != "constant-rate"
        ]
        return heads, rows


def readable_period(hours: float) -> tuple[float, str]:
    """A period in hours, or in seconds where it is short, and its unit."""
    return (hours, "h") if hours >= SHORTEST_H else (HOUR_S * hours, "s")


def written_period(hours: float, resolution_h: float) -> str:
    """A period with its unit, to a hundredth of what the length of the data resolves."""
    period, unit = readable_period(hours)
    decimals = 2 - math.floor(math.log10(resolution_h * period / hours))
    return f"{period:.{max(decimals, 0)}f} {unit}"
