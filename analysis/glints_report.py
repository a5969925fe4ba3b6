"""The text and figures of `lcbayes glints`."""

from __future__ import annotations

import numpy as np

from lcbayes.analysis.numerals import digits, show
from lcbayes.analysis.sky_plots import draw_line, mollweide, place
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import DATA, FAINT, Gallery, colour
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.spherical import lon_lat_deg
from lcbayes.geometry.times import Times
from lcbayes.inversion.glints.attitude import Glints
from lcbayes.inversion.glints.detect import Glint
from lcbayes.inversion.glints.directions import CHI2_90, Direction
from lcbayes.physics.bodies.facets import across

REFUSED = "no direction found"
MOST = 4  # stretches drawn: those with the strongest glints
LISTED = 12  # glints listed in the text


def wire_like(result: Glints, i: int) -> bool:
    """Whether a glint is no higher than its baseline and shorter than 2 deg of the bisector."""
    one, seen = result.glints[i], result.seen[i]
    return one.height < one.baseline and np.linalg.norm(seen.rate) * one.fwhm < np.radians(2.0)


def words(result: Glints, curve: LightCurve) -> list[str]:
    """The result as lines of text, without the verdict."""
    units = "; heights in baselines, directions of bisectors" if result.glints else ""
    lines = [f"{_counted(result, curve)}{units}"]
    if result.glints:
        lines += _columns(result, curve)
    if len(result.glints) > LISTED:
        lines.append(f"  and {len(result.glints) - LISTED} more, in summary.json")
    return lines + _directions(result) + result.notes


def table(result: Glints, curve: LightCurve) -> Listing:
    """A row for each glint."""
    heads = ("glint", "time", "pass", "width (s)", "height (baselines)", "sigma")
    heads += ("bisector longitude (deg)", "latitude (deg)", "kind")
    rows = [_cells(result, curve, i) for i in range(len(result.glints))]
    return Listing("glints", heads, rows)


def remarks(result: Glints, curve: LightCurve) -> list[str]:
    """What the text says besides the glints."""
    return [_counted(result, curve), *_directions(result), *result.notes]


def _counted(result: Glints, curve: LightCurve) -> str:
    return f"{len(result.glints)} glint(s) in {curve.n_obs} points"


def _directions(result: Glints) -> list[str]:
    """What the glints determine."""
    lines: list[str] = []
    for f in result.facets:
        lines.append(f"facet: normal {_where(f)}, from {len(f.members)} glints")
    if result.cylinder is not None:
        lines.append(
            f"cylinder: axis or opposite {_where(result.cylinder)}, "
            f"{len(result.cylinder.members)} glints, p = {result.cylinder.p_value:.2f}"
        )
    if result.panel is not None:
        p = result.panel
        mean, sd = np.degrees([p.mean, p.error])
        lines.append(
            f"Sun-tracking panel: offset from the Sun {show(mean, sd)} ± {show(sd, sd)} deg about "
            f"the axis, from {len(p.offsets)} glints, p = {p.p_value:.2f}"
        )
    if result.single and result.facets:
        lines.append(f"{len(result.single)} glint(s) belong to none of these facets")
    return lines


def _columns(result: Glints, curve: LightCurve) -> list[str]:
    """The first glints in columns."""
    row = "{:>4} {:<24}{:>5}{:>9}{:>10}{:>7}  {:<16}{}"
    lines = [row.format("", "time", "pass", "width", "height", "sigma", "direction", "").rstrip()]
    for i in range(min(len(result.glints), LISTED)):
        number, time, stretch, width, height, sigma, lon, lat, kind = _cells(result, curve, i)
        cells = f"{number}:", time, stretch, f"{width} s", height, sigma, f"({lon}, {lat}) deg"
        lines.append(row.format(*cells, kind).rstrip())
    return lines


def _cells(result: Glints, curve: LightCurve, i: int) -> tuple[str, ...]:
    one = result.glints[i]
    lon, lat = (show(float(x), 10.0) for x in lon_lat_deg(result.seen[i].bisector))
    narrow = [] if one.resolved else ["not resolved"]
    wire = ["wire-like"] if wire_like(result, i) else []
    return (
        str(i + 1),
        _time(one, curve),
        str(one.stretch + 1),
        show(one.fwhm, one.fwhm),
        f"{one.height / one.baseline:.3g}",
        f"{one.significance:.3g}",
        lon,
        lat,
        ", ".join(narrow + wire),
    )


def _time(one: Glint, curve: LightCurve) -> str:
    """Time of the peak, in UTC if known, to the first digit of its error."""
    decimals = min(max(digits(one.t, one.t_error) - 1, 0), 3)
    if curve.epoch_jd is None:
        return f"t = {one.t:.{decimals}f} s"
    return Times.of(curve.epoch_jd, one.t).text(0, decimals)


def _where(d: Direction) -> str:
    lon, lat = lon_lat_deg(d.vector)
    longer, shorter = np.degrees(d.ellipse)
    return (
        f"({show(float(lon), shorter)}, {show(float(lat), shorter)}) deg, "
        f"90 % semi-axes {show(longer, longer)} and {show(shorter, shorter)} deg"
    )


def draw(result: Glints, gallery: Gallery) -> None:
    """The light curve with its glints, the directions on the sky, and the offsets of a panel."""
    draw_curve(result, gallery)
    if result.panel is not None:
        draw_panel(result, gallery)
    elif result.glints:
        draw_sky(result, gallery)


def draw_curve(result: Glints, gallery: Gallery) -> None:
    """Stretches with the strongest glints, with the baseline and numbered peaks."""
    level = result.baseline
    strongest = sorted(result.glints, key=lambda g: -g.significance)
    chosen = sorted(dict.fromkeys(g.stretch for g in strongest))[:MOST] or [0]
    figure = gallery.figure(7.0, 0.5 + 1.8 * len(chosen))
    unit = float(np.nanmedian(level.flux))
    for axes, i in zip(np.atleast_1d(figure.subplots(len(chosen), 1)), chosen, strict=True):
        rows = np.flatnonzero(level.stretch == i)
        rows = rows[np.argsort(result.t[rows])]
        begin = result.t[rows[0]]
        minutes = (result.t[rows] - begin) / 60.0
        axes.plot(minutes, result.flux[rows] / unit, ".", ms=2.5, color=colour(0), rasterized=True)
        axes.plot(minutes, level.flux[rows] / unit, color=FAINT, lw=1.0, label="baseline")
        for number, one in enumerate(result.glints, 1):
            if one.stretch == i:
                top = (one.baseline + one.height) / unit
                axes.annotate(
                    str(number),
                    ((one.t - begin) / 60.0, top),
                    xytext=(0, 4),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                    color=colour(1),
                )
        axes.set_ylim(top=1.15 * float(np.max(result.flux[rows])) / unit)
        axes.set_ylabel("flux ÷ median")
    figure.axes[-1].set_xlabel("time in the segment (min)")
    figure.axes[0].legend(loc="upper right")
    gallery.add(figure, "glints", "Light curve with numbered glints.", "Glints, numbered.")


def _outline(d: Direction, n: int = 181) -> np.ndarray:
    """The edge of the 90 % region, (n, 3)."""
    values, vectors = np.linalg.eigh(d.covariance)
    a, b = (np.sqrt(CHI2_90 * values[k]) * vectors[:, k] for k in (2, 1))
    turn = np.linspace(0, 2 * np.pi, n)[:, None]
    edge = d.vector + np.cos(turn) * a + np.sin(turn) * b
    return edge / np.linalg.norm(edge, axis=1, keepdims=True)


def draw_sky(result: Glints, gallery: Gallery) -> None:
    """Bisectors at the glints and the 90 % regions of the derived directions, body axes."""
    figure = gallery.figure(6.4, 3.4)
    axes = mollweide(figure)
    b = np.array([s.bisector for s in result.seen])
    x, y = place(*lon_lat_deg(b))
    axes.plot(x, y, ".", ms=5, color=DATA, label="bisectors at glints")
    known = [("facet, 90 %", f, colour(1), 1.0) for f in result.facets]
    if result.cylinder is not None:
        for sign in (1.0, -1.0):
            known.append(("cylinder's axis, 90 %", result.cylinder, colour(2), sign))
        turn = np.linspace(0, 2 * np.pi, 361)[:, None]
        first, second = across(result.cylinder.vector)
        circle = np.cos(turn) * first + np.sin(turn) * second
        draw_line(axes, circle, color=FAINT, lw=0.8, label="across the cylinder")
    labelled: set[str] = set()
    for name, d, hue, sign in known:
        label = None if name in labelled else name
        draw_line(axes, sign * _outline(d), color=hue, lw=1.3, label=label)
        x, y = place(*lon_lat_deg(sign * d.vector))
        axes.plot(x, y, "+", ms=7, color=hue)
        labelled.add(name)
    figure.legend(loc="outside lower center", ncols=3)
    gallery.add(
        figure,
        "directions",
        "Map of the bisectors at glints and of the derived directions.",
        "Body axes: inertial unless an attitude was given.",
    )


def draw_panel(result: Glints, gallery: Gallery) -> None:
    """The offset of the panel at each glint, and the height of the glints against the season."""
    p = result.panel
    assert p is not None
    figure = gallery.figure(7.0, 2.8)
    left, right = figure.subplots(1, 2)
    days = np.array([g.t for g in result.glints]) / 86400.0
    left.errorbar(
        days - days[0], np.degrees(p.offsets), np.degrees(p.errors), fmt="o", ms=4, color=colour(0)
    )
    left.axhline(np.degrees(p.mean), color=FAINT, lw=0.9, ls="--")
    left.set_xlabel("days since the first glint")
    left.set_ylabel("offset from the Sun (deg)")
    height = np.array([g.height / g.baseline for g in result.glints])
    right.plot(np.degrees(p.sun), height, "o", ms=4, color=colour(0))
    right.set_xlabel("Sun above the plane across the axis (deg)")
    right.set_ylabel("height ÷ baseline")
    right.set_ylim(0.0, 1.15 * float(height.max()))
    for axes in (left, right):
        axes.locator_params(nbins=6)
    gallery.add(
        figure,
        "panel",
        "Offset of the panel and height of the glints.",
        "Offset at each glint; height of the glints against the season.",
    )
