"""What a schedule is to find out: names of targets, and what they are made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.errors import InputError
from lcbayes.observability.parameters import GROUPS, Unknowns
from lcbayes.scenario import ConstantRate, PrincipalAxis

Floats = NDArray[np.float64]
NAMES = ("pole", *GROUPS, "normal:I", "all")


@dataclass(frozen=True)
class Target:
    """Factor B of `planning`, with the unit of its rows.

    Attributes
    ----------
    name : as it was asked for
    unit : "deg", "rad/s" or "1" (logarithms, reflectances; shares of what was known, for a mixture)
    factor : (T, S)
    """

    name: str
    unit: str
    factor: Floats


def of_unknowns(unknowns: Unknowns, name: str) -> Target:
    """A target as a linear function of the unknowns, each in units of its prior's width.

    "pole" is the direction of the spin axis; "normal:2" that of facet 2; a group, a parameter's
    name or "all" are those parameters. Angles are in degrees.

    Raises
    ------
    InputError
        Nothing unknown has that name.
    """
    if name == "pole":
        return Target(name, "deg", np.degrees(_pole(unknowns) * unknowns.prior_sd))
    rows = [i for i, p in enumerate(unknowns.parameters) if _named(p.name, p.group, p.facet, name)]
    if not rows:
        known = ", ".join(["pole", *dict.fromkeys(p.group for p in unknowns.parameters)])
        raise InputError(
            f"target {name!r} is not unknown here; choose from {known}, normal:I for facet I, "
            f"a parameter such as {unknowns.names[-1]!r}, or all"
        )
    units = {unknowns.parameters[i].unit for i in rows}
    if len(units) > 1:
        return Target(name, "1", np.eye(len(unknowns.parameters))[rows])
    unit, scale = ("deg", np.degrees(1.0)) if units == {"rad"} else (units.pop(), 1.0)
    return Target(name, unit, scale * np.diag(unknowns.prior_sd)[rows])


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
    elif isinstance(law, PrincipalAxis) and "pole_lon" in names:
        rows[0, names.index("pole_lon")] = np.cos(np.radians(law.pole_lat_deg))
        rows[1, names.index("pole_lat")] = 1.0
    else:
        raise InputError("target 'pole' needs a body that turns and a spin that is unknown")
    return rows


def across(direction: Floats) -> Floats:
    """Two unit vectors that are perpendicular to a unit vector and to each other, (2, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first)]).astype(np.float64)


def sampled(posterior: xr.Dataset, pick: NDArray[np.intp]) -> Floats:
    """Draws of everything that a posterior holds, a column each, (S, D)."""
    return np.concatenate([x.reshape(len(pick), -1) for x in _drawn(posterior, pick).values()], 1)


def _drawn(posterior: xr.Dataset, pick: NDArray[np.intp]) -> dict[str, Floats]:
    return {
        str(k): v.values.reshape(-1, *v.shape[2:])[pick]
        for k, v in posterior.data_vars.items()
        if v.dtype.kind == "f" and v.dims[:2] == ("chain", "draw")
    }


def of_posterior(posterior: xr.Dataset, pick: NDArray[np.intp], name: str) -> Target:
    """The same from draws of a fit, about their mean and over √(S − 1).

    Raises
    ------
    InputError
        The posterior does not hold it.
    """
    rows, unit = _of_draws(_drawn(posterior, pick), name)
    rows = rows - rows.mean(axis=0)
    if unit == "":
        rows, unit = rows / rows.std(axis=0, ddof=1), "1"
    return Target(name, unit, rows.T / np.sqrt(len(rows) - 1))


def _of_draws(drawn: dict[str, Floats], name: str) -> tuple[Floats, str]:
    """Draws of the target (S, T) and its unit, "" for a mixture."""
    spin = drawn.get("omega")
    if name == "pole" and spin is not None:
        return _tangents(spin), "deg"
    if name == "pole" and "pole_lon" in drawn:
        lon, lat = drawn["pole_lon"], drawn["pole_lat"]
        axis = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], -1)
        return _tangents(axis), "deg"
    if name == "spin" and spin is not None:
        return spin, "rad/s"
    normals, areas = drawn.get("normals"), drawn.get("albedo_area", drawn.get("area"))
    if name.startswith("normal") and normals is not None:
        n, which = normals.shape[1], name.removeprefix("normal:")
        chosen = range(n) if name == "normals" else [int(which)] if which.isdigit() else []
        if chosen and max(chosen) < n:
            return np.concatenate([_tangents(normals[:, i]) for i in chosen], axis=1), "deg"
    if name == "areas" and areas is not None:
        return np.log(areas), "1"
    if name == "all":
        found = [
            x
            for part in ("spin", "pole", "normals", "areas")
            if (x := _try(drawn, part)) is not None
        ]
        if found:
            return np.concatenate(found, axis=1), ""
    if name in drawn and name not in ("normals", "omega"):
        return drawn[name].reshape(len(drawn[name]), -1), ""
    raise InputError(
        f"target {name!r} is not in the posterior; it holds {', '.join(sorted(drawn))}: choose "
        "pole, spin, normals, normal:I for facet I, areas, all, or one of those"
    )


def _try(drawn: dict[str, Floats], part: str) -> Floats | None:
    if part == "pole" and "omega" in drawn:
        return None  # spin has it
    try:
        return _of_draws(drawn, part)[0]
    except InputError:
        return None


def of_directions(vectors: Floats) -> Floats:
    """Angles (deg) of drawn vectors (S, 3) from their mean along two axes across it, (2, S).

    Centred: over √(S − 1) they are the factor of a target.
    """
    found = _tangents(vectors)
    return (found - found.mean(axis=0)).T


def _tangents(vectors: Floats) -> Floats:
    """Angles (deg) of vectors from the direction of their mean along two axes, (S, 2)."""
    unit = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    mean = unit.mean(axis=0)
    mean /= np.linalg.norm(mean)
    axes = across(mean)
    off = np.degrees(np.arccos(np.clip(unit @ mean, -1.0, 1.0)))
    flat = unit @ axes.T
    length = np.maximum(np.linalg.norm(flat, axis=1), 1e-300)
    return flat * (off / length)[:, None]
