"""AHMC compared with common samplers: effective draws per gradient and per second.

    python benchmarks/samplers.py                        everything, into RESULTS.md
    python benchmarks/samplers.py glint banana           these posteriors, into RESULTS.md
    python benchmarks/samplers.py --quick one-facet      one seed, shorter; printed, not saved

needs ``pip install 'lcbayes[bench]'``, and for ``ariadne`` the data ($LCBAYES_DATA or
../shared/data).

Posteriors, coordinates, starts. All samplers see the same density of y, where z = mode + W y and
W Wᵀ is the inverse of the Fisher information (prior included) at the mode. These are the *whitened*
coordinates that `lcbayes.fit` uses with all samplers. A diagonal metric is therefore already a good
one, and no sampler has an advantage from scales or correlations alone. All start from the same
draws of N(0, 2² I) in y, the Gaussian at the mode widened by two. For Ariadne the mode is that at
the published pole and period, and the coordinates are those of the model's hook. emcee and RMHMC
are omitted for Ariadne: stretch moves fail in this number of dimensions, and every RMHMC step would
need a dozen information matrices and the derivative of one. RMHMC is also omitted for the glint,
where its step size was a thousandth of a posterior width and its chains did not mix in two minutes
per seed.

Measures. The effective size of a run is the smaller of the bulk ESS (Vehtari et al. 2021) and the
ESS of squares about the mean, minimised over all coordinates of z, the model's unconstrained
parameters. It is divided by gradient-equivalents and by wall time, for the draws alone and for
warm-up and draws. A gradient with its density counts as 1, a Fisher matrix as 3, a density alone as
1/3; for RMHMC the derivative of the metric along a direction also counts as a Fisher matrix. The
search of NUTS for its first step size is not counted; the matrices of AHMC's warm-up are.
Compilation is always excluded. A run with any R-hat above 1.05 has not converged and its ESS is not
used.

Settings. Gradient-based samplers: 4 chains, each a compiled program, in parallel on the cores (as
in `lcbayes.fit`; with vectorised chains in lock-step, NUTS would wait for its longest tree). emcee:
one ensemble of max(32, 4 D) walkers with a vectorised density; walkers count as chains. Warm-ups
and lengths are equal for all but emcee and RMHMC (`LENGTHS`); all other settings are the defaults
of each sampler.
"""

from __future__ import annotations

import argparse
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from _posteriors import POSTERIORS, Posterior
from _results import table, write_section
from _samplers import FISHER, N_CHAINS, SAMPLERS, Floats, Length, Run, per_gradient
from arviz_stats.base import array_stats  # pyright: ignore[reportPrivateImportUsage]

MAX_RHAT = 1.05
SEEDS = range(5)
USUAL = Length(600, 1000)
LENGTHS = {"emcee": Length(3000, 6000), "RMHMC": Length(300, 500)}
SHORTER = {"ariadne": 4}  # divisor of the lengths
LEFT_OUT = {"ariadne": ("emcee", "RMHMC"), "glint": ("RMHMC",)}
QUICK = 2  # divisor of the lengths in a quick run
MEASURES = ("per 1000 gradients", "with warm-up", "per second", "with warm-up")
AHMC = "AHMC exact"


class Score(NamedTuple):
    """One run: its convergence, effective size, and the four measures."""

    rhat: float
    ess: float
    measures: Floats  # (4,)
    run: Run

    @property
    def converged(self) -> bool:
        return self.rhat <= MAX_RHAT


def score(post: Posterior, run: Run) -> Score:
    z = post.z(run.y)
    squares = (z - z.mean((0, 1))) ** 2
    axes: dict[str, Any] = {"chain_axis": 0, "draw_axis": 1}
    rhat = max(np.max(array_stats.rhat(x, **axes)) for x in (z, squares))
    ess = min(
        np.min(array_stats.ess(z, method="bulk", **axes)),
        np.min(array_stats.ess(squares, method="mean", **axes)),
    )
    (warmup, draws), (warmup_s, draws_s) = run.gradients, run.seconds
    cost = [draws / 1000, (warmup + draws) / 1000, draws_s, warmup_s + draws_s]
    return Score(float(rhat), float(ess), ess / np.array(cost), run._replace(y=np.zeros(0)))


def measure(name: str, post: Posterior, quick: bool) -> dict[str, list[Score]]:
    """Scores of all samplers on one posterior, for each seed."""
    scores = {}
    divisor = SHORTER.get(name, 1) * (QUICK if quick else 1)
    for sampler, compile_for in SAMPLERS.items():
        if sampler in LEFT_OUT.get(name, ()):
            continue
        usual = LENGTHS.get(sampler, USUAL)
        run = compile_for(post, Length(usual.warmup // divisor, usual.draws // divisor))
        scores[sampler] = []
        for seed in SEEDS[:1] if quick else SEEDS:
            found = score(post, run(seed))
            scores[sampler].append(found)
            per, per_all, speed, speed_all = found.measures
            print(
                f"{name}, {sampler}, seed {seed}: ESS {found.ess:.0f}, R-hat {found.rhat:.3f}, "
                f"{per:.3g} ({per_all:.3g}) per 1000 gradients, {speed:.3g} ({speed_all:.3g}) "
                f"per s; {sum(found.run.seconds):.1f} s  {found.run.chosen}",
                flush=True,
            )
    return scores


def spread(values: Floats) -> str:
    """Median and range."""
    low, middle, high = (f"{x:.3g}" for x in (values.min(), np.median(values), values.max()))
    return f"{middle} ({low}–{high})" if len(values) > 1 else middle


def medians(scores: list[Score]) -> Floats | None:
    """Medians of the four measures over converged runs, if more than half converged."""
    good = [s.measures for s in scores if s.converged]
    return np.median(good, axis=0) if 2 * len(good) > len(scores) else None


def report(post: Posterior, cost: float, scores: dict[str, list[Score]]) -> str:
    rows = []
    for sampler, found in scores.items():
        good = [s for s in found if s.converged]
        cells = ["–"] * (1 + len(MEASURES))
        if medians(found) is not None:
            cells = [spread(np.array([s.ess for s in good]))]
            cells += [spread(column) for column in np.array([s.measures for s in good]).T]
        worst = max(s.rhat for s in found)
        rows.append([sampler, f"{len(good)} of {len(found)}", f"{worst:.3f}", *cells])
    heads = ["sampler", "converged", "largest R-hat", "smallest ESS", *MEASURES]
    texts = " / ".join(s.run.chosen for s in scores[AHMC]).split(" / ")
    chosen = Counter(text.split(",")[0] for text in texts)
    share = ", ".join(f"{text} in {n}" for text, n in chosen.most_common())
    first = scores[AHMC][0].run.chosen
    return (
        f"D = {post.dim}. Effective draws, the worst of all parameters and their squares.\n\n"
        f"{table(heads, rows)}\n\n"
        f"AHMC exact over the best of the others, medians: {against(scores)}.\n\n"
        f"Warm-up of AHMC chose {share} of {N_CHAINS * len(scores[AHMC])} chains; of the first "
        f"seed (steps × step size): {first}. A Fisher matrix took the time of {cost:.1f} "
        f"gradients and was counted as {FISHER:g}."
    )


def ratios(scores: dict[str, list[Score]]) -> tuple[Floats, list[str]] | None:
    """Ratio of AHMC to the best other sampler for each measure, and the names of the latter."""
    own = medians(scores[AHMC])
    others = {k: m for k, v in scores.items() if k != AHMC and (m := medians(v)) is not None}
    if own is None or not others:
        return None
    names = list(others)
    values = np.array([others[k] for k in names])
    best = np.argmax(values, axis=0)
    return own / np.max(values, axis=0), [names[i] for i in best]


def against(scores: dict[str, list[Score]]) -> str:
    found = ratios(scores)
    if found is None:
        return "it has not converged"
    each = zip(*found, MEASURES, strict=True)
    return ", ".join(f"{ratio:.2f} {what} ({who})" for ratio, who, what in each)


def closing(all_scores: dict[str, dict[str, list[Score]]]) -> str:
    rows, every = [], []
    for name, scores in all_scores.items():
        found = ratios(scores)
        if found is None:
            rows.append([POSTERIORS[name][0], *["not converged"] * len(MEASURES)])
            continue
        every.append(found[0])
        cells = [f"{r:.2f} ({who})" for r, who in zip(*found, strict=True)]
        rows.append([POSTERIORS[name][0], *cells])
    if every:
        rows.append(["median", *(f"{r:.2f}" for r in np.median(every, axis=0))])
    return (
        "Medians over the seeds of AHMC exact over those of the best other sampler (named).\n\n"
        + table(["posterior", *MEASURES], rows)
    )


def main() -> None:
    assert __doc__ is not None
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = ", ".join(POSTERIORS)
    parser.add_argument("posteriors", nargs="*", metavar="POSTERIOR", help=f"of {known}")
    parser.add_argument("--quick", action="store_true", help="one seed, half as long; no file")
    given = parser.parse_args()
    if unknown := set(given.posteriors) - set(POSTERIORS):
        parser.error(f"unknown posterior {', '.join(sorted(unknown))}; available: {known}")
    all_scores = {}
    for name in given.posteriors or POSTERIORS:
        title, make = POSTERIORS[name]
        post = make()
        cost = per_gradient(post)
        print(f"{title}: D = {post.dim}, a Fisher matrix costs {cost:.1f} gradients", flush=True)
        all_scores[name] = measure(name, post, given.quick)
        text = report(post, cost, all_scores[name])
        print(f"\n{text}\n", flush=True)
        if not given.quick:
            write_section(f"Samplers: {title}", f"python benchmarks/samplers.py {name}", text)
    text = closing(all_scores)
    print(text)
    if not given.quick and len(all_scores) == len(POSTERIORS):
        title = "Samplers: AHMC against the best other"
        write_section(title, "python benchmarks/samplers.py", text)


if __name__ == "__main__":
    main()
