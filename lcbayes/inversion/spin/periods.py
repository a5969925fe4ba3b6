"""The photometric period of passes: periodogram, false alarms, base period, folding."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from lcbayes.inversion.spin.detrended import Pass

Floats = NDArray[np.float64]
Rows = NDArray[np.integer]

CYCLES = 3.0  # cycles of the lowest frequency in the longest pass
OVERSAMPLING = 3.0
HIGHEST = 3  # harmonics of the strongest line used to select a base period
DIVISORS = (1, 2, 3, 4, 5, 6, 7, 8)  # base frequencies tried: the strongest line divided by these
EXPLAINED = 0.02  # least gain in explained variance for a longer base period
MAX_FREQUENCIES = 20_000
CHUNK = 256  # frequencies at a time
SHUFFLED = 2048  # frequencies for which powers of all shuffles are stored at a time


def design(phase: Floats, harmonics: Sequence[int]) -> Floats:
    """Columns cos kφ, sin kφ, (T, 2K)."""
    angle = np.outer(phase, harmonics)
    return np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(len(phase), -1)


def frequencies(passes: Sequence[Pass]) -> Floats:
    """The frequency grid, Hz, from three cycles in the longest pass to the highest Nyquist limit.

    The spacing at each frequency is a third of 1/T, with T the length of the longest pass that
    still contributes there. If there are too many frequencies, the highest are omitted.
    """
    low = CYCLES / max(p.length for p in passes)
    pieces = [np.array([low])]
    for top in sorted({p.nyquist for p in passes}):
        longest = max(p.length for p in passes if p.nyquist >= top)
        count = min(int(np.ceil(OVERSAMPLING * longest * (top - low))), MAX_FREQUENCIES)
        if count > 0:
            step = min((top - low) / count, 1.0 / (OVERSAMPLING * longest))
            pieces.append(low + step * np.arange(1, count + 1))
            low = top
    return np.concatenate(pieces)[:MAX_FREQUENCIES]


def power(passes: Sequence[Pass], grid: Floats, data: Sequence[Floats] | None = None) -> Floats:
    """Fraction of χ² explained by a sinusoid with free phase and level in every pass.

    P(f) = Σ_pass [χ²₀ − χ²(f)] / Σ_pass χ²₀, where each term is a generalised Lomb-Scargle
    periodogram. This implementation is used instead of that of astropy because data sets with
    common times and errors have common sines: a hundred shuffles cost little more than one.

    Parameters
    ----------
    grid : (F,) Hz
    data : (T,) or (T, S) each
        Replaces ``y`` of the passes; S data sets at once.

    Returns
    -------
    (F,) or (F, S)

    References
    ----------
    Zechmeister & Kürster 2009, A&A 496, 577, eqs. (5) to (15).
    """
    values = [one.y for one in passes] if data is None else data
    fall, whole = 0.0, 0.0
    for one, y in zip(passes, values, strict=True):
        weight = one.error**-2
        total = weight.sum()
        w = weight / total
        centred = y - w @ y
        wy = centred * (w if y.ndim == 1 else w[:, None])
        whole = whole + total * np.sum(wy * centred, axis=0)
        x = one.t - one.t[0]
        counts = grid <= one.nyquist
        parts = [_fall(x, w, wy, part) for part in _chunks(grid[counts], CHUNK)]
        part = np.zeros((len(grid), *y.shape[1:]))
        part[counts] = total * np.concatenate(parts)
        fall = fall + part
    return np.divide(fall, whole, out=np.zeros_like(fall), where=whole > 0)


def _chunks(grid: Floats, size: int) -> list[Floats]:
    return np.array_split(grid, max(1, -(-len(grid) // size)))


def _fall(x: Floats, w: Floats, wy: Floats, grid: Floats) -> Floats:
    angle = np.outer(2 * np.pi * grid, x)
    cos, sin = np.cos(angle), np.sin(angle)
    c, s = cos @ w, sin @ w
    cc, ss, cs = (cos**2) @ w - c**2, (sin**2) @ w - s**2, (cos * sin) @ w - c * s
    yc, ys = cos @ wy, sin @ wy
    if wy.ndim > 1:
        cc, ss, cs = cc[:, None], ss[:, None], cs[:, None]
    d = cc * ss - cs**2
    numerator = ss * yc**2 + cc * ys**2 - 2 * cs * yc * ys
    return np.where(d > 1e-6, numerator / np.maximum(d, 1e-6), 0.0)  # no phase at the Nyquist limit


def shuffled_peaks(
    passes: Sequence[Pass], grid: Floats, rng: np.random.Generator, count: int
) -> Floats:
    """The highest power of noise, (count,), from the points of each pass in random order.

    The ratio of y to its error is shuffled, so that unequal errors keep their positions.
    """
    data = []
    for one in passes:
        z = np.tile((one.y / one.error)[:, None], (1, count))
        data.append(rng.permuted(z, axis=0) * one.error[:, None])
    peaks = [power(passes, part, data).max(axis=0) for part in _chunks(grid, SHUFFLED)]
    return np.max(peaks, axis=0)


def chance(passes: Sequence[Pass], grid: Floats, fall: Floats) -> float:
    """Probability that noise with the errors of the passes produces the peak of a power spectrum.

    A sinusoid reduces χ² by an amount with two degrees of freedom per pass. Any frequency of the
    grid may give the peak (Bonferroni).
    """
    whole = 0.0
    for one in passes:
        weight = one.error**-2
        whole += float(np.sum(weight * (one.y - np.average(one.y, weights=weight)) ** 2))
    counting = np.sum([grid <= one.nyquist for one in passes], axis=0)
    p = stats.chi2.sf(whole * fall, 2 * np.maximum(counting, 1))
    return min(1.0, len(grid) * float(p.min()))


def blocks(one: Pass, count: int) -> list[Rows]:
    """Indices of ``count`` segments of equal duration."""
    edges = np.linspace(one.t[0], one.t[-1], count + 1)[1:-1]
    return list(np.split(np.arange(one.t.size), np.searchsorted(one.t, edges)))


def misfit(one: Pass, rows: Rows, frequency: float, harmonics: Sequence[int]) -> tuple[float, int]:
    """χ² of a Fourier series and a straight line for some points, and the number of unknowns."""
    t = one.t[rows]
    x = t - t.mean()
    columns = (
        np.column_stack([np.ones_like(x), x, design(2.0 * np.pi * frequency * x, harmonics)])
        / one.error[rows, None]
    )
    z = one.y[rows] / one.error[rows]
    solution, _, rank, _ = np.linalg.lstsq(columns, z, rcond=1e-10)
    return float(np.sum((z - columns @ solution) ** 2)), int(rank)


def base(passes: Sequence[Pass], line: float) -> tuple[float, list[int]]:
    """Base frequency of the modulation and its harmonics, from the strongest line.

    The line may be any harmonic of the base. The line divided by 1 to 8 is tried with all harmonics
    up to three times the line (and half the sampling rate), with separate coefficients for each
    half of a pass. The base is selected by the Bayesian information criterion. In addition, a
    longer base period must explain 2 % more of the variance and cover six cycles in the longest
    pass.
    """
    longest = max(p.length for p in passes)
    top = min(HIGHEST * line, 0.45 / max(p.step for p in passes))
    parts = [(p, rows) for p in passes for rows in blocks(p, 2)]
    count = sum(len(rows) for _, rows in parts)
    whole = sum(misfit(p, rows, line, [])[0] for p, rows in parts)
    best, chosen = np.inf, (line, [1])
    least = np.inf
    for divisor in DIVISORS:
        f = line / divisor
        harmonics = list(range(1, max(divisor, int(top / f + 1e-9)) + 1))
        unknowns = 2 * len(harmonics) + 2
        if f * longest < 6.0 and divisor > 1:
            continue
        usable = [(p, rows) for p, rows in parts if len(rows) > 2 * unknowns]
        if len(usable) < len(parts):
            continue
        fits = [misfit(p, rows, f, harmonics) for p, rows in parts]
        chi2 = sum(c for c, _ in fits)
        criterion = count * np.log(chi2 / count) + sum(k for _, k in fits) * np.log(count)
        if criterion < best and chi2 < least - EXPLAINED * whole * (divisor > 1):
            best, least, chosen = criterion, chi2, (f, harmonics)
    return chosen


def refine(passes: Sequence[Pass], f: float, harmonics: Sequence[int]) -> float:
    """The best-fitting frequency near f with all harmonics, with half passes fitted separately."""
    longest = max(p.length for p in passes)
    width = 1.0 / (longest * max(1, len(harmonics)))
    parts = [(p, rows) for p in passes for rows in blocks(p, 2) if len(rows) > 4 * len(harmonics)]
    trial = f + width * np.linspace(-1.5, 1.5, 31)
    chi2 = [sum(misfit(p, rows, x, harmonics)[0] for p, rows in parts) for x in trial]
    i = int(np.argmin(chi2))
    if 0 < i < len(trial) - 1:  # vertex of the parabola through three points
        a, b, c = chi2[i - 1 : i + 2]
        shift = 0.5 * (a - c) / (a - 2 * b + c)
        return float(trial[i] + shift * (trial[1] - trial[0]))
    return float(trial[i])


def skill(passes: Sequence[Pass], f: float, harmonics: Sequence[int]) -> float:
    """Fraction of the variance of a segment predicted from its neighbours by the period alone.

    Each pass is divided into segments of at least one and a half cycles. Each segment is predicted
    by the Fourier series of its two neighbours (one at an end): 1 − Σ(y − ŷ)²/Σ(y − ȳ)². The skill
    is one for a noise-free constant period, and zero or less for a signal that does not repeat,
    such as a single glint.
    """
    wrong = whole = 0.0
    for one in passes:
        count = int(min(one.length * f / 1.5, 24, one.t.size // (4 * len(harmonics) + 8)))
        if count < 3:
            continue
        parts = blocks(one, count)
        for i, rows in enumerate(parts):
            beside = np.concatenate([parts[j] for j in (i - 1, i + 1) if 0 <= j < count])
            if rows.size < 3 or beside.size < 2 * len(harmonics) + 2:
                continue
            columns = np.column_stack(
                [np.ones(one.t.size), design(2 * np.pi * f * (one.t - one.t[0]), harmonics)]
            )
            weight = 1.0 / one.error
            solution = np.linalg.lstsq(
                columns[beside] * weight[beside, None], one.y[beside] * weight[beside], rcond=1e-8
            )[0]
            w = weight[rows] ** 2
            # the mean level of the segment contains no information on the period
            left = one.y[rows] - columns[rows] @ solution
            wrong += float(np.sum(w * (left - np.average(left, weights=w)) ** 2))
            own = one.y[rows] - np.average(one.y[rows], weights=w)
            whole += float(np.sum(w * own**2))
    return 1.0 - wrong / whole if whole > 0 else -np.inf


def subharmonic(f: float, line: float, resolution: float) -> int:
    """The k for which a line cannot be distinguished from a harmonic of f/k, or 0.

    Lines closer than the resolution, 1/T, cannot be separated. A line within the resolution of an
    odd multiple of f/2 therefore shows that the brightness repeats with period 2/f. Likewise, a
    line at f/3 or f/4 shows a period of 3/f or 4/f.
    """
    half = 2.0 * line / f
    odd = 2.0 * np.floor(0.5 * half) + 1.0
    if abs(half - odd) * 0.5 * f < resolution:
        return 2
    for k in (3, 4):
        if abs(line - f / k) < resolution:
            return k
    return 0


def other_line(
    passes: Sequence[Pass], grid: Floats, f: float, harmonics: Sequence[int]
) -> tuple[float, float]:
    """The strongest line that is not a harmonic of f, and the fraction of variance it explains.

    Harmonics are fitted separately in thirds of a pass and subtracted. Lines within four resolution
    elements of a harmonic are attributed to its change with aspect and are ignored.
    """
    left, whole = [], 0.0
    for one in passes:
        y = one.y.copy()
        for rows in blocks(one, 3):
            if rows.size < 3 * len(harmonics):
                return f, 0.0
            columns = np.column_stack(
                [np.ones(rows.size), design(2 * np.pi * f * one.t[rows], harmonics)]
            )
            y[rows] -= columns @ np.linalg.lstsq(columns, y[rows], rcond=1e-8)[0]
        left.append(y)
        whole += float(np.sum((one.y / one.error) ** 2))
    remaining = sum(float(np.sum((y / p.error) ** 2)) for y, p in zip(left, passes, strict=True))
    fall = power(passes, grid, left) * remaining / whole
    width = 4.0 / max(p.length for p in passes)
    rate = 1.0 / min(p.step for p in passes)
    lines = f * np.arange(1, 5 * max(harmonics) + 1)
    lines = np.abs(lines - rate * np.round(lines / rate))  # observed at their aliases
    free = np.min(np.abs(grid[:, None] - lines), axis=1) > width
    if not free.any():
        return f, 0.0
    i = int(np.argmax(np.where(free, fall, 0.0)))
    return float(grid[i]), float(fall[i])


def constant(phase: Floats, sigma: Floats, columns: Floats) -> float:
    """p-value of the χ² test that columns explain phases within their errors."""
    x, z = columns / sigma[:, None], phase / sigma
    solution, _, rank, _ = np.linalg.lstsq(x, z, rcond=1e-10)
    chi2 = float(np.sum((z - x @ solution) ** 2))
    freedom = len(z) - int(rank)
    return float(stats.chi2.sf(chi2, freedom)) if freedom > 0 else 1.0
