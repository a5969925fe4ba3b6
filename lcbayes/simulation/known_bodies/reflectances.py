"""The reflectances that a body's file leaves open, in which the brightness is linear."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.reflectance_coordinates import Reflectance, ReflectanceCoordinates
from lcbayes.physics.reflectance import LAWS, REFLECTANCES
from lcbayes.simulation.known_bodies.reader import BodyFile

DIFFUSE_UNIT = {"r_diff": 1.0, "r_spec": 1.0, "w": 4.0 * np.pi}  # for which area is albedo-area

type Numbers = Mapping[str, Mapping[str, Any]]  # material → parameter → value


def albedo_areas(file: BodyFile, values: Mapping[str, Mapping[str, Any]]) -> dict[str, jax.Array]:
    """Area times reflectance of each material, m²; with the median sizes if they are unknown."""
    areas = {}
    for name, area in file.body.areas.items():
        every = {**file.body.materials[name].parameters, **values[name]}
        share = sum(every[k] / unit for k, unit in DIFFUSE_UNIT.items() if k in every)
        areas[name] = jnp.asarray(area * share)
    return areas


def coordinates_of(
    file: BodyFile, scale_sd: float | None
) -> dict[str | tuple[str, ...], ReflectanceCoordinates]:
    """Joint coordinates of reflectances, and of the size if the data fix their products with it.

    The prior sd of ln size is None for data without calibration.
    """
    nothing = {name: dict.fromkeys(file.priors[name], 0.0) for name in file.body.materials}
    constant = float(sum(albedo_areas(file, nothing).values()))
    made: dict[str, Reflectance] = {}
    for key, unit in reversed(DIFFUSE_UNIT.items()):  # the specular ones first
        for name, area in file.body.areas.items():
            if (prior := file.priors[name].get(key)) is not None:
                mirror, law = f"{name}_r_spec", LAWS[file.body.materials[name].law]
                below = law.layered and key == "r_diff" and mirror in made
                above = [*made].index(mirror) if below else None
                uniform = prior.kind == "uniform"
                ends = (prior.first, prior.second) if uniform else (0.0, np.inf)
                site = f"{name}_{key}" if uniform else f"log_{name}_{key}"
                made[site] = Reflectance(*ends, area / unit, above)
    if scale_sd is None and len(made) > 1:
        return {tuple(made): ReflectanceCoordinates([*made.values()], None)}
    if scale_sd and made:
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


def shape_of(file: BodyFile, values: Numbers, sizes: Mapping[Any, Any]) -> jax.Array:
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


def _corners(linear: Mapping[str, tuple[str, ...]]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Each material with each choice of 0 and 1 for its reflectances, but all 0."""
    for name, keys in linear.items():
        for ends in product((0, 1), repeat=len(keys)):
            if any(ends):
                yield name, ends


def weights(file: BodyFile, values: Numbers) -> jax.Array:
    """w (K,), of all reflectances 0 first."""
    linear = unknown_reflectances(file)
    each = [
        jnp.prod(
            jnp.stack(
                [
                    values[name][key] if end else 1.0 - values[name][key]
                    for key, end in zip(linear[name], ends, strict=True)
                ]
            )
        )
        for name, ends in _corners(linear)
    ]
    return jnp.stack([1.0 - sum(each), *each])


def corners(file: BodyFile) -> dict[str, dict[str, jax.Array]]:
    """The reflectances (K,) of the K functions."""
    linear = unknown_reflectances(file)
    chosen = [("", ()), *_corners(linear)]
    return {
        name: {
            key: jnp.array([float(one == name and ends[i]) for one, ends in chosen])
            for i, key in enumerate(keys)
        }
        for name, keys in linear.items()
    }
