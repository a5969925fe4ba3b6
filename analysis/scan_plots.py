"""Figures of an attitude scan: χ² over the sky and over period, the fit, the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.shape_plots import STONE, draw_views
from lcbayes.analysis.sky_plots import FRAMES, mollweide, nearest_pixels, place
from lcbayes.analysis.style import DATA, FAINT, Gallery, Image, colour
from lcbayes.attitude_scan.found import Found, Solution, lon_lat, readable_period
from lcbayes.attitude_scan.grid import HOUR
from lcbayes.polyhedron import Polyhedron

Floats = NDArray[np.float64]

SHOWN = 6  # solutions with a number of their own, and light curves that are folded
WIDE = 3.0  # longest over shortest trial period from which their axis is logarithmic
GAP = 0.15  # of a panel
CEILING = 4.0  # residuals over the least; what is worse looks the same


def draw_sky(found: Found, gallery: Gallery) -> Image | None:
    """Residuals against the direction of the pole, at the best period."""
    if found.sky is None or found.screened is None:
        return None
    poles, chi2 = found.sky
    least = min(float(found.screened.chi2.min()), float(chi2.min()))
    worse = np.sqrt(chi2 / least)
    figure = gallery.figure(7.0, 3.7)
    axes = mollweide(figure)
    lon_edges, lat_edges, pixels = nearest_pixels(poles)
    from matplotlib.colors import LogNorm

    picture = axes.pcolormesh(
        np.radians(lon_edges), np.radians(lat_edges), worse[pixels], cmap="viridis_r",
        norm=LogNorm(1.0, min(max(float(worse.max()), 1.1), CEILING)), rasterized=True,
    )  # fmt: skip
    axes.tick_params(axis="x", labelcolor="white")
    bar = figure.colorbar(picture, ax=axes, label="residuals ÷ least", shrink=0.8, pad=0.03)
    ticks = [x for x in (1.0, 1.1, 1.2, 1.5, 2.0, 3.0, 4.0) if x <= picture.norm.vmax * 1.001]
    bar.set_ticks(ticks, labels=[f"{x:g}" for x in ticks])
    bar.minorticks_off()
    for i, s in _spins(found):
        if s.relation in ("period-alias", "period", "half-period", "double-period"):
            continue  # of another period than the map
        assert s.pole is not None
        x, y = place(*map(np.array, lon_lat(s.pole)))
        _ring(axes, float(x), float(y), str(i + 1))
    frame = FRAMES.get(found.frame, found.frame)
    caption = (
        f"Residuals of the best body against the pole of its spin, {frame}, at the period of "
        "solution 1, in units of the least. Each direction was held and the body solved for. "
        "Rings: refined solutions of that period."
    )
    return gallery.add(figure, "sky", "Map of the sky: residuals for each pole.", caption)


def _ring(axes: Any, x: float, y: float, text: str) -> None:
    from matplotlib import patheffects

    halo = [patheffects.withStroke(linewidth=3.0, foreground="white")]
    axes.plot(x, y, "o", ms=9, mfc="none", mec=DATA, mew=1.2, path_effects=halo, clip_on=False)
    label = axes.annotate(
        text, (x, y), xytext=(7, 4), textcoords="offset points", fontsize=9, weight="bold"
    )
    label.set_path_effects(halo)


def _spins(found: Found) -> list[tuple[int, Solution]]:
    """Constant spins among the first solutions, with their places."""
    return [(i, s) for i, s in enumerate(found.solutions[:SHOWN]) if s.pole is not None]


def draw_periods(found: Found, gallery: Gallery) -> Image | None:
    """Residuals against trial period: every hypothesis, and the best of each period."""
    table = found.screened
    if table is None or found.n_periods < 3:
        return None
    ours = table.tried <= 1.0000001 * _last(found)
    ours &= table.tried >= 0.9999999 * _first(found)
    tried, chi2 = table.tried[ours], table.chi2[ours]
    worse = np.sqrt(chi2 / table.chi2.min())
    periods, number = np.unique(1.0 / (HOUR * tried), return_inverse=True)
    best = np.full(len(periods), np.inf)
    np.minimum.at(best, number, worse)
    figure = gallery.figure(7.0, 2.9)
    axes = figure.subplots()
    unit, name = readable_period(periods[0])
    unit /= periods[0]
    if periods[-1] > WIDE * periods[0]:
        axes.set_xscale("log")
        round_ = np.outer(10.0 ** np.arange(-3, 6), [1.0, 2.0, 3.0, 5.0]).ravel()
        shown = round_[(round_ >= unit * periods[0]) & (round_ <= unit * periods[-1])]
        axes.set_xticks(shown, [f"{x:g}" for x in shown])
    axes.plot(unit / (HOUR * tried), worse, ".", ms=2, color=FAINT, alpha=0.5, rasterized=True,
              label="every pole")  # fmt: skip
    axes.plot(unit * periods, best, "-", lw=1.0, color=colour(0), label="best pole")
    for at, low, text in _numbers(found, periods, best):
        axes.annotate(
            text, (unit * at, low), xytext=(0, -11), textcoords="offset points", ha="center",
            fontsize=8.5, weight="bold", color=colour(1),
        )  # fmt: skip
    axes.set_yscale("log")
    top = float(np.quantile(worse, 0.98))
    axes.set_ylim(0.8, max(1.3 * top, 1.5))
    ticks = [x for x in (1, 2, 3, 5, 10, 20, 50) if x < 1.3 * top]
    axes.set_yticks(ticks, [f"{x:g}" for x in ticks])
    axes.minorticks_off()
    axes.set_xlabel(f"trial sidereal period ({name})")
    axes.set_ylabel("residuals ÷ least")
    figure.legend(loc="outside upper right", ncols=2)
    caption = (
        "Residuals against trial period, in units of the least, with the coarse body that "
        "hypotheses are screened with. Numbers: refined solutions."
    )
    return gallery.add(figure, "periods", "Residuals against trial period.", caption)


def _numbers(found: Found, periods: Floats, best: Floats) -> list[tuple[float, float, str]]:
    """Where (h, residuals) to write which numbers of solutions, those of one place together."""
    places: list[list[Any]] = []
    reach = 0.02 * float(np.ptp(periods))
    for i, s in _spins(found):
        at = 1.0 / (HOUR * (s.frequency or np.inf))
        if s.chi2 > CEILING**2 * found.solutions[0].chi2 or not periods[0] <= at <= periods[-1]:
            continue
        near = next((p for p in places if abs(p[0] - at) < reach), None)
        if near is None:
            middle = int(np.argmin(np.abs(periods - at)))
            low = float(np.min(best[max(middle - 1, 0) : middle + 2]))
            places.append([at, low, str(i + 1)])
        else:
            near[2] += f", {i + 1}"
    return [(at, low, text) for at, low, text in places]


def _first(found: Found) -> float:
    high = found.settings.period_range_h[1]
    return 1.0 / (HOUR * high)


def _last(found: Found) -> float:
    return 1.0 / (HOUR * found.settings.period_range_h[0])


def draw_laws(found: Found, gallery: Gallery) -> Image | None:
    """Residuals under each law, the best first."""
    if not found.n_laws:
        return None
    shown = found.solutions[:25]
    figure = gallery.figure(7.0, 0.9 + 0.23 * len(shown))
    axes = figure.subplots()
    names = [
        s.law if s.pole is None else "spin {}: {:.5g} {}".format(i + 1, *_period(s))
        for i, s in enumerate(shown)
    ]
    hues = [colour(0) if s.pole is None else colour(1) for s in shown]
    axes.barh(np.arange(len(shown)), [s.rms for s in shown], color=hues, height=0.7)
    axes.set_yticks(np.arange(len(shown)), names)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlabel("rms residual ÷ mean of the curve")
    caption = "Rms of the residuals of the best body under each attitude."
    return gallery.add(figure, "laws", "Residuals under each attitude law.", caption)


def _period(s: Solution) -> tuple[float, str]:
    return readable_period(s.spin()["period_h"])


def draw_fit(found: Found, gallery: Gallery) -> Image:
    """The curves with most points, observed and fitted: against rotational phase or time."""
    best = found.solutions[0]
    counts = np.bincount(found.curve)
    chosen = np.sort(np.argsort(-counts, kind="stable")[:SHOWN])
    rows = -(-len(chosen) // 3)
    columns = min(3, len(chosen))
    figure = gallery.figure(7.0, 1.0 + 1.6 * rows)
    fitted = found.flux - best.residual
    middle = 0.5 * (found.t.min() + found.t.max())
    folded = best.frequency is not None and np.ptp(found.t) * best.frequency > 3
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes in grid.flat[len(chosen) :]:
        axes.set_visible(False)
    for axes, group in zip(grid.flat, chosen, strict=False):
        here = found.curve == group
        t, x = found.t[here], (found.t[here] - found.t[here].min()) / 60.0
        if folded and best.frequency is not None:
            x = np.mod((t - middle) * best.frequency, 1.0)
        order = np.argsort(x, kind="stable")
        axes.plot(x[order], found.flux[here][order], ".", ms=3, color=DATA)
        line = fitted[here][order]
        dense = folded and np.ptp(t) * (best.frequency or 0.0) < 5
        # a line across a gap would tell of what nobody saw
        line = np.where(np.diff(x[order], append=np.inf) > GAP * np.ptp(x), np.nan, line)
        axes.plot(x[order], line, "-", lw=1.0, color=colour(1), alpha=float(dense))
        axes.plot(x[order], fitted[here][order], ".", ms=2.0, color=colour(1))
        axes.set_title(f"curve {group}", fontsize=8)
        axes.locator_params(nbins=4)
    figure.supxlabel("rotational phase" if folded else "time since the curve began (min)", size=9)
    figure.supylabel("flux ÷ mean of the curve", size=9)
    caption = (
        f"Observed (black) and fitted (orange) flux of the {len(chosen)} curves with most points, "
        f"solution 1. Rms of all residuals: {best.rms:.4f}."
    )
    return gallery.add(figure, "fit", "Observed and fitted flux.", caption)


def draw_shape(body: Polyhedron, gallery: Gallery) -> Image:
    """The body of the best solution from three sides."""
    reach = float(np.max(np.linalg.norm(body.vertices, axis=1)))
    faces = [body.vertices[f] / reach for f in body.faces]
    size = np.sort(body.dimensions)
    extent = " : ".join(f"{x / size[0]:.2f}" for x in size[::-1])
    caption = f"Convex body of solution 1 for one albedo; extents are as {extent}."
    return draw_views(
        faces, [STONE] * len(faces), gallery, "shape", "The body from three sides.", caption
    )
