"""Glints: short brightenings above a robust baseline, with width, height and significance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.optimize import curve_fit
from scipy.stats import norm

from lcbayes.data.segments import nights

Floats = NDArray[np.float64]
Ints = NDArray[np.integer]

SPAN = 4.0  # window of the baseline, in durations of the longest glint
DEGREE = 5  # of the polynomial that removes trends with phase angle and aspect beforehand
FWHM = 2.0 * np.sqrt(2.0 * np.log(2.0))


@dataclass(frozen=True)
class Glint:
    """One glint.

    Attributes
    ----------
    row : int
        Point of the light curve nearest to the peak.
    stretch : int
        Index of the segment without long gaps.
    t, t_error : s
        Time of the peak of a Gaussian profile, and its error: the statistical error combined with a
        twentieth of the width for non-Gaussian profiles.
    fwhm : s
        Full width at half maximum; one sampling step if unresolved.
    height, baseline : flux
        Height above the baseline; level of the baseline.
    significance : float
        Significance of the brightest run of points, in standard deviations.
    false_alarm : float
        Probability that noise produces an equally significant glint anywhere in the light curve.
    resolved : bool
        Whether the glint is wider than two sampling steps.
    """

    row: int
    stretch: int
    t: float
    t_error: float
    fwhm: float
    height: float
    baseline: float
    significance: float
    false_alarm: float
    resolved: bool


@dataclass(frozen=True)
class Baseline:
    """Baseline at each point: flux without glints, and the scatter about it."""

    flux: Floats
    scatter: Floats
    stretch: Ints


def baseline(
    t: Floats, flux: Floats, error: Floats, parts: list[Ints], longest_s: Sequence[float]
) -> tuple[Baseline, list[int]]:
    """A smooth trend plus a running median over four times the longest glint, and the scatter.

    The scatter is the larger of the error and the median absolute residual. Structure that the
    median does not follow is therefore treated as noise.

    Returns
    -------
    Baseline
    list of int
        The longest glint of each segment, in points.
    """
    level, scatter = np.full(flux.shape, np.nan), np.full(flux.shape, np.nan)
    which = np.full(flux.shape, -1)
    longest = []
    for i, rows in enumerate(parts):
        step = float(np.median(np.diff(t[rows])))
        points = max(1, round(longest_s[i] / step))
        window = min(max(15, int(SPAN * points)) | 1, (rows.size - 1) | 1)
        slow = _slow(t[rows], flux[rows])
        level[rows] = slow + median_filter(flux[rows] - slow, window, mode="reflect")
        z = (flux[rows] - level[rows]) / error[rows]
        raised = max(1.0, 1.4826 * float(np.median(np.abs(z - np.median(z)))))
        scatter[rows] = error[rows] * raised
        which[rows] = i
        longest.append(min(points, rows.size // 6))
    return Baseline(level, scatter, which), longest


def _slow(t: Floats, flux: Floats) -> Floats:
    """A robust polynomial in time: fitted ten times, each time without outliers."""
    x = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
    kept = np.ones(t.size, bool)
    fitted = np.full(t.size, float(np.median(flux)))
    for _ in range(10):
        series = np.polynomial.legendre.legfit(x[kept], flux[kept], DEGREE)
        fitted = np.polynomial.legendre.legval(x, series)
        left = flux - fitted
        size = 1.4826 * float(np.median(np.abs(left[kept])))
        fresh = np.abs(left) <= 2.5 * max(size, 1e-300)
        if fresh.sum() < 0.6 * t.size or np.array_equal(fresh, kept):
            break
        kept = fresh
    return fitted


def detect(
    t: Floats,
    flux: Floats,
    error: Floats,
    label: Ints,
    longest_s: float | Sequence[float],
    alarm: float = 0.01,
    relative: bool = False,
) -> tuple[list[Glint], Baseline]:
    """Glints with a false-alarm probability over the whole light curve below ``alarm``.

    In each segment, z = (flux − baseline)/scatter is summed over 1, 2, 4, … points and divided by
    the square root of their number. The sums are compared with a normal distribution, and the
    probability is multiplied by the total number of sums (Bonferroni). Overlapping detections are
    one glint, represented by the most significant. Features more than 1.5 times as wide as the
    longest glint are rejected.

    Parameters
    ----------
    t, flux, error : (T,)
        Time in seconds, without equal times in a segment (`instants`); flux at unit distance and
        its standard deviation.
    label : (T,) int
        Points with different labels are never in the same segment.
    longest_s : s
        Duration of the longest glint, common to all segments or for each segment.
    alarm : float
        Nominal probability of a false glint per light curve.
    relative : bool
        Whether noise is normal in the logarithm of the flux, as for magnitudes. Baseline and z are
        then computed in the logarithm, because such noise is skewed towards bright values in flux.

    Returns
    -------
    list of Glint, in order of time
    Baseline
    """
    parts = nights(t, label)
    widest = [longest_s] * len(parts) if isinstance(longest_s, int | float) else longest_s
    value, sigma = (np.log(flux), error / flux) if relative else (flux, error)
    level, longest = baseline(t, value, sigma, parts, widest)
    excess = (value - level.flux) / level.scatter
    if relative:
        level = replace(level, flux=np.exp(level.flux), scatter=flux * level.scatter)
    limits = [
        1.5 * n * float(np.median(np.diff(t[r]))) for n, r in zip(longest, parts, strict=True)
    ]
    widths = [[2**k for k in range(int(np.log2(n)) + 1)] for n in longest]
    trials = sum(rows.size * len(w) for rows, w in zip(parts, widths, strict=True))
    glints: list[Glint] = []
    for i, (rows, sizes) in enumerate(zip(parts, widths, strict=True)):
        z = excess[rows]
        candidates = []
        for size in sizes:
            total = _calm(np.convolve(z, np.ones(size), mode="valid") / np.sqrt(size))
            p = np.minimum(trials * norm.sf(total), 1.0)
            candidates += [(total[j], p[j], j, size) for j in np.flatnonzero(p < alarm)]
        taken = np.zeros(rows.size, bool)
        for score, p, start, size in sorted(candidates, reverse=True):
            if taken[max(0, start - size) : start + 2 * size].any():
                continue
            taken[start : start + size] = True
            peak = _Peak(rows, start, size, i, float(score), float(p))
            one = _measure(t, flux, level, peak)
            taken |= np.abs(t[rows] - one.t) < 2.0 * one.fwhm  # including its wings
            if one.fwhm <= limits[i]:
                glints.append(one)
    return sorted(glints, key=lambda g: g.t), level


def _calm(total: Floats) -> Floats:
    """Sums divided by their own scatter if that exceeds the scatter expected from noise.

    Structure that the baseline does not follow, such as the periodic brightening of diffuse facets,
    has minima as deep as its maxima are high. It must not be detected as a glint; glints have no
    minima. The scatter is therefore estimated from the lower 25, 5 and 1 % quantiles, and from the
    upper quartile, which is insensitive to glints that fill less than a quarter of the time.
    """
    middle = float(np.median(total))
    levels = np.array([0.01, 0.05, 0.25, 0.75])
    scale = np.max((np.quantile(total, levels) - middle) / norm.ppf(levels))
    return total / max(1.0, float(scale))


class _Peak(NamedTuple):
    """A run of significant points: ``size`` rows of a segment from ``start``."""

    rows: Ints
    start: int
    size: int
    stretch: int
    score: float
    p: float


def _measure(t: Floats, flux: Floats, level: Baseline, of: _Peak) -> Glint:
    """Time, width and height of a Gaussian profile above the baseline."""
    rows, start, size = of.rows, of.start, of.size
    step = float(np.median(np.diff(t[rows])))
    excess = flux[rows] - level.flux[rows]
    peak = start + int(np.argmax(excess[start : start + size]))
    near = np.arange(max(0, start - 2 * size - 3), min(rows.size, start + 3 * size + 3))
    x, y, s = t[rows[near]] - t[rows[peak]], excess[near], level.scatter[rows[near]]
    height, centre, sigma, error = (
        float(excess[peak]),
        0.0,
        max(0.5 * size * step, 0.4 * step),
        step,
    )

    def profile(x: Floats, h: float, c: float, w: float) -> Floats:
        return h * np.exp(-0.5 * ((x - c) / w) ** 2)

    low, high = [0.0, x[0], 0.3 * step], [3 * height, x[-1], max(x[-1] - x[0], step)]
    try:
        fitted, covariance = curve_fit(
            profile, x, y, (height, 0.0, sigma), s, absolute_sigma=True, bounds=(low, high)
        )
        if size > 1 or fitted[2] < 3 * step:
            height, centre, sigma = (float(v) for v in fitted)
            error = float(np.sqrt(max(covariance[1, 1], 0.0)))
    except RuntimeError:  # no convergence: the sampling step sets the time error
        pass
    fwhm = max(FWHM * sigma, step)
    at = t[rows[peak]] + centre
    error = float(np.hypot(min(error, fwhm), 0.05 * fwhm))
    nearest = rows[int(np.argmin(np.abs(t[rows] - at)))]
    return Glint(
        int(nearest),
        of.stretch,
        float(at),
        max(error, 0.3 * step if fwhm <= 2 * step else 0.0),
        fwhm,
        height,
        float(level.flux[nearest]),
        of.score,
        of.p,
        bool(fwhm > 2 * step),
    )
