"""What a model sees of a light curve: arrays on the device, in the units the physics uses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from lcbayes._jax import jax, jnp
from lcbayes.lightcurve import LightCurve

SOLAR_FLUX_VISIBLE = 455.0  # W/m², Linares & Crassidis, below eq. (5)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Epochs:
    """The argument of every model: `model(data)`.

    Attributes
    ----------
    t : (T,) s
        Time since the light curve's epoch.
    sun, obs : (T, 3)
        Unit vectors body→Sun and body→observer, inertial.
    brightness, error : (T,)
        Observed flux or magnitude and its standard deviation (NaN when unknown). Only
        `noise.observe` reads them.
    dilution : (T,)
        What unit-distance flux is multiplied by: Φ_sun,vis/r² (W/m² per m²) where ranges are
        known, else 1.
    curve : (T,) int
        Group of the point.
    free_scale : (C,)
        1 where the group's brightness carries an unknown factor, else 0.
    exposure_s : (T,) s
    kind : "flux" or "mag"
    has_error : whether `error` is known
    """

    t: jax.Array
    sun: jax.Array
    obs: jax.Array
    brightness: jax.Array
    error: jax.Array
    dilution: jax.Array
    curve: jax.Array
    free_scale: jax.Array
    exposure_s: jax.Array
    kind: str = field(default="flux", metadata={"static": True})
    has_error: bool = field(default=True, metadata={"static": True})

    @classmethod
    def of(cls, curve: LightCurve) -> Epochs:
        """The device arrays of a light curve."""
        n = len(curve.t)
        ranged = curve.range_km is not None
        return cls(
            t=jnp.asarray(curve.t),
            sun=jnp.asarray(curve.sun),
            obs=jnp.asarray(curve.obs),
            brightness=jnp.asarray(curve.brightness),
            error=jnp.full(n, np.nan) if curve.error is None else jnp.asarray(curve.error),
            dilution=(
                SOLAR_FLUX_VISIBLE / (1e3 * jnp.asarray(curve.range_km)) ** 2
                if ranged
                else jnp.ones(n)
            ),
            curve=jnp.asarray(curve.curve),
            free_scale=jnp.asarray(curve.free_scale, dtype=float),
            exposure_s=jnp.asarray(curve.exposure_s),
            kind=curve.kind,
            has_error=curve.error is not None,
        )
