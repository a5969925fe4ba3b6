"""The text and figures of `lcbayes shape-match`."""

from __future__ import annotations

import numpy as np

from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import DATA, Gallery, colour
from lcbayes.inversion.separated.shape_match import REACH_MAG, Match, ShapeMatch

PANELS = 8


def assumptions(result: ShapeMatch) -> str:
    """The assumptions under which a rejection is valid."""
    surface = result.surface
    return (
        "rejected are shapes with this surface on all facets (diffuse "
        f"{surface.r_diff:g}, specular {surface.r_spec:g}, exponent {surface.exponent:g}), whether "
        "their orientation is random at every point or they spin about a fixed axis; another "
        "surface may reject the true shape, and a stabilised body is not tested"
    )


def words(result: ShapeMatch) -> list[str]:
    """The result as lines of text, without the verdict."""
    first, *rest = remarks(result)
    return [first, *(_line(m, result) for m in result.matches), *rest]


def _line(m: Match, result: ShapeMatch) -> str:
    return (
        f"{m.name:14s} p = {m.p_value:.3f}  {_verdict(m, result)}  (Kolmogorov-Smirnov "
        f"{m.p_kolmogorov:.3f}, energy distance {m.p_energy:.3f}; spin about a fixed axis "
        f"{m.p_fixed_axis:.3f})"
    )


def _verdict(m: Match, result: ShapeMatch) -> str:
    return "consistent" if m.p_value >= result.level else "rejected"


def table(result: ShapeMatch) -> Listing:
    """A row for each candidate."""
    rows = []
    for m in result.matches:
        values = (m.p_value, m.p_kolmogorov, m.p_energy, m.p_fixed_axis)
        rows.append((m.name, _verdict(m, result), *(f"{p:.3f}" for p in values)))
    tests = ("p, Kolmogorov–Smirnov", "p, energy distance", "p, spin about a fixed axis")
    heads = ("shape", "verdict", "p-value", *tests)
    return Listing("candidates", heads, rows)


def remarks(result: ShapeMatch) -> list[str]:
    """What the text says besides the candidates."""
    faint = f", {result.n_faint} below their noise left out" if result.n_faint else ""
    taken = f", one in {result.stride} taken" if result.stride > 1 else ""
    lines = [
        f"{result.n_obs} points{faint}{taken}: {len(result.phase)} used, phase angles "
        f"{np.degrees(result.phase.min()):.0f} to {np.degrees(result.phase.max()):.0f} deg"
    ]
    lines.append(assumptions(result))
    if result.reasons:
        return lines
    left = [m.name for m in result.consistent]
    if len(left) > 1:
        lines.append(f"the data do not distinguish {' and '.join(left)}")
    elif left:
        lines.append(f"of the candidates only {left[0]} is consistent with the data")
    else:
        lines.append("no candidate has this distribution: another shape, or another surface")
    return lines


def draw(result: ShapeMatch, gallery: Gallery) -> None:
    """The observations on top of the distribution of each candidate."""
    shown = [m for m in result.matches if len(m.phase)][:PANELS]
    columns = min(4, len(shown))
    rows = -(-len(shown) // columns)
    figure = gallery.figure(1.0 + 1.9 * columns, 0.8 + 2.0 * rows)
    grid = np.atleast_2d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False))
    for k, axes in enumerate(grid.ravel()):
        if k >= len(shown):
            axes.set_visible(False)
            continue
        m = shown[k]
        axes.plot(
            np.degrees(m.phase),
            m.magnitude,
            ".",
            ms=1.6,
            alpha=0.35,
            mew=0,
            color=colour(0 if m.p_value >= result.level else 1),
            rasterized=True,
            label="_",
        )
        axes.plot(np.degrees(result.phase), result.magnitude, ".", ms=4.0, mew=0, color=DATA)
        axes.set_title(f"{m.name}, p = {m.p_value:.2g}", loc="left")
        axes.set_ylim(REACH_MAG, -REACH_MAG)
        axes.locator_params(axis="x", nbins=4)
        if k + columns >= len(shown):
            axes.set_xlabel("phase angle (deg)")
            axes.tick_params(labelbottom=True)
    figure.supylabel("magnitude at unit distance − median (mag)", fontsize=9)
    for hue, name in (
        (colour(0), "candidate, consistent"),
        (colour(1), "candidate, rejected"),
        (DATA, "observed"),
    ):
        grid[0, 0].plot([], [], ".", ms=6, color=hue, label=name)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    gallery.add(
        figure,
        "distributions",
        "Brightness over phase angle, observed and of every candidate.",
        "Brightness over phase angle, observed (dark) and of each candidate turned at random; a "
        "candidate is rejected if the two distributions differ.",
    )
