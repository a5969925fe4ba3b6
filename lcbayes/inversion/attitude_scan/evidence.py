"""The evidence of a spin for sparse points, and the posterior over all spins by adaptive cells.

The noise is Student's t with an unknown level for each curve, and an error that the points of a
night share. The coefficients of the linear model of `harmonics` are marginalised by Laplace's
method. Cells of pole and frequency that hold the posterior are divided until their parts add up to
the whole.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
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
BATCH = 512  # spins at once
INFORMATION = 0.5  # power of the evidence: errors of the model are common to many points
PRIOR_NIGHTS = 4.0  # weight of the prior of the error that a night shares, in nights
DIVIDED = 64  # cells divided at once
MASS = 3e-3  # share of the posterior below which a cell is not divided
SETTLED = 0.1  # change of ln(mass) on division, nat, below which a cell's parts are kept
LOCATED, LOCATED_PERIODS, LOCATED_CELLS = 3, 32, 3  # rounds; periods, and cells of each
DEEPEST = 7  # level of division of poles (0.5 degrees)


class Fits(NamedTuple):
    """The linear model at B spins.

    log_evidence : (B,), up to a constant
    coefficients : (B, Q), offsets, phase law, shape
    noise : (B, K), in units of the errors
    night : (B,), sd of the error that a night shares
    weight : (B, T), of Student's t; near one, small for outliers
    of_class : (B, C), ln of the evidence of each class of shapes
    factor : (B, C), of the noise levels and of the sd of nights for that class
    """

    log_evidence: Any
    coefficients: Any
    noise: Any
    night: Any
    weight: Any
    of_class: Any
    factor: Any


@jax.jit
def _fits(points: SparsePoints, tilt: jax.Array, frequency: jax.Array) -> Fits:
    n_curves = points.group.shape[1]
    every, classes = prior(n_curves), class_priors(n_curves)

    def one(tilt: jax.Array, frequency: jax.Array) -> Fits:
        shape = shape_columns(points.bisector, tilt, points.t * frequency)
        x = jnp.concatenate([points.fixed, shape], axis=1)
        return _fit(points, x, every, classes)

    return jax.vmap(one)(tilt, frequency)


def _fit(points: SparsePoints, x: jax.Array, every: Normal, classes: Normal) -> Fits:
    """The linear model with columns ``x`` (T, Q): ln of its evidence, and its coefficients.

    An expectation-maximisation finds the noise levels of curves and the sd of nights, with the
    coefficients and the errors of nights marginalised and Student's t as a mixture of normals,
    under the prior of ``every`` class as one normal density. The evidence is the mean of those of
    the classes, `_of_class`.
    """
    y, night, group, used = points.log_flux, points.night, points.group, points.used
    mean, known, count = every.mean, every.precision, used @ group
    real = jnp.any(night > 0, axis=0)  # columns that only fill the array have no night
    n_nights = jnp.sum(real)
    noise0 = PRIOR_POINTS * points.noise**2

    def solved(heavy: Any, scale: Any, tau: Any) -> tuple[jax.Array, ...]:
        """Coefficients and errors of nights at given levels, and what their variances need."""
        w = used * heavy / (points.error * (group @ scale)) ** 2
        inside = w @ night + tau**-2.0
        means = (night.T @ (w[:, None] * x)) / inside[:, None]
        own = x - night @ means  # the errors of nights are eliminated
        covariance = jnp.linalg.inv(x.T @ (w[:, None] * own) + known)
        found = covariance @ (own.T @ (w * y) + known @ mean)
        shared = (night.T @ (w * (y - x @ found))) / inside
        return found, shared, y - x @ found - night @ shared, inside, means, own, covariance

    def again(_: Any, state: tuple[Any, ...]) -> tuple[Any, ...]:
        heavy, scale, tau = state
        shared, residual, inside, means, own, covariance = solved(heavy, scale, tau)[1:]
        spread = jnp.sum((own @ covariance) * own, axis=1) + night @ (1.0 / inside)
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
    less = y - night @ ((night.T @ (w * y)) / inside)
    sums = Sums(
        x.T @ (w[:, None] * own),
        own.T @ (w * y),
        jnp.sum(w * y * less),
        jnp.sum(used),
        jnp.sum(noise0 / scale**2) + PRIOR_NIGHTS * (NIGHT_SD / tau) ** 2,
        2.0 * PRIOR_POINTS * len(scale) + PRIOR_NIGHTS,
    )
    of_class, level = jax.vmap(lambda one: _of_class(sums, one))(classes)
    alone = _log_normal(sums, every, jnp.asarray(1.0))[0]
    of_class += value - alone
    mixed = jax.scipy.special.logsumexp(of_class) - jnp.log(len(of_class))
    return Fits(mixed, found, scale, tau, heavy, of_class, level)


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


def fits(points: SparsePoints, poles: Floats, frequencies: Floats) -> Fits:
    """The linear model at spins with poles (B, 3) and frequencies (B,)."""
    parts = []
    on_device = jax.tree.map(jnp.asarray, points)
    for i in range(0, len(poles), BATCH):
        check_time()
        rows = np.resize(np.arange(i, min(i + BATCH, len(poles))), BATCH)
        part = _fits(on_device, jnp.asarray(tilts(poles[rows])), jnp.asarray(frequencies[rows]))
        parts.append([np.asarray(x)[: len(poles) - i] for x in part])
    return Fits(*(np.concatenate(x) for x in zip(*parts, strict=True)))


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


def cells(points: SparsePoints, cell: Any, level: Any, frequency: Floats, width: Floats) -> Cells:
    """Cells with their masses: evidence^½ × prior, uniform over poles and over ln(period)."""
    level = np.broadcast_to(level, np.shape(cell)).copy()
    value = fits(points, sphere_cells.centres(cell, level), frequency).log_evidence
    found = Cells(np.asarray(cell), level, frequency, width, value, value)
    return found._replace(log_mass=mass(found))


def mass(of: Cells) -> Floats:
    """ln of evidence^½ × prior of each cell."""
    volume = np.log(of.width / of.frequency)
    volume -= np.log(sphere_cells.number(1) * 4.0 ** (of.level - 1.0))
    return INFORMATION * of.log_evidence + volume


def total_mass(of: Cells) -> float:
    """ln of the sum of the masses."""
    return float(np.logaddexp.reduce(of.log_mass))


def divided(points: SparsePoints, whole: Cells) -> Cells:
    """Each cell divided into four poles and two frequencies, in the order of the cells."""
    cell = (4 * whole.cell[:, None] + np.arange(4)).repeat(2, axis=1).ravel()
    side = np.tile([-0.25, 0.25], 4) * whole.width[:, None]
    frequency = (whole.frequency[:, None] + side).ravel()
    return cells(points, cell, (whole.level + 1).repeat(8), frequency, 0.5 * whole.width.repeat(8))


def located(points: SparsePoints, listed: Cells) -> Cells:
    """Cells divided near the best pole of each of the best periods, whatever their masses.

    A cell is wide compared with a strong maximum of the evidence, so the value at its centre may
    rank it far below others. Each round divides the best cells of the best periods.
    """
    span = points.span
    deepest = int(listed.level.max()) + LOCATED
    for _ in range(LOCATED):
        order = np.argsort(-listed.log_evidence, kind="stable")
        period = np.floor(listed.frequency[order] * span)
        _, first = np.unique(period, return_index=True)
        best = period[np.sort(first)[:LOCATED_PERIODS]]
        chosen = [order[period == k][:LOCATED_CELLS] for k in best]
        chosen = np.concatenate(chosen)
        chosen = chosen[listed.level[chosen] < deepest]
        if not len(chosen):
            break
        kept = np.ones(len(listed.cell), bool)
        kept[chosen] = False
        parts = divided(points, listed.rows(chosen))
        listed = Cells(*(np.concatenate([a[kept], b]) for a, b in zip(listed, parts, strict=True)))
    return listed


def refined(points: SparsePoints, first: Cells, rest: float, rounds: int = 5) -> Cells:
    """Cells divided wherever the posterior is, until their masses settle.

    Parameters
    ----------
    points : SparsePoints
    first : Cells
    rest : float
        ln(mass) of everything outside these cells.
    rounds : int
        Limit on the number of divisions.
    """
    done, still = first, np.ones(len(first.cell), bool)
    for _ in range(rounds):
        total = np.logaddexp(total_mass(done), rest)
        worth = still & (done.log_mass > total + np.log(MASS)) & (done.level < DEEPEST)
        chosen = np.flatnonzero(worth)
        if not len(chosen):
            break
        chosen = chosen[np.argsort(-done.log_mass[chosen], kind="stable")[:DIVIDED]]
        parts = divided(points, done.rows(chosen))
        mass = np.logaddexp.reduce(parts.log_mass.reshape(-1, 8), axis=1)
        # the parts of a part that is as it was expected to be are not divided again
        settled = np.abs(mass - done.log_mass[chosen]) < SETTLED
        kept = np.ones(len(done.cell), bool)
        kept[chosen] = False
        done = Cells(*(np.concatenate([a[kept], b]) for a, b in zip(done, parts, strict=True)))
        still = np.concatenate([still[kept], np.repeat(~settled, 8)])
    return done
