"""Matplotlib figures drawn without a display, which a notebook shows as pictures."""

from __future__ import annotations

import base64
import io
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

DPI = 144  # twice that of a page, for screens with small pixels


class Picture(Figure):
    """A figure that is its own picture in a notebook, whatever the backend of pyplot."""

    def _repr_png_(self) -> tuple[bytes, dict[str, Any]]:
        width, height = (int(96 * side) for side in self.get_size_inches())
        return png(self), {"width": width, "height": height}


class Pictures(list[Any]):
    """Figures that a notebook shows below each other."""

    def _repr_html_(self) -> str:
        return "".join(
            f'<img src="data:image/png;base64,{base64.b64encode(png(one)).decode()}" '
            f'style="max-width: 100%; width: {int(96 * one.get_size_inches()[0])}px">'
            for one in self
        )


def png(figure: Figure) -> bytes:
    """The figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def new_figure(width: float, height: float) -> Picture:
    """An empty figure of this size in inches."""
    figure = Picture(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
