"""Result of `lcbayes.shape_match`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from lcbayes.analysis import shape_match_report
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.shape_match import ShapeMatch, Surface
from lcbayes.tasks.deterministic import DeterministicResult, about, figure_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

CANDIDATES = (
    "name",
    "p_value",
    "p_kolmogorov",
    "p_energy",
    "p_fixed_axis",
    "kolmogorov",
    "energy",
    "excess",
)


class ShapeMatchResult(DeterministicResult):
    """The p-value of each candidate shape.

    Attributes
    ----------
    data : lcbayes.inversion.separated.shape_match.ShapeMatch
    """

    task = "shape-match"

    def __init__(self, found: ShapeMatch, curve: LightCurve, surface: Surface, seed: int) -> None:
        content = about(curve) | {"seed": seed, "surface": vars(surface)} | _numbers(found)
        super().__init__(found, content, found.reasons)

    def summary(self) -> pd.DataFrame:
        """One row per candidate, highest p-value first."""
        import pandas as pd

        rows = pd.DataFrame(self.content["candidates"], columns=list(CANDIDATES))
        rows.insert(1, "consistent", rows["name"].isin(self.content["consistent"]))
        return rows.rename(columns={"name": "shape"})

    def lines(self) -> list[str]:
        return shape_match_report.words(self.data)

    def tables(self) -> dict[str, pd.DataFrame]:
        """The candidates."""
        return {"candidates": self.summary()}

    def draw(self, gallery: Gallery) -> None:
        shape_match_report.draw(self.data, gallery)

    def plot_distributions(self) -> Figure:
        """Brightness against phase angle, observed and for each candidate."""
        return figure_of(shape_match_report.draw, self.data)


def _numbers(result: ShapeMatch) -> dict[str, Any]:
    return {
        "n_obs": result.n_obs,
        "n_faint_left_out": result.n_faint,
        "n_used": len(result.phase),
        "points_per_independent_one": result.correlation,
        "level": result.level,
        "assumptions": shape_match_report.assumptions(result),
        "consistent": [m.name for m in result.consistent],
        "candidates": [{k: getattr(m, k) for k in CANDIDATES} for m in result.matches],
    }
