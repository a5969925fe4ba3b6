"""Draws that miss arrangements of facets are told from draws that do not.

Without information in the data the posterior is the prior, from which facets are drawn here.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.arrangements import missed
from lcbayes.inference.label_switching import FacetOrder
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.results.reasons import reason

N_FACETS, N_EPOCHS, CHAINS, DRAWS = 3, 24, 4, 250
OPTIONS = {"n_facets": N_FACETS, "omega_sd": 1.0}


@pytest.fixture(scope="module")
def problem():
    """A body that turns, observed with errors far above its brightness."""
    t = np.linspace(0.0, 100.0, N_EPOCHS)
    sun, obs = np.tile([1.0, 0.0, 0.0], (N_EPOCHS, 1)), np.tile([0.8, 0.6, 0.0], (N_EPOCHS, 1))
    curve = LightCurve(
        t=t, brightness=np.ones(N_EPOCHS), error=np.full(N_EPOCHS, 1e6), sun=sun, obs=obs,
        kind="flux", free_scale=np.array([False]),
    )  # fmt: skip
    data = Epochs.of(curve)
    return build_problem(registry.find("faceted"), OPTIONS, data)[1], data


def draws(problem, allowed):
    """Facets of the prior that are lit and seen at some epoch, all of them ``allowed``."""
    rng = np.random.default_rng(5)
    omega = np.array([0.0, 0.0, 0.1])  # in the plane of Sun and observer every azimuth is seen
    rows = []
    while len(rows) < CHAINS * DRAWS:
        base = rng.standard_normal((N_FACETS, 3))
        base /= np.linalg.norm(base, axis=1, keepdims=True)
        if np.abs(base[:, 2]).max() < 0.95 and allowed(base):
            base *= 1.0 + 0.1 * rng.standard_normal((N_FACETS, 1))
            area = rng.standard_normal(N_FACETS)
            rows.append((base, area))
    base, area = (np.array(x) for x in zip(*rows, strict=True))
    ravel = jax.jit(
        jax.vmap(
            lambda b, a: problem.ravel(
                {"omega_unit": jnp.asarray(omega), "normals_base": b, "log_albedo_area": a}
            )
        )
    )
    return np.asarray(ravel(base, area)).reshape(CHAINS, DRAWS, -1)


@pytest.mark.parametrize(
    ("allowed", "found"),
    [(lambda _: True, False), (lambda base: np.all(base[:, 0] > 0.3), True)],
    ids=["everywhere", "one side only"],
)
def test_missed_arrangements_are_noticed(problem, allowed, found):
    problem, data = problem
    order = FacetOrder(problem, registry.find("faceted").facet_sites)
    flat = draws(problem, allowed)
    z = order.like_all(flat.reshape(-1, problem.dim), flat[0, 0]).reshape(flat.shape)
    hook = registry.find("faceted").hook("moves")
    assert hook is not None
    moves = hook(problem, data, **OPTIONS)
    mode: Any = SimpleNamespace(z=z, weight=1.0)
    findings = missed(moves, [mode], order, data, jax.random.key(0))
    assert [f.code for f in findings] == ["facets-elsewhere"] * found
    if found:
        assert "did not see every arrangement" in reason(findings[0]).text
    unlikely: Any = SimpleNamespace(z=z, weight=0.01)
    assert missed(moves, [unlikely], order, data, jax.random.key(0)) == []
