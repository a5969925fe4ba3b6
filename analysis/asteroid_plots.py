"""Figures of asteroids at the widths of journals: model light curves against rotational phase."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lcbayes.analysis.contents import Mode, Results
from lcbayes.analysis.shape_files import model_of_fit
from lcbayes.analysis.style import DATA, Gallery, Image, colour
from lcbayes.core.constants import DAY_S
from lcbayes.geometry.times import date

Floats = NDArray[np.float64]

MM = 1.0 / 25.4  # inches
ONE_COLUMN_MM, TWO_COLUMNS_MM = 88.0, 180.0
WIDTHS = {"1-column": (ONE_COLUMN_MM, 2, 6), "2-columns": (TWO_COLUMNS_MM, 4, 32)}  # panels
SMALL_PRINT: dict[Any, Any] = {"font.size": 7.0, "axes.titlesize": 7.0, "axes.labelsize": 7.5}
SMALL_PRINT |= {"xtick.labelsize": 6.5, "ytick.labelsize": 6.5, "legend.fontsize": 6.5}
LIGHT_CURVE = ("solution", "curve", "jd", "rotation", "observed", "model", "model_sd")


def model_curves(results: Results, mode: Mode) -> dict[str, Any] | None:
    """The model light curve of a solution at every point, and the rotation; None if unknown.

    Returns
    -------
    dict
        Columns `LIGHT_CURVE`: ``rotation`` is the rotation angle φ of ``spin.txt`` in turns, in
        [0, 1); ``model`` and ``model_sd`` are mean and sd of the brightness without noise.
    """
    model = model_of_fit(results, mode)
    if model is None or mode.curves is None or not mode.curves.sizes["curve_draw"]:
        return None
    jd = results.attrs["epoch_jd"] + results.t / DAY_S
    each = mode.curves["expected"].sel(time=results.constant["time"]).to_numpy()
    spread = each.std(axis=0, ddof=1) if len(each) > 1 else np.full(jd.size, np.nan)
    return {
        "solution": mode.index + 1,
        "curve": results.curve,
        "jd": jd,
        "rotation": model.spin.phase_deg(jd) / 360.0,
        "observed": results.brightness,
        "model": each.mean(axis=0),
        "model_sd": spread,
    }


def draw_phased(results: Results, mode: Mode, gallery: Gallery) -> list[Image]:
    """The curves with most points against the rotation, at one and two columns' width."""
    columns = model_curves(results, mode)
    if columns is None:
        return []
    images = []
    for name, (width, across, most) in WIDTHS.items():
        chosen = _fullest(results.curve, most)
        rows = -(-len(chosen) // across)
        figure = _panels(results, columns, chosen, (rows, across), width, gallery)
        caption = (
            f"Observed (black) and model (colour) flux of {len(chosen)} of "
            f"{np.unique(results.curve).size} curves of {mode.name.lower()}, each divided by its "
            f"mean, against the rotation angle of spin.txt; {width:.0f} mm wide."
        )
        title = f"model-curves-{mode.index + 1}-{name}"
        images.append(gallery.add(figure, title, "Phased light curves.", caption))
    return images


def _fullest(curve: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """The curves with most points, in their order."""
    names, counts = np.unique(curve, return_counts=True)
    return np.sort(names[np.argsort(-counts, kind="stable")[:most]])


def _panels(
    results: Results,
    columns: dict[str, Any],
    chosen: NDArray[np.int64],
    grid: tuple[int, int],
    width_mm: float,
    gallery: Gallery,
) -> Any:
    import matplotlib

    with matplotlib.rc_context(SMALL_PRINT):
        figure = gallery.figure(width_mm * MM, (12.0 + 24.0 * grid[0]) * MM)
        axes = figure.subplots(*grid, squeeze=False, sharex=True, sharey=True)
        for one in axes.flat[len(chosen) :]:
            one.set_visible(False)
        for one, curve in zip(axes.flat, chosen, strict=False):
            here = np.flatnonzero(columns["curve"] == curve)
            here = here[np.argsort(columns["rotation"][here], kind="stable")]
            x, y, model = (columns[k][here] for k in ("rotation", "observed", "model"))
            unit = np.mean(model)
            if results.is_magnitude:
                y, model = y - unit, model - unit
            else:
                y, model = y / unit, model / unit
            one.plot(x, y, ".", ms=1.8, color=DATA)
            one.plot(x, model, ".", ms=1.2, color=colour(1))
            one.set_title(date(columns["jd"][here].min()), pad=2.0)
            one.locator_params(nbins=4)
        axes[0, 0].set_xlim(0.0, 1.0)
        if results.is_magnitude:
            axes[0, 0].invert_yaxis()
        figure.supxlabel("rotation (turns)", size=7.5)
        words = "magnitude − mean" if results.is_magnitude else "flux ÷ mean"
        figure.supylabel(words, size=7.5)
    return figure
