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
    """Within 3.5 of the combined error, itself below 0.25: where one method misses half of the
    posterior, or counts a facet's prior twice, it is off by 0.7 or more.
    """
    import nested

    problem, data = small.posed(small.curve(30, n_facets), n_facets=n_facets, spin="none")
    found = smc.replicate(problem, data, jax.random.key(0), 500, 4)
    one, _ = nested.log_evidence(problem, data, jax.random.key(1), n_facets, False, 1000)
    error = np.hypot(found.se, one.se)
    assert error < 0.25
    assert abs(found.log_evidence - one.value) < 3.5 * error
