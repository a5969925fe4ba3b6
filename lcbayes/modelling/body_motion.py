"""Motion of a body whose axes mean something: its attitude is unknown beside its spin.

The attitude is that in the middle of the light curve, where the data fix it best, so that it hardly
depends on the rate. The middle is that of the first observer's clock, so that the attitude does not
depend on an offset that is common to all clocks. It is recorded at t = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import ArrayLike
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform
from numpyro.distributions.util import validate_sample
from numpyro.util import is_prng_key
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import nuisances, priors
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import RADIUS_SD
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets

type Turned = Callable[[jax.Array], tuple[jax.Array, jax.Array]]


class UniformRotation(dist.Distribution):
    """Rotations uniform over all, represented by a quaternion (4,) of length near one.

    log p(q) = −(|q| − 1)²/(2ρ²) − 3 log|q| + const with ρ = 0.1, as in `priors.UniformDirection`.
    Components are (w, x, y, z); q and −q are the same rotation.
    """

    support = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    pytree_data_fields = ()
    redundant = 1  # its length, which does not count as a parameter

    def __init__(self, *, validate_args: bool | None = None) -> None:
        super().__init__(batch_shape=(), event_shape=(4,), validate_args=validate_args)

    def sample(self, key: jax.Array, sample_shape: tuple[int, ...] = ()) -> jax.Array:
        assert is_prng_key(key)
        key_direction, key_radius = jax.random.split(key)
        u = jax.random.normal(key_direction, (*sample_shape, 4))
        radius = 1.0 + RADIUS_SD * jax.random.truncated_normal(
            key_radius, -1.0 / RADIUS_SD, jnp.inf, sample_shape
        )
        return u / jnp.linalg.norm(u, axis=-1, keepdims=True) * radius[..., None]

    @validate_sample
    def log_prob(self, value: jax.Array) -> jax.Array:
        radius = jnp.sqrt(jnp.sum(value**2, axis=-1) + 1e-30)
        log_norm = jnp.log(2.0 * jnp.pi**2) + jnp.log(RADIUS_SD) + 0.5 * jnp.log(2.0 * jnp.pi)
        return -0.5 * ((radius - 1.0) / RADIUS_SD) ** 2 - 3.0 * jnp.log(radius) - log_norm

    def precision(self, value: jax.Array) -> jax.Array:
        """Precision (4, 4): 1/ρ² radially, 4/r² across, the inverse variance of a uniform one."""
        square = jnp.sum(value**2) + 1e-30
        along = jnp.outer(value, value) / square
        return along / RADIUS_SD**2 + (jnp.eye(4) - along) * 4.0 / square


def matrix(quaternion: jax.Array) -> jax.Array:
    """Rotation matrix (3, 3) of a quaternion (4,) = (w, x, y, z) of any length."""
    w, x, y, z = quaternion / jnp.linalg.norm(quaternion)
    return jnp.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def product(p: ArrayLike, q: ArrayLike) -> jax.Array:
    """The quaternion of the rotation q followed by p."""
    a, b = jnp.asarray(p), jnp.asarray(q)
    vector = a[0] * b[1:] + b[0] * a[1:] + jnp.cross(a[1:], b[1:])
    return jnp.concatenate([(a[0] * b[0] - a[1:] @ b[1:])[None], vector])


def brought(start: ArrayLike, end: jax.Array) -> jax.Array:
    """The shortest rotation (3, 3) that takes a unit vector to another one (Rodrigues)."""
    a = jnp.asarray(start)
    v = jnp.cross(a, end)
    skew = jnp.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return jnp.eye(3) + skew + skew @ skew / jnp.maximum(1.0 + a @ end, 1e-12)


class TurnAboutBisector(Transform):
    """(Re ζ, Im ζ, Re w, Im w) ↔ quaternion of an attitude, for directions that hardly move.

    In the axes of the bisector b of the directions to Sun and observer, with b along z, let the
    quaternion be (z₁, z₂) = (w + iz, x + iy). A turn about b multiplies both by one phase. Then
    ζ = z₂/z₁ is the stereographic projection of b in body axes, which one pass fixes well, and the
    phase of w = |q| z₁/|z₁| is the angle of the body about b, which it may not fix at all. In the
    components of the quaternion that angle is a thin curve through all four, and here it is the
    plane of w. The coordinates are singular at z₁ = 0, which has no volume.

    Parameters
    ----------
    bisector : (3,)
        Inertial axes, of any length.
    """

    domain = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    codomain = constraints.real_vector  # pyright: ignore[reportAssignmentType]

    def __init__(self, bisector: ArrayLike) -> None:
        b = np.asarray(bisector, float)
        self.bisector = tuple(b / np.linalg.norm(b))
        x = np.cross(np.eye(3)[np.argmin(np.abs(self.bisector))], self.bisector)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(self.bisector, x), self.bisector])
        turn = Rotation.from_matrix(axes)
        self._frame = turn.as_quat(scalar_first=True)

    def __call__(self, x: jax.Array) -> jax.Array:
        ratio, turn = x[0] + 1j * x[1], x[2] + 1j * x[3]
        first = turn / jnp.sqrt(1.0 + x[0] ** 2 + x[1] ** 2)
        second = ratio * first
        q = jnp.stack([first.real, second.real, second.imag, first.imag])
        return product(self._frame * np.array([1.0, -1.0, -1.0, -1.0]), q)

    def _inverse(self, y: jax.Array) -> jax.Array:
        w, a, b, z = product(self._frame, y)
        first = w + 1j * z
        size = jnp.maximum(jnp.sqrt(w**2 + z**2), 1e-150)
        ratio = (a + 1j * b) / first
        turn = jnp.linalg.norm(y) * first / size
        return jnp.stack([ratio.real, ratio.imag, turn.real, turn.imag])

    def log_abs_det_jacobian(self, x: jax.Array, y: jax.Array, intermediates=None) -> jax.Array:  # noqa: ARG002
        """ln (|w|²/(1 + |ζ|²)²)."""
        return jnp.log(x[2] ** 2 + x[3] ** 2) - 2.0 * jnp.log1p(x[0] ** 2 + x[1] ** 2)

    def tree_flatten(self):
        return (), ((), {"bisector": self.bisector, "_frame": self._frame})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TurnAboutBisector) and self.bisector == other.bisector

    def __hash__(self) -> int:
        return hash((TurnAboutBisector, self.bisector))


def flat_spin(
    flat_axis: ArrayLike, omega_sd: float, known: dist.Distribution | None = None
) -> tuple[jax.Array, jax.Array]:
    """Attitude (3, 3) in the middle of the light curve and ω (3,) about an axis of the body.

    ω = s A n with the axis n in body axes, s ~ N(0, omega_sd²) and A uniform. ``known`` is another
    prior of s/omega_sd, such as `known_spin.RatePrior`.
    """
    attitude = _attitude()
    unit = numpyro.sample("rate_unit", dist.Normal(0.0, 1.0) if known is None else known)
    rate = omega_sd * jnp.asarray(unit)
    omega = rate * (attitude @ jnp.asarray(flat_axis))
    numpyro.deterministic("rate_deg_s", jnp.rad2deg(rate))
    numpyro.deterministic("omega", omega)
    return attitude, omega


def free_spin(
    axis: ArrayLike | None, omega_sd: float, known: dist.Distribution | None = None
) -> tuple[jax.Array, jax.Array]:
    """Attitude (3, 3) in the middle of the light curve and ω ~ N(0, omega_sd² I), of any direction.

    ``known`` is another prior of ω/omega_sd, such as `known_spin.SpinPrior`. The angle of a body
    about its axis of symmetry, if it has one, changes nothing: the direction of the axis is
    sampled, and the angle is left out.
    """
    omega = priors.angular_velocity(omega_sd, known)
    if axis is None:
        return _attitude(), omega
    direction = priors.directions("axis", 1)[0]
    numpyro.deterministic("axis", direction)
    rate = jnp.sqrt(jnp.sum(omega**2) + 1e-30)
    cosine = jnp.clip(direction @ omega / rate, -1.0, 1.0)
    numpyro.deterministic("cone_deg", jnp.rad2deg(jnp.arccos(cosine * (1.0 - 1e-12))))
    return brought(axis, direction), omega


def _attitude() -> jax.Array:
    base = jnp.asarray(numpyro.sample("attitude_base", UniformRotation()))
    return matrix(base)


class Motion(NamedTuple):
    """Rotation at a constant rate, with errors of clocks and a drift of the rate.

    Attributes
    ----------
    attitude : (3, 3)
        Body to inertial axes in the middle of the light curve, by the clock of the first observer.
    omega : (3,) rad/s
        Inertial axes.
    offsets : (n_observers + 1,) s or None
        Of the clock of each observer, and of any other.
    drift : scalar or None
        Relative change of the rate over the light curve.
    """

    attitude: jax.Array
    omega: jax.Array
    offsets: jax.Array | None
    drift: jax.Array | None

    @classmethod
    def of(
        cls,
        data: Epochs,
        attitude: jax.Array,
        omega: jax.Array,
        clock_sd: float,
        rate_drift_sd: float,
    ) -> Motion:
        """With offsets and drift drawn from their priors."""
        rate = jnp.sqrt(jnp.sum(omega**2) + 1e-30)
        offsets = nuisances.clock_offsets(data, clock_sd)
        return cls(attitude, omega, offsets, nuisances.rate_drift(data, rate, rate_drift_sd))

    def turned(self, data: Epochs) -> Turned:
        """Directions in body axes; records the attitude at t = 0.

        Returns
        -------
        callable
            ``(sun_body, obs_body)``, (T, 3) each, at the recorded times t of the epochs. The
            directions are those of the recorded times, moved to the true ones.
        """
        attitude, omega, offsets, drift = self
        late = nuisances.late(data, offsets)
        true = nuisances.moved(data, late)

        def since_middle(t: jax.Array) -> jax.Array:
            elapsed = t - data.t_middle
            if drift is not None:
                elapsed = elapsed + drift * elapsed**2 / (2.0 * data.t_span)
            return elapsed if offsets is None else elapsed - offsets[0]

        def to_body(t: jax.Array) -> tuple[jax.Array, jax.Array]:
            elapsed = since_middle(t if late is None else t + late)
            sun, obs = rotations.constant_rate_to_body(elapsed, omega, true.sun, true.obs)
            return sun @ attitude, obs @ attitude

        start = rotations.constant_rate(since_middle(jnp.zeros(1)), omega)[0] @ attitude
        numpyro.deterministic("attitude", start)
        return to_body

    def near(
        self, middle: jax.Array, flat_axis: ArrayLike | None, axis: ArrayLike | None
    ) -> jax.Array:
        """Coordinates about the attitude ``middle``, without redundant ones.

        Half the antisymmetric part of the rotation from there, body axes; the rate of a flat spin
        or ω; drift; offset of the first clock, and of the others from that. A turn about an axis of
        symmetry is left out.
        """
        r = middle.T @ self.attitude
        turn = 0.5 * jnp.stack([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
        if axis is not None:
            turn = jnp.asarray(facets.across(axis)) @ turn
        spin = self.omega
        if flat_axis is not None:
            spin = spin @ (self.attitude @ jnp.asarray(flat_axis))
        parts = [turn, spin, self.drift]
        if self.offsets is not None:
            parts.append(self.offsets[:-1].at[1:].add(-self.offsets[0]))
        return jnp.concatenate([jnp.atleast_1d(x) for x in parts if x is not None])
