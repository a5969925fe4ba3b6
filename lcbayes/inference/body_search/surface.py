"""The flux of a body as a linear function of its unknown reflectances."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.reflectance import REFLECTANCES
from lcbayes.simulation.known_bodies.reader import BodyFile, Prior

Floats = NDArray[np.float64]

ATTITUDES, EPOCHS = 32, 64  # random ones, and epochs of each
INSIDE = 0.05  # of a prior's range, that starts keep from its ends
MOST = 5  # combinations of reflectances
LEAST = 0.05  # of the flux, that a combination must change to count
REACH = 2.0  # prior standard deviations


class Surface(NamedTuple):
    """F ≈ s (F₀ + Σ u_k F_k) with u ~ N(0, I), for a few combinations u of the reflectances.

    Attributes
    ----------
    priors : {(material, parameter): Prior}
        Of the P reflectances that are unknown.
    columns : (sun_body, obs_body) → (T, K)
        F₀, with all reflectances at the medians of their priors, and F_k, without shadows.
    size : int
        K.
    directions : (P, K − 1)
        Reflectances are median + sd · directions @ u.
    brightness : m²
        Root mean square of F₀ over random attitudes.
    """

    priors: dict[tuple[str, str], Prior]
    columns: Callable[[jax.Array, jax.Array], jax.Array]
    size: int
    directions: Floats
    brightness: float

    @classmethod
    def of(cls, file: BodyFile, sun: jax.Array, obs: jax.Array, most: int = MOST) -> Surface:
        """The combinations that change the flux most, in random attitudes.

        Parameters
        ----------
        file : BodyFile
        sun, obs : (T, 3)
            Directions of the light curve, inertial axes.
        most : int
            Largest number of combinations; the time of the search grows with its square.
        """
        priors = {
            (name, key): prior
            for name, given in file.priors.items()
            for key, prior in given.items()
            if key in REFLECTANCES
        }
        centre, width = jnp.asarray(_medians(priors)), jnp.asarray(_widths(priors))

        def flux(values: jax.Array, sun_body: jax.Array, obs_body: jax.Array) -> jax.Array:
            given = _by_material(priors, values)
            return file.body.flux(sun_body, obs_body, given, shadows=False)

        def slopes(sun_body: jax.Array, obs_body: jax.Array) -> jax.Array:
            return jax.jacfwd(flux)(centre, sun_body, obs_body) * width

        stride = max(1, len(sun) // EPOCHS)
        sun, obs = sun[::stride], obs[::stride]
        any_turn = jnp.asarray(Rotation.random(ATTITUDES, rng=np.random.default_rng(0)).as_matrix())
        first = jax.jit(lambda turn: flux(centre, sun @ turn, obs @ turn))
        brightness = float(jnp.sqrt(jnp.mean(jax.lax.map(first, any_turn) ** 2)))
        directions = np.zeros((len(priors), 0))
        if priors:
            every = jax.lax.map(jax.jit(lambda turn: slopes(sun @ turn, obs @ turn)), any_turn)
            rows = np.asarray(every).reshape(-1, len(priors))
            _, size, along = np.linalg.svd(rows / np.sqrt(len(rows)), full_matrices=False)
            directions = along[size > LEAST * brightness][:most].T

        def columns(sun_body: jax.Array, obs_body: jax.Array) -> jax.Array:
            alone = flux(centre, sun_body, obs_body)[:, None]
            if not directions.shape[1]:
                return alone
            return jnp.concatenate([alone, slopes(sun_body, obs_body) @ directions], axis=1)

        return cls(priors, columns, 1 + directions.shape[1], directions, brightness)

    def values(self, coefficients: Floats) -> dict[str, dict[str, Any]]:
        """Reflectances of each material, inside their priors, from coefficients (K,) of columns."""
        u = coefficients[1:] / max(coefficients[0], 1e-9)
        found = _medians(self.priors) + _widths(self.priors) * (self.directions @ u)
        for i, prior in enumerate(self.priors.values()):
            if prior.kind == "uniform":
                margin = INSIDE * (prior.second - prior.first)
                found[i] = np.clip(found[i], prior.first + margin, prior.second - margin)
            else:
                found[i] = max(found[i], INSIDE * prior.first)
        return _by_material(self.priors, found)

    def sites(self, values: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
        """The sites of the model `body` with these values."""
        sites = {}
        for (name, key), prior in self.priors.items():
            value = values[name][key]
            if prior.kind == "uniform":
                sites[f"{name}_{key}"] = value
            else:
                sites[f"log_{name}_{key}"] = np.log(value)
        return sites


def _medians(priors: Mapping[Any, Prior]) -> Floats:
    return np.array([prior.centre for prior in priors.values()])


def _widths(priors: Mapping[Any, Prior]) -> Floats:
    """Standard deviations of the priors."""
    widths = [
        (p.second - p.first) / np.sqrt(12.0) if p.kind == "uniform" else p.first * np.log(p.second)
        for p in priors.values()
    ]
    return np.array(widths)


def _by_material(priors: Mapping[tuple[str, str], Prior], values: Any) -> dict[str, dict[str, Any]]:
    """Values in the order of the priors as {material: {parameter: value}}."""
    given: dict[str, dict[str, Any]] = {name: {} for name, _ in priors}
    for (name, key), value in zip(priors, values, strict=True):
        given[name][key] = value
    return given


def solved(square: list[list[jax.Array]], cross: list[jax.Array]) -> list[jax.Array]:
    """The solutions of many small positive definite systems, elementwise over all leading axes.

    Written out as LDLᵀ, because a loop over a library routine takes longer than the arithmetic.
    """
    n = len(cross)
    lower: list[list[jax.Array]] = [[cross[0]] * n for _ in range(n)]
    pivot: list[jax.Array] = []
    for j in range(n):
        own = square[j][j] - sum(lower[j][k] ** 2 * pivot[k] for k in range(j))
        pivot.append(jnp.maximum(own, 1e-6 * square[j][j]))
        for i in range(j + 1, n):
            mixed = sum(lower[i][k] * lower[j][k] * pivot[k] for k in range(j))
            lower[i][j] = (square[i][j] - mixed) / pivot[j]
    x: list[jax.Array] = []
    for i in range(n):
        x.append(cross[i] - sum(lower[i][k] * x[k] for k in range(i)))
    x = [value / d for value, d in zip(x, pivot, strict=True)]
    for i in reversed(range(n)):
        x[i] = x[i] - sum(lower[k][i] * x[k] for k in range(i + 1, n))
    return x
