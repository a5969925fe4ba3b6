"""Evidence from tempered particles against nested sampling, which shares nothing with it."""

from __future__ import annotations

import numpy as np
import pytest
import small
from false_alarms import EACH, limit

from lcbayes._jax import jax
from lcbayes.inference import smc

RUNS = 16

pytest.importorskip("blackjax.ns", reason="needs blackjax >= 1.7, of the extra bench")


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
@pytest.mark.parametrize("n_facets", [1, 2])
def test_evidence_agrees_with_nested_sampling(n_facets):
    """In the combined error, by t with the degrees of freedom of either's runs: where one method
    misses half of the posterior, or counts a facet's prior twice, it is off by 0.7 or more.
    """
    import nested

    problem, data = small.posed(small.curve(30, n_facets), n_facets=n_facets, spin="none")
    found = smc.replicate(problem, data, jax.random.key(0), 500, RUNS)
    runs = [
        nested.log_evidence(problem, data, key, n_facets, False, 500)[0]
        for key in jax.random.split(jax.random.key(1), RUNS)
    ]
    value, error = nested.pooled(runs)
    error = np.hypot(found.se, error)
    most = limit(1, RUNS - 1) * error
    assert most < 0.7
    assert abs(found.log_evidence - value) < most
