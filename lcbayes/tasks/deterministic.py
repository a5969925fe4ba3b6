"""Results of deterministic methods: data, a verdict and figures, without a posterior."""

# pyright: reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false, reportUnknownVariableType=false
# (pandas, xarray, ArviZ and JAX come without complete types)

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypedDict

from lcbayes.analysis import explore_curve, small_report
from lcbayes.analysis.style import Gallery, figures
from lcbayes.core.reasons import Finding
from lcbayes.data.lightcurve import LightCurve
from lcbayes.results.reasons import reasons
from lcbayes.results.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class CurveContent(TypedDict):
    """The light curve of a deterministic method."""

    curve: str
    frame: str
    points_in_penumbra_left_out: int


class DeterministicResult[D, C: Mapping[str, object]](Result[C]):
    """Result of a method that does not sample a posterior.

    Parameters
    ----------
    data : output of the method
    content : content of ``summary.json`` besides the verdict
    findings : findings against the result; empty if it is trusted

    Attributes
    ----------
    refused : heading of the reasons on the page
    """

    refused: ClassVar[str] = small_report.UNTRUSTED

    def __init__(
        self, data: D, content: Mapping[str, object], findings: Iterable[Finding] = ()
    ) -> None:
        super().__init__(content, reasons(findings), {})
        self._data = data

    @property
    def data(self) -> D:
        """The output of the method, as arrays."""
        return self._data

    @abstractmethod
    def draw(self, gallery: Gallery) -> None:
        """Draw the figures of the report."""

    def write_page(self, folder: Path) -> None:
        explored, listing = self.explored(), self.listing()
        small_report.write_page(folder, self, self.draw, self.refused, explored, listing)

    def listing(self) -> tuple[small_report.Listing, list[str]] | None:
        """A table for the page and remarks on it; None: the page shows `lines`."""
        return None

    def explored(self) -> Any:
        """The light curve and candidate periods for the interactive part of the page, or None."""
        known = isinstance(self.source, LightCurve)
        return explore_curve.payload(self.source, self.candidates()) if known else None

    def candidates(self) -> list[tuple[str, float]]:
        """Labels and periods (s) at which the page folds the light curve, the best first."""
        return []


def about(curve: LightCurve) -> CurveContent:
    """The entries of ``summary.json`` about the light curve."""
    return {
        "curve": curve.source.get("file", ""),
        "frame": curve.frame,
        "points_in_penumbra_left_out": int(curve.source.get("in_penumbra", 0)),
    }


def figure_of(draw: Callable[..., object], *what: Any) -> Figure:
    """The figure that ``draw(*what, gallery)`` adds to a gallery."""
    return figures(lambda gallery: draw(*what, gallery))[-1]
