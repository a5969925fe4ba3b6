"""Targets of a schedule: their names and their dependence on the unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.simulation.observability.parameters import Unknowns
from lcbayes.simulation.scenarios.scenario import ConstantRate, PrincipalAxis

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Target:
    """Factor B of `planning` for each of K versions of the truth.

    Attributes
    ----------
    name : as requested
    unit : unit of the rows, "deg", "rad/s" or "1" (logarithms, reflectances; for targets of mixed
        units, fractions of the prior error of each part)
    factor : (K, T, S)
    """

    name: str
    unit: str
    factor: Floats


def of_unknowns(unknowns: Unknowns, name: str) -> Target:
    """A target as a linear function of the unknowns, in units of their prior widths.

    "pole" is the direction of the spin axis, and "normal:2" is the normal of facet 2. A group, the
    name of a parameter, or "all" selects those parameters. Angles are in degrees.

    Raises
    ------
    InputError
        If no unknown has that name.
    """
    if name == "pole":
        return Target(name, "deg", np.degrees(_pole(unknowns) * unknowns.prior_sd)[None])
    rows = [i for i, p in enumerate(unknowns.parameters) if _named(p.name, p.group, p.facet, name)]
    if not rows:
        known = ", ".join(["pole", *dict.fromkeys(p.group for p in unknowns.parameters)])
        raise InputError(
            f"target {name!r} is not unknown here; choose from {known}, normal:I for facet I, "
            f"a parameter such as {unknowns.names[-1]!r}, or all"
        )
    units = {unknowns.parameters[i].unit for i in rows}
    if len(units) > 1:
        return Target(name, "1", np.eye(len(unknowns.parameters))[None, rows])
    unit, scale = ("deg", np.degrees(1.0)) if units == {"rad"} else (units.pop(), 1.0)
    return Target(name, unit, scale * np.diag(unknowns.prior_sd)[None, rows])


def _named(parameter: str, group: str, facet: int | None, name: str) -> bool:
    if name.startswith("normal:"):
        return group == "normals" and str(facet) == name.removeprefix("normal:")
    return name in ("all", group, parameter)


def _pole(unknowns: Unknowns) -> Floats:
    """∂(direction of the spin axis)/∂θ, two tangential components in rad, (2, P)."""
    law, names = unknowns.scenario.attitude, unknowns.names
    rows = np.zeros((2, len(names)))
    if isinstance(law, ConstantRate) and "omega_x" in names and any(law.omega_rad_s):
        omega = np.asarray(law.omega_rad_s)
        rate = float(np.linalg.norm(omega))
        columns = [names.index(f"omega_{axis}") for axis in "xyz"]
        rows[:, columns] = across(omega / rate) / rate
    elif isinstance(law, PrincipalAxis) and "pole_east" in names:
        rows[0, names.index("pole_east")] = rows[1, names.index("pole_north")] = 1.0
    else:
        raise InputError("target 'pole' needs a body that turns and a spin that is unknown")
    return rows


def across(direction: Floats) -> Floats:
    """Two unit vectors perpendicular to a unit vector and to each other, (2, 3)."""
    return np.asarray(_across(jnp.asarray(direction)))


def _across(direction: jax.Array) -> jax.Array:
    helper = jnp.eye(3)[jnp.argmin(jnp.abs(direction))]
    first = jnp.cross(direction, helper)
    first = first / jnp.linalg.norm(first)
    return jnp.stack([first, jnp.cross(direction, first)])


def of_sites(sites: Mapping[str, jax.Array], name: str) -> tuple[jax.Array, str]:
    """A target at one draw of a fit, as a differentiable function of the model's sites.

    A direction is represented by two tangential components, which are zero at the draw itself.

    Parameters
    ----------
    sites : as returned by `Problem.constrain`

    Returns
    -------
    value : (T,)
    unit : "" for mixed units

    Raises
    ------
    InputError
        If the posterior does not contain the target.
    """
    spin = sites.get("omega")
    if name == "pole" and spin is not None:
        return _tangents(spin), "deg"
    if name == "pole" and "pole_lon" in sites:
        lon, lat = sites["pole_lon"], sites["pole_lat"]
        axis = [jnp.cos(lat) * jnp.cos(lon), jnp.cos(lat) * jnp.sin(lon), jnp.sin(lat)]
        return _tangents(jnp.stack(axis)), "deg"
    if name == "spin" and spin is not None:
        return spin, "rad/s"
    normals, areas = sites.get("normals"), sites.get("albedo_area", sites.get("area"))
    if name.startswith("normal") and normals is not None:
        n, which = len(normals), name.removeprefix("normal:")
        chosen = range(n) if name == "normals" else [int(which)] if which.isdecimal() else []
        if chosen and max(chosen) < n:
            return jnp.concatenate([_tangents(normals[i]) for i in chosen]), "deg"
    if name == "areas" and areas is not None:
        return jnp.log(areas), "1"
    if name == "all":
        parts = ("spin" if spin is not None else "pole", "normals", "areas")
        values = [x for part in parts if (x := _try(sites, part)) is not None]
        if values:
            return jnp.concatenate(values), ""
    if name in sites and name not in ("normals", "omega"):
        return jnp.ravel(sites[name]), ""
    raise InputError(
        f"target {name!r} is not in the posterior; it holds {', '.join(sorted(sites))}: choose "
        "pole, spin, normals, normal:I for facet I, areas, all, or one of those"
    )


def _try(sites: Mapping[str, jax.Array], part: str) -> jax.Array | None:
    try:
        return of_sites(sites, part)[0]
    except InputError:
        return None


def _tangents(vector: jax.Array) -> jax.Array:
    """Components (deg) of a vector's direction along two perpendicular axes, (2,)."""
    unit = vector / jnp.linalg.norm(vector)
    return jnp.degrees(_across(jax.lax.stop_gradient(unit)) @ unit)
