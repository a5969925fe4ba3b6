"""Result of `lcbayes.shape_match`."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

from lcbayes.analysis import shape_match_report
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import Gallery
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.separated.shape_match import ShapeMatch, Surface
from lcbayes.results.content import Verdict
from lcbayes.tasks.deterministic import CurveContent, DeterministicResult, about, figure_of

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


class ShapeContent(TypedDict):
    """The comparison with one shape."""

    name: str
    p_value: float
    p_kolmogorov: float
    p_energy: float
    p_fixed_axis: float
    kolmogorov: float
    energy: float
    excess: float


class Asked(TypedDict):
    """The options of a shape match."""

    seed: int
    surface: dict[str, float]


class Numbers(TypedDict):
    """Numbers of a shape match; ``consistent`` are names of candidates."""

    n_obs: int
    n_faint_left_out: int
    n_used: int
    points_per_independent_one: float
    level: float
    assumptions: Any
    consistent: list[str]
    candidates: list[ShapeContent]


class ShapeMatchContent(Verdict, CurveContent, Asked, Numbers):
    """Content of the summary of `lcbayes.shape_match`."""


class ShapeMatchResult(DeterministicResult[ShapeMatch, ShapeMatchContent]):
    """The p-value of each candidate shape.

    Attributes
    ----------
    data : lcbayes.inversion.separated.shape_match.ShapeMatch
    """

    task = "shape-match"

    def __init__(self, matched: ShapeMatch, curve: LightCurve, surface: Surface, seed: int) -> None:
        asked: Asked = {"seed": seed, "surface": vars(surface)}
        content = {**about(curve), **asked, **_numbers(matched)}
        super().__init__(matched, content, matched.reasons)

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

    def listing(self) -> tuple[Listing, list[str]]:
        return shape_match_report.table(self.data), shape_match_report.remarks(self.data)

    def draw(self, gallery: Gallery) -> None:
        shape_match_report.draw(self.data, gallery)

    def plot_distributions(self) -> Figure:
        """Brightness against phase angle, observed and for each candidate."""
        return figure_of(shape_match_report.draw, self.data)


def _numbers(result: ShapeMatch) -> Numbers:
    return {
        "n_obs": result.n_obs,
        "n_faint_left_out": result.n_faint,
        "n_used": len(result.phase),
        "points_per_independent_one": result.correlation,
        "level": result.level,
        "assumptions": shape_match_report.assumptions(result),
        "consistent": [m.name for m in result.consistent],
        "candidates": [
            {
                "name": m.name,
                "p_value": m.p_value,
                "p_kolmogorov": m.p_kolmogorov,
                "p_energy": m.p_energy,
                "p_fixed_axis": m.p_fixed_axis,
                "kolmogorov": m.kolmogorov,
                "energy": m.energy,
                "excess": m.excess,
            }
            for m in result.matches
        ],
    }
