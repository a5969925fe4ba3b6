"""Figures of `lcbayes observability`: light curve, information, maps, bounds, trades, plan."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.sky_plots import draw_line, mollweide, place
from lcbayes.analysis.style import DATA, FAINT, INK, PALETTE, Gallery, Image, colour
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.simulation.observability.summary import Findings

Floats = NDArray[np.float64]
MOST_PARAMETERS = 36  # parameters drawn; of more, those with the best and worst bounds
DECADES = 4.0  # range of information spanned by the colours of a map
CMAP = "viridis"
FAINT_ERROR = 0.5  # mag: larger errors are meaningful in flux only, so such points are omitted


def draw(findings: Findings, gallery: Gallery) -> dict[str, Image]:
    """All figures that have content, by name."""
    made = {
        "information": draw_information(findings, gallery),
        "hemisphere": draw_hemisphere(findings, gallery),
        "seen": draw_seen(findings, gallery),
        "bounds": draw_bounds(findings, gallery),
    }
    if findings.trades:
        made["open"] = draw_open(findings, gallery)
    if findings.plan is not None:
        made["plan"] = draw_plan(findings, gallery)
    return made


def _sites(findings: Findings) -> list[tuple[str, NDArray[np.bool_], str]]:
    """Name, rows and colour of each site."""
    site = findings.measured.curve.site
    names = list(dict.fromkeys(map(str, site)))
    return [(name, site == name, colour(i)) for i, name in enumerate(names)]


def _time(findings: Findings) -> tuple[Floats, str]:
    """Times in a suitable unit, and the label of the axis."""
    t = findings.measured.curve.t
    span = float(np.ptp(t))
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if span > 3.0 * size:
            return t / size, f"time ({unit})"
    return t, "time (s)"


def draw_information(findings: Findings, gallery: Gallery) -> Image:
    m = findings.measured
    figure = gallery.figure(7.0, 4.4)
    upper, lower = figure.subplots(2, 1, sharex=True)
    t, label = _time(findings)
    sd = np.degrees(np.where(m.information > 0, m.information, np.nan) ** -0.5)
    measured = m.mag_err < FAINT_ERROR
    for name, here, hue in _sites(findings):
        good = here & measured
        upper.errorbar(
            t[good],
            m.mag[good],
            m.mag_err[good],
            fmt=".",
            ms=3,
            lw=0.6,
            color=hue,
            label=name or None,
        )
        lower.semilogy(t[here], sd[here], ".", ms=4, color=hue)
    upper.invert_yaxis()
    upper.set_ylabel("magnitude" if m.apparent else "−2.5 log₁₀ flux")
    lower.set_ylabel("attitude about one axis (°)")
    lower.set_xlabel(label)
    if findings.plan is not None:
        best = [findings.plan.visits[v] for v in findings.plan.schedule.visits]
        rows = np.concatenate(best)
        lower.semilogy(
            t[rows], sd[rows], "o", ms=8, mfc="none", mec=INK, mew=0.8, label="in the plan"
        )
        lower.legend(loc="best")
    if any(name for name, _, _ in _sites(findings)):
        upper.legend(loc="best", ncols=3)
    low, high = np.nanmin(sd), np.nanmax(sd)
    lower.yaxis.set_major_formatter("{x:g}")
    lower.set_ylim(low / 1.5, min(high * 1.5, low * 1e4))
    return gallery.add(
        figure,
        "information",
        "Magnitude and attitude information of every measurement over time.",
        "Above: the predicted measurements, with their errors (points with errors above half a "
        "magnitude are omitted). Below: the precision of the attitude from one measurement, about "
        "the single axis to which it is sensitive, σ/|∂m/∂α|; lower is better. "
        "It contains no information about the other two axes.",
    )


def sphere_patches(step_deg: float = 5.0) -> tuple[list[Floats], Floats]:
    """Corners of nearly square patches that cover the sphere, and their centres (G, 3)."""
    edges = np.radians(np.arange(-90.0, 90.0 + 1e-9, step_deg))
    patches, middles = [], []
    for low, high in pairwise(edges):
        count = max(3, round(360.0 / step_deg * np.cos(0.5 * (low + high))))
        lon = np.linspace(0.0, 2.0 * np.pi, count + 1)
        for a, b in pairwise(lon):
            corners = [(a, low), (b, low), (b, high), (a, high)]
            patches.append(np.array([_point(*c) for c in corners]))
            middles.append(_point(0.5 * (a + b), 0.5 * (low + high)))
    return patches, np.array(middles)


def _point(lon: float, lat: float) -> tuple[float, float, float]:
    return np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)


def levels(information: Floats) -> Floats:
    """log₁₀ of information, scaled from `DECADES` below the largest (0) to the largest (1); NaN
    where there is none."""
    top = np.max(information)
    with np.errstate(divide="ignore"):
        depth = np.log10(information / top) / DECADES + 1.0
    return np.where(information > 0.0, np.clip(depth, 0.0, 1.0), np.nan)


def draw_hemisphere(findings: Findings, gallery: Gallery) -> Image:
    """The information of a measurement from each direction in the body frame."""
    figure = gallery.figure(7.0, 4.0)
    axes = mollweide(figure)
    lon, lat = np.linspace(-180.0, 180.0, 241), np.linspace(-90.0, 90.0, 121)
    x, y = np.meshgrid(
        np.radians(0.5 * (lon[1:] + lon[:-1])), np.radians(0.5 * (lat[1:] + lat[:-1]))
    )
    directions = np.stack(_point(x, y), axis=-1)  # pyright: ignore[reportArgumentType]
    information = findings.map_information(directions.reshape(-1, 3)).reshape(x.shape)
    positive = np.where(information > 0.0, information, np.nan)
    top = float(np.nanmax(positive))
    from matplotlib.colors import LogNorm

    picture = axes.pcolormesh(
        np.radians(lon),
        np.radians(lat),
        positive,
        cmap=CMAP,
        rasterized=True,
        norm=LogNorm(top * 10.0**-DECADES, top),
    )
    axes.set_axisbelow(False)
    figure.colorbar(
        picture,
        ax=axes,
        shrink=0.75,
        pad=0.03,
        extend="min",
        label="information of one measurement (1/rad²)",
    )
    _mark_directions(axes, findings)
    legend = figure.legend(loc="outside lower center", ncols=3, frameon=True)
    legend.get_frame().set(facecolor="#8894a0", edgecolor="none", alpha=0.55)
    return gallery.add(
        figure,
        "hemisphere",
        "Map of the body frame: attitude information of a measurement from each direction.",
        "Information on the attitude for each direction of the observer, with the Sun at its "
        "position for the most informative measurement (white ring). Body frame, azimuth to the "
        "right, z at the top; blank: no illuminated facet is visible from there.",
    )


def _mark_directions(axes: Any, findings: Findings) -> None:
    """The observer, the Sun and the facet normals on a map of the body frame."""
    m, i = findings.measured, findings.most_informative
    path = np.linspace(0, len(m.obs_body) - 1, min(len(m.obs_body), 600)).astype(int)
    dots = {"ms": 1.6, "color": "white", "alpha": 0.7, "label": "observer, all measurements"}
    axes.plot(*place(*lon_lat_deg(m.obs_body[path])), ".", **dots)
    axes.plot(*place(*lon_lat_deg(m.obs_body[i])), "o", ms=7, mfc="none", mec="white", mew=1.6)
    star = {"ms": 13, "color": "#ffd23f", "mec": INK, "mew": 0.6, "label": "Sun"}
    axes.plot(*place(*lon_lat_deg(m.sun_body[i])), "*", **star)
    body = findings.scenario.body
    if len(body.areas) <= 40:
        squares = {"ms": 5, "mfc": "none", "mec": PALETTE[1], "mew": 1.2}
        axes.plot(*place(*lon_lat_deg(body.normals)), "s", label="facet normals", **squares)


def draw_seen(findings: Findings, gallery: Gallery) -> Image:
    """The axis to which each measurement is sensitive, and for the best one the two others."""
    m, i = findings.measured, findings.most_informative
    figure = gallery.figure(7.0, 4.0)
    axes = mollweide(figure)
    kept = m.information > 0.0
    g = m.mag_gradient[kept]
    g = g / np.linalg.norm(g, axis=1, keepdims=True)
    share = levels(m.information[kept])
    order = np.argsort(share)
    both = np.concatenate([g[order], -g[order]])
    picture = axes.scatter(
        *place(*lon_lat_deg(both)),
        c=np.tile(share[order], 2) * DECADES - DECADES,
        s=10,
        cmap=CMAP,
        lw=0,
        vmin=-DECADES,
        vmax=0.0,
        rasterized=True,
    )
    figure.colorbar(picture, ax=axes, shrink=0.75, pad=0.03, label="log₁₀ of information, best = 0")
    for row, (name, hue) in enumerate((("n₁", PALETTE[1]), ("n₂", PALETTE[3]))):
        ends = np.stack([m.nullspace[i, row], -m.nullspace[i, row]])
        lon, lat = place(*lon_lat_deg(ends))
        axes.plot(
            lon,
            lat,
            "D",
            ms=6,
            mfc="none",
            mec=hue,
            mew=1.4,
            label=f"{name}, not seen by the best measurement",
        )
    circle = _great_circle(m.nullspace[i])
    draw_line(axes, circle, color=FAINT, lw=0.9, label="all axes it does not see")
    figure.legend(loc="outside lower center", ncols=3, fontsize=7.5)
    return gallery.add(
        figure,
        "seen",
        "Map of the body frame: axis about which each measurement is sensitive to a rotation.",
        "The axis about which each measurement is sensitive to a small rotation, both ends; dark "
        "ones contain little information. The best measurement does not detect a rotation about "
        "any axis on the grey circle, which n₁ and n₂ span. Measurements whose axes "
        "are spread over the map together determine the whole attitude.",
    )


def _great_circle(plane: Floats) -> Floats:
    turn = np.linspace(0.0, 2.0 * np.pi, 361)[:, None]
    return np.cos(turn) * plane[0] + np.sin(turn) * plane[1]


def draw_bounds(findings: Findings, gallery: Gallery) -> Image:
    c = findings.campaign
    parameters, sd = c.unknowns.parameters, c.unknowns.prior_sd
    ratio, alone = c.bound_with_prior / sd, c.bound / sd
    rows = np.arange(len(parameters))
    left_out = ""
    if len(rows) > MOST_PARAMETERS:
        order = np.argsort(ratio)
        half = MOST_PARAMETERS // 2
        rows = np.sort(np.concatenate([order[:half], order[-half:]]))
        left_out = f" The {half} best and {half} worst of {len(parameters)} are drawn."
    figure = gallery.figure(7.0, 1.1 + 0.19 * len(rows))
    axes = figure.subplots()
    y = np.arange(len(rows))[::-1]
    axes.hlines(y, ratio[rows], 1.0, color="#d5d8dd", lw=1.2)
    groups = list(dict.fromkeys(p.group for p in parameters))
    for k, group in enumerate(groups):
        here = np.array([parameters[r].group == group for r in rows])
        is_open = ~np.isfinite(alone[rows])
        axes.plot(
            ratio[rows][here & ~is_open],
            y[here & ~is_open],
            "o",
            ms=5,
            color=colour(k),
            label=group,
        )
        axes.plot(
            ratio[rows][here & is_open],
            y[here & is_open],
            "o",
            ms=5,
            mfc="white",
            mec=colour(k),
            mew=1.3,
        )
    axes.axvline(1.0, color=FAINT, lw=0.8)
    axes.set_xscale("log")
    axes.set_yticks(y, [parameters[r].name for r in rows], fontsize=7.5)
    axes.set_ylim(-0.8, len(rows) - 0.2)
    axes.set_xlabel("error after the campaign ÷ width of the prior")
    figure.legend(loc="outside upper right", ncols=len(groups))
    return gallery.add(
        figure,
        "bounds",
        "Bound on the error of each parameter over the width of its prior.",
        "What is left of the prior's width after the campaign (Cramér-Rao bound with prior). "
        "Open circles: the measurements alone leave the parameter open, by itself or in a trade."
        + left_out,
    )


def draw_open(findings: Findings, gallery: Gallery) -> Image:
    unknowns, trades = findings.campaign.unknowns, findings.trades[:16]
    weights = np.array([t.combination for t in trades]) / unknowns.prior_sd
    weights /= np.abs(weights).max(axis=1, keepdims=True)
    columns = np.flatnonzero(np.abs(weights).max(axis=0) > 0.05)
    order = columns[np.argsort([np.argmax(np.abs(weights[:, c])) for c in columns], kind="stable")]
    order = order[:48]
    width = float(np.clip(1.6 + 0.24 * len(order), 4.0, 10.0))
    figure = gallery.figure(width, 1.7 + 0.26 * len(trades))
    axes = figure.subplots()
    picture = axes.imshow(weights[:, order], cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
    axes.set_xticks(
        range(len(order)), [unknowns.names[c] for c in order], rotation=90, fontsize=7.5
    )
    sentences = list(dict.fromkeys(t.words for t in findings.trades))
    numbers = [str(sentences.index(t.words) + 1) for t in trades]
    axes.set_yticks(range(len(trades)), numbers)
    axes.set_ylabel("combination")
    axes.spines[:].set_visible(False)
    axes.set_xticks(np.arange(len(order) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(trades) + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="white", lw=1.2)
    axes.tick_params(which="both", length=0)
    figure.colorbar(picture, ax=axes, label="change, in prior widths", ticks=[-1, 0, 1], shrink=0.9)
    more = len(findings.trades) - len(trades)
    return gallery.add(
        figure,
        "open",
        "Combinations of parameters that the campaign leaves open.",
        "Combinations of changes that the measurements cannot detect, numbered as in "
        "the list." + (f" {more} more are in observability.json." if more else ""),
    )


def draw_plan(findings: Findings, gallery: Gallery) -> Image:
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

    plan = findings.plan
    assert plan is not None
    figure = gallery.figure(9.0, 3.4)
    left, right = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    t, label = _time(findings)
    first = np.array([rows[0] for rows in plan.visits])
    chosen = plan.schedule.visits
    for name, here, hue in _sites(findings):
        mine = here[first]
        left.plot(
            t[first][mine],
            plan.schedule.first_gain[mine],
            ".",
            ms=4,
            color=hue,
            alpha=0.5,
            label=name or "possible visits",
        )
    height = plan.schedule.first_gain[chosen]
    left.plot(t[first][chosen], height, "o", ms=9, mfc="none", mec=INK, mew=1.0, label="chosen")
    for rank, v in enumerate(chosen[:9], 1):
        where = t[first[v]], plan.schedule.first_gain[v]
        above = {"xytext": (0, 6), "textcoords": "offset points", "ha": "center", "va": "bottom"}
        left.annotate(str(rank), where, fontsize=7.5, **above)
    left.set_ylim(0.0, 1.18 * float(plan.schedule.first_gain.max()))
    left.set_xlabel(label)
    left.set_ylabel("information of the visit alone (nats)")
    left.legend(loc="best", fontsize=7.5)
    unit = "" if plan.target.unit == "1" else f" ({plan.target.unit.replace('deg', '°')})"
    n = np.arange(len(plan.schedule.sd))
    right.semilogy(n, plan.schedule.sd, "-", color=DATA, lw=1.6, label="planned")
    right.semilogy(n, plan.even.sd, "--", color=FAINT, lw=1.4, label="at equal steps")
    for k, (name, alone) in enumerate(plan.sites.items()):
        right.semilogy(
            np.arange(len(alone.sd)), alone.sd, ":", color=colour(k), lw=1.4, label=f"{name} alone"
        )
    right.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    right.yaxis.set_major_formatter("{x:g}")
    right.yaxis.set_minor_locator(NullLocator())
    right.xaxis.set_major_locator(MaxNLocator(integer=True))
    right.set_xlabel("visits")
    right.set_ylabel(f"error of {plan.target.name}{unit}")
    right.legend(loc="best", fontsize=7.5)
    return gallery.add(
        figure,
        "plan",
        "Selected visits, and the error of the target against their number.",
        f"Left: the information of each possible visit alone on {plan.target.name}, and the "
        "selected visits, the first nine with their rank. Right: error of the target against the "
        "number of visits in order of importance, and of visits at equal steps in order of time.",
    )
