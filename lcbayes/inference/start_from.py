"""Starts of a fit from the solutions of an attitude scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unit_vector
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem

POLE, SHIFT, SHAPE, OMEGA = "pole_base", "period_shift", "coefficients", "omega_unit"


def placed(
    spins: Sequence[Mapping[str, Any]],
    starts: jax.Array,
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
) -> jax.Array:
    """Unconstrained starts (B, D) of a search, moved to the spins of a scan in turn.

    Poles and periods (or angular velocities) are replaced by those of the spins; all other
    parameters are unchanged. A body of harmonics starts twice from each spin: with the shape of the
    original start and with the shape from the scan.

    Parameters
    ----------
    options : mapping
        Model options, with their defaults.
    """
    names = set(problem.names)
    if not ({POLE, SHIFT} <= names or OMEGA in names):
        raise InputError(
            "--start-from goes with models that spin freely: faceted, body, convex-grid"
        )
    sites = _constrained(problem, starts, data)
    sites = {k: np.array(sites[k]) for k in problem.names}
    count = len(starts) if SHAPE not in names else 2 * len(spins)
    sites = {k: np.resize(v, (count, *v.shape[1:])) for k, v in sites.items()}
    which = [spins[i % len(spins)] for i in range(count)]
    if OMEGA in names:
        omega = np.array([[s[f"omega_{axis}_rad_s"] for axis in "xyz"] for s in which])
        sites[OMEGA] = omega / float(options["omega_sd"])
    else:
        lon, lat = np.radians([[s["pole_lon_deg"], s["pole_lat_deg"]] for s in which]).T
        pole = unit_vector(lon, lat)
        sites[POLE] = pole.reshape(sites[POLE].shape)
        period = np.array([s["period_h"] for s in which])
        given = float(options["period"])
        sites[SHIFT] = (period - given) * 2.0 * float(data.t_span) / (HOUR_S * given**2)
        for i, s in enumerate(which[: len(spins)]):
            shape = np.asarray(s.get("coefficients", ()), float)
            size = min(len(shape), len(sites[SHAPE][i]))
            sites[SHAPE][i, :size] = shape[:size]
    rows = [problem.ravel({k: jnp.asarray(v[i]) for k, v in sites.items()}) for i in range(count)]
    return jnp.stack(rows)


@partial(jax.jit, static_argnums=0)
def _constrained(problem: Problem, starts: jax.Array, data: Epochs) -> dict[str, jax.Array]:
    return jax.vmap(problem.constrain, (0, None))(starts, data)
