"""Draw `docs/figures/architecture.svg`, the rooms of the package from the ground up.

python docs/make_architecture.py

`tests/contract/test_imports.py` holds `ROOMS` against the imports of the code.
"""

from __future__ import annotations

import re
from pathlib import Path

from matplotlib import pyplot as plt

from lcbayes.analysis import style

OUT = Path(__file__).parent / "figures" / "architecture.svg"
HOLDS = {
    "core": "JAX set-up, files, TOML, errors, progress, threads, cluster, checkpoint",
    "geometry": "times, Earth and Sun, sites, two-line elements, directions",
    "data": "LightCurve, readers and writers, the Earth's shadow, segments",
    "physics": "attitude laws, reflectance, brightness, photometry, bodies",
    "modelling": "epochs, priors, likelihood, pass effects, registry, log density",
    "simulation": "scenario files, simulated light curves, observability",
    "samplers": "MCMC kernels, chains, tempered SMC, bridge sampling, convergence",
    "inference": "search, solutions, goodness of fit, evidence, number of facets",
    "inversion": "albedo-area distribution, attitude scan, spin, glints",
    "results": "results folders, the posterior file, summaries, verdicts",
    "models": "the NumPyro models, one file each",
    "analysis": "figures and reports",
    "tasks": "one folder a command: options, run, result",
    "cli": "the command line",
}
ROOMS = tuple(HOLDS)
OUTSIDE = ("models", "analysis")  # at the top of the repository
HEIGHT, STEP = 0.8, 1.0


def main() -> None:
    plt.rcParams.update(style.RC | {"svg.fonttype": "path"})
    figure, axes = plt.subplots(figsize=(7.2, 5.8), layout="constrained")
    axes.axis("off")
    axes.set_xlim(-0.35, 10.05)
    axes.set_ylim(-0.5, len(ROOMS) * STEP - 0.4)
    for i, (name, holds) in enumerate(HOLDS.items()):
        face = "#fbf3e6" if name in OUTSIDE else "#eef3f8"
        bottom = i * STEP - HEIGHT / 2
        axes.add_patch(plt.Rectangle((0, bottom), 10, HEIGHT, fc=face, ec=style.PALETTE[0], lw=0.8))
        axes.text(0.2, i * STEP, name, va="center", weight="bold", fontsize=9)
        axes.text(2.0, i * STEP, holds, va="center", fontsize=8.5)
    arrow = {"arrowstyle": "-|>", "color": style.INK}
    axes.annotate("", (-0.2, -0.4), (-0.2, (len(ROOMS) - 1) * STEP + 0.4), arrowprops=arrow)
    OUT.parent.mkdir(exist_ok=True)
    figure.savefig(OUT, metadata={"Date": None, "Creator": None})
    drawn = OUT.read_text(encoding="utf-8")
    OUT.write_text(re.sub(r"(?m)[ \t]+$", "", drawn), encoding="utf-8")
    print(OUT)


if __name__ == "__main__":
    main()
