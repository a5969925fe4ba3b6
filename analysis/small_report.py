"""The page of a result without a posterior: verdict, text and figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lcbayes.analysis.pages import environment
from lcbayes.analysis.style import Gallery, drawing
from lcbayes.core.version import installed_version

if TYPE_CHECKING:
    from lcbayes.results.result import Result


@dataclass(frozen=True)
class Listing:
    """A table of the page: its name as a file, heads, and cells of each row as text."""

    name: str
    heads: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]


UNTRUSTED = "NOT to be trusted"


def write_page(
    folder: Path,
    result: Result,
    draw: Callable[[Gallery], None],
    refused: str = UNTRUSTED,
    explored: Any = None,
    listing: tuple[Listing, list[str]] | None = None,
) -> None:
    """Write ``report.html`` and ``figures/`` of a result without a posterior.

    Parameters
    ----------
    folder : folder that holds the data
    draw : function that adds its figures to the given gallery
    refused : heading of the reasons, if there are any
    explored : data of the interactive light curve, from `explore_curve.payload`
    listing : a table and remarks on it, in place of the lines of text
    """
    figures = folder / "figures"
    figures.mkdir()
    with drawing():
        gallery = Gallery(figures)
        draw(gallery)
    content = result.content
    page = (
        environment()
        .get_template("small.html.j2")
        .render(
            title=Path(str(content.get("curve", ""))).name or result.task,
            what=result.task.replace("-", " "),
            refused=refused[:1].upper() + refused[1:],
            content=content | {"reasons": [reason.text for reason in result.reasons]},
            lines=result.lines(),
            listing=listing,
            images=gallery.images,
            explored=explored,
            version=installed_version(),
        )
    )
    (folder / "report.html").write_text(page, encoding="utf-8")
