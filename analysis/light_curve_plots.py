"""Plots of the light curve with its prediction, by night or pass and folded, and residuals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.numerals import date, duration
from lcbayes.analysis.style import DATA, FAINT, Gallery, Image, colour
from lcbayes.data.segments import Gap, split

Floats = NDArray[np.float64]
MOST_PANELS = 12
PANEL = Gap(1800.0, 30.0)  # between the panels of a figure
CONNECTED = Gap(0.0, 10.0)  # gap across which no band is drawn
SPARSE = 3600.0  # s; points farther apart are not connected
FARTHEST = 6.0  # σ; larger residuals are shown as arrows at the edge
BAND = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True)
class Segment:
    """Points of one curve and site without a long gap, such as a night or a pass."""

    points: NDArray[np.int64]
    curve: int
    site: str = ""


def segments(results: Results) -> list[Segment]:
    """Split the light curve by `curve`, site and long gaps; isolated points form one segment."""
    whole, panels = [], []
    sites = results.labels.get("site", np.full(results.t.size, ""))
    for c, site in sorted(set(zip(results.curve.tolist(), sites.tolist(), strict=True))):
        points = np.flatnonzero((results.curve == c) & (sites == site))
        whole.append(Segment(points, c, site))
        parts = split(results.t[points], np.zeros(points.size, int), PANEL)
        panels += [Segment(points[rows], c, site) for rows in parts]
    mean_size = results.t.size / len(panels)
    chosen = whole if len(panels) > len(whole) and mean_size < 5 else panels
    return sorted(chosen, key=lambda s: results.t[s.points[0]])


def bands(mode: Mode) -> Floats | None:
    """Quantiles `BAND` of the predicted brightness, (5, T); None if there are too few draws."""
    if len(mode.predicted) < 20:
        return None
    return np.quantile(mode.predicted, BAND, axis=0)


def sigmas(results: Results, best: Mode) -> Floats:
    """Standard deviation of each point: the error in the file, combined with inferred scatter and
    offsets per pass; without an error in the file, the inferred level; otherwise NaN.

    An inferred level is relative to the mean of the curve for fluxes
    (see `lcbayes.modelling.likelihood`).
    """
    sigma = results.error.copy()
    unknown = ~np.isfinite(sigma)
    unit = np.ones(sigma.size)
    if not results.is_magnitude:
        for c in np.unique(results.curve):
            here = results.curve == c
            unit[here] = np.mean(np.abs(results.brightness[here]))
    if "sigma" in best.draws and best.draws["sigma"].ndim == 2:
        level = np.full(sigma.size, float(best.draws["sigma"].mean()))
        if "noise" in best.draws:  # one level per curve
            level = best.draws["noise"].mean(("chain", "draw")).to_numpy()[results.curve]
        level = level * unit
        sigma = np.where(unknown, level, np.hypot(sigma, level))
    if "pass_sd" in best.draws:
        sigma = np.hypot(sigma, float(best.draws["pass_sd"].mean()) * unit)
    return sigma


def _time_unit(span: float) -> tuple[str, float]:
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if span >= 2.5 * size:
            return unit, size
    return "s", 1.0


def _label(results: Results) -> tuple[str, float]:
    """Label of the axis of brightness, and the power of ten factored out of its numbers."""
    if results.is_magnitude:
        return "magnitude", 1.0
    words, unit = "flux at unit distance", ""
    if "range_km" in results.constant:
        words, unit = "flux", "W/m²"
    elif results.is_relative:
        words = "relative flux"
    power = int(np.floor(np.log10(max(float(np.max(np.abs(results.brightness))), 1e-300))))
    if -2 <= power <= 3:
        return f"{words} ({unit})" if unit else words, 1.0
    return f"{words} (10$^{{{power}}}$ {unit})".replace(" )", ")"), 10.0**power


def runs(x: Floats) -> list[NDArray[np.int64]]:
    """Runs of indices without a gap, over which a continuous band may be drawn."""
    return split(x, np.zeros(x.size, int), CONNECTED)


def draw_panels(results: Results, gallery: Gallery) -> tuple[list[Image], str]:
    """One figure per segment, for at most the dozen most informative, and a note on the rest."""
    parts = segments(results)
    note = ""
    if len(parts) > MOST_PANELS:
        signal = [_signal(results, s) for s in parts]
        keep = sorted(np.argsort(signal)[::-1][:MOST_PANELS])
        note = (
            f"The {MOST_PANELS} most informative of {len(parts)} segments (many points, large "
            "variation) are shown; the table below lists all of them."
        )
        parts = [parts[i] for i in keep]
    big = len(parts) <= 2
    quantiles = [(m, bands(m)) for m in results.modes]
    sigma = sigmas(results, results.modes[0])
    images = []
    for number, part in enumerate(parts):
        figure = gallery.figure(*((5.4, 3.7) if big else (3.6, 2.7)))
        _draw_segment(figure, results, part, quantiles, sigma)
        epoch = results.attrs.get("epoch_jd")
        start = results.t[part.points[0]]
        when = f" from {date(epoch + start / 86400, clock=True)}" if epoch else ""
        alt = (
            f"Light curve {part.curve + 1}{when}: {part.points.size} observed points over the "
            "50 % and 90 % bands of the prediction, residuals below."
        )
        images.append(gallery.add(figure, f"light-curve-{number + 1:02d}", alt))
    return images, note


def _signal(results: Results, part: Segment) -> float:
    """Relative variation times the square root of the number of points."""
    y = results.brightness[part.points]
    scale = 1.0 if results.is_magnitude else max(abs(float(np.mean(y))), 1e-300)
    return float(np.sqrt(y.size) * np.std(y) / scale)


def _draw_segment(
    figure: Any,
    results: Results,
    part: Segment,
    quantiles: list[tuple[Mode, Floats | None]],
    sigma: Floats,
) -> None:
    """One segment with its predicted bands, and below it the residuals of the best solution."""
    grid = figure.add_gridspec(2, 1, height_ratios=(3, 1))
    top = figure.add_subplot(grid[0])
    at = part.points
    unit, size = _time_unit(float(np.ptp(results.t[at])))
    words, power = _label(results)
    x, y = (results.t[at] - results.t[at[0]]) / size, results.brightness[at] / power
    drawn = [(m, q[:, at] / power) for m, q in quantiles if q is not None]
    low = figure.add_subplot(grid[1], sharex=top) if drawn else None
    # there is no prediction between single points days apart
    sparse = at.size > 1 and float(np.median(np.diff(results.t[at]))) > SPARSE
    for rank, (mode, q) in enumerate(drawn):
        draw = _draw_band if rank == 0 else _draw_median
        draw(top, x, q, colour(mode.index), sparse)
    error = results.error[at] / power
    if np.isfinite(error).all():
        top.errorbar(x, y, error, fmt="none", ecolor=DATA, elinewidth=0.6, alpha=0.5)
    top.plot(x, y, "o", ms=2.6, color=DATA, zorder=4)
    top.set_ylabel(words)
    if results.is_magnitude:
        top.invert_yaxis()
    if low is not None:
        top.tick_params(labelbottom=False)
        best, q = drawn[0]
        _draw_segment_residuals(
            low, x, (y - q[2]) * power, sigma[at], colour(best.index), results.is_magnitude, power
        )
    top.set_title(_segment_title(results, part), loc="left")
    (low or top).set_xlabel(f"time ({unit}) from the first point")
    figure.align_ylabels()


def _draw_band(axes: Any, x: Floats, q: Floats, hue: str, sparse: bool) -> None:
    """The 50 % and 90 % intervals of the prediction: bars for sparse points, else bands."""
    if sparse:
        axes.vlines(x, q[0], q[4], color=hue, alpha=0.3, lw=3)
        axes.vlines(x, q[1], q[3], color=hue, alpha=0.5, lw=3)
        return
    for run in runs(x):
        axes.fill_between(x[run], q[0, run], q[4, run], color=hue, alpha=0.18, lw=0)
        axes.fill_between(x[run], q[1, run], q[3, run], color=hue, alpha=0.38, lw=0)


def _draw_median(axes: Any, x: Floats, q: Floats, hue: str, sparse: bool) -> None:
    """The median prediction of another solution."""
    if sparse:
        axes.plot(x, q[2], "_", color=hue, ms=6)
        return
    for run in runs(x):
        axes.plot(x[run], q[2, run], color=hue, lw=1.1, ls="--")


def _draw_segment_residuals(
    axes: Any,
    x: Floats,
    residual: Floats,
    sigma: Floats,
    hue: str,
    is_magnitude: bool,
    power: float,
) -> None:
    """Residuals, in units of ``sigma`` if known; arrows mark those outside the axes."""
    scaled = np.isfinite(sigma).all()
    residual = residual / (sigma if scaled else power)
    axes.axhline(0, color=FAINT, lw=0.7)
    if scaled:
        axes.axhspan(-1.645, 1.645, color=hue, alpha=0.14, lw=0)
        largest = float(np.clip(1.1 * np.max(np.abs(residual)), 3.2, FARTHEST))
        axes.set_ylim(-largest, largest)
        out = np.abs(residual) > largest
        up, down = ("v", "^") if is_magnitude else ("^", "v")
        for side, mark in ((residual > 0, up), (residual < 0, down)):
            edge = np.sign(residual) * 0.9 * largest
            axes.plot(x[out & side], edge[out & side], mark, ms=4, color="#b3391a")
        x, residual = x[~out], residual[~out]
    axes.plot(x, residual, "o", ms=2.4, color=DATA)
    axes.set_ylabel("resid. (σ)" if scaled else "residual")
    if is_magnitude:
        axes.invert_yaxis()


def _segment_title(results: Results, part: Segment) -> str:
    """Curve, site, date and number of points, where they distinguish segments."""
    title = f"{part.points.size} points"
    if epoch := results.attrs.get("epoch_jd"):
        title = f"{date(float(epoch) + float(results.t[part.points[0]]) / 86400)} · {title}"
    if part.site and np.unique(results.labels["site"]).size > 1:
        title = f"{part.site} · {title}"
    if np.unique(results.curve).size > 1:
        title = f"curve {part.curve + 1} · {title}"
    return title


def draw_folded(results: Results, gallery: Gallery) -> Image | None:
    """All points against rotational phase, each curve scaled to the same mean."""
    best = results.modes[0]
    if "period_h" not in best.draws or results.t.size < 50:
        return None
    period = float(best.draws["period_h"].mean()) * 3600
    if results.span_s < 10 * abs(period):
        return None
    y = results.brightness.copy()
    for c in np.unique(results.curve):
        here = results.curve == c
        if results.is_magnitude:
            y[here] -= np.mean(y[here])
        else:
            y[here] /= np.mean(y[here])
    figure = gallery.figure(5.4, 3.4)
    axes = figure.subplots()
    turns = results.t / period % 1.0
    dots = axes.scatter(turns, y, c=results.phase_angle_deg, s=5, cmap="viridis", rasterized=True)
    axes.set_xlim(0, 1)
    axes.set_xlabel("rotational phase (rotations)")
    axes.set_ylabel("magnitude − mean" if results.is_magnitude else "flux ÷ mean of its curve")
    if results.is_magnitude:
        axes.invert_yaxis()
    figure.colorbar(dots, ax=axes, label="phase angle (deg)", pad=0.02)
    return gallery.add(
        figure,
        "light-curve-folded",
        f"All {y.size} points against the rotational phase, coloured by phase angle.",
        f"All points folded with the period of {best.name.lower()}. Over "
        f"{duration(results.span_s)} the viewing geometry changed, so the curves need not "
        "coincide.",
    )


def draw_residuals(results: Results, gallery: Gallery) -> Image | None:
    """Residuals of all points against time."""
    best = results.modes[0]
    q = bands(best)
    if q is None or len(segments(results)) <= 2:
        return None
    sigma = sigmas(results, best)
    residual = results.brightness - q[2]
    scaled = np.isfinite(sigma).all()
    residual = residual / sigma if scaled else residual
    figure = gallery.figure(5.4, 3.4)
    axes = figure.subplots()
    epoch = results.attrs.get("epoch_jd")
    if epoch and results.span_s > 3 * 365.25 * 86400:
        x = 2000.0 + (float(epoch) + results.t / 86400 - 2451545.0) / 365.25
        axes.set_xlabel("year")
    else:
        unit, size = _time_unit(results.span_s)
        x = (results.t - results.t[0]) / size
        axes.set_xlabel(f"time ({unit}) from the first point")
    if scaled:
        axes.axhspan(-1.645, 1.645, color=colour(best.index), alpha=0.14, lw=0)
    axes.axhline(0, color=FAINT, lw=0.7)
    axes.plot(x, residual, "o", ms=2, color=DATA, alpha=0.6, rasterized=True)
    axes.set_ylabel("residual (σ)" if scaled else "residual")
    return gallery.add(
        figure,
        "residuals",
        "Residuals of all points against time.",
        f"Residuals from the median prediction of {best.name.lower()}"
        + ("; nine in ten points should lie in the shaded band." if scaled else "."),
    )
