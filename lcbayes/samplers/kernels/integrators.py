"""Reversible, volume-preserving integrators of Hamilton's equations, of second order."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from jax.scipy.linalg import solve_triangular

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers.kernels import metric
from lcbayes.samplers.kernels.trajectory import Point

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
    Linares & Crassidis, eq. 23; for the whitened momentum, see `kernels.metric`.
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


TOLERANCE = 1e-9  # of an implicit step, in posterior widths according to the metric
RETURN_TOLERANCE = 1e-6  # largest distance of a reversed step from its origin
MAX_ITERATIONS = 40


class Geometry(NamedTuple):
    """The metric at a point, for the generalised leapfrog."""

    root: jax.Array  # (D, D), W with W Wᵀ = M⁻¹, triangular
    slope: jax.Array  # (D, D, D), slope[..., k] = ∂M/∂z_k
    log_det: jax.Array
    good: jax.Array  # False if the frozen metric is used instead
    evaluations: jax.Array  # number of Fisher matrices so far along the trajectory


class Manifold(NamedTuple):
    """A metric M(z) and its geometry; ``frozen`` replaces M if it is singular or not finite."""

    mass_fn: Callable[[jax.Array], jax.Array]
    frozen: jax.Array  # (D, D)

    def root(self, z: jax.Array) -> jax.Array:
        return metric.inverse_root(self.mass_fn(z), self.frozen)[0]

    def at(self, z: jax.Array, evaluations: jax.Array) -> Geometry:
        root, good = metric.inverse_root(self.mass_fn(z), self.frozen)
        slope = jax.jacfwd(self.mass_fn)(z)
        slope = jnp.where(good, slope, 0.0)  # the frozen metric is constant
        return Geometry(root, slope, metric.log_det(root), good, evaluations + 1 + z.shape[0])

    def energy(self, point: Point) -> jax.Array:
        """H = U + ½ ln det M + ½ pᵀM⁻¹p."""
        geometry = point.extra
        return point.potential + 0.5 * geometry.log_det + metric.kinetic(geometry.root.T @ point.v)


def generalised_leapfrog(
    value_and_grad: ValueAndGrad, manifold: Manifold
) -> Callable[[Point, jax.Array], Point]:
    """Generalised leapfrog for H = U(z) + ½ ln det M(z) + ½ pᵀM(z)⁻¹p; `Point.v` is p itself.

    p½ = p − ½ε ∂H/∂z(z, p½);  z′ = z + ½ε (M(z)⁻¹ + M(z′)⁻¹) p½;  p′ = p½ − ½ε ∂H/∂z(z′, p½).

    The first two equations are solved by fixed-point iteration. A step is `solved` if both converge
    and if the step from (z′, −p′) also converges and returns to (z, −p). Only then is the step a
    volume-preserving involution that may be accepted.

    References
    ----------
    Linares & Crassidis, eq. 26; Girolami & Calderhead (2011), eqs. 16-18.
    """

    def force(geometry: Geometry, grad: jax.Array, p: jax.Array) -> jax.Array:
        inverse = geometry.root @ geometry.root.T
        velocity = inverse @ p
        trace = jnp.einsum("ij,jik->k", inverse, geometry.slope)
        return (
            grad + 0.5 * trace - 0.5 * jnp.einsum("i,ijk,j->k", velocity, geometry.slope, velocity)
        )

    def half_kick(geometry, grad, p, step_size):
        """p½ and whether the iteration converged; z is fixed, so no Fisher matrix is needed."""

        def once(half):
            return p - 0.5 * step_size * force(geometry, grad, half)

        half, converged, _ = _fixed_point(once, p, lambda d: geometry.root.T @ d)
        return half, converged

    def drift(geometry, z, half, step_size):
        """z′, whether the iteration converged, and the number of Fisher matrices computed."""
        here = geometry.root @ (geometry.root.T @ half)

        def once(other):
            root = manifold.root(other)
            return z + 0.5 * step_size * (here + root @ (root.T @ half))

        def length(d):
            return _forward(geometry.root, d)

        return _fixed_point(once, z + step_size * here, length)

    def step(point: Point, step_size: jax.Array) -> Point:
        before = point.extra
        half, kicked = half_kick(before, point.grad, point.v, step_size)
        z, drifted, n_there = drift(before, point.z, half, step_size)
        potential, grad = value_and_grad(z)
        after = manifold.at(z, before.evaluations)
        p = half - 0.5 * step_size * force(after, grad, half)

        half_back, kicked_back = half_kick(after, grad, -p, step_size)
        z_back, drifted_back, n_back = drift(after, z, half_back, step_size)
        p_back = half_back - 0.5 * step_size * force(before, point.grad, half_back)
        off = jnp.concatenate(
            [_forward(before.root, z_back - point.z), before.root.T @ (p_back + point.v)]
        )
        solved = kicked & drifted & kicked_back & drifted_back
        solved &= jnp.max(jnp.abs(off)) < RETURN_TOLERANCE
        after = after._replace(
            good=after.good & before.good, evaluations=after.evaluations + n_there + n_back
        )
        return Point(z, p, potential, grad, point.solved & solved, after)

    return step


def _forward(root: jax.Array, d: jax.Array) -> jax.Array:
    """W⁻¹ d, a shift in units of the metric's widths. W is upper triangular."""
    return solve_triangular(root, d, lower=False)


def unwhiten(root: jax.Array, v: jax.Array) -> jax.Array:
    """p = W⁻ᵀ v ~ N(0, M) for v ~ N(0, I)."""
    return solve_triangular(root, v, lower=False, trans="T")


def _fixed_point(
    once: Callable[[jax.Array], jax.Array],
    start: jax.Array,
    length: Callable[[jax.Array], jax.Array],
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Solution of x = once(x) from ``start``, whether it converged, and the iteration count."""

    def going(carry):
        n, _, size = carry
        return (n < MAX_ITERATIONS) & (size > TOLERANCE) & jnp.isfinite(size)

    def again(carry):
        n, x, _ = carry
        new = once(x)
        return n + 1, new, jnp.max(jnp.abs(length(new - x)))

    first = once(start)
    size = jnp.max(jnp.abs(length(first - start)))
    n, x, size = jax.lax.while_loop(going, again, (jnp.array(1), first, size))
    return x, size <= TOLERANCE, n
