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

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jax.custom_derivatives import SymbolicZero

from lcbayes._jax import jax, jnp
from lcbayes.physics import attitude

TERMS = 12  # of a series in q^(n²): complete to 1e-16 up to q = 0.74, where 1 − m = 1e-13
NEAREST = 1e-13  # 1 − m is not taken smaller: closer to the separatrix no time is long enough
STEADY = 1e-10  # sine of the angle of M and ω below which the body spins about ω as if for good
DUPLICATIONS = 12
N = np.arange(1, TERMS)
FLIP = (-1.0) ** N


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


class Motion(NamedTuple):
    """What decides the attitude; see the module and `Polhode`.

    Attributes
    ----------
    axes : (3, 3)
        Rows: the axes in which the formulae are written, body frame.
    scale : (3,)
        M/|M| along them over θ₂/θ₄, θ₁/θ₄, θ₃/θ₄.
    inner, outer, speed, phase, precession : as of `Polhode`
    """

    axes: jax.Array
    scale: jax.Array
    inner: jax.Array
    outer: jax.Array
    speed: jax.Array
    phase: jax.Array
    precession: jax.Array


def torque_free(t: jax.Array, omega: jax.Array, inertia: jax.Array) -> jax.Array:
    """Attitude of a rigid body on which no torque acts, A(0) = I.

    Ȧ = A [ω_b×], J ω̇_b = J ω_b × ω_b; the angular momentum A J ω_b stays as it is, and so does the
    energy, to rounding. Differentiable in t, ω and J, but not in J where two moments of inertia
    agree to rounding or where the spin is steady.

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
    t = jnp.asarray(t, float)
    steady, motion = _motion(omega, inertia)
    columns = tuple(jnp.broadcast_to(axis[:, None], (3, t.size)) for axis in jnp.eye(3))
    tumbling = jnp.stack([u.T for u in _turned(t, motion, columns)], axis=1)
    return jnp.where(steady, attitude.constant_rate(t, jnp.asarray(omega, float)), tumbling)


def torque_free_to_body(
    t: jax.Array, omega: jax.Array, inertia: jax.Array, *vectors: jax.Array
) -> tuple[jax.Array, ...]:
    """Components in the frame of a body on which no torque acts: those of `torque_free`.

    The derivative is written out: du = u × ψ with ψ (3,) linear in the changes of the constants of
    the motion, so that its coefficients are computed once for all directions; a Jacobian costs
    three times the value, where automatic differentiation of the series takes sixty.

    Parameters
    ----------
    t, omega, inertia
        As for `torque_free`.
    *vectors : (T, 3)
        Inertial, held fixed in derivatives.

    Returns
    -------
    tuple of (T, 3)
    """
    t = jnp.asarray(t, float)
    steady, motion = _motion(omega, inertia)
    columns = tuple(jnp.asarray(jax.lax.stop_gradient(v), float).T for v in vectors)
    still = attitude.constant_rate_to_body(t, jnp.asarray(omega, float), *vectors)
    turned = _turned(t, motion, columns)
    return tuple(jnp.where(steady, s, u.T) for s, u in zip(still, turned, strict=True))


def _motion(omega: jax.Array, inertia: jax.Array) -> tuple[jax.Array, Motion]:
    """Whether the body spins steadily, and its motion if it does not."""
    omega, inertia = (jnp.asarray(x, float) for x in (omega, inertia))
    momentum = inertia @ omega
    sine = jnp.linalg.norm(jnp.cross(omega, momentum))
    scale = jnp.linalg.norm(omega) * jnp.linalg.norm(momentum)
    steady = sine <= STEADY * scale
    # what is not steady stands in for what is, so that no branch divides by zero
    some, other = jnp.array([1.0, 0.5, 0.7]), jnp.diag(jnp.array([1.0, 2.0, 3.0]))
    path = polhode(jnp.where(steady, some, omega), jnp.where(steady, other, inertia))
    _, null2, null3, null4, *_ = jnp.sum(_terms(path.inner, path.outer), axis=1)
    null = jnp.stack([null4 / null2, null3 / null2, null4 / null3])
    return steady, Motion(
        path.axes, path.amplitude / path.length * null, path.inner, path.outer, path.speed,
        path.phase, path.precession,
    )  # fmt: skip


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
    *_, real, imaginary = _terms(inner, outer)
    slope = -2.0 * N @ imaginary[1:] / jnp.sum(real)  # d ln θ₃(iy)/dy
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


@jax.custom_jvp
def _turned(t: jax.Array, motion: Motion, columns: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """Inertial vectors (3, T) in the body's frame: Σᵢ fᵢ(t) (fᵢ(0)·v), fᵢ the rows of `_triad`."""
    return _turn(t, motion, columns)[0]


@partial(_turned.defjvp, symbolic_zeros=True)
def _turned_jvp(primals, tangents):
    """du = u × ψ, ψ = Aᵀ w(0) − w(t), w the angle by which `_triad` turns, body frame.

    w = a + n × dn − (dψ + n₂ (dn·r)/|e₂ × n|) n with a that of the axes, n = M/|M|, and r = n × p
    as in `_triad`, whose p leaves e₂ as n turns.
    """
    t, motion, _ = primals
    dt, changed, _ = tangents
    turned, n, frame = _turn(*primals)
    n1, n2, n3 = n
    lean = n2 / (n1**2 + n3**2)

    def turn(dn, d_azimuth):
        return attitude.cross(n, dn) - (d_azimuth + lean * (n1 * dn[2] - n3 * dn[0])) * n

    since = _since(t)
    ratio, along, argument = _slopes(since, motion)
    after = argument - argument[:, -1:]
    by_phase = turn(along[2], -argument[2])
    slopes = [
        *(turn(ratio * row[:, None], jnp.zeros_like(n2)) for row in np.eye(3)),
        turn(along[0], -after[0]),
        turn(along[1], -after[1]),
        since * by_phase,
        turn(along[2], -after[2]),
        -since * n,
    ]  # of w by scale, inner, outer, speed, phase and precession, along the axes of the motion
    w = jnp.einsum("ia,kit->kat", motion.axes, jnp.stack(slopes))
    w = jnp.concatenate([w, jnp.broadcast_to(jnp.eye(3)[..., None], (3, *n.shape))])  # and by a
    begin = jnp.einsum("ia,ka->ki", frame[..., -1], w[..., -1])
    basis = jnp.einsum("iat,ki->kat", frame[..., :-1], begin) - w[..., :-1]
    basis = jax.lax.optimization_barrier(basis)
    change = jnp.concatenate(
        [
            *(jnp.ravel(_filled(x)) for x in changed[1:]),
            0.5 * jnp.sum(jnp.cross(motion.axes, _filled(changed.axes)), axis=0),
        ]
    )
    psi = jnp.tensordot(change, basis, 1)
    if not isinstance(dt, SymbolicZero):
        now = motion.speed * by_phase - motion.precession * n
        psi = psi - motion.axes.T @ now[:, :-1] * dt
    return turned, tuple(attitude.cross(u, psi) for u in turned)


def _filled(tangent: jax.Array | SymbolicZero) -> jax.Array:
    return jnp.zeros(tangent.shape) if isinstance(tangent, SymbolicZero) else tangent


def _since(t: jax.Array) -> jax.Array:
    """The times (T,), and t = 0 for the last."""
    return jnp.concatenate([t, jnp.zeros(1)])


def _turn(
    t: jax.Array, motion: Motion, columns: tuple[jax.Array, ...]
) -> tuple[tuple[jax.Array, ...], jax.Array, jax.Array]:
    """The turned columns; M/|M| along the axes of the motion (3, T + 1) and `_triad`, body frame,
    (3, 3, T + 1), both with t = 0 for the last epoch."""
    since = _since(t)
    ((theta1, theta2, theta3, theta4, real, imaginary),) = _sums(
        _phase(since, motion), [_terms(motion.inner, motion.outer)]
    )
    along = motion.scale[:, None] * jnp.stack([theta2, theta1, theta3]) / theta4
    argument = jnp.arctan2(imaginary, real)
    azimuth = motion.precession * since - (argument - argument[-1])
    along, azimuth = jax.lax.optimization_barrier((along, azimuth))
    triad = _triad(along, *attitude.sin_cos(azimuth))
    frame = jnp.einsum("ikt,ka->iat", triad, motion.axes)
    first = frame[..., -1]
    turned = tuple(jnp.einsum("iat,it->at", frame[..., :-1], first @ v) for v in columns)
    return turned, along, frame


def _slopes(since: jax.Array, motion: Motion) -> tuple[jax.Array, jax.Array, jax.Array]:
    """M/|M| over `Motion.scale` (3, T), and the derivatives by inner, outer and phase of M/|M|
    (3, 3, T) and of arg θ₃(x + iy) (3, T)."""
    terms, by_inner = jax.jvp(partial(_terms, outer=motion.outer), (motion.inner,), (jnp.ones(()),))
    _, by_outer = jax.jvp(partial(_terms, motion.inner), (motion.outer,), (jnp.ones(()),))
    sums, *by = _sums(_phase(since, motion), [terms, by_inner, by_outer], by_phase=True)
    (*first, theta4, real, imaginary) = sums
    first = jnp.stack([first[1], first[0], first[2]])
    ratio, scale = first / theta4, motion.scale[:, None]
    along, argument = [], []
    for d in by:
        d_first = jnp.stack([d[1], d[0], d[2]])
        along.append(scale * (d_first - ratio * d[3]) / theta4)
        argument.append((real * d[5] - imaginary * d[4]) / (real**2 + imaginary**2))
    return ratio, jnp.stack(along), jnp.stack(argument)


def _phase(t: jax.Array, motion: Motion) -> jax.Array:
    x = motion.speed * t + motion.phase
    return x - jax.lax.stop_gradient(2.0 * jnp.pi * jnp.round(x / (2.0 * jnp.pi)))


def _terms(inner: jax.Array, outer: jax.Array) -> jax.Array:
    """Coefficients of the six series of `_sums`, (6, TERMS)."""
    q = inner * outer
    power = q ** (N**2 - N)
    even, odd = 2.0 * q ** (N**2), q ** (N**2 + N)
    up, down = power * inner**N, power * (q * outer) ** N  # q^(n²) e^(2ny), q^(n²) e^(−2ny)
    rows = jnp.stack([FLIP * odd, odd, even, FLIP * even, up + down, down - up])
    return jnp.concatenate([jnp.array([[1.0]] * 5 + [[0.0]]), rows], axis=1)


def _sums(
    x: jax.Array, terms: Sequence[jax.Array], by_phase: bool = False
) -> list[tuple[jax.Array, ...]]:
    """θ₁ and θ₂ over 2 q^(1/4), θ₃, θ₄, and Re and Im of θ₃(x + iy), (T,) each, of each array of
    coefficients; with ``by_phase`` the derivatives by x of the first at the end.

    θ₁ = Σ aₙ sin (2n + 1)x, θ₂ = Σ aₙ cos (2n + 1)x, the next three Σ aₙ cos 2nx, Im Σ aₙ sin 2nx,
    by Clenshaw's recurrence in u = 2 cos 2x: an addition and a product for each term, where a table
    of sines and cosines costs ten times as much.
    """
    if by_phase:
        n = 2.0 * np.arange(TERMS)
        terms = [*terms, jnp.stack([n + 1.0, n + 1.0, n, n, n, n]) * terms[0]]
    rows = jnp.stack(list(terms))[..., None]
    # Barriers keep XLA from computing what comes before anew in every place that uses it.
    sin, cos = jax.lax.optimization_barrier(attitude.sin_cos(x))
    sin2, cos2 = jax.lax.optimization_barrier((2.0 * sin * cos, (cos - sin) * (cos + sin)))
    b0 = b1 = jnp.zeros((*rows.shape[:2], x.size))
    for n in range(TERMS - 1, -1, -1):
        b0, b1 = rows[:, :, n] + 2.0 * cos2 * b0 - b1, b0
    b0, b1 = jax.lax.optimization_barrier((b0, b1))
    one, two = sin * (b0 + b1), cos * (b0 - b1)
    whole, half = b0 - cos2 * b1, sin2 * b1
    sums = [
        (one[k, 0], two[k, 1], whole[k, 2], whole[k, 3], whole[k, 4], half[k, 5])
        for k in range(len(rows) - by_phase)
    ]
    if by_phase:
        one, two = cos * (b0[-1, 0] - b1[-1, 0]), -sin * (b0[-1, 1] + b1[-1, 1])
        sums.append((one, two, -half[-1, 2], -half[-1, 3], -half[-1, 4], whole[-1, 5]))
    return sums


def _triad(along: jax.Array, sin: jax.Array, cos: jax.Array) -> jax.Array:
    """Rows (3, 3, T): two inertial directions at right angles to M, and M's own, along the axes of
    the motion; the intermediate axis is at the azimuth of this sine and cosine."""
    n1, n2, n3 = along
    across = jnp.hypot(n1, n3)
    p = jnp.stack([-n2 * n1, across**2, -n2 * n3]) / across
    r = jnp.stack([-n3, jnp.zeros_like(n2), n1]) / across  # M × p
    return jnp.stack([cos * p - sin * r, sin * p + cos * r, along])
