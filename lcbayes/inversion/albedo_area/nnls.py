"""Non-negative least squares: an exact solver and a batched solver under XLA."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp

Floats = NDArray[np.float64]

MAX_STEPS = 60
PRECISE = 1e-13  # complementarity, relative to the objective, at which the iteration ends


def exact(matrix: Floats, target: Floats) -> Floats:
    """argmin |A x − b|² over x ≥ 0, by the active-set method of Lawson & Hanson.

    Parameters
    ----------
    matrix : (T, n)
    target : (T,)

    Returns
    -------
    (n,)

    References
    ----------
    Lawson & Hanson 1974, ch. 23, as implemented in `scipy.optimize.nnls`.
    """
    from scipy.optimize import nnls

    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    try:
        return nnls(matrix / size, target, maxiter=10 * matrix.shape[1])[0] / size
    except RuntimeError:
        raise InputError(
            f"the areas were not found: {matrix.shape[1]} unknowns did not settle; take fewer "
            "normals, or smooth"
        ) from None


@jax.jit
def batched(gram: jax.Array, moment: jax.Array) -> jax.Array:
    """argmin ½ xᵀGx − cᵀx over x ≥ 0, for a batch of problems; G = AᵀA and c = Aᵀb.

    The solver is a primal-dual interior-point method (Mehrotra's predictor-corrector). It needs
    about 15 Cholesky factorisations of G + diag(z/x) for any condition number of G; gradient
    methods need thousands of steps. Finally, the unknowns identified as positive are solved for
    exactly. This result is kept if it satisfies the optimality conditions: no unknown is negative,
    and no unknown at zero has a gradient that would increase it. If G is singular, the minimum is
    reached, but the minimiser is not unique.

    Parameters
    ----------
    gram : (B, n, n)
        Positive semidefinite.
    moment : (B, n)

    Returns
    -------
    (B, n)
        The objective agrees with that of `exact` to 10⁻⁹ of bᵀb.

    References
    ----------
    Mehrotra 1992, SIAM J. Optim. 2, 575; Nocedal & Wright, *Numerical Optimization*, sec. 16.6.
    """
    # one problem at a time: a factorisation of this size occupies a core by itself
    return jax.lax.map(lambda problem: _interior(*problem), (gram, moment))


def _interior(gram: jax.Array, moment: jax.Array) -> jax.Array:
    diagonal = jnp.diagonal(gram)
    empty = diagonal <= 0.0
    size = jnp.where(empty, 1.0, jnp.sqrt(jnp.where(empty, 1.0, diagonal)))
    g = gram / size / size[:, None] + jnp.diag(jnp.where(empty, 1.0, 0.0))
    c = jnp.where(empty, 0.0, moment / size)
    unit = jnp.maximum(jnp.max(jnp.abs(c)), 1e-300)
    c = c / unit
    n = c.shape[0]
    start = jnp.full(n, 1.0 / jnp.sqrt(n)), jnp.full(n, 1.0)

    def gap(state):
        x, z = state
        return x @ z, jnp.max(jnp.abs(g @ x - c - z))

    def unfinished(carry):
        step, state = carry
        product, fault = gap(state)
        scale = 1.0 + jnp.abs(c @ state[0])
        return (step < MAX_STEPS) & ((product > PRECISE * scale) | (fault > 1e-12 * scale))

    def advance(carry):
        step, (x, z) = carry
        residual = g @ x - c - z
        factor = jax.scipy.linalg.cho_factor(g + jnp.diag(z / x))

        def direction(extra):
            dx = jax.scipy.linalg.cho_solve(factor, -residual - z + extra / x)
            return dx, -z + extra / x - z / x * dx

        mean = x @ z / n
        dx, dz = direction(0.0)
        length = _longest(x, dx, z, dz)
        ahead = (x + length * dx) @ (z + length * dz) / n
        dx, dz = direction((ahead / mean) ** 3 * mean - dx * dz)
        length = jnp.minimum(1.0, 0.995 * _longest(x, dx, z, dz))
        return step + 1, (x + length * dx, z + length * dz)

    _, (x, z) = jax.lax.while_loop(unfinished, advance, (0, start))
    return jnp.where(empty, 0.0, _polished(g, c, x, z)) * unit / size


def _longest(x, dx, z, dz):
    """The longest step, at most 1, for which both remain non-negative."""
    ratios = jnp.concatenate([jnp.where(dx < 0, -x / dx, 1.0), jnp.where(dz < 0, -z / dz, 1.0)])
    return jnp.minimum(1.0, jnp.min(ratios))


def _polished(g, c, x, z):
    """Solve exactly for the positive unknowns; keep the result if it is optimal."""
    positive = x > z
    both = positive[:, None] & positive
    masked = jnp.where(both, g, 0.0) + jnp.diag(jnp.where(positive, 0.0, 1.0))
    y = jax.scipy.linalg.cho_solve(jax.scipy.linalg.cho_factor(masked), jnp.where(positive, c, 0.0))
    good = jnp.all(jnp.isfinite(y)) & jnp.all(y >= 0.0) & jnp.all((g @ y - c) > -1e-9)
    return jnp.where(good, y, x)


@partial(jax.jit, static_argnames=("chunk",))
def weighted(matrix: jax.Array, target: jax.Array, weight: jax.Array, chunk: int = 1) -> jax.Array:
    """`batched` for problems that differ in the weights of their rows.

    Parameters
    ----------
    matrix : (T, n)
    target : (T,)
    weight : (B, T)
        Weight of the squared residual of each row.
    chunk : int
        Problems in memory at once.

    Returns
    -------
    (B, n)
    """

    def one(w: jax.Array) -> jax.Array:
        scaled = matrix * w[:, None]
        return _interior(scaled.T @ matrix, scaled.T @ target)

    return jax.lax.map(one, weight, batch_size=chunk)
