"""Small torque-free nutation as a linear response of the brightness.

A rigid body that spins nearly about its axis of largest or smallest inertia nutates. With A₀ the
rotation at a constant rate about the angular momentum, its attitude is to first order

    A(t) = A₀(t) (1 + [e(t)×]),    e = p cos θ + q sin θ,    θ = κ ω (t − t_m),

in body axes. The four components of p and q, perpendicular to the spin axis, are free: they contain
the phase, the directions of the other two axes and the axis ratio of the ellipse. κ is the nutation
frequency in the body over the rate of rotation,

    κ² = (I₃ − I₁)(I₃ − I₂)/(I₁ I₂),

for a spin about the third axis. It is below 1 for every rigid body, because no moment of inertia
exceeds the sum of the other two. In inertial axes, e has the frequencies (1 ± κ) ω.

References
----------
Landau & Lifshitz 1976, Mechanics, sec. 37 (free rotation near an axis of inertia).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpyro
import numpyro.distributions as dist

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import pass_effects
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.attitude.rotations import cross

COMPONENTS = 4
SD_DEG = 1.0  # of each component
RESPONSE = "nutation_response"
AMOUNTS = "nutation"


class Wobble(NamedTuple):
    """Changes of the flux (4, T) by a degree of each component of p and q, and their prior sd."""

    columns: jax.Array
    sd: float


def response(
    data: Epochs,
    omega: jax.Array,
    time: Callable[[jax.Array], jax.Array],
    torque: jax.Array,
    sd: float,
    ratio: float,
) -> Wobble:
    """Changes of the flux by the components of p and q.

    Sites: ``nutation_ratio``, κ = ``ratio`` + u δ with u ~ Normal(0, 1) and δ of `resolution`;
    ``nutation_response``; and ``nutation`` (nights + 1, 4), the components in deg. The components
    of each night are independent, because the phase cannot be followed from night to night; the
    last are those of a night without data. They are zero here: `nuisances.drawn` draws them after
    the fit, and predictions insert the draws.

    Parameters
    ----------
    data : Epochs
    omega : (3,) rad/s
        Angular velocity; body axes are inertial axes at t = 0.
    time : callable
        Times (T,) in which the rate is constant, from recorded times.
    torque : (3, T)
        Derivatives of the flux by e, 1/rad, as of `with_torque`.
    sd : float
        Prior standard deviation of each component, deg.
    ratio : float
        κ, to the resolution of the light curve.
    """
    rate = jnp.sqrt(jnp.sum(omega**2) + 1e-30)
    unit = jnp.asarray(numpyro.sample("nutation_ratio_unit", dist.Normal(0.0, 1.0)))
    kappa = ratio + unit * resolution(rate * data.longest_night)
    numpyro.deterministic("nutation_ratio", kappa)
    pole = omega / rate
    first = jnp.cross(pole, jnp.eye(3)[jnp.argmin(jnp.abs(pole))])
    first = first / jnp.linalg.norm(first)
    along = jnp.stack([first, jnp.cross(pole, first)]) @ torque
    turn = rate * (time(data.t) - time(data.t - data.nights.elapsed))
    columns = jnp.radians(1.0) * in_phase(along, kappa * turn)
    columns = jnp.where(data.night < 0, 0.0, columns)
    return Wobble(jnp.asarray(numpyro.deterministic(RESPONSE, columns)), sd)


def resolution(angle: jax.Array | float) -> jax.Array | float:
    """Change of κ that moves the phase at either end of a night by one radian; at most a quarter.

    The angle is that by which the body rotates in the longest night, rad.
    """
    return 2.0 / (8.0 + angle)


def in_phase(along: jax.Array, theta: jax.Array) -> jax.Array:
    """Responses (4, T) to p and q, from those to rotations about two axes (2, T)."""
    return jnp.concatenate([jnp.cos(theta) * along, jnp.sin(theta) * along])


def with_torque(
    flux: Callable[[jax.Array, jax.Array], jax.Array], sun: jax.Array, obs: jax.Array
) -> jax.Array:
    """Flux and its derivatives by a small rotation e of the body, (1 + 3, T).

    A rotation by e changes the body components of a direction v by v × e, and the flux by
    e · Σ ∂f/∂v × v. One gradient gives all three components.

    Parameters
    ----------
    flux : callable
        Flux (T,) from body components of the directions to Sun and observer, each (T, 3).
    sun, obs : (T, 3)
    """
    value, pull = jax.vjp(flux, sun, obs)
    slopes = pull(jnp.ones_like(value))
    torque = sum(cross(g.T, v.T) for g, v in zip(slopes, (sun, obs), strict=True))
    return jnp.concatenate([value[None], jnp.asarray(torque)])


def on(sd: float, ratio: float) -> bool:
    """Whether nutation is modelled; raises an InputError for values that no body can have."""
    if not sd >= 0:
        raise InputError(f"nutation_sd is {sd}; give a standard deviation > 0, or 0 for none")
    if not 0 <= ratio < 1:
        raise InputError(
            f"nutation_ratio is {ratio}; the nutation frequency of a rigid body is less than its "
            "rate of rotation: give a ratio between 0 and 1, or 0 if the body does not nutate"
        )
    return sd > 0 and ratio > 0


def shifted(data: Epochs, flux: jax.Array, wobble: Wobble) -> jax.Array:
    """The flux (T,) with the values of the site ``nutation``: zero unless they are inserted."""
    zero = jnp.zeros((data.n_nights + 1, COMPONENTS))
    each = jnp.asarray(numpyro.deterministic(AMOUNTS, zero))[data.night]
    return flux + jnp.sum(each.T * wobble.columns, axis=0)


def given_earlier(
    data: Epochs, mean: jax.Array, sd: jax.Array, columns: jax.Array, prior_sd: float
) -> tuple[jax.Array, jax.Array]:
    """Mean and standard deviation (T,) of each point given the earlier ones of its night.

    y ~ Normal(m + Cᵀ n, diag σ²) with n ~ Normal(0, s² I) for each night. The components are
    integrated out one after another, each as in `zero_points.given_earlier`. The sites
    ``nutation_mean`` (nights, 4) and ``nutation_root`` (nights, 4, 4) are the mean of n given all
    points and a root of its covariance, in deg.

    Parameters
    ----------
    mean, sd : (T,)
        Without nutation.
    columns : (4, T)
        C: changes of the brightness by n.
    prior_sd : float
        s, deg.
    """
    _moments(data, (data.brightness - mean) / sd, prior_sd * columns / sd, prior_sd)
    variance = sd**2
    for _ in range(len(columns)):
        mean, variance, left, _ = pass_effects.given_earlier(
            data.nights, data.brightness, mean, variance, columns, prior_sd
        )
        columns = left[1:]
    return mean, jnp.sqrt(variance)


def _moments(data: Epochs, miss: jax.Array, columns: jax.Array, prior_sd: float) -> None:
    """Record the moments of n (nights, 4) given the whitened misses (T,) and columns (4, T)."""
    k = len(columns)
    products = jnp.concatenate([(columns[:, None] * columns).reshape(k * k, -1), columns * miss])
    total = jnp.zeros((len(products), data.n_nights + 1)).at[:, data.night]
    total = total.add(data.information * products)[:, :-1].T
    precision = jnp.eye(k) + total[:, : k * k].reshape(-1, k, k)
    covariance = jnp.linalg.inv(precision)
    mean = jnp.einsum("nij,nj->ni", covariance, total[:, k * k :])
    numpyro.deterministic("nutation_mean", prior_sd * mean)
    numpyro.deterministic("nutation_root", prior_sd * jnp.linalg.cholesky(covariance))
