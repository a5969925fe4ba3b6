"""A plot of a light curve as it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from lcbayes.core.constants import DAY_S, HOUR_S, MINUTE_S

if TYPE_CHECKING:
    from lcbayes.data.lightcurve import LightCurve


def plot(curve: LightCurve, ax: Any = None) -> Any:
    """Brightness against time since the first point; see `LightCurve.plot`."""
    if ax is None:
        from lcbayes.core.figures import new_figure

        ax = new_figure(8.0, 3.6).subplots()
    span = float(np.ptp(curve.t))
    scales = (("d", DAY_S), ("h", HOUR_S), ("min", MINUTE_S))
    unit, size = next(((name, one) for name, one in scales if span >= 2.5 * one), ("s", 1.0))
    x = (curve.t - curve.t.min()) / size
    names = np.char.add(np.char.add(curve.site, " "), curve.band)
    for name in np.unique(names):
        at = names == name
        error = None if curve.error is None else curve.error[at]
        ax.errorbar(x[at], curve.brightness[at], error, fmt=".", ms=4, lw=0.6, label=name.strip())
    if np.unique(names).size > 1:
        ax.legend()
    if curve.kind == "mag":
        ax.invert_yaxis()
    ax.set_xlabel(f"time ({unit})")
    ax.set_ylabel("magnitude" if curve.kind == "mag" else "flux")
    return ax.figure
