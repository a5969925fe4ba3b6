"""Mass matrices M, represented by W with M⁻¹ = W Wᵀ, and whitened momenta.

With p = W⁻ᵀ v, the momentum v is standard normal, the kinetic energy is ½ vᵀv and the velocity M⁻¹p
is W v. After one factorisation, each step costs two matrix-vector products and no linear solve.
"""

from __future__ import annotations

from typing import NamedTuple

from jax.scipy.linalg import solve_triangular

from lcbayes.core.jax_setup import jax, jnp


class Scale(NamedTuple):
    """Mean and covariance S = R Rᵀ of the posterior, estimated during warm-up."""

    mean: jax.Array  # (D,)
    root: jax.Array  # (D, D), R: Cholesky factor of S
    white: jax.Array  # (D, D), R⁻¹

    @property
    def precision(self) -> jax.Array:
        """S⁻¹, (D, D)."""
        return self.white.T @ self.white


def scale_of(mean: jax.Array, covariance: jax.Array, fallback: Scale) -> Scale:
    """The scale of a covariance (D, D), or ``fallback`` if it is not positive definite."""
    root = jnp.linalg.cholesky(_symmetric(covariance))
    white = solve_triangular(root, jnp.eye(root.shape[0]), lower=True)
    good = _finite(white) & _finite(covariance) & _finite(mean)
    return jax.tree.map(lambda a, b: jnp.where(good, a, b), Scale(mean, root, white), fallback)


def unit_scale(mean: jax.Array) -> Scale:
    """S = I about a point (D,)."""
    eye = jnp.eye(mean.shape[0])
    return Scale(mean, eye, eye)


def inverse_root(mass: jax.Array, fallback: jax.Array) -> tuple[jax.Array, jax.Array]:
    """W (D, D) with W Wᵀ = M⁻¹, and whether M is usable; otherwise W of the mass ``fallback``.

    A singular matrix has no Cholesky factor, or one whose inverse is not finite. The inverse of an
    infinite matrix is zero, and a chain would not move along it. The caller therefore provides a
    valid mass matrix for such cases.
    """
    eye = jnp.eye(mass.shape[0])

    def root(m):
        return solve_triangular(jnp.linalg.cholesky(_symmetric(m)), eye, lower=True).T

    factor = root(mass)
    good = _finite(factor) & _finite(mass)
    return jax.lax.cond(good, lambda: factor, lambda: root(fallback)), good


def variance(information: jax.Array) -> jax.Array:
    """Diagonal (D,) of the inverse of an information matrix (D, D), or ones if it is singular."""
    root, _ = inverse_root(information, jnp.eye(information.shape[0]))
    return jnp.sum(root**2, axis=1)


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
