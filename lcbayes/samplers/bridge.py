"""Evidence of a single solution by bridge sampling."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from scipy.special import logsumexp

Floats = NDArray[np.float64]
COMPONENTS = (1, 2, 4, 8)  # Gaussians of a mixture
BRIDGED = 5  # effective number of proposals that must overlap with the draws


class Mixture(NamedTuple):
    """A mixture of K Gaussians.

    Attributes
    ----------
    log_weight : (K,)
    mean : (K, D)
    root : (K, D, D)
        Cholesky factors of the covariances.
    """

    log_weight: Floats
    mean: Floats
    root: Floats

    @classmethod
    def of(cls, draws: Floats, rng: np.random.Generator) -> Mixture:
        """The mixture of 1, 2, 4 or 8 Gaussians that describes held-out draws (n, D) best.

        Components are clusters of the draws. The covariance of each is drawn towards their mean
        covariance with the weight of D draws, so that a small cluster has one too.
        """
        here, there = draws[::2], draws[1::2]
        fits = [
            cls._clusters(here, k, rng) for k in COMPONENTS if k * 4 * draws.shape[1] <= len(here)
        ]
        best = max(fits or [cls._clusters(here, 1, rng)], key=lambda q: q.log_density(there).mean())
        return cls._clusters(draws, len(best.log_weight), rng)

    @classmethod
    def _clusters(cls, draws: Floats, number: int, rng: np.random.Generator) -> Mixture:
        n, dim = draws.shape
        whole = np.cov(draws.T).reshape(dim, dim) + 1e-10 * np.eye(dim)
        white = np.linalg.solve(np.linalg.cholesky(whole), (draws - draws.mean(axis=0)).T).T
        label = np.zeros(n, int)
        if number > 1:
            _, label = kmeans2(white, number, minit="++", rng=rng)
        parts = [draws[label == k] for k in np.unique(label)]
        squares = [(p - p.mean(axis=0)).T @ (p - p.mean(axis=0)) for p in parts]
        within = sum(squares) / n
        covariance = [
            (square + dim * within) / (len(p) + dim)
            for p, square in zip(parts, squares, strict=True)
        ]
        root = np.linalg.cholesky(np.stack(covariance) + 1e-10 * np.eye(dim))
        log_weight = np.log([len(p) / n for p in parts])
        return cls(log_weight, np.stack([p.mean(axis=0) for p in parts]), root)

    def draws(self, n: int, rng: np.random.Generator) -> Floats:
        """n draws, (n, D)."""
        which = rng.choice(len(self.mean), n, p=np.exp(self.log_weight))
        noise = rng.standard_normal((n, self.mean.shape[1]))
        return self.mean[which] + np.einsum("nij,nj->ni", self.root[which], noise)

    def log_density(self, x: Floats) -> Floats:
        """ln q of each row (n, D)."""
        each = []
        for log_weight, mean, root in zip(*self, strict=True):
            w = np.linalg.solve(root, (x - mean).T)
            each.append(log_weight - 0.5 * np.sum(w**2, axis=0) - np.log(np.diag(root)).sum())
        return logsumexp(each, axis=0) - 0.5 * x.shape[1] * np.log(2 * np.pi)


class LogEvidence(NamedTuple):
    """ln ∫ exp(−U) over one solution, with its Monte-Carlo standard error."""

    value: float
    se: float


def bridge(
    draws: Floats,
    potential: Callable[[Floats], Floats],
    ess: float,
    rng: np.random.Generator,
    energies: Floats | None = None,
) -> LogEvidence:
    """Evidence of the solution sampled by ``draws``.

    A mixture of Gaussians q is fitted to one half of the draws. The bridge between q and the other
    half gives
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
    energies : (C, S), optional
        The potential of each draw, where it is known; otherwise it is computed.

    References
    ----------
    Meng & Wong 1996, Statistica Sinica 6, 831, eq. (4.1); error: Frühwirth-Schnatter 2004.
    """
    half = draws.shape[1] // 2
    dim = draws.shape[2]
    fit, use = draws[:, :half].reshape(-1, dim), draws[:, half:].reshape(-1, dim)
    q = Mixture.of(fit, rng)
    proposal = q.draws(len(use), rng)

    at_use = potential(use) if energies is None else energies[:, half:].ravel()
    log_p_use, log_p_new = -at_use, -potential(proposal)
    n_use = min(len(use), ess * len(use) / draws[..., 0].size)
    ratios = log_p_use - q.log_density(use), log_p_new - q.log_density(proposal)
    return log_ratio(*ratios, n_use, len(proposal))


def log_ratio(at_p: Floats, at_q: Floats, n_p: float, n_q: float) -> LogEvidence:
    """ln Z_p/Z_q of two densities p̃ and q̃ from ln p̃/q̃ at draws of each, with its error.

    Parameters
    ----------
    at_p, at_q : (n,), (m,)
        At draws of p and of q; −inf or NaN where p̃ vanishes, inf where q̃ does.
    n_p, n_q : float
        Effective numbers of these draws. They enter the weights of the optimal h and the error.
    """
    at_q = np.where(np.isfinite(at_q), at_q, -np.inf)
    s1, s2 = np.log(n_p / (n_p + n_q)), np.log(n_q / (n_p + n_q))
    within = at_p[np.isfinite(at_p)]
    if not within.size:
        return LogEvidence(0.0, np.inf)
    z = np.median(within)
    # Without overlap the bridge estimate is arbitrary. The fallback is the median of p̃/q̃ at the
    # draws of p, with the scatter of its logarithm as the error.
    apart = LogEvidence(float(z), max(1.0, float(np.std(within))))
    if not np.any(np.isfinite(at_q)):
        return apart
    for _ in range(500):
        top = logsumexp(at_q - np.logaddexp(s1 + at_q, s2 + z)) - np.log(len(at_q))
        bottom = logsumexp(-np.logaddexp(s1 + at_p, s2 + z)) - np.log(len(at_p))
        z, last = top - bottom, z
        if abs(z - last) < 1e-10:
            break
    variance_q = _relative_variance(at_q - np.logaddexp(s1 + at_q, s2 + z))
    variance_p = _relative_variance(-np.logaddexp(s1 + at_p, s2 + z))
    if BRIDGED * (variance_q + 1.0) > n_q:
        return apart
    return LogEvidence(float(z), float(np.sqrt(variance_q / n_q + variance_p / n_p)))


def _relative_variance(log_f: Floats) -> float:
    """Variance over squared mean of exp(log_f)."""
    once, twice = (np.logaddexp.reduce(k * log_f) for k in (1, 2))
    return len(log_f) * float(np.exp(twice - 2 * once)) - 1.0
