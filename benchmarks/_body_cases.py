"""Light curves of bundled bodies in a flat or constant spin, for `bodies.py`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax
from lcbayes.data.lightcurve import LightCurve
from lcbayes.simulation.known_bodies.body import KnownBody
from lcbayes.simulation.known_bodies.reader import Prior, body_text, read_body_text

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.helpers.low_earth_orbit import campaign

PERIODS_S = (20.0, 200.0)  # log-uniform
POINTS = 150  # of a pass


@dataclass(frozen=True)
class Case:
    """A light curve and the motion that it was made from.

    Attributes
    ----------
    curve : LightCurve
    omega : (3,) rad/s
    attitude : (3, 3)
        Body to inertial at the first epoch.
    turns : over the time base
    body : KnownBody
    surface : parameters of materials that the body's file leaves open, by the names of the model
    """

    curve: LightCurve
    omega: np.ndarray
    attitude: np.ndarray
    turns: float
    body: KnownBody
    surface: dict[str, float]


def drawn(body: str, spin: str, seed: int, snr: float = 30.0, passes: int = 2) -> Case:
    """A case: a random orbit with some of its passes, a random motion and a random surface."""
    rng = np.random.default_rng([seed, 7])
    file = read_body_text(body_text(body))
    values = {
        name: {**file.body.materials[name].parameters}
        | {key: _from(prior, rng) for key, prior in result.items()}
        for name, result in file.priors.items()
    }
    flux_of = jax.jit(file.body.flux)
    while True:
        orbit, spans = campaign(rng, passes)
        t = np.concatenate([np.linspace(a, a + min(b - a, 480.0), POINTS) for a, b in spans])
        sun, obs, _ = orbit.look(t)
        t = t - t[0]
        rate = 2.0 * np.pi / np.exp(rng.uniform(*np.log(PERIODS_S)))
        attitude = Rotation.random(rng=rng).as_matrix()
        if spin == "flat":
            omega = rate * rng.choice([-1.0, 1.0]) * attitude @ file.body.flat_axis
        else:
            direction = rng.standard_normal(3)
            omega = rate * direction / np.linalg.norm(direction)
        turns = Rotation.from_rotvec(t[:, None] * omega).as_matrix() @ attitude
        in_body = [np.einsum("ti,tij->tj", v, turns) for v in (sun, obs)]
        flux = np.asarray(flux_of(*in_body, values))
        if flux.mean() > 0.0 and flux.std() > 0.1 * flux.mean():
            break
    error = np.full(t.size, flux.mean() / snr)
    curve = LightCurve(
        t=t,
        brightness=flux + error * rng.standard_normal(t.size),
        error=error,
        sun=np.array(sun),
        obs=obs,
        frame="icrs",
        kind="flux",
        free_scale=np.array([False]),
    )
    surface = {f"{m}_{k}": values[m][k] for m, priors in file.priors.items() for k in priors}
    return Case(curve, omega, attitude, rate * t[-1] / (2.0 * np.pi), file.body, surface)


def _from(prior: Prior, rng: np.random.Generator) -> float:
    """A draw of a prior."""
    if prior.kind == "uniform":
        return float(rng.uniform(prior.first, prior.second))
    return float(prior.first * prior.second ** rng.standard_normal())
