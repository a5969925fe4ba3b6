"""The free rotation of a rigid body in closed form: no steps, and no error that grows with time.

Euler's equations are solved by Jacobi's elliptic functions, and the precession about the angular
momentum by the argument of a theta function. Their series in the nome converge like q^(n²), so a
dozen terms serve every body and every energy, and an epoch costs the same however late it is.

With M the angular momentum in principal axes, moments of inertia J₁ ≤ J₂ ≤ J₃, and a = 1/J₂ − 1/J₃,
b = 1/J₁ − 1/J₃, c = 1/J₁ − 1/J₂, M moves about axis 3 where c M₁² < a M₃², and about axis 1 where
it is greater (then 1 and 3 change their parts, and a, b, c their signs):

    M = (A₁ cn, A₂ sn, A₃ dn)(λt + u₀),   A₁² = M₁² + (a/b) M₂²,   A₂² = (b/a) A₁²,
    A₃² = M₃² + (c/b) M₂²,   λ = √(ab) A₃,   m = c A₁²/(a A₃²).

The azimuth ψ of the intermediate axis about M grows at L/J₂ − (a A₃² − c A₁²)/(L − (A₂²/L) sn²),
L = |M|: an elliptic integral of the third kind, whose periodic part is −arg θ₃(π(λt + u₀)/2K + iy).
Intermediate axis, and not that about which M moves: this one M never reaches but on the separatrix,
so that ψ has a meaning for a body that spins about an axis of largest or of smallest inertia.

References
----------
Landau & Lifshitz, Mechanics, secs. 36, 37; van Zon & Schofield 2007, J. Comput. Phys. 225, 145;
Whittaker & Watson, chs. 21, 22; Carlson 1995, Numer. Algorithms 10, 13 (elliptic integrals).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from lcbayes._jax import jax, jnp
from lcbayes.physics import attitude

TERMS = 12  # of a series in q^(n²): complete to 1e-16 up to q = 0.74, where 1 − m = 1e-13
NEAREST = 1e-13  # 1 − m is not taken smaller: closer to the separatrix no time is long enough
STEADY = 1e-10  # sine of the angle of M and ω below which the body spins about ω as if for good
DUPLICATIONS = 12
N = np.arange(1, TERMS)


class Polhode(NamedTuple):
    """The path of M in the body; scalars but for ``axes``.

    Attributes
    ----------
    axes : (3, 3)
        Rows: the axes in which the formulae are written, body frame.
    momentum : (3,)
        M at t = 0 along them.
    amplitude : (3,)
        A₁, A₂, A₃, the first and the last with the sign of M₃.
    m : parameter of the elliptic functions
    speed, phase : rad/s, rad
        x = speed · t + phase is π(λt + u₀)/2K.
    outer, inner : e^(−2y) and q e^(2y), of which the nome q is the product
    precession : mean dψ/dt, rad/s
    """

    axes: jax.Array
    momentum: jax.Array
    amplitude: jax.Array
    m: jax.Array
    speed: jax.Array
    phase: jax.Array
    outer: jax.Array
    inner: jax.Array
    precession: jax.Array

    @property
    def length(self) -> jax.Array:
        """|M|."""
        return jnp.linalg.norm(self.momentum)

    @property
    def nome(self) -> jax.Array:
        return self.outer * self.inner


def torque_free(t: jax.Array, omega: jax.Array, inertia: jax.Array) -> jax.Array:
    """Attitude of a rigid body on which no torque acts, A(0) = I.

    Ȧ = A [ω_b×], J ω̇_b = J ω_b × ω_b; the angular momentum A J ω_b stays as it is, and so does the
    energy, to rounding. Differentiable in ω and J, but not where two moments of inertia agree to
    rounding or where the spin is steady.

    Parameters
    ----------
    t : (T,) s
        Since the instant at which the body axes are the inertial axes.
    omega : (3,) rad/s
        Angular velocity at t = 0.
    inertia : (3, 3)
        Inertia tensor in body axes, symmetric, of any scale.

    Returns
    -------
    (T, 3, 3)
        Body to inertial.
    """
    t, omega, inertia = (jnp.asarray(x, float) for x in (t, omega, inertia))
    momentum = inertia @ omega
    sine = jnp.linalg.norm(jnp.cross(omega, momentum))
    scale = jnp.linalg.norm(omega) * jnp.linalg.norm(momentum)
    steady = sine <= STEADY * scale
    # what is not steady stands in for what is, so that no branch divides by zero
    some, other = jnp.array([1.0, 0.5, 0.7]), jnp.diag(jnp.array([1.0, 2.0, 3.0]))
    path = polhode(jnp.where(steady, some, omega), jnp.where(steady, other, inertia))
    return jnp.where(steady, attitude.constant_rate(t, omega), _turned(t, path))


def polhode(omega: jax.Array, inertia: jax.Array) -> Polhode:
    """The constants of the motion that begins with ω (3,) rad/s, body frame; see the module."""
    moments, principal = jnp.linalg.eigh(inertia)
    principal = principal * jnp.linalg.det(principal)  # right-handed
    momentum = principal.T @ (inertia @ omega)
    by1, by2, by3 = 1.0 / moments
    a, b, c = by2 - by3, by1 - by3, by1 - by2
    left, right = c * momentum[0] ** 2, a * momentum[2] ** 2
    about3 = (left < right) | ((left == right) & (a > c))
    swapped = jnp.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    axes = jnp.where(about3, jnp.eye(3), swapped) @ principal.T
    m1_, m2_, m3_ = momentum = axes @ (inertia @ omega)
    sign = jnp.where(about3, 1.0, -1.0)
    a, c = jnp.where(about3, a, c), jnp.where(about3, c, a)

    length = jnp.linalg.norm(momentum)
    ratio_a, ratio_c = a / b, c / b
    a1 = jnp.hypot(m1_, jnp.sqrt(ratio_a) * m2_)
    a2 = a1 / jnp.sqrt(ratio_a)
    a3 = jnp.sqrt(m3_**2 + ratio_c * m2_**2)
    m1 = jnp.maximum((a * m3_**2 - c * m1_**2) / (a * a3**2), NEAREST)
    speed = sign * jnp.sqrt(a * b) * a3

    side = jnp.sign(m3_)
    sn, cn, dn = m2_ / a2, side * m1_ / a1, side * m3_ / a3
    root_c = jnp.sqrt(ratio_c)
    zero, one = jnp.zeros(()), jnp.ones(())
    quarter, from_zero, inner, outer = carlson(
        jnp.stack([zero, jnp.abs(cn), a1, root_c]),
        jnp.stack([jnp.sqrt(m1), dn, a2, root_c * length / a3]),
        jnp.stack([one, one, length, one]),
    ) * jnp.stack([one, sn, a3, jnp.sqrt(ratio_a)])
    argument = jnp.where(cn >= 0.0, from_zero, 2.0 * quarter - from_zero)
    to_x = jnp.pi / (2.0 * quarter)
    inner, outer = jnp.exp(-2.0 * to_x * inner), jnp.exp(-2.0 * to_x * outer)
    up, down = _off_axis(inner, outer)
    # d ln θ₃(iy)/dy
    slope = jnp.sum(2.0 * N * (up - down)) / (1.0 + jnp.sum(up + down))
    precession = length * by2 - sign * a * a3**2 * m1 / length - speed * to_x * slope
    return Polhode(
        axes, momentum, jnp.stack([side * a1, a2, side * a3]), c * a1**2 / (a * a3**2),
        to_x * speed, to_x * argument, outer, inner, precession,
    )  # fmt: skip


def carlson(x: jax.Array, y: jax.Array, z: jax.Array) -> jax.Array:
    """Carlson's R_F(x², y², z²) = ½ ∫₀^∞ [(s + x²)(s + y²)(s + z²)]^(−½) ds, of roots >= 0.

    At most one of them zero. Roots, because what is known here are these, and a root has no
    derivative where its square is zero.

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


def _turned(t: jax.Array, path: Polhode) -> jax.Array:
    """A(t) of a motion that is not steady."""
    along, argument = _moved(path, t)
    psi = path.precession * t - (argument - _moved(path, jnp.zeros(1))[1])
    now = _triad(along, jnp.cos(psi), jnp.sin(psi))
    begin = _triad(path.momentum[:, None] / path.length, jnp.ones(1), jnp.zeros(1))
    first = path.axes.T @ begin[..., 0].T
    return jnp.einsum("ij,jkt,kl->til", first, now, path.axes)


def _moved(path: Polhode, t: jax.Array) -> tuple[jax.Array, jax.Array]:
    """M/|M| along the axes of the path (3, T), and arg θ₃(x + iy) (T,), which no turn winds up:
    θ₃ has no zero so near the real axis."""
    x = path.speed * t + path.phase
    x = x - jax.lax.stop_gradient(2.0 * jnp.pi * jnp.round(x / (2.0 * jnp.pi)))
    sin, cos = attitude.sin_cos(jnp.arange(1, 2 * TERMS)[:, None] * x)
    q = path.outer * path.inner
    flip = (-1.0) ** N
    even, odd = 2.0 * q ** (N**2), q ** (N**2 + N)
    null2, null3, null4 = 1.0 + jnp.sum(odd), 1.0 + jnp.sum(even), 1.0 + flip @ even
    # theta functions, the first two without 2 q^(1/4)
    theta1 = sin[0] + (flip * odd) @ sin[2::2]
    theta2 = cos[0] + odd @ cos[2::2]
    theta3 = 1.0 + even @ cos[1::2]
    theta4 = 1.0 + (flip * even) @ cos[1::2]
    cn_sn_dn = jnp.stack(
        [null4 / null2 * theta2, null3 / null2 * theta1, null4 / null3 * theta3]
    )  # times theta4
    along = path.amplitude[:, None] / path.length * cn_sn_dn / theta4
    up, down = _off_axis(path.inner, path.outer)
    return along, jnp.arctan2(-(up - down) @ sin[1::2], 1.0 + (up + down) @ cos[1::2])


def _off_axis(inner: jax.Array, outer: jax.Array) -> tuple[jax.Array, jax.Array]:
    """q^(n²) e^(2ny) and q^(n²) e^(−2ny) of n = 1 …, (TERMS − 1,) each."""
    q = inner * outer
    power = q ** (N**2 - N)
    return power * inner**N, power * (q * outer) ** N


def _triad(along: jax.Array, cos: jax.Array, sin: jax.Array) -> jax.Array:
    """Rows (3, 3, T): two inertial directions at right angles to M, and M's own, body components;
    the intermediate axis is at azimuth ψ."""
    n1, n2, n3 = along
    across = jnp.hypot(n1, n3)
    p = jnp.stack([-n2 * n1, across**2, -n2 * n3]) / across
    r = jnp.stack([-n3, jnp.zeros_like(n2), n1]) / across  # M × p
    return jnp.stack([cos * p - sin * r, sin * p + cos * r, along])
