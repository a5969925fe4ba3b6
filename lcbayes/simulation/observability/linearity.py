"""How far the bound may be believed: whether the brightness is linear in the unknowns within it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.simulation.observability.campaign import Campaign, flux_weight
from lcbayes.simulation.observability.measurements import Measurements

Floats = NDArray[np.float64]

ENDS = 2.0  # standard deviations
MAX_NONLINEARITY = 0.05  # up to this the bound describes an error
_FAR = 1e4  # χ² beyond which no step is taken from a straight line
_ROUNDS = 4  # of the other unknowns following; where they need more, nothing is linear


def nonlinearity(found: Campaign, measured: Measurements) -> Floats:
    """By what share of itself the interval of two bounds is off, for each unknown, (P,).

    Each unknown is put two standard deviations (`Campaign.bound_with_prior`) to either side, the
    others follow as the data and the prior want, and the brightness is worked out anew. If it were
    linear, data without noise would have lost χ² = 4. The number is max |√χ²/2 − 1| over the two
    sides: 0 for a linear model, negligible if below `MAX_NONLINEARITY`;
    large where a facet turns away, a phase is lost or only the prior constrains the unknown.

    The others follow by Gauss-Newton steps with the Jacobian of the truth, which costs a few
    evaluations of the brightness for each unknown. Where that does not converge, χ² comes out too
    large, never too small; it is cut at 10⁴, the number at 49.

    References
    ----------
    Bates & Watts 1988, Nonlinear Regression Analysis and Its Applications, sec. 6.1 (profile t).
    """
    unknowns = found.unknowns
    sd, curve = unknowns.prior_sd, measured.curve
    seen = found.jacobian * sd
    _, values, rows = np.linalg.svd(seen, full_matrices=True)
    information = np.zeros(len(sd))
    information[: len(values)] = values**2
    covariance = (rows.T / (1.0 + information)) @ rows  # of θ over the prior's widths
    towards = covariance / np.sqrt(np.diag(covariance))  # column i: unknown i one sd away

    weight = jnp.asarray(np.nan_to_num(flux_weight(measured)))
    epochs = tuple(map(jnp.asarray, (curve.t, curve.sun, curve.obs)))

    @jax.jit
    def change(scaled: jax.Array) -> jax.Array:
        """Of the brightness over its noise, (2 P, T)."""
        zero = unknowns.flux(jnp.zeros(len(sd)), *epochs)
        return jax.lax.map(lambda u: (unknowns.flux(u * sd, *epochs) - zero) * weight, scaled)

    which = np.tile(np.arange(len(sd)), 2)
    here = np.concatenate([ENDS * towards.T, -ENDS * towards.T])
    least = np.full(len(here), np.inf)
    for _ in range(_ROUNDS):
        off = np.asarray(change(jnp.asarray(here)))
        least = np.fmin(least, np.sum(off**2, axis=1) + np.sum(here**2, axis=1))
        near = np.sum(off**2, axis=1) < _FAR  # also false where it is not finite
        step = -(np.where(near[:, None], off, 0.0) @ seen + here) @ covariance
        fixed = step[np.arange(len(here)), which] / np.sqrt(np.diag(covariance))[which]
        here = here + np.where(near[:, None], step - fixed[:, None] * towards.T[which], 0.0)
    shift = np.abs(np.sqrt(np.minimum(least, _FAR)) / ENDS - 1.0)
    return np.max(shift.reshape(2, -1), axis=0)
