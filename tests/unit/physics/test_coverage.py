"""Shadows by cells: against an independent ray caster, hand calculations and differences."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies.parts import rotation_by
from lcbayes.physics.bodies.primitive_flux import Primitive, body_flux
from tests.helpers import ray_casting as cast
from tests.helpers import shaded_bodies as shaded

pytestmark = pytest.mark.usefixtures("full_optimisation")

WHITE, GREY = ("lambertian", {"r_diff": 0.8}), ("lambertian", {"r_diff": 0.4})
BLACK = ("lambertian", {"r_diff": 0.0})


def _at(kind, sizes, surfaces, position=(0.0, 0.0, 0.0), angles=(0.0, 0.0, 0.0)):
    return Primitive(
        kind, sizes, surfaces, jnp.asarray(rotation_by(angles)), jnp.asarray(position, float)
    )


def _wings():
    made = [_at("box", {"x": 1.5, "y": 1.2, "z": 2.0}, {"side": WHITE})]
    sides = {"front": GREY, "back": WHITE}
    for y in (2.1, -2.1):
        made.append(_at("plate", {"x": 3.0, "y": 1.2}, sides, (0, y, 0), (90, 0, 90)))
    return made


def _stage():
    tank = _at("cylinder", {"radius": 1.0, "length": 4.0}, {"side": WHITE, "end": GREY})
    sizes = {"radius": 0.7, "radius_top": 0.25, "length": 1.0}
    return [tank, _at("frustum", sizes, {"side": WHITE}, (0, 0, -3))]


def _cone_and_cylinder():
    """A cone whose apex points to a cylinder that lies across its axis, and a disc."""
    cone = _at("cone", {"radius": 0.9, "length": 1.2}, {"side": WHITE}, (0, 0, 0))
    disc = _at("disc", {"radius": 0.8}, {"front": WHITE, "back": GREY}, (0, 0, -0.7))
    return [cone, disc]


BODIES = {"wings": _wings, "stage": _stage, "cone": _cone_and_cylinder}


def _rays(name, sun, obs):
    if name != "cone":
        return shaded.cast_flux(name, sun, obs, 10_000)
    made = [(cast.Round(0.9, 0, 0, 1.2), 0.8, 1.0), (cast.Disc(0.9, 0, False), 0.8, 1.0)]
    made += [(cast.Disc(0.8, -0.7, True), 0.8, 1.0), (cast.Disc(0.8, -0.7, False), 0.4, 1.0)]
    return cast.flux(made, [surface for surface, _, _ in made], sun, obs, 10_000)


def _flux_of(parts, cells):
    return lambda sun, obs: body_flux(parts, sun, obs, cells=cells)


@pytest.mark.parametrize("name", list(BODIES))
def test_flux_is_that_of_rays(name):
    """The error of `coverage` in the worst of 40 attitudes, with 8 and with 16 cells."""
    parts = BODIES[name]()
    sun, obs = shaded.attitudes(40, 1)
    rays = _rays(name, sun, obs)
    whole = np.asarray(jax.jit(_flux_of(parts, 0))(sun, obs))
    assert np.max(whole - rays) > 0.05 * rays.max()
    for cells, within in ((8, 6e-3), (16, 2e-3))[: 2 if name == "stage" else 1]:
        result = jax.jit(_flux_of(parts, cells))(sun, obs)
        np.testing.assert_allclose(result, rays, rtol=0, atol=within * rays.max())


def test_what_hides_the_sun_is_what_a_solid_shades():
    """A white square far below a black solid, the Sun overhead: what is lit is the square without
    the outline of the solid, whose area is known."""
    square = _at("plate", {"x": 4.0, "y": 4.0}, {"front": WHITE})
    sizes = {"box": {"x": 1.0, "y": 0.8, "z": 2.0}, "ellipsoid": {"x": 0.5, "y": 0.8, "z": 1.2}}
    sizes |= {"sphere": {"radius": 1.1}, "cylinder": {"radius": 0.5, "length": 1.5}}
    sizes |= {"cone": {"radius": 0.8, "length": 1.6}, "disc": {"radius": 0.9}}
    sizes |= {"frustum": {"radius": 0.3, "radius_top": 0.8, "length": 1.0}}
    up, aside = jnp.array([[0.0, 0.0, 1.0]]), jnp.array([[0.0, 0.6, 0.8]])
    turn = rotation_by((40.0, 25.0, 10.0))
    d = turn.T @ np.array([0, 0, 1.0])
    a, b = np.abs(d[2]), np.hypot(d[0], d[1])
    outline = {
        "box": np.abs(d) @ [0.8 * 2.0, 1.0 * 2.0, 0.8],
        "ellipsoid": np.pi * 0.5 * 0.8 * 1.2 * np.linalg.norm(d / [0.5, 0.8, 1.2]),
        "sphere": np.pi * 1.21,
        "cylinder": np.pi * 0.25 * a + 2 * 0.5 * 1.5 * b,
        "disc": np.pi * 0.81 * a,
        "cone": _hull(0.8, 0.0, 1.6, a, b),
        "frustum": _hull(0.3, 0.8, 1.0, a, b),
    }
    for kind, own in sizes.items():
        side = "front" if kind == "disc" else "side"
        solid = Primitive(kind, own, {side: BLACK}, jnp.asarray(turn), jnp.array([0.3, -0.5, 9.0]))
        # the observer sees all of the square past the solid, which is high above it
        result = float(jax.jit(_flux_of([square, solid], 24))(up, aside)[0])
        lit = result / (0.8 / np.pi * 0.8)
        assert 16.0 - lit == pytest.approx(outline[kind], rel=0.01), kind


def _hull(radius, top, length, a, b):
    """Area of the convex hull of two ellipses, by its support function: ½ ∮ h (h + h'')."""
    angle = np.linspace(0, 2 * np.pi, 200_001)[:-1]
    x, y = np.cos(angle), np.sin(angle)
    width = np.hypot(x, a * y)
    h = np.maximum(radius * width, length * b * y + top * width)
    slope = np.gradient(h, angle[1])
    return 0.5 * np.mean(h**2 - slope**2) * 2 * np.pi


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wings", "stage"])
def test_gradients_are_differences(name):
    """By a rotation, a size and a position, also while an outline crosses cells."""
    parts = BODIES[name]()
    first = next(iter(parts[1].sizes))
    weight = np.random.default_rng(8).random(12)

    def total(x, sun, obs):
        turn = rotations.constant_rate(jnp.ones(1), x[:3])[0]
        sizes = {**parts[1].sizes, first: parts[1].sizes[first] + x[3]}
        moved = parts[1]._replace(sizes=sizes, position=parts[1].position + x[4:])
        flux = body_flux([parts[0], moved], sun @ turn.T, obs @ turn.T, cells=4)
        return flux @ weight

    sun, obs = shaded.attitudes(12, 3)
    at = 1e-3 * jnp.ones(7)
    slope = np.asarray(jax.jit(jax.grad(total))(at, sun, obs))
    value = jax.jit(total)
    difference = np.array(
        [(value(at + h, sun, obs) - value(at - h, sun, obs)) / 2e-5 for h in 1e-5 * np.eye(7)]
    )
    assert np.abs(difference).min() > 1e-3
    np.testing.assert_allclose(slope, difference, rtol=0, atol=2e-3 * np.abs(difference).max())


def test_the_flux_is_continuous_where_a_shadow_begins():
    """And its slope finite, where the Sun crosses the plane of the wings' edges."""
    angles = np.linspace(-0.3, 0.3, 61)
    sun = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    obs = np.tile([1.0, 0.0, 0.0], (61, 1))
    parts = _wings()[:2]

    def total(sun):
        flux = body_flux(parts, sun, jnp.asarray(obs), cells=4)
        return jnp.sum(flux), flux

    slope, flux = jax.jit(jax.grad(total, has_aux=True))(jnp.asarray(sun))
    assert np.abs(np.diff(flux)).max() < 4e-2 * flux.max()
    assert np.isfinite(slope).all()
