"""A smooth convex body with a spin: brightness and its Jacobian in attitude and shape."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets
from lcbayes.physics.brightness import LAMBERT_C, diffuse_kernel

_BLOCK = 1 << 14  # epochs x facets at once; the working set fits in a core's cache
CLOSURE_SD = 0.01  # of Σ a n / Σ a
DEPENDENT = 1e-12  # share of a square below which a function is a multiple of others
PRIOR_POINTS = 2.0  # weight, in points, of the prior on an unknown noise level ...
PRIOR_SQUARES = PRIOR_POINTS * 0.25**2  # ... at a quarter of the expected error, half a per cent


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SmoothBody:
    """Facets on a grid whose log-areas are real spherical harmonics, aᵢ ∝ exp Σ c_lm Y_lm(nᵢ).

    Attributes
    ----------
    normals : (N, 3)
        Normals of an equal-area grid, body frame. Their dtype sets the precision of all facet
        computations.
    harmonics : (N, P)
        P = (L + 1)² − 1, without the constant, which is replaced by the factor of a curve.
    sd : (P,)
        Standard deviations of the normal priors of c_lm: ``roughness`` (2/(l + 1))².
    closure : scalar
        1/sd of each component of Σ a n / Σ a; 0 if albedos differ and closure is not required.
    law : str
        One of `brightness.DIFFUSE_LAWS`.
    """

    normals: jax.Array
    harmonics: jax.Array
    sd: jax.Array
    closure: jax.Array
    law: str = field(metadata={"static": True})

    @classmethod
    def of(
        cls,
        n_facets: int,
        degree: int,
        law: str,
        *,
        roughness: float = 10.0,
        closed: bool = True,
        dtype: type = np.float64,
    ) -> SmoothBody:
        """A body with this number of facets and harmonics up to the given degree."""
        normals = facets.grid(n_facets)
        degrees = np.concatenate([np.full(2 * n + 1, n) for n in range(1, degree + 1)])
        return cls(
            jnp.asarray(normals, dtype),
            jnp.asarray(facets.spherical_harmonics(normals, degree)[:, 1:], dtype),
            jnp.asarray(roughness * (2.0 / (degrees + 1.0)) ** 2),
            jnp.asarray(1.0 / CLOSURE_SD if closed else 0.0),
            law,
        )

    def shares(self, coefficients: jax.Array) -> jax.Array:
        """Areas (N,) that sum to one."""
        return jax.nn.softmax(self.harmonics @ coefficients.astype(self.harmonics.dtype))


class Spin(NamedTuple):
    """A hypothesis: attitude and body.

    tilt : (3, 3), body to inertial at the middle of the data; its third column is the pole.
    frequency : turns per second, sidereal.
    coefficients : (P,) of the harmonics.
    """

    tilt: jax.Array
    frequency: jax.Array
    coefficients: jax.Array

    def moved(self, step: jax.Array, unit: jax.Array) -> Spin:
        """Spin turned by step[:2] (rad) about the body's x and y axes, with frequency increased by
        step[2] ``unit`` and coefficients by step[3:]."""
        turn = jnp.stack([step[0], step[1], jnp.zeros_like(step[0])])
        small = rotations.constant_rate(jnp.ones(1), turn)[0]
        return Spin(
            self.tilt @ small, self.frequency + step[2] * unit, self.coefficients + step[3:]
        )


class Model(NamedTuple):
    """Brightness of a body whose areas sum to one, (T,), and its derivatives, (T, 3 + P)."""

    flux: jax.Array
    jacobian: jax.Array


def brightness(body: SmoothBody, points: Points, spin: Spin) -> Model:
    """f = Σᵢ aᵢ K(s·nᵢ, o·nᵢ) and its Jacobian in two rotations of the pole, frequency and c_lm.

    The kernel and its slopes are computed once. Brightness is linear in the areas, so the shape
    part of the Jacobian is K (a Y). The attitude part is ∂f = Σ_u (∂f/∂u × u)·ψ over u = s, o in
    the body frame, for a rotation of the body by ψ. It has two components for the pole and one for
    the rotational phase. The derivative with respect to phase, times 2πt, is that with respect to
    frequency.

    Parameters
    ----------
    body, points, spin

    References
    ----------
    Kaasalainen, Torppa & Muinonen 2001, eqs. (1)-(5); Hall et al. 2007, eq. (8).
    """
    kind = body.normals.dtype
    area = body.shares(spin.coefficients)
    centred = body.harmonics - area @ body.harmonics  # derivative of the softmax
    shape = jnp.concatenate([area[:, None], area[:, None] * centred], axis=1)
    # a fourth column of zeros: XLA multiplies four columns more than twice as fast as three
    vectors = jnp.pad(area[:, None] * body.normals, ((0, 0), (0, 1)))

    def rows(directions: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        sun, obs = directions
        value, slope0, slope = diffuse_kernel(
            body.law, sun @ body.normals.T, obs @ body.normals.T, jnp.asarray(LAMBERT_C, kind)
        )
        by_sun, by_obs = (slope0 @ vectors)[:, :3], (slope @ vectors)[:, :3]
        return value @ shape, jnp.cross(by_sun, sun) + jnp.cross(by_obs, obs)

    still = points.sun @ spin.tilt, points.obs @ spin.tilt

    def instant(t: jax.Array) -> jax.Array:
        turns = t * spin.frequency
        phase = 2.0 * jnp.pi * (turns - jnp.floor(turns))
        cos, sin = jnp.cos(phase), jnp.sin(phase)
        sun, obs = (
            jnp.stack([cos * u[:, 0] + sin * u[:, 1], cos * u[:, 1] - sin * u[:, 0], u[:, 2]], 1)
            for u in still
        )
        by_shape, torque = _in_blocks(rows, (sun.astype(kind), obs.astype(kind)), len(area))
        x, y, z = torque.T
        by_attitude = jnp.stack([cos * x - sin * y, sin * x + cos * y, 2.0 * jnp.pi * t * z], 1)
        return jnp.concatenate([by_shape[:, :1], by_attitude, by_shape[:, 1:]], axis=1)

    each = [w * instant(t) for w, t in zip(points.instant, points.t, strict=True)]
    out = jnp.sum(jnp.stack(each), axis=0)
    return Model(out[:, 0], out[:, 1:])


def _in_blocks(function, arrays, n_facets: int):
    """Apply a function to rows in blocks."""
    count = arrays[0].shape[0]
    size = max(1, _BLOCK // n_facets)
    if count <= 2 * size:
        return function(arrays)
    blocks = -(-count // size)
    size = -(-count // blocks)
    missing = blocks * size - count

    def cut(x):
        return jnp.pad(x, ((0, missing), (0, 0)), mode="edge").reshape(blocks, size, -1)

    done = jax.lax.map(function, tuple(cut(x) for x in arrays))
    return tuple(x.reshape(blocks * size, -1)[:count] for x in done)


class Factors(NamedTuple):
    """The best factors of the brightness m of a body, by linear least squares.

    best : (T,)
        The factor of each point.
    functions : (T,) each
        Orthonormal functions m/σ times 1 and, for curves that have a phase law, its two terms.
    members : (T, C) each
        The groups in which they are orthonormal.
    """

    best: jax.Array
    functions: list[jax.Array]
    members: list[jax.Array]

    def parts(self, rows: jax.Array) -> jax.Array:
        """The coefficients of the functions in rows (T, D), of every group, (C + 2M, D)."""
        pairs = zip(self.functions, self.members, strict=True)
        return jnp.concatenate([of.T @ (f[:, None] * rows) for f, of in pairs])


def _factors(points: Points, flux: jax.Array) -> Factors:
    """Gram and Schmidt's procedure in all curves at once."""
    unit, best = flux / points.error, jnp.zeros_like(points.flux)
    laws = [*points.laws.T] if points.phased.shape[1] else []
    multiples, functions, members = [], [], []
    for multiple, of in ((jnp.ones_like(flux), points.scale), *((x, points.phased) for x in laws)):
        size = of.T @ (multiple * unit) ** 2
        for other, orthonormal in zip(multiples, functions, strict=True):
            multiple = multiple - other * (of @ (of.T @ (orthonormal * multiple * unit)))
        square = of.T @ (multiple * unit) ** 2
        # Nothing is left in a dark curve, or where one point alone is bright.
        left = square > DEPENDENT * size
        multiple = multiple * (of @ jnp.where(left, jnp.where(left, square, 1.0) ** -0.5, 0.0))
        function = multiple * unit
        best = best + multiple * (of @ (of.T @ (function * points.flux / points.error)))
        multiples.append(multiple)
        functions.append(function)
        members.append(of)
    return Factors(best, functions, members)


def fitted(body: SmoothBody, points: Points, spin: Spin) -> jax.Array:
    """Brightness with the best factors, (T,)."""
    flux = brightness(body, points, spin).flux
    return _factors(points, flux).best * flux


class Normal(NamedTuple):
    """The objective at a point, and its normal equations.

    value : −ln p(data, c) up to a constant
    gradient : (D,), of the value
    curvature : (D, D), Gauss-Newton approximation
    squares : (K,), Σ (residual/error)² of each noise group
    """

    value: jax.Array
    gradient: jax.Array
    curvature: jax.Array
    squares: jax.Array


def normal_equations(body: SmoothBody, points: Points, spin: Spin, unit: jax.Array) -> Normal:
    """Misfit, priors and their derivatives with respect to the step of `Spin.moved`.

    With known errors the misfit is ½ Σ r². Otherwise it is ½ Σ_k (n_k + 2) ln(S_k + 1/8), with
    S_k = Σ r² over a noise group in units of the expected error. This is the likelihood at the best
    noise level, which gives a low weight to a curve with large residuals. The factors of curves,
    with the phase laws of those that have one, follow from the other parameters by linear least
    squares (variable projection with Kaufman's Jacobian, whose gradient is exact).
    """
    flux, jacobian = brightness(body, points, spin)
    jacobian = jacobian.at[:, 2].multiply(unit)
    factors = _factors(points, flux)
    residual = (points.flux - factors.best * flux) / points.error
    squares = points.noise.T @ residual**2
    if points.error_known:
        value, weight = 0.5 * jnp.sum(squares), jnp.ones_like(residual)
    else:
        count = jnp.sum(points.noise, axis=0) + PRIOR_POINTS
        value = 0.5 * jnp.sum(count * jnp.log(squares + PRIOR_SQUARES))
        weight = points.noise @ (count / (squares + PRIOR_SQUARES))
    root = jnp.sqrt(weight)
    rows = jacobian * (factors.best * root / points.error)[:, None]
    taken = factors.parts(rows)  # absorbed by the factors; the weight is constant over a group
    gradient, curvature = -((root * residual) @ rows), rows.T @ rows - taken.T @ taken

    area = body.shares(spin.coefficients)
    gap = body.closure * (area @ body.normals)
    mean = area @ body.harmonics
    slope = body.closure * (area[:, None] * body.normals).T @ (body.harmonics - mean)
    pull = spin.coefficients / body.sd
    value = value + 0.5 * (gap @ gap) + 0.5 * (pull @ pull)
    gradient = gradient.at[3:].add(gap @ slope + pull / body.sd)
    curvature = curvature.at[3:, 3:].add(slope.T @ slope + jnp.diag(body.sd**-2.0))
    return Normal(value, gradient, curvature, squares)
