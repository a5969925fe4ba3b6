"""Up to which χ² a solution fits as well as the best."""

from __future__ import annotations

from scipy import stats

from lcbayes.inversion.attitude_scan.result import Found

WORSE = 1.05  # rms over that of the best up to which errors of the model may tell them apart
MISSED = 0.05  # rate at which noise may part the true hypothesis from the best


def limit(found: Found) -> float:
    """The larger of two: residuals 5 % above the best ones, and what noise alone may do to χ².

    A fit of d numbers that are not needed lowers χ² by χ²_d, and of H hypotheses the best is
    taken: the true one is above it by more than the quantile χ²_d(1 − 0.05/H) in at most 5 % of
    all data (Bonferroni). d is the most that any solution uses: how many facets of hundreds come
    out above zero is a matter of noise, and where they lie is free as well. With σ² taken from the
    residuals of the best fit, the quantile is d F_{d,dof}(1 − 0.05/H) χ²/dof.

    References
    ----------
    Meyer & Woodroofe 2000, Ann. Stat. 28, 1083 (degrees of freedom of fits with constraints).
    """
    least = found.solutions[0].chi2
    d = max(max(s.n_fitted for s in found.solutions), 1)
    rate = MISSED / found.n_hypotheses
    if found.error_known:
        by_noise = float(stats.chi2.isf(rate, d))
    else:
        by_noise = d * float(stats.f.isf(rate, d, found.dof)) * least / found.dof
    return max(WORSE**2 * least, least + by_noise)
