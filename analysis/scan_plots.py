"""Figures of an attitude scan: χ² over the sky and over period, the fit and the body."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.shape_plots import STONE, draw_views
from lcbayes.analysis.sky_plots import FRAMES, mollweide, nearest_pixels, place
from lcbayes.analysis.style import DATA, FAINT, Gallery, Image, colour
from lcbayes.core.constants import HOUR_S
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution, readable_period
from lcbayes.physics.bodies.polyhedron import Polyhedron

Floats = NDArray[np.float64]

SHOWN = 6  # number of solutions that are labelled, and of light curves that are folded
WIDE = 3.0  # ratio of longest to shortest trial period above which the axis is logarithmic
GAP = 0.15  # fraction of a panel's width
CEILING = 4.0  # residuals, relative to the best solution, up to which a solution is labelled
LEVELS = 65  # residual levels between which colours change evenly
MARGIN = 0.08  # fraction of the range of periods added on either side, for searches that left it


def draw_nights(scan: AttitudeScan, gallery: Gallery) -> Image | None:
    """Expected probability of the true period after each night, and after the best together."""
    ahead = scan.nights
    if ahead is None:
        return None
    rows = ahead["nights"]
    number = np.array([row["night"] for row in rows])
    alone = [row["probability"] for row in rows]
    figure = gallery.figure(7.0, 2.7)
    axes = figure.subplots()
    axes.bar(number, alone, width=0.7, color=colour(4), label="this night alone")
    axes.axhline(ahead["now"], color=FAINT, lw=1.0, ls=":", label="now")
    chosen = [row["night"] for row in ahead["together"]]
    reached = [row["probability"] for row in ahead["together"]]
    axes.plot(chosen, reached, "o", color=colour(1), ms=5, label="with those chosen before it")
    for k, (x, y) in enumerate(zip(chosen, reached, strict=True), start=1):
        axes.annotate(str(k), (x, y), (0, 5), textcoords="offset points", ha="center", fontsize=8.5)
    axes.set_ylim(0.0, 1.12)
    axes.set_yticks(np.linspace(0.0, 1.0, 6))
    axes.set_xlim(0.3, len(rows) + 0.7)
    axes.locator_params(axis="x", integer=True)
    axes.set_xlabel("night of the file")
    axes.set_ylabel("expected probability")
    figure.legend(loc="outside upper right", ncols=3)
    caption = (
        "Expected probability of the true period after each night that could be observed, with an "
        f"error of {ahead['error_mag']:g} mag for each point. Numbers: the best night, the best "
        "one beside it, and so on."
    )
    alt = "Expected probability of the true period after each night."
    return gallery.add(figure, "nights", alt, caption)


def draw_sky(scan: AttitudeScan, gallery: Gallery) -> Image | None:
    """Residuals against the direction of the pole, at the best period."""
    if scan.sky is None or scan.screened is None:
        return None
    poles, chi2 = scan.sky
    least = min(float(scan.screened.chi2.min()), float(chi2.min()))
    worse = np.sqrt(chi2 / least)
    figure = gallery.figure(7.0, 3.7)
    axes = mollweide(figure)
    axes.set_axisbelow(False)
    axes.grid(color="white", lw=0.5, alpha=0.5)
    lon_edges, lat_edges, pixels = nearest_pixels(poles)
    # colours by rank: each quarter of the sky gets a quarter of the colours
    steps = np.unique(np.append(1.0, np.quantile(worse, np.linspace(0.0, 1.0, LEVELS))))
    shade = np.interp(worse, steps, np.linspace(0.0, 1.0, len(steps)))
    picture = axes.pcolormesh(
        np.radians(lon_edges),
        np.radians(lat_edges),
        shade[pixels],
        cmap="viridis_r",
        vmin=0.0,
        vmax=1.0,
        rasterized=True,
    )
    axes.tick_params(axis="x", labelcolor="white")
    bar = figure.colorbar(picture, ax=axes, label="residuals ÷ least", shrink=0.8, pad=0.03)
    ticks = np.linspace(0.0, 1.0, 6)
    values = np.interp(ticks, np.linspace(0.0, 1.0, len(steps)), steps)
    bar.set_ticks(ticks, labels=[f"{x:.3g}" for x in values])
    for i, s in _spins(scan):
        if s.relation in ("period-alias", "period", "half-period", "double-period"):
            continue  # its period differs from that of the map
        assert s.pole is not None
        x, y = place(*map(np.array, lon_lat_deg(s.pole)))
        _ring(axes, float(x), float(y), str(i + 1))
    frame = FRAMES.get(scan.frame, scan.frame)
    caption = (
        f"Residuals of the best body against the pole of its spin, {frame}, at the period of "
        "solution 1, relative to the smallest. Each direction was held fixed and the body fitted. "
        "Equal areas of the sky have equal parts of the scale. Rings: refined solutions of that "
        "period."
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


def _spins(scan: AttitudeScan) -> list[tuple[int, Solution]]:
    """Constant spins among the first solutions, with their ranks."""
    return [(i, s) for i, s in enumerate(scan.solutions[:SHOWN]) if s.pole is not None]


def draw_periods(scan: AttitudeScan, gallery: Gallery) -> Image | None:
    """Residuals against the final period of each search, and the best per trial period."""
    table = scan.screened
    if table is None or scan.n_periods < 3:
        return None
    shortest, longest = scan.settings.period_range_h
    wide = longest > WIDE * shortest
    ends = np.array([shortest, longest])
    scaled = np.log(ends) if wide else ends
    scaled = scaled + MARGIN * np.ptp(scaled) * np.array([-1.0, 1.0])
    first, last = np.exp(scaled) if wide else scaled
    reached = 1.0 / (HOUR_S * table.frequency)
    shown = (reached >= first) & (reached <= last)
    reached, worse = reached[shown], np.sqrt(table.chi2[shown] / table.chi2.min())
    unit, name = readable_period(shortest)
    unit /= shortest
    figure = gallery.figure(7.0, 2.9)
    axes = figure.subplots()
    if wide:
        _set_log_ticks(axes, unit * shortest, unit * longest)
    axes.set_xlim(unit * first, unit * last)
    for x in ends:
        axes.axvline(unit * x, color=FAINT, lw=0.7, ls=":")
    best = _least_near(np.unique(table.tried), table.frequency[shown], worse)
    dots = {"ms": 3, "color": FAINT, "alpha": 0.5, "rasterized": True}
    axes.plot(unit * reached, worse, ".", label="every search", **dots)
    dots = {"ms": 5, "color": colour(0)}
    axes.plot(unit * reached[best], worse[best], ".", label="best near each trial period", **dots)
    bold = {"ha": "center", "fontsize": 8.5, "weight": "bold", "color": colour(1)}
    for at, low, text in _numbers(scan, reached, worse, (first, last)):
        axes.annotate(text, (unit * at, low), (0, -11), textcoords="offset points", **bold)
    axes.set_yscale("log")
    top = float(np.quantile(worse, 0.98))
    axes.set_ylim(0.7, max(1.3 * top, 1.5))
    ticks = [x for x in (1, 2, 3, 5, 10, 20, 50) if x < 1.3 * top]
    axes.set_yticks(ticks, [f"{x:g}" for x in ticks])
    axes.minorticks_off()
    axes.set_xlabel(f"sidereal period reached ({name})")
    axes.set_ylabel("residuals ÷ smallest")
    figure.legend(loc="outside upper right", ncols=2)
    caption = (
        "Residuals of every search against the period that it reached, relative to the smallest, "
        "for the coarse body used in the screening. Dotted: ends of the search range. Numbers: "
        "refined solutions."
    )
    if scan.n_ranked:
        caption = (
            "The periodogram: residuals of a fit with as much evidence, relative to the smallest, "
            "at the best pole of each frequency. Of adjacent frequencies the best is shown. "
            "Dotted: ends of the search range. Numbers: refined solutions."
        )
    return gallery.add(figure, "periods", "Residuals against the period reached.", caption)


def _set_log_ticks(axes: Any, low: float, high: float) -> None:
    """A logarithmic x axis with ticks at round numbers between ``low`` and ``high``."""
    axes.set_xscale("log")
    round_ = np.outer(10.0 ** np.arange(-3, 6), [1.0, 2.0, 3.0, 5.0]).ravel()
    ticks = round_[(round_ >= low) & (round_ <= high)]
    axes.set_xticks(ticks, [f"{x:g}" for x in ticks])


def _least_near(tried: Floats, frequency: Floats, worse: Floats) -> NDArray[np.integer]:
    """Index of the search with the smallest residuals among those ending nearest each frequency."""
    cell = np.searchsorted(0.5 * (tried[1:] + tried[:-1]), frequency)
    order = np.lexsort((worse, cell))
    return order[np.unique(cell[order], return_index=True)[1]]


def _numbers(
    scan: AttitudeScan, reached: Floats, worse: Floats, shown: tuple[float, float]
) -> list[tuple[float, float, str]]:
    """Positions (h, residuals) and labels of solutions; solutions at one position share a label."""
    places: list[list[Any]] = []
    reach = 0.02 * (shown[1] - shown[0])
    for i, s in _spins(scan):
        at = 1.0 / (HOUR_S * (s.frequency or np.inf))
        if s.chi2 > CEILING**2 * scan.solutions[0].chi2 or not shown[0] <= at <= shown[1]:
            continue
        near = next((p for p in places if abs(p[0] - at) < reach), None)
        if near is None:
            here = worse[np.abs(reached - at) < reach]
            places.append([at, float(here.min(initial=CEILING)), str(i + 1)])
        else:
            near[2] += f", {i + 1}"
    return [(at, low, text) for at, low, text in places]


def draw_laws(scan: AttitudeScan, gallery: Gallery) -> Image | None:
    """Residuals under each law, best first."""
    if not scan.n_laws:
        return None
    shown = scan.solutions[:25]
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


def draw_fit(scan: AttitudeScan, gallery: Gallery) -> Image:
    """The curves with most points, observed and fitted, against rotational phase or time."""
    best = scan.solutions[0]
    counts = np.bincount(scan.curve)
    chosen = np.sort(np.argsort(-counts, kind="stable")[:SHOWN])
    rows = -(-len(chosen) // 3)
    columns = min(3, len(chosen))
    figure = gallery.figure(7.0, 1.0 + 1.6 * rows)
    fitted = scan.flux - best.residual
    middle = 0.5 * (scan.t.min() + scan.t.max())
    folded = best.frequency is not None and np.ptp(scan.t) * best.frequency > 3
    grid = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for axes in grid.flat[len(chosen) :]:
        axes.set_visible(False)
    for axes, group in zip(grid.flat, chosen, strict=False):
        here = scan.curve == group
        t, x = scan.t[here], (scan.t[here] - scan.t[here].min()) / 60.0
        if folded and best.frequency is not None:
            x = np.mod((t - middle) * best.frequency, 1.0)
        order = np.argsort(x, kind="stable")
        axes.plot(x[order], scan.flux[here][order], ".", ms=3, color=DATA)
        line = fitted[here][order]
        dense = folded and np.ptp(t) * (best.frequency or 0.0) < 5
        # a line across a gap would suggest data there
        line = np.where(np.diff(x[order], append=np.inf) > GAP * np.ptp(x), np.nan, line)
        axes.plot(x[order], line, "-", lw=1.0, color=colour(1), alpha=float(dense))
        axes.plot(x[order], fitted[here][order], ".", ms=2.0, color=colour(1))
        axes.set_title(scan.curve_titles[group], fontsize=8)
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
