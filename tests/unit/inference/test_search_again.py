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
from lcbayes.inference.spin_search.allowed import Allowed
from lcbayes.inference.spin_search.arcs import Arcs, Points
from lcbayes.inference.spin_search.cells import Grid
from lcbayes.inference.spin_search.drift import Drift
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.inference.spin_search.series import Series, precision, total_area
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.settings import NUTS, Settings
from tests.helpers.heard import Heard
from tests.helpers.turning_facets import GAP, Truth

LAW = "lambertian"
OMEGA_SD = 0.008


@pytest.mark.slow
def test_cells_with_the_right_drift_have_the_evidence():
    """Five passes: in three, another number of turns has nearly the phases of another drift."""
    truth = Truth(passes=(0.0, 2 * GAP, 5 * GAP, 9 * GAP, 12 * GAP), drift=0.008)
    data, series = Epochs.of(truth.curve), Series.of(LAW)
    points = Points.of(data)
    prior = precision(series, total_area(series, points.sun, points.obs, points.flux))
    rate = float(np.linalg.norm(truth.omega))
    allowed = Allowed(((0.99 * rate, 1.01 * rate),))
    arcs = Arcs.of(points, 1.01 * rate, 0.15)
    span = float(np.ptp(truth.curve.t))
    found = {}
    for sd in (0.0, 0.01):
        drift = Drift(0.5 * span, span, sd)
        grid = Grid.of(series, arcs, prior, allowed, drift)
        found[sd] = grid.search(1, Silent(), 1000).cells
    cells = found[0.01]
    assert cells.score[0] > found[0.0].score[0] + 30.0
    unit = 0.008 / 0.01 * np.hypot(1.0, 0.01 * rate * span / 8.0)
    near = grid.poles[cells.pole] @ truth.omega / rate > np.cos(np.radians(14.0))
    near &= (np.abs(cells.rate - rate) * span < 2.0) & (np.abs(cells.drift - unit) < 0.7)
    assert np.flatnonzero(near).min(initial=1000) < 5  # drifts are 0.625 apart


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
