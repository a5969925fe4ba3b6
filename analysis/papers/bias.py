"""An additional figure: the bias of the published kernel, compared with the exact kernel.

One facet, two passes; the exact mean and sd of log α, φ and g come from a grid. Left: bias against
the number of leapfrog steps at one step size; right: against the step size with one step. The error
of a mean is in posterior standard deviations; bars are one Monte-Carlo standard error. The kernels
run without warm-up, with the same step size, number of steps and fallback covariance. The bias of
the published rule does not vanish with the step size: in this limit it samples a different density.
"""

from __future__ import annotations

import warnings
from functools import partial
from itertools import count
from typing import Any

import _script
import many_chains
import numpy as np
import one_facet
from many_chains import Moments
from one_facet import LABELS, NAMES, Quadrature, Truth

from lcbayes.analysis import style
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.kernels import AHMC
from lcbayes.simulation.simulate import simulate

SIGMA, STEP = 0.7, 10.0  # m², s: noisy enough that the posterior is not Gaussian
STEP_SIZE, STEPS = 0.4, (1, 2, 3, 5, 7, 10, 15, 20)
STEP_SIZES = (0.2, 0.3, 0.4, 0.6, 0.8, 1.0, 1.2)
DELTA = 1.0
CHAINS = 400


class Experiment:
    """The posterior, its exact moments, and kernels applied to it in the paper's coordinates."""

    def __init__(self, seed: int) -> None:
        what = one_facet.experiment(2, truth=Truth(g=0.15), sigma=SIGMA, step=STEP)
        data = Epochs.of(simulate(what, seed)[0])
        problem = one_facet.problem_of(data)
        self.seeds = count(1000 * seed)  # one per run, so that runs are independent
        self.grid = Quadrature.of(data)
        self.potential_fn = partial(one_facet.potential, problem, data=data)
        self.fisher_fn = partial(one_facet.fisher, problem, data=data)
        self.start = self.grid.draws(CHAINS, np.random.default_rng(seed))
        self.covariance = np.cov(self.grid.draws(20_000, np.random.default_rng(0)).T)

    def run(self, exact: bool, step_size: float, num_steps: int, draws: int) -> Moments:
        """Moments from chains that start at draws from the posterior."""
        scale: dict[str, Any] = {"proposal_scale": DELTA} if exact else {}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # the published rule is biased
            kernel = AHMC(
                potential_fn=self.potential_fn,
                fisher_fn=self.fisher_fn,
                exact=exact,
                step_size=step_size,
                num_steps=num_steps,
                covariance=self.covariance,
                **scale,
            )
        # With a small step the chain is a random walk, with a burn-in of about 1/ε² transitions.
        burn = int(min(20 + 10 / (step_size * num_steps) ** 2, 1000))
        return many_chains.run(
            kernel,
            self.start,
            lambda z: z,
            self.grid.moments(),
            draws=draws,
            burn=burn,
            seed=next(self.seeds),
        )


def draw(axes, x: tuple[float, ...], published: list[Moments], exact: list[Moments]) -> None:
    """Bias of the three means against x."""
    for i, name in enumerate(NAMES):
        hue, shift = style.colour(i), 1.0 + 0.02 * (i - 1)
        for moments, filled in ((published, True), (exact, False)):
            axes.errorbar(
                np.array(x) * shift,
                [m.bias[i] for m in moments],
                [m.bias_error[i] for m in moments],
                color=hue,
                marker="o",
                ms=4,
                lw=1.1 if filled else 0.8,
                elinewidth=0.9,
                mfc=hue if filled else "white",
                ls="-" if filled else ":",
                label=LABELS[name].split(" (")[0] if filled else None,
            )
    axes.axhline(0.0, color=style.INK, lw=0.6)
    axes.set_xscale("log")
    axes.set_xticks(x, [f"{v:g}" for v in x])
    axes.minorticks_off()


def report(label: str, moments: Moments) -> None:
    bias = "  ".join(
        f"{b:+.4f} ± {e:.4f}" for b, e in zip(moments.bias, moments.bias_error, strict=True)
    )
    print(f"{label:34s} {bias}   acceptance {moments.accept_prob:.3f}", flush=True)


def main() -> None:
    args = _script.parser(__doc__ or "", draws=300).parse_args()
    experiment = Experiment(args.seed)
    print(f"{'error of the mean in posterior sd':34s} " + "".join(f"{n:20s}" for n in NAMES))
    by_steps: dict[bool, list[Moments]] = {False: [], True: []}
    by_size: dict[bool, list[Moments]] = {False: [], True: []}
    for exact in (False, True):
        name = "exact" if exact else "published"
        for n in STEPS:
            by_steps[exact].append(experiment.run(exact, STEP_SIZE, n, args.draws))
            report(f"{name}, {n} steps of {STEP_SIZE:g}", by_steps[exact][-1])
        for size in STEP_SIZES:
            by_size[exact].append(experiment.run(exact, size, 1, 2 * args.draws))
            report(f"{name}, 1 step of {size:g}", by_size[exact][-1])
    figure = _script.figure(8.6, 3.8)
    left, right = figure.subplots(1, 2, sharey=True)
    draw(left, STEPS, by_steps[False], by_steps[True])
    draw(right, STEP_SIZES, by_size[False], by_size[True])
    left.set_ylabel("error of the mean (posterior sd)")
    left.set_xlabel("leapfrog steps")
    right.set_xlabel("step size")
    left.set_title(f"step size {STEP_SIZE:g}", loc="left")
    right.set_title("one leapfrog step", loc="left")
    left.legend(title="filled: published, open: exact", alignment="left", title_fontsize=8.5)
    _script.save(figure, args.out, "bias")


if __name__ == "__main__":
    main()
