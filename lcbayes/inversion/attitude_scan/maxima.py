"""Maxima of the evidence over pole and frequency, and cells divided as far as these.

A maximum is often much narrower than a cell of the periodogram. The evidence at the centre of the
cell may then be below that of a cell elsewhere by tens of nats, and the right pole would never be
looked at closely. So poles all around the sphere, and frequencies within half a turn over the data,
are tried near each of the best periods. The best of these are moved uphill to the next maximum by
damped Gauss-Newton steps, at the noise of the period's best spin. Where this leads to half or twice
a period, its own half and double are tried in turn. A true period may be reached in no other way:
if an alias is found first, and lies further off than the frequencies that are tried near it, twice
the alias may still lead to twice the true period, whose half is the true one.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.levenberg_marquardt import Controls, Quadratic, levenberg_marquardt
from lcbayes.inversion.attitude_scan import evidence, sphere_cells
from lcbayes.inversion.attitude_scan.evidence import Cells
from lcbayes.inversion.attitude_scan.harmonics import SparsePoints, shape_columns
from lcbayes.inversion.attitude_scan.shape_classes import Normal, prior
from lcbayes.inversion.attitude_scan.spin import tilts
from lcbayes.physics.attitude import rotations

Floats = NDArray[np.float64]

ROUNDS = ((16, 4), (2, 2), (2, 2))  # best periods that are tried, and of these also half and double
POLES = 1  # level of the grid of poles that are tried: 48
OFFSETS = np.arange(-4, 5) / 8.0  # turns over the data, of the frequencies that are tried
STEPS, TOLERANCE = 8, 0.1  # steps uphill; nat, of the last
CONTROLS = Controls(decrease=None, increase=2.0, patience=1)
TARGET_LEVEL = 5  # of division of poles (1.8 degrees) where a maximum is
AROUND = 3.0  # degrees from a maximum, to cells that are divided too
SAME_POLE, SAME_TURNS = 4.0, 0.25  # degrees, and turns over the data, of one maximum
NATS, MOST = 40.0, 64  # below the best (classes of shapes change less), and number of maxima kept
BATCH = 64, 1024  # spins at once, on a CPU and on an accelerator


class Noise(NamedTuple):
    """Noise of the points that is held fixed: of B spins, or of one.

    weight : (B, T), 1/σ² times Student's weight
    inside : (B, M), their sum over each night and 1/σ² of the error that the night shares
    """

    weight: Any
    inside: Any

    @classmethod
    def of(cls, points: SparsePoints, fit: evidence.Fits) -> Noise:
        """That found for the linear model at B spins."""
        level = points.error * (fit.noise @ points.group.T)
        weight = points.used * fit.weight / level**2
        return cls(weight, weight @ points.night + fit.night[:, None] ** -2.0)

    def rows(self, which: Any) -> Noise:
        """That of the selected spins."""
        return Noise(self.weight[which], self.inside[which])


class _Least(NamedTuple):
    """The linear model with least penalised squares at a spin.

    value : half the squares
    root : (Q, Q), Cholesky factor of the normal matrix
    coefficients : (Q,)
    columns, own : (T, Q), and without the errors of nights
    bisector, across : (T, 3), in the body frame
    cos, sin : (T,), of the rotational phase
    """

    value: Any
    root: Any
    coefficients: Any
    columns: Any
    own: Any
    bisector: Any
    across: Any
    cos: Any
    sin: Any


def ascended(
    points: SparsePoints, poles: Floats, frequencies: Floats, noise: Noise
) -> tuple[Floats, Floats]:
    """Poles (B, 3) and frequencies (B,) of the maxima of the posterior density uphill of spins."""
    return evidence.in_batches(_ascended, points, BATCH, tilts(poles), frequencies, noise)


def density(points: SparsePoints, poles: Floats, frequencies: Floats, noise: Noise) -> Floats:
    """ln of the normal density of the data at spins with a given noise, (B,), up to a constant."""
    return evidence.in_batches(_density, points, BATCH, tilts(poles), frequencies, noise)


def divided_at_maxima(
    points: SparsePoints, found: Cells, frequencies: Floats, apart: float, level: int
) -> Cells:
    """Cells, divided as far as the maxima near the best periods, and at half and twice these.

    The evidence of all shapes together may prefer half or twice the period of some bodies by far,
    and only the evidence by class tells them apart, so each is needed at its maximum.

    Parameters
    ----------
    points : SparsePoints
    found : Cells
    frequencies : (F,) Hz
        Those of the periodogram.
    apart : Hz
        Their step.
    level : int
        That of the periodogram's poles.
    """
    limits = frequencies[0] - 0.5 * apart, frequencies[-1] + 0.5 * apart
    tried = np.zeros(0)
    for periods, multiplied in ROUNDS:
        pole, frequency = _best_periods(points, found, periods, multiplied)
        new = (limits[0] < frequency) & (frequency < limits[1])
        off = np.abs(frequency[:, None] - tried) * points.span
        new &= np.all(off > OFFSETS.max(), axis=1)
        if not new.any():
            break
        tried = np.append(tried, frequency[new])
        ends = near(points, pole[new], frequency[new], limits)
        least = max(ends[2].max(), found.log_evidence.max()) - NATS
        if not np.any(ends[2] > least):
            continue
        targets = _targets(points, *ends, apart, least)
        held = _holding(points, found, targets, frequencies, apart, level)
        found = evidence.reaching(points, held, targets)
    return found


def _best_periods(
    points: SparsePoints, found: Cells, periods: int, multiplied: int
) -> tuple[Floats, Floats]:
    """Poles and frequencies of the best periods, and of half and double the first of them."""
    best = np.concatenate(evidence.best_of_periods(found, points.span, periods, 1))
    pole, frequency = found.pole[best], found.frequency[best]
    few = slice(0, multiplied)
    pole = np.concatenate([pole, pole[few], pole[few]])
    return pole, np.concatenate([frequency, 0.5 * frequency[few], 2.0 * frequency[few]])


def _holding(
    points: SparsePoints,
    found: Cells,
    targets: Cells,
    frequencies: Floats,
    apart: float,
    level: int,
) -> Cells:
    """Cells with the coarse ones that hold the targets, unless these or parts of them are there."""
    k = np.rint((targets.frequency - frequencies[0]) / apart).astype(int)
    new = set(zip(k, targets.cell // 4 ** (targets.level - level), strict=True))
    number = np.rint((found.frequency - frequencies[0]) / apart).astype(int)
    new -= set(zip(number, found.cell // 4 ** (found.level - level), strict=True))
    if not new:
        return found
    k, cell = np.array(sorted(new)).T
    coarse = evidence.cells(points, cell, level, frequencies[k], np.full(len(k), apart))
    return evidence.joined(found, coarse)


def near(
    points: SparsePoints, pole: Floats, frequency: Floats, limits: tuple[float, float]
) -> tuple[Floats, Floats, Floats]:
    """Poles (E, 3), frequencies (E,) and evidence (E,) of maxima near spins, and of these (P, 3).

    The maxima are those uphill of poles all around the sphere, each at the best of the frequencies
    within half a turn over the data, and within the limits (Hz).
    """
    noise = Noise.of(points, evidence.fits(points, pole, frequency))
    grid = sphere_cells.centres(np.arange(sphere_cells.number(POLES)), POLES)
    # every pole of the grid, and that of the period itself, at its best frequency
    shape = len(frequency), len(grid) + 1, len(OFFSETS)
    tried = np.concatenate([np.tile(grid, (shape[0], 1, 1)), pole[:, None]], axis=1)
    off = frequency[:, None] + OFFSETS / points.span
    given = tried.reshape(-1, 3).repeat(shape[2], axis=0), off.repeat(shape[1], axis=0).ravel()
    of_period = np.arange(shape[0]).repeat(shape[1])
    value = density(points, *given, noise.rows(of_period.repeat(shape[2]))).reshape(shape)
    f = off[of_period, np.argmax(value, axis=2).ravel()]
    tried, f = ascended(points, tried.reshape(-1, 3), f, noise.rows(of_period))
    within = (limits[0] < f) & (f < limits[1])
    tried, f = np.vstack([tried[within], pole]), np.append(f[within], frequency)
    return tried, f, evidence.all_shapes(points, tried, f)


def _targets(
    points: SparsePoints,
    pole: Floats,
    frequency: Floats,
    value: Floats,
    apart: float,
    least: float,
) -> Cells:
    """Small cells at the best of the distinct maxima above a least evidence, and around them."""
    left, chosen = value > least, []
    for i in np.argsort(-value, kind="stable"):
        if left[i] and len(chosen) < MOST:
            chosen.append(i)
            near = pole @ pole[i] > np.cos(np.radians(SAME_POLE))
            left &= ~(near & (np.abs(frequency - frequency[i]) * points.span < SAME_TURNS))
    rows = np.array(chosen)
    aside = np.radians(AROUND) * tilts(pole[rows])[:, :, :2]
    around = [pole[rows]] + [pole[rows] + s * aside[:, :, j] for s in (-1, 1) for j in range(2)]
    every = sphere_cells.centres(np.arange(sphere_cells.number(TARGET_LEVEL)), TARGET_LEVEL)
    cell = np.argmax(np.concatenate(around) @ every.T, axis=1)
    size = len(cell)
    return Cells(
        cell,
        np.full(size, TARGET_LEVEL),
        np.tile(frequency[rows], len(around)),
        np.full(size, apart),
        np.tile(value[rows], len(around)),
        np.full(size, -np.inf),
    )


@jax.jit
def _density(points: SparsePoints, tilt: Any, frequency: Any, noise: Noise) -> jax.Array:
    every = prior(points.group.shape[1])

    def one(tilt: jax.Array, frequency: jax.Array, noise: Noise) -> jax.Array:
        least = _least(points, noise, every, tilt, frequency)
        return -least.value - jnp.sum(jnp.log(jnp.diag(least.root)))

    return jax.vmap(one)(tilt, frequency, noise)


@jax.jit
def _ascended(points: SparsePoints, tilt: Any, frequency: Any, noise: Noise) -> tuple[Any, Any]:
    every, unit = prior(points.group.shape[1]), 0.5 / points.span

    def moved(spin: tuple[Any, Any], step: jax.Array) -> tuple[Any, Any]:
        turn = jnp.stack([step[0], step[1], jnp.zeros_like(step[0])])
        return spin[0] @ rotations.constant_rate(jnp.ones(1), turn)[0], spin[1] + step[2] * unit

    def one(tilt: jax.Array, frequency: jax.Array, noise: Noise) -> tuple[Any, Any]:
        end = levenberg_marquardt(
            partial(_model, points, noise, every),
            (tilt, frequency),
            num_steps=STEPS,
            tolerance=TOLERANCE,
            controls=CONTROLS,
            move=moved,
        )
        return end.position[0][:, 2], end.position[1]

    return jax.vmap(one)(tilt, frequency, noise)


def _least(
    points: SparsePoints, noise: Noise, every: Normal, tilt: jax.Array, frequency: jax.Array
) -> _Least:
    turns = points.t * frequency
    phase = 2.0 * jnp.pi * (turns - jnp.floor(turns))
    cos, sin = jnp.cos(phase), jnp.sin(phase)

    def in_body(vectors: jax.Array) -> jax.Array:
        a, b, c = (vectors @ tilt).T
        return jnp.stack([cos * a + sin * b, cos * b - sin * a, c], axis=1)

    bisector, across = in_body(points.bisector), in_body(points.across)
    x = jnp.concatenate([points.fixed, _shape(bisector, across)], axis=1)
    weighed, y = noise.weight[:, None] * x, points.log_flux
    own = x - (points.night_sums(weighed) / noise.inside[:, None])[points.night_index]
    right = own.T @ (noise.weight * y) + every.precision @ every.mean
    root = jnp.linalg.cholesky(own.T @ weighed + every.precision)
    found = jax.scipy.linalg.cho_solve((root, True), right)
    shared = points.night_sums(noise.weight * y) / noise.inside
    squares = noise.weight * y @ (y - shared[points.night_index])
    squares += every.mean @ every.precision @ every.mean - right @ found
    return _Least(0.5 * squares, root, found, x, own, bisector, across, cos, sin)


def _shape(bisector: jax.Array, across: jax.Array) -> jax.Array:
    """Columns of the shape, of vectors in the body frame."""
    return shape_columns(bisector, across, jnp.eye(3), jnp.zeros(len(bisector)))


def _model(
    points: SparsePoints, noise: Noise, every: Normal, spin: tuple[jax.Array, jax.Array]
) -> Quadratic:
    """Half the least penalised squares, and its slopes for two rotations of the pole and for the
    frequency in units of half a turn over the data.

    The coefficients follow from the spin (variable projection with Kaufman's Jacobian, whose
    gradient is exact). The slope of the light for a rotation ψ of the body is Σ_u (∂f/∂u × u)·ψ.
    """
    least = _least(points, noise, every, *spin)
    shape = least.coefficients[points.fixed.shape[1] :]
    light, slopes = jax.vjp(lambda b, a: _shape(b, a) @ shape, least.bisector, least.across)
    by_bisector, by_across = slopes(jnp.ones_like(light))
    torque = jnp.cross(by_bisector, least.bisector) + jnp.cross(by_across, least.across)
    a, b, c = torque.T
    cos, sin, turn = least.cos, least.sin, jnp.pi * points.t / points.span
    rows = jnp.stack([cos * a - sin * b, sin * a + cos * b, turn * c], axis=1)
    weighed = noise.weight[:, None] * rows
    own = rows - (points.night_sums(weighed) / noise.inside[:, None])[points.night_index]
    taken = least.own.T @ weighed
    residual = points.log_flux - least.columns @ least.coefficients
    taken_back = jax.scipy.linalg.cho_solve((least.root, True), taken)
    gradient = -(own.T @ (noise.weight * residual))
    return Quadratic(least.value, gradient, own.T @ weighed - taken.T @ taken_back)
