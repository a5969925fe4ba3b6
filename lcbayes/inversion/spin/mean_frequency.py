"""Mean synodic frequency of one pass, with an error valid for correlated noise and drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lcbayes.inversion.spin.detrended import Pass
from lcbayes.inversion.spin.periods import design

Floats = NDArray[np.float64]

DEGREE = 3  # of the phase polynomial: the synodic rate has its extremum at culmination
MAX_STEPS = 12
MAX_ORDER = 4  # of the autoregressive process
MAX_ABSORBED = 0.75  # largest fraction of the noise absorbed by the fit
CONVERGED = 1e-2  # largest final step, in standard errors


@dataclass(frozen=True)
class MeanFrequency:
    """Frequency of the modulation in one pass.

    Attributes
    ----------
    frequency, error : Hz
        Slope of the best-fitting straight line through the phase, in cycles per second, and its
        standard error. The error is NaN if the pass has too few points for the fit.
    drift, drift_error :
        Relative change of the local frequency from the first to the last point, from the quadratic
        term of the phase.
    """

    frequency: float
    error: float
    drift: float
    drift_error: float

    @property
    def period(self) -> float:
        """1/frequency, s."""
        return 1.0 / self.frequency

    @property
    def period_error(self) -> float:
        """Standard error of the period, s."""
        return self.error / self.frequency**2


def mean_frequency(one: Pass, start: float, harmonics: Sequence[int]) -> MeanFrequency:
    """Mean frequency of a pass along which the frequency may change.

    The model is y = a + b x + Σ_k (c_k cos kφ + s_k sin kφ) with
    φ = 2π f₀ t + Σ_{d=1..3} θ_d P_d(x) and P_d the Legendre polynomials of x = 2(t − t₀)/T − 1. It
    is fitted by Gauss-Newton. P₁ is orthogonal to the others, so f = f₀ + θ₁/(πT) is the slope of
    the phase for any drift. Low harmonics are fitted first. The variance takes the serial
    correlation of the residuals into account (`estimator_variance`); the size of the residuals need
    not be known.

    Parameters
    ----------
    start : Hz
        Within about half a resolution, 1/(2T), of the mean frequency.
    harmonics : of ``start`` that are present in the brightness

    References
    ----------
    Hannan 1973, J. Appl. Prob. 10, 510: frequency estimates under stationary noise. Brockwell &
    Davis 1991, *Time Series*, sec. 8.1 (Yule-Walker), 9.3 (Akaike's criterion).
    """
    t = one.t - 0.5 * (one.t[0] + one.t[-1])
    x = 2.0 * t / one.length
    polynomial = np.polynomial.legendre.legvander(x, DEGREE)[:, 1:]
    theta = np.zeros(DEGREE)
    empty = MeanFrequency(start, np.nan, np.nan, np.nan)
    orders = sorted({min(3, max(harmonics)), max(harmonics)})
    estimator, residual = np.zeros((DEGREE, t.size)), np.zeros(t.size)
    unknowns = 0
    for highest in orders:
        used = [k for k in harmonics if k <= highest] or list(harmonics)
        unknowns = 2 + 2 * len(used) + DEGREE
        if t.size < 2 * unknowns:
            return empty
        for _ in range(MAX_STEPS):
            phase = 2.0 * np.pi * start * t + polynomial @ theta
            step, estimator, residual = _step(one, x, phase, polynomial, used)
            theta = theta + np.clip(step, -0.5, 0.5)
            if np.all(
                np.abs(step) < CONVERGED * residual.std() * np.linalg.norm(estimator, axis=1)
            ):
                break
    error = np.sqrt(
        estimator_variance(estimator, residual, unknowns, 2.0 * one.length * start * max(harmonics))
    )
    to_hz = 1.0 / (np.pi * one.length)
    frequency = start + theta[0] * to_hz
    # dP₂/dx = 3x: the rate changes by 6 θ₂ · 2/T rad/s from one end to the other
    change = 6.0 * to_hz / frequency
    return MeanFrequency(
        float(frequency),
        float(error[0] * to_hz),
        float(theta[1] * change),
        float(error[1] * change),
    )


def _step(
    one: Pass, x: Floats, phase: Floats, polynomial: Floats, harmonics: Sequence[int]
) -> tuple[Floats, Floats, Floats]:
    """Gauss-Newton step of θ (D,), the linear estimator (D, T), weighted residuals (T,)."""
    k = np.repeat(np.asarray(harmonics, float), 2)
    waves = design(phase, harmonics)
    weight = 1.0 / one.error
    fixed = np.column_stack([np.ones_like(x), x, waves]) * weight[:, None]
    z = one.y * weight
    c, s = np.linalg.lstsq(fixed.T @ fixed, fixed.T @ z, rcond=1e-12)[0][2:].reshape(-1, 2).T
    crossed = np.stack([s, -c], axis=1).ravel()  # phase derivative of each pair
    slope = (waves @ (k * crossed)) * weight
    columns = np.hstack([fixed, slope[:, None] * polynomial])
    inverse = np.linalg.pinv(columns.T @ columns, rcond=1e-12, hermitian=True) @ columns.T
    solution = inverse @ z
    residual = z - columns @ solution
    degree = polynomial.shape[1]
    return solution[-degree:], inverse[-degree:], residual


def estimator_variance(estimator: Floats, residual: Floats, unknowns: int, band: float) -> Floats:
    """Variance of linear estimators (D, T) under the serial correlation of the residuals (T,).

    The variance is hᵀ Γ h. Γ_ij = γ(|i − j|) is the autocovariance of the autoregressive process of
    order 0 to 4 that best describes the residuals by Akaike's criterion (Yule-Walker). The fit
    absorbs part of the noise. For white noise this is ``unknowns`` of T degrees of freedom. For
    correlated noise it is ``unknowns`` of the ``band``, the degrees of freedom below the highest
    harmonic, which contain its power.
    """
    n = residual.size
    gamma = autocovariance(residual)
    freedom = min(float(n), band) if gamma[1] != 0.0 else float(n)
    gamma /= 1.0 - min(unknowns / freedom, MAX_ABSORBED)
    padded = np.fft.rfft(estimator, 2 * n, axis=1)
    products = np.fft.irfft(np.abs(padded) ** 2, 2 * n, axis=1)[:, :n]
    return products[:, 0] * gamma[0] + 2.0 * products[:, 1:] @ gamma[1:]


def autocovariance(residual: Floats) -> Floats:
    """Autocovariances γ(0) … γ(T − 1) of the autoregressive process fitted to a series, (T,)."""
    from scipy.linalg import solve_toeplitz

    n = residual.size
    raw = np.array([residual[: n - k] @ residual[k:] / n for k in range(MAX_ORDER + 1)])
    best, chosen = np.inf, np.zeros(0)
    for order in range(MAX_ORDER + 1):
        phi = solve_toeplitz(raw[:order], raw[1 : order + 1]) if order else np.zeros(0)
        innovation = raw[0] - phi @ raw[1 : order + 1]
        criterion = n * np.log(max(innovation, 1e-300)) + 2.0 * order
        if criterion < best:
            best, chosen = criterion, phi
    gamma = np.zeros(n)
    order = len(chosen)
    gamma[: order + 1] = raw[: order + 1]
    for k in range(order + 1, n):
        if not order:
            break
        gamma[k] = chosen @ gamma[k - order : k][::-1]
    return gamma
