"""The style of figures, and their inclusion in a page as vector images without external files."""

from __future__ import annotations

import base64
import io
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import quote

# Okabe & Ito 2008, safe for colour-blind readers, without yellow, which is invisible on white.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#555555")
HUES = ("blue", "red-orange", "green", "pink", "light blue", "orange", "grey")  # of the palette
DPI = 130  # of dense clouds of points in a vector image
PLAIN = " !$')*+,/:;=?@[]"  # characters that need no escape in the address of an image
_CLOUD = re.compile(r'(data:image/png;base64,\s*)([^"]+)')
_NEEDLESS = re.compile(
    "<metadata>.*?</metadata>|<!--.*?-->"
    r'|(?<=<g) id="[^"]*"'  # to which nothing refers
    "|xlink:(?=href)"
    r"|(?<=>) +(?=<)|(?<=[:;]) +(?=[a-z#\d])"  # spaces between elements and in styles
)
_PATH = re.compile(r'(?<= d=")[^"]*')
_COMMAND = re.compile(r" *([A-Za-z]) *")  # of a path
_SHAPE = re.compile(r'(?<=id=")m[0-9a-f]{10}(?=")')  # the name of a marker's shape
_MARKER = r'<use href="{}" x="([^"]*)" y="([^"]*)"{}/>'
_EQUAL_MARKERS = re.compile(
    _MARKER.format("(#m[0-9]+)", "( style=[^/]*)") + f"(?:{_MARKER.format(r'\1', r'\4')})+"
)
_DIGITS = re.compile(r"(?<![\d.])([1-9]\d*\.\d\d)\d+")
INK, FAINT, DATA = "#222222", "#8a8f98", "#1b1b1b"

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlecolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "text.color": INK,
    "figure.facecolor": "white",
    "axes.facecolor": "white",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "svg.hashsalt": "lcbayes",  # identical results give identical files
    "svg.fonttype": "path",
    "pdf.fonttype": 42,  # TrueType, which journals and editors of figures ask for
}


def colour(index: int) -> str:
    return PALETTE[index % len(PALETTE)]


def hue(index: int) -> str:
    """The name of a colour."""
    return HUES[index % len(HUES)]


@contextmanager
def drawing() -> Iterator[None]:
    """Apply the package's style to figures made in this context."""
    import matplotlib

    with matplotlib.rc_context(RC), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        yield


@dataclass(frozen=True)
class Image:
    """An image of the report: `src` is a data URI; `width` and `height` are CSS pixels."""

    name: str
    src: str
    alt: str
    caption: str
    width: int
    height: int


def _compact(svg: str) -> str:
    """A vector image for a page: one line, coordinates to 0.01 pt, clouds with 128 colours, and
    equal markers at the vertices of a path."""
    line = _DIGITS.sub(r"\1", _NEEDLESS.sub("", svg.replace("\n", " ")))
    line = _PATH.sub(lambda m: _COMMAND.sub(r"\1", m[0]), line)
    for k, name in enumerate(dict.fromkeys(_SHAPE.findall(line))):
        line = line.replace(f'"{name}"', f'"m{k}"').replace(f'"#{name}"', f'"#m{k}"')
    number = count()
    line = _EQUAL_MARKERS.sub(lambda m: _at_vertices(m, f"v{next(number)}"), line)
    return _CLOUD.sub(lambda m: m[1] + _palette(m[2]), line)


def _at_vertices(markers: re.Match[str], name: str) -> str:
    """Equal markers as one path, which takes a third of the space."""
    places = " ".join(f"{x} {y}" for x, y in re.findall(' x="(.*?)" y="(.*?)"', markers[0]))
    drawn = " ".join(f'marker-{where}="url(#{name})"' for where in ("start", "mid", "end"))
    return (
        f'<marker id="{name}" markerUnits="userSpaceOnUse" overflow="visible"{markers[4]}>'
        f'<use href="{markers[1]}"/></marker>'
        f'<path fill="none" stroke="none" d="M{places}" {drawn}/>'
    )


def _palette(code: str) -> str:
    """A PNG in base64 with a palette, a third of the size."""
    from PIL import Image as Raster

    cloud = Raster.open(io.BytesIO(base64.b64decode(code))).convert("RGBA")
    buffer = io.BytesIO()
    cloud.quantize(128, method=Raster.Quantize.FASTOCTREE).save(buffer, "PNG", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


@dataclass
class Gallery:
    """Collects the figures of a report and writes each to ``folder`` as SVG and PDF."""

    folder: Path
    images: list[Image] = field(default_factory=list)

    def figure(self, width: float, height: float) -> Any:
        """A new figure of this size in inches, drawn without a display."""
        from lcbayes.core.figures import new_figure

        return new_figure(width, height)

    def add(self, figure: Any, name: str, alt: str, caption: str = "") -> Image:
        """Save the figure as ``name``.svg and .pdf, and return it as an image for the page."""
        buffer = io.StringIO()
        # Lay out once: with a layout engine, savefig draws each file twice.
        figure.get_layout_engine().execute(figure)
        figure.set_layout_engine(None)
        figure.savefig(buffer, format="svg", dpi=DPI, metadata={"Date": None, "Creator": None})
        # the XML header is not needed in a page; single spaces make the text a quarter smaller
        text = buffer.getvalue()
        text = re.sub(r"\n\s*", "\n", text[text.index("<svg") :])
        head = '<?xml version="1.0" encoding="utf-8"?>\n'
        (self.folder / f"{name}.svg").write_text(head + text, encoding="utf-8")
        path = self.folder / f"{name}.pdf"
        figure.savefig(path, dpi=170, metadata={"CreationDate": None, "Producer": None})
        width, height = figure.get_size_inches()
        src = f"data:image/svg+xml,{quote(_compact(text), safe=PLAIN)}"
        image = Image(name, src, alt, caption, int(96 * width), int(96 * height))
        self.images.append(image)
        return image


class Sketchbook(Gallery):
    """Collects figures without writing them, so that they can be shown."""

    def __init__(self) -> None:
        super().__init__(Path())
        self.figures: list[Any] = []

    def add(self, figure: Any, name: str, alt: str, caption: str = "") -> Image:
        self.figures.append(figure)
        return Image(name, "", alt, caption, 0, 0)


def figures(draw: Callable[[Gallery], object]) -> list[Any]:
    """The Matplotlib figures that a function draws for a gallery."""
    from lcbayes.core.figures import Pictures

    book = Sketchbook()
    with drawing():
        draw(book)
    return Pictures(book.figures)


def picture(
    folder: Path, name: str, draw: Callable[[Gallery], Any], alt: str, caption: str
) -> Image:
    """The single figure of a page, written to ``figures/`` in the folder."""
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    with drawing():
        gallery = Gallery(figures)
        return gallery.add(draw(gallery), name, alt, caption)
