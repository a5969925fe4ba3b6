"""The tables [[body.parts]] of a scenario: parts with sizes, places, directions and materials."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.toml import REQUIRED, Table
from lcbayes.physics.bodies import division
from lcbayes.physics.bodies.mesh import read_mesh
from lcbayes.physics.bodies.parts import Assembly, Part, rotation_by, rotation_to
from lcbayes.physics.bodies.primitives import KINDS, Kind, Panels, circle_sides, moved
from lcbayes.physics.bodies.shapes import LARGEST_M, SMALLEST_M
from lcbayes.simulation.scenarios.body import LONGEST, Material

MESH = "mesh"
TOLERANCES = (1e-6, 0.1)
MOST_DEG = 1e6


def read_parts(
    table: Table, materials: Mapping[str, Material]
) -> tuple[Assembly, tuple[bool, ...]]:
    """The table [body] with its parts, and which of its panels are on a solar array.

    A side of a part takes its own material (``end_material``, ``back_material``), else that of the
    part, else ``body.material``, else the only one there is; a face of a mesh takes the material of
    its own name, where there is one, before that of its part.

    Raises
    ------
    InputError
        One line with file, line and key.
    """
    others = [key for key in ("facets", "shape", "file") if key in table]
    if others:
        raise table.fault(None, f"has 'parts' and {others[0]!r}; give one of them")
    only = next(iter(materials)) if len(materials) == 1 else None
    default = table.text("material", only, tuple(materials))
    shaded = table.flag("shadows", True)
    tolerance = table.number("tolerance", division.TOLERANCE, *TOLERANCES)
    parts, on_array = [], []
    for one in table.tables("parts"):
        part = _part(one, materials, default, tolerance)
        parts.append(part)
        on_array += [one.flag("on_array", False)] * len(part.panels.areas)
        one.done()
    if not parts:
        raise table.fault("parts", "is empty; give at least one [[body.parts]]")
    if shaded and any(on_array):
        raise table.fault(
            "shadows",
            "needs a rigid body, and a part has on_array = true; set body.shadows = false, or "
            "leave on_array out",
        )
    table.done()
    return Assembly(tuple(parts), shaded, tolerance), tuple(on_array)


def _part(
    table: Table, materials: Mapping[str, Material], default: str | None, tolerance: float
) -> Part:
    kind = table.text("kind", choices=(*KINDS, MESH))
    fallback = REQUIRED if default is None else default
    material = table.text("material", fallback, tuple(materials))
    position = table.vector("position", default=(0.0, 0.0, 0.0), limit=LARGEST_M)
    rotation = _rotation(table)
    if kind == MESH:
        scale = table.number("scale", 1.0, low=SMALLEST_M, high=LARGEST_M)
        made, error = read_mesh(table.path.parent / table.text("file"), scale), 0.0
        labels = tuple(side if side in materials else material for side in made.sides)
        sizes = {"scale": scale}
    else:
        shape = KINDS[kind]
        sizes = {key: _size(table, key) for key in shape.sizes}
        own = {
            side: material if i == 0 else table.text(f"{side}_material", material, tuple(materials))
            for i, side in enumerate(shape.sides)
        }
        made, error = _divided(table, shape, sizes, own, materials, tolerance)
        labels = tuple(own[side] for side in made.sides)
    panels = moved(made._replace(sides=labels), rotation, np.array(position))
    return Part(kind, sizes, position, rotation, panels, error)


def _size(table: Table, key: str) -> float:
    """A length in m; the top of a frustum may be a point."""
    return table.number(key, low=0.0 if key == "radius_top" else SMALLEST_M, high=LARGEST_M)


def _divided(
    table: Table,
    shape: Kind,
    sizes: Mapping[str, float],
    own: Mapping[str, str],
    materials: Mapping[str, Material],
    tolerance: float,
) -> tuple[Panels, float]:
    if not shape.curved:
        return shape.make(*sizes.values()), 0.0
    surfaces = {side: (materials[m].law, materials[m].parameters) for side, m in own.items()}
    make = partial(shape.make, *sizes.values())
    if shape.round_ends:
        make = partial(make, end_sides=circle_sides(tolerance))
    try:
        return division.divide(make, surfaces, tolerance)
    except division.TooManyPanels as fault:
        raise table.fault(
            None,
            f"is so glossy that {fault}, over the tolerance of {tolerance:g}; set body.tolerance, "
            "or take a wider lobe",
        ) from None


def _rotation(table: Table) -> NDArray[np.float64]:
    """From `direction` and `roll_deg`, or from `rotation_deg`."""
    if "rotation_deg" in table:
        if "direction" in table or "roll_deg" in table:
            raise table.fault("rotation_deg", "and 'direction' exclude each other; give one")
        return rotation_by(table.vector("rotation_deg", limit=MOST_DEG))
    direction = np.array(table.vector("direction", default=(0.0, 0.0, 1.0), limit=LONGEST))
    if not np.linalg.norm(direction) > 0.0:
        raise table.fault("direction", "has length zero; give the direction of the part's z axis")
    return rotation_to(direction, table.number("roll_deg", 0.0, -MOST_DEG, MOST_DEG))


def described(assembly: Assembly) -> dict[str, Any]:
    """What the truth of a light curve says of a body of parts, ready for JSON."""
    return {
        "parts": [
            {
                "kind": part.kind,
                "sizes": dict(part.sizes),
                "position_m": list(part.position),
                "rotation": part.rotation.tolist(),
                "materials": sorted(set(part.panels.sides)),
                "panels": len(part.panels.areas),
                "area_m2": float(part.panels.areas.sum()),
                "flux_error": part.error,
            }
            for part in assembly.parts
        ],
        "shadows": {"method": assembly.method, "flux_error": assembly.shadow_error},
    }
