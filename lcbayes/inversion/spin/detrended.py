"""Division of a light curve into passes: segments without long gaps from one site."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import MIN_POINTS, labels, nights

Floats = NDArray[np.float64]
Rows = NDArray[np.integer]

TREND = 3  # degree of the polynomial in time that removes phase-angle and aspect trends
ROUNDING = 1e-9  # of the flux; smaller variations count as constant
LEAST_ERROR = 0.1  # of a point, relative to the scatter of its pass


@dataclass(frozen=True)
class Pass:
    """One segment of a light curve.

    Attributes
    ----------
    name : for messages
    t : (T,) s
    y, error : (T,)
        Flux over its smooth trend, minus one, and the standard deviation, see `split`.
    sun, obs : (T, 3)
        Unit vectors body→Sun and body→observer, inertial.
    """

    name: str
    t: Floats
    y: Floats
    error: Floats
    sun: Floats
    obs: Floats

    @property
    def length(self) -> float:
        """Time from the first to the last point, s."""
        return float(self.t[-1] - self.t[0])

    @property
    def step(self) -> float:
        """Median time between points, s."""
        steps = np.diff(self.t)
        return float(np.median(steps[steps > 0]))

    @property
    def nyquist(self) -> float:
        """Half the sampling rate, Hz; higher frequencies are aliased."""
        return 0.5 / self.step


def split(curve: LightCurve) -> list[Pass]:
    """The passes of a light curve with at least `MIN_POINTS` points.

    A pass has one group, site and band, and ends at a gap of `lcbayes.data.segments.NIGHT`. Flux is
    scaled to unit distance if the range is known, and divided by a cubic in time. Unknown errors
    are estimated from third differences, (y₀ − 3y₁ + 3y₂ − y₃)/√20, which are insensitive to a
    smooth curve. No error is below a tenth of the scatter of its pass: errors of magnitudes are
    relative, so the faintest points of a deep light curve would outweigh all others, although no
    periodic curve describes them that well.

    Raises
    ------
    InputError
        There is no brightness, or no pass has enough points.
    """
    if curve.geometry_only:
        raise InputError("the light curve has no brightness, only geometry; give a measured one")
    flux, error = linear(curve)
    passes = []
    for rows in nights(curve.t, labels(curve)):
        one = _one(curve, rows, flux[rows], None if error is None else error[rows])
        if one is not None:
            passes.append(one)
    if not passes:
        raise InputError(
            f"no pass has {MIN_POINTS} points and light; give single passes that are sampled more "
            "densely"
        )
    return passes


def linear(curve: LightCurve) -> tuple[Floats, Floats | None]:
    """Flux proportional to that at unit distance, (T,), and its error if known.

    Magnitudes are relative to their median; their errors are converted to relative flux errors in
    the limit of small errors.
    """
    dilution = 1.0
    if curve.range_km is not None:
        dilution = (np.median(curve.range_km) / curve.range_km) ** 2
    if curve.kind == "flux":
        error = None if curve.error is None else curve.error / dilution
        return curve.brightness / dilution, error
    flux = 10.0 ** (-0.4 * (curve.brightness - np.median(curve.brightness)))
    error = None if curve.error is None else 0.4 * np.log(10.0) * flux * curve.error / dilution
    return flux / dilution, error


def _one(curve: LightCurve, rows: Rows, flux: Floats, error: Floats | None) -> Pass | None:
    t = curve.t[rows]
    mean = float(np.mean(flux))
    if not mean > 0:
        return None  # only noise
    x = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
    trend = np.polynomial.legendre.legval(x, np.polynomial.legendre.legfit(x, flux, TREND))
    trend = np.maximum(trend, 0.1 * mean)
    y = flux / trend - 1.0
    if np.abs(y).max() < ROUNDING:
        y = np.zeros_like(y)  # rounding errors have structure that shuffling destroys
    known = np.full(t.size, noise_of(y)) if error is None else error / trend
    known = np.maximum(known, LEAST_ERROR * np.std(y))
    day = f"t = {t[0]:.6g} s"
    name = ", ".join(s for s in (str(curve.site[rows[0]]), day) if s)
    return Pass(name, t, y, known, curve.sun[rows], curve.obs[rows])


def noise_of(y: Floats) -> float:
    """Standard deviation of the non-smooth part of y, from its third differences."""
    third = np.diff(y, 3)
    return max(1.4826 * float(np.median(np.abs(third))) / np.sqrt(20.0), 1e-12)
