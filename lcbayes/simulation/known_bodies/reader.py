"""Files of bodies of known shape: the tables [body] and [materials] of a scenario, with priors.

A number that is unknown is written as a prior: ``{ low = 0.1, high = 0.6 }`` is uniform, and
``{ median = 30, factor = 2 }`` log-normal, with 68 % within that factor of the median.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lcbayes.core.errors import InputError
from lcbayes.core.files import printable
from lcbayes.core.toml import REQUIRED, Table, parse_toml, read_toml
from lcbayes.physics.bodies import primitive_flux
from lcbayes.physics.bodies.shapes import LARGEST_M, SMALLEST_M
from lcbayes.physics.reflectance import LAWS, Parameter
from lcbayes.simulation.known_bodies import bundled
from lcbayes.simulation.known_bodies.body import KnownBody
from lcbayes.simulation.scenarios.body import Material
from lcbayes.simulation.scenarios.parts import MESH, read_parts

OF_SCENARIOS = ("attitude", "geometry", "noise", "output")
"""Tables that a file may have as a scenario, and that do not describe the body."""
UNNAMED = "the body's file"  # with which messages about a text begin
FACTORS = (1.0 + 1e-9, 1e3)  # range of the factor of a log-normal prior


class Prior(NamedTuple):
    """The prior of a number: uniform on [low, high], or log-normal of a median and a factor.

    Attributes
    ----------
    kind : "uniform" or "log-normal"
    first, second : float
        low and high, or median and factor.
    """

    kind: str
    first: float
    second: float

    @property
    def centre(self) -> float:
        """Median."""
        return 0.5 * (self.first + self.second) if self.kind == "uniform" else self.first


@dataclass(frozen=True)
class BodyFile:
    """The content of a file.

    Attributes
    ----------
    title : str
    body : KnownBody
    priors : {material: {parameter: Prior}}
        Of the parameters that are unknown.
    sizes : {(part, length): Prior}
        Of the lengths that are unknown, by the number of the part.
    """

    title: str
    body: KnownBody
    priors: Mapping[str, Mapping[str, Prior]]
    sizes: Mapping[tuple[int, str], Prior]


def body_text(body: str) -> str:
    """The text of a body given by the name of a bundled one, by its file, or as that text itself.

    Raises
    ------
    InputError
        There is no such body or file, or its content is invalid.
    """
    if "\n" in body:
        return body
    path = Path(body)
    if path.suffix != ".toml" and not path.is_file():
        named = bundled()
        if body not in named:
            raise InputError(
                f"no file and no body is called {body!r}; available: {', '.join(named)}; or give "
                "a TOML file"
            )
        path = named[body]
    read_toml(path)  # for its errors, which name the file
    text = path.read_text(encoding="utf-8-sig").rstrip() + "\n"
    try:
        read_body_text(text, None)
    except InputError as fault:
        raise InputError(str(fault).replace(UNNAMED, printable(path), 1)) from None
    return text


@lru_cache(maxsize=32)
def read_body_text(text: str, tolerance: float | None = None) -> BodyFile:
    """The body of a TOML text, from `body_text`, to a tolerance of its own or a given one.

    Raises
    ------
    InputError
        If a value is invalid; the message gives line, table, key and the expected value.
    """
    root = parse_toml(text, UNNAMED)
    title = root.text("title", "a body of known shape")
    materials, priors = _materials(root)
    table = root.table("body")
    if "parts" not in table:
        raise table.fault(
            None, "has no [[body.parts]]; a fit needs parts with places (box, cylinder, plate …)"
        )
    axis = table.vector("spin_axis", default=None, limit=LARGEST_M)
    if axis is not None and not np.linalg.norm(axis) > 0.0:
        raise table.fault("spin_axis", "has length zero; give a direction in body axes")
    sizes, names = _sizes(table)
    sides = _sides(table, materials)
    if tolerance:
        table.put("tolerance", tolerance)
    assembly, _ = read_parts(table, materials)
    if sizes and assembly.shaded and len(assembly.parts) > 1:
        raise table.fault(
            "shadows",
            "needs parts of known size; give each length as a number, from a drawing or from a fit "
            "with shadows = false (only proportions matter, as the scale is free)",
        )
    for name in OF_SCENARIOS:
        root.table(name, None)
    root.done()
    body = KnownBody.of(assembly, materials, axis, sides, names, tuple(sizes))
    return BodyFile(title, body, {name: priors[name] for name in body.materials}, sizes)


def with_shadows(
    text: str, sizes: Mapping[tuple[int, str], float], tolerance: float | None = None
) -> KnownBody:
    """The body of a TOML text with shadows, whatever the file says of them.

    Parameters
    ----------
    text : str
        As for `read_body_text`, which must accept it.
    sizes : (part, length) → m
        Values of the lengths that are unknown.
    tolerance : float, optional
        Of the flux of curved parts, over its maximum. Default: that of the file.
    """
    root = parse_toml(text, UNNAMED)
    materials, _ = _materials(root)
    table = root.table("body")
    _sizes(table)
    for i, part in enumerate(table.tables("parts")):
        if "on_array" in part:  # a fit takes every body as rigid
            part.put("on_array", None)
        for (owner, key), size in sizes.items():
            if owner == i:
                part.put(key, size)
    table.put("shadows", True)
    if tolerance is not None:
        table.put("tolerance", tolerance)
    table.vector("spin_axis", default=None)
    assembly, _ = read_parts(table, materials)
    return KnownBody.of(assembly, materials)


def _sizes(table: Table) -> tuple[dict[tuple[int, str], Prior], tuple[str, ...]]:
    """Priors of lengths, which are put at their medians, and a name for each part."""
    sizes: dict[tuple[int, str], Prior] = {}
    names: list[str] = []
    parts = table.tables("parts")
    kinds = [part.text("kind", "") for part in parts]
    for i, (part, kind) in enumerate(zip(parts, kinds, strict=True)):
        if kind == MESH:
            raise part.fault(
                "kind",
                "is a mesh, whose shadows have no derivative; describe the body by box, cylinder, "
                "cone, frustum, plate, sphere or ellipsoid",
            )
        alone = kind if kinds.count(kind) == 1 else f"{kind}{kinds[: i + 1].count(kind)}"
        names.append(part.text("name", alone))
        if "name" in part:
            part.put("name", None)
        for key in primitive_flux.KINDS[kind].sizes if kind in primitive_flux.KINDS else ():
            if isinstance(part.values.get(key), dict):
                prior = read_prior(part, key, Parameter(SMALLEST_M, LARGEST_M, "length"))
                sizes[i, key] = prior
                part.put(key, prior.centre)
    if len(set(names)) < len(names):
        raise table.fault("parts", f"has parts of one name among {', '.join(names)}")
    return sizes, tuple(names)


def _sides(table: Table, materials: Mapping[str, Material]) -> tuple[dict[str, str], ...]:
    """The material of each side of each part, as `scenarios.parts` reads them."""
    only = next(iter(materials)) if len(materials) == 1 else ""
    default = table.text("material", only)
    listed = []
    for part in table.tables("parts"):
        kind = primitive_flux.KINDS.get(part.text("kind", ""))
        own = part.text("material", default)
        sides = () if kind is None else kind.sides
        listed.append(
            {s: own if i == 0 else part.text(f"{s}_material", own) for i, s in enumerate(sides)}
        )
    return tuple(listed)


def _materials(root: Table) -> tuple[dict[str, Material], dict[str, dict[str, Prior]]]:
    """Materials with unknown parameters at the medians of their priors, and those priors."""
    outer = root.table("materials")
    materials: dict[str, Material] = {}
    priors: dict[str, dict[str, Prior]] = {}
    for name in outer.keys():  # noqa: SIM118
        table = outer.table(name)
        law = table.text("law", choices=tuple(LAWS))
        values: dict[str, float] = {}
        unknown: dict[str, Prior] = {}
        for key, allowed in LAWS[law].parameters.items():
            # nv may be left out: the lobe is then as wide along v as along u
            default = values["nu"] if key == "nv" else allowed.default
            if isinstance(table.values.get(key), dict):
                unknown[key] = read_prior(table, key, allowed)
                values[key] = unknown[key].centre
            else:
                values[key] = table.number(
                    key, REQUIRED if default is None else default, allowed.lower, allowed.upper
                )
        if "nu" in unknown and "nv" in LAWS[law].parameters and "nv" not in table:
            unknown.pop("nv", None)
        table.done()
        if LAWS[law].sum_to_one:
            _check_sum(table, values, unknown)
        materials[name], priors[name] = Material(law, values), unknown
    if not materials:
        raise outer.fault(None, "is empty; describe at least one material as [materials.NAME]")
    return materials, priors


def read_prior(table: Table, key: str, allowed: Parameter) -> Prior:
    """The prior that a table holds for a key, within the range of a parameter."""
    inner = table.table(key)
    if "median" in inner:
        if math.isfinite(allowed.upper) and allowed.upper <= 1.0:
            raise inner.fault(
                "median",
                f"would allow values above {allowed.upper:g}; give {{ low = …, high = … }}",
            )
        median = inner.number("median", above=max(allowed.lower, 0.0), high=allowed.upper)
        prior = Prior("log-normal", median, inner.number("factor", REQUIRED, *FACTORS))
    else:
        low = inner.number("low", low=allowed.lower, high=allowed.upper)
        high = inner.number("high", above=low, high=allowed.upper)
        prior = Prior("uniform", low, high)
    inner.done()
    return prior


def _check_sum(table: Table, values: Mapping[str, float], unknown: Mapping[str, Prior]) -> None:
    """Refuse priors under which a surface may reflect more light than it receives."""
    most = sum(
        unknown[key].second if key in unknown else values[key] for key in ("r_diff", "r_spec")
    )
    if most > 1.0 + 1e-12:
        raise table.fault(
            None, f"may reflect r_diff + r_spec = {most:g} of the light; give a sum <= 1"
        )


def described(file: BodyFile) -> str:
    """A body in a line: its title and what is unknown of it."""
    names = [f"{file.body.names[i]} {k}" for i, k in file.sizes]
    names += [f"{m} {k}" for m, priors in file.priors.items() for k in priors]
    unknown = f"; unknown: {', '.join(names)}" if names else ""
    return printable(f"{file.title}{unknown}")
