"""Equally weighted draws of a posterior whose chains belong to solutions of unequal weight."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import NDArray

LOG_LIKELIHOOD, DARK, DARK_TIME = "log_likelihood", "log_likelihood_dark", "dark_time"
ALIGNED = ("posterior", "sample_stats", LOG_LIKELIHOOD, DARK, "log_prior", "posterior_predictive")


def weighted_draws[Drawn: (xr.Dataset, xr.DataTree)](
    source: Drawn, n: int | None = None, seed: int = 0
) -> Drawn:
    """Equally weighted draws of a posterior.

    The group ``posterior`` of a fit holds the chains of every solution as they were sampled. Its
    coordinate ``weight`` (chain) is the share of the posterior that each chain represents, so a
    plain mean over ``posterior`` is wrong if there are several solutions. Here solution k
    contributes round(n wₖ) draws, taken evenly from its own chains.

    Parameters
    ----------
    source : xarray.DataTree or xarray.Dataset
        ``posterior.nc`` (or `lcbayes.Fit.tree`), or its group ``posterior``.
    n : int, optional
        Number of draws. Default: all draws of a single solution; for several solutions, the
        number of draws of the one with most chains.
    seed : int
        Seed of the random order in which the draws of several solutions are mixed.

    Returns
    -------
    xarray.DataTree or xarray.Dataset
        As ``source``, with one chain of n draws and the coordinate ``solution`` (draw). In a tree
        the same draws are taken from every group with a row for each draw, so ``az.loo`` applies
        to the whole posterior. One chain has no R-hat: assess convergence on ``source``.

    Examples
    --------
    >>> import lcbayes, numpy as np, xarray as xr
    >>> chains = xr.Dataset(
    ...     {"period": (("chain", "draw"), np.repeat([[5.0], [7.0]], 100, axis=1))},
    ...     coords={"solution": ("chain", [0, 1]), "weight": ("chain", [0.75, 0.25])},
    ... )
    >>> lcbayes.weighted_draws(chains)["period"].mean().item()
    5.5
    """
    if isinstance(source, xr.DataTree):
        posterior = source["posterior"].to_dataset()
        rows = weighted_rows(posterior, n, seed)
        kept = {k: node.to_dataset() for k, node in source.children.items() if k != "modes"}
        picked = {
            k: _picked(v, rows, posterior.sizes["draw"]) if k in ALIGNED else v
            for k, v in kept.items()
        }
        return xr.DataTree.from_dict({"/": xr.Dataset(attrs=source.attrs), **picked})
    return _picked(source, weighted_rows(source, n, seed), source.sizes["draw"])


def weighted_rows(posterior: xr.Dataset, n: int | None = None, seed: int = 0) -> NDArray[np.int64]:
    """Indices of the selected draws among those of all chains, concatenated, (n,)."""
    chains, draws = posterior.sizes["chain"], posterior.sizes["draw"]
    every = np.arange(chains * draws).reshape(chains, draws)
    solution = posterior.coords.get("solution", np.zeros(chains, int))
    label, index, count = np.unique(np.asarray(solution), return_inverse=True, return_counts=True)
    if len(label) == 1:
        return every.ravel() if n is None else _evenly(every.ravel(), n)
    total = int(count.max()) * draws if n is None else n
    upto = np.cumsum(np.bincount(index, np.asarray(posterior.coords["weight"])))
    counts = np.diff(np.round(upto / upto[-1] * total).astype(int), prepend=0)
    parts = [_evenly(every[index == k].ravel(), m) for k, m in enumerate(counts)]
    return np.random.default_rng(seed).permutation(np.concatenate(parts))


def _evenly(rows: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    return rows[np.linspace(0, len(rows) - 1, n).round().astype(int)]


def _picked(group: xr.Dataset, rows: NDArray[np.int64], draws: int) -> xr.Dataset:
    """The given rows of every variable that has chains and draws, as one chain."""
    names = [k for k, v in group.data_vars.items() if {"chain", "draw"} <= set(v.dims)]
    at = {"chain": xr.DataArray(rows // draws, dims="draw")}
    at["draw"] = xr.DataArray(rows % draws, dims="draw")
    picked = group[names].load().isel(at).drop_vars(("chain", "draw", "weight"), errors="ignore")
    picked = picked.expand_dims(chain=[0]).assign_coords(draw=np.arange(len(rows)))
    others = group.drop_vars([*names, "chain", "draw", "solution", "weight"], errors="ignore")
    return others.merge(picked, combine_attrs="override")


def pointwise(tree: xr.DataTree) -> xr.DataArray:
    """ln p(yᵢ|z) of every epoch, including dark ones, (chain, draw, time) in the curve's order."""
    lit = tree[LOG_LIKELIHOOD].to_dataset()["brightness"]
    if DARK not in tree:
        return lit.transpose("chain", "draw", "time")
    dark = tree[DARK].to_dataset()["brightness"].rename({DARK_TIME: "time"})
    whole = xr.concat([lit, dark], "time", coords="minimal", compat="override", join="override")
    return whole.sortby("time").transpose("chain", "draw", "time")
