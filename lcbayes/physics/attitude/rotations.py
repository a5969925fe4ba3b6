"""Rotations: directions of the body axes at each time.

Every law returns A (T, 3, 3), which maps body to inertial components; `to_body` applies its
transpose, the A of Hinks et al.
"""

from __future__ import annotations

from functools import partial

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.tangents import present

type Scalar = jax.Array | float


def constant_rate(t: jax.Array, omega: jax.Array) -> jax.Array:
    """Rotation at a constant angular velocity, A = exp([ω×] t), A(0) = I.

    Parameters
    ----------
    t : (T,) s
        Time since the body axes coincided with the inertial axes.
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
    a, b, _ = _rodrigues(t, omega)
    x, y, z = omega
    zero = jnp.zeros_like(x)
    cross = jnp.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]])
    eye = jnp.eye(3, dtype=cross.dtype)
    return eye + a[:, None, None] * cross + b[:, None, None] * (cross @ cross)


def constant_rate_to_body(
    t: jax.Array, omega: jax.Array, *vectors: jax.Array
) -> tuple[jax.Array, ...]:
    """Components in the frame of a body that rotates at a constant rate, u = exp(−[ω×] t) v.

    Equivalent to `to_body` of `constant_rate`, but including the derivative at a third of the cost.
    The derivative is written out: du = u × ψ + exp(−[ω×] t) dv with ψ = t J(ωt) dω + ω dt, where J
    is the right Jacobian of the rotation vector. The gradient of a function of u by ω is therefore
    the sum over time of its torques u × ∂f/∂u, multiplied by t Jᵀ.

    Parameters
    ----------
    t : (T,) s
    omega : (3,) rad/s
        Inertial.
    *vectors : (T, 3)
        Inertial.

    Returns
    -------
    tuple of (T, 3)

    References
    ----------
    Linares & Crassidis, sec. II; Chirikjian 2012, Stochastic Models, Information Theory and Lie
    Groups 2, sec. 10.6 (J).
    """
    t, *columns = (jnp.asarray(x).T for x in (t, *vectors))  # (3, T): the long axis is inner
    return tuple(u.T for u in _turned(t, omega, tuple(columns)))


@jax.custom_jvp
def _turned(
    t: jax.Array, omega: jax.Array, columns: tuple[jax.Array, ...]
) -> tuple[jax.Array, ...]:
    return _turn(t, omega, columns)[0]


@partial(_turned.defjvp, symbolic_zeros=True)
def _turned_jvp(primals, tangents):
    return _turned_and_change(*primals, *present(tangents))


@jax.jit
def _turned_and_change(t, omega, columns, dt, d_omega, d_columns):
    """The rotated columns and their change; tangents that are zero are None."""
    turned, (a, b, c) = _turn(t, omega, columns)
    psi = jnp.zeros_like(turned[0])
    if d_omega is not None:
        once = jnp.cross(omega, d_omega)
        basis = jnp.stack([d_omega, -once, jnp.cross(omega, once)])
        psi = basis.T @ jnp.stack([t, b, c])
    if dt is not None:
        psi = psi + omega[:, None] * dt
    change = [cross(u, psi) for u in turned]
    for k, dv in enumerate(d_columns):
        if dv is not None:
            change[k] = change[k] + _rotated(dv, omega, a, b)
    return turned, tuple(change)


@jax.jit  # traced once, not at each of the hundreds of times that a model is
def _turn(t, omega, columns):
    """The rotated columns, and the functions of the angles required by the derivative."""
    # The barriers prevent XLA from recomputing the angles at each use.
    a, b, c = jax.lax.optimization_barrier(_rodrigues(t, omega))
    turned = tuple(_rotated(v, omega, a, b) for v in columns)
    return jax.lax.optimization_barrier(turned), (a, b, c)


def _rotated(v, omega, a, b):
    once = cross(omega, v)
    return v - a * once + b * cross(omega, once)


def _rodrigues(t, omega):
    """sin θ/|ω|, (1 − cos θ)/|ω|² and (θ − sin θ)/|ω|³ with θ = |ω| t, smooth at ω = 0; (T,)."""
    theta2 = jnp.sum(omega**2) * t**2
    small = theta2 < 1e-8
    square = jnp.where(small, 1.0, theta2)
    theta = jnp.sqrt(square)
    (sin, cos), by_square = sin_cos(theta), 1.0 / square
    a = jnp.where(small, 1.0 - theta2 / 6.0, sin / theta)
    b = jnp.where(small, 0.5 - theta2 / 24.0, (1.0 - cos) * by_square)
    c = jnp.where(small, 1.0 / 6.0 - theta2 / 120.0, (1.0 - sin / theta) * by_square)
    return a * t, b * t**2, c * t**3


# π/2 in three parts of 33 bits: n times each of the first two is exact up to n = 2²⁰.
_QUARTER = (1.57079632673412561417, 6.07710050630396597660e-11, 2.02226624871116645580e-21)


def sin_cos(x):
    """Sine and cosine to 2e-16 for |x| < 10⁶, without a branch.

    XLA calls the C library for each number separately. These products are vectorised and reduce the
    cost of the rotation of the body, a quarter of that of a gradient, to a third. Taylor series on
    (−π/4, π/4) are used after the multiple of π/2 is subtracted in parts (Cody & Waite).
    """
    n = jnp.round(x * (2.0 / jnp.pi))
    r = x
    for part in _QUARTER:
        r = r - n * part
    y = r * r
    sin, cos = jnp.zeros_like(r), jnp.zeros_like(r)
    for k in range(8, 0, -1):
        cos = (1.0 + cos) * (-1.0 / ((2 * k - 1) * (2 * k))) * y
        sin = (1.0 + sin) * (-1.0 / ((2 * k) * (2 * k + 1))) * y
    sin, cos = r * (1.0 + sin), 1.0 + cos
    quarter = n.astype(int)
    odd = (quarter & 1) == 1
    sin, cos = jnp.where(odd, cos, sin), jnp.where(odd, sin, cos)
    return (
        jnp.where((quarter & 2) == 2, -sin, sin),
        jnp.where(((quarter + 1) & 2) == 2, -cos, cos),
    )


def cross(a, b):
    """a × b, (3,) or (3, T): the long axis is the inner one."""
    return jnp.stack(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


def principal_axis(
    t: jax.Array, pole_lon: Scalar, pole_lat: Scalar, period: Scalar, phase0: Scalar
) -> jax.Array:
    """Rotation about the body's z axis, which points to the pole: the asteroid convention.

    A = R_z(λ) R_y(π/2 − β) R_z(φ₀ + 2πt/P).

    Parameters
    ----------
    t : (T,) s
        Time since the epoch of ``phase0``.
    pole_lon, pole_lat : rad
        Pole in the frame of the inertial vectors.
    period : s
        Sidereal rotation period; negative for the opposite sense of rotation.
    phase0 : rad
        Rotational phase at t = 0.

    Returns
    -------
    (T, 3, 3)
        Body to inertial.

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, eq. (1), from body to inertial.
    """
    cl, sl = jnp.cos(pole_lon), jnp.sin(pole_lon)
    cb, sb = jnp.cos(pole_lat), jnp.sin(pole_lat)
    # columns: directions of the body axes at zero rotational phase
    tilt = jnp.array([[cl * sb, -sl, cl * cb], [sl * sb, cl, sl * cb], [-cb, 0.0 * sb, sb]])
    return spinning(t, tilt, period, phase0)


def spinning(t: jax.Array, tilt: jax.Array, period: Scalar, phase0: Scalar = 0.0) -> jax.Array:
    """Rotation (T, 3, 3), body to inertial, about the body's z axis: A = tilt R_z(φ₀ + 2πt/P)."""
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


def brought_to(pole: jax.Array) -> jax.Array:
    """Axes (3, 3), as columns, with z along the pole.

    They are the inertial y, z and x axes after the smallest rotation that brings x to the pole.
    Axes defined by longitude and latitude rotate about z as the pole moves around a latitude of
    ±90°, near which the poles of many asteroids lie. Any such definition is singular somewhere;
    this one at (180°, 0°).

    Parameters
    ----------
    pole : (3,)
        Unit vector, inertial.

    References
    ----------
    Duff et al. 2017, J. Comput. Graph. Tech. 6 (1), eq. (2), with cyclically permuted axes.
    """
    x, y, z = pole[0], pole[1], pole[2]
    a = 1.0 / jnp.maximum(1.0 + x, 1e-12)
    first = jnp.array([-y, 1.0 - a * y * y, -a * y * z])
    return jnp.stack([first, jnp.array([-z, -a * y * z, 1.0 - a * z * z]), pole], axis=-1)


def fixed(t: jax.Array) -> jax.Array:
    """The body axes remain the inertial axes: A = I, (T, 3, 3)."""
    return jnp.broadcast_to(jnp.eye(3), (t.shape[0], 3, 3))


def to_body(rotation: jax.Array, vectors: jax.Array) -> jax.Array:
    """Body-frame components of inertial vectors: Aᵀ v, (T, 3)."""
    return jnp.einsum("tij,ti->tj", rotation, vectors)
