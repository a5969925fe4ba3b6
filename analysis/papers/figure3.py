"""Figure 3 of Linares & Crassidis: draws of the exact Fisher-adaptive kernel and the target.

Rows: one pass, two passes. Left: every 20th draw over (φ, g) and (α, g), with the regions that
contain 50 and 90 % of the exact posterior. Right: histograms, and the exact densities as lines.
As in sec. VII.B, chains start at draws from the prior and the first 1000 transitions are dropped;
here these are also the warm-up in which the kernel adapts.
"""

from __future__ import annotations

import _script
import numpy as np
import one_facet
from figure2 import outline
from numpyro.infer import MCMC
from one_facet import LABELS, MODEL, TRUTH, Floats, Quadrature

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jax
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.kernels import AHMC
from lcbayes.simulation.simulate import simulate

CHAINS, WARMUP = 8, 1000
THINNING = 20  # the posterior of one pass is a thin, curved ridge that chains traverse slowly
SHAPE = (800, 120, 200)


def sample(data: Epochs, draws: int, seed: int) -> dict[str, Floats]:
    """Draws of albedo_area, phi and g, each (draws,), from chains of the exact kernel."""
    kernel = AHMC(MODEL)
    mcmc = MCMC(
        kernel,
        num_warmup=WARMUP,
        num_samples=THINNING * -(-draws // CHAINS),
        thinning=THINNING,
        num_chains=CHAINS,
        chain_method="vectorized",
        progress_bar=False,
    )
    mcmc.run(jax.random.key(seed), data)
    assert mcmc.last_state is not None
    print(kernel.describe(mcmc.last_state))
    sites = mcmc.get_samples()
    return {k: np.asarray(sites[k])[:draws, 0] for k in ("albedo_area", "phi", "g")}


def density(axes, draws: Floats, x: Floats, exact: Floats, truth: float) -> None:
    """A histogram of draws, and the exact density at the points x."""
    axes.hist(draws, bins=60, density=True, color=style.PALETTE[0], alpha=0.35)
    axes.plot(x, exact / np.trapezoid(exact, x), color=style.PALETTE[1], lw=1.2)
    axes.axvline(truth, color=style.INK, lw=0.8, ls=":")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_ylim(0.0)


def main() -> None:
    args = _script.parser(__doc__ or "", draws=8000).parse_args()
    figure = _script.figure(10.5, 5.4)
    rows = figure.subplots(2, 4, width_ratios=(1.0, 1.0, 0.8, 0.8))
    for n_passes, (left, middle, of_g, of_area) in enumerate(rows, start=1):
        data = Epochs.of(simulate(one_facet.experiment(n_passes), args.seed)[0])
        grid = Quadrature.of(data, SHAPE)
        log_alpha, phi, g = grid.axes
        alpha = np.exp(log_alpha)
        draws = sample(data, args.draws, args.seed)
        dots = {
            "marker": ".",
            "ls": "",
            "ms": 1.6,
            "alpha": 0.25,
            "color": style.PALETTE[0],
            "mew": 0,
            "rasterized": True,
        }
        left.plot(draws["phi"], draws["g"], **dots)
        outline(left, phi, g, grid.marginal("phi", "g"))
        middle.plot(draws["albedo_area"], draws["g"], **dots)
        outline(middle, alpha, g, grid.marginal("log_albedo_area", "g"))
        for axes, x in ((left, TRUTH.phi), (middle, TRUTH.albedo_area)):
            axes.plot(x, TRUTH.g, "+", color=style.INK, ms=9, mew=1.3)
            axes.set_ylabel(LABELS["g"])
        density(of_g, draws["g"], g, grid.marginal("g"), TRUTH.g)
        by_area = grid.marginal("log_albedo_area") / alpha
        density(of_area, draws["albedo_area"], alpha, by_area, TRUTH.albedo_area)
        # the range of the draws: the grid extends far into the tails
        low, high = np.quantile(draws["albedo_area"], [0.0, 0.999])
        for axes in (middle, of_area):
            axes.set_xlim(low - 0.05 * (high - low), high + 0.05 * (high - low))
        reach = 1.05 * np.max(np.abs(draws["g"]))
        of_g.set_xlim(-reach, reach)
        for axes in (left, middle):
            axes.set_ylim(-reach, reach)
        low, high = np.quantile(draws["phi"], [2e-4, 0.9998])
        left.set_xlim(low - 0.003, high + 0.003)
        left.set_title({1: "one pass", 2: "two passes"}[n_passes], loc="left")
        if n_passes == 2:
            left.set_xlabel(LABELS["phi"])
            middle.set_xlabel(LABELS["albedo_area"])
            of_g.set_xlabel(LABELS["g"])
            of_area.set_xlabel(LABELS["albedo_area"])
    _script.save(figure, args.out, "figure3")


if __name__ == "__main__":
    main()
