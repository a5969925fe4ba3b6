"""A search is repeated with a drift of the rate if no constant rate explains the data."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.inference import search
from lcbayes.inference.fit import Stages
from lcbayes.inference.problem_cache import build_problem
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.settings import NUTS, Settings
from tests.helpers.turning_facets import GAP, Truth

LAW = "lambertian"
OMEGA_SD = 0.008


class Heard(Silent):
    """Progress that keeps what is said."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def say(self, text: str) -> None:
        self.lines.append(text)


@pytest.mark.slow
@pytest.mark.parametrize("drift", [0.0, 0.008])
def test_a_rate_that_drifts_is_searched_if_no_constant_one_explains_the_data(drift):
    """Three passes, of which the second is 1.3 rad off a constant rate."""
    truth = Truth(passes=(0.0, 5 * GAP, 11.5 * GAP), drift=drift)
    entry, data = registry.find("faceted"), Epochs.of(truth.curve)
    options = {"n_facets": 3, "omega_sd": OMEGA_SD, "reflectance": LAW, "period": "290-310s"}
    plain, _ = build_problem(entry, options, data)
    heard = Heard()
    stages = Stages.of(plain, entry, options, Settings(NUTS), Checkpoint(None, {}), heard)
    found = stages.search(data, jax.random.key(0))
    assert ("searching again" in " ".join(heard.lines)) == bool(drift)
    sd = 0.01 / np.hypot(1.0, 0.01 * np.linalg.norm(truth.omega) * np.ptp(truth.curve.t) / 8.0)
    unit = np.array([drift / sd])
    body = Bodies(truth.omega[None], truth.normals[None], truth.areas[None], unit)
    best = search.polish(plain, data, starts(plain, data, body, OMEGA_SD), 1)
    assert found.solutions[0].potential <= float(best.potential[0]) + 0.5
