"""Plots of the light curve with its prediction, by night or pass and folded, and residuals."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.numerals import SUPERSCRIPT, duration
from lcbayes.analysis.style import DATA, FAINT, Gallery, Image, colour
from lcbayes.core.constants import HOUR_S
from lcbayes.data.segments import Gap, Rows, split
from lcbayes.geometry.times import date
from lcbayes.inversion.spin import periods
from lcbayes.inversion.spin.candidates import within
from lcbayes.inversion.spin.detrended import Pass

Floats = NDArray[np.float64]
MOST_PANELS = 12
LARGE = 4  # panels that are drawn across the page
PANEL = Gap(1800.0, 30.0)  # between the panels of a figure
CONNECTED = Gap(0.0, 10.0)  # gap across which no band is drawn
SPARSE = 3600.0  # s; points farther apart are not connected
MANY = 400  # points of a panel above which they are pixels: as paths they would fill megabytes
FEWEST_FOLDED = 50  # points
FEWEST_OF_PASS = 20  # points of a pass in the periodogram of residuals
PERIODOGRAM = 4e6  # points × frequencies of that periodogram
FARTHEST = 6.0  # σ; larger residuals are shown as arrows at the edge
BAND = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True)
class Segment:
    """Points of one curve and site without a long gap, such as a night or a pass."""

    points: Rows
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


def plain_label(results: Results) -> tuple[str, float]:
    """The label of the axis of brightness without mathematical markup, and its power of ten."""
    text, power = _label(results)
    if power == 1.0:
        return text, power
    digits = str(int(np.log10(power))).translate(SUPERSCRIPT)
    return re.sub(r"10\$\^\{.*?\}\$", f"10{digits}", text), power


def runs(x: Floats) -> list[Rows]:
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
    large = len(parts) <= LARGE
    quantiles = [(m, bands(m)) for m in results.modes]
    sigma = sigmas(results, results.modes[0])
    images = []
    for number, part in enumerate(parts):
        figure = gallery.figure(*((10.0, 4.0) if large else (5.4, 3.2)))
        _draw_segment(figure, results, part, quantiles, sigma)
        alt = (
            f"{segment_title(results, part)}: observed brightness over the 50 % and 90 % bands of "
            "the prediction, residuals below."
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
    many = at.size > MANY
    # there is no prediction between single points days apart
    sparse = at.size > 1 and float(np.median(np.diff(results.t[at]))) > SPARSE
    for rank, (mode, q) in enumerate(drawn):
        draw = _draw_band if rank == 0 else _draw_median
        draw(top, x, q, colour(mode.index), sparse)
    error = results.error[at] / power
    if np.isfinite(error).all():
        bars = {"fmt": "none", "ecolor": DATA, "elinewidth": 0.6, "alpha": 0.2 if many else 0.5}
        top.errorbar(x, y, error, **bars, rasterized=many)
    dots = {"ms": 1.2, "alpha": 0.6} if many else {"ms": 2.6}
    top.plot(x, y, "o", **dots, mew=0, color=DATA, zorder=4, rasterized=many)
    top.set_ylabel(words)
    if results.is_magnitude:
        top.invert_yaxis()
    if low is not None:
        top.tick_params(labelbottom=False)
        best, q = drawn[0]
        _draw_segment_residuals(
            low, x, (y - q[2]) * power, sigma[at], colour(best.index), results.is_magnitude, power
        )
    top.set_title(segment_title(results, part), loc="left")
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
    many = x.size > MANY
    axes.plot(x, residual, "o", ms=1.2 if many else 2.4, color=DATA, mew=0, rasterized=many)
    axes.set_ylabel("resid. (σ)" if scaled else "residual")
    if is_magnitude:
        axes.invert_yaxis()


def segment_title(results: Results, part: Segment) -> str:
    """Curve, site, date and number of points, where they distinguish segments."""
    title = f"{part.points.size} points"
    if epoch := results.attrs.get("epoch_jd"):
        title = f"{date(float(epoch) + float(results.t[part.points[0]]) / 86400)} · {title}"
    if part.site and np.unique(results.labels["site"]).size > 1:
        title = f"{part.site} · {title}"
    if np.unique(results.curve).size > 1:
        title = f"{results.labels['curve'][part.points[0]]} · {title}"
    return title


def rotation_period(mode: Mode) -> tuple[float, float] | None:
    """Rotation period of a solution and its standard deviation, s; None without one rotation."""
    if "period_h" in mode.draws:
        values = HOUR_S * mode.draws["period_h"].to_numpy()
    elif "omega" in mode.draws and "inertia_ratio" not in mode.draws:
        omega = mode.draws["omega"].transpose("chain", "draw", ...).to_numpy()
        values = 2 * np.pi / np.maximum(np.linalg.norm(omega, axis=-1), 1e-300)
    else:
        return None
    return float(np.mean(values)), float(np.std(values))


def draw_folded(results: Results, gallery: Gallery) -> Image | None:
    """All points against rotational phase, each curve scaled to the same mean.

    A period is folded only if there are at least three rotations whose phases are known to a
    quarter of a rotation.
    """
    best = results.modes[0]
    rotation = rotation_period(best)
    if rotation is None or results.t.size < FEWEST_FOLDED:
        return None
    period, spread = rotation
    turns_seen = results.span_s / abs(period)
    if turns_seen < 3.0 or turns_seen * spread / abs(period) > 0.25:
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


def draw_residual_periodogram(results: Results, gallery: Gallery) -> Image | None:
    """Part of the χ² of the residuals explained by a sinusoid, against its period.

    The phase of the sinusoid is free in each pass. A peak at the rotation period or a fraction of
    it shows what the model does not explain.
    """
    best = results.modes[0]
    q = bands(best)
    if q is None:
        return None
    sigma = sigmas(results, best)
    residual = results.brightness - q[2]
    passes = [_residual_pass(results, s, residual, sigma) for s in segments(results)]
    long = [p for p in passes if p is not None]
    if not long:
        return None
    used, notes = within(long, PERIODOGRAM)
    grid = periods.frequencies(used)
    power = periods.power(used, grid)
    unit, size = _time_unit(1.0 / float(grid[0]))
    figure = gallery.figure(5.4, 3.4)
    axes = figure.subplots()
    axes.plot(1.0 / grid / size, power, color=colour(best.index), lw=0.8)
    rotation = rotation_period(best)
    if rotation is not None:
        for k in (1, 2):
            label = f"rotation period{' ÷ 2' * (k == 2)}"
            inside = 1.0 / grid[-1] <= abs(rotation[0]) / k <= 1.0 / grid[0]
            if inside:
                style = "--" if k == 1 else ":"
                axes.axvline(
                    abs(rotation[0]) / k / size, color=FAINT, lw=0.9, ls=style, label=label
                )
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, frameon=False)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel(f"period ({unit})")
    axes.set_ylabel("part of χ² explained")
    return gallery.add(
        figure,
        "residual-periodogram",
        "Periodogram of the residuals.",
        "Periodogram of the residuals: what a sinusoid of each period, with a free phase in each "
        f"pass, would still explain.{' Longest passes only.' if notes else ''}",
    )


def _residual_pass(results: Results, part: Segment, residual: Floats, sigma: Floats) -> Pass | None:
    """The residuals of a segment as a series; None if it is too short."""
    at = part.points
    t = results.t[at]
    if at.size < FEWEST_OF_PASS or not np.ptp(t) > 0:
        return None
    y = residual[at] - np.mean(residual[at])
    known = np.where(np.isfinite(sigma[at]), sigma[at], np.std(residual) or 1.0)
    sun, obs = (results.constant[k].to_numpy()[at] for k in ("sun", "obs"))
    return Pass(segment_title(results, part), t, y, known, sun, obs)
