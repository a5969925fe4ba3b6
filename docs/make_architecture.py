"""Draw `docs/figures/architecture.svg`, the layers of the package.

python docs/make_architecture.py

`tests/contract/test_imports.py` holds `LAYERS` against the rules that it checks.
"""

from __future__ import annotations

import re
from pathlib import Path

from matplotlib import pyplot as plt

from lcbayes.analysis import style

OUT = Path(__file__).parent / "figures" / "architecture.svg"

# From the ground up. A layer may import from those that are named with it.
LAYERS = {
    "ground": ("lcbayes._jax, lcbayes.errors", ()),
    "physics": ("lcbayes.physics", ("ground",)),
    "io": ("lcbayes.io", ("ground", "core")),
    "core": (
        "light curves, priors, noise, inference, scenarios,\nresults, methods without inversion",
        ("physics", "io"),
    ),
    "models": ("lcbayes.models", ("core",)),
    "analysis": ("lcbayes.analysis: figures, pages", ("models",)),
    "front door": ("lcbayes.cli, lcbayes.commands, lcbayes itself", ("analysis",)),
}  # fmt: skip
PLACES = {  # centre and width of a box, in boxes
    "ground": (0.0, 0.0, 4.6),
    "physics": (-1.25, 1.0, 2.1),
    "io": (1.5, 2.0, 1.6),
    "core": (-0.95, 2.0, 2.7),
    "models": (-0.95, 3.0, 2.7),
    "analysis": (-0.95, 4.0, 2.7),
    "front door": (-0.95, 5.0, 2.7),
}
HEIGHT = 0.62


def main() -> None:
    plt.rcParams.update(style.RC | {"svg.fonttype": "path"})
    figure, axes = plt.subplots(figsize=(7.2, 5.6), layout="constrained")
    axes.axis("off")
    axes.set_xlim(-2.45, 2.45)
    axes.set_ylim(-0.5, 5.5)
    for name, (holds, _) in LAYERS.items():
        x, y, width = PLACES[name]
        box = plt.Rectangle(
            (x - width / 2, y - HEIGHT / 2), width, HEIGHT, fc="#eef3f8", ec=style.PALETTE[0], lw=1
        )
        axes.add_patch(box)
        axes.text(x, y + 0.14, name, ha="center", va="center", weight="bold", fontsize=9.5)
        axes.text(x, y - 0.11, holds, ha="center", va="center", fontsize=8, linespacing=1.1)
    for name, (_, below) in LAYERS.items():
        x, y, width = PLACES[name]
        for other in below:
            to_x, to_y, to_width = PLACES[other]
            if to_y == y:  # core and io, side by side
                edge = 1 if to_x > x else -1
                ends = ((to_x - edge * to_width / 2, y), (x + edge * width / 2, y))
            else:
                at = x if abs(x - to_x) < to_width / 2 else to_x
                at = at if abs(at - x) < width / 2 else x
                ends = ((at, to_y + HEIGHT / 2), (at, y - HEIGHT / 2))
            axes.annotate("", *ends, arrowprops={"arrowstyle": "-|>", "color": style.INK})
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, metadata={"Date": None, "Creator": None})
    OUT.write_text(re.sub(r"[ \t]+$", "", OUT.read_text("utf-8"), flags=re.M), encoding="utf-8")
    print(OUT)


if __name__ == "__main__":
    main()
