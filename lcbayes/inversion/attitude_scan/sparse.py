"""Spins of an object with sparse points: the posterior over all periods and poles.

`periodogram` ranks every pole of a grid with every frequency. `evidence` then computes the evidence
of the best, and of half and twice their periods, and divides the cells that hold the posterior.
Cells with nearly the same pole and frequency are one solution; its probability is their mass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.constants import DAY_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import evidence, grid, maxima, smooth, sphere_cells, spin
from lcbayes.inversion.attitude_scan.evidence import Cells
from lcbayes.inversion.attitude_scan.harmonics import (
    SparsePoints,
    nights_of,
    shape_columns,
)
from lcbayes.inversion.attitude_scan.limits import PERIODS_H, unsuited
from lcbayes.inversion.attitude_scan.periodogram import periodogram, weights
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.result import Table
from lcbayes.inversion.attitude_scan.shape_classes import prior
from lcbayes.inversion.attitude_scan.smooth import SmoothBody
from lcbayes.inversion.attitude_scan.spin import Ends

Floats = NDArray[np.float64]

STEP = 0.25  # between frequencies, in turns over the data
LEVEL = 2  # of the grid of poles: 192
KEPT, KEPT_FREQUENCIES = 512, 2048  # hypotheses of the periodogram whose evidence is computed, and
# frequencies of which the best pole is among them
DRAWN = 256  # of all others
ROUNDS, CLASS_ROUNDS, CLASS_CELLS = 2, 3, 32  # divisions where the posterior is; cells of each
SAME_PERIOD, SAME_TURNS = 1.0, 0.5  # turns over the data: of one period, and of one solution
SAME_POLE = 30.0  # degrees, of one solution
UNIQUE = 0.99  # probability of the only period, or the only pole
LISTED = 1e-3  # smallest probability of a solution that is reported
PER_NIGHT = 8.0  # sparse points
ROWS = 20_000  # of the table of hypotheses
SMALLEST_WEIGHT = 0.05  # of an outlier
ANGLES = 64  # of a turn, for the amplitude
MAG = 2.5 / np.log(10.0)
MOST = 400_000_000  # hypotheses; they are held in memory


@dataclass(frozen=True)
class Spin:
    """A solution: pole (3,), frequency (Hz) and probability; its log-evidence at the best cell.

    ``period_probability`` is that of its period whatever the pole, within one turn over the data of
    one of the solutions that have this period.
    """

    pole: Floats
    frequency: float
    probability: float
    log_evidence: float
    period_probability: float


@dataclass(frozen=True)
class SparseSearch:
    """The posterior over spins.

    Attributes
    ----------
    spins : list of Spin
        Solutions with a probability of at least 0.001, the most probable first.
    frequencies, best, pole : (F,) Hz, (F,), (F, 3)
        The periodogram: frequencies, greatest log-evidence at any pole, and that pole.
    n_ranked : int
        Number of poles times number of frequencies.
    cells : Cells
        Those that hold the posterior, and 256 of all others, drawn by their masses and with as much
        mass together.
    """

    spins: list[Spin]
    frequencies: Floats
    best: Floats
    pole: Floats
    n_ranked: int
    cells: Cells

    @property
    def period_probability(self) -> float:
        """Of the period of the first solution, whatever the pole."""
        return self.spins[0].period_probability


def is_sparse(curve: LightCurve) -> bool:
    """Whether a light curve has a few points in each of many nights over more than 200 days."""
    nights = int(nights_of(np.asarray(curve.t), curve.curve).max()) + 1
    return (
        curve.frame == "ecliptic-j2000"
        and not unsuited(curve)
        and curve.n_obs <= PER_NIGHT * nights
        and curve.n_obs > PER_NIGHT * curve.n_curves
    )


def search(
    points: SparsePoints, period_range_h: tuple[float, float] = PERIODS_H, step: float = STEP
) -> SparseSearch:
    """The posterior over spins with periods in a range, uniform in ln(period) and over the sphere.

    Parameters
    ----------
    points : SparsePoints
    period_range_h : (h, h)
    step : float
        Between frequencies, in turns over the data.

    Raises
    ------
    InputError
        The range is invalid, or too wide.
    """
    low, high = period_range_h
    if not 0 < step <= 0.5:
        raise InputError(f"--period-step is {step:g}; give a number in 0..0.5, such as {STEP}")
    apart = step / points.span
    first, count = grid.frequencies(period_range_h, apart)
    number = sphere_cells.number(LEVEL)
    if count * number > MOST:
        raise InputError(
            f"--period-range {low:g},{high:g} has {count} periods to tell apart in data "
            f"{points.span / DAY_S:.4g} days long; give a narrower range"
        )
    poles = sphere_cells.centres(np.arange(number), LEVEL)
    value = periodogram(points, poles, first, apart, count)
    frequencies = first + apart * np.arange(count)
    cells, others = _cells(points, value, frequencies, apart)
    rest = evidence.total_mass(others)
    found = _solutions(cells, rest, points.span)
    at = np.argmax(value, axis=1)
    best = value.max(axis=1).astype(float)
    every = Cells(*(np.concatenate(x) for x in zip(cells, others, strict=True)))
    return SparseSearch(found, frequencies, best, poles[at], value.size, every)


def table(found: SparseSearch, n_obs: int) -> Table:
    """The periodogram as a table with at most 20,000 rows, each the best of adjacent frequencies.

    χ² is n exp(−2 Δ/n), with the log-evidence Δ relative to the greatest: that of a fit with as
    much evidence, at the noise level of the best.
    """
    size = -(-len(found.best) // ROWS)
    parts = np.array_split(np.arange(len(found.best)), -(-len(found.best) // size))
    rows = np.array([part[np.argmax(found.best[part])] for part in parts])
    f, pole, less = found.frequencies[rows], found.pole[rows], found.best[rows] - found.best.max()
    chi2 = n_obs * np.exp(-2.0 * less / n_obs)
    return Table(pole, f, pole, f, chi2, np.zeros(len(rows), int))


def ends(spins: list[Spin]) -> Ends:
    """Spherical bodies with these spins, as starts of a refinement."""
    poles = np.array([s.pole for s in spins])
    none = np.zeros((len(spins), 0))
    return Ends(
        spin.tilts(poles),
        np.array([s.frequency for s in spins]),
        none,
        np.zeros(len(spins)),
        none,
        np.zeros(len(spins), int),
    )


def without_phase_law(points: Points, few: SparsePoints, body: SmoothBody, best: Spin) -> Points:
    """The points of a scan without the phase law of the best spin, and with its noise.

    The phase law of a sphere with the scan's law of reflection is left in the flux. Outliers have
    larger errors.
    """
    fit = evidence.fits(few, best.pole[None], np.array([best.frequency]))
    n, n_curves = points.flux.shape[0], few.group.shape[1]
    law = np.exp(few.fixed[:n, n_curves:] @ fit.coefficients[0, n_curves : few.fixed.shape[1]])
    none = jnp.zeros(body.harmonics.shape[1])
    still = smooth.Spin(jnp.eye(3), jnp.asarray(best.frequency), none)
    sphere = np.asarray(smooth.brightness(body, points, still).flux)
    flux = np.asarray(points.flux) * sphere / law
    member = np.asarray(points.scale)
    unit = member @ (member.T @ flux / member.sum(axis=0))
    error = np.asarray(points.error) * sphere / law / unit
    if points.error_known:
        level = few.error[:n] * (few.group[:n] @ fit.noise[0])
        error = level * flux / unit
    error = error / np.sqrt(np.maximum(fit.weight[0, :n], SMALLEST_WEIGHT))
    return replace(points, flux=jnp.asarray(flux / unit), error=jnp.asarray(error))


@jax.jit
def _turned(bisector: jax.Array, across: jax.Array, tilt: jax.Array, shape: jax.Array) -> jax.Array:
    """ln of the brightness of a shape, from each direction (T, 3), at angles of a turn."""
    turns = jnp.arange(ANGLES) / ANGLES
    return jax.vmap(lambda turn: shape_columns(bisector, across, tilt, turn) @ shape)(turns)


_columns = jax.jit(shape_columns)


def linear_model(points: SparsePoints, spins: list[Spin]) -> tuple[Floats, Floats]:
    """Amplitude (mag) and rms residual (ln flux) of the linear model at each spin, (S,) and (S,).

    The amplitude is that of a turn seen from the direction of the data where it is largest. The
    weights of the points are those of the periodogram.
    """
    w, used = weights(points), points.used > 0
    known, n_fixed = prior(points.group.shape[1]), points.fixed.shape[1]
    right = known.precision @ known.mean
    amplitude, rms = [], []
    for s in spins:
        tilt = spin.tilts(s.pole[None])[0]
        shape = np.asarray(_columns(points.bisector, points.across, tilt, points.t * s.frequency))
        x = np.concatenate([points.fixed, shape], axis=1)
        matrix = x.T @ (w[:, None] * x) + known.precision
        found = np.linalg.solve(matrix, x.T @ (w * points.log_flux) + right)
        light = np.asarray(_turned(points.bisector, points.across, tilt, found[n_fixed:]))
        amplitude.append(MAG * float(np.ptp(light[:, used], axis=0).max()))
        rms.append(float(np.sqrt(np.mean((points.log_flux - x @ found)[used] ** 2))))
    return np.array(amplitude), np.array(rms)


def _cells(
    points: SparsePoints, value: NDArray[np.float32], frequencies: Floats, apart: float
) -> tuple[Cells, Cells]:
    """Cells that hold the posterior, and some of all others, with the mass of these together."""
    volume = np.log(apart / frequencies)[:, None].astype(np.float32)
    mass = value + volume
    top = _kept(mass)
    kept = len(top)
    at, cell = np.divmod(top, value.shape[1])
    listed = evidence.cells(points, cell, LEVEL, frequencies[at], np.full(kept, apart))
    # the other hypotheses have the evidence of the periodogram, shifted as for the last of these
    last = np.argsort(value[at, cell])[: max(kept // 4, 1)]
    shift = np.median((listed.log_evidence - value[at, cell])[last])
    mass.flat[top] = -np.inf
    at, cell = _drawn(mass)
    others = Cells(
        cell,
        np.full(len(cell), LEVEL),
        frequencies[at],
        np.full(len(cell), apart),
        value[at, cell] + shift,
        np.full(len(cell), -np.inf),
    )
    rest = -np.inf
    if len(cell):  # in a narrow range, all hypotheses are listed
        most = float(mass.max())
        rest = most + float(np.log(np.sum(np.exp(mass - most), dtype=float)))
        rest += float(shift) - np.log(value.shape[1])
        others = others._replace(log_mass=np.full(len(cell), rest - np.log(len(cell))))
    found = evidence.located(points, listed)
    found = maxima.divided_at_maxima(points, found, frequencies, apart, LEVEL)
    found = evidence.refined(points, found, rest, ROUNDS)
    found, weighed = evidence.weighed(points, found, rest)
    found = evidence.refined(points, found, weighed, CLASS_ROUNDS, CLASS_CELLS, evidence.by_class)
    shift = weighed - rest if len(cell) else 0.0
    others = others._replace(
        log_evidence=others.log_evidence + shift,
        log_mass=others.log_mass + shift,
    )
    return found, others


def _kept(mass: NDArray[np.float32]) -> NDArray[np.intp]:
    """Flat indices of the hypotheses with the greatest masses, and of the best pole of each of the
    best frequencies."""
    few = min(KEPT, mass.size)
    top = np.argpartition(mass, mass.size - few, axis=None)[mass.size - few :]
    pole = np.argmax(mass, axis=1)
    best = mass[np.arange(len(mass)), pole]
    few = min(KEPT_FREQUENCIES, len(best))
    at = np.argpartition(best, len(best) - few)[len(best) - few :]
    return np.union1d(top, at * mass.shape[1] + pole[at])


def _drawn(mass: NDArray[np.float32]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of some hypotheses, drawn by their masses; none if all are zero."""
    most = mass.max()
    if not np.isfinite(most):
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    rng = np.random.default_rng(0)
    place = (np.arange(DRAWN) + rng.uniform(size=DRAWN)) / DRAWN
    of_row = np.cumsum(np.exp(mass - most).sum(axis=1, dtype=float))
    rows = np.searchsorted(of_row, place * of_row[-1]).clip(max=len(mass) - 1)
    within = np.cumsum(np.exp(mass[rows] - most), axis=1)
    part = rng.uniform(size=DRAWN) * within[:, -1]
    return rows, np.sum(within < part[:, None], axis=1).clip(max=mass.shape[1] - 1)


def _solutions(cells: Cells, rest: float, span: float) -> list[Spin]:
    """Solutions with their probabilities; those of the most probable period come first."""
    share = np.exp(cells.log_mass - np.logaddexp(evidence.total_mass(cells), rest))
    keep = share > 1e-9
    cells, share = cells.rows(keep), share[keep]
    pole, left, found = cells.pole, np.ones(len(share), bool), []
    for i in np.argsort(-cells.log_evidence, kind="stable"):
        if not left[i]:
            continue
        turns = np.abs(cells.frequency - cells.frequency[i]) * span
        same = left & (turns < SAME_TURNS) & (pole @ pole[i] > np.cos(np.radians(SAME_POLE)))
        left &= ~same
        found.append((i, float(share[same].sum())))
    found.sort(key=lambda x: -x[1])
    found = [(i, p) for k, (i, p) in enumerate(found) if p >= LISTED or k == 0]
    f = np.array([cells.frequency[i] for i, _ in found])
    within = [same_period(cells.frequency, g, span) for g in f]
    of_period = np.array([share[cells_of].sum() for cells_of in within])
    # solutions of one period have its probability, that of the best interval around one of them
    most = [float(of_period[same_period(f, g, span)].max()) for g in f]
    spins = [
        Spin(pole[i], float(cells.frequency[i]), p, float(cells.log_evidence[i]), of_its_period)
        for (i, p), of_its_period in zip(found, most, strict=True)
    ]
    return most_probable_first(spins)


def most_probable_first(spins: list[Spin]) -> list[Spin]:
    """Spins of the most probable period, then all others, each by their probabilities."""
    most = max(s.period_probability for s in spins)
    return sorted(spins, key=lambda s: (s.period_probability < most, -s.probability))


def same_period(frequency: ArrayLike, other: float, span: float) -> NDArray[np.bool_]:
    """Whether frequencies are of one period with another, less than a turn over the data apart."""
    return np.abs(np.asarray(frequency) - other) * span < SAME_PERIOD
