"""How many points the points are worth: residuals that follow each other count less."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled

SIGNIFICANT = 3.0  # standard errors of a correlation: passed by chance once in 740 white curves


def of_residuals(residuals: NDArray, group: NDArray) -> float:
    """Information per point of a stationary sequence, at most 1: the inverse of its correlation
    time, 1/(1 + 2 Σ ρₖ).

    The sum runs over the lags k = 1, 2, … within groups as long as ρₖ exceeds 3 of its standard
    errors, √(τ/nₖ) with nₖ the pairs at lag k and τ the sum so far (Bartlett's formula); so it is 1
    for white residuals but once in some 700 times, and then near 1.

    Parameters
    ----------
    residuals : (T,)
        Standardised, in order of time within each group.
    group : (T,) int
        Groups, each in one piece.

    References
    ----------
    Sokal 1997, Monte Carlo methods in statistical mechanics, eq. (2.16), the sum cut where the
    terms are lost in the noise.
    """
    variance = np.mean(residuals**2)
    tau = 1.0
    for lag in range(1, residuals.size):
        same = group[lag:] == group[:-lag]
        n = int(same.sum())
        if n == 0:
            break
        rho = np.sum((residuals[lag:] * residuals[:-lag])[same]) / (n * variance)
        if not rho > SIGNIFICANT * np.sqrt(tau / n):
            break
        tau += 2.0 * rho
    return float(1.0 / tau)


def weighed(problem: Problem, z: NDArray, data: Epochs) -> Epochs:
    """The data, their likelihood to the power that their residuals at z warrant.

    No model is quite the body, and what it misses lasts longer than the time between two points.
    Taken as independent, N such points would claim √τ too narrow a posterior, and of two solutions
    would exclude one by odds to the power τ, τ their correlation time; the data's own residuals
    tell it.

    References
    ----------
    Miller & Dunson 2019, JASA 114, 1113 (posteriors robust to small errors of the model, as a
    power of the likelihood).
    """
    mean, sd = compiled(problem.moments)(jnp.asarray(z), data)
    residuals = np.asarray((data.brightness - mean) / sd)
    order = np.lexsort((np.asarray(data.t), np.asarray(data.curve)))
    found = of_residuals(residuals[order], np.asarray(data.curve)[order])
    return replace(data, information=jnp.asarray(found))
