"""Light curves of spinning bodies of known shape, for the tests of attitude scans."""

from __future__ import annotations

import numpy as np

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.attitude_scan.points import Points
from lcbayes.inversion.attitude_scan.smooth import SmoothBody, Spin, brightness
from lcbayes.inversion.attitude_scan.spin import tilts

HOUR = 3600.0
LAW = "lommel-seeliger-lambert"


def directions(rng: np.random.Generator, n: int) -> np.ndarray:
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def geometry(
    n_curves: int = 8, per_curve: int = 12, days: float = 400.0, seed: int = 0, flat: float = 0.6
) -> LightCurve:
    """Curves of three hours each, Sun and observer some 20° apart, all round a circle.

    ``flat`` is how far, in rad, they leave its plane.
    """
    rng = np.random.default_rng(seed)
    t, sun, obs, group = [], [], [], []
    for c, begin in enumerate(np.sort(rng.uniform(0.0, 86400.0 * days, n_curves))):
        lon, lat = 2.0 * np.pi * c / n_curves, flat * rng.uniform(-1.0, 1.0)
        turn = np.array(
            [
                [np.cos(x) * np.cos(y), np.sin(x) * np.cos(y), np.sin(y)]
                for x, y in ((lon, lat), (lon + 0.35, 0.6 * lat))
            ]
        )
        t.append(begin + np.sort(rng.uniform(0.0, 3.0 * HOUR, per_curve)))
        sun.append(np.tile(turn[0], (per_curve, 1)))
        obs.append(np.tile(turn[1], (per_curve, 1)))
        group.append(np.full(per_curve, c))
    return LightCurve(
        t=np.concatenate(t),
        brightness=np.ones(n_curves * per_curve),
        error=None,
        sun=np.concatenate(sun),
        obs=np.concatenate(obs),
        curve=np.concatenate(group),
        free_scale=np.ones(n_curves, bool),
        frame="ecliptic-j2000",
    )


def shape(degree: int, seed: int = 1, size: float = 0.5) -> np.ndarray:
    """Harmonics of an elongated body with some irregularity, no constant."""
    rng = np.random.default_rng(seed)
    orders = [(n, m) for n in range(1, degree + 1) for m in range(-n, n + 1)]
    c = np.array([size * rng.normal() / (n + 1) ** 2 if n > 1 else 0.0 for n, _ in orders])
    c[orders.index((2, 2))] = -0.8
    return c


def observed(
    curve: LightCurve, pole: np.ndarray, period_h: float, noise: float, n_facets: int = 300
) -> LightCurve:
    """The same epochs with the flux of such a body, with Gaussian noise relative to the flux."""
    from dataclasses import replace

    body = SmoothBody.of(n_facets, 4, LAW)
    points = Points.of(curve, phase_law_known=False)
    spin = Spin(*map(jnp.asarray, (tilts(pole[None])[0], 1.0 / (HOUR * period_h), shape(4))))
    flux = np.asarray(jax.jit(brightness)(body, points, spin).flux)
    rng = np.random.default_rng(9)
    return replace(curve, brightness=flux * (1.0 + noise * rng.normal(size=len(flux))))
