"""Evidence of a single solution by bridge sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Floats = NDArray[np.float64]
BRIDGED = 5  # effective number of Gaussian proposals that must overlap with the draws


class LogEvidence(NamedTuple):
    """ln ∫ exp(−U) over one solution, with its Monte-Carlo standard error."""

    value: float
    se: float


def bridge(
    draws: Floats,
    potential: Callable[[Floats], Floats],
    ess: float,
    rng: np.random.Generator,
) -> LogEvidence:
    """Evidence of the solution sampled by ``draws``.

    A Gaussian q is fitted to one half of the draws. The bridge between q and the other half gives
    Z = E_q[p̃ h] / E_p[q h], with the optimal h ∝ 1/(s₁ p̃ + s₂ Z q) iterated to its fixed point.

    Parameters
    ----------
    draws : (C, S, D)
        Chains, in coordinates in which the solution is approximately Gaussian.
    potential : callable
        (n, D) -> (n,) unnormalised −ln p in those coordinates.
    ess : float
        Effective sample size of all draws. It enters the weights s₁ and s₂ of the optimal h and
        the error.
    rng : numpy Generator

    References
    ----------
    Meng & Wong 1996, Statistica Sinica 6, 831, eq. (4.1); error: Frühwirth-Schnatter 2004.
    """
    half = draws.shape[1] // 2
    dim = draws.shape[2]
    fit, use = draws[:, :half].reshape(-1, dim), draws[:, half:].reshape(-1, dim)
    mean, cov = fit.mean(axis=0), np.cov(fit.T).reshape(dim, dim) + 1e-10 * np.eye(dim)
    chol = np.linalg.cholesky(cov)
    proposal = mean + rng.standard_normal((len(use), dim)) @ chol.T

    def log_q(x: Floats) -> Floats:
        w = np.linalg.solve(chol, (x - mean).T)
        return -0.5 * np.sum(w**2, 0) - np.log(np.diag(chol)).sum() - 0.5 * dim * np.log(2 * np.pi)

    log_p_use, log_p_new = -potential(use), -potential(proposal)
    log_p_new = np.where(np.isfinite(log_p_new), log_p_new, -np.inf)
    ratio_use, ratio_new = log_p_use - log_q(use), log_p_new - log_q(proposal)
    n_use, n_new = min(len(use), ess * len(use) / draws[..., 0].size), len(proposal)
    s1, s2 = np.log(n_use / (n_use + n_new)), np.log(n_new / (n_use + n_new))
    z = np.median(ratio_use)
    # Without overlap of the Gaussian and the draws, the bridge estimate is arbitrary. The fallback
    # is the median of p̃/q at the draws, with the scatter of its logarithm as the error.
    apart = LogEvidence(float(z), max(1.0, float(np.std(ratio_use))))
    if not np.any(np.isfinite(ratio_new)):
        return apart
    for _ in range(500):
        top = logsumexp(ratio_new - np.logaddexp(s1 + ratio_new, s2 + z)) - np.log(n_new)
        bottom = logsumexp(-np.logaddexp(s1 + ratio_use, s2 + z)) - np.log(len(use))
        z, last = top - bottom, z
        if abs(z - last) < 1e-10:
            break
    variance_new = _relative_variance(ratio_new - np.logaddexp(s1 + ratio_new, s2 + z))
    variance_use = _relative_variance(-np.logaddexp(s1 + ratio_use, s2 + z))
    if BRIDGED * (variance_new + 1.0) > n_new:
        return apart
    return LogEvidence(float(z), float(np.sqrt(variance_new / n_new + variance_use / n_use)))


def _relative_variance(log_f: Floats) -> float:
    """Variance over squared mean of exp(log_f)."""
    once, twice = (np.logaddexp.reduce(k * log_f) for k in (1, 2))
    return len(log_f) * float(np.exp(twice - 2 * once)) - 1.0
