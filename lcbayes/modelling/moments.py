"""Moments as coordinates of a log-linear body, in which the data are nearly linear."""

from __future__ import annotations

import numpy as np
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes.core.jax_setup import jax, jnp

MAX_NEWTON_STEPS = 40


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

    def __call__(self, x: jax.Array) -> jax.Array:
        """c of x = (m, c″), (K,), by Newton's method; NaN if no positive areas have moments m."""
        n = self.n_moments
        basis, high = jnp.asarray(self.basis[:, :n]), jnp.asarray(self.basis[:, n:])
        return jnp.concatenate([_natural(basis, x[:n], high @ x[n:] + self.log_weights), x[n:]])

    def _inverse(self, y: jax.Array) -> jax.Array:
        n = self.n_moments
        log_area = self.basis @ y + self.log_weights
        return jnp.concatenate([_moments(self.basis[:, :n], log_area)[0], y[n:]])

    def log_abs_det_jacobian(self, x, y, intermediates=None):  # noqa: ARG002 - numpyro's signature
        log_area = self.basis @ y + self.log_weights
        covariance = _moments(self.basis[:, : self.n_moments], log_area)[1]
        return -2.0 * jnp.sum(jnp.log(jnp.diagonal(jnp.linalg.cholesky(covariance))))

    def tree_flatten(self):
        kept = {"basis": self.basis, "n_moments": self.n_moments}
        return (), ((), kept | {"log_weights": self.log_weights})

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, MomentCoordinates)
            and self.basis is other.basis
            and self.n_moments == other.n_moments
            and self.log_weights is other.log_weights
        )

    def __hash__(self) -> int:
        return hash((id(self.basis), self.n_moments, id(self.log_weights)))


def _moments(basis, log_area) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Mean and covariance of the basis functions under p = softmax(log_area), and p."""
    p = jax.nn.softmax(log_area)
    m = p @ basis
    return m, basis.T @ (basis * p[:, None]) - jnp.outer(m, m), p


def _solve(covariance: jax.Array, right: jax.Array) -> jax.Array:
    return jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(covariance), True), right)


@jax.custom_jvp
def _natural(basis: jax.Array, m: jax.Array, offset: jax.Array) -> jax.Array:
    """Minimum c of the convex log Σ exp(Y c + offset) − m·c, by damped Newton steps."""

    def cond(state):
        i, _, decrement = state
        return (i < MAX_NEWTON_STEPS) & (decrement > 1e-14)  # the next step would square it

    def body(state):
        i, c, _ = state
        mean, covariance, _ = _moments(basis, basis @ c + offset)
        step = _solve(covariance, m - mean)
        decrement = step @ (m - mean)
        # Full steps within the region of quadratic convergence, damped steps outside it
        # (rule of Nesterov & Nemirovskii for self-concordant functions).
        length = jnp.where(decrement < 0.25, 1.0, 1.0 / (1.0 + jnp.sqrt(decrement)))
        return i + 1, c + length * step, decrement

    start = (0, jnp.zeros(m.shape[0]), jnp.array(jnp.inf))
    _, c, decrement = jax.lax.while_loop(cond, body, start)
    return jnp.where(decrement < 1e-10, c, jnp.nan)


@_natural.defjvp
def _natural_jvp(primals, tangents):
    basis, m, offset = primals
    _, d_m, d_offset = tangents
    c = _natural(basis, m, offset)
    mean, covariance, p = _moments(basis, basis @ c + offset)
    lifted = (p * d_offset) @ basis - mean * (p @ d_offset)
    return c, _solve(covariance, d_m - lifted)
