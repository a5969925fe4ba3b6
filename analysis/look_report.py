"""The text, figures and page of `lcbayes look`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.analysis.numerals import FRAMES, duration, show
from lcbayes.analysis.pages import environment
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import DATA, FAINT, Gallery, colour, drawing
from lcbayes.core.constants import DAY_S, HOUR_S
from lcbayes.core.errors import InputError
from lcbayes.core.version import installed_version
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.times import date
from lcbayes.inversion.spin.candidates import Candidates

if TYPE_CHECKING:
    from lcbayes.results.result import Result

PANELS = 12
FEW = 5  # points below which a pass has no panel of its own
SMALL = 40  # points above which a line joins those of a pass
TWO = 2.0  # turns shown in a folded curve


def words(content: Mapping[str, Any]) -> list[str]:
    """The result as lines of text."""
    lines = [f"{label:12s} {text}" for label, text in facts(content)]
    lines += [f"{'':12s} {note}" for note in content["notes"]]
    lines.append("")
    lines += [
        f"{'periods':12s} {line}" if not i else f"{'':12s} {line}"
        for i, line in enumerate(period_words(content["periods"]))
    ]
    lines.append("")
    suits = [one for one in content["commands"] if one["suits"]]
    others = [one for one in content["commands"] if not one["suits"]]
    lines.append("what could be asked (cost: " + content["cost_basis"] + ")")
    for one in suits:
        lines += [
            f"  {one['command']}",
            f"      {one['answers']}; {rough(one['cost_s'])}; {one['why']}",
        ]
    for one in others:
        task = one["command"].split()[1]
        lines.append(f"  not {task} ({one['answers']}): {one['why']}")
    return lines


def facts(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the file holds, as pairs of label and text."""
    return [
        ("read as", content["format"] or "arrays"),
        ("points", _points(content)),
        ("time", _time(content)),
        *(
            (label, ", ".join(f"{name} ({n})" for name, n in list(content[label].items())[:8]))
            for label in ("sites", "bands")
            if content[label]
        ),
        ("brightness", _brightness(content)),
        ("errors", _errors(content)),
        ("geometry", _geometry(content)),
    ]


def _points(content: Mapping[str, Any]) -> str:
    n, passes, curves = content["n_obs"], content["n_passes"], content["n_curves"]
    text = f"{n} in {passes} pass{'es' * (passes > 1)} or night{'s' * (passes > 1)}"
    if curves > 1:
        text += f" and {curves} curves"
    if free := content["curves_of_unknown_scale"]:
        text += f" ({free} of unknown scale)"
    return text


def _time(content: Mapping[str, Any]) -> str:
    clock = content["span_s"] < 20 * 86400
    span = duration(content["span_s"])
    if content["first_jd"] is not None:
        span += f", {date(content['first_jd'], clock)} to {date(content['last_jd'], clock)} UTC"
    parts = [span, f"longest pass {duration(content['longest_pass_s'])}"]
    if content["cadence_s"] is not None:
        parts.append(f"a point every {duration(content['cadence_s'])} (median)")
    return "; ".join(parts)


def _brightness(content: Mapping[str, Any]) -> str:
    name = {"mag": "magnitudes", "flux": "fluxes"}[content["kind"]]
    low, high = content["brightness_range"]
    spread = abs(high - low)
    return f"{name} {show(low, spread / 20)} to {show(high, spread / 20)}"


def _errors(content: Mapping[str, Any]) -> str:
    errors = content["errors"]
    unit = " mag" if content["kind"] == "mag" else ""
    scatter = ""
    if errors["scatter"] is not None:
        size = (
            f"{show(errors['scatter'], errors['scatter'] / 5)} mag"
            if unit
            else f"{100 * errors['scatter']:.2g} % of the flux"
        )
        scatter = f"neighbouring points scatter by {size}"
    if errors["given"]:
        given = f"given, median {show(errors['median'], errors['median'] / 10)}{unit}"
        return f"{given}; {scatter}" if scatter else given
    return f"not given; {scatter or 'too few points to estimate them'}"


def _geometry(content: Mapping[str, Any]) -> str:
    if not content["geometry"]:
        return "none: no directions to Sun and observer"
    low, high = content["phase_angle_range_deg"]
    text = (
        f"phase angle {low:.1f}° to {high:.1f}°, {FRAMES.get(content['frame'], content['frame'])}"
    )
    if content["range_km"]:
        near, far = content["range_km"]
        text += f", range {near:.0f} to {far:.0f} km" if far < 1e6 else ", range known"
    return text + (", orbit known" if content["orbit"] else "")


def period_words(periods: Mapping[str, Any] | None) -> list[str]:
    """What is known about periods."""
    before, after = period_remarks(periods)
    kind, series = _fitted(periods)
    lines = [
        f"{period}: {kind} explains {explained} % of χ², {cycles} cycles in the {series}"
        f"{f', {role}' * bool(role)}"
        for period, explained, cycles, role in _candidates(periods)
    ]
    return before + lines + after


def period_table(periods: Mapping[str, Any] | None) -> Listing | None:
    """A row for each candidate; None if no period stands out."""
    kind, series = _fitted(periods)
    heads = ("period", f"{kind} explains (% of χ²)", f"cycles in the {series}", "role")
    rows = [(*cells, role or "–") for *cells, role in _candidates(periods)]
    return Listing("periods", heads, rows) if rows else None


def _fitted(periods: Mapping[str, Any] | None) -> tuple[str, str]:
    """What was fitted at each period, and to what."""
    joined = periods is not None and periods["nights_joined"]
    return ("a Fourier series", "season") if joined else ("a sinusoid", "longest pass")


def _candidates(periods: Mapping[str, Any] | None) -> list[tuple[str, ...]]:
    """Period, part of χ², cycles and role of each candidate that stands out."""
    if periods is None or not periods["significant"]:
        return []
    return [
        (
            _period(one["period_s"]),
            f"{100 * one['explained']:.0f}",
            f"{one['cycles']:.1f}",
            _role(one),
        )
        for one in periods["listed"]
    ]


def period_remarks(periods: Mapping[str, Any] | None) -> tuple[list[str], list[str]]:
    """What is said before the candidates, and after them."""
    if periods is None:
        return ["not searched: no pass has 30 points, and no month either"], []
    alarm = periods["false_alarm_probability"]
    searched = (
        f"searched from {_period(periods['shortest_searched_s'])} to "
        f"{_period(periods['longest_searched_s'])}"
        + (", nights joined" if periods["nights_joined"] else "")
    )
    if not periods["significant"]:
        none = f"none stands out ({searched}; noise has such a peak with probability {alarm:.2g})"
        return [none], periods["notes"]
    if periods["nights_joined"]:
        after = ["gaps between nights cause aliases: the first need not be the true period"]
    else:
        after = [c["words"] for c in periods["conditions"] if not c["met"]]
        after.append(
            "a body often repeats its brightness twice in a rotation, so the rotation may take "
            "twice as long"
        )
    return [f"{searched}; false-alarm probability {alarm:.2g}"], after + periods["notes"]


def _role(one: Mapping[str, Any]) -> str:
    if not one["of_base"]:
        return ""
    return "repeats" if one["of_base"] == 1 else f"harmonic {one['of_base']}"


def _period(seconds: float) -> str:
    """A period in a convenient unit with six digits."""
    for unit, size in (("d", 2 * 86400.0), ("h", 2 * 3600.0), ("min", 600.0)):
        if seconds >= size:
            return f"{seconds / {'d': 86400.0, 'h': 3600.0, 'min': 60.0}[unit]:.6g} {unit}"
    return f"{seconds:.6g} s"


def rough(seconds: float | None) -> str:
    """A rough duration: one digit."""
    if seconds is None or not np.isfinite(seconds):
        return ""
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("min", 60.0), ("s", 1.0)):
        if seconds >= 2 * size or size == 1.0:
            return f"about {float(f'{seconds / size:.1g}'):g} {unit}"
    return ""


def write_page(
    folder: Path, result: Result, draw: Callable[[Gallery], None], explored: Any
) -> None:
    """Write ``report.html`` and ``figures/`` of a look; ``explored`` is its interactive curve."""
    figures = folder / "figures"
    figures.mkdir()
    with drawing():
        gallery = Gallery(figures)
        draw(gallery)
    content = result.content
    commands = [one | {"cost": rough(one["cost_s"])} for one in content["commands"]]
    values = {
        "title": Path(str(content["curve"])).name or "a light curve",
        "content": content,
        "facts": facts(content),
        "periods": period_table(content["periods"]),
        "said": period_remarks(content["periods"]),
        "commands": [one for one in commands if one["suits"]],
        "others": [one for one in commands if not one["suits"]],
        "images": gallery.images,
        "explored": explored,
        "version": installed_version(),
    }
    page = environment().get_template("look.html.j2").render(values)
    (folder / "report.html").write_text(page, encoding="utf-8")


def draw(
    curve: LightCurve, passes: list[Any], candidates: Candidates | None, gallery: Gallery
) -> None:
    """All figures."""
    draw_passes(curve, passes, gallery)
    if not curve.brightness_only:
        draw_phase_angle(curve, passes, gallery)
    if candidates is not None:
        draw_periodogram(candidates, gallery)
        if candidates.best is not None:
            draw_folded(candidates, gallery)


def _scaled(curve: LightCurve) -> tuple[Any, str]:
    """Brightness as drawn, and its label."""
    if curve.kind == "mag":
        return curve.brightness, "magnitude"
    size = float(np.median(np.abs(curve.brightness))) or 1.0
    power = int(np.floor(np.log10(size)))
    if -2 <= power <= 3:
        return curve.brightness, "flux"
    return curve.brightness / 10.0**power, f"flux (10$^{{{power}}}$)"


def draw_passes(curve: LightCurve, passes: list[Any], gallery: Gallery) -> None:
    """Brightness against time: the dozen passes with most points, each with its own time axis, and
    all passes of a few points together."""
    many = [i for i, at in enumerate(passes) if at.size >= FEW]
    most = sorted(sorted(many, key=lambda i: -passes[i].size)[:PANELS])
    panels = [(passes[i], _title(curve, i, passes[i])) for i in most]
    few = [i for i, at in enumerate(passes) if at.size < FEW]
    if few:
        at = np.concatenate([passes[i] for i in few])
        together = f"{len(few)} passes of fewer than {FEW} points · {at.size} points"
        panels.append((at, together if len(few) > 1 else _title(curve, few[0], at)))
    columns = min(2, len(panels))
    rows = -(-len(panels) // columns)
    figure = gallery.figure(9.0 if columns > 1 else 8.0, 0.5 + 2.1 * rows)
    grid = np.atleast_1d(figure.subplots(rows, columns)).ravel()
    y, label = _scaled(curve)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    for axes, (at, title) in zip(grid, panels, strict=False):
        _draw_pass(axes, curve, at, y)
        axes.set_title(title, loc="left", fontsize=8.5)
    for axes in grid[: len(panels) : columns]:
        axes.set_ylabel(label)
    left = f" The {PANELS} with most points of {len(many)}." if len(many) > PANELS else ""
    left += f" Those of fewer than {FEW} points are together in one panel." if few and most else ""
    gallery.add(
        figure,
        "light-curve",
        "Light curve.",
        f"Brightness against time{', one panel for each pass or night' * bool(most)}.{left}",
    )


def _draw_pass(axes: Any, curve: LightCurve, at: Any, y: Any) -> None:
    span = float(np.ptp(curve.t[at]))
    unit, size = _unit(span)
    x = (curve.t[at] - curve.t[at[0]]) / size
    if curve.error is not None and at.size <= 300:
        error = curve.error[at] * (y[at[0]] / curve.brightness[at[0]] if y[at[0]] else 1.0)
        axes.errorbar(x, y[at], error, fmt="none", ecolor=FAINT, elinewidth=0.6)
    if at.size > SMALL and unit != "d":
        axes.plot(x, y[at], "-", color=FAINT, lw=0.5)
    axes.plot(x, y[at], "o", ms=2.2, color=DATA, rasterized=at.size > 2000)
    if curve.kind == "mag":
        axes.invert_yaxis()
    axes.set_xlabel(f"time ({unit})")


def _title(curve: LightCurve, number: int, at: Any) -> str:
    parts = [f"pass {number + 1}"]
    if curve.epoch_jd is not None:
        parts.append(date(curve.epoch_jd + float(curve.t[at[0]]) / 86400, clock=True))
    if site := str(curve.site[at[0]]):
        parts.append(site)
    return " · ".join([*parts, f"{at.size} point{'s' * (at.size > 1)}"])


def draw_phase_angle(curve: LightCurve, passes: list[Any], gallery: Gallery) -> None:
    """Brightness against the phase angle, scaled to unit distance if the ranges are known."""
    figure = gallery.figure(6.4, 3.4)
    axes = figure.subplots()
    y, label = _scaled(curve)
    if curve.range_km is not None:
        factor = curve.range_km / float(np.median(curve.range_km))
        y = y - 5 * np.log10(factor) if curve.kind == "mag" else y * factor**2
        label += ", scaled to the median range"
    angle = np.degrees(curve.phase_angle)
    for number, at in enumerate(passes):
        hue = colour(number) if len(passes) <= 7 else DATA
        name = f"pass {number + 1}" if 1 < len(passes) <= 7 else None
        axes.plot(angle[at], y[at], ".", ms=3, alpha=0.7, color=hue, label=name, rasterized=True)
    if curve.kind == "mag":
        axes.invert_yaxis()
    axes.set_xlabel("phase angle (deg)")
    axes.set_ylabel(label)
    if 1 < len(passes) <= 7:
        axes.legend(loc="best", ncols=2)
    gallery.add(
        figure,
        "phase-angle",
        "Brightness against the phase angle.",
        "Brightness against the phase angle, the angle Sun–object–observer.",
    )


def draw_periodogram(candidates: Candidates, gallery: Gallery) -> None:
    """Part of χ² explained against the period, with the candidates."""
    figure = gallery.figure(6.4, 2.8)
    axes = figure.subplots()
    unit, size = _unit(1.0 / float(candidates.spin.grid[0]))
    axes.plot(1.0 / candidates.spin.grid / size, candidates.spin.power, color=colour(0), lw=0.7)
    if candidates.best is not None:
        for i, one in enumerate(candidates.listed):
            label = None if i else "candidates"
            axes.axvline(one.period_s / size, color=colour(1), lw=0.8, ls=":", label=label)
        axes.legend(loc="upper right")
    axes.set_xscale("log")
    axes.set_ylim(0, 1.12 * float(candidates.spin.power.max()))
    axes.set_xlabel(f"period ({unit})")
    axes.set_ylabel("part of χ² explained")
    axes.xaxis.set_major_formatter("{x:g}")
    gallery.add(
        figure,
        "periodogram",
        "Part of chi-squared explained against the period.",
        "Periodogram of a sinusoid with a free phase and level in each "
        + ("season." if candidates.joined else "pass."),
    )


def _unit(longest: float) -> tuple[str, float]:
    """The unit of a time axis of that length (s), and its seconds."""
    units = [("d", DAY_S, 3 * DAY_S), ("h", HOUR_S, 3 * HOUR_S), ("min", 60.0, 600.0)]
    return next(((name, size) for name, size, least in units if longest > least), ("s", 1.0))


def draw_folded(candidates: Candidates, gallery: Gallery) -> None:
    """The points, divided by their trend, folded with the best period and with twice that."""
    if candidates.best is None:
        raise InputError("no period was found to fold the points with; the summary says why")
    figure = gallery.figure(8.0, 3.0)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, period in zip(panels, (candidates.best, 2 * candidates.best), strict=True):
        for i, one in enumerate(candidates.spin.passes):
            for turn in range(int(TWO)):
                x = (one.t - one.t[0]) / period % 1.0 + turn
                hue = colour(i) if len(candidates.spin.passes) <= 7 else DATA
                axes.plot(x, 1 + one.y, ".", ms=2.5, alpha=0.6, color=hue, rasterized=True)
        axes.set_xlim(0, TWO)
        axes.set_title(f"period {_period(period)}", loc="left")
        axes.set_xlabel("cycles")
    panels[0].set_ylabel("flux ÷ its trend")
    note = "" if candidates.joined else " Phases of different passes are not aligned."
    gallery.add(
        figure,
        "folded",
        "The light curve folded with two periods.",
        f"The points folded with the best period and with twice that, two cycles.{note}",
    )
