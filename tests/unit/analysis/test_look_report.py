"""Panels of the page of `lcbayes look`."""

import numpy as np
import pytest

from lcbayes.analysis import style
from lcbayes.analysis.look_report import FEW, PANELS, draw_passes
from lcbayes.data.lightcurve import LightCurve
from lcbayes.tasks.look.description import describe


def panels(sizes: list[int]) -> dict[str, int]:
    """Titles and numbers of points of the panels of nights of these sizes."""
    t = np.concatenate([1e6 * k + 600.0 * np.arange(n, dtype=float) for k, n in enumerate(sizes)])
    side = np.tile([1.0, 0.0, 0.0], (len(t), 1))
    curve = LightCurve(
        t=t,
        brightness=1.0 + np.arange(len(t), dtype=float),
        error=None,
        sun=side,
        obs=side,
        kind="flux",
    )
    passes = describe(curve).passes
    (figure,) = style.figures(lambda gallery: draw_passes(curve, passes, gallery))
    shown = [axes for axes in figure.axes if axes.get_visible()]
    return {axes.get_title("left"): len(axes.lines[-1].get_xdata()) for axes in shown}


def test_nights_of_few_points_share_a_panel():
    found = panels([20, FEW - 1, 30, 1, 2])
    few = f"3 passes of fewer than {FEW} points · {FEW + 2} points"
    assert list(found.values()) == [20, 30, FEW + 2]
    assert list(found)[-1] == few


def test_a_single_night_of_few_points_keeps_its_title():
    assert panels([20, 1, 30]) == {
        "pass 1 · 20 points": 20,
        "pass 3 · 30 points": 30,
        "pass 2 · 1 point": 1,
    }


@pytest.mark.parametrize("sizes", [[1], [2, 3, 1]])
def test_survey_points_alone_have_one_panel(sizes):
    assert list(panels(sizes).values()) == [sum(sizes)]


def test_the_passes_with_most_points_have_panels():
    sizes = [FEW + k for k in range(PANELS + 3)]
    assert list(panels(sizes).values()) == sizes[3:]
