"""Light curves of turning diffuse facets with a small fault; plain NumPy, without the package."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from lcbayes.data.lightcurve import LightCurve

DAY = 86400.0


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Fault:
    """Departures from the model; all zero by default.

    The zero point (mag, positive if fainter) and the clock (s, added to the recorded times) are
    those of the second site, and late_pass_s (likewise) is that of the pass `late_pass`; the drift
    is the relative change of rate over the light curve, and the nutation the half-angle (deg) of
    the cone on which the spin axis moves. The second site becomes fainter along each pass by the
    slope (mag) from its middle to its end.
    """

    zero_point: float = 0.0
    clock: float = 0.0
    late_pass_s: float = 0.0
    late_pass: int = 0
    drift: float = 0.0
    nutation_deg: float = 0.0
    slope: float = 0.0
    lobe: float = 0.0  # brightness of a lobe of exponent 30 on the first facet over its diffuse one
    lommel_seeliger: float = 0.0  # share of the light that is scattered by this law
    error_factor: float = 1.0
    correlation_s: float = 0.0  # of the noise


@dataclass(frozen=True)
class Body:
    """Facets with their truth, for a rotation about ``omega`` with body axes inertial at t = 0."""

    normals: np.ndarray
    areas: np.ndarray
    omega: np.ndarray
    sun: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))

    @property
    def sites(self) -> dict[str, Any]:
        """The truth as values of the model `faceted`, without a scale of its own."""
        return {
            "normals_base": self.normals,
            "log_albedo_area": np.log(self.areas),
            "omega_unit": self.omega / 0.1,
            "log_level": np.zeros(0),
        }


def body(seed: int, n_facets: int = 3) -> Body:
    """A random body whose facets are all seen, spinning once in one to four minutes."""
    rng = np.random.default_rng([seed, 1])
    axis = unit(rng.normal(size=3))
    rate = 2 * np.pi / rng.uniform(60.0, 240.0)
    while True:
        normals = unit(rng.normal(size=(n_facets, 3)))
        apart = np.arccos(np.clip(normals @ normals.T, -1, 1)) + 4 * np.eye(n_facets)
        if apart.min() > 0.7 and np.abs(normals @ axis).max() < 0.85:
            break
    return Body(normals, rng.uniform(1.0, 4.0, n_facets), rate * axis)


def diffuse(mu0: np.ndarray, mu: np.ndarray) -> np.ndarray:
    mu0, mu = np.maximum(mu0, 0), np.maximum(mu, 0)
    return (1 - (1 - mu0 / 2) ** 5) * (1 - (1 - mu / 2) ** 5) * mu0 * mu / np.pi


def flux(it: Body, t: np.ndarray, sun: np.ndarray, obs: np.ndarray, fault: Fault) -> np.ndarray:
    """Flux (T,) at true times t and directions."""
    middle, span = 0.5 * (t.min() + t.max()), np.ptp(t)
    warped = t + fault.drift * ((t - middle) ** 2 - middle**2) / (2 * span)
    turn = Rotation.from_rotvec(warped[:, None] * it.omega)
    if fault.nutation_deg:
        pole = unit(it.omega)
        first = unit(np.cross(pole, [0.3, 0.5, 0.8]))
        angle = 0.7 * np.linalg.norm(it.omega) * t + 0.4
        tilt = np.cos(angle)[:, None] * first + np.sin(angle)[:, None] * np.cross(pole, first)
        turn = Rotation.from_rotvec(np.radians(fault.nutation_deg) * tilt) * turn
    sun, obs = (turn.inv().apply(v) for v in (sun, obs))
    mu0, mu = sun @ it.normals.T, obs @ it.normals.T
    result = diffuse(mu0, mu) @ it.areas
    if fault.lommel_seeliger:
        seen = (mu0 > 0) & (mu > 0)
        other = np.where(seen, mu0 * mu / np.where(seen, mu0 + mu, 1.0), 0.0) @ it.areas
        other *= result.mean() / other.mean()
        result = (1.0 - fault.lommel_seeliger) * result + fault.lommel_seeliger * other
    if fault.lobe:
        half = np.maximum(unit(sun + obs) @ it.normals[0], 0.0)
        seen = (mu0[:, 0] > 0) & (mu[:, 0] > 0)
        result = result + fault.lobe * it.areas[0] / np.pi * half**30 * seen
    return result


def light_curve(
    it: Body,
    fault: Fault | None = None,
    *,
    seed: int = 0,
    n: int = 160,
    noise: float = 0.02,
    n_sites: int = 2,
    n_passes: int = 2,
    spacing_s: float = 900.0,
) -> LightCurve:
    """A light curve with ``n`` points of relative errors ``noise``, alternating between the sites.

    Each pass lasts 240 s; the direction to each site turns by 100° in it. Directions are those of
    the recorded times.
    """
    fault = fault or Fault()
    rng = np.random.default_rng([seed, 2])
    each = n // n_passes
    t = np.concatenate([k * spacing_s + np.linspace(0, 240.0, each) for k in range(n_passes)])
    which = np.arange(t.size) % n_sites
    number = np.repeat(np.arange(n_passes), each)

    def directions(t: np.ndarray) -> np.ndarray:
        angle = np.radians(-50.0 + 100.0 * (t - number * spacing_s) / 240.0)
        lean = 0.3 + 0.35 * which + 0.25 * number
        return unit(
            np.stack(
                [
                    np.cos(angle) * np.cos(lean),
                    np.sin(angle),
                    np.cos(angle) * np.sin(lean),
                ],
                1,
            )
        )

    late = fault.clock * (which == 1) + fault.late_pass_s * (number == fault.late_pass)
    sun = np.tile(it.sun, (t.size, 1))
    true = flux(it, t, sun, directions(t), fault)
    along = (t - number * spacing_s) / 120.0 - 1.0
    true = true * 10 ** (-0.4 * (fault.zero_point + fault.slope * along) * (which == 1))
    error = noise * true.mean() * np.ones(t.size)
    unit_noise = rng.normal(size=t.size)
    if fault.correlation_s:
        lag = np.abs(t[:, None] - t) / fault.correlation_s
        unit_noise = np.linalg.cholesky(np.exp(-lag) + 1e-12 * np.eye(t.size)) @ unit_noise
    recorded = t + late
    order = np.argsort(recorded, kind="stable")
    which, number = which[order], number[order]
    seen = true + fault.error_factor * error * unit_noise
    recorded = recorded[order]
    return LightCurve(
        t=recorded,
        brightness=seen[order],
        error=error[order],
        sun=sun,
        obs=directions(recorded),
        kind="flux",
        free_scale=np.array([False]),
        site=np.array(["A", "B"] if n_sites == 2 else ["", ""])[which],
    )
