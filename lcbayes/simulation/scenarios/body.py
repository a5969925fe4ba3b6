"""The body of a scenario: materials, and facets listed, of a built-in shape or from an OBJ file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lcbayes.core.toml import REQUIRED, Table
from lcbayes.physics.bodies import mesh, shapes
from lcbayes.physics.bodies.shapes import LARGEST_M, SMALLEST_M
from lcbayes.physics.reflectance import LAWS

LONGEST = 1e6  # of a vector whose direction alone counts


@dataclass(frozen=True)
class Material:
    """A reflectance law and its parameters, by their names in `reflectance.LAWS`."""

    law: str
    parameters: Mapping[str, float]


def read_materials(root: Table) -> dict[str, Material]:
    """The tables [materials.NAME], every parameter within its law's bounds."""
    outer = root.table("materials")
    materials = {name: _material(outer.table(name)) for name in outer.keys()}  # noqa: SIM118
    if not materials:
        raise outer.fault(None, "is empty; describe at least one material as [materials.NAME]")
    return materials


def _material(table: Table) -> Material:
    name = table.text("law", choices=tuple(LAWS))
    values: dict[str, float] = {}
    for key, allowed in LAWS[name].parameters.items():
        # nv may be left out: the lobe is then as wide along v as along u
        default = values["nu"] if key == "nv" else allowed.default
        values[key] = table.number(
            key, REQUIRED if default is None else default, low=allowed.lower, high=allowed.upper
        )
    table.done()
    if LAWS[name].sum_to_one and values["r_diff"] + values["r_spec"] > 1.0:
        total = values["r_diff"] + values["r_spec"]
        raise table.fault(
            None, f"reflects r_diff + r_spec = {total:g} of the light; give a sum <= 1"
        )
    return Material(name, values)


ON_ARRAY = (
    "panel",
    "back",
)  # parts that a solar array consists of, unless a scenario says otherwise


def read_body(
    table: Table, materials: Mapping[str, Material]
) -> tuple[shapes.Body, tuple[bool, ...]]:
    """The table [body], and which of its facets are on a solar array.

    The labels of the body that is returned are names of materials.

    A facet without a material of its own takes that of its part's name (shapes and files), else
    ``body.material``, else the only one there is.
    """
    kinds = [key for key in ("facets", "shape", "file") if key in table]
    if len(kinds) != 1:
        given = " and ".join(map(repr, kinds)) or "none of them"
        raise table.fault(
            None, f"needs one of 'facets', 'parts', 'shape' and 'file'; it has {given}"
        )
    if table.flag("shadows", False):
        raise table.fault("shadows", "needs places; give the body as [[body.parts]]")
    only = next(iter(materials)) if len(materials) == 1 else None
    default = table.text("material", only, tuple(materials))
    on_arrays: list[bool | None] = []
    if kinds == ["facets"]:
        body, on_arrays = _facets(table, default, materials)
    elif kinds == ["shape"]:
        name = table.text("shape", choices=tuple(shapes.SHAPES))
        body = shapes.shape(name, **_sizes(table, name))
    else:
        body = mesh.read_body(table.path.parent / table.text("file"))
    table.done()
    for label in body.labels:
        if label not in materials and default is None:
            raise table.fault(
                None,
                f"has a part {label!r} without a material; describe [materials.{label}] or set "
                "body.material",
            )
    on_arrays = on_arrays or [None] * len(body.labels)
    on_array = tuple(
        label in ON_ARRAY if one is None else one
        for one, label in zip(on_arrays, body.labels, strict=True)
    )
    labels = tuple(label if label in materials else str(default) for label in body.labels)
    return body._replace(labels=labels), on_array


def _facets(
    table: Table, default: str | None, materials: Mapping[str, Material]
) -> tuple[shapes.Body, list[bool | None]]:
    """The tables [[body.facets]], and what each says of the solar array."""
    normals, areas, axes, labels, on_array = [], [], [], [], []
    for facet in table.tables("facets"):
        normal = _normal(facet)
        normals.append(normal)
        areas.append(facet.number("area_m2", above=0.0, high=LARGEST_M**2))
        axes.append(_in_plane(facet, normal))
        fallback = REQUIRED if default is None else default
        labels.append(facet.text("material", fallback, choices=tuple(materials)))
        on_array.append(facet.flag("on_array", None))
        facet.done()
    if not normals:
        raise table.fault("facets", "is empty; give at least one [[body.facets]]")
    made = shapes.Body(np.array(normals), np.array(areas), np.array(axes), tuple(labels))
    return made, on_array


def _normal(facet: Table) -> shapes.Floats:
    """From `normal`, of any length, or from `phi` (rad) and `g`."""
    if "normal" in facet:
        normal = np.array(facet.vector("normal", limit=LONGEST))
        length = np.linalg.norm(normal)
        if length == 0:
            raise facet.fault("normal", "has length zero; give the outward direction")
        return normal / length
    phi, g = facet.number("phi"), facet.number("g", low=-1.0, high=1.0)
    s = np.sqrt(1.0 - g * g)
    return np.array([s * np.cos(phi), s * np.sin(phi), g])


def _in_plane(facet: Table, normal: shapes.Floats) -> shapes.Floats:
    """The unit vector `u`, for anisotropic laws."""
    if "u" not in facet:
        return shapes.plane_axis(normal)[0]
    u = np.array(facet.vector("u", limit=LONGEST))
    length = np.linalg.norm(u)
    if length == 0 or abs(u @ normal) > 1e-6 * length:
        raise facet.fault("u", f"is {u.tolist()}; expected a direction in the facet's plane")
    return u / length


_SIZES = {  # lengths in m; the shape's own defaults hold for what is left out
    "cube": ("side",),
    "tetrahedron": ("side",),
    "plate": ("x", "y"),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "rocket-body": ("radius", "length"),
    "box-wing": (),
}


def _sizes(table: Table, name: str) -> dict[str, Any]:
    """The dimensions of a built-in shape, as its function takes them."""
    sizes = {key: table.number(key, None, low=SMALLEST_M, high=LARGEST_M) for key in _SIZES[name]}
    if name == "box-wing":
        for key, length in (("bus", 3), ("wing", 2)):
            sizes[key] = table.vector(key, length, None, limit=LARGEST_M)
            if sizes[key] is not None and not min(sizes[key]) >= SMALLEST_M:
                raise table.fault(key, f"is {list(sizes[key])}; expected lengths >= {SMALLEST_M:g}")
        sizes["cant_deg"] = table.number("cant_deg", None)
    return {key: value for key, value in sizes.items() if value is not None}
