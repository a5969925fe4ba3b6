"""Brightness of convex primitives without shadows, differentiable in all that describes them.

Flat faces are facets. On a curved face the flux is an integral over the part that is both lit and
visible, whose limits are known in closed form: arcs of azimuths on a cylinder, cone or frustum
(`revolution`), a lune on an ellipsoid (`lune`). Inside these limits the integrand is smooth, so
Gauss-Legendre quadrature converges exponentially (`quadrature`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.coverage import Blockers, Cells, Shade, Solid, discs, lit_and_seen
from lcbayes.physics.bodies.lune import over_lune
from lcbayes.physics.bodies.quadrature import length as norm
from lcbayes.physics.bodies.revolution import around_axis
from lcbayes.physics.brightness import flux_brdf
from lcbayes.physics.reflectance import Parameters, get_law

type Sizes = Mapping[str, jax.Array | float]
type Surface = tuple[str, Parameters]
"""A law of `reflectance.LAWS` and its parameters, each a number or a scalar array."""
type Surfaces = Mapping[str, Surface | Sequence[Surface]]
"""By side; several surfaces of one side are added, such as two lobes."""


class Kind(NamedTuple):
    """A kind of primitive: its lengths and its sides, the first of which every part has."""

    sizes: tuple[str, ...]
    sides: tuple[str, ...] = ("side",)


KINDS: dict[str, Kind] = {
    "box": Kind(("x", "y", "z")),
    "plate": Kind(("x", "y"), ("front", "back")),
    "disc": Kind(("radius",), ("front", "back")),
    "cylinder": Kind(("radius", "length"), ("side", "end")),
    "cone": Kind(("radius", "length"), ("side", "end")),
    "frustum": Kind(("radius", "radius_top", "length"), ("side", "end")),
    "sphere": Kind(("radius",)),
    "ellipsoid": Kind(("x", "y", "z")),
}

NODES = {"diffuse": 16, "glossy": 12}
"""Nodes of each smooth interval by default. Error over the largest flux of a part, at phase angles
up to 150 deg: 1e-13 for Lambert's law and the "non-lambertian" one, 1e-5 for Lommel and Seeliger's,
5e-5 for lobes of any width, 3e-4 for that of Cook and Torrance, whose shadowing term has kinks,
and 5e-3 for an anisotropic law on a sphere or ellipsoid, whose u axis is undefined at the poles."""


class Primitive(NamedTuple):
    """A primitive in a body.

    Attributes
    ----------
    kind : a name of `KINDS`
    sizes : m
    surfaces : by side
    rotation : (3, 3) or None
        From the part's own axes to the body's; None if they are the same.
    position : (3,) m or None
        Of the origin of the part's own axes; None for that of the body. It matters for shadows.
    """

    kind: str
    sizes: Sizes
    surfaces: Surfaces
    rotation: jax.Array | None = None
    position: jax.Array | None = None


def body_flux(
    parts: Sequence[Primitive],
    sun_body: jax.Array,
    obs_body: jax.Array,
    nodes: int | None = None,
    cells: int = 0,
) -> jax.Array:
    """Flux of a body of several primitives at unit distance under unit irradiance.

    Parameters
    ----------
    parts : list of Primitive
        Convex, without common points but on their surfaces.
    sun_body, obs_body : (T, 3)
        Unit vectors to Sun and observer, body frame.
    nodes : int or None
        Of the quadrature, as for `primitive_flux`.
    cells : int
        Cells along each edge of a face for shadows (`coverage`); without shadows where 0.

    Returns
    -------
    (T,)
        m².
    """
    solids = [_solid(part) for part in parts]
    total = jnp.zeros(len(sun_body))
    for i, part in enumerate(parts):
        shade = None
        if cells and len(parts) > 1:
            order = [i, *(j for j in range(len(parts)) if j != i)]
            kinds = tuple(parts[j].kind for j in order)
            others = tuple(solids[j] for j in order[1:])
            shade = Shade(Blockers(kinds, solids[i], others), cells)
        total += primitive_flux(*part[:3], sun_body, obs_body, part.rotation, nodes, shade)
    return total


def _solid(part: Primitive) -> Solid:
    rotation = jnp.eye(3) if part.rotation is None else jnp.asarray(part.rotation)
    position = jnp.zeros(3) if part.position is None else jnp.asarray(part.position, float)
    return Solid(tuple(_checked(*part[:3])), rotation, position)


def primitive_flux(
    kind: str,
    sizes: Sizes,
    surfaces: Surfaces,
    sun_body: jax.Array,
    obs_body: jax.Array,
    rotation: jax.Array | None = None,
    nodes: int | None = None,
    shade: Shade | None = None,
) -> jax.Array:
    """Flux of a convex primitive at unit distance under unit irradiance.

    f = ∫ f_r μ₀ μ dA over the surface that is lit and visible. The shapes and axes are those of
    `primitives`; a disc lies in the xy plane, and its front faces +z.

    Parameters
    ----------
    kind : str
        A name of `KINDS`.
    sizes : mapping of scalars, m
        Lengths by the names in `KINDS`. x, y and z are sides of a box, semi-axes of an ellipsoid.
    surfaces : mapping
        Law and parameters of each side; a side that is missing has the surface of the first one.
        Several surfaces of one side are added.
    sun_body, obs_body : (T, 3)
        Unit vectors to Sun and observer, body frame.
    rotation : (3, 3) or None
        From the part's own axes to the body's.
    nodes : int or None
        Of the quadrature in each smooth interval; None for those of `NODES`.
    shade : Shade or None
        Other parts that may shade this one.

    Returns
    -------
    (T,)
        m².

    Raises
    ------
    ValueError
        If the kind is unknown, or a size or the first side is missing.

    Examples
    --------
    A Lambertian sphere at full phase reflects 2/3 of r_diff r²:

    >>> up = jnp.array([[0.0, 0.0, 1.0]])
    >>> white = {"side": ("lambertian", {"r_diff": 0.9})}
    >>> round(float(primitive_flux("sphere", {"radius": 2.0}, white, up, up)[0]), 9)
    2.4
    """
    given = _checked(kind, sizes, surfaces)
    sun, obs = jnp.asarray(sun_body), jnp.asarray(obs_body)
    if rotation is not None:
        sun, obs = sun @ rotation, obs @ rotation
    faces, first = _flat_faces(kind, given), KINDS[kind].sides[0]
    total = jnp.zeros(sun.shape[0])
    for side in KINDS[kind].sides:
        for surface in _terms(surfaces.get(side, surfaces[first])):
            if side in faces:
                normals, areas, u_axes = faces[side]
                visible = _visible(kind, given, sun, obs, shade)
                total += flux_brdf(sun, obs, normals, areas, *surface, u_axes, visible)
            if side == first:
                total += _curved(kind, given, surface, sun, obs, nodes, shade)
    return total


def _checked(kind: str, sizes: Sizes, surfaces: Surfaces) -> list[jax.Array]:
    """The sizes in the order of `KINDS`."""
    if kind not in KINDS:
        raise ValueError(f"no formula for {kind!r}; available: {', '.join(KINDS)}")
    names, sides = KINDS[kind]
    if set(sizes) != set(names):
        raise ValueError(f"a {kind} has the sizes {', '.join(names)}; given: {', '.join(sizes)}")
    if sides[0] not in surfaces or not set(surfaces) <= set(sides):
        raise ValueError(
            f"a {kind} has the sides {', '.join(sides)}, of which {sides[0]!r} needs a surface; "
            f"given: {', '.join(surfaces)}"
        )
    return [jnp.asarray(sizes[name], float) for name in names]


def _terms(surface: Surface | Sequence[Surface]) -> Sequence[Surface]:
    return [surface] if isinstance(surface[0], str) else surface  # pyright: ignore[reportReturnType]


# Flat faces: by side, normals (N, 3), areas (N,) and u axes (N, 3).
type Faces = dict[str, tuple[jax.Array, jax.Array, jax.Array]]
_AXES = np.eye(3)


def _longer(a: jax.Array, b: jax.Array, i: int, j: int) -> jax.Array:
    """The axis i or j, whichever side is longer."""
    return jnp.where(a >= b, _AXES[i], _AXES[j])


def _box_faces(x: jax.Array, y: jax.Array, z: jax.Array) -> Faces:
    areas = jnp.stack([y * z, x * z, x * y])
    u_axes = jnp.stack([_longer(y, z, 1, 2), _longer(x, z, 0, 2), _longer(x, y, 0, 1)])
    normals = jnp.asarray(np.concatenate([_AXES, -_AXES]))
    return {"side": (normals, jnp.tile(areas, 2), jnp.tile(u_axes, (2, 1)))}


def _two_sided(area: jax.Array, u_axis: Any) -> Faces:
    return {
        side: (jnp.asarray(sign * _AXES[2:]), area[None], jnp.asarray(u_axis)[None])
        for side, sign in (("front", 1.0), ("back", -1.0))
    }


def _end_faces(radius: jax.Array, radius_top: jax.Array) -> Faces:
    normals = jnp.asarray([-_AXES[2], _AXES[2]])
    areas = jnp.pi * jnp.stack([radius, radius_top]) ** 2
    return {"end": (normals, areas, jnp.asarray(np.tile(_AXES[0], (2, 1))))}


def _flat_faces(kind: str, sizes: Sequence[jax.Array]) -> Faces:
    match kind:
        case "box":
            return _box_faces(*sizes)
        case "plate":
            return _two_sided(sizes[0] * sizes[1], _longer(sizes[0], sizes[1], 0, 1))
        case "disc":
            return _two_sided(jnp.pi * sizes[0] ** 2, _AXES[0])
        case "cylinder":
            return _end_faces(sizes[0], sizes[0])
        case "cone":
            return _end_faces(sizes[0], 0.0 * sizes[0])
        case "frustum":
            return _end_faces(*sizes[:2])
    return {}


def _visible(
    kind: str, sizes: Sequence[jax.Array], sun: jax.Array, obs: jax.Array, shade: Shade | None
) -> jax.Array | None:
    """Share of each flat face that is lit and seen, (T, N), by cells of equal area.

    Of two opposite faces at most one is lit, and the other has its share.
    """
    if shade is None:
        return None
    if kind in ("box", "plate"):
        cells = _rectangular_cells(sizes, shade.count, sun)
    else:
        cells = _round_cells(kind, sizes, shade.count, sun)
    lit = lit_and_seen(shade.blockers, cells, sun, obs)
    if kind in ("plate", "disc"):  # the sides are faces one by one
        return lit.mean(axis=1, keepdims=True)
    return jnp.tile(lit.reshape(len(sun), 3 if kind == "box" else 1, -1).mean(axis=2), (1, 2))


def _rectangular_cells(sides: Sequence[jax.Array], count: int, sun: jax.Array) -> Cells:
    """On the lit faces across x, y, z of a box, (T, 3 count², 3), or on a plate, (1, count², 3)."""
    at = (np.arange(count) + 0.5) / count - 0.5
    x, y = (a.ravel()[:, None] for a in np.meshgrid(at, at))
    zero, cells = np.zeros((1, count**2, 3)), []
    for k in (0, 1, 2) if len(sides) == 3 else (2,):
        a, b = (sides[i] * _AXES[i] for i in range(3) if i != k)
        centre = (x * a + y * b)[None]
        if len(sides) == 3:
            out = 0.5 * jnp.where(sun[:, k] > 0.0, sides[k], -sides[k])
            centre = centre + out[:, None, None] * _AXES[k]
        cells.append((centre, zero + a / count, zero + b / count))
    return Cells(*(jnp.concatenate(edges, axis=1) for edges in zip(*cells, strict=True)))


def _round_cells(kind: str, sizes: Sequence[jax.Array], count: int, sun: jax.Array) -> Cells:
    """On the lit end of a part, or on a disc: rings of equal area, (T, 2 count², 3)."""
    edges = np.sqrt(np.arange(count + 1) / count)
    step = np.pi / count
    r = np.repeat(0.5 * (edges[1:] + edges[:-1]), 2 * count)[:, None]
    width = np.repeat(np.diff(edges), 2 * count)[:, None]
    phi = np.tile(step * (np.arange(2 * count) + 0.5), count)[:, None]
    out = np.cos(phi) * _AXES[0] + np.sin(phi) * _AXES[1]
    around = np.cos(phi) * _AXES[1] - np.sin(phi) * _AXES[0]
    low, high, radius, top = discs(kind, sizes)
    upper = sun[:, 2, None, None] > 0.0
    radius, z = jnp.where(upper, top, radius), jnp.where(upper, high, low)
    centre = radius * (r * out) + z * _AXES[2]
    return Cells(centre, radius * (width * out), radius * (r * step * around))


def _curved(
    kind: str,
    sizes: Sequence[jax.Array],
    surface: Surface,
    sun: jax.Array,
    obs: jax.Array,
    nodes: int | None,
    shade: Shade | None,
) -> jax.Array | float:
    """∫ f_r μ₀ μ dA over the curved face, (T,); 0 where there is none. Axes of the part."""
    law = surface[0]
    parameters = {name: jnp.asarray(value, float) for name, value in surface[1].items()}
    count = nodes or NODES["diffuse" if get_law(law).diffuse else "glossy"]
    match kind:
        case "cylinder":
            radius, length = sizes
            return radius * length * around_axis(law, parameters, sun, obs, None, count, shade)
        case "cone" | "frustum":
            radius, length = sizes[0], sizes[-1]
            top = sizes[1] if kind == "frustum" else 0.0 * radius
            slant = norm(jnp.stack([length, radius - top]))
            tilt = length / slant, (radius - top) / slant
            integral = around_axis(law, parameters, sun, obs, tilt, count, shade)
            return 0.5 * (radius + top) * slant * integral
        case "sphere":
            if shade is None and "nv" not in parameters:
                return sizes[0] ** 2 * over_lune(law, parameters, sun, obs, None, count)
            scale = jnp.stack([sizes[0]] * 3)
            return over_lune(law, parameters, sun, obs, scale, count, shade)
        case "ellipsoid":
            return over_lune(law, parameters, sun, obs, jnp.stack(list(sizes)), count, shade)
    return 0.0
