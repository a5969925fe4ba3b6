"""The largest likelihood of a number of facets, and bodies with facets left out."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import screening
from lcbayes.inference.prior_mass import log_prior_mass
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled, prior_draws
from lcbayes.results.reasons import reason as sentence
from tests.helpers import small_curves

SITES = registry.find("faceted").facet_sites


def problem_of(n: int) -> tuple[Problem, Epochs]:
    data = Epochs.of(small_curves.curve(16))
    return Problem(registry.find("faceted").bind({"n_facets": n, "spin": "none"}), data), data


@pytest.fixture(scope="module")
def one() -> tuple[Problem, Epochs]:
    return problem_of(1)


def test_no_evidence_and_no_body_exceeds_the_largest_likelihood(one):
    """One facet: ln Z by quadrature is below; a fine grid of bodies has no better fit."""
    from tests.helpers import one_facet_posterior

    problem, data = one
    draw = jax.jit(jax.vmap(problem.prior_draw, (0, None)))
    starts = np.asarray(draw(jax.random.split(jax.random.key(1), 12), data))
    below, z = screening.largest_likelihood(problem, data, starts, 1)
    mass = log_prior_mass(problem, data, jax.random.key(2)).value
    exact = one_facet_posterior.Quadrature.of(data).log_evidence(data)
    assert exact - mass < below

    likelihood = jax.jit(jax.vmap(lambda z: problem.log_likelihood(z, data).sum()))
    at = float(likelihood(jnp.asarray(z[None]))[0])
    assert below == pytest.approx(at)  # with or without what the factors leave of the prior
    many = draw(jax.random.split(jax.random.key(3), 20_000), data)
    assert float(likelihood(many).max()) < at + 0.05  # what the prior pulls
    near = z + 0.05 * np.random.default_rng(4).normal(size=(2000, problem.dim))
    assert float(likelihood(jnp.asarray(near)).max()) < at + 0.05


def test_half_the_information_halves_it(one):
    from dataclasses import replace

    problem, data = one
    half = replace(data, information=0.5 * data.information)
    rows = np.asarray(prior_draws(problem, jax.random.key(5)[None], data))
    whole, _ = screening.largest_likelihood(problem, data, rows, 1)
    part, _ = screening.largest_likelihood(problem, half, rows, 1)
    assert part == pytest.approx(0.5 * whole, abs=0.5)  # the prior pulls more


def test_facets_left_out(one):
    """Each of two bodies of one facet; the flux of both together is that of the whole."""
    (smaller, data), (larger, _) = one, problem_of(2)
    z = np.asarray(prior_draws(larger, jax.random.key(7)[None], data))[0]
    rows = screening.with_fewer(larger, z, smaller, SITES, data)
    assert rows.shape == (2, smaller.dim)
    moments = compiled(smaller.moments)
    parts = sum(np.asarray(moments(jnp.asarray(row), data).mean) for row in rows)
    np.testing.assert_allclose(
        parts, compiled(larger.moments)(jnp.asarray(z), data).mean, rtol=1e-12
    )


def test_problems_of_other_sites_give_no_bodies(one):
    smaller, data = one
    turning = Problem(registry.find("faceted").bind({"n_facets": 2}), data)
    z = np.asarray(prior_draws(turning, jax.random.key(8)[None], data))[0]
    assert len(screening.with_fewer(turning, z, smaller, SITES, data)) == 2  # ω is left out
    small_one = np.asarray(prior_draws(smaller, jax.random.key(9)[None], data))[0]
    assert screening.with_fewer(smaller, small_one, turning, SITES, data).shape == (
        0,
        turning.dim,
    )


def test_more_facets_that_fit_worse_are_at_a_local_optimum():
    """Their particles are elsewhere; likelihoods count as much as the points do."""
    result = {4: -80.0, 2: -400.0, 3: -30.0, 5: -20.0, 6: -62.0}
    lost = screening.lost(result, 1.0)
    assert list(lost) == [4, 6]
    assert "fit 50 nats worse than with 3; increase" in sentence(lost[4]).text
    assert "42 nats worse than with 5" in sentence(lost[6]).text
    assert list(screening.lost(result, 0.7)) == [4]
    assert screening.lost({2: -400.0, 3: -30.0}, 1.0) == {}
