"""Coordinates in which a log-linear body is nearly linear to the data: the moments of its areas."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes._jax import jax, jnp

MAX_NEWTON_STEPS = 40


class MomentCoordinates(Transform):
    """c ↔ m with p ∝ exp(Y c) over the grid and m = Yᵀ p: natural and mean parameters.

    Brightness is linear in the facets' areas, and light curves fix some sums of areas to a part in
    a thousand while others stay almost free. In c, which is log-linear, every change along a free
    direction turns the fixed ones (to second order, exp(Yc) is not linear), so that a sampler's
    step must be a thousandth of the posterior's length. In m the fixed sums stay where they are.
    The map is one to one: m is the gradient of the convex function log Σ exp(Y c), and
    dm/dc = A = Yᵀ diag(p) Y − m mᵀ.

    Parameters
    ----------
    basis : (N, K)
        Y: functions on the grid, without the constant.

    References
    ----------
    Amari & Nagaoka, Methods of Information Geometry, ch. 3 (dual coordinates).
    """

    domain = constraints.real_vector
    codomain = constraints.real_vector

    def __init__(self, basis: np.ndarray) -> None:
        self.basis = basis

    def __call__(self, x: jax.Array) -> jax.Array:
        """c of the moments x (K,), by Newton's method; NaN where no positive areas have them."""
        return _natural(jnp.asarray(self.basis), x)

    def _inverse(self, y: jax.Array) -> jax.Array:
        return _moments(jnp.asarray(self.basis), y)[0]

    def log_abs_det_jacobian(self, x, y, intermediates=None):  # noqa: ARG002 - numpyro's signature
        covariance = _moments(jnp.asarray(self.basis), y)[1]
        return -2.0 * jnp.sum(jnp.log(jnp.diagonal(jnp.linalg.cholesky(covariance))))

    def tree_flatten(self):
        return (), ((), {"basis": self.basis})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MomentCoordinates) and self.basis is other.basis

    __hash__ = object.__hash__


def _moments(basis: jax.Array, c: jax.Array) -> tuple[jax.Array, jax.Array]:
    p = jax.nn.softmax(basis @ c)
    m = basis.T @ p
    return m, (basis * p[:, None]).T @ basis - jnp.outer(m, m)


@partial(jax.custom_jvp)
def _natural(basis: jax.Array, m: jax.Array) -> jax.Array:
    """Damped Newton on the convex log Σ exp(Y c) − m·c, whose minimum is c."""

    def cond(state):
        i, _, decrement = state
        return (i < MAX_NEWTON_STEPS) & (decrement > 1e-20)

    def body(state):
        i, c, _ = state
        moments, covariance = _moments(basis, c)
        step = jnp.linalg.solve(covariance, m - moments)
        decrement = step @ (m - moments)
        # Full steps within the region of quadratic convergence, damped ones outside it
        # (Nesterov & Nemirovskii's self-concordant rule).
        length = jnp.where(decrement < 0.25, 1.0, 1.0 / (1.0 + jnp.sqrt(decrement)))
        return i + 1, c + length * step, decrement

    start = (0, jnp.zeros(m.shape[0]), jnp.array(jnp.inf))
    _, c, decrement = jax.lax.while_loop(cond, body, start)
    return jnp.where(decrement < 1e-12, c, jnp.nan)


@_natural.defjvp
def _natural_jvp(primals, tangents):
    basis, m = primals
    c = _natural(basis, m)
    return c, jnp.linalg.solve(_moments(basis, c)[1], tangents[1])
