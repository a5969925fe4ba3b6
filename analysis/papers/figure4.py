"""Figure 4 of Linares & Crassidis: measurements and their posterior prediction.

Left: the fitted pass. Right, in addition to the paper: the second pass, predicted from the first
alone and from both. The bands contain 50 and 90 % of the predicted measurements, noise included;
below, the same minus the mean prediction, in units of σ.
"""

from __future__ import annotations

import _script
import numpy as np
import one_facet
from figure3 import CHAINS, THINNING, WARMUP
from numpyro.infer import MCMC
from one_facet import MODEL, Floats

from lcbayes.analysis import style
from lcbayes.core.jax_setup import jax
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.kernels import AHMC
from lcbayes.simulation.simulate import simulate

QUANTILES = (0.05, 0.25, 0.75, 0.95)


def predict(fitted: LightCurve, at: LightCurve, draws: int, seed: int) -> Floats:
    """Measurements predicted at epochs ``at`` by the posterior given ``fitted``, (draws, T)."""
    data = Epochs.of(fitted)
    mcmc = MCMC(
        AHMC(MODEL),
        num_warmup=WARMUP,
        num_samples=THINNING * -(-draws // CHAINS),
        thinning=THINNING,
        num_chains=CHAINS,
        chain_method="vectorized",
        progress_bar=False,
    )
    key_chain, key = jax.random.split(jax.random.key(seed))
    mcmc.run(key_chain, data)
    problem, there = one_facet.problem_of(data), Epochs.of(at, fitted)
    sites = mcmc.get_samples()
    latent = {k: sites[k][:draws] for k in problem.names}

    def one(sites, key):
        return problem.replicate(problem.ravel(sites), there, key)

    return np.asarray(jax.jit(jax.vmap(one))(latent, jax.random.split(key, draws)))


def band(axes, t: Floats, drawn: Floats, off: Floats, unit: float, colour: str, label: str) -> None:
    """The 50 and 90 % bands of ``drawn`` (draws, T), minus ``off``."""
    q = (np.quantile(drawn, QUANTILES, axis=0) - off) / unit
    axes.fill_between(t, q[0], q[3], color=colour, alpha=0.22, lw=0, label=label)
    axes.fill_between(t, q[1], q[2], color=colour, alpha=0.32, lw=0)


def main() -> None:
    args = _script.parser(__doc__ or "", draws=8000).parse_args()
    both, truth = simulate(one_facet.experiment(2), args.seed)
    second = np.flatnonzero(both.t >= 200.0)
    first = np.flatnonzero(both.t < 200.0)
    clean = np.array(truth["flux"])
    figure = _script.figure(8.6, 4.8)
    panels = figure.subplots(2, 2, sharex="col", height_ratios=(2.2, 1.0))
    blue, orange = style.PALETTE[0], style.PALETTE[1]
    columns = (
        (first, ((first, orange, "fitted: this pass"),)),
        (second, ((first, orange, "fitted: the first pass"), (None, blue, "fitted: both passes"))),
    )
    for (upper, lower), (shown, fits) in zip(panels.T, columns, strict=True):
        curve = both.select(shown)
        t, sigma = curve.t, float(np.median(curve.error))  # type: ignore[arg-type]
        for used, colour, label in fits:
            fitted = both if used is None else both.select(used)
            drawn = predict(fitted, curve, args.draws, args.seed)
            off = drawn.mean(axis=0)
            band(upper, t, drawn, np.zeros_like(off), 1.0, colour, label)
            if used is None or shown is first:
                band(lower, t, drawn, off, sigma, colour, label)
                lower.plot(t, (curve.brightness - off) / sigma, ".", ms=4, color=style.DATA)
                lower.plot(t, (clean[shown] - off) / sigma, color=style.INK, lw=0.9)
        upper.plot(t, clean[shown], color=style.INK, lw=0.9, label="truth")
        upper.plot(t, curve.brightness, ".", ms=4, color=style.DATA, label="measured")
        upper.legend(loc="best")
        lower.axhline(0.0, color=style.FAINT, lw=0.6)
        lower.set_xlabel("time (s)")
    panels[0, 0].set_title("first pass", loc="left")
    panels[0, 1].set_title("second pass, out of the plane", loc="left")
    panels[0, 0].set_ylabel("flux at unit distance (m²)")
    panels[1, 0].set_ylabel("residual / σ")
    _script.save(figure, args.out, "figure4")


if __name__ == "__main__":
    main()
