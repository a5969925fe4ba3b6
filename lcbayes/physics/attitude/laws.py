"""Attitude laws behind one interface: from time, Sun and orbit to the axes of a body.

A law has a `name` and `frames(ephemeris)`; whatever asks for body axes asks it. `Law` describes the
stabilised ones by what they hold: one body axis points exactly at a target, a second one as nearly
as it then can. `catalogue` lists them under the names that operators use; `ConstantRate`,
`PrincipalAxis`, `Spinning`, `TorqueFree` and `Fixed` need nothing but time; `Tabulated` is an
attitude known at the times of a light curve.
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

SINGULAR = 1e-9  # sine of the angle between two targets below which the second says nothing


class Ephemeris(NamedTuple):
    """What laws read, along the times of a light curve; one set of inertial axes throughout.

    Attributes
    ----------
    t : (T,) s
    sun : (T, 3)
        Unit vectors from the satellite to the Sun.
    position_km, velocity_km_s : (T, 3) or None
        Geocentric place of the satellite and its velocity; None where no orbit is known.
    celestial_north, ecliptic_north : (3,) or None
        The Earth's pole of J2000 and that of the ecliptic; None where the axes are not named.
    """

    t: jax.Array
    sun: jax.Array
    position_km: jax.Array | None = None
    velocity_km_s: jax.Array | None = None
    celestial_north: jax.Array | None = None
    ecliptic_north: jax.Array | None = None

    def at(self, rows: Any) -> Ephemeris:
        """The same at some of its times."""
        poles = {k: getattr(self, k) for k in ("celestial_north", "ecliptic_north")}
        along = self._replace(**dict.fromkeys(poles))
        return jax.tree.map(lambda x: x[rows], along)._replace(**poles)


class Frames(NamedTuple):
    """Where the parts of a body point.

    Attributes
    ----------
    body : (T, 3, 3)
        Body to inertial: its columns are the body's axes.
    array : (T, 3, 3) or None
        The same of an articulated solar array: y along its hinge, x the normal of its front; None
        where the law has none.
    """

    body: jax.Array
    array: jax.Array | None = None


class Attitude(Protocol):
    """How a body is oriented in time: what every attitude law offers."""

    @property
    def name(self) -> str: ...

    @property
    def needs(self) -> frozenset[str]:
        """Fields of `Ephemeris` beyond t and sun."""
        ...

    @property
    def array(self) -> str:
        """ "one-axis" or "two-axis" where the law turns a solar array, else empty."""
        ...

    def settings(self) -> dict[str, Any]:
        """What was set, by the names of a scenario file; ready for JSON."""
        ...

    def frames(self, ephemeris: Ephemeris) -> Frames: ...


@dataclass(frozen=True)
class _OfTime:
    """A law that needs no orbit: it depends on time alone."""

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
    """A(t) = exp([ω×] t), ω (3,) rad/s inertial; A = I at t = 0."""

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
        Sidereal; negative for the other sense.
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

    It is constant during an exposure.
    """

    axes: NDArray[np.float64]

    @property
    def name(self) -> str:
        return "tabulated"

    def frames(self, ephemeris: Ephemeris) -> Frames:  # noqa: ARG002
        return Frames(jnp.asarray(self.axes))


@dataclass(frozen=True)
class TorqueFree(_OfTime):
    """A rigid body left to itself; its axes are its principal axes.

    ω (3,) rad/s at t = 0, inertial; moments of inertia about x, y, z of any scale; at t = 0 the
    axes are R_z(yaw) R_y(pitch) R_x(roll) from the inertial ones.
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
    """A stabilised attitude: one body axis on a target, a second one as near to another as it can.

    A = [p aᵀ + q bᵀ + (p × q)(a × b)ᵀ] R_a(2πt/P + φ) R_z(yaw) R_y(pitch) R_x(roll),

    with a, b the two body axes, p the first target and q the part of the second at right angles to
    it, made unit vectors; R_a only where the law spins. Where the second target comes to lie along
    the first (a satellite at noon under "yaw-steering"), the inertial axis farthest from p takes
    its place.

    A solar array turns about its hinge h, an axis of the body: its front is the Sun's direction
    (two-axis), or the part of it at right angles to the hinge (one-axis), turned on by
    ``array_offset_deg`` about +h.

    Parameters
    ----------
    name, title : as a user meets them
    point, clock : (body axis, target)
        Axes are "+x" … "-z", targets the keys of `TARGETS`.
    spins : bool
        Turns about the first axis with ``period_s``.
    array : "", "one-axis" or "two-axis"
    hinge : body axis of the array
    aliases : other names of it
    same_as : str
        The law from which it differs by a constant turn of the body alone, so that brightness
        tells them apart only where the body's axes are known.
    yaw_deg, pitch_deg, roll_deg : degrees
        Constant turn of the body against the axes described, in the order 3-2-1.
    period_s, phase_deg : s, degrees
        Of laws that spin, right-handed about the target; the phase at t = 0.
    array_offset_deg : degrees

    References
    ----------
    Hall et al. 2007, sec. 3.4 (the commonly used modes, a few dozen); Black 1964, AIAA J. 2, 1350
    (axes from two directions).
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
        """Fields of `Ephemeris` that its targets are computed from."""
        return frozenset().union(*(TARGETS[target].needs for _, target in (self.point, self.clock)))

    @property
    def keys(self) -> tuple[str, ...]:
        """What can be set of it."""
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
            The ephemeris lacks what the law needs, or a spin has no period.
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
            turns = turns - jax.lax.stop_gradient(jnp.floor(turns))  # reduced: precise for years
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
    """Raise `InputError`, one line, unless the ephemeris has what the law needs."""
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
    """A direction that a law points at: what it is computed from, and how, (T, 3) of any length."""

    at: Callable[[Ephemeris], jax.Array]
    needs: frozenset[str] = frozenset()


def _everywhere(name: str) -> Callable[[Ephemeris], jax.Array]:
    return lambda e: jnp.broadcast_to(jnp.asarray(getattr(e, name)), e.sun.shape)


def _constant(axis: str) -> Callable[[Ephemeris], jax.Array]:
    return lambda e: jnp.broadcast_to(jnp.asarray(_axis(axis)), e.sun.shape)


def _air_velocity(e: Ephemeris) -> jax.Array:
    """Of the satellite against an atmosphere (or ground) that turns with the Earth."""
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
    """The unit vectors along the part of v at right angles to the unit vectors p, (T, 3)."""
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
