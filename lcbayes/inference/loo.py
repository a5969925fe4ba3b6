"""Leave-one-out cross-validation: predictive density of each epoch, and stacking weights."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LOG_WEIGHT_TOLERANCE = 1e-9  # smaller differences of log weights are rounding errors
MIN_TAIL = 5  # fewest draws to which a Pareto distribution can be fitted
NEGLIGIBLE_WEIGHT = 0.01  # share of the weight below which the shape of the tail is ignored
BAD_K = 0.7  # Pareto k above which an epoch's value is unreliable
FLAT = 1e-5  # nats; log weights of a stored tail that differ by less count as equal


class Loo(NamedTuple):
    """PSIS-LOO results for each epoch, (T,)."""

    elpd: Floats  # ln p(y_i | all other epochs)
    khat: Floats  # Pareto k; -inf if the weights have no tail, inf if k is unknown


class Stacked(NamedTuple):
    """Stacking results for each model, in the order given."""

    weight: Floats  # in the mixture with the best predictions
    diff: Floats  # elpd minus that of the best model
    diff_se: Floats


def loo(log_likelihood: Floats, power: float = 1.0) -> Loo:
    """PSIS-LOO from draws of a posterior whose likelihood is raised to ``power``.

    Leaving out epoch i removes the factor p(yᵢ|z)^power from that posterior. The draws are
    therefore weighted by p(yᵢ|z)^(−power), with the weights smoothed by a Pareto tail
    (`log_weights`). The predictive density is p(yᵢ|z) itself.

    Parameters
    ----------
    log_likelihood : (S, T)
        ln p(yᵢ|z) of each draw, with each point at full weight.
    power : float
        `Epochs.information` under which the draws were made.

    References
    ----------
    Vehtari, Gelman & Gabry 2017, Stat. Comput. 27, 1413; Vehtari et al. 2024, JMLR 25, 72.
    """
    log_weight, khat = log_weights(log_likelihood, power)
    return Loo(np.logaddexp.reduce(log_weight + log_likelihood, axis=0), khat)


def log_weights(log_likelihood: Floats, power: float = 1.0) -> tuple[Floats, Floats]:
    """ln of the importance weights (S, T) of the posterior without each epoch, and Pareto k (T,).

    The weights sum to one over the draws; k is as in `Loo`. The arguments are those of `loo`.

    An epoch at which the body is dark has the same likelihood for all draws, or for all draws of
    the tail. No smoothing is then possible, and ArviZ raises an error. The unsmoothed weights are
    used instead. For a constant likelihood this is exact: elpdᵢ is that constant. If the body is
    dark in so many draws that their weight reaches into the tail, only the draws with larger
    weights form the tail. If these are fewer than five, or repetitions of one draw (from a chain
    that does not move), k is unknown unless they hold less than 1 % of the weight.
    """
    ratio = -power * log_likelihood
    n_tail = _tail(len(ratio))
    ends = np.sort(ratio, axis=0)[-n_tail - 1 :]
    above = np.sum(ends[1:] > ends[0] + LOG_WEIGHT_TOLERANCE, axis=0)
    alike = ends[-1] - ends[1] < LOG_WEIGHT_TOLERANCE
    lowest = np.take_along_axis(ends, np.minimum(len(ends) - above, n_tail)[None], axis=0)[0]
    one = ends[-1] - lowest < LOG_WEIGHT_TOLERANCE
    log_weight, khat = ratio.copy(), np.where(alike, -np.inf, np.inf)
    for n in np.unique(above[~one & (above >= MIN_TAIL)]):
        here = ~one & (above == n)
        log_weight[:, here], khat[here] = _smoothed(ratio[:, here], int(n))
    log_weight -= np.logaddexp.reduce(log_weight, axis=0)
    scarce = ((above < MIN_TAIL) | (one & ~alike)) & (len(ratio) >= 5 * MIN_TAIL)
    held = np.sum(np.exp(log_weight), axis=0, where=ratio > ends[0] + LOG_WEIGHT_TOLERANCE)
    khat[scarce & (held < NEGLIGIBLE_WEIGHT)] = -np.inf
    return log_weight, khat


def without_tail(log_likelihood: Floats) -> NDArray[np.bool_]:
    """Epochs (T,) whose weights (S, T) `log_weights` does not smooth in the manner of ArviZ.

    These are mainly dark epochs: if the largest weights are all equal, ArviZ raises an error. Its
    tail is shorter for anti-correlated draws, down to half that of independent draws. Values are
    stored in single precision, so those that differ by less than `FLAT` count as equal.
    """
    ratio = -log_likelihood
    n_tail = _tail(len(ratio))
    ends = np.sort(ratio, axis=0)[-n_tail - 1 :]
    tied = np.any(ends[1:] <= ends[0] + LOG_WEIGHT_TOLERANCE, axis=0)
    return tied | (ends[-1] - ends[-max(1, n_tail // 2)] < FLAT)


def _tail(n_draws: int) -> int:
    """Number of draws in the tail used by ArviZ."""
    return int(3.0 * np.sqrt(n_draws)) if n_draws > 225 else n_draws // 5


def _smoothed(ratio: Floats, n_tail: int) -> tuple[Floats, Floats]:
    """Log weights (S, T) with a smoothed tail of ``n_tail`` draws, and Pareto k (T,)."""
    import arviz_stats  # registers the accessor azstats  # noqa: F401
    import xarray as xr

    n = len(ratio)
    log_ratio: Any = xr.DataArray(-ratio, dims=("draw", "time"))
    # ArviZ derives the tail length from the efficiency r: 3 √(S / r), rounded down
    efficiency: Any = 1.0 if n_tail == _tail(n) else 9.0 * n / (n_tail + 0.5) ** 2
    with np.errstate(all="ignore"):  # range of weights too large for a fit: k is NaN
        smooth, khat = log_ratio.azstats.psislw(dim="draw", r_eff=efficiency)
    smooth = smooth.transpose("draw", "time").to_numpy()
    khat = np.nan_to_num(khat.to_numpy().astype(float), nan=np.inf)
    bad = ~np.all(np.isfinite(smooth), axis=0)  # a tail whose width is below rounding
    return np.where(bad, ratio, smooth), np.where(bad, np.inf, khat)


def stacking(pointwise: Mapping[Any, Loo]) -> Stacked:
    """Stacking weights: the mixture of models that best predicts left-out epochs, by ArviZ.

    The weights w maximise Σᵢ ln Σₖ wₖ exp(elpdₖᵢ). A term common to all models at an epoch affects
    neither the weights nor the differences, and is subtracted first. Otherwise the exponentials in
    ArviZ would underflow to zero for every model at an outlier.

    References
    ----------
    Yao, Vehtari, Simpson & Gelman 2018, Bayesian Analysis 13, 917, eq. (4).
    """
    import arviz as az
    import xarray as xr
    from arviz_stats import ELPDData

    best = np.max([one.elpd for one in pointwise.values()], axis=0)
    given = {}
    for name, one in pointwise.items():
        elpd = xr.DataArray(one.elpd - best, dims="time")
        n = elpd.size
        given[str(name)] = ELPDData(
            elpd=float(elpd.sum()),
            se=float(np.sqrt(n * elpd.var())),
            p=np.nan,
            n_samples=0,
            n_data_points=n,
            scale="log",
            warning=False,
            good_k=BAD_K,
            elpd_i=elpd,
            pareto_k=xr.DataArray(one.khat, dims="time"),
        )
    if len(given) == 1:
        return Stacked(np.ones(1), np.zeros(1), np.zeros(1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # about the number of models; the table suffices
        table: Any = az.compare(given, method="stacking", round_to="none")
    columns = (
        table.loc[list(given), name].to_numpy(float) for name in ("weight", "elpd_diff", "dse")
    )
    return Stacked(*columns)
