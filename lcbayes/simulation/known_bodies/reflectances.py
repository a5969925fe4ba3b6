"""The reflectances that a body's file leaves open, in which the brightness is linear."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.reflectance_coordinates import Reflectance, ReflectanceCoordinates
from lcbayes.physics.reflectance import LAWS, REFLECTANCES
from lcbayes.simulation.known_bodies.body import Sizes, Values
from lcbayes.simulation.known_bodies.reader import BodyFile


def albedo_areas(file: BodyFile, values: Values) -> dict[str, jax.Array]:
    """Area times reflectance of each material, m²; with the median sizes if they are unknown."""
    areas = {}
    for name, area in file.body.areas.items():
        every = {**file.body.materials[name].parameters, **values[name]}
        share = sum(every[k] / unit for k, unit in REFLECTANCES.items() if k in every)
        areas[name] = jnp.asarray(area * share)
    return areas


def coordinates_of(
    file: BodyFile, scale_sd: float | None
) -> dict[str | tuple[str, ...], ReflectanceCoordinates]:
    """Joint coordinates of reflectances, and of the size if the data fix their products with it.

    The prior sd of ln size is None for data without calibration. A single reflectance needs none:
    its product with the size is a site of the model.
    """
    nothing = {name: dict.fromkeys(file.priors[name], 0.0) for name in file.body.materials}
    constant = float(sum(albedo_areas(file, nothing).values()))
    made: dict[str, Reflectance] = {}
    for key, unit in reversed(REFLECTANCES.items()):  # the specular ones first
        for name, area in file.body.areas.items():
            if (prior := file.priors[name].get(key)) is not None:
                mirror, law = f"{name}_r_spec", LAWS[file.body.materials[name].law]
                below = law.layered and key == "r_diff" and mirror in made
                above = [*made].index(mirror) if below else None
                uniform = prior.kind == "uniform"
                ends = (prior.first, prior.second) if uniform else (0.0, np.inf)
                site = f"{name}_{key}" if uniform else f"log_{name}_{key}"
                made[site] = Reflectance(*ends, area / unit, above)
    if len(made) < 2:
        return {}
    if scale_sd is None:
        return {tuple(made): ReflectanceCoordinates([*made.values()], None)}
    if scale_sd:
        return {("log_brightness", *made): ReflectanceCoordinates([*made.values()], constant)}
    return {}


def unknown_reflectances(file: BodyFile) -> dict[str, tuple[str, ...]]:
    """The unknown parameters of each material in which its brightness is linear."""
    materials = file.body.materials
    return {
        name: tuple(k for k in unknown if k in REFLECTANCES)
        for name, unknown in file.priors.items()
        if LAWS[materials[name].law].multilinear
    }


def shape_of(file: BodyFile, values: Values, sizes: Sizes) -> jax.Array:
    """The other unknown numbers: lobes and lengths, logarithms of those of log-normal priors."""
    linear = unknown_reflectances(file)
    others = [
        (prior, values[name][key])
        for name, unknown in file.priors.items()
        for key, prior in unknown.items()
        if key not in linear.get(name, ())
    ]
    others += [(prior, sizes[key]) for key, prior in file.sizes.items()]
    numbers = [jnp.log(x) if prior.kind == "log-normal" else x for prior, x in others]
    return jnp.stack([jnp.asarray(x) for x in numbers]) if numbers else jnp.zeros(0)


def _corners(file: BodyFile) -> Iterator[tuple[str, dict[str, int]]]:
    """Each material with each choice of 0 and 1 for its reflectances, but all 0."""
    for name, keys in unknown_reflectances(file).items():
        for ends in product((0, 1), repeat=len(keys)):
            if any(ends):
                yield name, dict(zip(keys, ends, strict=True))


def weights(file: BodyFile, values: Values) -> jax.Array:
    """w (K,) of `BodyExpansion`; that of all reflectances 0 is the first."""

    def weight(name: str, ends: dict[str, int]) -> jax.Array | float:
        given = ((values[name][key], end) for key, end in ends.items())
        return math.prod(r if end else 1.0 - r for r, end in given)

    each = [weight(*corner) for corner in _corners(file)]
    return jnp.stack([jnp.asarray(1.0 - sum(each)), *map(jnp.asarray, each)])


def corners(file: BodyFile) -> dict[str, dict[str, jax.Array]]:
    """The reflectances (K,) at which the K functions of `BodyExpansion` are the brightness."""
    chosen = [("", {}), *_corners(file)]
    return {
        name: {
            key: jnp.array([float(one == name and ends[key]) for one, ends in chosen])
            for key in keys
        }
        for name, keys in unknown_reflectances(file).items()
    }
