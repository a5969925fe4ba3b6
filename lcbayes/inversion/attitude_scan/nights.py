"""How far further nights would settle the period of an object with sparse points.

Spins drawn from the posterior predict the points of each night. Nights are simulated from some of
the spins, and the others are weighed by what they predicted, as a scan of all points would.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan import evidence, sparse
from lcbayes.inversion.attitude_scan.evidence import Cells, Fits
from lcbayes.inversion.attitude_scan.harmonics import (
    ERROR_FLOOR,
    OFFSET,
    SparsePoints,
    nights_of,
    phase_columns,
    shape_columns,
)
from lcbayes.inversion.attitude_scan.shape_classes import prior
from lcbayes.inversion.attitude_scan.spin import tilts

Floats = NDArray[np.float64]

HYPOTHESES, TRUTHS, REPEATS = 512, 96, 2  # spins that are weighed; true ones, and nights of each
MOST_RATIO = 1.0  # nats by which a spin may count more or less than its cell
BESIDE = 3  # spins that are weighed beside a true one which is too rare to be among the others
MOST_NIGHTS, MOST_POINTS = 400, 100  # a night with more points is thinned
TOGETHER = 5  # nights chosen one after the other
ENOUGH = 0.98  # probability at which no further night is added


class Draws(NamedTuple):
    """Spins with their shares, and the posterior of the coefficients at each.

    pole : (B, 3)
    frequency : (B,) Hz
    share : (B,)
    mean, covariance : (B, P) and (B, P, P), of the phase law and the shape
    night : (B,), sd of the error that a night shares
    """

    pole: Floats
    frequency: Floats
    share: Floats
    mean: Floats
    covariance: Floats
    night: Floats


@dataclass(frozen=True)
class Further:
    """Points that could be observed: their epochs and directions, and the error of one, mag."""

    geometry: LightCurve
    error_mag: float


@dataclass(frozen=True)
class Night:
    """Points that could be observed, at most `MOST_POINTS` of them.

    t : (T,) s, since the middle of the data
    bisector, across, phase : (T, 3), (T, 3) and (T, 2), as of `SparsePoints`
    start : float, of the file, s
    n_points, hours : of all points
    weight : share of the points that are kept
    """

    t: Floats
    bisector: Floats
    across: Floats
    phase: Floats
    start: float
    n_points: int
    hours: float
    weight: float


def outlook(
    points: SparsePoints,
    found: sparse.SparseSearch,
    curve: LightCurve,
    further: Further,
    seed: int = 0,
) -> dict[str, Any]:
    """Expected probability of the true period after each night, and after several.

    Each night has a zero point of its own, and errors
    of a night and of the model as in a scan. Nights are taken as independent given the spin.

    Parameters
    ----------
    points, found, curve
        The data, their search, and the light curve.
    further : Further
    seed : int

    Returns
    -------
    dict
        ``now``, the expected probability without further nights; ``nights``, a row for each;
        ``together``, the best first night, the best night beside it, and so on, with the
        probability after each.

    Raises
    ------
    InputError
        There are too many nights, or their times or axes are not those of the light curve.
    """
    nights = _nights(curve, further.geometry)
    rng = np.random.default_rng(seed)
    weighed, true = sampled(points, found, rng)
    same = np.abs(true.frequency[:, None] - weighed.frequency) * points.span < sparse.SAME_PERIOD
    likelihoods = np.array(
        [_gain(night, weighed, true, further.error_mag, rng) for night in nights]
    )

    def after(gain: Floats) -> float:
        """Mean probability of the true period, ln-likelihoods (A, R, B) given."""
        mass = np.log(weighed.share) + gain
        mass = np.exp(mass - mass.max(axis=-1, keepdims=True))
        right = np.sum(mass * same[:, None], axis=-1) / np.sum(mass, axis=-1)
        return float(true.share @ right.mean(axis=1))

    none = np.zeros((len(true.share), REPEATS, len(weighed.share)))
    now = after(none)
    alone = [after(gain) for gain in likelihoods]
    together: list[dict[str, Any]] = []
    chosen: list[int] = []
    total = none
    while len(chosen) < min(TOGETHER, len(nights)):
        left = [i for i in range(len(nights)) if i not in chosen]
        reached = [after(total + likelihoods[i]) for i in left]
        k = int(np.argmax(reached))
        chosen.append(left[k])
        total = total + likelihoods[left[k]]
        together.append({"night": left[k] + 1, "probability": reached[k]})
        if reached[k] > ENOUGH:
            break
    epoch = further.geometry.epoch_jd
    return {
        "now": now,
        "error_mag": further.error_mag,
        "nights": [
            {
                "night": i + 1,
                **({"t_s": n.start} if epoch is None else {"jd": epoch + n.start / DAY_S}),
                "n_points": n.n_points,
                "hours": n.hours,
                "probability": p,
            }
            for i, (n, p) in enumerate(zip(nights, alone, strict=True))
        ],
        "together": together,
    }


def sampled(
    points: SparsePoints, found: sparse.SparseSearch, rng: np.random.Generator
) -> tuple[Draws, Draws]:
    """Spins of the posterior to be weighed, and others that are true in turn.

    A true spin in a cell that is too small to be among the others has neighbours of its own cell
    beside it, with the mass of that cell.
    """
    cells = found.cells
    share = np.exp(cells.log_mass - evidence.total_mass(cells))
    rows, true_rows = _evenly(share, HYPOTHESES, rng), _evenly(share, TRUTHS, rng)
    own = np.exp(evidence.mass(cells) - evidence.total_mass(cells))
    rare = np.repeat(np.unique(true_rows[share[true_rows] < 1.0 / HYPOTHESES]), BESIDE)
    every = np.concatenate([rows, rare])
    size = np.concatenate([np.full(len(rows), 1.0 / len(rows)), own[rare] / BESIDE])
    weighed = _draws(points, cells.rows(every), size, rng)
    return weighed, _draws(points, cells.rows(true_rows), np.ones(len(true_rows)), rng)


def _evenly(share: Floats, number: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Rows drawn by their shares, at even steps of the sum of these."""
    place = (np.arange(number) + rng.uniform()) / number
    return np.searchsorted(np.cumsum(share), place).clip(max=len(share) - 1)


def _draws(points: SparsePoints, cells: Cells, size: Floats, rng: np.random.Generator) -> Draws:
    """A spin anywhere in each cell; its share is the cell's times the ratio of evidences.

    The ratio is limited, as a cell that was not divided may have a sharp maximum, and one spin on
    it would then have most of the mass of all.
    """
    number = len(size)
    frequency = cells.frequency + (rng.uniform(size=number) - 0.5) * cells.width
    pole = _within(cells, rng)
    fit = evidence.fits(points, pole, frequency)
    ratio = fit.log_evidence - cells.log_evidence
    share = size * np.exp(np.clip(ratio, -MOST_RATIO, MOST_RATIO))
    mean, covariance = _coefficients(points, fit, pole, frequency)
    return Draws(pole, frequency, share / share.sum(), mean, covariance, np.asarray(fit.night))


def _within(cells: Cells, rng: np.random.Generator) -> Floats:
    """A direction in each cell: the centre of one of its smallest parts."""
    deeper = evidence.DEEPEST + 2
    below = 4 ** (deeper - cells.level)
    part = cells.cell * below + (rng.uniform(size=len(below)) * below).astype(int)
    return cells._replace(cell=part, level=np.full(len(part), deeper)).pole


def _coefficients(
    points: SparsePoints, fit: Fits, poles: Floats, frequencies: Floats
) -> tuple[Floats, Floats]:
    """Posterior means and covariances of the phase law and the shape at each spin."""
    n_curves = points.group.shape[1]
    known = prior(n_curves).precision
    covariances = []
    shapes = _columns(points, poles, frequencies)
    for b, shape in enumerate(shapes):
        x = np.concatenate([points.fixed, shape], axis=1)
        level = points.error * (points.group @ fit.noise[b])
        w = points.used * fit.weight[b] / level**2
        inside = w @ points.night + fit.night[b] ** -2.0
        shared = points.night.T @ (w[:, None] * x)
        matrix = x.T @ (w[:, None] * x) - shared.T @ (shared / inside[:, None])
        covariances.append(np.linalg.inv(matrix + known)[n_curves:, n_curves:])
    return np.asarray(fit.coefficients)[:, n_curves:], np.array(covariances)


_each = jax.jit(jax.vmap(shape_columns, in_axes=(None, None, 0, 0)))


def _columns(of: Any, poles: Floats, frequencies: Floats) -> Floats:
    """Columns (B, T, 31) of the shape at each spin, for points with times and directions."""
    turns = frequencies[:, None] * of.t
    given = of.bisector, of.across, tilts(poles), turns
    return np.asarray(_each(*map(jnp.asarray, given)))


def _gain(
    night: Night, weighed: Draws, true: Draws, error_mag: float, rng: np.random.Generator
) -> Floats:
    """ln-likelihoods (A, R, B) of each weighed spin for nights drawn from each true one."""
    variance = night.weight * (error_mag / sparse.MAG) ** 2 + ERROR_FLOOR**2
    mean, factor = predicted(night, weighed, variance)
    centre, spread = predicted(night, true, variance)
    noise = rng.standard_normal((len(centre), REPEATS, len(night.t)))
    drawn = centre[:, None] + np.einsum("aij,arj->ari", spread, noise)
    flat = drawn.reshape(-1, len(night.t))
    out = np.empty((len(flat), len(mean)))
    for b in range(len(mean)):
        white = solve_triangular(factor[b], (flat - mean[b]).T, lower=True)
        size = np.log(np.diagonal(factor[b])).sum()
        out[:, b] = -0.5 * np.sum(white**2, axis=0) - size
    return out.reshape(*drawn.shape[:2], -1)


def predicted(night: Night, spins: Draws, variance: float) -> tuple[Floats, Floats]:
    """Mean (B, T) of ln f at each spin, and the Cholesky factor (B, T, T) of its covariance."""
    n = len(night.t)
    filled = replace(
        night,
        t=np.resize(night.t, MOST_POINTS),
        bisector=np.resize(night.bisector, (MOST_POINTS, 3)),
        across=np.resize(night.across, (MOST_POINTS, 3)),
    )
    shape = _columns(filled, spins.pole, spins.frequency)[:, :n]
    x = np.concatenate([np.broadcast_to(night.phase, (len(shape), n, 2)), shape], axis=2)
    common = OFFSET[1] ** 2 + spins.night[:, None, None] ** 2
    covariance = x @ spins.covariance @ x.transpose(0, 2, 1) + common + variance * np.eye(n)
    return np.einsum("bij,bj->bi", x, spins.mean), np.linalg.cholesky(covariance)


def _nights(curve: LightCurve, geometry: LightCurve) -> list[Night]:
    """The nights of a file of geometry, on the clock of the light curve's middle."""
    if geometry.frame != curve.frame:
        raise InputError(
            f"the nights are in {geometry.frame} and the light curve in {curve.frame}; give both "
            "in the same axes"
        )
    if (geometry.epoch_jd is None) != (curve.epoch_jd is None):
        raise InputError("the nights and the light curve need times of the same kind: both in JD")
    between = 0.0
    if geometry.epoch_jd is not None and curve.epoch_jd is not None:
        between = DAY_S * (geometry.epoch_jd - curve.epoch_jd)
    middle = 0.5 * float(curve.t.min() + curve.t.max())
    t = geometry.t + between - middle
    number = nights_of(t, geometry.curve)
    if number.max() >= MOST_NIGHTS:
        raise InputError(f"the file has {number.max() + 1} nights; give at most {MOST_NIGHTS}")
    bisector = geometry.sun + geometry.obs
    bisector = bisector / np.linalg.norm(bisector, axis=1, keepdims=True)
    across = geometry.sun - geometry.obs
    phase = phase_columns(np.asarray(geometry.phase_angle))
    found = []
    for k in range(number.max() + 1):
        rows = np.flatnonzero(number == k)
        rows = rows[np.argsort(t[rows], kind="stable")]
        few = rows[np.unique(np.linspace(0, len(rows) - 1, MOST_POINTS).round().astype(int))]
        found.append(
            Night(
                t[few],
                bisector[few],
                across[few],
                phase[few],
                float(geometry.t[rows[0]]),
                len(rows),
                round(float(np.ptp(t[rows])) / HOUR_S, 4),
                len(few) / len(rows),
            )
        )
    return sorted(found, key=lambda n: n.t[0])


def words(found: Mapping[str, Any]) -> list[str]:
    """What further nights would bring, in sentences."""
    said = [f"Expected probability of the true period: {found['now']:.2f} now."]
    where = {row["night"]: row for row in found["nights"]}
    for k, row in enumerate(found["together"], start=1):
        night = where[row["night"]]
        when = f"JD {night['jd']:.2f}" if "jd" in night else f"t = {night['t_s'] / DAY_S:.2f} d"
        what = f"{night['n_points']} points in {night['hours']:.1f} h from {when}"
        how = "with" if k == 1 else "adding"
        said.append(f"{k} night{'s' * (k > 1)}: {row['probability']:.2f}, {how} {what}.")
    return said
