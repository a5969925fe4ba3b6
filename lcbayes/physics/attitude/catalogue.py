"""The catalogue of attitude laws, under the names used by operators.

Body axes follow the convention of each kind. For Earth pointers z is toward nadir, x along the
direction of flight and y opposite to the orbit normal (LVLH, as for the ISS). For Sun pointers x is
toward the Sun, like the front of the built-in "box-wing". Names such as "+XVV" state the body axis
along the velocity.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from lcbayes.core.errors import InputError
from lcbayes.core.text import closest
from lcbayes.physics.attitude.laws import Attitude, ConstantRate, Fixed, Law, PrincipalAxis

_NADIR, _FLIGHT = ("+z", "nadir"), ("-y", "orbit-normal")

_ALL = (
    Law(
        "inertial",
        "holds its axes among the stars",
        ("+z", "inertial-z"),
        ("+x", "inertial-x"),
        aliases=("three-axis-inertial", "staring"),
    ),
    # Earth pointers on an orbit
    Law(
        "lvlh",
        "nadir pointing, x along the flight",
        _NADIR,
        _FLIGHT,
        aliases=("nadir", "+xvv", "+xvv +zlv", "earth-pointing"),
    ),
    Law(
        "lvlh-backward",
        "nadir pointing, flying backwards",
        _NADIR,
        ("+y", "orbit-normal"),
        aliases=("-xvv", "yaw-around"),
        same_as="lvlh",
    ),
    Law(
        "lvlh-sideways",
        "nadir pointing, y along the flight",
        _NADIR,
        ("+x", "orbit-normal"),
        aliases=("+yvv",),
        same_as="lvlh",
    ),
    Law(
        "zenith",
        "z to the zenith, x along the flight",
        ("-z", "nadir"),
        ("+y", "orbit-normal"),
        aliases=("-zlv", "inverted"),
        same_as="lvlh",
    ),
    Law(
        "velocity",
        "x along the inertial velocity, z as near to nadir as it can",
        ("+x", "velocity"),
        _FLIGHT,
        aliases=("velocity-aligned", "vnc"),
    ),
    Law(
        "ram",
        "x into the air that turns with the Earth, for the least drag",
        ("+x", "air-velocity"),
        ("+z", "nadir"),
        aliases=("airspeed", "aerostable", "low-drag"),
    ),
    Law(
        "ground-track",
        "nadir pointing, yawed along the ground track",
        _NADIR,
        ("+x", "air-velocity"),
        aliases=("zero-doppler", "yaw-compensated"),
    ),
    Law(
        "earth-north",
        "nadir pointing, y to the south of the Earth",
        _NADIR,
        ("-y", "celestial-north"),
        aliases=("geo", "north-south"),
    ),
    Law(
        "gravity-gradient",
        "long axis to nadir, turning about it",
        _NADIR,
        _FLIGHT,
        spins=True,
        aliases=("nadir-spin", "yaw-spin"),
    ),
    # the same with a solar array that follows the Sun
    Law(
        "nadir-sun-array",
        "lvlh with an array that follows the Sun about the pitch axis",
        _NADIR,
        _FLIGHT,
        array="one-axis",
        aliases=("orbit-normal", "pitch-array"),
    ),
    Law(
        "nadir-roll-array",
        "lvlh with an array that follows the Sun about the roll axis",
        _NADIR,
        _FLIGHT,
        array="one-axis",
        hinge="+x",
        aliases=("roll-array",),
    ),
    Law(
        "nadir-yaw-array",
        "lvlh with an array that follows the Sun about the yaw axis",
        _NADIR,
        _FLIGHT,
        array="one-axis",
        hinge="+z",
        aliases=("mast-array",),
    ),
    Law(
        "nadir-gimbal-array",
        "lvlh with an array on two gimbals, square to the Sun",
        _NADIR,
        _FLIGHT,
        array="two-axis",
        aliases=("two-axis-array",),
    ),
    Law(
        "geo-sun-array",
        "earth-north with an array that follows the Sun about the polar axis",
        _NADIR,
        ("-y", "celestial-north"),
        array="one-axis",
        aliases=("geo-comsat",),
    ),
    Law(
        "yaw-steering",
        "nadir pointing, yawed so that the array meets the Sun square (GNSS)",
        _NADIR,
        ("+x", "sun"),
        array="one-axis",
        aliases=("gnss", "nominal-yaw", "dynamic-yaw"),
    ),
    # Sun pointers
    Law(
        "sun-pointing",
        "x to the Sun, y as near to the orbit's normal as it can",
        ("+x", "sun"),
        _FLIGHT,
        aliases=("solar-inertial", "sun-tracking"),
    ),
    Law(
        "sun-north",
        "x to the Sun, z as near to celestial north as it can",
        ("+x", "sun"),
        ("+z", "celestial-north"),
    ),
    Law(
        "sun-ecliptic",
        "x to the Sun, z as near to ecliptic north as it can",
        ("+x", "sun"),
        ("+z", "ecliptic-north"),
    ),
    Law(
        "sun-nadir",
        "x to the Sun, z as near to nadir as it can",
        ("+x", "sun"),
        ("+z", "nadir"),
        aliases=("sun-pointing-earth-clocked",),
    ),
    Law(
        "sun-flight",
        "x to the Sun, z as near to the velocity as it can",
        ("+x", "sun"),
        ("+z", "velocity"),
    ),
    Law(
        "sun-spin",
        "turns about the line to the Sun (safe mode)",
        ("+x", "sun"),
        ("+z", "ecliptic-north"),
        spins=True,
        aliases=("safe-mode", "sun-spinner"),
    ),
    # oriented relative to the orbital plane and the Sun
    Law(
        "xpop",
        "x across the orbit's plane, z to nadir at orbital noon",
        ("+x", "orbit-normal"),
        ("-z", "sun"),
        aliases=("quasi-inertial",),
    ),
    # spinners
    Law(
        "orbit-normal-spin",
        "turns about the orbit's normal (cartwheel)",
        ("+z", "orbit-normal"),
        ("+x", "inertial-x"),
        spins=True,
        aliases=("cartwheel",),
    ),
    Law(
        "polar-spin",
        "turns about the Earth's pole (geostationary drum)",
        ("+z", "celestial-north"),
        ("+x", "inertial-x"),
        spins=True,
        aliases=("geo-drum",),
    ),
    Law(
        "ecliptic-spin",
        "turns about the pole of the ecliptic (thermal roll)",
        ("+z", "ecliptic-north"),
        ("+x", "inertial-x"),
        spins=True,
        aliases=("barbecue",),
    ),
    Law(
        "velocity-spin",
        "turns about its direction of flight (rifle spin)",
        ("+x", "velocity"),
        _FLIGHT,
        spins=True,
        aliases=("rifle",),
    ),
)

LAWS: dict[str, Law] = {law.name: law for law in _ALL}
_NAMES = {other: law for law in _ALL for other in (law.name, *law.aliases)}


def distinct() -> tuple[Law, ...]:
    """One law of each class; laws of a class differ by a constant rotation of the body."""
    return tuple(law for law in _ALL if not law.same_as)


def find(name: str) -> Law:
    """A law by its name or an alias, case-insensitive.

    Raises
    ------
    InputError
        There is no such law; the message lists the available ones.
    """
    law = _NAMES.get(" ".join(name.lower().split()))
    if law is None:
        raise InputError(
            f"unknown attitude law {name!r}{closest(name, LAWS)}; available: {', '.join(LAWS)}"
        )
    return law


def parse(text: str) -> Attitude:
    """A law with its settings, from ``LAW`` or ``LAW:NAME=NUMBER,NAME=NUMBER``.

    In addition to the catalogue: ``fixed``, ``constant-rate:x=…,y=…,z=…`` (rad/s) and
    ``principal-axis:pole_lon_deg=…,pole_lat_deg=…,period_s=…,phase0_deg=…``.

    Raises
    ------
    InputError
        The law or a setting is unknown, missing or not a number.
    """
    name, _, rest = text.partition(":")
    given: dict[str, float] = {}
    for pair in filter(None, (p.strip() for p in rest.split(","))):
        key, _, value = pair.partition("=")
        try:
            given[key.strip()] = float(value)
            if not math.isfinite(given[key.strip()]):
                raise ValueError
        except ValueError:
            raise InputError(f"law {text!r}: {pair!r} is not NAME=NUMBER") from None
    free = {
        "fixed": (),
        "constant-rate": ("x", "y", "z"),
        "principal-axis": ("pole_lon_deg", "pole_lat_deg", "period_s"),
    }
    name = name.strip()
    if name not in free:
        law = find(name).set(**given)
        if law.spins and law.period_s is None:
            raise InputError(f"law {text!r} spins; give its period as {name}:period_s=SECONDS")
        return law
    needed = free[name]
    more = {"phase0_deg"} if name == "principal-axis" else set()
    if not set(needed) <= set(given) or set(given) - set(needed) - more:
        also = "".join(f", and may take {key}" for key in more)
        raise InputError(f"law {text!r}: {name} takes {', '.join(needed) or 'no settings'}{also}")
    if name == "constant-rate":
        return ConstantRate((given["x"], given["y"], given["z"]))
    if name == "principal-axis":
        if given["period_s"] == 0:
            raise InputError(f"law {text!r}: a period is not 0")
        return PrincipalAxis(**given)
    return Fixed()


def spelled(law: Attitude) -> str:
    """A law as text for `parse`, with the settings that differ from their defaults."""
    usual = {k: getattr(type(law), k, None) for k in law.settings()}
    given = {k: v for k, v in law.settings().items() if v != usual[k]}
    if isinstance(law, ConstantRate):
        given = dict(zip("xyz", law.omega_rad_s, strict=True))
    settings = ",".join(f"{k}={str(v).removesuffix('.0')}" for k, v in given.items())
    return f"{law.name}:{settings}" if settings else law.name


def by_unique_name(laws: Sequence[Attitude]) -> dict[str, Attitude]:
    """Distinct laws by name, or by name and settings if several share a name."""
    each = {spelled(law): law for law in laws}
    count = Counter(law.name for law in each.values())
    return {law.name if count[law.name] == 1 else text: law for text, law in each.items()}
