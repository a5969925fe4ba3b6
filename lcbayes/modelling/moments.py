"""Moments as coordinates of a log-linear body, in which the data are nearly linear."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes.core.jax_setup import jax, jnp

MAX_NEWTON_STEPS = 40
CONVERGED = 1e-12  # squared Newton decrement; that of the next step is its square


class Start(NamedTuple):
    """Where Newton's method starts for points x near x̄: c′ = c̄′ + slope (x − x̄)."""

    x: jax.Array  # (K,)
    c: jax.Array  # (n,)
    slope: jax.Array  # (n, K)

    def __call__(self, x: jax.Array) -> jax.Array:
        return self.c + self.slope @ (x - self.x)


class Basis(NamedTuple):
    """Functions Y on a grid, and their products as sums of a few others: Y = U S, Yᵢ Yⱼ = U P.

    Products of harmonics up to degree L are sums of those up to 2L: 81 functions in place of 300
    products for L = 4, so that their means take a third of the time.
    """

    values: NDArray[np.float64]  # (N, n) Y
    span: NDArray[np.float64]  # (N, R) U
    singles: NDArray[np.float64]  # (R, n) S
    products: NDArray[np.float64]  # (R, n (n + 1)/2) P, of i ≤ j
    pairs: NDArray[np.int64]  # (n, n) column of P

    @classmethod
    def of(cls, values: NDArray[np.float64]) -> Basis:
        n = values.shape[1]
        i, j = np.triu_indices(n)
        pairs = np.zeros((n, n), np.int64)
        pairs[i, j] = pairs[j, i] = np.arange(i.size)
        every = np.concatenate([values, values[:, i] * values[:, j]], axis=1)
        span, sizes, rows = np.linalg.svd(every, full_matrices=False)
        kept = sizes > 1e-12 * sizes[0]
        rows = sizes[kept, None] * rows[kept]
        return cls(values, span[:, kept], rows[:, :n], rows[:, n:], pairs)

    def moments(self, c: jax.Array, offset: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Mean (n,) and covariance (n, n) of Y under p ∝ exp(Y c + offset), and p (N,)."""
        p = jax.nn.softmax(jnp.asarray(self.values) @ c + offset)
        means = p @ jnp.asarray(self.span)
        m = means @ self.singles
        return m, (means @ self.products)[self.pairs] - jnp.outer(m, m), p


class MomentCoordinates(Transform):
    """(m, c″) ↔ (c′, c″) with p ∝ w exp(Y′c′ + Y″c″) over the grid and m = Y′ᵀ p.

    Brightness is linear in the facet areas. Light curves determine some sums of areas to a part in
    a thousand and leave others almost free. Because exp(Yc) is not linear, a change of c along a
    free direction also changes, to second order, the well-determined sums. The step size of a
    sampler in c must therefore be a hundredth of the posterior's length. In m, these sums are
    coordinates and remain fixed. Functions that the data hardly constrain keep the coordinates c″,
    in which their prior is Gaussian; their moments would be bounded, because areas are positive.

    The map is one-to-one: at given c″, m is the gradient by c′ of the convex function
    log Σ exp(Yc), and ∂m/∂c′ = A′′, ∂m/∂c″ = A′″, blocks of A = Yᵀ diag(p) Y − (Yᵀp)(Yᵀp)ᵀ.

    Parameters
    ----------
    basis : (N, K)
        Y: functions on the grid, without the constant.
    n_moments : int
        Number of leading columns that are described by their moments.
    log_weights : (N,)
        ln w of the nodes of the grid.

    References
    ----------
    Amari & Nagaoka, Methods of Information Geometry, sec. 3.6 (mixed coordinates).
    """

    domain = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    codomain = constraints.real_vector  # pyright: ignore[reportAssignmentType]

    def __init__(self, basis: np.ndarray, n_moments: int, log_weights: np.ndarray) -> None:
        self.basis = basis
        self.n_moments = n_moments
        self.log_weights = log_weights
        self.low = Basis.of(basis[:, :n_moments])

    def __call__(self, x: jax.Array, start: Start | None = None) -> jax.Array:
        """c of x = (m, c″), (K,), by Newton's method; NaN if no positive areas have moments m."""
        n = self.n_moments
        first = jnp.zeros(n) if start is None else start(x)
        return jnp.concatenate([_natural(self.low, x[:n], self._offset(x), first), x[n:]])

    def _offset(self, y: jax.Array) -> jax.Array:
        """ln of the areas for c′ = 0, (N,)."""
        return jnp.asarray(self.basis[:, self.n_moments :]) @ y[self.n_moments :] + self.log_weights

    def _moments(self, y: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        return self.low.moments(y[: self.n_moments], self._offset(y))

    def start(self, x: jax.Array) -> Start:
        """For points near x (K,)."""
        n = self.n_moments
        return Start(x, self(x)[:n], jax.jacfwd(self)(x)[:n])

    def _inverse(self, y: jax.Array) -> jax.Array:
        return jnp.concatenate([self._moments(y)[0], y[self.n_moments :]])

    def log_abs_det_jacobian(self, x, y, intermediates=None):  # noqa: ARG002 - numpyro's signature
        return -_log_det(self._moments(y)[1])

    def tree_flatten(self):
        kept = ("basis", "n_moments", "log_weights", "low")
        return (), ((), {k: getattr(self, k) for k in kept})

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, MomentCoordinates)
            and self.basis is other.basis
            and self.n_moments == other.n_moments
            and self.log_weights is other.log_weights
        )

    def __hash__(self) -> int:
        return hash((id(self.basis), self.n_moments, id(self.log_weights)))


def _solve(covariance: jax.Array, right: jax.Array) -> jax.Array:
    return jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(covariance), True), right)


@jax.custom_jvp
def _log_det(covariance: jax.Array) -> jax.Array:
    return 2.0 * jnp.sum(jnp.log(jnp.diagonal(jnp.linalg.cholesky(covariance))))


@_log_det.defjvp
def _log_det_jvp(primals, tangents):
    """d ln |A| = tr A⁻¹ dA, which takes less time than the derivative of Cholesky's factor."""
    (covariance,), (change,) = primals, tangents
    inverse = _solve(covariance, jnp.eye(len(covariance)))
    return _log_det(covariance), jnp.sum(inverse * change)


@jax.custom_jvp
def _natural(basis: Basis, m: jax.Array, offset: jax.Array, first: jax.Array) -> jax.Array:
    """Minimum c of the convex log Σ exp(Y c + offset) − m·c, by Newton steps from ``first``."""

    def cond(state):
        i, _, decrement = state
        return (i < MAX_NEWTON_STEPS) & (decrement > CONVERGED)

    def body(state):
        i, c, _ = state
        mean, covariance, _ = basis.moments(c, offset)
        step = _solve(covariance, m - mean)
        decrement = step @ (m - mean)
        # Full steps within the region of quadratic convergence, damped steps outside it
        # (rule of Nesterov & Nemirovskii for self-concordant functions).
        length = jnp.where(decrement < 0.25, 1.0, 1.0 / (1.0 + jnp.sqrt(decrement)))
        return i + 1, c + length * step, decrement

    start = (0, first, jnp.array(jnp.inf))
    _, c, decrement = jax.lax.while_loop(cond, body, start)
    return jnp.where(decrement < 1e-10, c, jnp.nan)


@_natural.defjvp
def _natural_jvp(primals, tangents):
    basis, m, offset, first = primals
    _, d_m, d_offset, _ = tangents
    c = _natural(basis, m, offset, first)
    mean, covariance, p = basis.moments(c, offset)
    lifted = (p * d_offset) @ basis.values - mean * (p @ d_offset)
    return c, _solve(covariance, d_m - lifted)
