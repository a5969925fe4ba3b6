"""Fisher information of all measurements of a campaign, and the Cramér-Rao bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.sensitivity import MAGNITUDE_PER_NEPER
from lcbayes.simulation.observability.measurements import Measurements
from lcbayes.simulation.observability.parameters import Unknowns

Floats = NDArray[np.float64]

# A combination whose eigenvalue of the scaled information is below this share of the largest one is
# unobservable. The limit corresponds to 1e-11 of the largest singular value of the Jacobian, well
# above its rounding errors of 1e-14. A decomposition of the information matrix itself would only
# resolve eigenvalues above 1e-15 of the largest.
NOTHING = 1e-22
_TANGENTS = 5_000_000  # epochs x facets x parameters at a time, to limit the memory


@dataclass(frozen=True)
class Campaign:
    """The information of a campaign on the unknowns θ, at the values of the scenario.

    Attributes
    ----------
    unknowns : Unknowns
    jacobian : (T, P)
        ∂(clean flux)/∂θ over the standard deviation of the flux, per unit of θ.
    """

    unknowns: Unknowns
    jacobian: Floats

    @property
    def fisher(self) -> Floats:
        """F = Σₜ (∂f/∂θ)(∂f/∂θ)ᵀ/σ², (P, P), of the measurements without the prior (Hinks 16)."""
        return self.jacobian.T @ self.jacobian

    @property
    def bound(self) -> Floats:
        """Cramér-Rao bound √(F⁻¹)ᵢᵢ of each parameter, (P,); ∞ if the data do not constrain it."""
        return bound(self.jacobian)

    @property
    def bound_with_prior(self) -> Floats:
        """Bound √((F + Π)⁻¹)ᵢᵢ, with the precision Π of the prior included; always finite.

        References
        ----------
        Van Trees 1968, Detection, Estimation and Modulation Theory I, sec. 2.4.3.
        """
        sd = self.unknowns.prior_sd
        _, values, rows = np.linalg.svd(self.jacobian * sd, full_matrices=True)
        information = np.zeros(len(sd))
        information[: len(values)] = values**2
        return np.sqrt(np.sum(rows**2 / (1.0 + information[:, None]), axis=0)) * sd


def bound(jacobian: Floats) -> Floats:
    """√diag (JᵀJ)⁻¹ by singular values, (P,); ∞ for components in the nullspace."""
    scale = np.linalg.norm(jacobian, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)  # normalises the columns, which have different units
    _, values, rows = np.linalg.svd(jacobian / scale, full_matrices=True)
    kept = np.zeros(jacobian.shape[1])
    kept[: len(values)] = values
    null = kept**2 <= NOTHING * max(kept[0] ** 2, 1e-300)
    open_share = np.sum(rows[null] ** 2, axis=0)
    inverse = np.where(null, 0.0, 1.0 / np.where(null, 1.0, kept))
    norms = np.sqrt(np.sum((rows * inverse[:, None]) ** 2, axis=0))
    return np.where(open_share > 1e-9, np.inf, norms / scale)


def campaign(unknowns: Unknowns, measured: Measurements) -> Campaign:
    """Derivatives of every measurement with respect to every unknown, in forward mode."""
    curve = measured.curve
    facets, size = len(unknowns.scenario.body.areas), len(unknowns.parameters)
    step = max(1, _TANGENTS // (facets * size))
    parts = [
        jacobian(unknowns, *(x[i : i + step] for x in (curve.t, curve.sun, curve.obs)))
        for i in range(0, curve.n_obs, step)
    ]
    return Campaign(unknowns, np.concatenate(parts) * flux_weight(measured)[:, None])


def flux_weight(measured: Measurements) -> Floats:
    """One over the standard deviation of the flux at unit distance, 1/m², (T,)."""
    sd = np.asarray(measured.curve.error)
    if measured.curve.kind == "mag":  # flux with the same relative error as the magnitude
        return MAGNITUDE_PER_NEPER / (measured.flux * sd)
    return measured.unit / sd


def jacobian(unknowns: Unknowns, t: Floats, sun: Floats, obs: Floats) -> Floats:
    """∂flux/∂θ at θ = 0, m² per unit, (T, P)."""
    zero = jnp.zeros(len(unknowns.parameters))
    return np.asarray(jax.jit(jax.jacfwd(unknowns.flux))(zero, *map(jnp.asarray, (t, sun, obs))))
