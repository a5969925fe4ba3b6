"""Validity of the bound: whether the brightness is linear in the unknowns within it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.simulation.observability.campaign import Campaign, flux_weight
from lcbayes.simulation.observability.measurements import Measurements

Floats = NDArray[np.float64]

ENDS = 2.0  # standard deviations
MAX_NONLINEARITY = 0.05  # up to this value, the bound describes the error
_FAR = 1e4  # χ² beyond which no linearised step is taken
_ROUNDS = 4  # of Gauss-Newton steps; strongly nonlinear cases need more


def nonlinearity(campaign: Campaign, measured: Measurements) -> Floats:
    """Relative error of the two-sigma interval for each unknown, (P,).

    Each unknown is shifted by two standard deviations (`Campaign.bound_with_prior`) to either side.
    The other unknowns are fitted to the data and the prior, and the brightness is recomputed. For a
    linear model and data without noise, χ² then rises by 4. The result is max |√χ²/2 − 1| over the
    two sides. It is 0 for a linear model and negligible below `MAX_NONLINEARITY`. It is large if a
    facet turns away, if the phase becomes ambiguous, or if only the prior constrains the unknown.

    The fit uses Gauss-Newton steps with the Jacobian at the truth, which requires a few evaluations
    of the brightness for each unknown. If it does not converge, χ² is too large, never too small.
    It is limited to 10⁴, and the result to 49.

    References
    ----------
    Bates & Watts 1988, Nonlinear Regression Analysis and Its Applications, sec. 6.1 (profile t).
    """
    unknowns = campaign.unknowns
    sd, curve = unknowns.prior_sd, measured.curve
    seen = campaign.jacobian * sd
    _, values, rows = np.linalg.svd(seen, full_matrices=True)
    information = np.zeros(len(sd))
    information[: len(values)] = values**2
    covariance = (rows.T / (1.0 + information)) @ rows  # of θ in units of the prior widths
    towards = covariance / np.sqrt(np.diag(covariance))  # column i: change with unknown i by one sd

    weight = jnp.asarray(np.nan_to_num(flux_weight(measured)))
    epochs = tuple(map(jnp.asarray, (curve.t, curve.sun, curve.obs)))

    @jax.jit
    def change(scaled: jax.Array) -> jax.Array:
        """Change of the brightness over its noise, (2 P, T)."""
        zero = unknowns.flux(jnp.zeros(len(sd)), *epochs)
        return jax.lax.map(lambda u: (unknowns.flux(u * sd, *epochs) - zero) * weight, scaled)

    which = np.tile(np.arange(len(sd)), 2)
    here = np.concatenate([ENDS * towards.T, -ENDS * towards.T])
    least = np.full(len(here), np.inf)
    for _ in range(_ROUNDS):
        off = np.asarray(change(jnp.asarray(here)))
        least = np.fmin(least, np.sum(off**2, axis=1) + np.sum(here**2, axis=1))
        near = np.sum(off**2, axis=1) < _FAR  # also false if not finite
        step = -(np.where(near[:, None], off, 0.0) @ seen + here) @ covariance
        fixed = step[np.arange(len(here)), which] / np.sqrt(np.diag(covariance))[which]
        here = here + np.where(near[:, None], step - fixed[:, None] * towards.T[which], 0.0)
    shift = np.abs(np.sqrt(np.minimum(least, _FAR)) / ENDS - 1.0)
    return np.max(shift.reshape(2, -1), axis=0)
