"""Starts of a fit from the solutions of an attitude scan."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from lcbayes.core.constants import HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.geometry.spherical import unit_vector
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.recorded import Sites

SPINS_FREELY = (
    "--start-from goes with models that spin freely: faceted, body, convex-grid, contact-binary"
)
POLE, SHIFT, SHAPE, OMEGA = "pole_base", "period_shift", "coefficients", "omega_unit"


def placed(
    spins: Sequence[Mapping[str, Any]],
    starts: jax.Array,
    problem: Problem,
    data: Epochs,
    options: Mapping[str, Any],
    shapes_of: Callable[..., Sequence[Sites]] | None = None,
) -> jax.Array:
    """Unconstrained starts (B, D) of a search, moved to the spins of a scan.

    Each of the model's shapes, if it has a hook ``shapes``, starts from each spin; a body of
    harmonics starts with the shape from the scan too, which come first. Without the hook, the
    starts take the spins in turn, and poles and periods (or angular velocities) are replaced by
    those of the spins; all other parameters are unchanged.

    Parameters
    ----------
    options : mapping
        Model options, with their defaults.
    """
    names = set(problem.names)
    if not ({POLE, SHIFT} <= names or OMEGA in names):
        raise InputError(SPINS_FREELY)
    if OMEGA in names:
        every = [_omega(spin, float(options["omega_sd"])) for spin in spins]
    else:
        every = [spin_sites(spin, data, float(options["period"])) for spin in spins]
    if shapes_of is not None:
        shapes = shapes_of(data, **options)
        rows = [
            {**shapes[0], **sites, SHAPE: _shape(shapes[0][SHAPE], spin["coefficients"])}
            for sites, spin in zip(every, spins, strict=True)
            if SHAPE in names and "coefficients" in spin
        ]
        rows += [{**shape, **sites} for sites in every for shape in shapes]
    else:
        sites = _constrained(problem, starts, data)
        rows = [
            {**{k: sites[k][i] for k in problem.names}, **every[i % len(every)]}
            for i in range(len(starts))
        ]
    return jnp.stack([problem.ravel(row) for row in rows])


def spin_sites(spin: Mapping[str, Any], data: Epochs, period: float) -> Sites:
    """The sites of a pole (``pole_lon_deg``, ``pole_lat_deg``) and a sidereal period
    (``period_h``), of a model with a given ``period`` in h."""
    lon, lat = np.radians([spin["pole_lon_deg"], spin["pole_lat_deg"]])
    shift = (spin["period_h"] - period) * 2.0 * float(data.t_span) / (HOUR_S * period**2)
    return {POLE: jnp.asarray(unit_vector(lon, lat))[None], SHIFT: jnp.asarray(shift)}


def _omega(spin: Mapping[str, Any], sd: float) -> Sites:
    return {OMEGA: jnp.array([spin[f"omega_{axis}_rad_s"] for axis in "xyz"]) / sd}


def _shape(sphere: jax.Array, coefficients: Sequence[float]) -> jax.Array:
    """Coefficients of a scan, of another degree, for those of the model."""
    size = min(len(coefficients), len(sphere))
    return sphere.at[:size].set(jnp.asarray(coefficients[:size]))


@partial(jax.jit, static_argnums=0)
def _constrained(problem: Problem, starts: jax.Array, data: Epochs) -> dict[str, jax.Array]:
    return jax.vmap(problem.constrain, (0, None))(starts, data)
