"""Every kernel, through one protocol: NumPyro's MCMC and what it lets a user do."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from numpyro.infer import MCMC, log_likelihood

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.kernels import AHMC, HMC, RMHMC, MetropolisHastings
from tests.helpers import small_curves
from tests.helpers.false_alarms import EACH, limit

ROOT = Path(__file__).parents[2]
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


def _published(*args, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return AHMC(*args, exact=False, **options)


KINDS = [
    Kind("mh", MetropolisHastings),
    Kind("hmc", HMC),
    Kind("ahmc", AHMC),
    Kind("ahmc-paper", _published),
    Kind("rmhmc", RMHMC),
]


# The published rule is AHMC with another way to choose: what is tested is of the class they share.
@pytest.fixture(
    params=[
        pytest.param(k, id=k.name, marks=pytest.mark.slow if k.name == "ahmc-paper" else ())
        for k in KINDS
    ]
)
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


FROZEN = ("step_size", "adapt_state.scale.root", "adapt_state.choice", "adapt_state.num_steps")
SCALE = 2.0  # an argument of the model, of which every run makes use


def start_run(mcmc: MCMC, seed: int = 3, scale: float = SCALE, n: int = 2) -> MCMC:
    fields = ("i", "potential_energy", "accept_prob", *FROZEN)
    mcmc.run(jax.random.key(seed), scale, init_params=starts(n), extra_fields=fields)
    return mcmc


@cache
def ran(kind: Kind, method: str = "vectorized", num_samples: int = 40) -> MCMC:
    """Two chains of 60 transitions of warm-up and so many draws; one compilation each."""
    kernel = make(kind)
    return start_run(sampler(kernel, num_samples=num_samples, num_chains=2, chain_method=method))


def options_of(kind: Kind) -> dict[str, Any]:
    """All that a warm-up would find."""
    options: dict[str, Any] = {"step_size": 0.5, "covariance": COVARIANCE}
    if kind.name != "mh":
        options["num_steps"] = 3
    if kind.name == "ahmc":
        options["proposal_scale"] = 0.8
    return options


def given(kind: Kind, method: str, num_samples: int = 20) -> MCMC:
    kernel = make(kind, **options_of(kind))
    options = {"num_warmup": 0, "num_samples": num_samples, "num_chains": 2}
    return start_run(sampler(kernel, chain_method=method, **options))


def draws(mcmc: MCMC) -> np.ndarray:
    return np.asarray(mcmc.get_samples(group_by_chain=True)["y"])


def dear(kinds: list[Kind], quick: tuple[str, ...]) -> list[Any]:
    """The kinds, of which but a few are quick: what is tested is of the class they share."""
    return [
        pytest.param(k, id=k.name, marks=() if k.name in quick else pytest.mark.slow) for k in kinds
    ]


@pytest.mark.parametrize("kind", dear(KINDS, ("ahmc", "mh")))
def test_draws(kind):
    y = draws(ran(kind))
    assert y.shape == (2, 40, 2)
    assert y.dtype == np.float64
    assert np.all(np.isfinite(y))
    assert np.unique(y[0, :, 0]).size > 2
    assert not np.array_equal(y[0], y[1])


@pytest.mark.slow
@pytest.mark.parametrize("kind", dear(KINDS, ("ahmc",)))
def test_a_chain_is_the_same_alone_and_beside_others(kind):
    """Sequential and vectorised chains differ by rounding, which few transitions leave small.

    With everything given and no warm-up, whose choices between nearly equal candidates a rounding
    error may turn.
    """
    alone, beside = (draws(given(kind, method)) for method in ("sequential", "vectorized"))
    np.testing.assert_allclose(alone, beside, rtol=0, atol=1e-6)


def test_frozen_after_warmup(kind):
    """Nothing that a transition rests on changes once draws are kept."""
    fields = ran(kind).get_extra_fields(group_by_chain=True)
    np.testing.assert_array_equal(fields["i"][0], np.arange(61, 101))
    for name in FROZEN:
        values = np.asarray(fields[name])
        np.testing.assert_array_equal(values, np.broadcast_to(values[:, :1], values.shape))


def test_adapts_during_warmup(kind):
    mcmc = ran(kind)
    first = mcmc.sampler.init(jax.random.key(0), 60, START, (SCALE,), {})
    assert float(first.step_size) != float(last(mcmc).step_size[0])
    assert not np.allclose(first.adapt_state.scale.root, last(mcmc).adapt_state.scale.root[0])


def test_model_arguments_reach_the_potential(kind):
    mcmc = ran(kind)
    energy = np.asarray(mcmc.get_extra_fields(group_by_chain=True)["potential_energy"])
    y = draws(mcmc)
    want = 0.5 * SCALE * np.einsum("cni,ij,cnj->cn", y, PRECISION, y)
    np.testing.assert_allclose(energy, want, rtol=1e-10)


def test_other_arguments_make_another_posterior():
    """The same object on other data does not go on with what it compiled for the first."""
    kind = KINDS[0]
    mcmc = sampler(make(kind), num_chains=2)
    one, other = (draws(start_run(mcmc, scale=s)) for s in (SCALE, 2 * SCALE))
    np.testing.assert_array_equal(one, draws(ran(kind)))
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("kind", dear(KINDS, ("ahmc",)))
def test_seed_and_pickled_kernel_decide(kind):
    """A kernel that was stored draws the same numbers from the same seed, others from another."""
    mcmc = sampler(pickle.loads(pickle.dumps(make(kind))), num_chains=2)
    known = draws(ran(kind))
    np.testing.assert_array_equal(draws(start_run(mcmc)), known)
    assert not np.array_equal(draws(start_run(mcmc, seed=4)), known)


def test_a_sampler_that_has_run_pickles():
    mcmc = ran(KINDS[0])
    again = pickle.loads(pickle.dumps(mcmc))
    np.testing.assert_array_equal(draws(again), draws(mcmc))


def stored_and_read(state: Any) -> Any:
    """A state as bytes and back, keys as plain integers."""
    plain = state._replace(rng_key=jax.random.key_data(state.rng_key))
    back = jax.tree.map(jnp.asarray, pickle.loads(pickle.dumps(jax.tree.map(np.asarray, plain))))
    return back._replace(rng_key=jax.random.wrap_key_data(back.rng_key))


def resumed(kind: Kind, state: Any, method: str) -> np.ndarray:
    rest = sampler(make(kind), num_warmup=0, num_samples=20, num_chains=2, chain_method=method)
    rest.post_warmup_state = state
    rest.run(state.rng_key, SCALE)
    return draws(rest)


@pytest.mark.parametrize("kind", dear(KINDS, ("ahmc",)))
def test_resume_is_bit_identical(kind):
    """A stored state, read into a fresh sampler, goes on as though nothing had happened."""
    rest = resumed(kind, stored_and_read(last(ran(kind))), "vectorized")
    both = np.concatenate([draws(ran(kind)), rest], axis=1)
    np.testing.assert_array_equal(both, draws(ran(kind, num_samples=60)))


def test_resume_of_chains_one_after_the_other():
    """Each goes on from its own state."""
    kind = KINDS[0]
    first = ran(kind, "sequential")
    rest = resumed(kind, last(first), "sequential")
    np.testing.assert_array_equal(rest, draws(ran(kind, "sequential", 60))[:, 40:])


PARALLEL = """
import sys
import numpy as np
from numpyro.infer import MCMC, log_likelihood
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers import kernels

assert jax.local_device_count() == 2
precision = jnp.asarray(np.load(sys.argv[1]))
given = {given}
def sampler(n):
    kernel = kernels.{name}(
        potential_fn=lambda z, s: 0.5 * s * z["y"] @ precision @ z["y"],
        fisher_fn=lambda z, s: s * precision * (1.0 + 0.1 * jnp.tanh(z["y"][0])),
        covariance=np.load(sys.argv[2]),
        **given,
    )
    return MCMC(kernel, num_warmup=0, num_samples=n, num_chains=2, progress_bar=False)
first = sampler(10)
first.run(jax.random.key(3), 2.0, init_params={{"y": jnp.array([[0.3, -0.2]] * 2)}})
rest = sampler(10)
rest.post_warmup_state = first.last_state
rest.run(first.last_state.rng_key, 2.0)
y = [m.get_samples(group_by_chain=True)["y"] for m in (first, rest)]
np.save(sys.argv[3], np.concatenate(y, axis=1))
"""


@pytest.mark.parametrize("kind", dear([KINDS[0], KINDS[2]], ("mh",)))
def test_chains_on_two_devices(kind, tmp_path):
    """chain_method="parallel", which NumPyro gives up where there is but one device."""
    options = options_of(kind)
    np.save(tmp_path / "precision.npy", PRECISION)
    np.save(tmp_path / "covariance.npy", options.pop("covariance"))
    script = PARALLEL.format(name=type(make(kind)).__name__, given=options)
    files = [tmp_path / f"{name}.npy" for name in ("precision", "covariance", "y")]
    flags = "--xla_force_host_platform_device_count=2"
    done = subprocess.run(
        [sys.executable, "-c", script, *files],
        env=os.environ | {"PYTHONPATH": str(ROOT), "XLA_FLAGS": flags, "JAX_PLATFORMS": "cpu"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(np.load(files[2]), draws(given(kind, "vectorized")), atol=1e-6)


def test_diagnostics(kind):
    mcmc = ran(kind)
    state = jax.tree.map(lambda x: x[0], last(mcmc))
    assert "acc. prob=0." in mcmc.sampler.get_diagnostics_str(state)
    text = mcmc.sampler.describe(state)
    assert text.startswith(type(mcmc.sampler).__name__)
    assert f"{float(state.step_size):.3g}" in text
    assert mcmc.sampler.describe(last(mcmc)).startswith("chain 1: ")


def test_progress_bar_and_flat_vectors(capsys):
    kernel = MetropolisHastings(potential_fn=lambda z: 0.5 * z @ z)
    mcmc = sampler(kernel, num_warmup=5, num_samples=5, progress_bar=True)
    mcmc.progress_bar = True  # NumPyro turns it off under CI
    mcmc.run(jax.random.key(0), init_params=jnp.ones(3))
    assert "acc. prob" in capsys.readouterr().err
    assert mcmc.get_samples().shape == (5, 3)


# ------------------------------------------------------------------------------ models


def level(data):
    """A brightness that does not change: NumPyro starts it with few operations, each compiled."""
    brightness = jnp.asarray(numpyro.sample("level", dist.LogNormal()))
    likelihood.observe(data, brightness * jnp.ones_like(data.t))


@cache
def problem_of(name: str = "faceted"):
    light = small_curves.curve(20)
    faceted = registry.find("faceted").bind({"n_facets": 1, "spin": "none"})
    return level if name == "level" else faceted, Epochs.of(light)


@cache
def model_ran(make_kernel: Callable[..., Any], name: str = "faceted") -> MCMC:
    model, data = problem_of(name)
    mcmc = sampler(make_kernel(model), num_chains=2, num_warmup=40)
    mcmc.run(jax.random.key(0), data, extra_fields=("num_steps", "accept_prob", "energy"))
    return mcmc


OF_A_MODEL = pytest.mark.parametrize(
    "make_kernel",
    [MetropolisHastings, pytest.param(AHMC, marks=pytest.mark.slow)],
    ids=["mh", "ahmc"],
)


@pytest.mark.slow
@OF_A_MODEL
def test_arviz_reads_the_sites_and_statistics_of_a_model(make_kernel):
    """ArviZ runs the model operation by operation, each of which is compiled."""
    import arviz

    tree = arviz.from_numpyro(model_ran(make_kernel), log_likelihood=False)
    assert tree["posterior"]["normals_base"].shape == (2, 40, 1, 3)
    assert "normals" in tree["posterior"] or len(tree["posterior"].data_vars) >= 2
    assert {"diverging", "energy"} <= set(tree["sample_stats"].data_vars)


@OF_A_MODEL
@pytest.mark.parametrize("name", ["level", pytest.param("faceted", marks=pytest.mark.slow)])
def test_numpyro_gives_the_log_likelihood_of_the_draws_of_a_model(make_kernel, name):
    model, data = problem_of(name)
    sites = model_ran(make_kernel, name).get_samples(group_by_chain=True)
    result = jax.jit(lambda s: log_likelihood(model, s, data, batch_ndims=2))(sites)
    assert result["brightness"].shape == (2, 40, 20)
    assert np.all(np.isfinite(result["brightness"]))


@pytest.mark.slow
@OF_A_MODEL
def test_arviz_gives_the_log_likelihood_of_the_draws_of_a_model(make_kernel):
    """Operation by operation, each of which is compiled."""
    import arviz

    tree = arviz.from_numpyro(model_ran(make_kernel), log_likelihood=True)
    assert tree["log_likelihood"]["brightness"].shape == (2, 40, 20)


def test_model_pickles():
    model, _ = problem_of()
    assert pickle.loads(pickle.dumps(AHMC(model))).model is not None


# ------------------------------------------------------------------------------ faults


@pytest.mark.statistical(false_alarm=EACH)
def test_singular_metric_falls_back():
    """A metric of zeros or NaN half of the time: counted, and the chain goes on, and is right."""

    def holed(z):
        good = z["y"][0] < 0.2
        return jnp.where(good, fisher(z), jnp.where(z["y"][1] < 0, 0.0, jnp.nan))

    kernel = AHMC(
        potential_fn=potential,
        fisher_fn=holed,
        step_size=0.7,
        num_steps=3,
        proposal_scale=0.8,
        covariance=COVARIANCE,
    )
    mcmc = sampler(kernel, num_warmup=0, num_samples=100, num_chains=100)
    mcmc.run(jax.random.key(0), init_params=starts(100))
    y = np.asarray(mcmc.get_samples(group_by_chain=True)["y"])[:, 20:]
    square = (y**2).mean(1)
    error = square.std(0, ddof=1) / 10
    assert np.all(abs(square.mean(0) - np.diag(COVARIANCE)) < limit(2, 99) * error)
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
    kernel = MetropolisHastings(potential_fn=potential, step_size=1e4)
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
