"""Attitudes tested with free facets: refined spins, and the catalogue of stabilised laws.

A smooth body is sufficient to find the basin of attraction of a spin. A satellite, however, has
edges. Only a body with free facets shows how well an attitude explains its light curve.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.distribution import Distribution, grid, solve
from lcbayes.inversion.albedo_area.facets import refine
from lcbayes.inversion.albedo_area.kernel import Material, columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.laws import Attitude, Spinning

Floats = NDArray[np.float64]

N_NORMALS = 400
FRONT_AND_BACK = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])  # of an array, in the array's axes
MOST_STEPS = 15
ROUNDS = 3  # alternations between the spin for given normals and the normals for a given spin
NUDGE = 1e-3  # rad, and turns over the data; step of finite differences


def moved(spin: Spinning, step: Floats, span: float) -> Spinning:
    """Spin turned by step[:2] (rad) about body x and y, with step[2] more turns in ``span``."""
    small = rotations.constant_rate(jnp.ones(1), jnp.array([step[0], step[1], 0.0]))[0]
    return replace(
        spin, tilt=spin.tilt @ np.asarray(small), frequency=spin.frequency + step[2] / span
    )


def best_body(
    curve: LightCurve,
    attitude: Attitude,
    material: Material,
    n_normals: int = N_NORMALS,
    array: Attitude | None = None,
) -> Distribution:
    """The best-fitting non-negative facets, with free normals, for an attitude.

    They are found on an equal-area grid, refined about non-zero areas.

    Parameters
    ----------
    curve : LightCurve
    attitude : Attitude
    material : Material
    n_normals : int
        Number of normals of the grid.
    array : Attitude, optional
        Attitude of a solar array on the body: its front and back are two additional facets.

    Returns
    -------
    Distribution
        The array's front and back come last, with ``which`` 1 and normals in the array's axes.
    """
    normals, which = grid(n_normals, (material,))
    seen = Observed.of(curve, attitude)
    matrix = columns(seen, normals, which, (material,))
    if array is not None:
        own = columns(Observed.of(curve, array), FRONT_AND_BACK, np.zeros(2, int), (material,))
        normals, matrix = np.vstack([normals, FRONT_AND_BACK]), np.hstack([matrix, own])
        which = np.concatenate([which, [1, 1]])
    coarse = solve(seen, normals, which, matrix)
    fine = refine(seen, coarse, matrix, (material,), still=len(normals) - n_normals)
    order = np.argsort(fine.which, kind="stable")
    return replace(
        fine, normals=fine.normals[order], which=fine.which[order], areas=fine.areas[order]
    )


def polish(
    curve: LightCurve, start: Spinning, span: float, material: Material, n_normals: int = N_NORMALS
) -> tuple[Spinning, Distribution]:
    """The spin near ``start`` whose best body has the best fit.

    The normals of a body are fixed, and all its areas are solved for at each step (variable
    projection). The three spin parameters are fitted by scipy's trust-region least squares with
    finite differences. The fit first uses a full grid of normals, and then the normals of the best
    body, which are updated in each round.
    """
    normals = grid(n_normals)[0]
    spin = start
    for _ in range(ROUNDS):
        spin = _nearest(curve, spin, span, material, normals)
        body = best_body(curve, spin, material, n_normals)
        normals = body.normals
    return spin, body


def _nearest(
    curve: LightCurve, start: Spinning, span: float, material: Material, normals: Floats
) -> Spinning:
    """The best-fitting spin near ``start`` for facets with these normals."""
    from scipy.optimize import least_squares

    which = np.zeros(len(normals), int)

    # parameters centred at one, because scipy's finite differences are relative
    def residual(x: Floats) -> Floats:
        seen = Observed.of(curve, moved(start, x - 1.0, span))
        body = solve(seen, normals, which, columns(seen, normals, which, (material,)))
        return (seen.flux - body.flux) / seen.error

    end = least_squares(
        residual,
        np.ones(3),
        diff_step=NUDGE,
        x_scale=[0.05, 0.05, 0.1],
        max_nfev=MOST_STEPS,
        xtol=1e-6,
        ftol=1e-5,
    )
    return moved(start, end.x - 1.0, span)
