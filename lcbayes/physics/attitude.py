"""Attitude laws: where the body's axes point at each time.

Every law returns A (T, 3, 3), which maps body to inertial components; `to_body` applies its
transpose. Hinks' A is that transpose.
"""

from __future__ import annotations

from lcbayes._jax import jax, jnp


def constant_rate(t: jax.Array, omega: jax.Array) -> jax.Array:
    """Rotation at a constant angular velocity, A = exp([ω×] t), A(0) = I.

    Parameters
    ----------
    t : (T,) s
        Time since the instant at which the body axes are the inertial axes.
    omega : (3,) rad/s
        Angular velocity, inertial.

    Returns
    -------
    (T, 3, 3)
        Body to inertial.

    References
    ----------
    Linares & Crassidis, sec. II: Ȧ = [ω×]A, A(t₀) = I.
    """
    # Rodrigues with sin(x)/x and (1-cos x)/x², smooth and differentiable at ω = 0.
    theta2 = jnp.sum(omega**2) * t**2
    small = theta2 < 1e-8
    theta = jnp.sqrt(jnp.where(small, 1.0, theta2))
    a = jnp.where(small, 1.0 - theta2 / 6.0, jnp.sin(theta) / theta)
    b = jnp.where(small, 0.5 - theta2 / 24.0, (1.0 - jnp.cos(theta)) / theta**2)
    x, y, z = omega
    zero = jnp.zeros_like(x)
    cross = jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    eye = jnp.eye(3, dtype=cross.dtype)
    return eye + (a * t)[:, None, None] * cross + (b * t**2)[:, None, None] * (cross @ cross)


def principal_axis(
    t: jax.Array, pole_lon: jax.Array, pole_lat: jax.Array, period: jax.Array, phase0: jax.Array
) -> jax.Array:
    """Rotation about the body's z axis, which points to the pole; the asteroid convention.

    A = R_z(λ) R_y(π/2 − β) R_z(φ₀ + 2πt/P).

    Parameters
    ----------
    t : (T,) s
        Time since the epoch of ``phase0``.
    pole_lon, pole_lat : rad
        Pole in the frame of the inertial vectors.
    period : s
        Sidereal rotation period; negative for the other sense.
    phase0 : rad
        Rotational phase at t = 0.

    Returns
    -------
    (T, 3, 3)
        Body to inertial.

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, eq. (1), written for body to inertial.
    """
    cl, sl = jnp.cos(pole_lon), jnp.sin(pole_lon)
    cb, sb = jnp.cos(pole_lat), jnp.sin(pole_lat)
    # columns: the directions at zero rotational phase of the body axes
    tilt = jnp.array([[cl * sb, -sl, cl * cb], [sl * sb, cl, sl * cb], [-cb, 0.0 * sb, sb]])
    # Reduce to one turn first: over decades the phase reaches 10⁵ turns.
    turns = t / period
    phase = phase0 + 2 * jnp.pi * (turns - jax.lax.stop_gradient(jnp.floor(turns)))
    c, s = jnp.cos(phase), jnp.sin(phase)
    zero, one = jnp.zeros_like(c), jnp.ones_like(c)
    spin = jnp.stack(
        [
            jnp.stack([c, -s, zero], -1),
            jnp.stack([s, c, zero], -1),
            jnp.stack([zero, zero, one], -1),
        ],
        axis=-2,
    )
    return tilt @ spin


def fixed(t: jax.Array) -> jax.Array:
    """The body axes stay the inertial axes: A = I, (T, 3, 3)."""
    return jnp.broadcast_to(jnp.eye(3), (t.shape[0], 3, 3))


def to_body(rotation: jax.Array, vectors: jax.Array) -> jax.Array:
    """Components in the body frame of inertial vectors: Aᵀ v, (T, 3)."""
    return jnp.einsum("tij,ti->tj", rotation, vectors)
