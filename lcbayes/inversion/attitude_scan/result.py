"""Results of a scan."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import HOUR_S
from lcbayes.geometry.spherical import lon_lat_deg

if TYPE_CHECKING:
    from lcbayes.inversion.attitude_scan.contradiction import Contradiction

Floats = NDArray[np.float64]

SHORTEST_H = 0.2  # a shorter period is given in seconds


@dataclass(frozen=True)
class Solution:
    """A hypothesis after refinement.

    Attributes
    ----------
    law : str
        "constant-rate", or the name in the catalogue.
    chi2, rms : float
        Σ r²/σ², and the rms of residuals relative to the mean of their curve.
    residual : (T,)
        Observed minus fitted, relative.
    normals, areas : (N, 3), (N,)
        The body; areas sum to one.
    hits : int
        Number of searches that ended here.
    pole, frequency : (3,), Hz; None for laws
        The frequency is positive; the pole gives the sense of rotation.
    coefficients : (P,) or None
        Harmonics of the log-areas in the body's axes; None for facets. At the middle of the data
        the axes are `attitude.brought_to` of the pole, as in the model "convex-grid".
    relation, words : str
        Relation to the best solution; see `solutions.Geometry`.
    probability : float or None
        Of this pole and period; None unless a periodogram was the first stage.
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
    probability: float | None = None

    @property
    def n_fitted(self) -> int:
        """Number of fitted parameters of body and spin, excluding the body's size."""
        body = np.count_nonzero(self.areas) - 1
        if self.coefficients is not None:
            body = len(self.coefficients)
        return int(body) + (0 if self.pole is None else 3)

    def spin(self) -> dict[str, float]:
        """Pole and period by their names in files; empty for laws."""
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
    """The screened constant spins, in the order of the trials.

    start, pole : (B, 3); frequency, chi2 : (B,); steps : (B,)
        χ² with the coarse body; see `search.misfit`.
    tried : (B,) Hz
        Initial frequency of each spin.
    """

    start: Floats
    tried: Floats
    pole: Floats
    frequency: Floats
    chi2: Floats
    steps: NDArray[np.integer]


@dataclass
class AttitudeScan:
    """Complete result of a scan.

    Attributes
    ----------
    settings : Settings
    solutions : list of Solution
        The best first.
    screened : Table or None
    n_laws, n_periods : int
    left_out : mapping
        Laws requested by "all" that cannot be tested, with the reason.
    sky : (M, 3) and (M,), or None
        Poles, and χ² of the coarse body with each pole fixed, at the period of the best solution.
    n_obs, dof : int
    error_known : bool
    frame : str
    t, curve, flux : (T,)
        Time (s), group and flux over the mean of its curve for each point; for figures.
    curve_titles : tuple of str
        Of each group, with the day of its first point; for figures.
    timing : mapping of seconds
    epoch_jd : float or None
        Julian date of t = 0; None if only seconds are known.
    period_probability : float or None
        Of the period of the first solution, whatever its pole; None without a periodogram.
    n_ranked : int
        Number of spins that the periodogram ranked.
    nights : dict or None
        Of `nights.outlook`.
    contradiction : Contradiction or None
        A curve without which another period is the most probable; not in files, whose summary
        names it.
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
    epoch_jd: float | None = None
    curve_titles: tuple[str, ...] = ()
    period_probability: float | None = None
    n_ranked: int = 0
    nights: dict[str, Any] | None = None
    contradiction: Contradiction | None = None

    def resolution_h(self, period_h: float) -> float:
        """P²/T: over the data, closer periods differ by less than one turn of the body."""
        return period_h**2 / (float(np.ptp(self.t)) / HOUR_S)

    @property
    def n_hypotheses(self) -> int:
        if self.n_ranked:
            return self.n_ranked
        return self.n_laws + (0 if self.screened is None else len(self.screened.chi2))

    def table(self) -> tuple[list[str], Iterable[list[str]]]:
        """Column names and rows of ``tables/hypotheses.csv``."""
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
    """A period in hours, or in seconds if it is short, and its unit."""
    return (hours, "h") if hours >= SHORTEST_H else (HOUR_S * hours, "s")


def written_period(hours: float, resolution_h: float) -> str:
    """A period with its unit, rounded to a hundredth of the resolution of the data."""
    period, unit = readable_period(hours)
    decimals = 2 - math.floor(math.log10(resolution_h * period / hours))
    return f"{period:.{max(decimals, 0)}f} {unit}"
