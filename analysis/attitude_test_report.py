"""The text and figures of `lcbayes attitude-test`."""

from __future__ import annotations

import textwrap

import numpy as np

from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import FAINT, Gallery, colour
from lcbayes.inversion.separated.attitude_test import MIN_PAIRS, MIN_POINTS, AttitudeTest, Verdict


def words(result: AttitudeTest) -> list[str]:
    """The result as lines of text, without the verdict."""
    first, *rest = remarks(result)
    return [first, *(_line(v, result) for v in result.verdicts if v.tested), *rest]


def table(result: AttitudeTest) -> Listing:
    """A row for each law that was tested."""
    rows = [
        (
            v.name,
            "rejected" if result.rejected(v) else "consistent",
            f"{v.p_value:.3f}",
            str(v.n_pairs),
            str(v.n_points),
            ", ".join(v.same_as) or "–",
        )
        for v in result.verdicts
        if v.tested
    ]
    heads = ("attitude law", "verdict", "p-value", "pairs", "points", "same directions here as")
    return Listing("laws", heads, rows)


def remarks(result: AttitudeTest) -> list[str]:
    """What the text says besides the laws that were tested."""
    flashes = f", {result.n_glints} more left out as glints" if result.n_glints else ""
    lines = [f"{result.n_obs} points{flashes}; laws are rejected below p = {result.level:g}"]
    lines += _not_tested(result)
    held = [v for v in result.verdicts if v.tested and not result.rejected(v)]
    tested = [v for v in result.verdicts if v.tested]
    if len(held) > 1:
        lines.append(
            f"{len(held)} of {len(tested)} laws are consistent with the data, which do not "
            "distinguish them; their order is not evidence"
        )
    elif len(held) == 1:
        lines.append(
            f"{held[0].name} alone of {len(tested)} laws is not rejected; another law, not in the "
            "list, may hold as well"
        )
    elif tested:
        lines.append("every law that could be tested is rejected")
    return lines


def _line(v: Verdict, result: AttitudeTest) -> str:
    verdict = "rejected" if result.rejected(v) else "consistent"
    same = f"; the same here: {', '.join(v.same_as)}" if v.same_as else ""
    return (
        f"{v.name:20s} p = {v.p_value:.3f}  {verdict}  ({v.n_pairs} pairs of {v.n_points} points"
        f"{same})"
    )


def _not_tested(result: AttitudeTest) -> list[str]:
    """Each reason why laws were not tested, with those laws."""
    names: dict[str, list[str]] = {}
    for v in result.verdicts:
        if v.sparse:
            too_few = f"fewer than {MIN_PAIRS} pairs among {MIN_POINTS} points are alike"
            some = f" ({v.n_pairs} among {v.n_points})" if v.n_pairs else ""
            names.setdefault(too_few, []).append(v.name + some)
        elif not v.tested:
            names.setdefault(v.reason, []).append(v.name)
    lines = []
    for reason, stopped in names.items():
        # already at the top, with the remedy
        why = "as said above" if any(reason in str(r) for r in result.reasons) else reason
        count = f"{len(stopped)} laws" if len(stopped) > 1 else "1 law"
        lines.append(f"{count} not tested, {why}:")
        lines += textwrap.wrap(
            ", ".join(stopped),
            92,
            initial_indent="  ",
            subsequent_indent="  ",
            break_on_hyphens=False,
        )
    return lines


def draw(result: AttitudeTest, gallery: Gallery) -> None:
    """The p-values, and the differences within pairs of the best and the worst law."""
    if any(v.tested for v in result.verdicts):
        draw_laws(result, gallery)
        draw_pairs(result, gallery)


def draw_laws(result: AttitudeTest, gallery: Gallery) -> None:
    """The p-value of each tested law."""
    tested = [v for v in result.verdicts if v.tested]
    figure = gallery.figure(6.4, 1.3 + 0.2 * len(tested))
    axes = figure.subplots()
    y = np.arange(len(tested))[::-1]
    hue = [colour(1) if result.rejected(v) else colour(0) for v in tested]
    axes.hlines(y, 1e-3, [max(v.p_value, 1.05e-3) for v in tested], color=hue, lw=1.0, alpha=0.5)
    axes.scatter([v.p_value for v in tested], y, s=22, c=hue, zorder=3)
    axes.axvline(result.level, color=FAINT, lw=0.8, ls="--")
    for name, index in (("consistent", 0), ("rejected", 1)):
        axes.scatter([], [], s=22, color=colour(index), label=name)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    axes.set_xscale("log")
    axes.set_xlim(1e-3, 1.3)
    axes.set_xticks([0.001, 0.01, 0.1, 1.0], ["0.001", "0.01", "0.1", "1"])
    axes.set_yticks(y, [v.name for v in tested])
    axes.set_ylim(-0.7, len(tested) - 0.3)
    axes.set_xlabel(f"p-value (dashed: {result.level:g}, below it a law is rejected)")
    alt = "p-value of each attitude law."
    gallery.add(figure, "laws", alt, f"{alt} No p-value is below 1/(1 + number of bodies).")


def draw_pairs(result: AttitudeTest, gallery: Gallery) -> None:
    """Differences of flux within the pairs of the best and the worst law."""
    tested = [v for v in result.verdicts if v.tested]
    shown = [tested[0], tested[-1]] if len(tested) > 1 else tested
    figure = gallery.figure(3.4 * len(shown), 3.0)
    for k, (v, axes) in enumerate(
        zip(shown, np.atleast_1d(figure.subplots(1, len(shown), sharey=True)), strict=True)
    ):
        pairs, seen = v.pairs, result.seen
        assert pairs is not None
        size = float(np.mean(seen.flux))
        change = np.abs(seen.flux[pairs.i] - seen.flux[pairs.j]) / size
        noise = float(np.median(np.hypot(seen.error[pairs.i], seen.error[pairs.j]))) / size
        axes.plot(np.degrees(pairs.d), 100 * change, ".", ms=3.5, alpha=0.6, color=colour(k))
        axes.axhline(100 * noise, color=FAINT, lw=0.8, ls="--", label="noise of a difference")
        axes.set_title(f"{v.name}: p = {v.p_value:.3f}", loc="left")
        axes.set_xlabel("angle between directions (deg)")
        axes.set_yscale("symlog", linthresh=max(100 * noise, 0.1))
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_xlim(left=0.0)
    first = figure.axes[0]
    first.set_ylabel("difference of flux (% of the mean)")
    figure.legend(*first.get_legend_handles_labels(), loc="outside lower center")
    gallery.add(
        figure,
        "pairs",
        "Differences of flux within pairs.",
        "Differences of flux within pairs that the law makes alike.",
    )
