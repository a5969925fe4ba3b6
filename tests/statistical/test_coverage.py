"""Are the intervals honest? Simulated truth, one facet, two passes (sec. VII.A).

In two steps, each of which can fail alone. The chains have to give what the posterior gives, seed
by seed; and the posterior, by quadrature, has to hold the truth as often as it says, which takes
more seeds than chains can be run for here.
"""

from __future__ import annotations

import arviz as az
import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.inference import search, solutions
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers.sampling import Sampler, Timing
from lcbayes.samplers.settings import Settings
from lcbayes.simulation.scenarios import scenario
from lcbayes.simulation.simulate import simulate
from tests.helpers import one_facet_posterior
from tests.helpers.false_alarms import EACH, counts, limit

TRUTH = {"log_albedo_area": np.log(10.0), "phi": 0.8, "g": 0.15}
SAMPLED = range(20)
INTEGRATED = range(100)


def observed(seed: int) -> Epochs:
    return Epochs.of(simulate(scenario.load("one-facet"), seed)[0])


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    """Probability that the posterior gives to less than the truth, by quadrature; (100, 3)."""
    assert tuple(TRUTH) == one_facet_posterior.NAMES
    below = []
    for seed in INTEGRATED:
        grid = one_facet_posterior.Quadrature.of(observed(seed), (120, 100, 100))
        for name, axis in zip(TRUTH, grid.axes, strict=True):
            ends = axis + 0.5 * (axis[1] - axis[0])
            below.append(np.interp(TRUTH[name], ends, np.cumsum(grid.marginal(name))))
    return np.reshape(below, (-1, 3))


@pytest.fixture(scope="module")
def sampled() -> tuple[np.ndarray, np.ndarray]:
    """The same from chains, and the effective number of draws; (20, 3) each.

    The parts of `fit.run` on one posterior that is compiled once: what takes the time of a fit
    this small is tracing, 2 s for each, where the chains take 0.1 s.
    """
    entry = registry.find("faceted")
    settings = Settings(num_warmup=200, num_samples=250)
    problem = Problem(entry.bind({"n_facets": 1, "spin": "none"}), observed(0))
    order = FacetOrder(problem, entry.facet_sites)
    sampler = Sampler(problem, settings, 2)
    draw = jax.jit(jax.vmap(problem.prior_draw, (0, None)))
    constrain = jax.jit(lambda z, data: jax.lax.map(lambda row: problem.constrain(row, data), z))
    below, effective = [], []
    for seed in SAMPLED:
        data = observed(seed)
        key_start, key = jax.random.split(jax.random.key(seed))
        starts = draw(jax.random.split(key_start, 32), data)
        ends = search.successive_halving(problem, data, starts, 2, Silent())
        (best,) = solutions.select_for_sampling(
            problem, data, solutions.distinct(problem, data, ends, order, 4)
        )
        with Silent().stage("sampling", 1, "draws") as track:
            z, stats, *_ = sampler.run(
                "mode", best.z[None], data, key, Checkpoint(None, {}), Timing(), track
            )
        assert stats["diverging"].mean() < 0.005
        sites = constrain(z.reshape(-1, problem.dim), data)
        for name, value in TRUTH.items():
            x = np.asarray(sites[name]).reshape(z.shape[:2])
            below.append(np.mean(x < value))
            effective.append(min(float(az.ess(x)), x.size))
    return np.reshape(below, (-1, 3)), np.reshape(effective, (-1, 3))


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_chains_place_the_truth_where_the_posterior_does(exact, sampled):
    """Sixty comparisons, each in its Monte-Carlo standard error."""
    below, effective = sampled
    p = exact[: len(SAMPLED)]
    assert np.all(np.abs(below - p) < limit(p.size) * np.sqrt(p * (1.0 - p) / effective))


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
@pytest.mark.parametrize("name", TRUTH)
def test_central_intervals_hold_the_truth(exact, name):
    """Binomial, 100 seeds. Intervals of 90 % would hold 59 truths if they were half as long as they
    should be, and those of 50 % 82 if they were twice as long: both are beyond the bounds.
    """
    below = exact[:, list(TRUTH).index(name)]
    for level in (0.9, 0.5):
        low, high = counts(len(INTEGRATED), level, 2)
        assert low <= np.sum(np.abs(below - 0.5) < 0.5 * level) <= high


def test_the_truth_is_the_scenarios():
    """The numbers above are those of the bundled scenario, and of its facet alone."""
    true_facets = simulate(scenario.load("one-facet"))[1]["facets"]
    assert len(true_facets) == 1
    result = (np.log(true_facets[0]["albedo_area_m2"]), true_facets[0]["phi"], true_facets[0]["g"])
    np.testing.assert_allclose(result, tuple(TRUTH.values()), rtol=1e-12)
