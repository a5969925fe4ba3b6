"""The text and figures of `lcbayes spin`."""

from __future__ import annotations

from typing import Any

import numpy as np

from lcbayes.analysis.numerals import FRAMES, show
from lcbayes.analysis.sky_plots import mollweide, place
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import DATA, FAINT, Gallery, colour
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.spin.pole import azimuths
from lcbayes.inversion.spin.sidereal import Solution, Spin

REFUSED = "no pole and no sidereal period"
MOST_PASSES, MOST_SOLUTIONS = 6, 6  # passes in the figure; solutions in the text
LEAST_PART = 0.005  # weight of a part of a region too large that is listed


def words(result: Spin, curve: LightCurve) -> list[str]:
    """The result as text, without the verdict."""
    lines = _before(result, curve)
    if result.too_wide:
        lines.append("no pole is given, but these are the parts of its 90 % region:")
    for s in _shown(result):
        weight, lon, lat, radius, period, sd, rate, cycles = _cells(s)
        lines.append(
            f"weight {weight}: pole ({lon}, {lat}) deg, uncertain by {radius} deg; sidereal period "
            f"{period} ± {sd} s ({rate} deg/s), {cycles} cycle{'s' * (s.multiple > 1)} of "
            "brightness per rotation"
        )
    return lines + _after(result, curve)


def table(result: Spin) -> Listing:
    """A row for each solution, or for each part of the pole's region if it is too wide."""
    heads = ("weight", "pole longitude (deg)", "latitude (deg)", "radius (deg)")
    heads += ("sidereal period (s)", "sd (s)", "rate (deg/s)", "cycles a rotation")
    return Listing("solutions", heads, [_cells(s) for s in _shown(result)])


def _cells(s: Solution) -> tuple[str, ...]:
    lon, lat = lon_lat_deg(s.pole)
    radius = np.degrees(s.radius)
    period, spread = 1 / s.frequency, s.error / s.frequency**2
    return (
        f"{s.weight:.2f}",
        show(float(lon), radius),
        show(float(lat), radius),
        show(radius, radius),
        show(period, spread),
        show(spread, spread),
        show(360.0 * s.frequency, 360.0 * s.error),
        str(s.multiple),
    )


def remarks(result: Spin, curve: LightCurve) -> list[str]:
    """What the text says besides the solutions."""
    wide = ["no pole is given, but the table has the parts of its 90 % region"]
    return wide * bool(result.too_wide) + _before(result, curve) + _after(result, curve)


def _shown(result: Spin) -> list[Solution]:
    least = LEAST_PART if result.too_wide else 0.0
    listed = (result.solutions or result.too_wide)[:MOST_SOLUTIONS]
    return [s for s in listed if s.weight >= least]


def _before(result: Spin, curve: LightCurve) -> list[str]:
    """What the data are, and the period of the brightness."""
    lines: list[str] = []
    if len(result.solutions) > 1:
        lines.append(f"{len(result.solutions)} solutions: the periods do not distinguish them")
    left = curve.n_obs - sum(p.t.size for p in result.passes)
    short = f", {left} points in passes too short" if left else ""
    passes = "pass" if len(result.passes) == 1 else "passes"
    lines.append(f"{len(result.passes)} {passes} of {curve.n_obs - left} points{short}")
    if result.base is not None and result.mean is not None:
        mean = result.mean
        period, spread = mean.period, mean.period_error
        drift, drift_sd = 100.0 * mean.drift, 100.0 * mean.drift_error
        lines.append(
            f"brightness repeats with {show(1.0 / result.base, spread)} s on average; mean synodic "
            f"period of the longest pass {show(period, spread)} ± {show(spread, spread)} s, whose "
            f"frequency changes by {show(drift, drift_sd)} ± {show(drift_sd, drift_sd)} % along it"
        )
    return lines


def _after(result: Spin, curve: LightCurve) -> list[str]:
    """What holds for the solutions, and notes."""
    lines: list[str] = []
    listed = result.solutions or result.too_wide
    rest = listed[len(_shown(result)) :]
    if rest:
        lines.append(f"{len(rest)} more of weight {sum(s.weight for s in rest):.2f} together")
    if listed:
        lines.append(
            f"frame: {FRAMES.get(curve.frame, curve.frame)}; the body rotates right-handed about "
            "the pole; weights add to 0.9"
        )
    if result.solutions:
        lines.append(
            "for simulated bodies, such regions contained the true pole of 16 of 18 cylinders and "
            "4 of 4 boxes, where 90 % are expected"
        )
    return lines + result.notes


def draw(result: Spin, curve: LightCurve, gallery: Gallery) -> None:
    """Periodogram, synodic period along the passes, and pole on the sky."""
    draw_periodogram(result, gallery)
    if result.windows is not None and result.windows.t.size:
        draw_synodic(result, gallery)
    if result.sky is not None:
        draw_sky(result, curve, gallery)


def draw_periodogram(result: Spin, gallery: Gallery) -> None:
    """Power against period, with the base period and its harmonics."""
    figure = gallery.figure(6.4, 2.6)
    axes = figure.subplots()
    axes.plot(1.0 / result.grid, result.power, color=colour(0), lw=0.8)
    if result.base is not None:
        for k in result.harmonics:
            if k * result.base <= result.grid[-1]:
                axes.axvline(
                    1.0 / (k * result.base),
                    color=colour(1),
                    lw=0.8,
                    ls="-" if k == 1 else ":",
                    label={1: "base period", 2: "its harmonics"}.get(k),
                )
        axes.legend(loc="upper left")
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("period (s)")
    axes.set_ylabel("part of χ² explained")
    gallery.add(figure, "periodogram", "Power against period.", "Periodogram of all passes.")


def draw_synodic(result: Spin, gallery: Gallery) -> None:
    """Synodic period along each pass, measured and predicted by the best solution."""
    windows = result.windows
    assert windows is not None
    shown = np.unique(windows.which)[:MOST_PASSES]
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure = gallery.figure(0.8 + 2.6 * columns, 0.7 + 1.9 * rows)
    grid = np.atleast_1d(figure.subplots(rows, columns, sharey=True)).ravel()
    for axes in grid[len(shown) :]:
        axes.set_visible(False)
    for axes, i in zip(grid, shown, strict=False):
        one, here = result.passes[i], windows.which == i
        minutes = (windows.t[here] - one.t[0]) / 60.0
        period = 1.0 / windows.frequency[here]
        error = windows.error[here] * period**2
        dots = {"fmt": "o", "ms": 3, "lw": 0.9, "color": colour(0)}
        axes.errorbar(minutes, period, error, label="measured in windows", **dots)
        if result.solutions:
            _draw_predicted(axes, result.solutions[0], one)
        axes.set_title(f"pass {i + 1}", loc="left")
        axes.locator_params(nbins=5)
    for axes in grid[max(0, len(shown) - columns) : len(shown)]:
        axes.set_xlabel("time in the pass (min)")
    for axes in grid[: len(shown) : columns]:
        axes.set_ylabel("period (s)")
    low, high = np.quantile(1.0 / windows.frequency, [0.02, 0.98])
    margin = max(high - low, 1e-3 * high)
    grid[0].set_ylim(low - 0.6 * margin, high + 0.6 * margin)
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    gallery.add(
        figure,
        "synodic",
        "Synodic period along the passes.",
        "Period of the brightness in windows along each pass.",
    )


def _draw_predicted(axes: Any, best: Any, one: Any) -> None:
    """Predicted synodic period of a solution along a pass, and its sidereal period."""
    angle = azimuths(best.pole[None], one.sun + one.obs)[0]
    if np.all(np.diff(one.t) > 0):
        rate = np.gradient(angle, one.t, edge_order=1)
        f = best.multiple * (best.frequency - rate / (2 * np.pi))
        label = "synodic period for the best pole"
        axes.plot((one.t - one.t[0]) / 60.0, 1 / f, color=colour(1), lw=1.0, label=label)
    label = "sidereal period" + (f" ÷ {best.multiple}" if best.multiple > 1 else "")
    sidereal = 1 / (best.multiple * best.frequency)
    axes.axhline(sidereal, color=FAINT, lw=0.8, ls="--", label=label)


def draw_sky(result: Spin, curve: LightCurve, gallery: Gallery) -> None:
    """The 90 % region of the pole, and the solutions as rings."""
    sky = result.sky
    assert sky is not None
    figure = gallery.figure(6.4, 3.4)
    axes = mollweide(figure)
    inside = sky.region()
    x, y = place(*lon_lat_deg(sky.poles[inside]))
    weight = sky.weight.sum(axis=1)[inside]
    size = 1.0e4 * sky.cell
    axes.scatter(
        x,
        y,
        s=max(size, 3.0),
        c=np.sqrt(weight / weight.max()),
        cmap="Blues",
        vmin=-0.4,
        lw=0,
        rasterized=True,
        label="90 % region",
    )
    for i, s in enumerate(result.solutions[:MOST_SOLUTIONS]):
        x, y = place(*lon_lat_deg(s.pole))
        axes.scatter(
            x,
            y,
            s=120,
            fc="none",
            ec=colour(1) if i == 0 else DATA,
            lw=1.2,
            label=f"solution, weight {s.weight:.2f}" if i < 3 else None,
        )
    figure.legend(loc="outside lower center", ncols=4)
    frame = FRAMES.get(curve.frame, curve.frame)
    gallery.add(
        figure,
        "pole",
        "Map of the sky with the region of the pole.",
        f"90 % region of the pole, {frame}.",
    )
