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
    "ground": ("lcbayes._jax, _files, _toml, errors", ()),
    "physics": ("lcbayes.physics", ("ground",)),
    "light curves": ("lcbayes.io, lightcurve, geometry, tle", ("ground",)),
    "core": (
        "priors, noise, inference, scenarios, results,\nmethods without inversion",
        ("physics", "light curves"),
    ),
    "models": ("lcbayes.models", ("core",)),
    "analysis": ("lcbayes.analysis: figures, pages", ("models",)),
    "front door": ("lcbayes.cli, lcbayes.commands, lcbayes itself", ("analysis",)),
}  # fmt: skip
PLACES = {  # centre and width of a box, in boxes
    "ground": (0.0, 0.0, 4.6),
    "physics": (-1.2, 1.0, 2.2),
    "light curves": (1.2, 1.0, 2.2),
    "core": (0.0, 2.0, 2.7),
    "models": (0.0, 3.0, 2.7),
    "analysis": (0.0, 4.0, 2.7),
    "front door": (0.0, 5.0, 2.7),
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
            at = x if abs(x - to_x) < to_width / 2 else to_x  # straight down, onto both boxes
            ends = ((at, to_y + HEIGHT / 2), (at, y - HEIGHT / 2))
            axes.annotate("", *ends, arrowprops={"arrowstyle": "-|>", "color": style.INK})
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, metadata={"Date": None, "Creator": None})
    OUT.write_text(re.sub(r"[ \t]+$", "", OUT.read_text("utf-8"), flags=re.M), encoding="utf-8")
    print(OUT)


if __name__ == "__main__":
    main()
