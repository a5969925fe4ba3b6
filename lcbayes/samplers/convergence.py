"""Convergence checks of chains, and the chain length required to pass them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from numpyro.diagnostics import effective_sample_size, gelman_rubin
from scipy.special import ndtri
from scipy.stats import rankdata

Floats = NDArray[np.float64]

# Limits of a converged run, after Vehtari et al. 2021, Bayesian Analysis 16, 667.
MAX_RHAT = 1.01
MIN_ESS = 400.0
MAX_DIVERGING = 0.005  # share of divergent transitions
MAX_RHAT_TO_CONTINUE = 1.2  # above this, longer chains are not expected to mix
MAX_RHAT_OF_FEW = 2.0  # the same where there are too few draws to tell
TOO_FEW = 0.25  # of the maximum length: the effective size and R-hat of fewer draws vary too much
# The check uses unconstrained coordinates; reported quantities may have a smaller ESS.
LENGTH_MARGIN = 1.2
TAILS = (0.11, 0.89)  # quantiles whose effective sample sizes are those of the tails, as in ArviZ
FEWEST = 4  # draws of a chain


class Diagnostics(NamedTuple):
    """R-hat and effective sample sizes, (...) each, of draws (C, S, ...).

    R-hat is rank-normalised and split; it is NaN for constants and for a single chain. Constants
    have as many effective draws as there are. All are NaN for fewer than four draws in a chain, or
    where one is not finite.
    """

    rhat: Floats
    bulk: Floats
    tail: Floats


def diagnostics(z: Floats) -> Diagnostics:
    """Convergence of each quantity.

    The definitions are those of ArviZ, which treats one quantity after the other: for hundreds of
    them it takes ten times as long.

    Parameters
    ----------
    z : (C, S, ...)
        Draws: chains, draws, quantities.

    References
    ----------
    Vehtari et al. 2021, Bayesian Analysis 16, 667.

    Examples
    --------
    >>> draws = np.random.default_rng(0).standard_normal((4, 500, 2))
    >>> bool(np.all(diagnostics(draws).rhat < 1.01))
    True
    """
    chains, n = z.shape[:2]
    valid = np.isfinite(z).all(axis=(0, 1)) & (n >= FEWEST)
    if not np.any(valid):
        nothing = np.full(z.shape[2:], np.nan)
        return Diagnostics(nothing, nothing, nothing)
    with np.errstate(invalid="ignore", divide="ignore"):
        halves = _split(z)
        ranked = _normalised(halves)
        folded = _normalised(np.abs(halves - np.median(halves, axis=(0, 1))))
        rhat = np.maximum(gelman_rubin(ranked), gelman_rubin(folded))
        below = (_split(z <= q) for q in np.quantile(z, TAILS, axis=(0, 1)))
        tail = np.minimum(*(_size(1.0 * each) for each in below))
        found = rhat if chains > 1 else np.full(z.shape[2:], np.nan), _size(ranked), tail
    return Diagnostics(*(np.where(valid, each, np.nan) for each in found))


def _split(z: NDArray) -> NDArray:
    """The halves of each chain, (2C, S // 2, ...)."""
    half = z.shape[1] // 2
    return np.concatenate([z[:, :half], z[:, -half:]])


def _normalised(z: Floats) -> Floats:
    """Normal quantiles of the ranks of the draws (C, S, ...)."""
    n = z.shape[0] * z.shape[1]
    rank = rankdata(z.reshape(n, -1), axis=0).reshape(z.shape)
    return ndtri((rank - 0.375) / (n + 0.25))


def _size(z: Floats) -> Floats:
    """Effective number of draws (C, S, ...), at most n log₁₀ n of n."""
    n = z.shape[0] * z.shape[1]
    size = n / np.maximum(n / effective_sample_size(z), 1.0 / np.log10(n))
    return np.where(np.ptp(z, axis=(0, 1)) > 0.0, size, float(n))


def rhat_and_ess(z: Floats) -> tuple[float, float]:
    """Largest R-hat and smallest effective sample size, bulk or tail, over the coordinates.

    They are NaN if those of all coordinates are, and fail every check.

    Parameters
    ----------
    z : (C, S, D)
        Draws: chains, draws, coordinates.
    """
    found = diagnostics(z)
    rhat = np.fmax.reduce(found.rhat, initial=np.nan)
    return float(rhat), float(np.fmin.reduce(np.fmin(found.bulk, found.tail), initial=np.nan))


def required_length(z: Floats, max_length: int, margin: float = LENGTH_MARGIN) -> int:
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
