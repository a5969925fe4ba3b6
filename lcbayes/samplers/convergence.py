"""How many draws are enough, and whether more of them would be."""

from __future__ import annotations

import warnings

import numpy as np
import xarray as xr
from numpy.typing import NDArray

# What draws must be to be trusted, after Vehtari et al. 2021, Bayesian Analysis 16, 667.
MAX_RHAT = 1.01
MIN_ESS = 400.0
MAX_DIVERGING = 0.005  # share of the draws whose trajectories diverged
# Chains this far apart will not meet by going on.
APART = 1.1
# Judged are unconstrained coordinates, reported are others, which may be worth a little less.
MARGIN = 1.2


def worth(z: NDArray[np.float64]) -> tuple[float, float]:
    """Largest R-hat and smallest effective size, bulk or tail, of the coordinates of draws
    (C, S, D)."""
    import arviz as az

    data = xr.Dataset({"z": (("chain", "draw", "coordinate"), z)})
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # constant draws give NaN, with which nothing is hoped for
        rhat, bulk, tail = az.rhat(data), az.ess(data), az.ess(data, method="tail")
    return float(rhat["z"].max()), float(min(bulk["z"].min(), tail["z"].min()))


def wanted(z: NDArray[np.float64], most: int) -> int:
    """Length of the chains (C, S, D) at which they are likely to be worth `MIN_ESS` independent
    draws and to agree to `MAX_RHAT`.

    Effective size grows with length and R-hat − 1 falls with it, so that a bound of either says
    how far to go: a third more at least and as much again at most, since both are estimates. S
    where the draws are enough already, and where ``most`` would not do or the chains are apart:
    what is stuck costs no more.
    """
    n = z.shape[1]
    if n >= most or len(z) < 2:
        return n
    rhat, size = worth(z)
    if not (rhat <= APART and size >= MIN_ESS * n / most):  # nor where they are NaN
        return n
    short = MARGIN * max(MIN_ESS / size, (rhat - 1.0) / (MAX_RHAT - 1.0))
    if short <= 1.0:
        return n
    return min(most, int(np.ceil(n * min(max(short, 4 / 3), 2.0))))
