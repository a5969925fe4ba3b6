"""Are the intervals honest? Simulated truth, one facet, two passes (sec. VII.A), 20 noise seeds."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes import gallery, scenario
from lcbayes._jax import jax
from lcbayes.checkpoint import Checkpoint
from lcbayes.epochs import Epochs
from lcbayes.inference import search, solutions
from lcbayes.inference.facet_order import FacetOrder
from lcbayes.inference.problem import Problem
from lcbayes.inference.sample import Sampler, Timing
from lcbayes.inference.settings import Settings
from lcbayes.progress import Silent
from lcbayes.simulate import simulate

SEEDS = range(20)
TRUTH = {"albedo_area": 10.0, "phi": 0.8, "g": 0.15}


@pytest.fixture(scope="module")
def inside() -> dict[str, list[bool]]:
    """Whether each seed's 90 % interval holds the truth, by parameter.

    The parts of `fit.run` on one posterior that is compiled once: what takes the time of a fit
    this small is tracing, 2 s for each, where the chains take 0.1 s.
    """
    entry = gallery.find("faceted")
    settings = Settings(num_warmup=200, num_samples=250)
    what = scenario.load("one-facet")
    problem = Problem(entry.bind({"n_facets": 1, "spin": "none"}), Epochs.of(simulate(what)[0]))
    order = FacetOrder(problem, entry.facet_sites)
    sampler = Sampler(problem, settings, 2)
    draw = jax.jit(jax.vmap(problem.prior_draw, (0, None)))
    constrain = jax.jit(lambda z, data: jax.lax.map(lambda row: problem.constrain(row, data), z))
    found: dict[str, list[bool]] = {k: [] for k in TRUTH}
    for seed in SEEDS:
        data = Epochs.of(simulate(what, seed)[0])
        key_start, key = jax.random.split(jax.random.key(seed))
        starts = draw(jax.random.split(key_start, 32), data)
        ends = search.race(problem, data, starts, 2, Silent())
        (best,) = solutions.worth_sampling(
            problem, data, solutions.distinct(problem, data, ends, order, 4), 4
        )
        z, stats, _ = sampler.run(
            "mode", best.z, data, key, Checkpoint(None, {}), Timing(), _Track()
        )
        assert stats["diverging"].mean() < 0.005
        sites = constrain(z.reshape(-1, problem.dim), data)
        for name, value in TRUTH.items():
            low, high = np.quantile(sites[name], [0.05, 0.95])
            found[name].append(bool(low <= value <= high))
    return found


class _Track:
    def advance(self, n: int, note: str = "") -> None:
        pass


@pytest.mark.parametrize("name", TRUTH)
def test_ninety_per_cent_intervals_hold_the_truth(inside, name):
    """16 to 20 of 20.

    With exact intervals a fresh set of seeds gives fewer than 16 with probability 4.3 %, for one
    of the three parameters at most 13 %; the seeds are fixed, so that a failure is a change of
    the code. Intervals of half their right length would hold 12 of 20 and pass in 4.2 %.
    """
    assert 16 <= sum(inside[name]) <= 20


def test_the_truth_is_the_scenarios():
    """The numbers above are those of the bundled scenario, and of its facet alone."""
    told = simulate(scenario.load("one-facet"))[1]["facets"]
    assert [(f["albedo_area_m2"], round(f["phi"], 12), round(f["g"], 12)) for f in told] == [
        tuple(TRUTH.values())
    ]
