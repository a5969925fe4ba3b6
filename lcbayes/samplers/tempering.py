"""Steps of the tempering schedule: step size, weights and resampling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def log_sum(x: Floats) -> float:
    """ln Σ exp(x)."""
    return float(np.logaddexp.reduce(x))


def normalised(log_weights: Floats) -> Floats:
    """Weights normalised to a sum of one; NaN counts as zero weight."""
    log_weights = np.where(np.isnan(log_weights), -np.inf, log_weights)
    return log_weights - log_sum(log_weights)


def effective_share(log_weights: Floats, log_change: Floats) -> float:
    """Conditional effective sample size over sample size, (Σ W w)²/Σ W w², in (0, 1].

    It measures how much the incremental weights w of particles with weights W vary.

    References
    ----------
    Zhou, Johansen & Aston 2016, J. Comput. Graph. Stat. 25, 701, eq. (3.16).
    """
    log_change = np.where(np.isnan(log_change), -np.inf, log_change)
    top = log_sum(log_weights + log_change)
    if not np.isfinite(top):
        return 0.0
    square = log_sum(log_weights + 2 * log_change)
    return float(np.exp(2 * top - log_sum(log_weights) - square))


def effective_number(log_weights: Floats) -> float:
    """Effective sample size (Σ W)²/Σ W² of particles with weights W."""
    return float(np.exp(2 * log_sum(log_weights) - log_sum(2 * log_weights)))


def next_step(
    log_weights: Floats,
    log_likelihood: Floats,
    powers: Callable[[float], Floats],
    s: float,
    share: float,
) -> float:
    """The s′ in (s, 1] at which `effective_share` falls to ``share``, by bisection.

    Parameters
    ----------
    log_weights : (N,)
    log_likelihood : (N, K)
        Of each particle, split into K parts.
    powers
        s -> (K,), the powers of the parts, which rise with s.
    s : float
        Current position of the particles.
    """
    here = powers(s)

    def left(new: float) -> float:
        return effective_share(log_weights, change(log_likelihood, powers(new) - here))

    if left(1.0) >= share:
        return 1.0
    # Limits of the step. Its scale is unknown, so the bisection is in its logarithm.
    low, high = 0.0, 1.0 - s
    for _ in range(200):
        middle = np.sqrt(low * high) if low > 0 else 0.01 * high
        if left(s + middle) < share:
            high = middle
        else:
            low = middle
        if low > 0 and high / low < 1.001:
            break
    return min(s + low, 1.0) if low > 0 else s


def change(log_likelihood: Floats, by: Floats) -> Floats:
    """Σₖ bₖ ℓₖ (N,) for powers that rise by b (K,); only parts with bₖ > 0 are included."""
    return log_likelihood[:, by > 0] @ by[by > 0]


def systematic(log_weights: Floats, n: int, uniform: float) -> NDArray[np.int64]:
    """Indices (n,) of the particles drawn by systematic resampling, in increasing order.

    A particle of weight W is drawn n W times, to within one. The offspring of a particle remain
    neighbours in later steps, as do the members of a solution, which descend from few particles.
    The number of offspring of any group of neighbours is also correct to within one, so that
    resampling adds little noise to the weights of solutions.

    References
    ----------
    Carpenter, Clifford & Fearnhead 1999, IEE Proc. Radar Sonar Navig. 146, 2.
    """
    edges = np.cumsum(np.exp(normalised(log_weights)))
    return np.searchsorted(edges / edges[-1], (np.arange(n) + uniform) / n, side="right")
