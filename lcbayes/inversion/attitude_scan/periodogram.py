"""The periodogram of sparse points: every pole of a grid with every frequency, as matrix products.

Only u² and some zonal terms of `harmonics` are used: to first order a triaxial ellipsoid has z² and
u², and a box |z|. With
u²(t) = v_p(t) e(t), v of the pole p alone and e = exp(−4πi f t) of the frequency alone, all sums
over points that the normal equations need are products of a matrix of poles × points with one of
points × frequencies.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.time_limit import check_time
from lcbayes.inversion.attitude_scan.harmonics import (
    SparsePoints,
    fixed_prior,
)
from lcbayes.inversion.attitude_scan.shape_classes import shape_prior
from lcbayes.inversion.attitude_scan.spin import tilts

Floats = NDArray[np.float64]

NU = 5.0  # degrees of freedom of Student's t distribution of the noise
BLOCK, BLOCKS = 128, 64  # frequencies at once, and such blocks in one call
ROUNDS = 12  # of reweighting
PRIOR_POINTS = 2.0  # weight of the prior of a noise level, in points
NIGHT_SD = 0.03  # prior sd of the error that a night shares
ELONGATION = 0.2  # prior sd of Re and Im of u²
# z², |z|, and the square of the component along z of the difference of the directions: their
# numbers among the columns of `harmonics.shape_columns`
ZONAL_USED = [1, 4, 6]


class Poles(NamedTuple):
    """What the sums need of each pole; complex numbers as (real, imaginary).

    linear : (2, P, R, T), v times each of R vectors: residual and orthonormal fixed columns
    square : (2, P, T), v² times the weights
    modulus : (P,), Σ w |v|²
    rest : (P,), sum of squares without the shape's u²
    log_det : (P,), of the fixed columns
    """

    linear: jax.Array
    square: jax.Array
    modulus: jax.Array
    rest: jax.Array
    log_det: jax.Array


def weights(points: SparsePoints) -> Floats:
    """Weights (T,) of points in a fit without a shape: 1/σ² times Student's weight.

    An outlier beyond the range of a rotating body has little weight, and so have the points of a
    night together.
    """
    mean, sd = fixed_prior(points.group.shape[1])
    known, count = np.diag(sd**-2.0), points.used @ points.group
    scale = np.full(points.group.shape[1], 3.0 * points.noise)
    heavy, x, y = points.used, points.fixed, points.log_flux
    for _ in range(ROUNDS):
        w = heavy / (points.error * (points.group @ scale)) ** 2
        found = np.linalg.solve(x.T @ (w[:, None] * x) + known, x.T @ (w * y) + known @ mean)
        squares = ((y - x @ found) / points.error) ** 2
        total = points.group.T @ (heavy * squares) + PRIOR_POINTS * points.noise**2
        scale = np.sqrt(total / (count + PRIOR_POINTS))
        heavy = points.used * (NU + 1.0) / (NU + squares / (points.group @ scale) ** 2)
    w = heavy / (points.error * (points.group @ scale)) ** 2
    return w / (1.0 + NIGHT_SD**2 * (points.night @ (points.night.T @ w)))


def zonal_prior() -> tuple[Floats, Floats]:
    """Prior mean and covariance of the zonal terms."""
    mean, covariance = shape_prior()
    return mean[ZONAL_USED], covariance[np.ix_(ZONAL_USED, ZONAL_USED)]


def poles(points: SparsePoints, directions: Floats) -> Poles:
    """The parts of the sums that depend on the pole, for poles (P, 3)."""
    w = weights(points)
    root = np.sqrt(w)
    mean, sd = fixed_prior(points.group.shape[1])
    flat, covariance = zonal_prior()
    mean = np.concatenate([mean, flat])
    root_known: Floats = np.asarray(
        block_diag(np.diag(1.0 / sd), np.linalg.inv(np.linalg.cholesky(covariance)))
    )
    still = np.einsum("tj,pjk->ptk", points.bisector, tilts(directions))
    v = (still[..., 0] + 1j * still[..., 1]) ** 2
    linear, rest, log_det = [], [], []
    across = points.across @ directions.T
    for z, off in zip(still[..., 2], across.T, strict=True):
        x = np.column_stack([points.fixed, z * z - 1.0 / 3.0, np.abs(z) - 0.5, off**2])
        rows = np.vstack([root[:, None] * x, root_known])  # data, then prior
        y = np.concatenate([root * points.log_flux, root_known @ mean])
        q, r = np.linalg.qr(rows)
        y = y - q @ (q.T @ y)
        linear.append(root * np.vstack([y[: len(w)], q[: len(w)].T]))
        rest.append(y @ y)
        log_det.append(2.0 * np.sum(np.log(np.abs(np.diag(r)))))
    products = v[:, None, :] * np.array(linear)
    square = w * v * v

    def parts(x: NDArray[np.complex128]) -> jax.Array:
        return jnp.asarray(np.stack([x.real, x.imag]), jnp.float32)

    modulus = np.sum(w * np.abs(v) ** 2, axis=1)
    return Poles(parts(products), parts(square), *map(jnp.asarray, (modulus, rest, log_det)))


@jax.jit
def _scan(t: jax.Array, first: jax.Array, apart: jax.Array, p: Poles, half: jax.Array) -> jax.Array:
    n_poles, n_rows, n_points = p.linear.shape[1:]
    flat = p.linear.reshape(2, n_poles * n_rows, n_points)
    modulus, rest, log_det = (x.astype(jnp.float32) for x in p[2:])
    known = 1.0 / ELONGATION**2

    def product(g: jax.Array, c: jax.Array, s: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Real and imaginary parts of g (c − is)."""
        joined = jnp.concatenate([g[0], g[1]], axis=1), jnp.concatenate([g[1], -g[0]], axis=1)
        e = jnp.concatenate([c, s], axis=0)
        return joined[0] @ e, joined[1] @ e

    def block(i: jax.Array) -> jax.Array:
        f = first + apart * (i * BLOCK + jnp.arange(BLOCK))
        turns = 2.0 * t[:, None] * f
        angle = (2.0 * jnp.pi * (turns - jnp.round(turns))).astype(jnp.float32)
        c, s = jnp.cos(angle), jnp.sin(angle)
        re, im = (x.reshape(n_poles, n_rows, BLOCK) for x in product(flat, c, s))
        zr, zi = product(p.square, c * c - s * s, 2.0 * c * s)
        a = 0.5 * (modulus[:, None] + zr) - jnp.sum(re[:, 1:] ** 2, axis=1) + known
        b = 0.5 * (modulus[:, None] - zr) - jnp.sum(im[:, 1:] ** 2, axis=1) + known
        d = 0.5 * zi - jnp.sum(re[:, 1:] * im[:, 1:], axis=1)
        x, y = re[:, 0], im[:, 0]
        det = a * b - d * d
        gain = (b * x * x + a * y * y - 2.0 * d * x * y) / det
        least = jnp.maximum(rest[:, None] - gain, 1e-3 * rest[:, None])
        value = -half * jnp.log(least) - 0.5 * (jnp.log(det) + log_det[:, None])
        return value.T

    return jax.lax.map(block, jnp.arange(BLOCKS))


def periodogram(
    points: SparsePoints, directions: Floats, first: float, apart: float, count: int
) -> NDArray[np.float32]:
    """ln evidence (F, P) in single precision, up to a constant, at frequencies first + k apart.

    The noise level is marginalised under a scale-free prior, the coefficients under theirs.

    Parameters
    ----------
    points : SparsePoints
    directions : (P, 3)
        Poles.
    first, apart : Hz
    count : int
        Number of frequencies.
    """
    p, t = poles(points, directions), jnp.asarray(points.t)
    half = jnp.asarray(0.5 * (points.used.sum() + PRIOR_POINTS), jnp.float32)
    value = np.empty((count, len(directions)), np.float32)
    for i in range(0, count, BLOCK * BLOCKS):
        check_time()
        part = _scan(t, jnp.asarray(first + i * apart), jnp.asarray(apart), p, half)
        value[i : i + BLOCK * BLOCKS] = part.reshape(-1, len(directions))[: count - i]
    return value
