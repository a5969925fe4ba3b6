"""Figure 2 of Linares & Crassidis: the target density of one facet, for one pass and for two.

Left: over the direction of the facet (φ, g), with the albedo-area integrated out. Right: over
albedo-area and g, with φ integrated out. Colours: depth below the peak in units of log density, on
a logarithmic scale, as in the paper's "log(log π)". Lines: the regions that contain 50 and 90 % of
the posterior.
The densities are computed on a grid, without sampling. The facet is at g = 0, in the plane of the
first pass. One pass does not determine the sign of g, and |g| and the area are degenerate; the
second pass determines both.
"""

from __future__ import annotations

import _script
import numpy as np
import one_facet
from one_facet import LABELS, TRUTH, Floats, Quadrature

from lcbayes.analysis import style
from lcbayes.modelling.epochs import Epochs
from lcbayes.simulation.simulate import simulate

# One window for both rows, so that the effect of the second pass is visible. In α it is wider than
# the plot, because the left panels integrate over α.
WINDOW = {"log_albedo_area": (np.log(8.0), np.log(60.0)), "phi": (0.72, 0.88), "g": (-0.7, 0.7)}
SHOWN_AREA = (8.0, 20.0)
SHAPE = (800, 120, 280)
LEVELS = (0.0, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)


def mass_levels(mass: Floats, density: Floats, held: tuple[float, ...] = (0.9, 0.5)) -> list[float]:
    """Densities at the edges of the highest-density regions of the given probabilities, increasing.

    ``mass`` is the probability of each cell and ``density`` the probability per unit of the plot's
    axes; they are not proportional if cells differ in size.
    """
    falling = np.argsort(density.ravel())[::-1]
    total = np.cumsum(mass.ravel()[falling]) / mass.sum()
    return [float(density.ravel()[falling[np.searchsorted(total, share)]]) for share in held]


def log_marginal(grid: Quadrature, over: int) -> Floats:
    """log ∫ π along one axis, computed in logarithms, so that it is valid far into the tails."""
    peak = grid.log_density.max(axis=over)
    return peak + np.log(np.exp(grid.log_density - np.expand_dims(peak, over)).sum(axis=over))


def outline(axes, x: Floats, y: Floats, mass: Floats) -> None:
    """Outline the regions that contain 50 and 90 % of the probability of cells (x, y)."""
    density = mass / np.outer(np.gradient(x), np.gradient(y))
    levels = mass_levels(mass, density)
    axes.contour(x, y, density.T, levels=levels, colors=style.PALETTE[1], linewidths=(0.9, 1.4))


def draw(axes, x: Floats, y: Floats, log_mass: Floats):
    """Depth of the density below its peak in colour, and the 50 and 90 % regions; cells (x, y)."""
    from matplotlib.colors import BoundaryNorm

    log_density = log_mass - np.log(np.outer(np.gradient(x), np.gradient(y)))
    log_density -= log_density.max()
    filled = axes.contourf(
        x,
        y,
        -log_density.T,
        levels=LEVELS,
        cmap="Blues_r",
        extend="max",
        norm=BoundaryNorm(LEVELS, 256, extend="max"),
    )
    outline(axes, x, y, np.exp(log_mass - log_mass.max()))
    return filled


def enlarge(left, right, grid: Quadrature) -> None:
    """Insets that enlarge details too small for the common window."""
    log_alpha, phi, g = grid.axes
    flat = (log_marginal(grid, 0), log_marginal(grid, 1))
    xs, truths = (phi, np.exp(log_alpha)), (TRUTH.phi, TRUTH.albedo_area)
    for axes, x, density, truth in zip((left, right), xs, flat, truths, strict=True):
        inset = axes.inset_axes((0.56, 0.66, 0.42, 0.32))
        draw(inset, x, g, density)
        inset.plot(truth, TRUTH.g, "+", color=style.INK, ms=7, mew=1.1)
        inset.tick_params(labelsize=6.5, length=2)
        for spine in inset.spines.values():
            spine.set_visible(True)
        axes.indicate_inset_zoom(inset, edgecolor=style.FAINT)


def main() -> None:
    args = _script.parser(__doc__ or "").parse_args()
    figure = _script.figure(7.6, 6.2)
    panels = figure.subplots(2, 2, sharey=True)
    for n_passes, (left, right) in enumerate(panels, start=1):
        data = Epochs.of(simulate(one_facet.experiment(n_passes), args.seed)[0])
        window = Quadrature.over(data, tuple(WINDOW.values()), SHAPE)
        log_alpha, phi, g = window.axes
        draw(left, phi, g, log_marginal(window, 0))
        filled = draw(right, np.exp(log_alpha), g, log_marginal(window, 1))
        label = {1: "one pass", 2: "two passes"}[n_passes]
        for axes, x in ((left, TRUTH.phi), (right, TRUTH.albedo_area)):
            axes.plot(x, TRUTH.g, "+", color=style.INK, ms=9, mew=1.3)
            axes.set_title(label, loc="left")
        left.set_xticks([0.75, 0.80, 0.85])
        right.set_xlim(SHOWN_AREA)
        right.set_xticks(range(10, 21, 2))
        left.set_ylabel(LABELS["g"])
        if n_passes == 2:
            left.set_xlabel(LABELS["phi"])
            right.set_xlabel(LABELS["albedo_area"])
            enlarge(left, right, Quadrature.of(data))
    bar = figure.colorbar(filled, ax=panels, shrink=0.8, ticks=LEVELS, spacing="uniform")
    bar.set_label("depth of the log density below its peak")
    bar.ax.set_yticklabels([f"{level:g}" for level in LEVELS])
    _script.save(figure, args.out, "figure2")


if __name__ == "__main__":
    main()
