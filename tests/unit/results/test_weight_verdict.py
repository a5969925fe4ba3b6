"""An uncertain weight counts where the solution may hold a share of the posterior."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lcbayes.results.summary import _findings
from lcbayes.samplers.bridge import LogEvidence

CONVERGED = {"max_rhat": 1.0, "min_ess_bulk": 1e3, "min_ess_tail": 1e3, "divergences": 0}


def codes(weights, errors):
    modes = [
        SimpleNamespace(
            weight=weight,
            log_evidence=LogEvidence(0.0, error),
            stats={"diverging": np.zeros((4, 100))},
            run_weights=None,
            z=np.zeros((4, 100, 2)),
            apart=1.0,
            solution=SimpleNamespace(hits=9),
        )
        for weight, error in zip(weights, errors, strict=True)
    ]
    posterior: Any = SimpleNamespace(
        reasons=[], modes=modes, searched=None, data=SimpleNamespace(has_error=True), n_starts=1
    )
    misfit: Any = SimpleNamespace(explained=True)
    entries: Any = [CONVERGED] * len(modes)
    return [f.code for f in _findings(posterior, entries, misfit)]


@pytest.mark.parametrize(
    ("weights", "errors", "uncertain"),
    [
        ((0.7, 0.3), (0.0, 0.3), False),
        ((0.7, 0.3), (0.0, 3.0), True),
        ((0.9995, 0.0005), (0.0, 3.0), True),  # it may hold a fifth
        ((1.0, 1e-9), (0.0, 3.0), False),
        ((0.99, 0.01), (0.0, 0.6), True),  # it may hold 3 %
        ((1.0,), (37.0,), False),  # there is nothing to weigh it against
    ],
)
def test_uncertain_weights(weights, errors, uncertain):
    assert codes(weights, errors) == ["weight-uncertain"] * uncertain
