"""Elliptic integrals that JAX does not have."""

from __future__ import annotations

from lcbayes.core.jax_setup import jax, jnp

DUPLICATIONS = 12  # enough for double precision


def carlson(x: jax.Array, y: jax.Array, z: jax.Array) -> jax.Array:
    """Carlson's R_F(x², y², z²) = ½ ∫₀^∞ [(s + x²)(s + y²)(s + z²)]^(−½) ds for x, y, z >= 0.

    At most one of them may be zero. The arguments are the square roots of the usual ones, because
    the roots are known here, and a square root is not differentiable at zero.

    References
    ----------
    Carlson 1995, Numer. Algorithms 10, 13, sec. 2, with the series to fifth order.
    """

    def duplicate(_: int, roots: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
        x, y, z = roots
        shift = x * y + y * z + z * x
        return tuple(0.5 * jnp.sqrt(v**2 + shift) for v in roots)

    x, y, z = (v**2 for v in jax.lax.fori_loop(0, DUPLICATIONS, duplicate, (x, y, z)))
    mean = (x + y + z) / 3.0
    dx, dy = 1.0 - x / mean, 1.0 - y / mean
    dz = -dx - dy
    e2, e3 = dx * dy - dz**2, dx * dy * dz
    series = 1.0 - e2 / 10.0 + e3 / 14.0 + e2**2 / 24.0 - 3.0 * e2 * e3 / 44.0
    return series / jnp.sqrt(mean)
