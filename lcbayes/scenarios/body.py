"""The body of a scenario: materials, and facets listed, of a built-in shape or from an OBJ file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from lcbayes._toml import Table
from lcbayes.physics import shapes
from lcbayes.physics.reflectance import LAWS


@dataclass(frozen=True)
class Material:
    """A reflectance law and its parameters, by their names in `reflectance.LAWS`."""

    law: str
    parameters: Mapping[str, float]


def read_materials(root: Table) -> dict[str, Material]:
    outer = root.table("materials")
    found = {}
    for name in outer.keys():  # noqa: SIM118 - a Table is not a mapping
        table = outer.table(name)
        law_name = table.text("law", choices=tuple(LAWS))
        law = LAWS[law_name]
        values = {}
        for key, parameter in law.parameters.items():
            # nv may be left out: the lobe is then as wide along v as along u
            default = values["nu"] if key == "nv" else parameter.default
            values[key] = (
                table.number(key, low=parameter.lower, high=parameter.upper)
                if default is None
                else table.number(key, default, low=parameter.lower, high=parameter.upper)
            )
        table.done()
        if law.sum_to_one and values["r_diff"] + values["r_spec"] > 1.0:
            raise table.fault(
                None, f"reflects r_diff + r_spec = {values['r_diff'] + values['r_spec']:g} of the "
                "light; give a sum <= 1",
            )  # fmt: skip
        found[name] = Material(law_name, values)
    if not found:
        raise outer.fault(None, "is empty; describe at least one material as [materials.NAME]")
    return found


def read_body(table: Table, materials: Mapping[str, Material]) -> shapes.Body:
    ways = [key for key in ("facets", "shape", "file") if key in table]
    if len(ways) != 1:
        given = " and ".join(map(repr, ways)) or "none of them"
        raise table.fault(None, f"needs one of 'facets', 'shape' and 'file'; it has {given}")
    default = table.text("material", None, tuple(materials))
    if ways == ["facets"]:
        body = _facets(table.tables("facets"), default, materials)
    elif ways == ["shape"]:
        name = table.text("shape", choices=tuple(shapes.SHAPES))
        body = shapes.shape(name, **_sizes(table, name))
    else:
        body = shapes.read_obj(table.path.parent / table.text("file"))
    table.done()
    if ways != ["facets"]:
        body = body._replace(labels=_labels(table, body.labels, default, materials))
    return body


def _facets(
    facets: list[Table], default: str | None, materials: Mapping[str, Material]
) -> shapes.Body:
    normals, areas, axes, labels = [], [], [], []
    for facet in facets:
        if "normal" in facet:
            normal = np.array(facet.vector("normal"))
            if not np.linalg.norm(normal) > 0:
                raise facet.fault("normal", "has length zero; give the outward direction")
            normal /= np.linalg.norm(normal)
        else:
            phi, g = facet.number("phi"), facet.number("g", low=-1.0, high=1.0)
            s = np.sqrt(1.0 - g * g)
            normal = np.array([s * np.cos(phi), s * np.sin(phi), g])
        areas.append(facet.number("area_m2", above=0.0))
        only = next(iter(materials)) if len(materials) == 1 else None
        fallback = {"default": default or only} if default or only else {}
        labels.append(facet.text("material", choices=tuple(materials), **fallback))
        u = facet.vector("u", default=None)
        if u is None:
            axes.append(shapes.plane_axis(normal)[0])
        else:
            length = np.linalg.norm(u)
            if not length > 0 or abs(np.array(u) @ normal) > 1e-6 * length:
                raise facet.fault("u", f"is {list(u)}; expected a direction in the facet's plane")
            axes.append(np.array(u) / length)
        normals.append(normal)
        facet.done()
    return shapes.Body(np.array(normals), np.array(areas), np.array(axes), tuple(labels))


def _sizes(table: Table, name: str) -> dict[str, object]:
    """The dimensions of a built-in shape, as its function takes them."""
    if name == "box-wing":
        sizes = {"bus": table.vector("bus", default=None), "wing": table.vector("wing", 2, None)}
        for key, value in sizes.items():
            if value is not None and not min(value) > 0:
                raise table.fault(key, f"is {list(value)}; expected lengths > 0")
        sizes["cant_deg"] = table.number("cant_deg", None)
    else:
        keys = {
            "cube": ("side",),
            "tetrahedron": ("side",),
            "plate": ("x", "y"),
            "cylinder": ("radius", "length"),
            "sphere": ("radius",),
            "rocket-body": ("radius", "length"),
        }[name]
        sizes = {key: table.number(key, None, above=0.0) for key in keys}
        if name in ("cylinder", "sphere", "rocket-body"):
            n = table.number("n", None, low=3 if name != "sphere" else 12, high=10_000)
            sizes["n"] = None if n is None else int(n)
    return {key: value for key, value in sizes.items() if value is not None}


def _labels(
    table: Table, labels: tuple[str, ...], default: str | None, materials: Mapping[str, Material]
) -> tuple[str, ...]:
    """The material of each facet of a shape: of its part's name, else the body's, else the only."""
    default = default or (next(iter(materials)) if len(materials) == 1 else None)
    for label in labels:
        if label not in materials and default is None:
            raise table.fault(
                None, f"has a part {label!r} without a material; describe [materials.{label}] "
                "or set body.material",
            )  # fmt: skip
    return tuple(label if label in materials else str(default) for label in labels)
