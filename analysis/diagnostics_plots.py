"""Diagnostic plots of the sampler and the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.quantities import Quantity, readable
from lcbayes.analysis.style import DATA, FAINT, Gallery, Image, colour
from lcbayes.inference.loo import BAD_K, log_weights

Floats = NDArray[np.float64]
DOTS = 500


def _drawn(q: Quantity, between: str = " ") -> tuple[Floats, str]:
    """Values scaled so that axis numbers are short, and the matching label."""
    centre, size, shift = readable(q)
    return (q.values - centre) / size, f"{_short(q.name)}{between}{shift}".strip()


def _short(name: str) -> str:
    """A short name for a small plot: α[0], ω_x, pole lon."""
    if name.startswith("omega_"):
        return f"ω_{name[6]}"
    for long, symbol in (("albedo_area", "α"), ("phi", "φ")):
        if name.startswith(long + "["):
            return symbol + name[len(long) :]
    names = {"pole_lon_deg": "pole lon", "pole_lat_deg": "pole lat", "period_h": "period"}
    return names.get(name, name)


def _sparse_ticks(axes: Any, which: str = "both", count: int = 3) -> None:
    from matplotlib.ticker import MaxNLocator

    for name in ("x", "y") if which == "both" else (which,):
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(count, prune="both"))


def draw_traces(mode: Mode, selected: list[Quantity], gallery: Gallery) -> Image | None:
    """Trace of each chain, and histograms of the ranks of its draws among those of all chains."""
    from scipy.stats import rankdata

    if not selected:
        return None
    chains, draws = selected[0].values.shape
    figure = gallery.figure(5.4, 0.5 + 0.82 * len(selected))
    grid = figure.subplots(len(selected), 2, squeeze=False, width_ratios=(1.5, 1))
    bins = 20
    step = max(1, draws // 500)
    for (left, right), q in zip(grid, selected, strict=True):
        values, label = _drawn(q)
        ranks = rankdata(values).reshape(chains, draws)
        edges = np.linspace(0, chains * draws, bins + 1)
        top = 2.0
        for c in range(chains):
            hue = colour(c)
            left.plot(
                np.arange(0, draws, step),
                values[c, ::step],
                color=hue,
                lw=0.5,
                alpha=0.8,
                rasterized=True,
            )
            counts = np.histogram(ranks[c], edges)[0] * bins / draws
            right.stairs(counts, edges / edges[-1], color=hue, lw=1.0, baseline=None)
            top = max(top, float(counts.max()))
        right.axhline(1, color=FAINT, lw=0.7, ls="--")
        right.set_ylim(0, 1.1 * top)
        right.set_yticks([0, 1])
        left.set_title(label, loc="left", fontsize=8.5, pad=3)
        _sparse_ticks(left, "y")
        left.set_xlim(0, draws)
        right.set_xlim(0, 1)
        if q is not selected[-1]:
            left.set_xticks([])
            right.set_xticks([])
    grid[-1, 0].set_xlabel("draw")
    grid[-1, 1].set_xlabel("rank among all draws (0 to 1)")
    return gallery.add(
        figure,
        f"traces-{mode.index + 1}",
        f"Trace and rank plots of {len(selected)} parameters, one colour per chain.",
        "Left: the draws in the order they were made, one colour per chain; they should look like "
        "the same noise. Right: how high each chain's draws rank among all; flat lines near 1 mean "
        "that all chains sampled the same distribution.",
    )


def draw_energy(mode: Mode, gallery: Gallery) -> Image | None:
    """Distributions of the energy and of its change between draws, and E-BFMI."""
    if "energy" not in mode.stats:
        return None
    energy = mode.stats["energy"].transpose("chain", "draw").to_numpy().astype(float)
    if energy.shape[1] < 10 or not np.isfinite(energy).all() or np.ptp(energy) == 0:
        return None
    change = np.diff(energy, axis=1)
    bfmi = np.mean(change**2, axis=1) / np.maximum(np.var(energy, axis=1, ddof=1), 1e-300)
    figure = gallery.figure(5.4, 2.9)
    axes = figure.subplots()
    centred = (energy - energy.mean()).ravel()
    low, high = np.quantile(np.concatenate([centred, change.ravel()]), (0.001, 0.999))
    edges = np.linspace(low, high, 50)
    for values, hue, label in (
        (centred, colour(0), "energy − its mean"),
        (change.ravel(), colour(1), "change from draw to draw"),
    ):
        axes.hist(values, edges, density=True, histtype="stepfilled", color=hue, alpha=0.4)
        axes.hist(values, edges, density=True, histtype="step", color=hue, label=label)
    axes.set_xlabel("energy (nats)")
    axes.set_ylabel("density")
    figure.legend(loc="outside upper left", ncols=2)
    least = float(bfmi.min())
    verdict = "which is fine" if least >= 0.3 else "too low: tails of the posterior may be missed"
    return gallery.add(
        figure,
        f"energy-{mode.index + 1}",
        "Histograms of the energy of the draws and of its change from one to the next.",
        "The two outlines should have about the same width, else the sampler moves too slowly "
        f"through the posterior. Smallest E-BFMI over the chains: {least:.2f}, {verdict} "
        "(0.3 is the usual limit).",
    )


def draw_pairs(mode: Mode, selected: list[Quantity], gallery: Gallery) -> Image | None:
    """Each selected parameter against every other; divergent draws are marked."""
    if len(selected) < 2:
        return None
    n = len(selected)
    bad = np.zeros(selected[0].values.size, bool)
    if "diverging" in mode.stats and mode.stats["diverging"].size == bad.size:
        bad = mode.stats["diverging"].transpose("chain", "draw").to_numpy().astype(bool).ravel()
    shown = [_drawn(q, "\n") for q in selected]
    values, labels = np.stack([v.ravel() for v, _ in shown]), [label for _, label in shown]
    step = max(1, values.shape[1] // DOTS)
    margin = 0.06 * np.ptp(values, axis=1)
    limits = np.stack([values.min(axis=1) - margin, values.max(axis=1) + margin], axis=1)
    figure = gallery.figure(0.7 + 0.82 * n, 0.6 + 0.78 * n)
    grid = figure.add_gridspec(n, n)
    hue = colour(mode.index)
    lower = [(row, col) for row in range(n) for col in range(row + 1)]
    for row, col in lower:
        axes = figure.add_subplot(grid[row, col])
        axes.tick_params(labelsize=7)
        if col == row:
            axes.hist(values[row], bins=30, color=hue, alpha=0.75, histtype="stepfilled")
            axes.spines["left"].set_visible(False)
        else:
            across, upward = values[col, ::step], values[row, ::step]
            axes.plot(across, upward, ".", ms=2, color=hue, alpha=0.35, mew=0, rasterized=True)
            axes.plot(values[col, bad], values[row, bad], "x", ms=3.5, mew=0.8, color="k")
            axes.set_ylim(*limits[row])
        axes.set_xlim(*limits[col])
        if row == n - 1:  # only the outer edges have numbers
            axes.set_xlabel(labels[col], fontsize=7)
            _sparse_ticks(axes, "x", 2)
        else:
            axes.set_xticks([])
        if col == 0 and row > 0:
            axes.set_ylabel(labels[row], fontsize=7)
            _sparse_ticks(axes, "y", 3)
        else:
            axes.set_yticks([])
    tail = " Black crosses are divergent draws." if bad.any() else ""
    return gallery.add(
        figure,
        f"pairs-{mode.index + 1}",
        f"Pair plot of {n} parameters.",
        "The most important parameters two by two: a slanted or bent cloud means that the data fix "
        f"a combination better than either alone.{tail}",
    )


@dataclass(frozen=True)
class Pit:
    """LOO-PIT values; ``dark`` is the number of epochs with the same likelihood in every draw."""

    values: Floats
    dark: int
    unreliable: int


def loo_pit(results: Results) -> Pit | None:
    """Leave-one-out probability that each point is at or below its observed value.

    The weights are those of `lcbayes.inference.loo`, for the power of the likelihood in the
    posterior.
    """
    import arviz

    if results.log_likelihood is None or results.predicted is None:
        return None
    log_lik = results.log_likelihood.transpose("time", "chain", "draw").astype(float)
    predicted = results.predicted.transpose("time", "chain", "draw")
    finite = np.isfinite(log_lik.to_numpy()).all(axis=(1, 2))
    log_lik, predicted = log_lik.isel(time=finite), predicted.isel(time=finite)
    if log_lik.sizes["chain"] * log_lik.sizes["draw"] < 100 or not finite.any():
        return None
    power = (results.summary.get("fit") or {}).get("information_per_point", 1.0)
    flat = log_lik.to_numpy().reshape(len(log_lik), -1)
    weights, khat = log_weights(flat.T, power)
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset({"unused": log_lik.isel(time=0, drop=True)}),
            "observed_data": xr.Dataset({"brightness": ("time", results.brightness[finite])}),
            "posterior_predictive": xr.Dataset({"brightness": predicted}),
            "log_likelihood": xr.Dataset({"brightness": log_lik}),
        }
    )
    pit = arviz.loo_pit(
        tree,
        log_weights=xr.Dataset({"brightness": log_lik.copy(data=weights.T.reshape(log_lik.shape))}),
        pareto_k=xr.Dataset({"brightness": ("time", khat)}),
    )
    dark = np.ptp(log_lik.to_numpy(), axis=(1, 2)) < 1e-9
    values = np.clip(pit["brightness"].to_numpy(), 0.0, 1.0)
    return Pit(values, int(dark.sum()), int(np.sum(khat > BAD_K)))


def draw_loo_pit(results: Results, gallery: Gallery) -> Image | None:
    """Fraction of points below each predicted probability, minus that probability."""
    from scipy.stats import kstwo

    pit = loo_pit(results)
    if pit is None or pit.values.size < 10:
        return None
    ordered = np.sort(pit.values)
    n = ordered.size
    limit = float(kstwo.ppf(0.95, n))
    x = np.concatenate([[0.0], np.repeat(ordered, 2), [1.0]])
    y = np.concatenate([[0.0], np.repeat(np.arange(n + 1) / n, 2)[1:-1], [1.0]]) - x
    figure = gallery.figure(5.4, 2.9)
    axes = figure.subplots()
    axes.fill_between([0, 1], -limit, limit, color=colour(0), alpha=0.15, lw=0, label="95 % band")
    axes.axhline(0, color=FAINT, lw=0.7)
    axes.plot(x, y, color=DATA, lw=1.1, label="observed − expected share")
    axes.set_xlim(0, 1)
    axes.set_xlabel(
        "predicted probability of a fainter value"
        if not results.is_magnitude
        else "predicted probability of a brighter value"
    )
    axes.set_ylabel("difference of shares")
    figure.legend(loc="outside upper left", ncols=2)
    inside = float(np.max(np.abs(y))) <= limit
    caption = (
        "Each point is predicted from all the others; if the predictions are as sure as they "
        "should be, the line stays inside the band. "
        + ("It does. " if inside else "It leaves the band: errors, noise model or model are off. ")
    )
    if pit.dark:
        are = "point is" if pit.dark == 1 else "points are"
        caption += f"{pit.dark} {are} dark in every draw: leaving them out changes nothing. "
    if pit.unreliable:
        points = "point" if pit.unreliable == 1 else "points"
        caption += f"For {pit.unreliable} {points} the estimate is unreliable "
        caption += f"(Pareto k above {BAD_K})."
    return gallery.add(
        figure, "loo-pit", "LOO-PIT: calibration of the predictions.", caption.strip()
    )
