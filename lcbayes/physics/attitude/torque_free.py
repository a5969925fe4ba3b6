"""The free rotation of a rigid body in closed form: no steps, and no error that grows with time.

Euler's equations are solved by Jacobi's elliptic functions, and the precession about the angular
momentum by the argument of a theta function. Their series in the nome q converge like q^(n²). If
q > e^(−π), series of hyperbolic functions in the complementary nome q' = e^(−πK/K') are used
instead. Four terms are sufficient for every body and energy, and the cost of an epoch does not
depend on its time.

Let M be the angular momentum in principal axes, with moments of inertia J₁ ≤ J₂ ≤ J₃, and
a = 1/J₂ − 1/J₃, b = 1/J₁ − 1/J₃, c = 1/J₁ − 1/J₂. M moves about axis 3 if c M₁² < a M₃², and about
axis 1 if c M₁² is greater (then axes 1 and 3 are exchanged, and a, b, c change sign):

    M = (A₁ cn, A₂ sn, A₃ dn)(K + v),   v = λt + v₀,   A₁² = M₁² + (a/b) M₂²,   A₂² = (b/a) A₁²,
    A₃² = M₃² + (c/b) M₂²,   λ = √(ab) A₃,   m = c A₁²/(a A₃²),   1 − m = (a M₃² − c M₁²)/(a A₃²).

The azimuth ψ of the intermediate axis about M increases at the rate
L/J₂ − (a A₃² − c A₁²)/(L − (A₂²/L) sn²), L = |M|. Its integral is an elliptic integral of the third
kind with the periodic part −arg θ₄(z + iy), z = πv/2K. The intermediate axis is used instead of the
axis about which M moves, because M reaches the intermediate axis only on the separatrix; ψ is
therefore also defined for a body that spins about the axis of largest or smallest inertia. v = 0
when M is closest to the intermediate axis: ψ must then resolve the direction of M from this axis.

The same quantities in terms of q' follow from Jacobi's imaginary transformation with w = zK/K',
y' = yK/K': θ₁, θ₂, θ₃, θ₄ of z are proportional to −iθ₁, θ₄, θ₃, θ₂ of iw, and arg θ₄(z + iy) is
arg θ₂(iw − y') − 2zy'/π for |z| <= π/2. Each such interval is one passage by the intermediate axis;
ψ jumps by −2y' from one to the next.

Near the separatrix the component of M/|M| perpendicular to the intermediate axis grows as e^(λt).
The duration of a passage is the time in which this component reaches order 1. Errors and rounding
errors of ω and J grow in the same way; no other errors grow.

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
from lcbayes.physics.attitude.elliptic import carlson

TERMS = 4  # of a series in q^(n²): accurate to 1e-16 up to q = e^(−π)
# Limits of double precision: closer to the separatrix the times of the flips of M are unknown.
NEAREST = 1e-16  # (1 − m)/dn² at t = 0: rounding error of a difference of squares of M
STEADY = 1e-14  # sine of the angle of M and ω below which ω is constant; rounding of J gives 1e-15
ALL = np.arange(TERMS)
N = ALL[1:]
FLIP = (-1.0) ** ALL


class Polhode(NamedTuple):
    """The path of M in the body.

    Attributes
    ----------
    axes : (3, 3)
        Rows: the axes in which the formulae are written, body frame.
    momentum : (3,)
        M at t = 0 along them.
    amplitude : (3,)
        A₁, A₂, A₃, with the signs of M₂ M₃, M₂ and M₃.
    m1 : 1 − m, m the parameter of the elliptic functions
    near : whether m > ½, for which the series in q' are used
    speed, phase : rad/s, rad
        speed · t + phase is z of the module docstring, or w if ``near``.
    inner, outer : exponents
        For the nome q = e^(−2 (inner + outer)), with outer = y; if ``near``, ½ ln 1/q' and
        π/2 − y'. They are used because 1 − q e^(2y) and cos y' may be as small as the rounding
        error of 1.
    precession : rad/s
        Mean dψ/dt; if ``near``, without the jumps.
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
    """Constants that determine the attitude; see the module docstring and `Polhode`.

    Attributes
    ----------
    axes : (3, 3)
        Rows: the axes in which the formulae are written, body frame.
    scale : (3,)
        M/|M| along them divided by θ₁/θ₃, θ₂/θ₃, θ₄/θ₃ of z, or by the equivalents in w.
    inner, outer, speed, phase, precession, near : as in `Polhode`
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
    """Attitude of a rigid body without torque, A(0) = I.

    Ȧ = A [ω_b×], J ω̇_b = J ω_b × ω_b; the angular momentum A J ω_b and the energy are conserved to
    rounding. The attitude is differentiable in t, ω and J, except in J if two moments of inertia
    agree to rounding. If the angle between M and ω is below `STEADY`, the motion and its derivative
    are those of a steady spin. About the intermediate axis such a spin lasts for about 30/λ, with λ
    of the module docstring; the motion after that time is not modelled.

    Parameters
    ----------
    t : (T,) s
        Time since the body axes coincided with the inertial axes.
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


@jax.jit  # so that it is traced once, and its derivatives
def torque_free_to_body(
    t: jax.Array, omega: jax.Array, inertia: jax.Array, *vectors: jax.Array
) -> tuple[jax.Array, ...]:
    """Components in the frame of a body without torque, as from `torque_free`.

    The derivative is written out: du = u × ψ with ψ (3,) linear in the changes of the constants of
    the motion. Its coefficients are therefore computed once for all directions. A Jacobian takes
    three times as long as the value, instead of sixty times with automatic differentiation of the
    series.

    Parameters
    ----------
    t, omega, inertia
        As for `torque_free`.
    *vectors : (T, 3)
        Inertial, constant in derivatives.

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
    """Whether the body spins steadily, and its motion otherwise."""
    omega, inertia = (jnp.asarray(x, float) for x in (omega, inertia))
    momentum = inertia @ omega
    sine = jnp.linalg.norm(jnp.cross(omega, momentum))
    scale = jnp.linalg.norm(omega) * jnp.linalg.norm(momentum)
    steady = sine <= STEADY * scale
    # a tumbling motion replaces a steady one, so that no branch divides by zero
    some, other = jnp.array([1.0, 0.5, 0.7]), jnp.diag(jnp.array([1.0, 2.0, 3.0]))
    path = polhode(jnp.where(steady, some, omega), jnp.where(steady, other, inertia))
    terms, _ = _terms(path.inner, path.outer, path.near)
    _, null2, null3, null4, *_ = jnp.sum(terms, axis=1)
    # θ₁ and θ₂ are divided by 2 q^(1/4), which leaves a factor of √q'
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
    """Constants of the motion from the initial ω (3,) rad/s, body frame; see the module."""
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
    # factorised, because 1 − m may be 10¹⁶ times smaller than either square
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
    slope = -2.0 * N @ imaginary / (1.0 + jnp.sum(real))  # d ln θ₃/dy at iy, or d ln θ₃/dy' at y'
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


@jax.custom_jvp
def _turned(t: jax.Array, motion: Motion, columns: tuple[jax.Array, ...]) -> tuple[jax.Array, ...]:
    """Inertial vectors (3, T) in the body frame: Σᵢ fᵢ(t) (fᵢ(0)·v), fᵢ the rows of `_triad`."""
    return _turn(t, motion, columns)[0]


@partial(_turned.defjvp, symbolic_zeros=True)
def _turned_jvp(primals, tangents):
    """du = u × ψ, ψ = Aᵀ w(0) − w(t), w the rotation vector of `_triad`, body frame.

    w = a + n × dn − (dψ + n₂ (dn·r)/|e₂ × n|) n with a the rotation vector of the axes, n = M/|M|,
    and r = n × p as in `_triad`. The term in dn·r is the rotation of p about n as n changes.
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
    ]  # of w by scale, inner, outer, speed, phase, precession, along the axes of the motion
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
    """The times (T,), followed by t = 0."""
    return jnp.concatenate([t, jnp.zeros(1)])


def _turn(
    t: jax.Array, motion: Motion, columns: tuple[jax.Array, ...]
) -> tuple[tuple[jax.Array, ...], jax.Array, jax.Array]:
    """The rotated columns, M/|M| and `_triad`.

    M/|M| is along the axes of the motion (3, T + 1), `_triad` in the body frame (3, 3, T + 1); the
    last epoch of both is t = 0.
    """
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
    """M/|M| divided by `Motion.scale` (3, T), and derivatives by inner, outer and phase.

    The derivatives are those of M/|M| (3, 3, T), and of the argument of the theta function
    including its jumps (3, T).
    """
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
    """z in (−π/2, π/2), or w in (−½, ½) ln 1/q', and the number of intervals subtracted."""
    x = motion.speed * t + motion.phase
    whole = jnp.where(motion.near, 2.0 * motion.inner, jnp.pi)
    passages = jax.lax.stop_gradient(jnp.round(x / whole))
    return x - whole * passages, passages


def _signed(first: Sequence[jax.Array], passages: jax.Array) -> jax.Array:
    """The three functions as (3, T); the first two change sign from one passage to the next."""
    sign = 1.0 - 2.0 * jnp.abs(passages - 2.0 * jnp.round(0.5 * passages))
    return jnp.stack([sign * first[0], sign * first[1], first[2]])


def _real_imaginary(
    inner: jax.Array, outer: jax.Array, near: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """2 q^(n²) cosh 2ny and −2 q^(n²) sinh 2ny, n >= 1, or 2 q'^(n²) times cos and sin of 2ny'."""
    half = jnp.where(near, inner, inner + outer)  # ½ ln 1/q or 1/q'
    up = jnp.exp(-2.0 * N * ((N - 1.0) * half + inner))  # q^(n²) e^(2ny); q'^(n²) if near
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
    rest = jnp.append(jnp.cumsum(real[::-1])[::-1], 0.0)  # cos 2nx − cos (2n + 2)x = 2 sin x …
    real = jnp.where(near, FLIP * odd * jnp.sin(angle), rest)
    imaginary = jnp.where(near, FLIP * odd * jnp.cos(angle), jnp.append(0.0, imaginary))
    pairs = -jnp.expm1(-2.0 * (2.0 * ALL + 1.0) * inner)  # n and −1 − n nearly cancel
    origin = jnp.sum(FLIP * jnp.exp(-2.0 * ALL * (ALL * half + outer)) * pairs)
    return jnp.stack([FLIP * odd, odd, even, FLIP * even, real, imaginary]), origin


def _sums(
    x: jax.Array, terms: Sequence[tuple[jax.Array, jax.Array]], near: jax.Array, slope: bool = False
) -> list[tuple[jax.Array, ...]]:
    """The six series, (T,) each, for each element of ``terms``.

    They are θ₁ and θ₂ divided by 2 q^(1/4), θ₄, θ₃, and the real and imaginary parts of
    θ₄(x + iy). With ``slope`` the derivatives by x of the first element are appended. If ``near``,
    the series are −iθ₁, θ₄, θ₂, θ₃ of ix, and the real and imaginary parts of θ₂(ix − y'); they
    have the same meaning.

    θ₁ is Σ aₙ sin (2n + 1)x, θ₂ is Σ aₙ cos (2n + 1)x, and θ₃ and θ₄ are Σ aₙ cos 2nx. The
    imaginary part is Σ aₙ sin 2nx, the real part θ₄(iy) − 2 sin x Σ aₙ sin (2n + 1)x, a form
    without cancellation when it is small. If ``near``, sin and cos become sinh and cosh, the real
    part is Σ aₙ cosh (2n + 1)x and the imaginary part Σ aₙ sinh (2n + 1)x. Clenshaw's recurrence in
    u = 2 cos 2x takes one addition and one product per term; a table of sines and cosines costs ten
    times as much.
    """
    tables = [table for table, _ in terms]
    if slope:
        even, odd, table = 2.0 * ALL, 2.0 * ALL + 1.0, tables[0]
        real = jnp.where(near, odd * table[4], even * (jnp.roll(table[4], 1) - table[4]))
        imaginary = jnp.where(near, odd, even) * table[5]
        by = jnp.stack([odd, odd, even, even]) * table[:4]
        tables.append(jnp.concatenate([by, jnp.stack([real, imaginary])]))
    rows = jnp.stack(tables)[..., None]
    # The barriers prevent XLA from recomputing intermediate results at each use.
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
        s, c = -back * odd_sin[-1], odd_cos[-1]  # derivatives of cos and sin
        e = -back * even_sin[-1]
        real = jnp.where(near, s[4], e[4])
        imaginary = jnp.where(near, c[5], even_cos[-1, 5])
        second, third = jnp.where(near, e[3], s[1]), jnp.where(near, s[1], e[3])
        sums.append((c[0], second, third, e[2], real, imaginary))
    return sums


def _triad(along: jax.Array, sin: jax.Array, cos: jax.Array) -> jax.Array:
    """Two inertial directions perpendicular to M and the direction of M, as rows (3, 3, T).

    The components are along the axes of the motion; ``sin`` and ``cos`` are those of the azimuth of
    the intermediate axis.
    """
    n1, n2, n3 = along
    across = jnp.hypot(n1, n3)
    p = jnp.stack([-n2 * n1, across**2, -n2 * n3]) / across
    r = jnp.stack([-n3, jnp.zeros_like(n2), n1]) / across  # M × p
    return jnp.stack([cos * p - sin * r, sin * p + cos * r, along])
