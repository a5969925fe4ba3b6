"""Every kernel, through one protocol: NumPyro's MCMC and what it lets a user do."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
import small
from numpyro.infer import MCMC

from lcbayes import gallery
from lcbayes._jax import jax, jnp
from lcbayes.epochs import Epochs
from lcbayes.errors import InputError
from lcbayes.kernels import AHMC, HMC, RMHMC, MetropolisHastings

COVARIANCE = np.array([[1.0, 0.5], [0.5, 0.8]])
PRECISION = jnp.asarray(np.linalg.inv(COVARIANCE))
START = {"y": jnp.array([0.3, -0.2])}


def potential(z, scale=1.0):
    return 0.5 * scale * z["y"] @ PRECISION @ z["y"]


def fisher(z, scale=1.0):
    return scale * PRECISION * (1.0 + 0.1 * jnp.tanh(z["y"][0]))


@dataclass(frozen=True)
class Kind:
    name: str
    make: Callable[..., Any]
    exact: bool = True


def _published(*args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return AHMC(*args, exact=False, **options)


KINDS = [
    Kind("mh", MetropolisHastings),
    Kind("hmc", HMC),
    Kind("ahmc", AHMC),
    Kind("ahmc-paper", _published, exact=False),
    Kind("rmhmc", RMHMC),
]


@pytest.fixture(params=KINDS, ids=lambda k: k.name)
def kind(request) -> Kind:
    return request.param


def make(kind: Kind, **options):
    return kind.make(potential_fn=potential, fisher_fn=fisher, **options)


def sampler(kernel, num_warmup=60, num_samples=40, num_chains=1, **options) -> MCMC:
    with warnings.catch_warnings():
        # One device: NumPyro says that it runs the chains one after the other, and does.
        warnings.filterwarnings("ignore", "There are not enough devices", UserWarning)
        return MCMC(
            kernel,
            num_warmup=num_warmup,
            num_samples=num_samples,
            num_chains=num_chains,
            **({"progress_bar": False, "chain_method": "vectorized"} | options),
        )


def last(mcmc: MCMC) -> Any:
    """The state after a run, one chain's or a batch."""
    assert mcmc.last_state is not None
    return mcmc.last_state


def starts(n):
    return jax.tree.map(lambda x: jnp.broadcast_to(x, (n, *x.shape)), START)


@cache
def ran(kind: Kind, method: str) -> MCMC:
    mcmc = sampler(make(kind), num_chains=2, chain_method=method)
    mcmc.run(
        jax.random.key(3), init_params=starts(2), extra_fields=("step_size", "i", "accept_prob")
    )
    return mcmc


@pytest.mark.parametrize("method", ["sequential", "vectorized", "parallel"])
def test_chain_methods(kind, method):
    mcmc = ran(kind, method)
    y = mcmc.get_samples(group_by_chain=True)["y"]
    assert y.shape == (2, 40, 2)
    assert y.dtype == jnp.float64
    assert np.all(np.isfinite(y))
    assert np.unique(np.asarray(y[0, :, 0])).size > 2
    assert not np.array_equal(y[0], y[1])


@pytest.mark.parametrize("method", ["vectorized", "parallel"])
def test_chain_methods_agree(kind, method):
    """A chain is the same whether it runs alone or beside others."""
    got = ran(kind, method).get_samples()["y"]
    np.testing.assert_allclose(got[:5], ran(kind, "sequential").get_samples()["y"][:5], atol=1e-4)


def test_frozen_after_warmup(kind):
    """Nothing that a transition rests on changes once draws are kept."""
    mcmc = ran(kind, "vectorized")
    fields = mcmc.get_extra_fields(group_by_chain=True)
    assert np.ptp(np.asarray(fields["step_size"]), axis=1).max() == 0.0
    np.testing.assert_array_equal(fields["i"][0], np.arange(61, 101))
    kernel, state = mcmc.sampler, jax.tree.map(lambda x: x[0], last(mcmc))
    after = kernel.sample(state, (), {})
    for a, b in zip(
        jax.tree.leaves(state.adapt_state), jax.tree.leaves(after.adapt_state), strict=True
    ):
        np.testing.assert_array_equal(a, b)


def test_adapts_during_warmup(kind):
    mcmc = ran(kind, "vectorized")
    first = mcmc.sampler.init(jax.random.key(0), 60, START, (), {})
    assert float(first.step_size) != float(last(mcmc).step_size[0])
    assert not np.allclose(first.adapt_state.scale.root, last(mcmc).adapt_state.scale.root[0])


def test_seed_decides(kind):
    """The same seed gives the same numbers, another seed others."""

    mcmc = sampler(make(kind), num_chains=2)

    def draws(seed):
        mcmc.run(jax.random.key(seed), init_params=starts(2))
        return np.asarray(mcmc.get_samples()["y"])

    known = np.asarray(ran(kind, "vectorized").get_samples()["y"])
    np.testing.assert_array_equal(draws(3), known)
    assert not np.array_equal(draws(4), known)


def test_resume_is_bit_identical(kind):
    """A stored state, read into a fresh sampler, goes on as though nothing had happened."""
    long = sampler(make(kind), num_samples=40)
    long.run(jax.random.key(7), init_params=START)
    half = sampler(make(kind), num_samples=20)
    half.run(jax.random.key(7), init_params=START)
    state = last(half)
    stored = pickle.dumps(
        jax.tree.map(np.asarray, state._replace(rng_key=jax.random.key_data(state.rng_key)))
    )
    back = jax.tree.map(jnp.asarray, pickle.loads(stored))
    back = back._replace(rng_key=jax.random.wrap_key_data(back.rng_key))
    rest = sampler(make(kind), num_warmup=0, num_samples=20)
    rest.post_warmup_state = back
    rest.run(back.rng_key)
    both = np.concatenate([half.get_samples()["y"], rest.get_samples()["y"]])
    np.testing.assert_array_equal(both, long.get_samples()["y"])


@pytest.mark.parametrize("method", ["sequential", "vectorized", "parallel"])
def test_resume_of_several_chains(method):
    """All chains go on from their own states under every chain method."""
    kind = KINDS[2]
    first = ran(kind, method)
    rest = sampler(make(kind), num_chains=2, num_samples=10, chain_method=method)
    rest.post_warmup_state = last(first)
    rest.run(last(first).rng_key)
    y = rest.get_samples(group_by_chain=True)["y"]
    second = jax.tree.map(lambda x: x[1], last(first))
    np.testing.assert_allclose(y[1, 0], first.sampler.sample(second, (), {}).z["y"], rtol=1e-10)


def test_pickles(kind):
    kernel = pickle.loads(pickle.dumps(make(kind)))
    mcmc = sampler(kernel, num_chains=2)
    mcmc.run(jax.random.key(3), init_params=starts(2))
    np.testing.assert_array_equal(
        mcmc.get_samples()["y"], ran(kind, "vectorized").get_samples()["y"]
    )
    again = pickle.loads(pickle.dumps(mcmc))
    np.testing.assert_array_equal(again.get_samples()["y"], mcmc.get_samples()["y"])


def test_diagnostics(kind):
    mcmc = ran(kind, "vectorized")
    state = jax.tree.map(lambda x: x[0], last(mcmc))
    assert "acc. prob=0." in mcmc.sampler.get_diagnostics_str(state)
    text = mcmc.sampler.describe(state)
    assert text.startswith(type(mcmc.sampler).__name__)
    assert f"{float(state.step_size):.3g}" in text
    assert mcmc.sampler.describe(last(mcmc)).startswith("chain 1: ")


def test_progress_bar(capsys):
    mcmc = sampler(make(KINDS[2]), num_warmup=5, num_samples=5, progress_bar=True)
    mcmc.progress_bar = True  # NumPyro turns it off under CI
    mcmc.run(jax.random.key(0), init_params=START)
    assert "acc. prob" in capsys.readouterr().err


def test_model_arguments_reach_the_potential(kind):
    """The same kernel on other data is another posterior, not a cached one."""
    kernel = make(kind, step_size=0.5, **({} if kind.name == "mh" else {"num_steps": 3}))
    state = kernel.init(jax.random.key(0), 0, START, (4.0,), {})
    assert float(state.potential_energy) == pytest.approx(float(potential(START, 4.0)))
    state = kernel.sample(state, (4.0,), {})
    assert float(state.potential_energy) == pytest.approx(float(potential(state.z, 4.0)))


@pytest.mark.parametrize("kind", [k for k in KINDS if k.exact], ids=lambda k: k.name)
def test_gaussian_moments(kind):
    """Variances of a Gaussian within five standard errors, chains drawn with a frozen kernel."""
    many = 200
    frozen: dict[str, Any] = {"step_size": 0.9, "covariance": COVARIANCE}
    if kind.name != "mh":
        frozen["num_steps"] = 2
    if kind.name == "ahmc":
        frozen["proposal_scale"] = 1.0
    mcmc = sampler(make(kind, **frozen), num_warmup=0, num_samples=60, num_chains=many)
    root = np.linalg.cholesky(COVARIANCE)
    y0 = np.random.default_rng(0).standard_normal((many, 2)) @ root.T  # begins in equilibrium
    mcmc.run(jax.random.key(1), init_params={"y": jnp.asarray(y0)})
    y = np.asarray(mcmc.get_samples(group_by_chain=True)["y"])
    for value, wanted in (
        (y.mean(1), np.zeros(2)),
        ((y**2).mean(1), np.diag(COVARIANCE)),
        ((y[..., 0] * y[..., 1]).mean(1), COVARIANCE[0, 1]),
    ):
        error = value.std(0) / np.sqrt(many)
        assert np.all(abs(value.mean(0) - wanted) < 5 * error)


def test_flat_vectors_are_positions_too():
    kernel = HMC(potential_fn=lambda z: 0.5 * z @ z)
    mcmc = sampler(kernel)
    mcmc.run(jax.random.key(0), init_params=jnp.ones(3))
    assert mcmc.get_samples().shape == (40, 3)


# ------------------------------------------------------------------------------ models


@cache
def posed():
    light = small.curve(20)
    model = gallery.find("faceted").bind({"n_facets": 1, "spin": "none"})
    return model, Epochs.of(light)


@pytest.mark.parametrize("make_kernel", [MetropolisHastings, AHMC], ids=["mh", "ahmc"])
def test_model_to_arviz(make_kernel):
    """From a model to InferenceData: constrained sites, statistics and log-likelihood."""
    import arviz  # after NumPyro: the other way round leaves numpyro.distributions incomplete

    model, data = posed()
    mcmc = sampler(make_kernel(model), num_chains=2, num_warmup=40)
    mcmc.run(jax.random.key(0), data, extra_fields=("num_steps", "accept_prob", "energy"))
    tree = arviz.from_numpyro(mcmc, log_likelihood=True)
    assert tree["posterior"]["normals_base"].shape == (2, 40, 1, 3)
    assert "normals" in tree["posterior"] or len(tree["posterior"].data_vars) >= 2
    assert tree["log_likelihood"]["brightness"].shape == (2, 40, 20)
    assert {"diverging", "energy"} <= set(tree["sample_stats"].data_vars)


def test_model_pickles():
    model, _ = posed()
    assert pickle.loads(pickle.dumps(AHMC(model))).model is not None


# ------------------------------------------------------------------------------ faults


def test_singular_metric_falls_back():
    """A metric of zeros or NaN half of the time: counted, and the chain goes on, and is right."""

    def holed(z):
        good = z["y"][0] < 0.2
        return jnp.where(good, fisher(z), jnp.where(z["y"][1] < 0, 0.0, jnp.nan))

    kernel = AHMC(
        potential_fn=potential, fisher_fn=holed, step_size=0.7, num_steps=3, proposal_scale=0.8,
        covariance=COVARIANCE,
    )  # fmt: skip
    mcmc = sampler(kernel, num_warmup=0, num_samples=100, num_chains=100)
    mcmc.run(jax.random.key(0), init_params=starts(100))
    y = np.asarray(mcmc.get_samples(group_by_chain=True)["y"])[:, 20:]
    square = (y**2).mean(1)
    error = square.std(0) / 10
    assert np.all(abs(square.mean(0) - np.diag(COVARIANCE)) < 5 * error)
    fallbacks = np.asarray(last(mcmc).num_fallback)
    assert 10 < fallbacks.mean() < 90
    assert "metric singular in" in kernel.describe(last(mcmc))


def test_unsolved_steps_are_counted_and_rejected():
    kernel = RMHMC(
        potential_fn=potential,
        fisher_fn=lambda z: jnp.diag(jnp.exp(3 * z["y"])),
        step_size=3.0,
        num_steps=1,
    )
    mcmc = sampler(kernel, num_warmup=0, num_samples=60)
    mcmc.run(jax.random.key(0), init_params=START, extra_fields=("failed", "accept_prob"))
    fields = mcmc.get_extra_fields()
    failed = np.asarray(fields["failed"])
    assert failed.sum() > 10
    assert np.all(np.asarray(fields["accept_prob"])[failed] == 0)
    assert int(last(mcmc).num_failed) == failed.sum()
    assert f"{failed.sum()} of 60 rejected" in kernel.describe(last(mcmc))


def test_stuck_chain_says_so():
    kernel = HMC(potential_fn=potential, step_size=40.0, num_steps=3)
    mcmc = sampler(kernel, num_warmup=0, num_samples=60)
    mcmc.run(jax.random.key(0), init_params=START)
    assert "stuck: of the last 60 proposals" in kernel.describe(last(mcmc))
    assert "stuck" in kernel.get_diagnostics_str(last(mcmc))


def test_published_rule_warns():
    with pytest.warns(UserWarning, match="does not leave the posterior invariant"):
        AHMC(potential_fn=potential, fisher_fn=fisher, exact=False)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (partial(HMC), "either a model or potential_fn"),
        (partial(HMC, print, potential_fn=potential), "either a model or potential_fn"),
        (partial(AHMC, potential_fn=potential), "needs fisher_fn"),
        (partial(RMHMC, potential_fn=potential), "needs fisher_fn"),
        (partial(AHMC, print, fisher_fn=fisher), "drop fisher_fn"),
        (partial(HMC, potential_fn=potential, step_size=0.0), "step_size is 0.0"),
        (partial(HMC, potential_fn=potential, num_steps=0), "num_steps is 0"),
        (partial(HMC, potential_fn=potential, target_accept_prob=1.0), "0 < p < 1"),
        (partial(HMC, potential_fn=potential, covariance=[1.0]), "square matrix"),
        (partial(HMC, potential_fn=potential, covariance=[[-1.0]]), "not positive definite"),
        (
            partial(AHMC, potential_fn=potential, fisher_fn=fisher, proposal_scale=-1.0),
            "proposal_scale is -1.0",
        ),
    ],
)
def test_errors_at_construction(build, message):
    with pytest.raises(InputError, match=message):
        build()


def test_errors_at_start():
    kernel = HMC(potential_fn=potential)
    with pytest.raises(InputError, match="needs init_params"):
        sampler(kernel).run(jax.random.key(0))
    with pytest.raises(InputError, match="give step_size and num_steps"):
        sampler(kernel, num_warmup=0).run(jax.random.key(0), init_params=START)
