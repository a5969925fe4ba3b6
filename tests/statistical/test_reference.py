"""Every sampler against every reference posterior: means and sds, by `lcbayes.fit`.

Each pull of a mean or an sd is a Student t of the groups that its error rests on; Bonferroni over
those of a pair of posterior and sampler. The draws are many enough
that a shift of 0.2 posterior sd, or a width 15 % too narrow, is found out in each quantity, with
four standard errors to spare.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy import stats

from lcbayes.results.posterior import METRIC
from lcbayes.samplers.settings import AUTO, FACET_MOVES, GUIDED, PUBLISHED, WARMUP
from lcbayes.tasks.fit.run import fit_with_kernel
from tests.helpers.false_alarms import EACH, counts, limit
from tests.reference import agreement, problems, stored

SHIFT, NARROW = 0.2, -np.log(0.85)  # found out, posterior sd and ln of the width
# Chains, draws of each, stretches it is cut into: runs of particles are independent, what is in one
# run is not.
DRAWS = {
    "nuts": (4, 2500, 16),
    "ahmc": (4, 2500, 16),
    "hmc": (4, 2500, 16),
    "rmhmc": (4, 2500, 16),
    "mh": (4, 20_000, 16),
    "smc": (12, 500, 1),
}
LONGER = {
    ("banana", "nuts"): 8000,
    ("banana", "hmc"): 12_000,
    ("glossy-facet", "hmc"): 5000,
    ("glossy-facet", "mh"): 40_000,
    ("turning-facet", "mh"): 60_000,
    ("two-turning-facets", "mh"): 120_000,
    ("turning-facet", "smc"): 1000,
    ("two-turning-facets", "smc"): 1000,
}
QUICK = {("banana", "ahmc")}
PAIRS = [
    pytest.param(*pair, marks=() if pair in QUICK else pytest.mark.slow)
    for pair in ((one.name, sampler) for one in problems.ALL for sampler in DRAWS)
]


@cache
def drawn(name: str, sampler: str) -> tuple[tuple[str, ...], np.ndarray]:
    one = problems.BY_NAME[name]
    chains, length, _ = DRAWS[sampler]
    result = fit_with_kernel(
        one.curve,
        sampler,
        model=one.model,
        seed=7,
        num_chains=chains,
        num_samples=LONGER.get((name, sampler), length),
        **one.options,
    )
    names, draws, _ = one.draws(result)
    return names, draws


def compared(name: str, sampler: str, change=lambda draws: draws) -> agreement.Agreement:
    names, draws = drawn(name, sampler)
    known = stored.moments(name)
    assert known.names == names
    return agreement.compare(change(draws), known, DRAWS[sampler][2])


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(("name", "sampler"), PAIRS)
def test_draws_agree(name, sampler):
    result = compared(name, sampler)
    shift, narrow = result.finds()
    assert shift < SHIFT
    assert narrow < NARROW
    assert np.max(np.abs(result.pulls)) < result.limit()


@pytest.mark.parametrize(
    "change",
    [lambda x: x.mean((0, 1)) + 0.85 * (x - x.mean((0, 1))), lambda x: x + 0.2 * x.std((0, 1))],
    ids=["narrow", "shifted"],
)
def test_wrong_draws_are_found_out(change):
    """In every quantity, not in the worst alone."""
    result = compared("banana", "ahmc", change)
    pulls = np.abs(result.pulls).reshape(2, -1).max(axis=0)
    assert np.all(pulls > result.limit())


def test_every_sampler_offered_is_tested():
    """Those that need a model of their own are tested in `tests/unit/samplers/`."""
    assert set(DRAWS) == set(WARMUP) - {PUBLISHED, AUTO, FACET_MOVES, GUIDED}
    assert set(METRIC) == set(WARMUP) - {AUTO}


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("one", problems.ALL, ids=lambda one: one.name)
def test_the_numbers_are_of_these_problems(one):
    """Else run the command that the file names; and its two computations agree."""
    recorded = stored.everything()["problems"][one.name]
    assert {k: recorded[k] for k in stored.identity(one)} == stored.identity(one), (
        f"run {stored.everything()['command']}"
    )
    known, chains = stored.moments(one.name), stored.moments(one.name, "nuts_")
    bias = (chains.mean - known.mean) / np.hypot(chains.mean_se, known.mean_se)
    stretch = np.log(chains.sd / known.sd) / np.hypot(chains.log_sd_se, known.log_sd_se)
    assert np.max(np.abs([bias, stretch])) < limit(2 * len(bias))
    assert np.all(chains.mean_se < chains.sd / np.sqrt(20_000))


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(("groups", "size"), [(64, 40), (12, 200)])
def test_pulls_are_as_rare_as_they_should_be(groups, size):
    """100,000 sets of exact Gaussian draws: pulls of mean and of sd pass the level of 1 in 1000 as
    often as Student's t does, binomial."""
    rng = np.random.default_rng(groups)
    n, level = 100_000, 1e-3
    first = rng.standard_normal((n, groups)) / np.sqrt(size)
    second = rng.chisquare(size, (n, groups)) / size
    variance = second.mean(axis=1)
    for pull in (
        first.mean(axis=1) / agreement.error(first.T),
        np.log(variance) * variance / agreement.error(second.T),
    ):
        beyond = np.sum(np.abs(pull) > stats.t.isf(0.5 * level, groups - 1))
        low, high = counts(n, level, 2)
        assert low <= beyond <= high
