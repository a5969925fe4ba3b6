"""Correlation time of residuals, and the power likelihood that accounts for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled

SIGNIFICANT = 3.0  # standard errors of a correlation; exceeded by one white curve in 740


def information_per_point(residuals: NDArray, group: NDArray) -> float:
    """Information per point of a stationary sequence, 1/τ with correlation time τ = 1 + 2 Σ ρₖ.

    The sum runs over the lags k = 1, 2, … within groups while ρₖ exceeds three standard errors. The
    standard error is √(τ/nₖ), with nₖ the number of pairs at lag k and τ the current sum
    (Bartlett's formula). For white residuals the result is exactly 1, except in about one case in
    700, where it is close to 1.

    Parameters
    ----------
    residuals : (T,)
        Standardised, in time order within each group.
    group : (T,) int
        Group of each point; each group is contiguous.

    References
    ----------
    Sokal 1997, Monte Carlo methods in statistical mechanics, eq. (2.16), with the sum
    truncated where the terms fall below the noise.
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


class Autocorrelation(NamedTuple):
    """Autocorrelation ``rho`` (K,) at lags within groups, with the numbers of ``pairs``."""

    rho: NDArray
    pairs: NDArray


def autocorrelation(
    residuals: NDArray, groups: Sequence[NDArray], lags: NDArray
) -> Autocorrelation:
    """Autocorrelation of residuals (T,) within groups of rows in order of time.

    A lag is a number of points.
    """
    rho, pairs = np.zeros(lags.size), np.zeros(lags.size)
    for i, lag in enumerate(lags):
        for rows in groups:
            if rows.size > lag:
                rho[i] += np.sum(residuals[rows[lag:]] * residuals[rows[:-lag]])
                pairs[i] += rows.size - lag
    return Autocorrelation(rho / np.maximum(pairs, 1) / np.mean(residuals**2), pairs)


def tempered(problem: Problem, z: NDArray, data: Epochs) -> Epochs:
    """The data with their likelihood raised to the power 1/τ, with τ the correlation time at z.

    Model errors are correlated over times longer than the sampling interval. If the points were
    treated as independent, the posterior would be too narrow by √τ, and the odds of two solutions
    would be raised to the power τ. τ is estimated from the residuals at z
    (`information_per_point`).

    References
    ----------
    Miller & Dunson 2019, JASA 114, 1113 (posteriors made robust to small model errors by a
    power likelihood).
    """
    mean, sd = compiled(problem.moments)(jnp.asarray(z), data)
    residuals = np.asarray((data.brightness - mean) / sd)
    order = np.lexsort((np.asarray(data.t), np.asarray(data.curve)))
    information = information_per_point(residuals[order], np.asarray(data.curve)[order])
    return replace(data, information=jnp.asarray(information))
