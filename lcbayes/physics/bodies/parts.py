"""Bodies put together from parts, each with a place, a direction and materials; and their shadows.

Two ways of shadows, chosen by what they cost: exact ones of convex solids, in JAX and with
gradients (`shadows`), where a body has a few tens of faces that others shade; and by points, in
NumPy (`shadow_points`), where it has many.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies import shadow_area, shadows
from lcbayes.physics.bodies.division import TOLERANCE
from lcbayes.physics.bodies.lit import Lit, Shading
from lcbayes.physics.bodies.primitives import Panels
from lcbayes.physics.bodies.shadow_points import POINTS, Points, points_on
from lcbayes.physics.bodies.shapes import Body
from lcbayes.physics.bodies.solids import Solid

Floats = NDArray[np.float64]
type Method = Literal["none", "exact", "points"]

MOST_PAIRS = 5_000  # of a polygon and a solid, for exact shadows
MOST_TESTS = 400_000  # of an edge against an edge at each epoch, for exact shadows
MOST_POINTS = 1_000_000
AS_LONG = 2_000.0  # tests of edges at an epoch that take as long as a gradient without shadows
_PROBES = 16


@dataclass(frozen=True)
class Part:
    """One part of a body.

    Attributes
    ----------
    kind : a name of `primitives.KINDS`, or "mesh"
    sizes : its lengths by name, m
    position : (3,) m
        Of the origin of the part's own axes, body axes.
    rotation : (3, 3)
        From the part's own axes to the body's.
    panels : Panels
        In body axes; `sides` are labels of materials.
    error : float
        Of the flux without shadows, over the largest that the part has; 0 for flat faces.
    """

    kind: str
    sizes: Mapping[str, float]
    position: tuple[float, float, float]
    rotation: Floats
    panels: Panels
    error: float


def rotation_to(direction: ArrayLike, roll_deg: float = 0.0) -> Floats:
    """The rotation that takes z to a direction (of any length), after a turn about z by a roll.

    It is the shortest turn (Rodrigues), about x by 180° where the direction is −z.
    """
    z = np.asarray(direction, float)
    z = z / np.linalg.norm(z)
    turned = rotation_by((0.0, 0.0, roll_deg))
    if z[2] < -1.0 + 1e-14:
        return np.diag([1.0, -1.0, -1.0]) @ turned
    x, y = z[0], z[1]
    cross = np.array([[0.0, 0.0, x], [0.0, 0.0, y], [-x, -y, 0.0]])
    return (np.eye(3) + cross + cross @ cross / (1.0 + z[2])) @ turned


def rotation_by(angles_deg: ArrayLike) -> Floats:
    """Turns about the body's x, then y, then z axis: R = R_z R_y R_x."""
    total = np.eye(3)
    for axis, angle in enumerate(np.deg2rad(np.asarray(angles_deg, float))):
        c, s = np.cos(angle), np.sin(angle)
        j, k = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[j, j, k, k], [j, k, j, k]] = [c, -s, s, c]
        total = turn @ total
    return total


@dataclass(frozen=True)
class Assembly:
    """A body of parts.

    Attributes
    ----------
    parts : of the body
    shaded : whether its parts shade and hide one another
    tolerance : of shadows by points, over the largest flux
    """

    parts: tuple[Part, ...]
    shaded: bool = True
    tolerance: float = TOLERANCE

    @cached_property
    def body(self) -> Body:
        """All panels as facets, part by part."""
        panels = [part.panels for part in self.parts]
        return Body(
            np.concatenate([p.normals for p in panels]),
            np.concatenate([p.areas for p in panels]),
            np.concatenate([p.u_axes for p in panels]),
            sum((p.sides for p in panels), ()),
        )

    @cached_property
    def polygons(self) -> list[Floats]:
        """Of all panels, part by part."""
        return [polygon for part in self.parts for polygon in part.panels.polygons]

    @cached_property
    def _receivers(self) -> tuple[list[Floats], NDArray[np.integer]]:
        """Polygons that exact shadows fall on, part by part; which each panel belongs to, (N,)."""
        polygons, whose = [], []
        for part in self.parts:
            own, index = part.panels.receivers()
            whose.append(len(polygons) + index)
            polygons += own
        return polygons, np.concatenate(whose)

    @cached_property
    def method(self) -> Method:
        """How shadows are found."""
        if self.groups:
            return "exact"
        return "points" if self.points is not None else "none"

    @cached_property
    def groups(self) -> tuple[shadows.Group, ...]:
        """Exact shadows; empty where there are none, or they would cost too much."""
        polygons, whose = self._receivers
        part, solids, owner = self._blocking
        if not self.shaded or len(polygons) * len(solids) > MOST_PAIRS:
            return ()
        first = np.unique(whose, return_index=True)[1]
        return shadows.shadows(polygons, part[first], solids, owner, most=MOST_TESTS) or ()

    @cached_property
    def shadow_cost(self) -> float:
        """How many times as long a gradient takes with exact shadows as without, roughly."""
        return 1.0 + shadows.tests_per_epoch(self.groups) / AS_LONG

    @cached_property
    def _blocking(self) -> tuple[NDArray[np.integer], list[Solid], NDArray[np.integer]]:
        """The part of each polygon; the solids that block light; the part that owns each."""
        panels = [part.panels for part in self.parts]
        part = np.repeat(np.arange(len(panels)), [len(p.polygons) for p in panels])
        owner = [i if p.convex else -1 for i, p in enumerate(panels)]
        owner = np.repeat(owner, [len(p.solids) for p in panels])
        return part, [solid for p in panels for solid in p.solids], owner

    @cached_property
    def points(self) -> Points | None:
        """Shadows by points; None where there are none, or they are exact."""
        return self._sampled[0]

    @cached_property
    def shadow_error(self) -> float:
        """Of the flux in shadow, over the largest flux, for Lambert's law on all of the body.

        For points, the largest difference from four times as many in `_PROBES` random pairs of
        directions; they are as many as make it less than the tolerance, or `MOST_POINTS`. 0 where
        shadows are exact, but that a circle has `primitives.circle_sides` sides, and
        panels of a round part share the shadows of `primitives.STRIPS` strips.
        """
        return self._sampled[1]

    @cached_property
    def _sampled(self) -> tuple[Points | None, float]:
        lone = len(self.parts) == 1 and self.parts[0].panels.convex
        if not self.shaded or lone or self.groups:
            return None, 0.0
        points = points_on(self.polygons, *self._blocking)
        if points is None:
            return None, 0.0
        directions = np.random.default_rng(20261123).standard_normal((2, _PROBES, 3))
        directions[1] += directions[0]  # most phase angles are below 90 deg
        sun, obs = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        normals, areas = self.body.normals, self.body.areas
        kernel = np.clip(sun @ normals.T, 0.0, None) * np.clip(obs @ normals.T, 0.0, None)
        flux, count = (kernel * points.lit_and_seen(sun, obs)) @ areas, POINTS
        while True:
            finer = points_on(self.polygons, *self._blocking, 4 * count)
            assert finer is not None
            right = (kernel * finer.lit_and_seen(sun, obs)) @ areas
            error = float(np.max(np.abs(flux - right)) / np.max(right))
            if error <= self.tolerance or 4 * count > MOST_POINTS:
                return points, error
            points, flux, count = finer, right, 4 * count

    @cached_property
    def shading(self) -> Shading | None:
        """How exact shadows are computed; None for others."""
        if not self.groups:
            return None
        polygons, whose = self._receivers

        @partial(jax.jit, static_argnames="slopes")
        def about(sun: jax.Array, obs: jax.Array, *, slopes: bool = True) -> Lit:
            lit = shadow_area.about(self.groups, len(polygons), sun, obs, slopes=slopes)
            return lit._replace(polygon=jnp.asarray(whose))

        return Shading(about, len(polygons))

    def lit_and_seen(self, sun_body: jax.Array, obs_body: jax.Array) -> jax.Array | None:
        """Fraction of each panel that is both lit and seen, (T, N); None where all are whole.

        Parameters
        ----------
        sun_body, obs_body : (T, 3)
            Unit vectors to Sun and observer, body axes.
        """
        if self.method == "none":
            return None
        if self.groups:
            polygons, whose = self._receivers
            args = self.groups, len(polygons), sun_body, obs_body
            return shadow_area.lit_and_seen(*args)[:, whose]
        assert self.points is not None
        shape = jax.ShapeDtypeStruct((sun_body.shape[0], len(self.polygons)), jnp.float64)
        return jax.pure_callback(
            self.points.lit_and_seen, shape, sun_body, obs_body, vmap_method="sequential"
        )
