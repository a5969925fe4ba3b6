"""Scenarios: body, rotation, viewing geometry and noise, read from a TOML file.

Scenarios are the input of `lcbayes simulate` and `lcbayes observability`. All values are checked on
reading; docs/scenarios.md lists the keys.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.toml import REQUIRED, Table, read_toml
from lcbayes.physics.attitude import catalogue
from lcbayes.physics.attitude.laws import (
    Attitude,
    ConstantRate,
    Fixed,
    Law,
    PrincipalAxis,
    TorqueFree,
)
from lcbayes.physics.bodies import shapes
from lcbayes.physics.bodies.parts import Assembly
from lcbayes.simulation.scenarios import bundled
from lcbayes.simulation.scenarios.body import Material, read_body, read_materials
from lcbayes.simulation.scenarios.parts import read_parts
from lcbayes.simulation.scenarios.viewing import MAX_RATE, Orbit, Planar, Vectors, read_geometry

MAX_EXPOSURE_S = 86400.0
PERIODS_S = (1e-3, 1e12)
NOISES = {"sigma": (1e-30, 1e30), "mag_err": (1e-12, 10.0), "snr": (1e-6, 1e12)}
FREE = ("constant-rate", "principal-axis", "torque-free", "fixed")


@dataclass(frozen=True)
class Noise:
    """Gaussian noise: `kind` "sigma" (flux), "mag_err" (mag) or "snr"."""

    kind: str
    value: float


@dataclass(frozen=True)
class Scenario:
    """A body and its observation, to be simulated.

    Attributes
    ----------
    name : file name without its extension
    body : `shapes.Body`; its labels are keys of `materials`
    materials : name → `Material`
    attitude, geometry, noise : see their classes
    kind : "flux" or "mag"
    band : photometric band, for magnitudes
    exposure_s : 0 for instantaneous brightness
    on_array : for each facet, whether it rotates with the solar array of the attitude law; its
        normal is then in the axes of the array (front x, hinge y)
    parts : for a body with parts, the parts and their shadows; their panels are the facets of
        `body`
    """

    name: str
    body: shapes.Body
    materials: Mapping[str, Material]
    attitude: Attitude
    geometry: Planar | Orbit | Vectors
    noise: Noise
    kind: str
    band: str
    exposure_s: float
    on_array: tuple[bool, ...] = ()
    parts: Assembly | None = None


def scenario_path(scenario: str | Path) -> Path:
    """The file of a scenario given by its path or, if bundled, by its name.

    Raises
    ------
    InputError
        If it does not exist.
    """
    path = Path(scenario)
    if not path.exists() and path.suffix != ".toml":
        named = bundled()
        if str(scenario) not in named:
            raise InputError(
                f"no file and no scenario is called {str(scenario)!r}; available: "
                f"{', '.join(named)}; or give a TOML file"
            )
        path = named[str(scenario)]
    return path


def input_files(scenario: str | Path) -> dict[str, Path]:
    """The file of a scenario and the files it refers to: "scenario", "body", "geometry", "tle"."""
    path = scenario_path(scenario)
    root = read_toml(path)
    files = {"scenario": path}
    for table, key, name in (
        ("body", "file", "body"),
        ("geometry", "file", "geometry"),
        ("geometry", "tle", "tle"),
    ):
        section = root.table(table, None)
        text = section.text(key, "") if section is not None and key in section else ""
        if text and "\n" not in text.strip():
            files[name] = path.parent / text
    return files


def load(scenario: str | Path) -> Scenario:
    """Read a scenario from a TOML file, or a bundled one by its name.

    Raises
    ------
    InputError
        If a value is invalid; the message gives file, line, table, key and the expected value.
    """
    path = scenario_path(scenario)
    root = read_toml(path)
    materials = read_materials(root)
    table, parts = root.table("body"), None
    if "parts" in table:
        parts, on_array = read_parts(table, materials)
        body = parts.body
    else:
        body, on_array = read_body(table, materials)
    attitude = _attitude(root.table("attitude"))
    if attitude.array and not any(on_array):
        raise table.fault(
            None,
            f"has no facet on the solar array that the law {attitude.name!r} turns; name a part "
            "'panel' or 'back', or set on_array = true for its facets",
        )
    geometry = read_geometry(root.table("geometry"))
    noise = _noise(root.table("noise"))
    output = root.table("output", None) or root.blank()
    kind = output.text("kind", "mag" if noise.kind == "mag_err" else "flux", ("flux", "mag"))
    band = output.text("band", "V" if kind == "mag" else "")
    exposure = output.number("exposure_s", 0.0, 0.0, MAX_EXPOSURE_S)
    output.done()
    root.text("title", "")
    root.done()
    if kind == "mag" and noise.kind == "sigma":
        raise root.table("noise").fault(
            "sigma", "is a flux, but output.kind is 'mag'; give mag_err or snr"
        )
    if kind == "mag" and isinstance(geometry, Planar) and geometry.range_km is None:
        raise root.table("geometry").fault(
            None, "has no 'range_km'; a magnitude needs a distance (or set output.kind = 'flux')"
        )
    return Scenario(
        path.stem,
        body,
        materials,
        attitude,
        geometry,
        noise,
        kind,
        band,
        exposure,
        on_array if attitude.array else (),
        parts,
    )


def _attitude(table: Table) -> Attitude:
    law = table.text("law")
    if law not in FREE:
        return _stabilised(law, table)
    attitude: Attitude
    if law == "constant-rate":
        attitude = ConstantRate(table.vector("omega_rad_s", limit=MAX_RATE))
    elif law == "principal-axis":
        period = _period(table)
        attitude = PrincipalAxis(
            table.number("pole_lon_deg"),
            table.number("pole_lat_deg", low=-90.0, high=90.0),
            period,
            table.number("phase0_deg", 0.0),
        )
    elif law == "torque-free":
        inertia = table.vector("inertia")
        if min(inertia) <= 0.0 or 2.0 * max(inertia) > sum(inertia) * (1.0 + 1e-12):
            raise table.fault(
                "inertia",
                f"is {list(inertia)}; no body has these moments: each is positive and at most the "
                "sum of the other two",
            )
        turn = (table.number(f"{k}_deg", 0.0) for k in ("yaw", "pitch", "roll"))
        attitude = TorqueFree(table.vector("omega_rad_s", limit=MAX_RATE), inertia, *turn)
    else:
        attitude = Fixed()
    table.done()
    return attitude


def _stabilised(name: str, table: Table) -> Law:
    """A law of the catalogue."""
    try:
        law = catalogue.find(name)
    except InputError:
        known = ", ".join((*FREE, *catalogue.LAWS))
        raise table.fault("law", f"is {name!r}; expected one of: {known}") from None
    given: dict[str, float] = {"period_s": _period(table)} if law.spins else {}
    for key in law.keys:
        if key != "period_s":
            given[key] = table.number(key, 0.0)
    table.done()
    return law.set(**given)


def _period(table: Table) -> float:
    """Period in s, from `period_h` or `period_s`."""
    if ("period_h" in table) == ("period_s" in table):
        raise table.fault(None, "needs one of 'period_h' and 'period_s'")
    unit, scale = ("period_h", HOUR_S) if "period_h" in table else ("period_s", 1.0)
    period = table.number(unit)
    if period == 0:
        raise table.fault(unit, "is 0; a period is positive, or negative for the other sense")
    shortest, longest = PERIODS_S
    if not shortest <= abs(period) * scale <= longest:
        raise table.fault(
            unit, f"is {period:g}; expected from {shortest / scale:g} to {longest / scale:g}"
        )
    return period * scale


def _noise(table: Table) -> Noise:
    kinds = [key for key in NOISES if key in table]
    if len(kinds) != 1:
        given = " and ".join(map(repr, kinds)) or "none of them"
        raise table.fault(None, f"needs one of 'sigma', 'mag_err' and 'snr'; it has {given}")
    noise = Noise(kinds[0], table.number(kinds[0], REQUIRED, *NOISES[kinds[0]]))
    table.done()
    return noise
