"""Priors shared by models: directions, albedo-areas, angular velocity, visibility.

Each function draws NumPyro sites under the names of the results (``normals``, ``albedo_area``,
``omega`` …), so that the report can treat all models alike.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpyro.distributions import constraints
from numpyro.distributions.util import validate_sample
from numpyro.util import is_prng_key

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics import reflectance
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.torque_free import torque_free_to_body
from lcbayes.physics.bodies import facets

RADIUS_SD = 0.1
SOFTNESS = 0.02  # of the edge beyond which a facet is never lit and seen
SPECULAR = {"nu": (100.0, 1.0), "n": (100.0, 1.0), "m": (0.2, 0.5)}
"""Parameters of reflectance laws that are scales: median and sd of the logarithm."""
SPINS = ("free", "none", "torque-free")

type Rotation = Callable[..., tuple[jax.Array, ...]]


class UniformDirection(dist.Distribution):
    """Directions uniform on the sphere or circle, represented by a vector of length near one.

    log p(b) = −(|b| − 1)²/(2ρ²) − (d − 1) log|b| + const with ρ = 0.1 for b of d components, 3 or
    2. The direction b/|b| is exactly uniform for any ρ. Angles have boundaries (φ wraps at 2π and g
    ends at ±1), at which a sampler gets stuck; b has no boundary. With a free radius (a Gaussian
    b), the tangential scale would vary by a factor of ten between draws; ρ = 0.1 keeps it within
    10 %.
    """

    support = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    pytree_data_fields = ()

    def __init__(self, n: int, size: int = 3, *, validate_args: bool | None = None) -> None:
        super().__init__(batch_shape=(n,), event_shape=(size,), validate_args=validate_args)

    def sample(self, key: jax.Array, sample_shape: tuple[int, ...] = ()) -> jax.Array:
        assert is_prng_key(key)
        key_direction, key_radius = jax.random.split(key)
        shape = sample_shape + self.batch_shape
        u = jax.random.normal(key_direction, shape + self.event_shape)
        radius = 1.0 + RADIUS_SD * jax.random.truncated_normal(
            key_radius, -1.0 / RADIUS_SD, jnp.inf, shape
        )
        return u / jnp.linalg.norm(u, axis=-1, keepdims=True) * radius[..., None]

    @validate_sample
    def log_prob(self, value: jax.Array) -> jax.Array:
        radius = jnp.sqrt(jnp.sum(value**2, axis=-1) + 1e-30)
        size = self.event_shape[0]
        surface = {2: 2.0 * jnp.pi, 3: 4.0 * jnp.pi}[size]
        log_norm = jnp.log(surface) + 0.5 * jnp.log(2 * jnp.pi) + jnp.log(RADIUS_SD)
        return -0.5 * ((radius - 1.0) / RADIUS_SD) ** 2 - (size - 1) * jnp.log(radius) - log_norm

    def precision(self, value: jax.Array) -> jax.Array:
        """Precision (dn, dn): 1/ρ² radially, d/r² (inverse variance of a uniform direction) across.

        The curvature of −log p is not used, because it does not measure the tangential width.
        """
        square = jnp.sum(value**2, axis=-1)[:, None, None] + 1e-30
        along = value[:, :, None] * value[:, None, :] / square
        size = self.event_shape[0]
        blocks = along / RADIUS_SD**2 + (jnp.eye(size) - along) * size / square
        return jax.scipy.linalg.block_diag(*blocks)


def directions(name: str, n: int) -> jax.Array:
    """``n`` unit vectors uniform on the sphere, (n, 3); the sampled site is ``name_base``.

    Uniform φ in [0, 2π) and g in [−1, 1] (Linares & Crassidis, sec. II) are the same prior.
    """
    base = jnp.asarray(numpyro.sample(f"{name}_base", UniformDirection(n)))
    return base / jnp.linalg.norm(base, axis=-1, keepdims=True)


def angle(name: str) -> jax.Array:
    """An angle uniform on the circle, rad in (−π, π]; the sampled site is ``name_base``."""
    base = jnp.asarray(numpyro.sample(f"{name}_base", UniformDirection(1, 2)))[0]
    return jnp.arctan2(base[1], base[0])


def normals(n_facets: int, start: jax.Array | None = None) -> jax.Array:
    """Facet normals, body frame, (N, 3).

    They are recorded with their angles ``phi`` and ``g``, in inertial axes at t = 0: turned by
    ``start`` (3, 3), the attitude at that time, if body and inertial axes coincide at another time.
    """
    if n_facets < 1:
        raise InputError(f"n_facets is {n_facets}; give 1 or more")
    u = directions("normals", n_facets)
    at_start = u if start is None else u @ start.T
    numpyro.deterministic("normals", at_start)
    phi, g = facets.angles(at_start)
    numpyro.deterministic("phi", phi)
    numpyro.deterministic("g", g)
    return u


def albedo_area(n_facets: int, log_mean: float = 0.0, log_sd: float = 1.0) -> jax.Array:
    """Log-normal albedo-areas α, m², (N,); Linares & Crassidis, eq. (7)."""
    _positive("log_area_sd", log_sd)
    area = log_normal("albedo_area", n_facets, log_mean, log_sd)
    numpyro.deterministic("albedo_area", area)
    return area


def log_normal(name: str, n: int, log_mean: float | jax.Array, log_sd: float) -> jax.Array:
    """n log-normal values; the sampled site is ``log_name``."""
    prior = dist.Normal(log_mean, log_sd).expand([n]).to_event(1)
    return jnp.exp(jnp.asarray(numpyro.sample(f"log_{name}", prior)))


def sparse_area(albedo_area: jax.Array, weight: float) -> None:
    """Squared-L1 prior: log p = −weight · (Σα)²; a larger weight is sparser.

    The paper's λ is 1/√weight in eq. (30) and 1/√(2·weight) in eq. (29); its "λ = 1000 is sparse"
    only makes sense for a weight.
    """
    if weight < 0:
        raise ValueError(f"sparsity is {weight}; give a weight >= 0")
    numpyro.factor("sparse_area", -weight * jnp.sum(jnp.abs(albedo_area)) ** 2)


def surface(
    law: str, n: int, scales: Mapping[str, tuple[float, float]] = SPECULAR, suffix: str = ""
) -> dict[str, jax.Array]:
    """The parameters of a reflectance law for n facets, (n,) each; the caller records them.

    Reflectances are uniform. If a law has both r_diff and r_spec, their prior is uniform over the
    triangle r_diff + r_spec ≤ 1, in which no law reflects more light than it receives. The
    coordinates are the sum R ~ Beta(2, 1) and the specular share r_spec/R ~ U(0, 1). The light
    curve determines the albedo-area and the share of a facet of unknown area, but not R. In the
    coordinates r_diff and r_spec, the posterior has a curved ridge along which the area grows as
    both shrink, and chains mixed five times as slowly. Parameters in ``scales`` are log-normal.
    """
    parameters = reflectance.get_law(law).parameters
    parts = [name for name in ("r_diff", "r_spec", "w") if name in parameters]
    total = dist.Beta(float(len(parts)), 1.0).expand([n]).to_event(1)
    shares = [jnp.asarray(numpyro.sample(f"r_sum{suffix}", total))]
    if len(parts) == 2:
        uniform = dist.Uniform(0.0, 1.0).expand([n]).to_event(1)
        share = jnp.asarray(numpyro.sample(f"specular_share{suffix}", uniform))
        shares = [shares[0] * (1.0 - share), shares[0] * share]
    drawn = dict(zip(parts, shares, strict=True))
    for name, (median, sd) in scales.items():
        if name in parameters:
            drawn[name] = log_normal(f"{name}{suffix}", n, jnp.log(median), sd)
    return drawn


def deviations(name: str, n: int, median: float, log_sd: float = 1.0) -> jax.Array:
    """Deviations (n + 1,) of the members of a group from their common value.

    They are τ uᵢ with uᵢ ~ N(0, 1) and τ ~ LogNormal(ln median, log_sd). This non-centred form
    avoids a funnel at small τ. The last deviation is that of a member without data: its u follows
    the prior, so that predictions for a new member include the scatter between members.

    References
    ----------
    Betancourt & Girolami 2015, in Current Trends in Bayesian Methodology, ch. 4 (non-centred).
    """
    log_spread = numpyro.sample(f"log_{name}_sd", dist.Normal(jnp.log(median), log_sd))
    spread = jnp.asarray(numpyro.deterministic(f"{name}_sd", jnp.exp(log_spread)))
    unit = numpyro.sample(f"{name}_unit", dist.Normal(0.0, 1.0).expand([n + 1]).to_event(1))
    offset = spread * jnp.asarray(unit)
    numpyro.deterministic(f"{name}_offset", offset[:n])
    return offset


def angular_velocity(sd: float, known: dist.Distribution | None = None) -> jax.Array:
    """ω ~ N(0, sd² I), rad/s, inertial, (3,); Linares & Crassidis, above eq. (9).

    ``known`` is another prior of ω/sd, such as `modelling.known_spin.SpinPrior`.
    """
    omega = _angular_velocity(sd, known)
    numpyro.deterministic("omega", omega)
    return omega


def _angular_velocity(sd: float, known: dist.Distribution | None) -> jax.Array:
    _positive("omega_sd", sd)
    prior = dist.Normal(0.0, 1.0).expand([3]).to_event(1) if known is None else known
    return sd * jnp.asarray(numpyro.sample("omega_unit", prior))


def inertia(sd: float) -> jax.Array:
    """Inertia tensor, up to its scale, body axes, (3, 3).

    J = tr(M) I − M, where M = exp S contains the second moments of the mass distribution and S is
    symmetric and traceless, with components N(0, sd²) in an orthonormal basis. This prior is
    invariant under rotations. Every J is physical (each principal moment is less than the sum of
    the other two), and each J corresponds to one S. With sd = 1, half of all boxes have a ratio of
    longest to shortest side above 4.2; for 90 % it is between 2.1 and 9.9.
    """
    _positive("inertia_sd", sd)
    free = numpyro.sample("inertia_base", dist.Normal(0.0, 1.0).expand([5]).to_event(1))
    tensor, principal = inertia_tensor(jnp.asarray(free), sd)
    numpyro.deterministic("inertia_ratio", principal[:2] / principal[2])
    return tensor


def inertia_tensor(free: jax.Array, sd: float) -> tuple[jax.Array, jax.Array]:
    """Inertia tensor (3, 3) and principal moments, ascending (3,), of the site ``inertia_base``."""
    moments, axes = jnp.linalg.eigh(sd * jnp.tensordot(free, TRACELESS, 1))
    moments = jnp.exp(moments)
    tensor = (axes * (jnp.sum(moments) - moments)) @ axes.T
    return tensor, (jnp.sum(moments) - moments)[::-1]


# An orthonormal basis of traceless symmetric matrices (3, 3).
TRACELESS = np.zeros((5, 3, 3))
for _k, (_i, _j) in enumerate(((0, 1), (0, 2), (1, 2))):
    TRACELESS[_k, _i, _j] = TRACELESS[_k, _j, _i] = 0.5**0.5
TRACELESS[3] = np.diag([1.0, -1.0, 0.0]) / 2.0**0.5
TRACELESS[4] = np.diag([1.0, 1.0, -2.0]) / 6.0**0.5


class State(NamedTuple):
    """The state of a torque-free body at one time, in inertial axes.

    Attributes
    ----------
    attitude : (3, 3)
        Body to inertial.
    omega : (3,) rad/s
    inertia : (3, 3)
        Over the largest moment of inertia.
    """

    attitude: jax.Array
    omega: jax.Array
    inertia: jax.Array


class Spin(NamedTuple):
    """The rotation of a body since its axes coincided with the inertial axes.

    Attributes
    ----------
    to_body : callable
        ``to_body(elapsed, *vectors)`` gives the body-frame components of inertial vectors (T, 3)
        at times (T,) s since then.
    omega : (3,)
        Angular velocity at that time, rad/s.
    inertia : (3, 3), optional
        Of a torque-free body, body axes, up to its scale.
    """

    to_body: Rotation
    omega: jax.Array
    inertia: jax.Array | None = None

    def state(self, elapsed: jax.Array) -> State:
        """The state of a torque-free body at one time."""
        axes = (jnp.asarray(axis)[None] for axis in np.eye(3))
        attitude = jnp.concatenate(self.to_body(elapsed[None], *axes))
        assert self.inertia is not None
        tensor = attitude @ self.inertia @ attitude.T
        omega = jnp.linalg.solve(tensor, self.inertia @ self.omega)  # the momentum is constant
        return State(attitude, omega, tensor / jnp.linalg.eigvalsh(self.inertia)[-1])


def spin(
    kind: str,
    omega_sd: float,
    inertia_sd: float = 1.0,
    known: dist.Distribution | None = None,
) -> Spin:
    """Rotation of the body for a model's option ``spin``.

    "free" is rotation at a constant ω, "none" is no rotation, and "torque-free" is the motion of a
    rigid body with a sampled inertia tensor. ``known`` is a prior of ω/omega_sd in place of the
    normal one. The site ``omega`` of a torque-free body is left to the caller, who knows when its
    axes coincide with the inertial axes.
    """
    if kind not in SPINS:
        raise ValueError(f"unknown spin {kind!r}; available: {', '.join(SPINS)}")
    if kind != "torque-free":
        omega = jnp.zeros(3) if kind == "none" else angular_velocity(omega_sd, known)
        return Spin(lambda t, *vectors: rotations.constant_rate_to_body(t, omega, *vectors), omega)
    omega, tensor = _angular_velocity(omega_sd, known), inertia(inertia_sd)
    momentum = tensor @ omega
    pole = momentum / jnp.sqrt(jnp.sum(momentum**2) + 1e-30)
    pole_angles(pole)
    return Spin(lambda t, *vectors: torque_free_to_body(t, omega, tensor, *vectors), omega, tensor)


def pole_angles(pole: jax.Array) -> None:
    """Deterministic sites ``pole_lon_deg`` and ``pole_lat_deg`` of a unit vector (3,)."""
    lon, lat = jnp.arctan2(pole[1], pole[0]), jnp.arcsin(jnp.clip(pole[2], -1.0, 1.0))
    numpyro.deterministic("pole_lon_deg", jnp.mod(jnp.rad2deg(lon), 360.0))
    numpyro.deterministic("pole_lat_deg", jnp.rad2deg(lat))


def visibility_prior(
    sun_body: jax.Array, obs_body: jax.Array, normals: jax.Array, softness: float = SOFTNESS
) -> None:
    """Each facet is lit and seen at least once: directions (T, 3) and normals (N, 3), body frame.

    The prior of eq. (8) with each factor clipped is one if m = maxₜ min(μ₀, μ) > 0, with the
    unclipped cosines, and zero otherwise. A zero density has no gradient, so a sampler that starts
    there cannot return. The edge is therefore softened: log p = −(m/softness)² for m < 0 and 0
    otherwise. The prior is exact where a facet is seen, and falls to 37 % at 1.1° beyond the edge.
    """
    both = jnp.minimum(normals @ sun_body.T, normals @ obs_body.T)
    # The gradient of a maximum is that at the epoch of the maximum.
    best = jax.lax.stop_gradient(jnp.argmax(both, axis=1))
    mu0, mu = (jnp.sum(normals * v[best], axis=1) for v in (sun_body, obs_body))
    m = jnp.minimum(mu0, mu)
    numpyro.factor("visibility", -jnp.sum((jnp.minimum(m, 0.0) / softness) ** 2))


def _positive(name: str, value: float) -> None:
    if not value > 0:
        raise InputError(f"{name} is {value}; give a number > 0")
