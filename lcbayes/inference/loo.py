"""Leave one epoch out: how well a model predicts an epoch from all others, and weights from it."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

ALIKE = 1e-9  # log weights that differ by less are the same but for rounding
BAD_K = 0.7  # Pareto k above which an epoch's value cannot be relied on


class Loo(NamedTuple):
    """Of each epoch, (T,)."""

    elpd: Floats  # ln p(y_i | the others)
    khat: Floats  # Pareto k; -inf where the importance weights are bounded


class Stacked(NamedTuple):
    """Of each model, in the order given."""

    weight: Floats  # of the mixture that predicts best
    diff: Floats  # elpd minus that of the best model
    diff_se: Floats


def loo(log_likelihood: Floats, power: float = 1.0) -> Loo:
    """PSIS-LOO of draws from a posterior whose likelihood is raised to ``power``.

    Without epoch i that posterior has lost the factor p(yᵢ|z)^power, so draws are weighed by
    p(yᵢ|z)^(−power), smoothed by a Pareto tail, and what they predict is p(yᵢ|z) itself.

    An epoch at which the body is dark has the same likelihood for all draws, or for all draws of
    the tail: there is nothing to smooth, and ArviZ raises an error. The weights are bounded then
    and are used as they are, which for a constant is exact: elpdᵢ is that constant.

    Parameters
    ----------
    log_likelihood : (S, T)
        ln p(yᵢ|z) of each draw, each point taken whole.
    power : float
        `Epochs.information` under which the draws were made.

    References
    ----------
    Vehtari, Gelman & Gabry 2017, Stat. Comput. 27, 1413; Vehtari et al. 2024, JMLR 25, 72.
    """
    from arviz_stats.base.array import array_stats

    ratio = -power * log_likelihood
    n = len(ratio)
    n_tail = int(np.ceil(min(0.2 * n, 3.0 * np.sqrt(n))))  # as ArviZ cuts it
    tail = np.sort(ratio, axis=0)[-n_tail:]
    bounded = tail[-1] - tail[0] < ALIKE
    log_weight, khat = ratio.copy(), np.full(ratio.shape[1], -np.inf)
    if not bounded.all():
        smooth, k = array_stats.psislw(-ratio[:, ~bounded], r_eff=1, axis=0)
        log_weight[:, ~bounded], khat[~bounded] = np.moveaxis(smooth, -1, 0), k
    log_weight -= np.logaddexp.reduce(log_weight, axis=0)
    return Loo(np.logaddexp.reduce(log_weight + log_likelihood, axis=0), khat)


def stacking(pointwise: Mapping[int, Loo]) -> Stacked:
    """Weights of the mixture of predictions that predicts left-out epochs best, through ArviZ.

    max over w of Σᵢ ln Σₖ wₖ exp(elpdₖᵢ). What is common to all models at an epoch changes neither
    the weights nor the differences, and is taken off first: ArviZ takes exponentials, which a point
    far out would make zero for every model.

    References
    ----------
    Yao, Vehtari, Simpson & Gelman 2018, Bayesian Analysis 13, 917, eq. (4).
    """
    import arviz as az
    import xarray as xr
    from arviz_stats.utils import ELPDData

    best = np.max([one.elpd for one in pointwise.values()], axis=0)
    given = {}
    for name, one in pointwise.items():
        elpd = xr.DataArray(one.elpd - best, dims="time")
        n = elpd.size
        given[str(name)] = ELPDData(
            elpd=float(elpd.sum()), se=float(np.sqrt(n * elpd.var())), p=np.nan, n_samples=0,
            n_data_points=n, scale="log", warning=False, good_k=BAD_K, elpd_i=elpd,
            pareto_k=xr.DataArray(one.khat, dims="time"),
        )  # fmt: skip
    if len(given) == 1:
        return Stacked(np.ones(1), np.zeros(1), np.zeros(1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of many models; the table says what there is to say
        table: Any = az.compare(given, method="stacking", round_to="none")
    columns = (
        table.loc[list(given), name].to_numpy(float) for name in ("weight", "elpd_diff", "dse")
    )
    return Stacked(*columns)
