"""Exact rank test of one transition of every kernel that claims to be exact (Gandy & Scott).

θ is drawn from the prior and data y from the likelihood at θ, so θ is an exact draw from the
posterior given y. From it a chain is grown in both directions with the kernel for that posterior,
m transitions one way and L − 1 − m the other, m uniform on 0 .. L − 1: a reversible kernel is its
own time reversal. If the kernel leaves the posterior invariant, the L states are a stretch of a
stationary chain at which θ stands in a uniformly random place, so the rank of f(θ) among the L
values of f is uniform, exactly, whatever the autocorrelation; ties, which rejections make, are
broken at random. The ranks of many independent repetitions go through a χ² test. Nothing converges
here, nothing is tuned to the data, and no approximation stands between the kernel and the test.

False alarms: a kernel is rejected where the least of five p-values is below a fifth of `EACH`, so
with probability at most `EACH` if it is exact (Bonferroni).

References
----------
Gandy & Scott, "Unit testing for MCMC and other Monte Carlo methods", arXiv:2001.06465, sec. 2.2.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy import stats

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.physics.bodies import facets
from lcbayes.samplers.kernels import ahmc, hmc, metric, mh, rmhmc
from lcbayes.samplers.kernels.adaptation import Params
from lcbayes.simulation.simulate import simulate
from tests.helpers import one_facet_posterior
from tests.helpers.false_alarms import EACH, limit

STATES = 8
REPEATS = 16_000
FEW_REPEATS = 250  # of a kernel whose transitions are dear, and for the quick run
STATISTICS = ("log_albedo_area", "phi", "g", "radius", "potential")


def _published(potential_fn, fisher_fn):
    return ahmc.build_kernel(potential_fn, fisher_fn, exact=False)


# How to build each kernel from U and G, its init, step size, number of steps and δ.
KERNELS = {
    "mh": (lambda u, _: mh.build_kernel(u), mh.init, 0.5, 1, np.inf),
    "hmc": (lambda u, _: hmc.build_kernel(u), hmc.init, 0.25, 3, np.inf),
    "rmhmc": (rmhmc.build_kernel, rmhmc.init, 0.3, 1, np.inf),
    "ahmc": (ahmc.build_kernel, ahmc.init, 0.6, 3, 0.5),
    "ahmc-paper": (_published, ahmc.init, 0.4, 3, np.inf),
}


@pytest.fixture(scope="module")
def case() -> tuple[Problem, Epochs]:
    """One facet in two passes of 11 points, noise as large as the peak of a square metre."""
    what = one_facet_posterior.experiment(2, sigma=0.3, step=10.0)
    data = Epochs.of(simulate(what, 0)[0])
    return one_facet_posterior.posterior(data), data


def prior_draw(problem: Problem, data: Epochs, key: jax.Array) -> jax.Array:
    """An exact draw from the whole prior, visibility included, by rejection.

    The factor `visibility_prior` is at most one: the probability with which to keep a draw.
    """

    def excess(z):
        sites = problem.constrain(z, data)
        u = sites["normals"][0]
        seen = jnp.max(jnp.minimum(data.sun @ u, data.obs @ u))
        return -((jnp.minimum(seen, 0.0) / one_facet_posterior.SOFTNESS) ** 2)

    def again(carry):
        _, _, kept = carry
        return ~kept

    def draw(carry):
        key, _, _ = carry
        key, key_z, key_keep = jax.random.split(key, 3)
        z = problem.prior_draw(key_z, data)
        return key, z, jnp.log(jax.random.uniform(key_keep)) < excess(z)

    return jax.lax.while_loop(again, draw, (key, jnp.zeros(problem.dim), jnp.array(False)))[1]


def ranks(problem: Problem, data: Epochs, name: str, repeats: int, key: jax.Array):
    """Ranks (repeats, 5) of the statistics at θ, 0 .. STATES − 1; and the mean acceptance."""
    build, init, step_size, num_steps, delta = KERNELS[name]
    # A constant metric that knows nothing of any one data set: of the prior, but for the area.
    root = jnp.diag(jnp.array([0.6, 0.4, 0.4, 0.2]))
    scale = metric.Scale(jnp.zeros(4), root, jnp.linalg.inv(root))
    params = Params(jnp.asarray(step_size), jnp.asarray(num_steps), jnp.asarray(delta), scale)

    def statistics(state, data):
        radius = jnp.linalg.norm(problem.unravel(state.z)["normals_base"])
        return jnp.stack(
            [*one_facet_posterior.from_model(problem, state.z, data), radius, state.potential]
        )

    def one(key):
        key_theta, key_data, key_place, key_chain, key_ties = jax.random.split(key, 5)
        theta = prior_draw(problem, data, key_theta)
        here = replace(data, brightness=problem.replicate(theta, data, key_data))
        potential_fn = partial(problem.potential, data=here)
        kernel = build(potential_fn, partial(problem.fisher, data=here))
        first = init(theta, potential_fn)
        place = jax.random.randint(key_place, (), 0, STATES)

        def step(state, at):
            i, key = at
            # transition number `place` begins anew at θ: the other direction of time
            state = jax.tree.map(lambda a, b: jnp.where(i == place, a, b), first, state)
            state, info = kernel(key, state, params)
            return state, (state.z, statistics(state, here), info.accept_prob)

        n = STATES - 1
        keys = jax.random.split(key_chain, n)
        _, (z, others, accept) = jax.lax.scan(step, first, (jnp.arange(n), keys))
        # A tie is a state that was kept, told by z: f of it may differ by rounding.
        same = jnp.all(z == theta, axis=1)
        below = jnp.sum((others < statistics(first, here)) & ~same[:, None], axis=0)
        ties = jax.random.randint(key_ties, below.shape, 0, jnp.sum(same) + 1)
        return below + ties, accept.mean()

    result, accept = jax.lax.map(one, jax.random.split(key, repeats), batch_size=500)
    return result, accept.mean()


def p_values(case: tuple[Problem, Epochs], name: str, repeats: int = REPEATS) -> np.ndarray:
    """χ² test of uniformity for each of `STATISTICS`."""
    problem, data = case
    run = jax.jit(partial(ranks, problem, name=name, repeats=repeats))
    result, accept = run(data=data, key=jax.random.key(7))
    assert 0.3 < accept < 0.99  # a kernel that never moves, or hardly ever rejects, shows little
    counts = [np.bincount(column, minlength=STATES) for column in np.asarray(result).T]
    return np.array([stats.chisquare(count).pvalue for count in counts])


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize(
    ("name", "repeats"),
    [
        pytest.param("mh", REPEATS, marks=pytest.mark.slow),
        pytest.param("hmc", REPEATS, marks=pytest.mark.slow),
        ("ahmc", FEW_REPEATS),
        pytest.param("ahmc", REPEATS, marks=pytest.mark.slow),
        pytest.param("rmhmc", FEW_REPEATS, marks=pytest.mark.slow),
        pytest.param("rmhmc", REPEATS, marks=pytest.mark.slow),
    ],
)
def test_ranks_are_uniform(case, name, repeats):
    assert p_values(case, name, repeats).min() > EACH / len(STATISTICS)


@pytest.mark.slow
def test_few_repeats_suffice_to_find_out_the_published_rule(case):
    """So that those granted to RMHMC mean something."""
    assert p_values(case, "ahmc-paper", FEW_REPEATS).min() < 1e-8


@pytest.mark.slow
def test_ranks_under_the_published_rule_are_not(case):
    assert p_values(case, "ahmc-paper").min() < 1e-20


@pytest.mark.statistical(false_alarm=EACH)
def test_prior_draws_are_of_the_models_prior(case):
    """Directions against sums over a fine grid of the sphere, weighted by the visibility prior.

    Five comparisons.
    """
    problem, data = case
    keys = jax.random.split(jax.random.key(0), 20_000)
    z = jax.jit(jax.vmap(partial(prior_draw, problem, data)))(keys)
    sites = jax.vmap(lambda z: problem.constrain(z, data))(z)
    sun, obs = np.asarray(data.sun), np.asarray(data.obs)

    def seen(u):
        return np.max(np.minimum(sun @ u.T, obs @ u.T), axis=0)

    drawn, sphere = np.asarray(sites["normals"])[:, 0], facets.grid(200_000)
    weight = np.exp(-((np.minimum(seen(sphere), 0.0) / one_facet_posterior.SOFTNESS) ** 2))
    weight /= weight.sum()
    n = len(drawn)
    error = drawn.std(axis=0) / np.sqrt(n)
    most = limit(5)
    assert np.all(np.abs(drawn.mean(axis=0) - weight @ sphere) < most * error)
    beyond = weight[seen(sphere) < 0].sum()
    assert np.mean(seen(drawn) < 0) == pytest.approx(beyond, abs=most * np.sqrt(beyond / n))
    assert np.mean(sites["log_albedo_area"]) == pytest.approx(0.0, abs=most / np.sqrt(n))
