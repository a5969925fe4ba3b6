"""The brightness of a body of known shape, the axis about which it comes to rest, its symmetry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise, permutations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies.parts import Assembly
from lcbayes.physics.bodies.primitive_flux import Primitive, body_flux
from lcbayes.physics.bodies.primitives import CIRCLE_SIDES
from lcbayes.physics.reflectance import LAWS
from lcbayes.simulation.scenarios.body import Material
from lcbayes.simulation.simulate import body_flux as panels_flux

Floats = NDArray[np.float64]
type Values = Mapping[str, Mapping[str, jax.Array | float]]  # material → parameter → value
type Sizes = Mapping[tuple[int, str], jax.Array | float]  # (part, length) → m

EQUAL_MOMENTS = 1e-3  # relative difference below which two moments of inertia are equal


@dataclass(frozen=True, eq=False)
class KnownBody:
    """A body of known parts with materials whose parameters may be unknown.

    Attributes
    ----------
    assembly : Assembly
    materials : name → `Material`
        Unknown parameters at the medians of their priors.
    given_axis : (3,) or None
        The axis of a flat spin, body axes; None: the principal axis of largest inertia.
    sides : of each part, the material of each side
    names : of the parts
    free_sizes : of (part, length)
        Lengths that are unknown; the parts of ``assembly`` have the medians of their priors.
    """

    assembly: Assembly
    materials: Mapping[str, Material]
    given_axis: tuple[float, ...] | None = None
    sides: tuple[Mapping[str, str], ...] = ()
    names: tuple[str, ...] = ()
    free_sizes: tuple[tuple[int, str], ...] = ()

    @classmethod
    def of(cls, assembly: Assembly, materials: Mapping[str, Material], *others: Any) -> KnownBody:
        """A body of the materials that its parts have."""
        used = set(assembly.body.labels)
        return cls(assembly, {k: m for k, m in materials.items() if k in used}, *others)

    @property
    def values(self) -> Values:
        """Parameters of all materials at the medians of their priors."""
        return {name: dict(m.parameters) for name, m in self.materials.items()}

    @cached_property
    def areas(self) -> dict[str, float]:
        """Area of each material, m²."""
        labels = np.array(self.assembly.body.labels)
        areas = self.assembly.body.areas
        return {name: float(areas[labels == name].sum()) for name in self.materials}

    def flux(
        self,
        sun_body: jax.Array,
        obs_body: jax.Array,
        values: Values | None = None,
        shadows: bool = True,
        sizes: Sizes | None = None,
        visible: jax.Array | None = None,
    ) -> jax.Array:
        """Flux at unit distance under unit irradiance, m², (T,).

        Panels stand for curved parts, with the error of ``tolerance``; they are three times as fast
        as the exact integral, which serves where lengths are unknown.

        Parameters
        ----------
        sun_body, obs_body : (T, 3)
            Unit vectors to Sun and observer, body axes.
        values : material → parameter → value, optional
            Default: the medians of the priors. A parameter that is missing has its median.
        shadows : bool
            Whether parts shade one another, where the body's file says so.
        sizes : (part, length) → m, optional
            Lengths in place of the medians of their priors.
        visible : (T, N), optional
            Lit and seen share of each panel, in place of the shadows.
        """
        if sizes:
            return self._sized_flux(sun_body, obs_body, values or {}, sizes)
        surfaces = self._surfaces(values or {})
        if visible is None and shadows:
            visible = self.assembly.lit_and_seen(sun_body, obs_body)
        return panels_flux(self.assembly.body, surfaces, sun_body, obs_body, visible=visible)

    def _surfaces(self, values: Values) -> dict[str, Material]:
        """The materials with these values of their parameters."""
        surfaces = {}
        for name, material in self.materials.items():
            parameters = {**material.parameters, **values.get(name, {})}
            if self._isotropic([name]):  # nv is nu, which may be unknown
                parameters.pop("nv", None)
                if not self._isotropic(
                    m for m, x in self.materials.items() if x.law == material.law
                ):
                    parameters["nv"] = parameters["nu"]
            surfaces[name] = Material(material.law, parameters)
        return surfaces

    def _isotropic(self, names: Iterable[str]) -> bool:
        """Whether the lobes of some materials, if any, are as wide along v as along u."""
        every = [self.materials[name].parameters for name in names]
        return all(p.get("nv") == p.get("nu") for p in every)

    def _sized_flux(
        self, sun_body: jax.Array, obs_body: jax.Array, values: Values, sizes: Sizes
    ) -> jax.Array:
        """`flux` of parts of given sizes, without shadows."""
        materials = self._surfaces(values)
        parts = []
        for i, (part, sides) in enumerate(zip(self.assembly.parts, self.sides, strict=True)):
            own = dict(part.sizes) | {k: v for (j, k), v in sizes.items() if j == i}
            surfaces = {
                side: (materials[name].law, materials[name].parameters)
                for side, name in sides.items()
            }
            parts.append(Primitive(part.kind, own, surfaces, jnp.asarray(part.rotation)))
        return body_flux(parts, sun_body, obs_body)

    def unshaded_flux(self, sun_body: jax.Array, obs_body: jax.Array) -> jax.Array:
        """`flux` without shadows, with the medians of the priors."""
        return self.flux(sun_body, obs_body, shadows=False)

    @cached_property
    def inertia(self) -> tuple[Floats, Floats]:
        """Principal moments, ascending (3,), and axes, rows (3, 3), of a uniform shell.

        They are per mass over area, m⁴. Where the body axes are principal axes, these are they.
        """
        total, first, area = np.zeros((3, 3)), np.zeros(3), 0.0
        for polygon in self.assembly.polygons:
            corner = polygon[0]
            for b, c in pairwise(polygon[1:]):
                size = 0.5 * float(np.linalg.norm(np.cross(b - corner, c - corner)))
                triangle = np.stack([corner, b, c])
                middle = triangle.sum(axis=0)
                total += size / 12.0 * (triangle.T @ triangle + np.outer(middle, middle))
                first += size * middle / 3.0
                area += size
        total -= np.outer(first, first) / area
        tensor = np.trace(total) * np.eye(3) - total
        off = np.abs(tensor - np.diag(np.diagonal(tensor))).max()
        if off < EQUAL_MOMENTS * np.trace(tensor):
            moments, axes = np.diagonal(tensor), np.eye(3)
        else:
            moments, vectors = np.linalg.eigh(tensor)
            axes = vectors.T
        # Moments that are equal but for rounding keep their order, whatever the tolerance.
        order = np.argsort(np.round(moments / (EQUAL_MOMENTS * np.trace(tensor))), kind="stable")
        return moments[order], axes[order]

    @cached_property
    def flat_axis(self) -> Floats:
        """The axis of a flat spin, a unit vector (3,) in body axes.

        Energy that is lost inside a body leaves it in rotation about the principal axis of largest
        inertia. Of two equal moments, the axis of the second is taken.
        """
        if self.given_axis is not None:
            axis = np.asarray(self.given_axis, float)
            return axis / np.linalg.norm(axis)
        return self.inertia[1][2]

    @cached_property
    def symmetry(self) -> Symmetry:
        """The rotations and reflections under which the brightness does not change."""
        with jax.ensure_compile_time_eval():  # numbers, also while a function of it is traced
            return symmetry_of(self)


@dataclass(frozen=True)
class Symmetry:
    """Transformations of the body axes that leave the brightness unchanged.

    Attributes
    ----------
    axis : (3,) or None
        The axis about which any rotation leaves it unchanged, as for a rocket stage.
    sphere : bool
        Any rotation does.
    rotations : (G, 3, 3)
        The others, besides those about ``axis``; the first is the identity.
    reflections : (H, 3, 3)
        With determinant −1.
    """

    axis: Floats | None
    sphere: bool
    rotations: Floats
    reflections: Floats


ANGLES = tuple(2.0 * np.pi * k / CIRCLE_SIDES[0] for k in (3, 7))  # about an axis of symmetry, rad
PROBES = 48  # pairs of directions
SLACK = 4.0  # of the largest difference over the tolerance of curved parts
EXACT = 1e-6  # largest difference for flat parts, over the largest flux or extent


def symmetry_of(body: KnownBody) -> Symmetry:
    """The symmetry of a body, from its brightness in random directions and for random materials.

    Rotations about the principal axes by any angle are tried, and the 48 signed permutations of
    those axes. Where parts shade one another, their solids must also come to lie on themselves.
    """
    rng = np.random.default_rng(20261123)
    sun = rng.standard_normal((PROBES, 3))
    obs = sun + rng.standard_normal((PROBES, 3))
    sun, obs = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (sun, obs))
    axes = body.inertia[1]
    turns = [_about(axis, angle) for axis in axes for angle in ANGLES]
    moves = [axes.T @ m @ axes for m in _signed_permutations()]
    every = np.stack([np.eye(3), *turns, *moves])
    flux = jax.jit(partial(body.flux, shadows=False))
    apart = np.zeros(len(every))
    for _ in range(2):
        values = {name: _others(m, rng) for name, m in body.materials.items()}
        sizes = {
            (i, k): body.assembly.parts[i].sizes[k] * rng.uniform(0.6, 1.0)
            for i, k in body.free_sizes
        }
        directions = (v.reshape(-1, 3) for v in (sun @ every, obs @ every))
        brightness = np.asarray(flux(*directions, values, sizes=sizes)).reshape(len(every), PROBES)
        apart = np.maximum(apart, np.abs(brightness - brightness[0]).max(axis=1) / brightness.max())
    curved = any(part.error > 0.0 for part in body.assembly.parts)
    same = apart < (SLACK * body.assembly.tolerance if curved else EXACT)
    if body.assembly.shaded and len(body.assembly.parts) > 1:
        same &= np.array([_on_themselves(body.assembly, m) for m in every])
    about = same[1 : 1 + len(turns)].reshape(3, len(ANGLES)).all(axis=1)
    axis = axes[int(np.argmax(about))] if about.any() else None
    kept = [m for m, ok in zip(moves, same[1 + len(turns) :], strict=True) if ok]
    proper = sorted((m for m in kept if np.linalg.det(m) > 0.0), key=lambda m: -np.trace(m))
    improper = [m for m in kept if np.linalg.det(m) < 0.0]
    return Symmetry(axis, bool(about.all()), np.array(proper), np.array(improper).reshape(-1, 3, 3))


def _others(material: Material, rng: np.random.Generator) -> dict[str, float]:
    """Other values of the parameters of a material; an isotropic lobe remains so."""
    changed_values = {}
    for key, value in material.parameters.items():
        allowed = LAWS[material.law].parameters[key]
        changed = value * rng.uniform(0.6, 1.0)
        changed_values[key] = float(np.clip(changed, allowed.lower, allowed.upper))
    if material.parameters.get("nv") == material.parameters.get("nu") and "nv" in changed_values:
        changed_values["nv"] = changed_values["nu"]
    return changed_values


def _on_themselves(assembly: Assembly, move: Floats) -> bool:
    """Whether a move of the axes brings all solids that cast shadows onto one another."""
    solids = [s.vertices for part in assembly.parts for s in part.panels.solids]
    extent = max(float(np.abs(v).max()) for v in solids)

    def same(a: Floats, b: Floats) -> bool:
        if len(a) != len(b):
            return False
        apart = np.linalg.norm(a[:, None] - b, axis=2).min(axis=1)
        return bool(apart.max() < EXACT * extent)

    return all(any(same(v @ move.T, other) for other in solids) for v in solids)


def _about(axis: Floats, angle: float) -> Floats:
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def _signed_permutations() -> Iterator[Floats]:
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            yield matrix
