"""Mass matrices by an inverse root W, M⁻¹ = W Wᵀ, and momenta whitened by it.

With p = W⁻ᵀ v the momentum v is standard normal, the kinetic energy is ½ vᵀv and the velocity M⁻¹p
is W v: after one factorisation every step costs two products of matrix and vector, no solve.
"""

from __future__ import annotations

from typing import NamedTuple

from jax.scipy.linalg import solve_triangular

from lcbayes.core.jax_setup import jax, jnp


class Scale(NamedTuple):
    """Centre and covariance S = R Rᵀ of the posterior as warm-up saw it."""

    mean: jax.Array  # (D,)
    root: jax.Array  # (D, D), R: lower triangular, of S
    white: jax.Array  # (D, D), R⁻¹

    @property
    def precision(self) -> jax.Array:
        """S⁻¹, (D, D)."""
        return self.white.T @ self.white


def scale_of(mean: jax.Array, covariance: jax.Array, fallback: Scale) -> Scale:
    """The scale of a covariance (D, D); ``fallback`` where it is not positive definite."""
    root = jnp.linalg.cholesky(_symmetric(covariance))
    white = solve_triangular(root, jnp.eye(root.shape[0]), lower=True)
    good = _finite(white) & _finite(covariance) & _finite(mean)
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), Scale(mean, root, white), fallback)


def unit_scale(mean: jax.Array) -> Scale:
    """S = I about a point (D,)."""
    eye = jnp.eye(mean.shape[0])
    return Scale(mean, eye, eye)


def inverse_root(mass: jax.Array, fallback: jax.Array) -> tuple[jax.Array, jax.Array]:
    """W (D, D) with W Wᵀ = M⁻¹, and whether M allowed it; W of ``fallback``, a mass, where not.

    A matrix that is singular has no Cholesky factor, or one whose inverse is not finite; one that
    is infinite has an inverse of zero, along which nothing would ever move. None of these may stop
    a chain, so the caller names a mass that is always good.
    """
    eye = jnp.eye(mass.shape[0])

    def root(m):
        return solve_triangular(jnp.linalg.cholesky(_symmetric(m)), eye, lower=True).T

    found = root(mass)
    good = _finite(found) & _finite(mass)
    return jax.lax.cond(good, lambda: found, lambda: root(fallback)), good


def momentum(key: jax.Array, dim: int) -> jax.Array:
    """Whitened momentum v ~ N(0, I), (D,)."""
    return jax.random.normal(key, (dim,))


def kinetic(v: jax.Array) -> jax.Array:
    """½ pᵀM⁻¹p = ½ vᵀv."""
    return 0.5 * v @ v


def log_det(root: jax.Array) -> jax.Array:
    """ln det M of a triangular inverse root W."""
    return -2 * jnp.sum(jnp.log(jnp.abs(jnp.diagonal(root))))


def _finite(matrix: jax.Array) -> jax.Array:
    return jnp.all(jnp.isfinite(matrix))


def _symmetric(matrix: jax.Array) -> jax.Array:
    return 0.5 * (matrix + matrix.T)
