"""The evidence of a rotation against a sum over draws of the prior, with a simulator in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers import annealing
from tests.helpers.false_alarms import EACH, limit
from tests.helpers.turning_facets import cosines, flux, in_body_axes, unit

N_FACETS, N_EPOCHS, N_DRAWS = 3, 8, 300_000
OMEGA_SD, ERROR = 0.004, 0.2  # rad/s, m²
RUNS = 16
SOFT = 0.02  # of the edge of visibility, as `lcbayes models faceted` says


def flux_and_visibility(t, sun, obs, omega, normals, areas):
    """Lambert's law μ₀μ/π, and ln of the prior that each facet is lit and seen."""
    mu0, mu = cosines(in_body_axes(sun, t, omega), in_body_axes(obs, t, omega), normals)
    best = np.minimum(np.minimum(mu0, mu).max(axis=1), 0.0)
    return flux(mu0, mu, areas), -np.sum((best / SOFT) ** 2, axis=1)


@pytest.fixture(scope="module")
def case():
    """A light curve of a turning body, and ln of its evidence with its error."""
    rng = np.random.default_rng(3)
    t = np.linspace(0.0, 150.0, N_EPOCHS)
    sun = unit(np.array([1.0, 0.0, 0.2]) + 0.3 * rng.standard_normal((N_EPOCHS, 3)))
    obs = unit(np.array([0.4, 0.8, -0.3]) + 0.3 * rng.standard_normal((N_EPOCHS, 3)))
    omega = OMEGA_SD * rng.standard_normal((N_DRAWS, 3))
    normals = unit(rng.standard_normal((N_DRAWS, N_FACETS, 3)))
    areas = np.exp(rng.standard_normal((N_DRAWS, N_FACETS)))
    expected, visible = flux_and_visibility(t, sun, obs, omega, normals, areas)
    truth = np.flatnonzero(visible == 0.0)[0]
    y = expected[truth] + ERROR * rng.standard_normal(N_EPOCHS)
    log_l = -0.5 * np.sum(((y - expected) / ERROR) ** 2, axis=1)
    log_l -= N_EPOCHS * (np.log(ERROR) + 0.5 * np.log(2.0 * np.pi))
    keep = np.arange(N_DRAWS) != truth  # whose likelihood is no draw of the prior
    log_weight = (log_l + visible)[keep]
    top = log_weight.max()
    weight = np.exp(log_weight - top)
    error = weight.std() / weight.mean() / np.sqrt(len(weight))
    error_of_flux = np.full(N_EPOCHS, ERROR)
    curve = LightCurve(t=t, brightness=y, error=error_of_flux, kind="flux", sun=sun, obs=obs)
    return curve, top + np.log(weight.mean()), error


def annealed(curve, wider, monkeypatch):
    """ln of the evidence from a density of ω so many times as wide as its prior."""
    entry, data = registry.find("faceted"), Epochs.of(curve)
    options = {"n_facets": N_FACETS, "omega_sd": OMEGA_SD, "reflectance": "lambertian"}
    _, problem = build_problem(entry, options, data)
    hook = entry.hook("moves")
    assert hook is not None
    moves = hook(problem, data, **options)
    draws = np.asarray(
        jax.vmap(lambda k: problem.prior_draw(k, data))(jax.random.split(jax.random.key(0), 400))
    )
    monkeypatch.setattr(annealing, "WIDER", wider)
    monkeypatch.setattr(annealing, "RUNS", RUNS)
    return annealing.log_evidence(problem, data, moves, draws, jax.random.key(1), 2)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("wider", [pytest.param(0.5, marks=pytest.mark.slow), 2.0])
def test_the_evidence_is_that_of_the_prior(case, wider, monkeypatch):
    """Whatever the density from which the angular velocity begins."""
    curve, expected, error = case
    found = annealed(curve, wider, monkeypatch)
    assert error < 0.05
    assert found.se < 0.15
    assert abs(found.value - expected) < limit(dof=RUNS - 1) * np.hypot(found.se, error)


def test_prior_densities_of_the_sites_add_up_to_the_posterior(case):
    """Also where the angular velocity is sampled in other coordinates, whose Jacobian counts."""
    curve = replace(case[0], t=100.0 * case[0].t)
    data = Epochs.of(curve)
    options = {"n_facets": N_FACETS, "omega_sd": 0.1, "reflectance": "lambertian"}
    plain, problem = build_problem(registry.find("faceted"), options, data)
    assert problem is not plain
    for z in jax.vmap(lambda k: problem.prior_draw(k, data))(
        jax.random.split(jax.random.key(2), 5)
    ):
        parts = sum(problem.log_density(name, z, data) for name in problem.names)
        parts += problem.log_factors(z, data) + problem.log_likelihood(z, data).sum()
        np.testing.assert_allclose(parts, -problem.potential(z, data), rtol=1e-9)


def test_a_population_that_does_not_arrive_has_no_evidence(case, monkeypatch):
    """The error is infinite, so that the weight that follows from it is not used."""
    monkeypatch.setattr(annealing, "MAX_STAGES", 1)
    found = annealed(case[0], 2.0, monkeypatch)
    assert found.value == -np.inf
    assert found.se == np.inf
