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
    """

    kind: str
    sizes: Sizes
    surfaces: Surfaces
    rotation: jax.Array | None = None


def body_flux(
    parts: Sequence[Primitive],
    sun_body: jax.Array,
    obs_body: jax.Array,
    nodes: int | None = None,
) -> jax.Array:
    """Flux of a body of several primitives that do not shade one another, m², (T,)."""
    found = [primitive_flux(*part[:3], sun_body, obs_body, part.rotation, nodes) for part in parts]
    return sum(found, jnp.zeros(sun_body.shape[0]))


def primitive_flux(
    kind: str,
    sizes: Sizes,
    surfaces: Surfaces,
    sun_body: jax.Array,
    obs_body: jax.Array,
    rotation: jax.Array | None = None,
    nodes: int | None = None,
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
    >>> float(primitive_flux("sphere", {"radius": 2.0}, white, up, up)[0].round(9))
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
                total += flux_brdf(sun, obs, normals, areas, *surface, u_axes)
            if side == first:
                total += _curved(kind, given, surface, sun, obs, nodes)
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
            return _two_sided(sizes[0] * sizes[1], _longer(*sizes, 0, 1))
        case "disc":
            return _two_sided(jnp.pi * sizes[0] ** 2, _AXES[0])
        case "cylinder":
            return _end_faces(sizes[0], sizes[0])
        case "cone":
            return _end_faces(sizes[0], 0.0 * sizes[0])
        case "frustum":
            return _end_faces(*sizes[:2])
    return {}


def _curved(
    kind: str,
    sizes: Sequence[jax.Array],
    surface: Surface,
    sun: jax.Array,
    obs: jax.Array,
    nodes: int | None,
) -> jax.Array | float:
    """∫ f_r μ₀ μ dA over the curved face, (T,); 0 where there is none. Axes of the part."""
    law = surface[0]
    parameters = {name: jnp.asarray(value, float) for name, value in surface[1].items()}
    count = nodes or NODES["diffuse" if get_law(law).diffuse else "glossy"]
    match kind:
        case "cylinder":
            radius, length = sizes
            return radius * length * around_axis(law, parameters, sun, obs, None, count)
        case "cone" | "frustum":
            radius, length = sizes[0], sizes[-1]
            top = sizes[1] if kind == "frustum" else 0.0 * radius
            slant = norm(jnp.stack([length, radius - top]))
            tilt = length / slant, (radius - top) / slant
            found = around_axis(law, parameters, sun, obs, tilt, count)
            return 0.5 * (radius + top) * slant * found
        case "sphere":
            scale = jnp.ones(3) if "nv" in parameters else None
            return sizes[0] ** 2 * over_lune(law, parameters, sun, obs, scale, count)
        case "ellipsoid":
            return over_lune(law, parameters, sun, obs, jnp.stack(list(sizes)), count)
    return 0.0
