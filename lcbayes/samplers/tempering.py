"""From one step to the next: how far, what it adds to the evidence, and who goes on."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def log_sum(x: Floats) -> float:
    """ln Σ exp(x)."""
    return float(np.logaddexp.reduce(x))


def normalised(log_weights: Floats) -> Floats:
    """The same weights with a sum of one; NaN counts as no weight."""
    log_weights = np.where(np.isnan(log_weights), -np.inf, log_weights)
    return log_weights - log_sum(log_weights)


def effective_share(log_weights: Floats, log_change: Floats) -> float:
    """Conditional effective sample size over sample size, (Σ W w)²/Σ W w², in (0, 1].

    How unequal a change w makes particles of weights W, whatever these are.

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
    """(Σ W)²/Σ W², of particles with weights W."""
    return float(np.exp(2 * log_sum(log_weights) - log_sum(2 * log_weights)))


def next_step(
    log_weights: Floats,
    log_likelihood: Floats,
    powers: Callable[[float], Floats],
    s: float,
    share: float,
) -> float:
    """The s′ in (s, 1] at which the conditional effective share falls to ``share``, by bisection.

    Parameters
    ----------
    log_weights : (N,)
    log_likelihood : (N, K)
        Of each particle, in parts.
    powers
        s -> (K,), of the parts; rising.
    s : float
        Where the particles are.
    """
    here = powers(s)

    def left(new: float) -> float:
        return effective_share(log_weights, change(log_likelihood, powers(new) - here))

    if left(1.0) >= share:
        return 1.0
    low, high = 0.0, 1.0 - s  # of the step, whose scale is not known: halve its log
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
    """Σₖ bₖ ℓₖ (N,), of powers that rise by b (K,); a part that does not rise does not count."""
    return log_likelihood[:, by > 0] @ by[by > 0]


def systematic(log_weights: Floats, n: int, uniform: float) -> NDArray[np.int64]:
    """Indices (n,) of those that go on, each n W times to within one; in rising order.

    Children of one parent stay neighbours from one step to the next, and so do the members
    of a solution, all descending from the same few: a run of neighbours has its right number of
    children to within one, so that the weights of solutions do not drift by chance.

    References
    ----------
    Carpenter, Clifford & Fearnhead 1999, IEE Proc. Radar Sonar Navig. 146, 2.
    """
    edges = np.cumsum(np.exp(normalised(log_weights)))
    return np.searchsorted(edges / edges[-1], (np.arange(n) + uniform) / n, side="right")
