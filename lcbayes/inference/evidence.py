"""How much posterior a solution holds: its share of the evidence, by bridge sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

Floats = NDArray[np.float64]


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
    """Evidence of the solution that ``draws`` explore.

    A Gaussian is fitted to one half of the draws and bridged to the other half,
    Z = E_q[p̃ h] / E_p[q h] with the optimal h ∝ 1/(s₁ p̃ + s₂ Z q), iterated to its fixed point.

    Parameters
    ----------
    draws : (C, S, D)
        Chains, in coordinates in which the solution is about a Gaussian.
    potential : callable
        (n, D) -> (n,) unnormalised −ln p in those coordinates.
    ess : float
        Independent draws that all of them together count as; enters the weights of the two halves
        of the optimal h, and the error.
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
    for _ in range(500):
        top = logsumexp(ratio_new - np.logaddexp(s1 + ratio_new, s2 + z)) - np.log(n_new)
        bottom = logsumexp(-np.logaddexp(s1 + ratio_use, s2 + z)) - np.log(len(use))
        z, last = top - bottom, z
        if abs(z - last) < 1e-10:
            break
    f_new = np.exp(ratio_new - np.logaddexp(s1 + ratio_new, s2 + z))
    f_use = np.exp(-np.logaddexp(s1 + ratio_use, s2 + z) + z)
    variance = np.var(f_new) / np.mean(f_new) ** 2 / n_new
    variance += np.var(f_use) / np.mean(f_use) ** 2 / max(n_use, 1.0)
    return LogEvidence(float(z), float(np.sqrt(variance)))
