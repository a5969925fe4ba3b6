"""Synodic frequencies and phases in windows along a pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.inversion.spin.detrended import Pass
from lcbayes.inversion.spin.periods import blocks, design

Floats = NDArray[np.float64]
Rows = NDArray[np.integer]

MIN_CYCLES = 6.0  # of the base period in a pass: four windows of 1.5 cycles
MAX_WINDOWS = 10
NODES = 3  # directions per window
STRONG, STEADY = 5.0, 0.3  # least amplitude over error; least over largest amplitude of a pass
MAX_LINES = 3  # harmonics per pass whose phases are used


@dataclass(frozen=True)
class Synodic:
    """Local frequency of the modulation in sliding windows.

    Attributes
    ----------
    t : (W,) s
        Middle of the window.
    frequency, error : (W,) Hz
        Frequency of the base and its standard error.
    which : (W,) int
        Index of the pass.
    """

    t: Floats
    frequency: Floats
    error: Floats
    which: NDArray[np.int64]


@dataclass(frozen=True)
class Phases:
    """Phases of the modulation in non-overlapping windows, in radians of the base.

    Attributes
    ----------
    t : (W,) s
        Middle of the window, relative to the middle of its pass.
    phase, error : (W,) rad
        Phase of a harmonic divided by its number k, relative to the phase of the frequency
        ``base``, unwrapped along the pass; its standard error.
    line : (W,) int
        Index of the line (a harmonic in a pass); windows of one line have a common unknown
        constant.
    harmonic : (W,) int
        Harmonic number k of the line.
    which : (W,) int
        Index of the pass.
    sun, obs : (W, 3, 3)
        Directions at three evenly spaced times of the window.
    base : Hz
    """

    t: Floats
    phase: Floats
    error: Floats
    line: NDArray[np.int64]
    harmonic: NDArray[np.int64]
    which: NDArray[np.int64]
    sun: Floats
    obs: Floats
    base: float

    @property
    def constants(self) -> Floats:
        """Columns of the constants of the lines, (W, L)."""
        return (self.line[:, None] == np.arange(self.line.max() + 1)).astype(float)


def _solve(one: Pass, rows: Rows, columns: Floats) -> tuple[Floats, Floats]:
    """Weighted least squares and its covariance, increased if χ² shows errors to be too small."""
    x = columns / one.error[rows, None]
    z = one.y[rows] / one.error[rows]
    covariance = np.linalg.pinv(x.T @ x, rcond=1e-12, hermitian=True)
    solution = covariance @ (x.T @ z)
    chi2 = float(np.sum((z - x @ solution) ** 2))
    return solution, covariance * max(1.0, chi2 / max(len(z) - x.shape[1], 1))


def frequency(one: Pass, rows: Rows, start: float, harmonics: Sequence[int]) -> tuple[float, float]:
    """Frequency of a Fourier series with free coefficients for some points, by Gauss-Newton.

    The model is y = a + b t + Σ_k (c_k cos 2πkft + s_k sin 2πkft). For evenly spaced points the
    standard error of f tends to √(6/N) σ/(π T √(Σ k² A_k²)).

    Returns
    -------
    frequency, standard error : Hz
        NaN if the iteration leaves start ± 1/T.
    """
    x = one.t[rows] - one.t[rows].mean()
    span = float(np.ptp(x))
    estimate, error = start, np.nan
    fixed = np.column_stack([np.ones_like(x), x / span])
    k = np.repeat(np.asarray(harmonics, float), 2)
    for _ in range(25):
        waves = design(2 * np.pi * estimate * x, harmonics)
        solution, covariance = _solve(one, rows, np.column_stack([fixed, waves]))
        c, s = solution[2::2], solution[3::2]
        crossed = np.stack([s, -c], axis=1).ravel()  # phase derivative of each pair
        slope = 2 * np.pi * x * (waves @ (k * crossed))
        solution, covariance = _solve(one, rows, np.column_stack([fixed, waves, slope]))
        step = float(np.clip(solution[-1], -0.25 / span, 0.25 / span))
        estimate += step
        error = float(np.sqrt(covariance[-1, -1]))
        if abs(estimate - start) > 1.0 / span:
            return np.nan, np.nan
        if abs(step) < 1e-3 * error:
            break
    return estimate, error


def synodic(passes: Sequence[Pass], base: float, harmonics: Sequence[int]) -> Synodic:
    """Frequencies in windows that overlap by half, two cycles long or a sixth of the pass."""
    out: list[tuple[float, float, float, int]] = []
    for i, one in enumerate(passes):
        cycles = one.length * base
        if cycles < MIN_CYCLES:
            continue
        selected = list(harmonics)
        length = max(2.0 / base, one.length / 6.0)
        count = max(1, round(2.0 * (one.length - length) / length))
        for begin in np.linspace(one.t[0], one.t[-1] - length, count + 1):
            rows = np.flatnonzero((one.t >= begin) & (one.t <= begin + length))
            if rows.size < 2 * (2 * len(selected) + 3) or np.ptp(one.t[rows]) < 0.7 * length:
                continue
            f, error = frequency(one, rows, base, selected)
            if np.isfinite(f) and error < 0.5 * base:
                out.append((float(one.t[rows].mean()), f, error, i))
    table = np.array(out).reshape(-1, 4)
    return Synodic(table[:, 0], table[:, 1], table[:, 2], table[:, 3].astype(int))


def phases(passes: Sequence[Pass], base: float, harmonics: Sequence[int]) -> Phases | None:
    """Phases of the strongest steady harmonics of each pass; None if no pass has any.

    A pass has four to ten windows. A harmonic is used if its amplitude is at least five times its
    error in every window and never below 0.3 of its maximum, because a harmonic that vanishes
    reappears with a different phase.
    """
    rows_out: list[tuple[float, float, float, int, int, int]] = []
    sun, obs = [], []
    line = 0
    for i, one in enumerate(passes):
        cycles = one.length * base
        if cycles < MIN_CYCLES:
            continue
        count = int(np.clip(cycles / 2.0, 4, MAX_WINDOWS))
        middle = 0.5 * (one.t[0] + one.t[-1])
        parts = [r for r in blocks(one, count) if r.size >= 2 * (2 * len(harmonics) + 2)]
        parts = [r for r in parts if np.ptp(one.t[r]) * base > 1.0]
        if len(parts) < 4:
            continue
        fits = [_harmonics(one, r, base, harmonics) for r in parts]
        amplitude, angle, error = (np.array(x) for x in zip(*fits, strict=True))  # (W, K)
        steady = (amplitude.min(axis=0) > STEADY * amplitude.max(axis=0)) & np.all(
            amplitude > STRONG * error * amplitude, axis=0
        )
        k = np.asarray(harmonics)
        worth = np.where(steady, np.sum((k / error) ** 2, axis=0), 0.0)
        for j in np.argsort(-worth)[:MAX_LINES]:
            if not steady[j]:
                continue
            unwrapped = np.unwrap(angle[:, j]) / k[j]
            for r, p, e in zip(parts, unwrapped, error[:, j] / k[j], strict=True):
                rows_out.append((float(one.t[r].mean() - middle), p, e, line, int(k[j]), i))
                at = r[np.clip(((np.arange(NODES) + 0.5) / NODES * r.size).astype(int), 0, None)]
                sun.append(one.sun[at])
                obs.append(one.obs[at])
            line += 1
    if not rows_out:
        return None
    table = np.array(rows_out)
    line_of, harmonic, which = table[:, 3:].astype(int).T
    return Phases(
        table[:, 0],
        table[:, 1],
        table[:, 2],
        line_of,
        harmonic,
        which,
        np.array(sun),
        np.array(obs),
        base,
    )


def _harmonics(
    one: Pass, rows: Rows, base: float, harmonics: Sequence[int]
) -> tuple[Floats, Floats, Floats]:
    """Amplitude, phase and phase error of each harmonic, A cos(2πk f t + ψ)."""
    x = one.t[rows] - one.t[rows].mean()
    turns = 2 * np.pi * base * (one.t[rows] - 0.5 * (one.t[0] + one.t[-1]))
    columns = np.column_stack([np.ones_like(x), x / np.ptp(x), design(turns, harmonics)])
    solution, covariance = _solve(one, rows, columns)
    c, s = solution[2::2], solution[3::2]
    i = 2 + 2 * np.arange(len(harmonics))
    power = np.maximum(c**2 + s**2, 1e-300)
    variance = (
        s**2 * covariance[i, i] + c**2 * covariance[i + 1, i + 1] - 2 * c * s * covariance[i, i + 1]
    ) / power**2
    return np.sqrt(power), np.arctan2(-s, c), np.sqrt(variance)
