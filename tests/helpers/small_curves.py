"""Small light curves with a known truth, for tests of the inference."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics import brightness, photometry
from lcbayes.physics.attitude import rotations

# Options of short fits of one facet; tests that give the same ones share compiled programs.
SHORT_RUN = (
    *("--num-chains", "2", "--num-warmup", "10", "--num-samples", "20"),
    *("--num-starts", "16"),
)
TRUSTED_FIT = (
    *("--n-facets", "1", "--spin", "none", "--num-warmup", "200", "--num-samples", "250"),
    *("--num-starts", "16"),
)
SHORT_FIT = (
    *("--n-facets", "1", "--spin", "none", "--num-chains", "2"),
    *("--num-warmup", "50", "--num-samples", "100", "--num-starts", "16"),
)
NORMALS = np.array([[0.8, 0.5, 0.33], [-0.1, 0.75, 0.65]])
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
AREAS = np.array([6.0, 3.5])
OMEGA = np.array([0.004, -0.003, 0.008])


def of_flux(
    t: np.ndarray, flux: np.ndarray, error: float, sun: np.ndarray, obs: np.ndarray
) -> LightCurve:
    """A light curve of known scale whose points have one error, in m²."""
    return LightCurve(
        t=t,
        brightness=flux,
        error=np.full(t.size, error),
        sun=sun,
        obs=obs,
        frame="icrs",
        kind="flux",
        free_scale=np.array([False]),
    )


def directions(n: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Sun and observer all over the hemisphere that the facets face, (n, 3) each."""
    rng = np.random.default_rng(seed)
    v = np.array([0.4, 0.75, 0.55]) + 0.45 * rng.standard_normal((2, n, 3))
    return tuple(v / np.linalg.norm(v, axis=-1, keepdims=True))  # type: ignore[return-value]


@jax.jit
def _flux(
    t: jax.Array,
    omega: jax.Array,
    sun: jax.Array,
    obs: jax.Array,
    normals: jax.Array,
    areas: jax.Array,
) -> jax.Array:
    rotation = rotations.constant_rate(t, omega)
    sun, obs = rotations.to_body(rotation, sun), rotations.to_body(rotation, obs)
    return brightness.flux(sun, obs, normals, areas, "non-lambertian")


def curve(
    n: int = 30,
    n_facets: int = 1,
    *,
    noise: float = 0.03,
    seed: int = 0,
    spinning: bool = False,
    sun: np.ndarray | None = None,
    obs: np.ndarray | None = None,
    **changes: Any,
) -> LightCurve:
    """A flux curve of ``n`` points over a minute, its noise relative to the mean, as seen from
    directions of its own if none are given."""
    if sun is None or obs is None:
        sun, obs = directions(n)
    t = np.linspace(0.0, 60.0, n)
    flux = np.asarray(_flux(t, OMEGA * spinning, sun, obs, NORMALS[:n_facets], AREAS[:n_facets]))
    sd = noise * flux.mean()
    rng = np.random.default_rng(seed)
    given: dict[str, Any] = {
        "t": t,
        "brightness": flux + sd * rng.standard_normal(n),
        "error": np.full(n, sd),
        "kind": "flux",
        "sun": sun,
        "obs": obs,
    }
    return LightCurve(**(given | changes))


def posterior(light: LightCurve, model: str = "faceted", **options: Any) -> tuple[Problem, Epochs]:
    """The posterior of a built-in model."""
    data = Epochs.of(light)
    return Problem(registry.find(model).bind(options), data), data


def truth(problem: Problem, data: Epochs, n_facets: int, **sites: Any) -> jax.Array:
    """The vector z of the truth behind `curve`."""
    known = {
        "normals_base": jnp.asarray(NORMALS[:n_facets]),
        "log_albedo_area": jnp.log(jnp.asarray(AREAS[:n_facets])),
        "omega_unit": jnp.asarray(OMEGA / 0.1),
        "log_level": jnp.zeros(len([f for f in data.free_scale if f])),
        "log_sigma": jnp.log(jnp.array(0.03)),
    } | sites
    return problem.ravel(known)


def magnitudes(n: int, seed: int = 0) -> LightCurve:
    """One facet in V magnitudes at 700 km, without errors; the noise is 0.03 mag."""
    light = curve(n, noise=1e-9)
    kept = np.flatnonzero(light.brightness > 0.02 * light.brightness.max())
    light = light.select(kept)
    m = photometry.magnitude(
        jnp.asarray(light.brightness), jnp.asarray(7e5), photometry.sun_magnitude("V")
    )
    rng = np.random.default_rng(seed)
    return replace(
        light,
        kind="mag",
        brightness=np.asarray(m) + 0.03 * rng.standard_normal(len(kept)),
        error=None,
        band=np.full(len(kept), "V"),
        range_km=np.full(len(kept), 700.0),
    )
