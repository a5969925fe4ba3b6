"""Light curves of one structure share a problem, and so their compiled programs."""

from __future__ import annotations

import sys
import time
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.core.progress import Silent
from lcbayes.inference import problem_cache as keeping
from lcbayes.inference import search
from lcbayes.inference.problem_cache import build_problem, forget, structures
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.moments import MomentCoordinates
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.samplers import chains
from tests.helpers import small_curves

TRACED = []


def model(data: Epochs, *, level: float = 0.0):
    """A constant, that counts how often it is traced."""
    TRACED.append(data.t.shape)
    x = jnp.exp(level + numpyro.sample("x", dist.Normal(0.0, 1.0)))
    likelihood.observe(data, x * jnp.ones_like(data.t))


def entry(**hooks) -> registry.Entry:
    module = ModuleType("counted")
    vars(module).update({"model": model} | hooks)
    sys.modules["counted"] = module
    return registry.Entry("counted", module)


def test_same_structure_same_problem_other_structure_other_problem():
    forget()
    one = entry()
    first, _ = build_problem(one, {"level": 0.0}, Epochs.of(small_curves.curve(8, seed=1)))
    assert build_problem(one, {"level": 0.0}, Epochs.of(small_curves.curve(8, seed=2)))[0] is first
    others = [
        ({"level": 0.0}, small_curves.curve(9)),
        ({"level": 0.1}, small_curves.curve(8)),
        ({"level": 0.0}, small_curves.curve(8, free_scale=np.array([True]))),
        ({"level": 0.0}, small_curves.curve(8, error=None)),
    ]
    result = [build_problem(one, o, Epochs.of(c))[0] for o, c in others]
    assert len({id(p) for p in [first, *result]}) == structures() == 5
    forget()
    assert structures() == 0
    assert build_problem(one, {"level": 0.0}, Epochs.of(small_curves.curve(8)))[0] is not first


def test_a_second_light_curve_compiles_nothing_and_gives_its_own_numbers():
    one = entry()
    ends = []
    for seed in (1, 2):
        data = Epochs.of(small_curves.curve(8, seed=seed))
        problem, same = build_problem(one, {}, data)
        assert same is problem  # no coordinates of its own
        before = len(TRACED)
        starts = jnp.linspace(-1.0, 1.0, 4)[:, None]
        result = search.successive_halving(problem, data, starts, 1, Silent())
        sd = compiled(problem.moments)(jnp.asarray(result.z[0]), data).sd
        ends.append((float(result.z[0, 0]), float(sd[0])))
        assert (len(TRACED) > before) == (seed == 1)
    fresh = Epochs.of(small_curves.curve(8, seed=2))
    alone = search.successive_halving(Problem(one.bind({}), fresh), fresh, starts, 1, Silent())
    assert ends[1][0] == float(alone.z[0, 0]) != ends[0][0]


def slow(data: Epochs):
    """Other threads come in between any two of its sites."""
    time.sleep(0.005)
    x = numpyro.sample("x", dist.Normal(0.0, 1.0))
    time.sleep(0.005)
    likelihood.observe(data, jnp.exp(x) * jnp.ones_like(data.t))


def test_threads_trace_beside_each_other_while_programs_are_let_go_of(monkeypatch):
    """Light curves of different length, each with a problem of its own, of which one is kept."""
    monkeypatch.setattr(keeping, "MAX_STRUCTURES", 1)
    one = entry(model=slow)

    def numbers(n: int) -> list[float]:
        data = Epochs.of(small_curves.curve(n))
        problem, _ = build_problem(one, {}, data)
        z, whitening = jnp.zeros(1), chains.Whitening(jnp.zeros(1), jnp.eye(1))
        kernel = chains.kernel(problem)
        state = chains.start(kernel, jax.random.key(n), 10, whitening, (whitening, data))
        fisher = compiled(problem.fisher)(z, data)
        return [
            float(compiled(problem.potential)(z, data)),
            float(fisher[0, 0]),
            float(state.potential_energy),
        ]

    with ThreadPoolExecutor(2) as pool:
        beside = list(pool.map(numbers, (8, 9)))
    assert beside == [numbers(n) for n in (8, 9)]
    assert structures() == 1


@pytest.fixture
def unmade(monkeypatch):
    """Problems that are only told apart."""
    forget()
    monkeypatch.setattr(keeping, "Problem", lambda *_: object())
    yield
    forget()


@pytest.mark.usefixtures("unmade")
def test_no_more_structures_are_kept_than_may_be():
    one, data = entry(), Epochs.of(small_curves.curve(8))
    kept = []
    for i in range(keeping.MAX_STRUCTURES + 1):
        build_problem(one, {"level": float(i)}, data)
        kept.append(structures())
    assert kept == [*range(1, keeping.MAX_STRUCTURES + 1), 1]


@pytest.mark.usefixtures("unmade")
def test_coordinates_that_are_equal_are_shared():
    """One basis, or one for each light curve."""
    basis = np.eye(3)[:, :2]
    log_weights = np.zeros(3)
    data = Epochs.of(small_curves.curve(8))

    def problems(coordinates):
        one = entry(coordinates=coordinates)
        return [build_problem(one, {}, data) for _ in range(2)]

    first, again = problems(lambda _: {"x": MomentCoordinates(basis, 1, log_weights)})
    assert first is again
    assert first[0] is not first[1]
    first, again = problems(lambda _: {"x": MomentCoordinates(basis.copy(), 1, log_weights)})
    assert first[1] is not again[1]
    first, again = problems(lambda _: {"x": MomentCoordinates(basis, 1, log_weights.copy())})
    assert first[1] is not again[1]
    assert structures() == 5
