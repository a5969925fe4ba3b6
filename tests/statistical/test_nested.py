"""Evidence from tempered particles against nested sampling, which shares nothing with it."""

from __future__ import annotations

import numpy as np
import pytest
import small

from lcbayes._jax import jax
from lcbayes.inference import smc

pytest.importorskip("blackjax.ns", reason="needs blackjax >= 1.7, of the extra bench")


@pytest.mark.slow
@pytest.mark.parametrize("n_facets", [1, 2])
def test_evidence_agrees_with_nested_sampling(n_facets):
    """Within 3.5 of the combined error, itself below 0.3: where one method misses half of the
    posterior, or counts a facet's prior twice, it is off by 0.7 or more.
    """
    import nested

    problem, data = small.posed(small.curve(30, n_facets), n_facets=n_facets, spin="none")
    found = smc.replicate(problem, data, jax.random.key(0), 500, 4)
    runs = [
        nested.log_evidence(problem, data, key, n_facets, False, 500)[0]
        for key in jax.random.split(jax.random.key(1), 4)
    ]
    value, error = nested.pooled(runs)
    error = np.hypot(found.se, error)
    assert error < 0.3
    assert abs(found.log_evidence - value) < 3.5 * error
