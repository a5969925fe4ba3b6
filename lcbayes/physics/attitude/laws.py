"""Attitude laws with a common interface: from time, Sun and orbit to the axes of a body.

A law has a `name` and a method `frames(ephemeris)` that returns the body axes. `Law` describes
stabilised attitudes: one body axis points exactly at a target, and a second one as close as
possible to another target. `catalogue` lists them under the names used by operators.
`ConstantRate`, `PrincipalAxis`, `Spinning`, `TorqueFree` and `Fixed` depend only on time.
`Tabulated` is an attitude known at the times of a light curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.constants import EARTH_RATE
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.rotations import Scalar
from lcbayes.physics.attitude.torque_free import torque_free

SINGULAR = 1e-9  # sine of the angle between two targets below which the second is ignored


class Ephemeris(NamedTuple):
    """Input of attitude laws at the times of a light curve, all in the same inertial axes.

    Attributes
    ----------
    t : (T,) s
    sun : (T, 3)
        Unit vectors from the satellite to the Sun.
    position_km, velocity_km_s : (T, 3) or None
        Geocentric position and velocity of the satellite; None if no orbit is known.
    celestial_north, ecliptic_north : (3,) or None
        The Earth's pole at J2000 and the pole of the ecliptic; None if the axes are not named.
    """

    t: jax.Array
    sun: jax.Array
    position_km: jax.Array | None = None
    velocity_km_s: jax.Array | None = None
    celestial_north: jax.Array | None = None
    ecliptic_north: jax.Array | None = None

    def at(self, rows: Any) -> Ephemeris:
        """The ephemeris at a selection of its times."""
        poles = {k: getattr(self, k) for k in ("celestial_north", "ecliptic_north")}
        along = self._replace(**dict.fromkeys(poles))
        return jax.tree.map(lambda x: x[rows], along)._replace(**poles)


class Frames(NamedTuple):
    """Axes of the parts of a body.

    Attributes
    ----------
    body : (T, 3, 3)
        Body to inertial; the columns are the body's axes.
    array : (T, 3, 3) or None
        The same for an articulated solar array: y along its hinge, x the normal of its front. None
        if the law has no array.
    """

    body: jax.Array
    array: jax.Array | None = None


class Attitude(Protocol):
    """Orientation of a body as a function of time: the interface of all attitude laws."""

    @property
    def name(self) -> str: ...

    @property
    def needs(self) -> frozenset[str]:
        """Required fields of `Ephemeris` in addition to t and sun."""
        ...

    @property
    def array(self) -> str:
        """ "one-axis" or "two-axis" if the law rotates a solar array, otherwise empty."""
        ...

    def settings(self) -> dict[str, Any]:
        """The settings under their names in a scenario file, ready for JSON."""
        ...

    def frames(self, ephemeris: Ephemeris) -> Frames: ...


@dataclass(frozen=True)
class _OfTime:
    """A law that needs no orbit: it depends only on time."""

    @property
    def needs(self) -> frozenset[str]:
        return frozenset()

    @property
    def array(self) -> str:
        return ""

    def settings(self) -> dict[str, Any]:
        return {
            k: np.asarray(v).tolist() if isinstance(v, tuple | np.ndarray) else v
            for k, v in vars(self).items()
        }


@dataclass(frozen=True)
class ConstantRate(_OfTime):
    """A(t) = exp([ω×] t), with ω (3,) in rad/s, inertial; A = I at t = 0."""

    omega_rad_s: tuple[float, float, float]

    def __post_init__(self) -> None:
        for x in self.omega_rad_s:
            if isinstance(x, int | float) and not np.isfinite(x):
                raise InputError(f"omega_rad_s has a component {x}; give three finite numbers")

    @property
    def name(self) -> str:
        return "constant-rate"

    def frames(self, ephemeris: Ephemeris) -> Frames:
        return Frames(rotations.constant_rate(ephemeris.t, jnp.asarray(self.omega_rad_s)))


@dataclass(frozen=True)
class PrincipalAxis(_OfTime):
    """Rotation about the body's z axis.

    Parameters
    ----------
    pole_lon_deg, pole_lat_deg : degrees
        Pole, in the frame of the geometry.
    period_s : s
        Sidereal; negative for the opposite sense of rotation.
    phase0_deg : degrees
        Rotational phase at the time ``t0_s``.
    t0_s : s

    Raises
    ------
    InputError
        The period is zero, the latitude is out of range, or a number is not finite.
    """

    pole_lon_deg: float
    pole_lat_deg: float
    period_s: float
    phase0_deg: float = 0.0
    t0_s: float = 0.0

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            if isinstance(value, int | float) and not np.isfinite(value):
                raise InputError(f"{key} of a principal-axis spin is {value}; give a finite number")
        if isinstance(self.period_s, int | float) and self.period_s == 0:
            raise InputError("period_s is 0; a period is positive, or negative for the other sense")
        if isinstance(self.pole_lat_deg, int | float) and abs(self.pole_lat_deg) > 90:
            raise InputError(f"pole_lat_deg is {self.pole_lat_deg:g}; expected -90 to 90")

    @property
    def name(self) -> str:
        return "principal-axis"

    def frames(self, ephemeris: Ephemeris) -> Frames:
        angles = jnp.array([self.pole_lon_deg, self.pole_lat_deg, self.phase0_deg])
        lon, lat, phase = jnp.deg2rad(angles)
        period = jnp.asarray(self.period_s)
        time = ephemeris.t - self.t0_s
        return Frames(rotations.principal_axis(time, lon, lat, period, phase))

    def settings(self) -> dict[str, Any]:
        given = super().settings()
        if not self.t0_s:
            del given["t0_s"]
        return given


@dataclass(frozen=True)
class Spinning(_OfTime):
    """Rotation about the body's z axis from a known attitude.

    Parameters
    ----------
    tilt : (3, 3)
        Body to inertial at the time ``t0_s``; its third column is the pole.
    frequency : float
        Turns per second, sidereal.
    t0_s : s
    """

    tilt: NDArray[np.float64]
    frequency: float
    t0_s: float = 0.0

    @property
    def name(self) -> str:
        return "spinning"

    def frames(self, ephemeris: Ephemeris) -> Frames:
        time = ephemeris.t - self.t0_s
        return Frames(rotations.spinning(time, jnp.asarray(self.tilt), 1.0 / self.frequency))


@dataclass(frozen=True)
class Tabulated(_OfTime):
    """An attitude known at the times of a light curve, ``axes`` (T, 3, 3) body to inertial.

    The attitude is constant during an exposure.
    """

    axes: NDArray[np.float64]

    @property
    def name(self) -> str:
        return "tabulated"

    def frames(self, ephemeris: Ephemeris) -> Frames:  # noqa: ARG002
        return Frames(jnp.asarray(self.axes))


@dataclass(frozen=True)
class TorqueFree(_OfTime):
    """A rigid body without torque; its axes are the principal axes.

    ω (3,) is in rad/s at t = 0, inertial. The moments of inertia about x, y, z have any scale. At
    t = 0 the axes are rotated by R_z(yaw) R_y(pitch) R_x(roll) from the inertial axes.
    """

    omega_rad_s: tuple[float, float, float]
    inertia: tuple[float, float, float]
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def name(self) -> str:
        return "torque-free"

    def frames(self, ephemeris: Ephemeris) -> Frames:
        first = _offset(self.yaw_deg, self.pitch_deg, self.roll_deg)
        tensor = first @ jnp.diag(jnp.asarray(self.inertia)) @ first.T
        return Frames(torque_free(ephemeris.t, jnp.asarray(self.omega_rad_s), tensor) @ first)


@dataclass(frozen=True)
class Fixed(_OfTime):
    """The body's axes are the inertial axes."""

    @property
    def name(self) -> str:
        return "fixed"

    def frames(self, ephemeris: Ephemeris) -> Frames:
        return Frames(rotations.fixed(ephemeris.t))


@dataclass(frozen=True)
class Law:
    """A stabilised attitude: one body axis on a target, a second as close as possible to another.

    A = [p aᵀ + q bᵀ + (p × q)(a × b)ᵀ] R_a(2πt/P + φ) R_z(yaw) R_y(pitch) R_x(roll),

    with a, b the two body axes, p the unit vector to the first target, and q the unit vector along
    the component of the second target perpendicular to p. The factor R_a applies only to spinning
    laws. If the second target is parallel to the first (a satellite at noon under "yaw-steering"),
    it is replaced by the inertial axis farthest from p.

    A solar array rotates about its hinge h, an axis of the body. Its front points at the Sun
    (two-axis), or along the component of the Sun's direction perpendicular to the hinge (one-axis),
    rotated by ``array_offset_deg`` about +h.

    Parameters
    ----------
    name, title : as shown to the user
    point, clock : (body axis, target)
        Axes are "+x" … "-z", targets are the keys of `TARGETS`.
    spins : bool
        Whether the body rotates about the first axis with ``period_s``.
    array : "", "one-axis" or "two-axis"
    hinge : body axis of the array
    aliases : other names of the law
    same_as : str
        A law that differs only by a constant rotation of the body, so that brightness distinguishes
        the two only if the body's axes are known.
    yaw_deg, pitch_deg, roll_deg : degrees
        Constant rotation of the body relative to the axes above, in the order 3-2-1.
    period_s, phase_deg : s, degrees
        For spinning laws, right-handed about the target; the phase at t = 0.
    array_offset_deg : degrees

    References
    ----------
    Hall et al. 2007, sec. 3.4 (a few dozen common modes); Black 1964, AIAA J. 2, 1350 (axes from
    two directions).
    """

    name: str
    title: str
    point: tuple[str, str]
    clock: tuple[str, str]
    spins: bool = False
    array: str = ""
    hinge: str = "+y"
    aliases: tuple[str, ...] = ()
    same_as: str = ""
    yaw_deg: Scalar = 0.0
    pitch_deg: Scalar = 0.0
    roll_deg: Scalar = 0.0
    period_s: Scalar | None = None
    phase_deg: Scalar = 0.0
    array_offset_deg: Scalar = 0.0

    @property
    def needs(self) -> frozenset[str]:
        """Fields of `Ephemeris` from which the targets are computed."""
        return frozenset().union(*(TARGETS[target].needs for _, target in (self.point, self.clock)))

    @property
    def keys(self) -> tuple[str, ...]:
        """Names of the settings."""
        own = ("period_s", "phase_deg") if self.spins else ()
        return (
            "yaw_deg",
            "pitch_deg",
            "roll_deg",
            *own,
            *(("array_offset_deg",) if self.array else ()),
        )

    def set(self, **settings: Scalar) -> Law:
        """The same law with other settings.

        Raises
        ------
        InputError
            The law has no such setting, or a period of zero.
        """
        for key in settings:
            if key not in self.keys:
                raise InputError(
                    f"the law {self.name!r} has no {key!r}; it has {', '.join(self.keys)}"
                )
        if isinstance(settings.get("period_s"), int | float) and settings["period_s"] == 0:
            raise InputError("period_s is 0; a period is positive, or negative for the other sense")
        return replace(self, **settings)  # pyright: ignore[reportArgumentType]

    def settings(self) -> dict[str, Any]:
        return {key: getattr(self, key) for key in self.keys}

    def frames(self, ephemeris: Ephemeris) -> Frames:
        """Axes of body and array at every time.

        Raises
        ------
        InputError
            The ephemeris lacks a required field, or a spinning law has no period.
        """
        require(self, ephemeris)
        first, a = TARGETS[self.point[1]].at(ephemeris), _axis(self.point[0])
        second, b = TARGETS[self.clock[1]].at(ephemeris), _axis(self.clock[0])
        p = first / jnp.linalg.norm(first, axis=-1, keepdims=True)
        q = _across(second, p)
        axes = jnp.stack([p, q, jnp.cross(p, q)], axis=-1)
        body = axes @ jnp.asarray(np.stack([a, b, np.cross(a, b)]))
        if self.spins:
            if self.period_s is None:
                raise InputError(f"the law {self.name!r} spins; give its period_s")
            turns = ephemeris.t / self.period_s
            turns = turns - jax.lax.stop_gradient(jnp.floor(turns))  # stays precise over years
            angle = 2.0 * jnp.pi * turns + jnp.deg2rad(self.phase_deg)
            body = body @ rotations.constant_rate(angle, jnp.asarray(a))
        body = body @ _offset(self.yaw_deg, self.pitch_deg, self.roll_deg)
        return Frames(body, self._array(body, ephemeris.sun) if self.array else None)

    def _array(self, body: jax.Array, sun: jax.Array) -> jax.Array:
        hinge = body @ jnp.asarray(_axis(self.hinge))
        if self.array == "two-axis":
            x, y = sun, _across(hinge, sun)
        else:
            x, y = _across(sun, hinge), hinge
        turn = jnp.deg2rad(self.array_offset_deg)
        x = jnp.cos(turn) * x + jnp.sin(turn) * jnp.cross(y, x)
        return jnp.stack([x, y, jnp.cross(x, y)], axis=-1)


def require(law: Attitude, ephemeris: Ephemeris) -> None:
    """Raise a one-line `InputError` if the ephemeris lacks a field required by the law."""
    missing = {name for name in law.needs if getattr(ephemeris, name) is None}
    if missing & {"position_km", "velocity_km_s"}:
        both = ephemeris.position_km is None
        raise InputError(
            f"the law {law.name!r} needs the satellite's orbit, and this light curve has "
            f"{'none' if both else 'its places but no velocity'}; read it with --tle FILE"
            + (", or with a site and ra_deg dec_deg range_km" if both else "")
        )
    if missing:
        raise InputError(
            f"the law {law.name!r} needs to know north, and the axes of this light curve have no "
            "name; say '# frame: icrs' (or ecliptic-j2000) above its header"
        )


class Target(NamedTuple):
    """A target of a law: the fields it depends on, and a function for its (T, 3) vectors."""

    at: Callable[[Ephemeris], jax.Array]
    needs: frozenset[str] = frozenset()


def _everywhere(name: str) -> Callable[[Ephemeris], jax.Array]:
    return lambda e: jnp.broadcast_to(jnp.asarray(getattr(e, name)), e.sun.shape)


def _constant(axis: str) -> Callable[[Ephemeris], jax.Array]:
    return lambda e: jnp.broadcast_to(jnp.asarray(_axis(axis)), e.sun.shape)


def _air_velocity(e: Ephemeris) -> jax.Array:
    """Velocity of the satellite relative to an atmosphere (or ground) rotating with the Earth."""
    spin = EARTH_RATE * jnp.asarray(e.celestial_north)
    return jnp.asarray(e.velocity_km_s) - jnp.cross(spin, jnp.asarray(e.position_km))


_PLACE = frozenset({"position_km"})
_ORBIT = frozenset({"position_km", "velocity_km_s"})
TARGETS: dict[str, Target] = {
    "inertial-x": Target(_constant("+x")),
    "inertial-z": Target(_constant("+z")),
    "sun": Target(lambda e: e.sun),
    "nadir": Target(lambda e: -jnp.asarray(e.position_km), _PLACE),
    "velocity": Target(lambda e: jnp.asarray(e.velocity_km_s), frozenset({"velocity_km_s"})),
    "orbit-normal": Target(
        lambda e: jnp.cross(jnp.asarray(e.position_km), jnp.asarray(e.velocity_km_s)), _ORBIT
    ),
    "air-velocity": Target(_air_velocity, _ORBIT | {"celestial_north"}),
    "celestial-north": Target(_everywhere("celestial_north"), frozenset({"celestial_north"})),
    "ecliptic-north": Target(_everywhere("ecliptic_north"), frozenset({"ecliptic_north"})),
}


def _axis(text: str) -> np.ndarray:
    """(3,) from "+x" … "-z"."""
    return np.eye(3)["xyz".index(text[1])] * (-1.0 if text[0] == "-" else 1.0)


def _across(v: jax.Array, p: jax.Array) -> jax.Array:
    """Unit vectors along the component of v perpendicular to the unit vectors p, (T, 3)."""
    farthest = jnp.eye(3)[jnp.argmin(jnp.abs(p), axis=-1)]
    v = v / jnp.linalg.norm(v, axis=-1, keepdims=True)
    part = v - jnp.sum(v * p, axis=-1, keepdims=True) * p
    lost = jnp.sum(part**2, axis=-1, keepdims=True) < SINGULAR**2
    part = jnp.where(lost, farthest, part)
    part = part - jnp.sum(part * p, axis=-1, keepdims=True) * p
    return part / jnp.linalg.norm(part, axis=-1, keepdims=True)


def _offset(yaw_deg: Scalar, pitch_deg: Scalar, roll_deg: Scalar) -> jax.Array:
    """R_z(yaw) R_y(pitch) R_x(roll), (3, 3)."""
    turned = jnp.eye(3)
    for axis, angle in (("+z", yaw_deg), ("+y", pitch_deg), ("+x", roll_deg)):
        angle = jnp.deg2rad(jnp.asarray(angle, float))
        turned = turned @ rotations.constant_rate(angle[None], jnp.asarray(_axis(axis)))[0]
    return turned
