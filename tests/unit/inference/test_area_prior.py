"""The median of the prior on areas, and what it changes."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jnp
from lcbayes.inference import odds
from lcbayes.inference.area_prior import area_prior_of, bic
from lcbayes.modelling import registry
from tests.helpers import small_curves


def at(areas, n: int = 40):
    problem, data = small_curves.posterior(small_curves.curve(n), n_facets=len(areas), spin="none")
    normals = np.resize(small_curves.NORMALS, (len(areas), 3))
    sites = {
        "normals_base": jnp.asarray(normals),
        "log_albedo_area": jnp.log(jnp.asarray(areas, float)),
    }
    return problem, np.asarray(problem.ravel(sites)), data


def test_the_median_is_the_typical_area():
    """Σα²/Σα = 34/8 of 3 and 5 m²; a facet of 10⁻⁴ m² does not change three digits of it."""
    entry = registry.find("faceted")
    for areas in ([3.0, 5.0], [3.0, 5.0, 1e-4]):
        problem, z, data = at(areas)
        result = area_prior_of(entry, {}, problem, z, data)
        assert result is not None
        assert np.exp(result.log_mean) == pytest.approx(4.25)
        assert (result.log_sd, result.default, result.from_data) == (1.0, 0.0, True)


def test_a_median_that_is_given_stays():
    problem, z, data = at([3.0, 5.0])
    options = {"log_area_mean": 0.7, "log_area_sd": 2.0}
    result = area_prior_of(registry.find("faceted"), options, problem, z, data)
    assert result == (0.7, 2.0, 0.0, False)


def test_a_facet_divided_in_two_has_the_larger_criterion():
    """The same likelihood, and three more parameters: 3 ln 40."""
    one, z_one, data = at([6.0])
    two, _, _ = at([3.0, 3.0])
    normals = np.stack([small_curves.NORMALS[0]] * 2)
    halves = {
        "normals_base": jnp.asarray(normals),
        "log_albedo_area": jnp.log(jnp.array([3.0, 3.0])),
    }
    z_two = np.asarray(two.ravel(halves))
    assert bic(two, z_two, data) - bic(one, z_one, data) == pytest.approx(3 * np.log(40))


def test_the_evidence_under_another_median_is_that_of_quadrature():
    """One area with likelihood N(ln α; 1, 0.3²): Z is a normal density of the two variances."""
    rng = np.random.default_rng(0)
    variance = 1.0 / (1.0 / 0.3**2 + 1.0)
    draws = variance * (1.0 / 0.3**2 + 0.5) + np.sqrt(variance) * rng.normal(size=(40_000, 1))
    change, effective = odds.evidence_change(draws, 0.5, 1.0, 1.5)
    want = -0.5 * ((1.0 - 1.5) ** 2 - (1.0 - 0.5) ** 2) / (1.0 + 0.3**2)
    assert change == pytest.approx(want, abs=0.01)
    assert 30_000 < effective < 40_000
    assert odds.evidence_change(draws, 0.5, 1.0, 0.5) == (0.0, pytest.approx(40_000))
