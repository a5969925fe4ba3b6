"""What a search of all usual periods of an asteroid needs, and what it searches.

The options of the command line take the range from here, so this imports no heavy library.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from lcbayes.core.constants import DAY_S

if TYPE_CHECKING:
    from lcbayes.data.lightcurve import LightCurve

PERIODS_H = (2.0, 1000.0)  # searched if no range is given
FEWEST = 10  # points; the phase law and the shape have some twenty coefficients with priors
MOST_POINTS, SHORTEST_S = 2000, 200 * DAY_S


def unsuited(curve: LightCurve) -> str:
    """Why a light curve has too few or too many points, or is too short; empty if it suits."""
    if curve.n_obs < FEWEST:
        return f"there are {curve.n_obs} points; a period needs at least {FEWEST}"
    if curve.n_obs > MOST_POINTS:
        return (
            f"there are {curve.n_obs} points, and at most {MOST_POINTS} are sparse; use "
            "lcbayes scan, or average them (--average)"
        )
    span = float(curve.t.max() - curve.t.min())
    if not span > SHORTEST_S:
        return (
            f"the points cover {span / DAY_S:.3g} days, and sparse points need more than "
            f"{SHORTEST_S / DAY_S:.0f}; use lcbayes scan"
        )
    return ""
