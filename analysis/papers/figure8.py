"""Figure 8 of Linares & Crassidis: a glint of a geosynchronous satellite, and its prediction.

The facets follow the Ashikhmin–Shirley law and the body does not rotate. The paper gives neither
the true facets nor the epochs; here a panel and two sides of a bus are seen on two nights, the
second out of the plane of the first. Printed: the number of facets, of ten, that remain after a
burn-in under the squared-L1 prior, counted as in the paper. Drawn: the prediction of three facets
under the log-normal prior, by tempered particles; the bands contain 50 and 90 % of the predicted
measurements, noise included.
"""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import _script
import burn_in
import numpy as np
import six_facets
from figure4 import band
from six_facets import UPPER_BOUND

from lcbayes.analysis import style
from lcbayes.core.constants import HOUR_S
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import sparse
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate

SCENARIO = Path(__file__).with_name("geo-glint.toml")
ENTRY = registry.find("faceted-brdf")
CHAINS, TRANSITIONS, PARTICLES, RUNS = 3, 200, 80, 2


def problem_of(n_facets: int, data: Epochs, **options: float) -> Problem:
    fixed = {"spin": "none", "zero_point_sd": 0.0}  # nights have one zero point in the paper
    return Problem(ENTRY.bind({"n_facets": n_facets, **fixed, **options}), data)


def glossy(problem: Problem, data: Epochs, z: np.ndarray, panel: np.ndarray) -> None:
    """Print the posterior of the facet nearest to the panel, which is the first true facet."""
    sites = jax.jit(jax.vmap(lambda row: problem.constrain(row, data)))(jnp.asarray(z))
    cosines = np.asarray(sites["normals"]) @ panel
    nearest = np.argmax(cosines, axis=1)
    rows = np.arange(len(z))
    off = np.degrees(np.arccos(np.clip(cosines[rows, nearest], -1.0, 1.0)))
    print(f"panel: 90 % of the draws have a facet within {np.quantile(off, 0.9):.1f}° of it; its")
    for name in ("albedo_area", "r_spec", "r_diff", "nu"):
        low, mid, high = np.quantile(np.asarray(sites[name])[rows, nearest], [0.05, 0.5, 0.95])
        print(f"  {name} {mid:.3g}, 90 % {low:.3g} to {high:.3g}")


def main() -> None:
    parser = _script.parser(__doc__ or "", draws=4000)
    parser.add_argument(
        "--facets", type=int, default=UPPER_BOUND, help="to begin with; 0: no burn-in"
    )
    parser.add_argument("--chains", type=int, default=CHAINS)
    parser.add_argument("--transitions", type=int, default=TRANSITIONS)
    parser.add_argument("--particles", type=int, default=PARTICLES)
    args = parser.parse_args()
    what = scenario.load(SCENARIO)
    curve, truth = simulate(what, args.seed)
    data, clean = Epochs.of(curve), np.array(truth["flux"])
    reflected = [what.materials[k].parameters for k in what.body.labels]
    area = sum(
        a * (p["r_diff"] + p["r_spec"]) for a, p in zip(what.body.areas, reflected, strict=True)
    )
    if args.facets:
        print_burn_in(data, float(area), args)

    problem = problem_of(3, data)
    runs = six_facets.sample(problem, data, args.seed, args.particles, RUNS, "glint", args.out)
    z = six_facets.pooled(runs, args.draws)
    chi2 = six_facets.misfit(problem, data, z)
    evidence = ", ".join(f"{r.log_evidence:.2f}" for r in runs)
    print(f"three facets: ln Z of the runs {evidence}; chi2 {np.median(chi2):.0f}")
    for reason in {reason for r in runs for reason in r.reasons}:
        print(f"  {reason}")
    glossy(problem, data, z, np.asarray(what.body.normals[0]))
    keys = jax.random.split(jax.random.key(args.seed), len(z))
    replicated = jax.jit(jax.vmap(lambda z, k: problem.replicate(z, data, k)))
    draw(curve, clean, np.asarray(replicated(jnp.asarray(z), keys)), args.out)


def print_burn_in(data: Epochs, area: float, args: Namespace) -> None:
    """Print how many facets remain in each chain that begins with too many."""
    weight = sparse.weight(area)
    many = problem_of(args.facets, data, sparsity=weight, log_area_sd=sparse.LOG_AREA_SD)
    result = burn_in.run(many, data, args.chains, args.transitions, args.seed)
    for c in np.argsort(result.ends.mean(axis=1)):
        shares = result.remaining(int(c))
        print(
            f"chain {c}: chi2 {result.ends[c].mean():.0f} at {data.t.size} epochs; facets "
            f"that remain {max(shares, key=lambda n: shares[n])} {shares}"
        )


def draw(curve: LightCurve, clean: np.ndarray, drawn: np.ndarray, out: Path) -> None:
    """Draw the predicted brightness (draws, T) and its residuals for both nights."""
    assert curve.error is not None
    hours, sigma = curve.t / HOUR_S, float(np.median(curve.error))
    off = drawn.mean(axis=0)
    figure = _script.figure(8.6, 4.6)
    panels = figure.subplots(2, 2, sharex="col", sharey="row", height_ratios=(2.2, 1.0))
    for night, (upper, lower) in enumerate(panels.T):
        here = (hours > 12.0) == bool(night)
        t = hours[here]
        band(
            upper,
            t,
            drawn[:, here],
            np.zeros(here.sum()),
            1.0,
            style.PALETTE[0],
            "predicted, 50 and 90 %",
        )
        band(lower, t, drawn[:, here], off[here], sigma, style.PALETTE[0], "")
        upper.plot(t, clean[here], color=style.INK, lw=0.9, label="truth")
        upper.plot(t, curve.brightness[here], ".", ms=4, color=style.DATA, label="measured")
        lower.plot(t, (curve.brightness - off)[here] / sigma, ".", ms=4, color=style.DATA)
        lower.axhline(0.0, color=style.FAINT, lw=0.6)
        lower.set_xlabel("time (h)")
        upper.set_title(("first night", "second night")[night], loc="left")
    panels[0, 1].legend(loc="best")
    panels[0, 0].set_ylabel("flux at unit distance (m²)")
    panels[1, 0].set_ylabel("residual / σ")
    _script.save(figure, out, "figure8")


if __name__ == "__main__":
    main()
