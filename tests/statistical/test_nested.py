"""Evidence from tempered particles against nested sampling, which shares nothing with it."""

from __future__ import annotations

import pytest

from lcbayes.core.jax_setup import jax
from lcbayes.samplers import smc
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit

RUNS = 16

pytest.importorskip("blackjax.ns", reason="needs blackjax >= 1.7, of the extra bench")


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
@pytest.mark.parametrize("n_facets", [1, 2])
def test_evidence_agrees_with_nested_sampling(n_facets):
    """Each in its own error, with half of the rate: that of particles is told by their runs (t),
    that of nested sampling is at least what its shrinking volumes leave (normal). A difference of
    1.2 nats or more is found out.
    """
    from tests.helpers import nested_sampling

    problem, data = small_curves.posterior(
        small_curves.curve(30, n_facets), n_facets=n_facets, spin="none"
    )
    result = smc.replicate(problem, data, jax.random.key(0), 500, RUNS)
    runs = [
        nested_sampling.log_evidence(problem, data, key, n_facets, False, 500)[0]
        for key in jax.random.split(jax.random.key(1), 4)
    ]
    value, error = nested_sampling.pooled(runs)
    most = limit(2, RUNS - 1) * result.se + limit(2) * error
    assert most < 1.2
    assert abs(result.log_evidence - value) < most
