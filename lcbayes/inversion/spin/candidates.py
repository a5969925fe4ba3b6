"""Candidate periods of a light curve, also if its passes are too few or too short for `spin`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import MIN_POINTS, NIGHT, Gap, labels
from lcbayes.data.segments import split as split_at_gaps
from lcbayes.inversion.spin import periods
from lcbayes.inversion.spin.detrended import Pass, linear, noise_of, split
from lcbayes.inversion.spin.sidereal import ALARM, Spin, periodicity
from lcbayes.inversion.spin.windows import MIN_CYCLES

Floats = NDArray[np.float64]
Rows = NDArray[np.integer]

SEASON = Gap(30 * 86400.0)  # nights closer than this are analysed together
LEAST_OF_NIGHT = 3  # points of a night of which the level is removed
WORK = 1.5e7  # points × frequencies of a periodogram that takes a few seconds
MOST = 5  # periods listed
SEPARATION = 2.0  # least distance of two peaks, in units of 1/T of the longest pass
NIGHTS = 2.0  # least length of a season, in units of the longest night
PEAKS = 40  # of the periodogram of a season, at which Fourier series are fitted
HARMONICS = (1, 2, 3, 4)
TRIALS = 13  # frequencies within 1/T of a peak
LEAST_EXPLAINED = 0.05  # least part of χ² explained by a listed period


@dataclass(frozen=True)
class Candidate:
    """A period of the brightness.

    Attributes
    ----------
    period_s : s
    explained : part of χ² explained by a sinusoid of this period, or, for joined nights, by a
        Fourier series with four harmonics
    cycles : number of cycles in the longest pass or season
    of_base : k if it is the k-th harmonic of the base period, else 0
    """

    period_s: float
    explained: float
    cycles: float
    of_base: int


@dataclass(frozen=True)
class Candidates:
    """Periodogram and candidate periods.

    Attributes
    ----------
    spin : the periodogram, its false-alarm probability and the conditions of a stable period
    joined : whether nights were joined into one series, so that the phase is common to them
    listed : the candidates, the base period first, then by the part of χ² explained
    notes : what was left out
    """

    spin: Spin
    joined: bool
    listed: list[Candidate]
    notes: list[str]

    @property
    def significant(self) -> bool:
        """Whether noise has a peak as high with a probability of 1 % at most."""
        return self.spin.false_alarm <= ALARM

    @property
    def best(self) -> float | None:
        """The base period, or the strongest one if there is none, s; None if not significant."""
        return self.listed[0].period_s if self.significant and self.listed else None


def candidate_periods(
    curve: LightCurve,
    *,
    n_shuffles: int = 99,
    seed: int = 0,
    work: float = WORK,
    progress: Silent | None = None,
) -> Candidates | None:
    """Candidate periods: from single passes, or from nights joined where passes show none.

    Single passes are analysed as by `lcbayes.spin`, with a free phase for each. If none has six
    cycles of a period, each night is divided by its mean and the nights of the season with most
    points are joined; their common phase allows periods longer than a night, with the aliases that
    the gaps cause. Bodies mostly repeat their brightness twice in a rotation, so the candidates of
    joined nights are found by Fourier series with four harmonics, at the peaks of the periodogram
    and at twice their periods.

    Parameters
    ----------
    curve : LightCurve
        The directions are not used.
    n_shuffles : int
        Permutations of the points for the false-alarm probability; at least 99.
    seed : int
    work : float
        Largest number of points × frequencies of a periodogram. Shorter passes are left out, and a
        single pass is cut, to remain below it.
    progress : Silent, optional

    Returns
    -------
    Candidates or None
        None if there are fewer than 30 points in any night or season.

    Raises
    ------
    InputError
        The curve has no brightness.
    """
    progress = progress or Silent()
    results: list[Candidates] = []
    for joined in (False, True):
        passes, notes = within(_season(curve) if joined else _passes(curve), work)
        if not passes or (results and passes[0].length < NIGHTS * _longest(results[0])):
            continue
        spin = periodicity(
            passes, curve.error is not None, n_shuffles=n_shuffles, seed=seed, progress=progress
        )
        listed = _series(spin) if joined else _listed(spin)
        results.append(Candidates(spin, joined, listed, [*spin.notes, *notes]))
        if results[-1].significant and listed and listed[0].cycles >= MIN_CYCLES:
            return results[-1]
    return max(results, key=lambda one: one.significant, default=None)


def _longest(candidates: Candidates) -> float:
    return max(one.length for one in candidates.spin.passes)


def _passes(curve: LightCurve) -> list[Pass]:
    """The passes; none if no pass has enough points."""
    if curve.geometry_only:
        raise InputError("the light curve has no brightness, only geometry; give a measured one")
    try:
        return split(curve)
    except InputError:
        return []


def _season(curve: LightCurve) -> list[Pass]:
    """The nights of the season with most points as one series, each divided by its mean."""
    flux, error = linear(curve)
    y, known, kept = np.zeros(curve.n_obs), np.zeros(curve.n_obs), np.zeros(curve.n_obs, bool)
    for rows in split_at_gaps(curve.t, labels(curve), NIGHT, LEAST_OF_NIGHT):
        mean = float(np.mean(flux[rows]))
        if mean > 0:
            y[rows], kept[rows] = flux[rows] / mean - 1.0, True
            known[rows] = 0.0 if error is None else error[rows] / mean
    at = np.flatnonzero(kept)
    seasons = [at[rows] for rows in split_at_gaps(curve.t[at], np.zeros(at.size, int), SEASON)]
    rows = max(seasons, key=len, default=at)
    if rows.size < MIN_POINTS or np.ptp(curve.t[rows]) <= 0:
        return []
    noise = known[rows] if error is not None else np.full(rows.size, noise_of(y[rows]))
    return [Pass("season", curve.t[rows], y[rows], noise, curve.sun[rows], curve.obs[rows])]


def within(passes: list[Pass], work: float) -> tuple[list[Pass], list[str]]:
    """The passes with most points whose periodogram is within ``work``, and a note on the rest.

    Parameters
    ----------
    passes : list of Pass
    work : float
        Largest number of points × frequencies.
    """
    chosen: list[Pass] = []
    for one in sorted(passes, key=lambda p: -p.t.size):
        with_it = [*chosen, one]
        cost = sum(p.t.size for p in with_it) * len(periods.frequencies(with_it))
        if cost <= work:
            chosen = with_it
        elif not chosen:
            chosen = [_cut(one, int(np.sqrt(work / (0.5 * periods.OVERSAMPLING))))]
    used, whole = (sum(p.t.size for p in some) for some in (chosen, passes))
    left = f"the periodogram is of {used} of {whole} points, to be quick; `lcbayes spin` uses all"
    return sorted(chosen, key=lambda p: p.t[0]), [left] if used < whole else []


def _cut(one: Pass, most: int) -> Pass:
    """The first points of a pass."""
    at = slice(0, most)
    return replace(
        one, t=one.t[at], y=one.y[at], error=one.error[at], sun=one.sun[at], obs=one.obs[at]
    )


def _peaks(spin: Spin) -> Rows:
    """Local maxima of the periodogram, highest first."""
    power = spin.power
    inner = np.flatnonzero((power[1:-1] >= power[:-2]) & (power[1:-1] >= power[2:])) + 1
    return inner[np.argsort(-power[inner], kind="stable")]


def _series(spin: Spin) -> list[Candidate]:
    """The best separate periods of a season, from Fourier series."""
    (one,) = spin.passes
    nights = split_at_gaps(one.t, np.zeros(one.t.size, int), NIGHT)
    levels = np.zeros((one.t.size, len(nights)))
    for i, rows in enumerate(nights):
        levels[rows, i] = 1.0
    whole = _misfit(one, levels, None)
    near = np.linspace(-1.0, 1.0, TRIALS) / one.length
    fits: list[tuple[float, float]] = []
    for f in np.concatenate([spin.grid[_peaks(spin)[:PEAKS]] / k for k in (1.0, 2.0)]):
        chi2 = [_misfit(one, levels, x) for x in f + near / len(HARMONICS)]
        best = int(np.argmin(chi2))
        fits.append((chi2[best], float(f + near[best] / len(HARMONICS))))
    chosen: list[tuple[float, float]] = []
    for chi2, f in sorted(fits):
        far = all(abs(f - other) > 0.5 * SEPARATION / one.length for _, other in chosen)
        if far and len(chosen) < MOST and chi2 < (1 - LEAST_EXPLAINED) * whole:
            chosen.append((chi2, f))
    return [Candidate(1 / f, 1 - chi2 / whole, one.length * f, 0) for chi2, f in chosen]


def _misfit(one: Pass, levels: Floats, frequency: float | None) -> float:
    """χ² of a level for each night and, with a frequency, a Fourier series common to them."""
    columns = levels
    if frequency is not None:
        columns = np.hstack([levels, periods.design(2 * np.pi * frequency * one.t, HARMONICS)])
    x, z = columns / one.error[:, None], one.y / one.error
    return float(np.sum((z - x @ np.linalg.lstsq(x, z, rcond=1e-10)[0]) ** 2))


def _listed(spin: Spin) -> list[Candidate]:
    """The base period if there is one, and the strongest separate peaks."""
    grid, power = spin.grid, spin.power
    longest = max(p.length for p in spin.passes)
    chosen: list[float] = []
    if spin.base is not None:
        chosen.append(spin.base)
    for i in _peaks(spin):
        far = all(abs(grid[i] - f) > SEPARATION / longest for f in chosen)
        if len(chosen) < MOST and far and power[i] >= LEAST_EXPLAINED:
            chosen.append(periods.refine(spin.passes, float(grid[i]), [1]))
    return [_candidate(spin, f, longest) for f in chosen]


def _candidate(spin: Spin, f: float, longest: float) -> Candidate:
    part = float(periods.power(spin.passes, np.array([f]))[0])
    harmonic = 0 if spin.base is None else round(f / spin.base)
    if spin.base is None or abs(f - harmonic * spin.base) > SEPARATION / longest:
        harmonic = 0
    return Candidate(1.0 / f, part, longest * f, harmonic)
