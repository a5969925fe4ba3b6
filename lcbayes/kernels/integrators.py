"""Integrators of Hamilton's equations: reversible, volume-preserving, of second order."""

from __future__ import annotations

from collections.abc import Callable

from lcbayes._jax import jax
from lcbayes.kernels.trajectory import Point

ValueAndGrad = Callable[[jax.Array], tuple[jax.Array, jax.Array]]


def leapfrog(
    value_and_grad: ValueAndGrad,
    root: jax.Array,
    centre: jax.Array | None = None,
    spring: jax.Array | None = None,
) -> Callable[[Point, jax.Array], Point]:
    """Leapfrog for H = U(z) + ½ (z − c)ᵀK(z − c) + ½ vᵀv, with v = Wᵀp and M⁻¹ = W Wᵀ.

    v ← v − ½ε Wᵀ(∇U + K(z − c));  z ← z + ε W v;  v ← v − ½ε Wᵀ(∇U + K(z − c)).

    Parameters
    ----------
    value_and_grad
        z (D,) -> U, ∇U (D,).
    root
        W, (D, D).
    centre, spring
        c (D,) and K (D, D), symmetric; both or neither.

    References
    ----------
    Linares & Crassidis, eq. 23; as a whitened momentum, this package's metric module.
    """

    def force(z, grad):
        pull = 0.0 if centre is None or spring is None else spring @ (z - centre)
        return root.T @ (grad + pull)

    def step(point: Point, step_size: jax.Array) -> Point:
        v = point.v - 0.5 * step_size * force(point.z, point.grad)
        z = point.z + step_size * (root @ v)
        potential, grad = value_and_grad(z)
        v = v - 0.5 * step_size * force(z, grad)
        return point._replace(z=z, v=v, potential=potential, grad=grad)

    return step
