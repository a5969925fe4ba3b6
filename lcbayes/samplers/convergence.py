"""Convergence checks of chains, and the chain length required to pass them."""

from __future__ import annotations

import warnings

import numpy as np
import xarray as xr
from numpy.typing import NDArray

# Limits of a converged run, after Vehtari et al. 2021, Bayesian Analysis 16, 667.
MAX_RHAT = 1.01
MIN_ESS = 400.0
MAX_DIVERGING = 0.005  # share of divergent transitions
MAX_RHAT_TO_CONTINUE = 1.2  # above this, longer chains are not expected to mix
MAX_RHAT_OF_FEW = 2.0  # the same where there are too few draws to tell
TOO_FEW = 0.25  # of the maximum length: the effective size and R-hat of fewer draws vary too much
# The check uses unconstrained coordinates; reported quantities may have a smaller ESS.
LENGTH_MARGIN = 1.2


def rhat_and_ess(z: NDArray[np.float64]) -> tuple[float, float]:
    """Largest R-hat and smallest effective sample size, bulk or tail, over the coordinates.

    Parameters
    ----------
    z : (C, S, D)
        Draws: chains, draws, coordinates.
    """
    import arviz as az

    data = xr.Dataset({"z": (("chain", "draw", "coordinate"), z)})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # constant draws give NaN, which fails every check
        rhat, bulk, tail = az.rhat(data), az.ess(data), az.ess(data, method="tail")
    return float(rhat["z"].max()), float(min(bulk["z"].min(), tail["z"].min()))


def required_length(z: NDArray[np.float64], max_length: int, margin: float = LENGTH_MARGIN) -> int:
    """Length at which chains are expected to reach `MIN_ESS` and `MAX_RHAT`.

    The effective sample size grows in proportion to the length and R-hat − 1 falls in proportion to
    it; the length is extrapolated from both, to between 4/3 and 2 times the present one.

    Parameters
    ----------
    z : (C, S, D)
    max_length : int
    margin : float
        Factor on the length, for quantities with a smaller ESS or a larger R-hat than ``z``.

    Returns
    -------
    int
        S if the chains have converged, if ``max_length`` would not suffice, or if R-hat exceeds
        `MAX_RHAT_TO_CONTINUE`. Chains with fewer than `TOO_FEW` of ``max_length`` are extended
        unless R-hat exceeds `MAX_RHAT_OF_FEW`.
    """
    n = z.shape[1]
    if n >= max_length or len(z) < 2 or not z.shape[2]:
        return n
    rhat, size = rhat_and_ess(z)
    if n < TOO_FEW * max_length:
        hopeful = rhat <= MAX_RHAT_OF_FEW  # false for NaN
    else:
        hopeful = rhat <= MAX_RHAT_TO_CONTINUE and size >= MIN_ESS * n / max_length
    if not hopeful:
        return n
    short = margin * max(MIN_ESS / size, (rhat - 1.0) / (MAX_RHAT - 1.0))
    if short <= 1.0:
        return n
    return min(max_length, int(np.ceil(n * min(max(short, 4 / 3), 2.0))))
