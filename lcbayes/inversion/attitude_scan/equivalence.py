"""The χ² limit up to which a solution fits as well as the best."""

from __future__ import annotations

from scipy import stats

from lcbayes.inversion.attitude_scan.result import AttitudeScan

WORSE = 1.05  # rms relative to the best that model errors alone may cause
MISSED = 0.05  # rate at which noise may exclude the true hypothesis


def limit(scan: AttitudeScan) -> float:
    """The χ² limit: the larger of 5 % larger residuals and the effect of noise alone.

    A fit of d superfluous parameters lowers χ² by an amount distributed as χ²_d, and the best of H
    hypotheses is selected. The χ² of the true hypothesis therefore exceeds that of the best by more
    than the quantile χ²_d(1 − 0.05/H) in at most 5 % of all data sets (Bonferroni). d is the
    largest number of parameters in any solution, because noise decides how many of the hundreds of
    facets are non-zero, and their positions are also free. If σ² is estimated from the residuals of
    the best fit, the quantile is d F_{d,dof}(1 − 0.05/H) χ²/dof.

    References
    ----------
    Meyer & Woodroofe 2000, Ann. Stat. 28, 1083 (degrees of freedom of fits with constraints).
    """
    least = scan.solutions[0].chi2
    d = max(max(s.n_fitted for s in scan.solutions), 1)
    rate = MISSED / scan.n_hypotheses
    if scan.error_known:
        by_noise = float(stats.chi2.isf(rate, d))
    else:
        by_noise = d * float(stats.f.isf(rate, d, scan.dof)) * least / scan.dof
    return max(WORSE**2 * least, least + by_noise)
