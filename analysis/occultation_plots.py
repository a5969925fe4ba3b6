"""Outlines of an asteroid over the chords of occultations, at the widths of journals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.asteroid_plots import MM, ONE_COLUMN_MM, SMALL_PRINT, TWO_COLUMNS_MM
from lcbayes.analysis.style import DATA, FAINT, Gallery, colour

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Panel:
    """One solution at one event; lengths in km, x to the west and y to the north.

    Attributes
    ----------
    chords, negative : (C, 2, 2), (G, 2, 2)
        Ends of positive and negative chords.
    inside : (C, 2) bool
        Whether each end lies in the 90 % band of the limb.
    middle : (2,)
    angle, radii : (A,), (3, A)
        Outline of the convex bodies about ``middle`` at 5, 50 and 95 %.
    limb : (2, A)
        Limb at 5 and 95 %, with relief over the convex bodies.
    """

    title: str
    chords: Floats
    negative: Floats
    inside: NDArray[np.bool_]
    middle: Floats
    angle: Floats
    radii: Floats
    limb: Floats


def draw_outlines(panels: Sequence[Sequence[Panel]], gallery: Gallery) -> None:
    """Each event as a row and each solution as a column, 88 and 180 mm wide."""
    import matplotlib

    across = max(len(row) for row in panels)
    for name, width in (("1-column", ONE_COLUMN_MM), ("2-columns", TWO_COLUMNS_MM)):
        columns = 1 if name == "1-column" else across
        flat = [panel for row in panels for panel in row]
        rows = -(-len(flat) // columns)
        with matplotlib.rc_context(SMALL_PRINT):
            figure = gallery.figure(width * MM, rows * min(width / columns, 92.0) * MM)
            axes = figure.subplots(rows, columns, squeeze=False)
            for one in axes.flat[len(flat) :]:
                one.set_visible(False)
            for one, panel in zip(axes.flat, flat, strict=False):
                _draw(one, panel)
            alt = "Outlines of the posterior over the chords of the occultation."
            caption = (
                "Chords (lines) and outlines from light curves: median and 90 % band of the convex "
                "bodies (dark), and 90 % band of the limb, which has relief (light). Only size "
                "and place are fitted to the chords. Ends in orange lie outside; dashed "
                f"lines are negative chords. North is up, east is left; {width:.0f} mm wide."
            )
            gallery.add(figure, f"outlines-{name}", alt, caption)


def _draw(axes: Any, panel: Panel) -> None:
    toward = np.append(panel.angle, panel.angle[0])
    low, median, high = (np.append(r, r[0]) for r in panel.radii)
    lowest, highest = (np.append(r, r[0]) for r in panel.limb)
    cos, sin = np.cos(toward), np.sin(toward)
    for inner, outer, alpha in ((lowest, highest, 0.15), (low, high, 0.25)):
        axes.fill(
            np.concatenate([outer * cos, (inner * cos)[::-1]]),
            np.concatenate([outer * sin, (inner * sin)[::-1]]),
            color=colour(0),
            alpha=alpha,
            lw=0,
        )
    axes.plot(median * cos, median * sin, color=colour(0), lw=0.9)
    reach = 1.1 * max(float(highest.max()), float(np.abs(panel.chords - panel.middle).max()))
    for chord, inside in zip(panel.chords - panel.middle, panel.inside, strict=True):
        axes.plot(*chord.T, color=FAINT, lw=0.6)
        for end, within in zip(chord, inside, strict=True):
            axes.plot(*end, ".", ms=3.0, color=DATA if within else colour(1))
    for chord in panel.negative - panel.middle:
        step = chord[1] - chord[0]
        line = chord.mean(axis=0) + np.outer([-3.0, 3.0], step / np.linalg.norm(step) * reach)
        axes.plot(*line.T, "--", color=FAINT, lw=0.7)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)
    axes.set_aspect("equal")
    axes.set_title(panel.title)
    axes.set_xlabel("west (km)")
    axes.set_ylabel("north (km)")
