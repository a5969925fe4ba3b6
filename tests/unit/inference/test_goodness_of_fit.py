"""χ² and degrees of freedom of a fit: what they are, and how often they reject the truth."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy import special, stats

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference import goodness_of_fit, search
from lcbayes.inference.goodness_of_fit import Misfit
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, counts

N = 100
LAWS = ("gaussian", "student-t", "mixture")
OUTLIERS = {"logit_outlier_share": jnp.array(-3.4), "log_outlier_excess": jnp.log(4.0)}


@lru_cache  # and with it the programs
def linear(law: str, n_estimated: int = 6, held: int = 0, n: int = N, condition: bool = False):
    """A flux linear in some parameters that the data tell and some that the prior holds."""
    basis = jnp.asarray(np.random.default_rng(8).standard_normal((n, n_estimated + held)))
    sd = jnp.asarray(np.r_[np.full(n_estimated, 1.0), np.full(held, 1e-5)])

    def model(data):
        c = jnp.asarray(numpyro.sample("c", dist.Normal(0.0, sd).to_event(1)))
        if condition:
            numpyro.sample("sum", dist.Normal(jnp.sum(c), 1e-6), obs=0.0)
        likelihood.observe(data, 10.0 + basis @ c, law)  # pyright: ignore[reportArgumentType]

    data = Epochs.of(small_curves.curve(n, brightness=np.full(n, 10.0), error=np.full(n, 0.01)))
    return Problem(model, data), data


def at_zero(problem: Problem) -> np.ndarray:
    sites = {"c": jnp.zeros(problem.rows(["c"]).size)} | OUTLIERS
    return np.asarray(problem.ravel(sites))


@pytest.mark.parametrize("law", LAWS)
def test_chi2_is_of_normal_quantiles(law):
    """However far a point is: SciPy's laws in the tail, and of a mixture what is left of it."""
    problem, data = linear(law)
    z = at_zero(problem)
    for r in (0.0, 0.3, -2.5, 7.0, -60.0, 400.0):
        far = jnp.asarray(np.r_[10.0 + 0.01 * r, np.full(N - 1, 10.0)])
        result = goodness_of_fit.chi2(problem, z, replace(data, brightness=far))
        e = special.expit(-3.4)
        tail = {
            "gaussian": stats.norm.logsf(abs(r)),
            "student-t": stats.t.logsf(abs(r), 4),
            "mixture": special.logsumexp(stats.norm.logsf([abs(r), abs(r) / 5]), b=[1 - e, e]),
        }[law]
        assert result == pytest.approx(special.ndtri_exp(tail) ** 2, rel=1e-6, abs=1e-12)
    assert (result == pytest.approx(400.0**2, rel=1e-9)) is (law == "gaussian")


@pytest.mark.parametrize("law", LAWS)
def test_parameters_that_the_prior_holds_take_no_freedom(law):
    problem, data = linear(law, n_estimated=4, held=30)
    assert goodness_of_fit.degrees_of_freedom(problem, at_zero(problem), data) == pytest.approx(
        96, abs=0.01
    )


def test_only_the_brightness_takes_freedom():
    """A sum of the parameters that is conditioned on leaves the data one fewer to set."""
    problem, data = linear("gaussian", n_estimated=4, condition=True)
    result = goodness_of_fit.degrees_of_freedom(problem, at_zero(problem), data)
    assert result == pytest.approx(97, abs=0.01)


def test_a_direction_is_two_parameters_and_an_area_one():
    problem, data = small_curves.posterior(
        small_curves.curve(60, 2, noise=0.01), n_facets=2, spin="none"
    )
    z = np.asarray(small_curves.truth(problem, data, 2))
    assert (problem.dim, problem.n_parameters) == (8, 6)
    assert goodness_of_fit.measure(problem, data, z[None]).dof == pytest.approx(60 - 6, abs=0.1)


def test_misfit_is_seen_where_no_freedom_is_left():
    problem, data = linear("gaussian", n_estimated=12, n=8)
    z = at_zero(problem)
    assert goodness_of_fit.degrees_of_freedom(problem, z, data) == 8.0
    poor = replace(data, brightness=data.brightness.at[2].add(0.13))
    assert goodness_of_fit.measure(problem, data, z[None]).explained
    assert not goodness_of_fit.measure(problem, poor, z[None]).explained


def test_the_row_that_fits_best_counts():
    problem, data = linear("gaussian")
    z = at_zero(problem)
    rows = np.stack([z + 1.0, z, z - 1.0, np.full_like(z, np.nan)])
    assert goodness_of_fit.measure(problem, data, rows).chi2 == goodness_of_fit.chi2(
        problem, z, data
    )


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(
    "law",
    [
        "gaussian",
        pytest.param("student-t", marks=pytest.mark.slow),
        pytest.param("mixture", marks=pytest.mark.slow),
    ],
)
def test_the_truth_is_rejected_as_often_as_it_should_be(law):
    """100 points drawn from the law that is fitted: at the 5 % level one fit in twenty."""
    problem, data = linear(law)
    n = 300

    def fitted(key):
        drawn, noisy = jax.random.split(key)
        truth = problem.prior_draw(drawn, data)
        seen = replace(data, brightness=problem.replicate(truth, data, noisy))
        begin = search.SearchState(
            truth[None], jnp.full(1, jnp.inf), jnp.full(1, 1e-3), jnp.zeros(1)
        )
        return seen.brightness, search.advance(problem, seen, begin, 50).z[0]

    seen, z = jax.jit(jax.vmap(fitted))(jax.random.split(jax.random.key(1), n))
    chi2 = [
        goodness_of_fit.chi2(problem, best, replace(data, brightness=y))
        for y, best in zip(seen, np.asarray(z), strict=True)
    ]
    dof = goodness_of_fit.degrees_of_freedom(problem, np.asarray(z[0]), data)  # the same for all
    assert dof == pytest.approx(N - 6, abs=0.1)
    assert all(Misfit(one, dof, law).explained for one in chi2)
    least, most = counts(n, 0.05)
    assert least <= np.sum(stats.chi2.sf(chi2, dof) < 0.05) <= most


def test_words_advise_nothing_that_is_done():
    said = Misfit(300.0, 100.0, "gaussian").words
    assert "chi2 is 300 for 100 degrees of freedom" in said
    assert "--noise student-t" in said
    for law in ("student-t", "mixture"):
        said = Misfit(300.0, 97.6, law).words
        assert f"as normal quantiles by --noise {law}, is 300 for 97.6 degrees" in said
        assert said.endswith("try more facets or another law")
    known = Misfit(300.0, 97.6, "mixture", facets=False)
    assert known.words.endswith("another body or another law")
