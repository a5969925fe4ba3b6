"""Six bodies that shade themselves: as scenario files, and as surfaces for the ray caster."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.simulation.scenarios.scenario import Scenario, load
from lcbayes.simulation.simulate import body_flux
from tests.helpers import ray_casting

Floats = NDArray[np.float64]

REST = """
[attitude]
law = "fixed"
[geometry]
kind = "planar"
stop = 10
step = 1
omega_obs = 0.1
lambda_obs = 0.4
omega_sun = 0.0
lambda_sun = 0.2
[noise]
sigma = 0.1
[materials.white]
law = "lambertian"
r_diff = 0.8
[materials.grey]
law = "lambertian"
r_diff = 0.4
"""


def _upright(x: float, y: float, *position: float) -> str:
    """A plate that faces the x axis, x wide along the y axis and y high."""
    return f"""
[[body.parts]]
kind = "plate"
x = {x}
y = {y}
position = {list(position)}
rotation_deg = [90, 0, 90]
material = "grey"
back_material = "white"
"""


def _white_box(x: float, y: float, z: float) -> str:
    return f"""
[[body.parts]]
kind = "box"
x = {x}
y = {y}
z = {z}
material = "white"
"""


WINGS = _white_box(1.5, 1.2, 2.0) + _upright(3.0, 1.2, 0, 2.1, 0) + _upright(3.0, 1.2, 0, -2.1, 0)
FINS = _white_box(2, 2, 1) + _upright(1.6, 1.2, -1.5, 0, 1.0) + _upright(1.6, 1.2, 1.5, 0, 1.0)
L_SHAPE = """
[body]
material = "white"
[[body.parts]]
kind = "box"
x = 2
y = 1
z = 1
[[body.parts]]
kind = "box"
x = 1
y = 1
z = 1
position = [0.5, 0, 1]
"""
STAGE = """
[body]
material = "white"
tolerance = TOLERANCE
[[body.parts]]
kind = "cylinder"
radius = 1
length = 4
end_material = "grey"
[[body.parts]]
kind = "frustum"
radius = 0.7
radius_top = 0.25
length = 1
position = [0, 0, -3]
"""
DISH = """
[body]
material = "white"
tolerance = TOLERANCE
[[body.parts]]
kind = "box"
x = 1
y = 1
z = 1
[[body.parts]]
kind = "dish"
radius = 0.6
depth = 0.2
position = [0, 0, 0.6]
back_material = "grey"
"""
MESH = """
[body]
material = "white"
tolerance = TOLERANCE
[[body.parts]]
kind = "mesh"
file = "ring.obj"
"""
TEXTS = {
    "wings": WINGS,
    "l-shape": L_SHAPE,
    "stage": STAGE,
    "dish": DISH,
    "mesh": MESH,
    "fins": FINS,
}


def ring() -> Floats:
    """A torus of 2 × 12 × 8 triangles, counter-clockwise seen from outside."""
    n, m = 12, 8
    a, b = 2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m
    r = 1.0 + 0.45 * np.cos(b)[None]
    z = np.tile(0.45 * np.sin(b), (n, 1))
    at = np.stack([r * np.cos(a)[:, None], r * np.sin(a)[:, None], z], axis=2)
    p, q = np.roll(at, -1, axis=0), np.roll(at, -1, axis=1)
    pq = np.roll(p, -1, axis=1)
    return np.concatenate(
        [
            np.stack([at, p, pq], axis=2).reshape(-1, 3, 3),
            np.stack([at, pq, q], axis=2).reshape(-1, 3, 3),
        ]
    )


def scenario(name: str, folder: Path, tolerance: float = 1e-3) -> Scenario:
    corners = ring().reshape(-1, 3)
    lines = ["v {:.17g} {:.17g} {:.17g}".format(*c) for c in corners]
    lines += [f"f {i} {i + 1} {i + 2}" for i in range(1, len(corners), 3)]
    (folder / "ring.obj").write_text("\n".join(lines))
    path = folder / f"{name}.toml"
    path.write_text(TEXTS[name].replace("TOLERANCE", str(tolerance)) + REST)
    return load(path)


def flux(result: Scenario, sun: Floats, obs: Floats, shaded: bool = True) -> Floats:
    """m², (T,)."""
    assert result.parts is not None
    parts = result.parts if shaded else replace(result.parts, shaded=False)

    @jax.jit
    def of(sun, obs):
        visible = parts.lit_and_seen(sun, obs)
        return body_flux(result.body, result.materials, sun, obs, None, visible)

    return np.asarray(of(jnp.asarray(sun), jnp.asarray(obs)))


def _both_sides(corner: tuple[float, float, float], width: float) -> list:
    """A plate that faces the x axis, 1.2 m high, grey in front and white behind."""
    y, z = (0, width, 0), (0, 0, 1.2)
    front, back = ray_casting.Rectangle(corner, y, z), ray_casting.Rectangle(corner, z, y)
    return [(front, 0.4, 1.0), (back, 0.8, 1.0)]


def surfaces(name: str) -> tuple[list, list]:
    """What shines, with its reflectance and share of the points, and what stops rays."""
    if name == "wings":
        made = [(face, 0.8, 1.0) for face in ray_casting.box_faces((0, 0, 0), (1.5, 1.2, 2.0))]
        made += [*_both_sides((0, 0.6, -0.6), 3), *_both_sides((0, -3.6, -0.6), 3)]
    elif name == "fins":
        made = [(face, 0.8, 1.0) for face in ray_casting.box_faces((0, 0, 0), (2, 2, 1))]
        made += [*_both_sides((-1.5, -0.8, 0.4), 1.6), *_both_sides((1.5, -0.8, 0.4), 1.6)]
    elif name == "l-shape":
        boxes = ((0, 0, 0), (2, 1, 1)), ((0.5, 0, 1), (1, 1, 1))
        made = [(face, 0.8, 1.0) for one in boxes for face in ray_casting.box_faces(*one)]
    elif name == "stage":
        made = [
            (ray_casting.Round(1, -2, 1, 2), 0.8, 1.0),
            (ray_casting.Disc(1, 2, True), 0.4, 1.0),
        ]
        made += [
            (ray_casting.Disc(1, -2, False), 0.4, 1.0),
            (ray_casting.Round(0.7, -3, 0.25, -2), 0.8, 1.0),
        ]
        made += [
            (ray_casting.Disc(0.7, -3, False), 0.8, 1.0),
            (ray_casting.Disc(0.25, -2, True), 0.8, 0.1),
        ]
    elif name == "dish":
        made = [(face, 0.8, 1.0) for face in ray_casting.box_faces((0, 0, 0), (1, 1, 1))]
        made += [(ray_casting.Paraboloid(0.2 / 0.36, 0.6, 0.6, True), 0.8, 1.0)]
        made += [(ray_casting.Paraboloid(0.2 / 0.36, 0.6, 0.6, False), 0.4, 1.0)]
    else:
        made = [(ray_casting.Triangle(t), 0.8, 4.0 / 192) for t in ring()]
    return made, [surface for surface, _, _ in made]


def cast_flux(name: str, sun: Floats, obs: Floats, n: int) -> Floats:
    """The flux that rays give, n points on each surface, or 4 n on the mesh."""
    return ray_casting.flux(*surfaces(name), sun, obs, n)


def attitudes(count: int, seed: int) -> tuple[Floats, Floats]:
    """Directions to Sun and observer in body axes, at every phase angle below 150 deg."""
    rng = np.random.default_rng(seed)
    v = rng.standard_normal((2, 4 * count, 3))
    v /= np.linalg.norm(v, axis=-1, keepdims=True)
    kept = np.sum(v[0] * v[1], axis=1) > np.cos(np.deg2rad(150))
    return v[0, kept][:count], v[1, kept][:count]
