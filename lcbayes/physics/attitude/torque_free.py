"""The free rotation of a rigid body in closed form: no steps, and no error that grows with time.

Euler's equations are solved by Jacobi's elliptic functions, and the precession about the angular
momentum by the argument of a theta function. Their series in the nome converge like q^(n²), and
where q > e^(−π) those in its complement q' = e^(−πK/K'), of hyperbolic functions: four terms serve
every body and every energy, and an epoch costs the same however late it is.

With M the angular momentum in principal axes, moments of inertia J₁ ≤ J₂ ≤ J₃, and a = 1/J₂ − 1/J₃,
b = 1/J₁ − 1/J₃, c = 1/J₁ − 1/J₂, M moves about axis 3 where c M₁² < a M₃², and about axis 1 where
it is greater (then 1 and 3 change their parts, and a, b, c their signs):

    M = (A₁ cn, A₂ sn, A₃ dn)(K + v),   v = λt + v₀,   A₁² = M₁² + (a/b) M₂²,   A₂² = (b/a) A₁²,
    A₃² = M₃² + (c/b) M₂²,   λ = √(ab) A₃,   m = c A₁²/(a A₃²),   1 − m = (a M₃² − c M₁²)/(a A₃²).

The azimuth ψ of the intermediate axis about M grows at L/J₂ − (a A₃² − c A₁²)/(L − (A₂²/L) sn²),
L = |M|: an elliptic integral of the third kind, whose periodic part is −arg θ₄(z + iy), z = πv/2K.
Intermediate axis, and not that about which M moves: this one M never reaches but on the separatrix,
so that ψ has a meaning for a body that spins about an axis of largest or of smallest inertia. v = 0
where M is next to the intermediate axis: there ψ has to have the direction in which M lies off it.

With q' the same, by Jacobi's imaginary transformation, w = zK/K', y' = yK/K': θ₁, θ₂, θ₃, θ₄ of z
are as −iθ₁, θ₄, θ₃, θ₂ of iw, and arg θ₄(z + iy) is arg θ₂(iw − y') − 2zy'/π, for |z| <= π/2; from
one such stretch, a passage by the intermediate axis, to the next, ψ jumps by −2y'.

Next to the separatrix a passage lasts as long as e, the part of M off the intermediate axis, takes
to grow to 1 as e^(λt): an error of ω, J or their rounding grows so too, and none other does.

References
----------
Landau & Lifshitz, Mechanics, secs. 36, 37; van Zon & Schofield 2007, J. Comput. Phys. 225, 145;
Whittaker & Watson, chs. 21 (21.51: q'), 22; Carlson 1995, Numer. Algorithms 10, 13 (elliptic
integrals).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jax.custom_derivatives import SymbolicZero

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations

TERMS = 4  # of a series in q^(n²): complete to 1e-16 up to q = e^(−π)
# Closer than these double precision cannot say when M flips.
NEAREST = 1e-16  # 1 − m over dn² at t = 0: a difference of squares of M, whose rounding it is
STEADY = 1e-14  # sine of the angle of M and ω below which ω stays; rounding of J makes it 1e-15
DUPLICATIONS = 12
ALL = np.arange(TERMS)
N = ALL[1:]
FLIP = (-1.0) ** ALL


class Polhode(NamedTuple):
    """The path of M in the body; scalars but for ``axes``.

    Attributes
    ----------
    axes : (3, 3)
        Rows: the axes in which the formulae are written, body frame.
    momentum : (3,)
        M at t = 0 along them.
    amplitude : (3,)
        A₁, A₂, A₃, with the signs of M₂ M₃, M₂ and M₃.
    m1 : 1 − m, m the parameter of the elliptic functions
    near : m > ½, so that the series are those in q'
    speed, phase : rad/s, rad
        speed · t + phase is z, of the module, or w where ``near``.
    inner, outer : exponents
        Of the nome q = e^(−2 (inner + outer)), outer = y; where ``near`` ½ ln 1/q' and π/2 − y'.
        These, because 1 − q e^(2y) and cos y' may be as small as the rounding of 1.
    precession : rad/s
        Mean dψ/dt; where ``near`` without the jumps.
    """

    axes: jax.Array
    momentum: jax.Array
    amplitude: jax.Array
    m1: jax.Array
    near: jax.Array
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
        M/|M| along them over θ₁/θ₃, θ₂/θ₃, θ₄/θ₃ of z, or their equals in w.
    inner, outer, speed, phase, precession, near : as of `Polhode`
    """

    axes: jax.Array
    scale: jax.Array
    inner: jax.Array
    outer: jax.Array
    speed: jax.Array
    phase: jax.Array
    precession: jax.Array
    near: jax.Array


def torque_free(t: jax.Array, omega: jax.Array, inertia: jax.Array) -> jax.Array:
    """Attitude of a rigid body on which no torque acts, A(0) = I.

    Ȧ = A [ω_b×], J ω̇_b = J ω_b × ω_b; the angular momentum A J ω_b stays as it is, and so does the
    energy, to rounding. Differentiable in t, ω and J, but not in J where two moments of inertia
    agree to rounding, and as a steady spin where the angle of M and ω is below `STEADY`; about the
    intermediate axis such a spin stays for some 30/λ, λ the module's, and what follows is not told.

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
    return jnp.where(steady, rotations.constant_rate(t, jnp.asarray(omega, float)), tumbling)


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
    still = rotations.constant_rate_to_body(t, jnp.asarray(omega, float), *vectors)
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
    terms, _ = _terms(path.inner, path.outer, path.near)
    _, null2, null3, null4, *_ = jnp.sum(terms, axis=1)
    # θ₂ is over 2 q^(1/4), and so is θ₁, whence √q' is left
    root = 4.0 * jnp.exp(-path.inner)
    low = jnp.where(path.near, root * null2, null4)
    high = jnp.where(path.near, null4, null2)
    null = jnp.stack([-low / high, null3 / high, low / null3])
    return steady, Motion(
        path.axes,
        path.amplitude / path.length * null,
        path.inner,
        path.outer,
        path.speed,
        path.phase,
        path.precession,
        path.near,
    )


def polhode(omega: jax.Array, inertia: jax.Array) -> Polhode:
    """The constants of the motion that begins with ω (3,) rad/s, body frame; see the module."""
    moments, principal = jnp.linalg.eigh(inertia)
    principal = principal * jnp.linalg.det(principal)  # right-handed
    momentum = principal.T @ (inertia @ omega)
    j1, j2, j3 = moments
    a, c = (j3 - j2) / (j2 * j3), (j2 - j1) / (j1 * j2)
    b = a + c
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
    side, side2 = jnp.where(m3_ < 0.0, -1.0, 1.0), jnp.where(m2_ < 0.0, -1.0, 1.0)
    sn, cn, dn = side2 * m2_ / a2, side * side2 * m1_ / a1, side * m3_ / a3  # at t = 0
    # in factors, because 1 − m may be 10¹⁶ times less than either square
    root_a, root_c = jnp.sqrt(a), jnp.sqrt(c)
    off, other = root_a * m3_, root_c * m1_
    m1 = jnp.maximum((off - other) * (off + other) / (a * a3**2), NEAREST * dn**2)
    root = jnp.sqrt(m1)
    near = m1 < 0.5

    root_c = jnp.sqrt(ratio_c)
    zero, one = jnp.zeros(()), jnp.ones(())
    quarter, v, inner, outer = carlson(
        jnp.stack([zero, root * sn, a1, root_c]),
        jnp.stack([root, root, a2, root_c * length / a3]),
        jnp.stack([one, dn, length, one]),
    ) * jnp.stack([one, -cn, a3, jnp.sqrt(ratio_a)])
    scale = jnp.pi / (2.0 * jnp.where(near, inner + outer, quarter))  # the sum is K'
    inner, outer = (scale * jnp.where(near, *x) for x in ((quarter, inner), (inner, outer)))
    speed = sign * jnp.sqrt(a * b) * a3 * scale
    real, imaginary = _real_imaginary(inner, outer, near)
    slope = -2.0 * N @ imaginary / (1.0 + jnp.sum(real))  # d ln θ₃/dy at iy, or by y' at y'
    precession = length / j2 - sign * a * a3**2 * m1 / length - speed * slope
    return Polhode(
        axes,
        momentum,
        jnp.stack([side * side2 * a1, side2 * a2, side * a3]),
        m1,
        near,
        speed,
        scale * v,
        outer,
        inner,
        precession,
    )


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
        return rotations.cross(n, dn) - (d_azimuth + lean * (n1 * dn[2] - n3 * dn[0])) * n

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
            *(jnp.ravel(_filled(x)) for x in changed[1:-1]),
            0.5 * jnp.sum(jnp.cross(motion.axes, _filled(changed.axes)), axis=0),
        ]
    )
    psi = jnp.tensordot(change, basis, 1)
    if not isinstance(dt, SymbolicZero):
        now = motion.speed * by_phase - motion.precession * n
        psi = psi - motion.axes.T @ now[:, :-1] * dt
    return turned, tuple(rotations.cross(u, psi) for u in turned)


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
    phase, passages = _phase(since, motion)
    ((*first, last, real, imaginary),) = _sums(
        phase, [_terms(motion.inner, motion.outer, motion.near)], motion.near
    )
    along = motion.scale[:, None] * _signed(first, passages) / last
    jump = jnp.where(motion.near, jnp.pi - 2.0 * motion.outer, 0.0)
    argument = jnp.arctan2(imaginary, real) + jump * passages
    azimuth = motion.precession * since - (argument - argument[-1])
    along, azimuth = jax.lax.optimization_barrier((along, azimuth))
    triad = _triad(along, *rotations.sin_cos(azimuth))
    frame = jnp.einsum("ikt,ka->iat", triad, motion.axes)
    first = frame[..., -1]
    turned = tuple(jnp.einsum("iat,it->at", frame[..., :-1], first @ v) for v in columns)
    return turned, along, frame


def _slopes(since: jax.Array, motion: Motion) -> tuple[jax.Array, jax.Array, jax.Array]:
    """M/|M| over `Motion.scale` (3, T), and the derivatives by inner, outer and phase of M/|M|
    (3, 3, T) and of the argument of the theta function with its jumps (3, T)."""
    near, unit = motion.near, jnp.ones(())
    terms, by_inner = jax.jvp(lambda x: _terms(x, motion.outer, near), (motion.inner,), (unit,))
    _, by_outer = jax.jvp(lambda x: _terms(motion.inner, x, near), (motion.outer,), (unit,))
    phase, passages = _phase(since, motion)
    sums, *by = _sums(phase, [terms, by_inner, by_outer], near, slope=True)
    (*first, last, real, imaginary) = sums
    ratio, scale = _signed(first, passages) / last, motion.scale[:, None]
    along, argument = [], []
    for d in by:
        along.append(scale * (_signed(d[:3], passages) - ratio * d[3]) / last)
        argument.append((real * d[5] - imaginary * d[4]) / (real**2 + imaginary**2))
    shift = jnp.where(near, -2.0 * passages, 0.0)  # of the phase by inner, and of ψ by outer
    along[0] += shift * along[2]
    argument[0] += shift * argument[2]
    argument[1] += shift
    return ratio, jnp.stack(along), jnp.stack(argument)


def _phase(t: jax.Array, motion: Motion) -> tuple[jax.Array, jax.Array]:
    """z in (−π/2, π/2), or w in (−½, ½) ln 1/q', and how many such stretches were taken off."""
    x = motion.speed * t + motion.phase
    whole = jnp.where(motion.near, 2.0 * motion.inner, jnp.pi)
    passages = jax.lax.stop_gradient(jnp.round(x / whole))
    return x - whole * passages, passages


def _signed(first: Sequence[jax.Array], passages: jax.Array) -> jax.Array:
    """The three (3, T), of which two change sign from one passage to the next."""
    sign = 1.0 - 2.0 * jnp.abs(passages - 2.0 * jnp.round(0.5 * passages))
    return jnp.stack([sign * first[0], sign * first[1], first[2]])


def _real_imaginary(
    inner: jax.Array, outer: jax.Array, near: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """2 q^(n²) cosh 2ny and −2 q^(n²) sinh 2ny, n >= 1, or 2 q'^(n²) times cos and sin of 2ny'."""
    half = jnp.where(near, inner, inner + outer)  # ½ ln 1/q or 1/q'
    up = jnp.exp(-2.0 * N * ((N - 1.0) * half + inner))  # q^(n²) e^(2ny); q'^(n²) where near
    down = jnp.exp(-2.0 * N * (N * half + outer))  # q^(n²) e^(−2ny)
    angle = 2.0 * N * outer  # outer = π/2 − y'
    return (
        jnp.where(near, 2.0 * FLIP[1:] * up * jnp.cos(angle), up + down),
        jnp.where(near, -2.0 * FLIP[1:] * up * jnp.sin(angle), down - up),
    )


def _terms(inner: jax.Array, outer: jax.Array, near: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Coefficients of the six series of `_sums`, (6, TERMS), and θ₄(iy)."""
    half = jnp.where(near, inner, inner + outer)
    odd = jnp.exp(-2.0 * (ALL**2 + ALL) * half)
    even = jnp.where(ALL == 0, 1.0, 2.0) * jnp.exp(-2.0 * ALL**2 * half)
    angle = (2.0 * ALL + 1.0) * outer
    real, imaginary = (FLIP[1:] * x for x in _real_imaginary(inner, outer, near))
    rest = jnp.append(jnp.cumsum(real[::-1])[::-1], 0.0)  # cos 2nx − cos (2n + 2)x has sin x
    real = jnp.where(near, FLIP * odd * jnp.sin(angle), rest)
    imaginary = jnp.where(near, FLIP * odd * jnp.cos(angle), jnp.append(0.0, imaginary))
    pairs = -jnp.expm1(-2.0 * (2.0 * ALL + 1.0) * inner)  # n and −1 − n: they all but cancel
    origin = jnp.sum(FLIP * jnp.exp(-2.0 * ALL * (ALL * half + outer)) * pairs)
    return jnp.stack([FLIP * odd, odd, even, FLIP * even, real, imaginary]), origin


def _sums(
    x: jax.Array, terms: Sequence[tuple[jax.Array, jax.Array]], near: jax.Array, slope: bool = False
) -> list[tuple[jax.Array, ...]]:
    """θ₁ and θ₂ over 2 q^(1/4), θ₄, θ₃, and Re and Im of θ₄(x + iy), (T,) each, of each of
    ``terms``; with ``slope`` the derivatives by x of the first at the end. Where ``near`` −iθ₁, θ₄,
    θ₂, θ₃ of ix and Re and Im of θ₂(ix − y'): each means what it does elsewhere.

    θ₁ = Σ aₙ sin (2n + 1)x, θ₂ = Σ aₙ cos (2n + 1)x, θ₃ and θ₄ Σ aₙ cos 2nx, Im Σ aₙ sin 2nx, Re
    θ₄(iy) − 2 sin x Σ aₙ sin (2n + 1)x, which is small without being a difference; where ``near``
    sinh and cosh, Re Σ aₙ cosh (2n + 1)x and Im Σ aₙ sinh (2n + 1)x. By Clenshaw's recurrence in
    u = 2 cos 2x: an addition and a product for each term, where a table of sines and cosines costs
    ten times as much.
    """
    tables = [table for table, _ in terms]
    if slope:
        even, odd, table = 2.0 * ALL, 2.0 * ALL + 1.0, tables[0]
        real = jnp.where(near, odd * table[4], even * (jnp.roll(table[4], 1) - table[4]))
        imaginary = jnp.where(near, odd, even) * table[5]
        by = jnp.stack([odd, odd, even, even]) * table[:4]
        tables.append(jnp.concatenate([by, jnp.stack([real, imaginary])]))
    rows = jnp.stack(tables)[..., None]
    # Barriers keep XLA from computing what comes before anew in every place that uses it.
    sin, cos = rotations.sin_cos(x)
    back, up = jnp.where(near, -1.0, 1.0), jnp.exp(x)
    sin = jnp.where(near, 0.5 * (up - 1.0 / up), sin)
    cos = jnp.where(near, 0.5 * (up + 1.0 / up), cos)
    sin, cos = jax.lax.optimization_barrier((sin, cos))
    sin2, cos2 = jax.lax.optimization_barrier((2.0 * sin * cos, cos**2 - back * sin**2))
    b0 = b1 = jnp.zeros((*rows.shape[:2], x.size))
    for n in range(TERMS - 1, -1, -1):
        b0, b1 = rows[:, :, n] + 2.0 * cos2 * b0 - b1, b0
    b0, b1 = jax.lax.optimization_barrier((b0, b1))
    odd_sin, odd_cos = sin * (b0 + b1), cos * (b0 - b1)
    even_sin, even_cos = sin2 * b1, b0 - cos2 * b1
    sums = []
    for k, (_, origin) in enumerate(terms):
        s, c, e = odd_sin[k], odd_cos[k], even_cos[k]
        real = jnp.where(near, c[4], origin - 2.0 * sin * s[4])
        imaginary = jnp.where(near, s[5], even_sin[k, 5])
        second, third = jnp.where(near, e[3], c[1]), jnp.where(near, c[1], e[3])
        sums.append((s[0], second, third, e[2], real, imaginary))
    if slope:
        s, c = -back * odd_sin[-1], odd_cos[-1]  # of cos, and of sin
        e = -back * even_sin[-1]
        real = jnp.where(near, s[4], e[4])
        imaginary = jnp.where(near, c[5], even_cos[-1, 5])
        second, third = jnp.where(near, e[3], s[1]), jnp.where(near, s[1], e[3])
        sums.append((c[0], second, third, e[2], real, imaginary))
    return sums


def _triad(along: jax.Array, sin: jax.Array, cos: jax.Array) -> jax.Array:
    """Rows (3, 3, T): two inertial directions at right angles to M, and M's own, along the axes of
    the motion; the intermediate axis is at the azimuth of this sine and cosine."""
    n1, n2, n3 = along
    across = jnp.hypot(n1, n3)
    p = jnp.stack([-n2 * n1, across**2, -n2 * n3]) / across
    r = jnp.stack([-n3, jnp.zeros_like(n2), n1]) / across  # M × p
    return jnp.stack([cos * p - sin * r, sin * p + cos * r, along])
