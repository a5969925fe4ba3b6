"""Random bodies and their fluxes: the null distribution used to calibrate tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.bodies import shapes
from lcbayes.physics.brightness import flux_brdf

Floats = NDArray[np.float64]

SIDES = 8  # of a drum
SPECULAR = 0.5  # probability that a body has a specular lobe
EXPONENT = (5.0, 200.0)  # of lobes, log-uniform


@dataclass(frozen=True)
class Bodies:
    """B bodies of N facets each, padded with facets of zero area.

    Attributes
    ----------
    normals : (B, N, 3)
    areas, r_diff, r_spec, exponent : (B, N)
        Areas in m², and parameters of the Blinn-Phong law.
    on_array : (N,) bool
        Facets that rotate with a solar array, the same in all bodies.
    """

    normals: Floats
    areas: Floats
    r_diff: Floats
    r_spec: Floats
    exponent: Floats
    on_array: NDArray[np.bool_]


def draw(n: int, rng: np.random.Generator, articulated: bool = False) -> Bodies:
    """Bodies typical of satellites: boxes, boxes with wings, drums and plates, randomly oriented.

    Sides are log-uniform over a factor of four. A wing has half to three times the area of the
    largest side. Each facet has its own diffuse reflectance in 0.05 .. 0.6, and half of the bodies
    also have a specular reflectance. ``articulated`` puts the wings on a solar array with separate
    axes.
    """
    wing = shapes.plate().normals[:, [2, 0, 1]]  # front along x
    blank = np.tile([0.0, 0.0, 1.0], (SIDES + 2, 1))
    normals = np.empty((n, SIDES + 4, 3))
    areas = np.zeros((n, SIDES + 4))
    for i in range(n):
        sides = np.exp(rng.uniform(np.log(0.5), np.log(2.0), 3))
        kind = rng.choice(["box", "winged", "drum", "plate"], p=[0.3, 0.4, 0.2, 0.1])
        if articulated:
            kind = rng.choice(["winged", "drum with wings"], p=[0.7, 0.3])
        if kind.startswith("drum"):
            made = shapes.cylinder(0.5 * sides[0], sides[2], SIDES)
        elif kind == "plate":
            made = shapes.plate(sides[0], sides[1])
        else:
            made = shapes.box(*sides)
        count = len(made.areas)
        body = blank.copy()
        body[:count] = made.normals
        areas[i, :count] = made.areas
        front = wing
        if kind.endswith(("winged", "wings")):
            areas[i, -2:] = rng.uniform(0.5, 3.0) * made.areas.max()
            if not articulated:
                front = Rotation.random(None, rng).apply(wing)
        turn = Rotation.random(None, rng)
        normals[i, :-2] = turn.apply(body)
        normals[i, -2:] = front if articulated else turn.apply(front)
    shape = areas.shape
    r_diff = rng.uniform(0.05, 0.6, shape)
    r_spec = rng.uniform(0.0, 0.4, shape) * (rng.uniform(size=(n, 1)) < SPECULAR)
    exponent = np.exp(rng.uniform(*np.log(EXPONENT), size=shape))
    on_array = np.zeros(shape[1], bool)
    on_array[-2:] = articulated
    return Bodies(normals, areas, r_diff, r_spec, exponent, on_array)


def fluxes(bodies: Bodies, sun: Floats, obs: Floats, panel: tuple[Floats, Floats] | None) -> Floats:
    """Flux of each body at unit distance under unit irradiance, (B, T) m².

    Parameters
    ----------
    sun, obs : (T, 3)
        Unit vectors, body frame.
    panel :
        The same in the axes of the solar array, if there is one.
    """
    still = ~bodies.on_array if panel is not None else np.ones(bodies.areas.shape[1], bool)
    total = _send(bodies, still, sun, obs)
    if panel is not None:
        total = total + _send(bodies, ~still, *panel)
    return np.asarray(total)


def _send(bodies: Bodies, which: NDArray[np.bool_], sun: Floats, obs: Floats) -> jax.Array:
    return _many(
        jnp.asarray(sun),
        jnp.asarray(obs),
        *(
            jnp.asarray(x[:, which])
            for x in (bodies.normals, bodies.areas, bodies.r_diff, bodies.r_spec, bodies.exponent)
        ),
    )


@jax.jit
def _many(sun, obs, normals, areas, r_diff, r_spec, exponent):
    def one(args):
        normals, areas, r_diff, r_spec, n = args
        params = {"r_diff": r_diff, "r_spec": r_spec, "n": n}
        return flux_brdf(sun, obs, normals, areas, "blinn-phong", params)

    return jax.lax.map(one, (normals, areas, r_diff, r_spec, exponent))
