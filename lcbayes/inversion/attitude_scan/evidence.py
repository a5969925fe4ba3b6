"""The evidence of a spin for sparse points, and the posterior over all spins by adaptive cells.

The noise is Student's t with an unknown level for each curve, and an error that the points of a
night share. The coefficients of the linear model of `harmonics` are marginalised by Laplace's
method. Cells of pole and frequency that hold the posterior are divided until their parts add up to
the whole.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.blocks import in_blocks, together
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.threads import single_threaded_blas
from lcbayes.core.time_limit import check_time
from lcbayes.inversion.attitude_scan import sphere_cells
from lcbayes.inversion.attitude_scan.harmonics import (
    SparsePoints,
    shape_columns,
)
from lcbayes.inversion.attitude_scan.periodogram import NIGHT_SD, NU, PRIOR_POINTS
from lcbayes.inversion.attitude_scan.shape_classes import Normal, class_priors, prior
from lcbayes.inversion.attitude_scan.spin import tilts

Floats = NDArray[np.float64]

ROUNDS, CLASS_ROUNDS = 3, 2  # of reweighting, and of the noise level of a class
BATCH = 32, 1024  # spins at once, on a CPU and on an accelerator
PRIOR_NIGHTS = 4.0  # weight of the prior of the error that a night shares, in nights
DIVIDED = 64  # cells divided at once
MASS = 3e-3  # share of the posterior below which a cell is not divided
SETTLED = 0.1  # change of ln(mass) on division, nat, below which a cell's parts are kept
LOCATED = ((128, 1), (64, 2), (32, 3))  # periods whose cells are divided, and cells of each
WEIGHED, WEIGHED_PERIODS, WEIGHED_CELLS = 256, 64, 2  # cells whose classes are weighed
DEEPEST = 7  # level of division of poles (0.5 degrees)


class Fits(NamedTuple):
    """The linear model at B spins.

    log_evidence : (B,), up to a constant
    coefficients : (B, Q), offsets, phase law, shape
    noise : (B, K), in units of the errors
    night : (B,), sd of the error that a night shares
    weight : (B, T), of Student's t; near one, small for outliers
    """

    log_evidence: Any
    coefficients: Any
    noise: Any
    night: Any
    weight: Any


class Sums(NamedTuple):
    """Sums over points at the noise levels found, the errors of nights eliminated.

    matrix, vector, square : (Q, Q), (Q,) and (), of columns and data
    number : of points
    prior_square, prior_number : of the priors of the noise levels
    """

    matrix: Any
    vector: Any
    square: Any
    number: Any
    prior_square: Any
    prior_number: Any


@jax.jit
def _fits(points: SparsePoints, tilt: jax.Array, frequency: jax.Array) -> Fits:
    every = prior(points.group.shape[1])

    def one(tilt: jax.Array, frequency: jax.Array) -> Fits:
        return _fit(points, _all_columns(points, tilt, frequency), every)[0]

    return jax.vmap(one)(tilt, frequency)


@jax.jit
def _fits_moved(
    moved: jax.Array, points: SparsePoints, tilt: jax.Array, frequency: jax.Array, turns: jax.Array
) -> Fits:
    """The same with the body turned further at the points where ``moved`` is one."""
    every = prior(points.group.shape[1])

    def one(tilt: jax.Array, frequency: jax.Array, turns: jax.Array) -> Fits:
        return _fit(points, _all_columns(points, tilt, frequency, moved * turns), every)[0]

    return jax.vmap(one)(tilt, frequency, turns)


@jax.jit
def _by_class(points: SparsePoints, tilt: jax.Array, frequency: jax.Array) -> tuple[Any, Any]:
    n_curves = points.group.shape[1]
    every, classes = prior(n_curves), class_priors(n_curves)

    def one(tilt: jax.Array, frequency: jax.Array) -> tuple[jax.Array, jax.Array]:
        return _classes(*_fit(points, _all_columns(points, tilt, frequency), every), every, classes)

    return jax.vmap(one)(tilt, frequency)


def _all_columns(
    points: SparsePoints, tilt: jax.Array, frequency: jax.Array, further: Any = 0.0
) -> jax.Array:
    turns = points.t * frequency + further
    shape = shape_columns(points.bisector, points.across, tilt, turns)
    return jnp.concatenate([points.fixed, shape], axis=1)


def _fit(points: SparsePoints, x: jax.Array, every: Normal) -> tuple[Fits, Sums]:
    """The linear model with columns ``x`` (T, Q): ln of its evidence, and its coefficients.

    An expectation-maximisation finds the noise levels of curves and the sd of nights, with the
    coefficients and the errors of nights marginalised and Student's t as a mixture of normals,
    under the prior of ``every`` class as one normal density.
    """
    y, night, group, used = points.log_flux, points.night, points.group, points.used
    mean, known, count = every.mean, every.precision, used @ group
    real = jnp.any(night > 0, axis=0)  # columns that only fill the array have no night
    n_nights = jnp.sum(real)
    at, sums_of = points.night_index, points.night_sums
    noise0 = PRIOR_POINTS * points.noise**2

    def solved(heavy: Any, scale: Any, tau: Any) -> tuple[jax.Array, ...]:
        """Coefficients and errors of nights at given levels, and what their variances need."""
        w = used * heavy / (points.error * (group @ scale)) ** 2
        inside = sums_of(w) + tau**-2.0
        means = sums_of(w[:, None] * x) / inside[:, None]
        own = x - means[at]  # the errors of nights are eliminated
        covariance = jnp.linalg.inv(x.T @ (w[:, None] * own) + known)
        found = covariance @ (own.T @ (w * y) + known @ mean)
        residual = y - x @ found
        shared = sums_of(w * residual) / inside
        return found, shared, residual - shared[at], inside, means, own, covariance

    def again(_: Any, state: tuple[Any, ...]) -> tuple[Any, ...]:
        heavy, scale, tau = state
        shared, residual, inside, means, own, covariance = solved(heavy, scale, tau)[1:]
        spread = jnp.sum((own @ covariance) * own, axis=1) + (1.0 / inside)[at]
        squares = (residual**2 + spread) / points.error**2
        level = group.T @ (used * heavy * squares) + noise0
        scale = jnp.sqrt(level / (count + PRIOR_POINTS))
        of_night = shared**2 + 1.0 / inside + jnp.sum((means @ covariance) * means, axis=1)
        total = jnp.sum(jnp.where(real, of_night, 0.0)) + PRIOR_NIGHTS * NIGHT_SD**2
        tau = jnp.sqrt(total / (n_nights + PRIOR_NIGHTS))
        return (NU + 1.0) / (NU + squares / (group @ scale) ** 2), scale, tau

    start = jnp.ones_like(y), jnp.full(count.shape, 1.5 * points.noise), jnp.asarray(NIGHT_SD)
    heavy, scale, tau = jax.lax.fori_loop(0, ROUNDS, again, start)
    found, shared, residual, inside, _, own, covariance = solved(heavy, scale, tau)
    sigma = points.error * (group @ scale)
    value = -jnp.sum(
        used * (0.5 * (NU + 1.0) * jnp.log1p((residual / sigma) ** 2 / NU) + jnp.log(sigma))
    )
    value -= jnp.sum(PRIOR_POINTS * jnp.log(scale) + 0.5 * noise0 / scale**2)
    value -= PRIOR_NIGHTS * (jnp.log(tau) + 0.5 * (NIGHT_SD / tau) ** 2)
    value -= 0.5 * jnp.sum(shared**2) / tau**2
    value -= 0.5 * jnp.sum(jnp.where(real, jnp.log(inside * tau**2), 0.0))
    value -= 0.5 * (found - mean) @ known @ (found - mean) - 0.5 * every.log_det
    value += 0.5 * jnp.linalg.slogdet(covariance)[1]
    w = used * heavy / sigma**2
    less = y - (sums_of(w * y) / inside)[at]
    sums = Sums(
        x.T @ (w[:, None] * own),
        own.T @ (w * y),
        jnp.sum(w * y * less),
        jnp.sum(used),
        jnp.sum(noise0 / scale**2) + PRIOR_NIGHTS * (NIGHT_SD / tau) ** 2,
        PRIOR_POINTS * len(scale) + PRIOR_NIGHTS,
    )
    return Fits(value, found, scale, tau, heavy), sums


def _log_normal(sums: Sums, of: Normal, factor: jax.Array) -> tuple[jax.Array, ...]:
    """ln of the normal density of the data with all levels ``factor`` times those found, up to a
    constant, and the mean and covariance of the coefficients."""
    root = jnp.linalg.cholesky(sums.matrix / factor**2 + of.precision)
    right = sums.vector / factor**2 + of.precision @ of.mean
    mean = jax.scipy.linalg.cho_solve((root, True), right)
    misfit = sums.square / factor**2 + of.mean @ of.precision @ of.mean - right @ mean
    value = 0.5 * (of.log_det - misfit) - jnp.sum(jnp.log(jnp.diag(root)))
    levels = 0.5 * sums.prior_square * (factor**-2.0 - 1.0)
    value -= (sums.number + sums.prior_number) * jnp.log(factor) + levels
    return value, mean, root


def _of_class(sums: Sums, of: Normal) -> tuple[jax.Array, jax.Array]:
    """ln of the evidence of a class, and the factor of its noise levels, which maximises it."""
    factor = jnp.asarray(1.0)
    for _ in range(CLASS_ROUNDS):
        _, mean, root = _log_normal(sums, of, factor)
        covariance = jax.scipy.linalg.cho_solve((root, True), sums.matrix)
        squares = sums.square + mean @ sums.matrix @ mean - 2.0 * mean @ sums.vector
        total = squares + jnp.trace(covariance) + sums.prior_square
        factor = jnp.sqrt(total / (sums.number + sums.prior_number))
    return _log_normal(sums, of, factor)[0], factor


def _classes(fit: Fits, sums: Sums, every: Normal, classes: Normal) -> tuple[jax.Array, jax.Array]:
    """ln of the evidence of each class (C,), and the factor of its noise levels (C,).

    The difference between Student's t and a normal density is that of the fit.
    """
    value, factor = jax.vmap(lambda one: _of_class(sums, one))(classes)
    alone = _log_normal(sums, every, jnp.asarray(1.0))[0]
    return fit.log_evidence + value - alone, factor


def fits(points: SparsePoints, poles: Floats, frequencies: Floats) -> Fits:
    """The linear model at spins with poles (B, 3) and frequencies (B,)."""
    return in_batches(_fits, points, BATCH, tilts(poles), frequencies)


def all_shapes(points: SparsePoints, poles: Floats, frequencies: Floats) -> Floats:
    """ln of the evidence under the prior of all classes as one normal density, (B,)."""
    return fits(points, poles, frequencies).log_evidence


def all_shapes_moved(
    points: SparsePoints, poles: Floats, frequencies: Floats, moved: Floats, turns: Floats
) -> Floats:
    """The same with the body further by ``turns`` (B,) at the points (T,) where ``moved`` is one,
    as if these had been observed later."""
    function = partial(_fits_moved, moved)
    spins = tilts(poles), frequencies, turns
    return in_batches(function, points, BATCH, *spins).log_evidence


def by_class(points: SparsePoints, poles: Floats, frequencies: Floats) -> Floats:
    """ln of the evidence under the prior of each class, whose mean it is, (B,)."""
    value, _ = class_evidence(points, poles, frequencies)
    return np.logaddexp.reduce(value, axis=1) - np.log(value.shape[1])


def class_evidence(
    points: SparsePoints, poles: Floats, frequencies: Floats
) -> tuple[Floats, Floats]:
    """ln of the evidence of each class of shapes at spins, (B, C), and factors of the noise."""
    return in_batches(_by_class, points, BATCH, tilts(poles), frequencies)


def in_batches(function: Any, points: SparsePoints, batch: tuple[int, int], *spins: Any) -> Any:
    """A compiled function of the points and of spins, pytrees of B rows, a batch of them at once.

    ``batch`` has their numbers on a CPU and on an accelerator.
    """
    on_device = jax.tree.map(jnp.asarray, points)

    def some(*rows: Any) -> Any:
        check_time()
        return function(on_device, *jax.tree.map(jnp.asarray, rows))

    with single_threaded_blas:  # the matrices have some forty rows
        return in_blocks(some, together(*batch), *spins)


class Cells(NamedTuple):
    """Cells of pole and frequency, and the posterior mass of each up to a common factor.

    cell, level : (B,), of `sphere_cells`
    frequency, width : (B,) Hz
    log_evidence, log_mass : (B,)
    """

    cell: Any
    level: Any
    frequency: Any
    width: Any
    log_evidence: Any
    log_mass: Any

    @property
    def pole(self) -> Floats:
        """Centres of the cells of the sphere, (B, 3)."""
        return sphere_cells.centres(self.cell, self.level)

    def rows(self, which: Any) -> Cells:
        """The selected cells."""
        return Cells(*(x[which] for x in self))


def cells(
    points: SparsePoints, cell: Any, level: Any, frequency: Floats, width: Floats, how: Any = None
) -> Cells:
    """Cells with their masses: evidence × prior, uniform over poles and over ln(period).

    ``how`` is `by_class`, or by default `all_shapes`.
    """
    level = np.broadcast_to(level, np.shape(cell)).copy()
    value = (how or all_shapes)(points, sphere_cells.centres(cell, level), frequency)
    found = Cells(np.asarray(cell), level, frequency, width, value, value)
    return found._replace(log_mass=mass(found))


def mass(of: Cells) -> Floats:
    """ln of evidence × prior of each cell."""
    volume = np.log(of.width / of.frequency)
    volume -= np.log(sphere_cells.number(1) * 4.0 ** (of.level - 1.0))
    return of.log_evidence + volume


def total_mass(of: Cells) -> float:
    """ln of the sum of the masses."""
    return float(np.logaddexp.reduce(of.log_mass))


def divided(points: SparsePoints, whole: Cells, how: Any = None) -> Cells:
    """Each cell divided into four poles and two frequencies, in the order of the cells."""
    cell = (4 * whole.cell[:, None] + np.arange(4)).repeat(2, axis=1).ravel()
    side = np.tile([-0.25, 0.25], 4) * whole.width[:, None]
    frequency = (whole.frequency[:, None] + side).ravel()
    level, width = (whole.level + 1).repeat(8), 0.5 * whole.width.repeat(8)
    return cells(points, cell, level, frequency, width, how)


def located(points: SparsePoints, listed: Cells) -> Cells:
    """Cells divided near the best poles of the best periods, whatever their masses.

    A cell is wide compared with a strong maximum of the evidence, so the value at its centre may
    rank it far below others. Each round divides more cells of fewer periods.
    """
    for periods, number in LOCATED:
        chosen = np.concatenate(best_of_periods(listed, points.span, periods, number))
        kept = np.ones(len(listed.cell), bool)
        kept[chosen] = False
        parts = divided(points, listed.rows(chosen))
        listed = joined(listed.rows(kept), parts)
    return listed


def reaching(points: SparsePoints, listed: Cells, targets: Cells) -> Cells:
    """Cells divided as far as each of some targets, wherever they hold one."""
    for _ in range(int(targets.level.max()) - int(listed.level.min())):
        less = targets.level[:, None] - listed.level
        within = targets.cell[:, None] // 4 ** np.maximum(less, 0) == listed.cell
        off = np.abs(targets.frequency[:, None] - listed.frequency)
        holds = (less > 0) & within & (off <= 0.5 * listed.width * (1.0 + 1e-6))
        chosen = holds.any(axis=0)
        if not chosen.any():
            break
        listed = joined(listed.rows(~chosen), divided(points, listed.rows(chosen)))
    return listed


def best_of_periods(of: Cells, span: float, periods: int, number: int) -> list[NDArray[np.integer]]:
    """Rows of the best cells, at most ``number``, of each of the best periods."""
    order = np.argsort(-of.log_evidence, kind="stable")
    period = np.floor(of.frequency[order] * span)
    _, first = np.unique(period, return_index=True)
    return [order[period == k][:number] for k in period[np.sort(first)[:periods]]]


def joined(*parts: Cells) -> Cells:
    """All cells together."""
    return Cells(*(np.concatenate(x) for x in zip(*parts, strict=True)))


def refined(
    points: SparsePoints,
    first: Cells,
    rest: float,
    rounds: int,
    most: int = DIVIDED,
    how: Any = None,
) -> Cells:
    """Cells divided wherever the posterior is, until their masses settle.

    Parameters
    ----------
    points : SparsePoints
    first : Cells
    rest : float
        ln(mass) of everything outside these cells.
    rounds : int
        Limit on the number of divisions.
    most : int
        Cells divided at once.
    how : as for `cells`
    """
    done, still = first, np.ones(len(first.cell), bool)
    for _ in range(rounds):
        total = np.logaddexp(total_mass(done), rest)
        worth = still & (done.log_mass > total + np.log(MASS)) & (done.level < DEEPEST)
        chosen = np.flatnonzero(worth)
        if not len(chosen):
            break
        chosen = chosen[np.argsort(-done.log_mass[chosen], kind="stable")[:most]]
        parts = divided(points, done.rows(chosen), how)
        mass = np.logaddexp.reduce(parts.log_mass.reshape(-1, 8), axis=1)
        # the parts of a part that is as it was expected to be are not divided again
        settled = np.abs(mass - done.log_mass[chosen]) < SETTLED
        kept = np.ones(len(done.cell), bool)
        kept[chosen] = False
        done = joined(done.rows(kept), parts)
        still = np.concatenate([still[kept], np.repeat(~settled, 8)])
    return done


def weighed(points: SparsePoints, found: Cells, rest: float) -> tuple[Cells, float]:
    """Cells, and the mass of everything else, with the evidence over the classes of shapes.

    It is computed for the cells with the greatest masses and for the best of each of the best
    periods, and the others are shifted as the median of those.
    """
    best = np.concatenate(best_of_periods(found, points.span, WEIGHED_PERIODS, WEIGHED_CELLS))
    most = np.argsort(-found.log_mass, kind="stable")[:WEIGHED]
    chosen = np.union1d(most, best)
    value = by_class(points, found.pole[chosen], found.frequency[chosen])
    shift = float(np.median(value - found.log_evidence[chosen]))
    log_evidence = found.log_evidence + shift
    log_evidence[chosen] = value
    found = found._replace(log_evidence=log_evidence)
    return found._replace(log_mass=mass(found)), rest + shift
