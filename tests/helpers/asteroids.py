"""Light curves of a simulated asteroid."""

from __future__ import annotations

import numpy as np

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import unit_vector
from lcbayes.physics import brightness
from lcbayes.physics.attitude import rotations
from lcbayes.physics.bodies import facets

PERIOD_H, POLE_DEG, AXES = 6.0003, (60.0, 40.0), (1.6, 1.15, 1.0)
SMALL = {"period": 6.0, "n_facets": 100, "n_quadrature": 100, "degree": 3}


def unit(lon_deg, lat_deg) -> np.ndarray:
    return unit_vector(*np.broadcast_arrays(np.radians(lon_deg), np.radians(lat_deg)))


def observed(free_scale: bool = True, n_points: int = 25) -> LightCurve:
    """An ellipsoid that turns about its shortest axis, eight nights in half a year, noise 0.5 %."""
    rng = np.random.default_rng(5)
    night = np.repeat(np.arange(8), n_points)
    within = np.sort(rng.uniform(0, 0.8 * PERIOD_H * 3600, (8, n_points)), axis=1).ravel()
    t = 25 * 86400.0 * night + within
    sun = unit(45.0 * night, np.where(night % 2, 20.0, -12.0))
    obs = unit(45.0 * night + np.array([8, -20, 15, 3, -12, 22, -5, 18])[night], 5.0)
    normals = facets.grid(2000)
    density = 1.0 / (normals**2 @ np.square(AXES)) ** 2  # of the area by solid angle
    lon, lat = np.radians(POLE_DEG)
    turn = rotations.principal_axis(jnp.asarray(t), lon, lat, PERIOD_H * 3600, 0.3)
    sun_body, obs_body = (rotations.to_body(turn, jnp.asarray(v)) for v in (sun, obs))
    area = jnp.asarray(density / density.sum())
    law = "lommel-seeliger-lambert"
    flux = np.asarray(brightness.flux(sun_body, obs_body, jnp.asarray(normals), area, law))
    flux = flux * (1 + 0.005 * rng.normal(size=len(t)))
    return LightCurve(
        t=t,
        brightness=flux,
        error=None,
        sun=sun,
        obs=obs,
        curve=night,
        free_scale=np.full(8, free_scale),
        epoch_jd=2450000.0,
        frame="ecliptic-j2000",
    )
