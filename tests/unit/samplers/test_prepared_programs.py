"""The programs that are compiled during a search are those that the chains then run."""

import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.inference.correlation import tempered
from lcbayes.modelling import registry
from lcbayes.samplers import sampling
from lcbayes.samplers.settings import AUTO, Settings
from tests.helpers import small_curves


@pytest.mark.parametrize("n_facets", [1, 3])  # without and with moves of facets
def test_chains_find_their_programs_compiled(n_facets):
    options = {"n_facets": n_facets, "spin": "none" if n_facets == 1 else "free"}
    problem, data = small_curves.posterior(small_curves.curve(12, 1), **options)
    hook = registry.find("faceted").hook("moves")
    assert hook is not None
    moves = hook(problem, data, **options)
    assert (moves is None) == (n_facets == 1)
    settings = Settings(sampler=AUTO, num_warmup=50, num_samples=50, num_chains=1)
    sampler = sampling.Sampler(problem, settings, 1, moves)
    timing = sampling.Timing()
    sampler.prepare(data, timing)
    assert timing.compile_s > 0.1
    compiled = sampling.programs.cache_info().misses
    start = np.asarray(problem.prior_draw(jax.random.key(1), data))
    weighed = tempered(problem, start, data)  # as after a search
    with Silent().stage("sampling", 1, "draws") as track:
        found = sampler.run(
            "mode-0",
            start[None],
            weighed,
            jax.random.key(0),
            Checkpoint(None, {}),
            sampling.Timing(),
            track,
        )
    assert found.z.shape == (1, 50, problem.dim)
    assert sampling.programs.cache_info().misses == compiled
