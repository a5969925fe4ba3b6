"""Light curves of one structure share a problem, and so their compiled programs."""

from __future__ import annotations

import sys
from types import ModuleType

import numpy as np
import numpyro
import numpyro.distributions as dist
import small

from lcbayes import gallery, noise
from lcbayes._jax import jnp
from lcbayes.epochs import Epochs
from lcbayes.inference import search
from lcbayes.inference.posed import forget, posed, structures
from lcbayes.inference.problem import Problem, compiled
from lcbayes.progress import Silent

TRACED = []


def model(data: Epochs, *, level: float = 0.0):
    """A constant, that counts how often it is traced."""
    TRACED.append(data.t.shape)
    x = jnp.exp(level + numpyro.sample("x", dist.Normal(0.0, 1.0)))
    noise.observe(data, x * jnp.ones_like(data.t))


def entry() -> gallery.Entry:
    module = ModuleType("counted")
    module.model = model  # type: ignore[attr-defined]
    sys.modules["counted"] = module
    return gallery.Entry("counted", module)


def test_same_structure_same_problem_other_structure_other_problem():
    forget()
    one = entry()
    first, _ = posed(one, {"level": 0.0}, Epochs.of(small.curve(8, seed=1)))
    assert posed(one, {"level": 0.0}, Epochs.of(small.curve(8, seed=2)))[0] is first
    others = [
        ({"level": 0.0}, small.curve(9)),
        ({"level": 0.1}, small.curve(8)),
        ({"level": 0.0}, small.curve(8, free_scale=np.array([True]))),
        ({"level": 0.0}, small.curve(8, error=None)),
    ]
    found = [posed(one, o, Epochs.of(c))[0] for o, c in others]
    assert len({id(p) for p in [first, *found]}) == structures() == 5
    forget()
    assert structures() == 0
    assert posed(one, {"level": 0.0}, Epochs.of(small.curve(8)))[0] is not first


def test_a_second_light_curve_compiles_nothing_and_gives_its_own_numbers():
    one = entry()
    ends = []
    for seed in (1, 2):
        data = Epochs.of(small.curve(8, seed=seed))
        problem, same = posed(one, {}, data)
        assert same is problem  # no coordinates of its own
        before = len(TRACED)
        starts = jnp.linspace(-1.0, 1.0, 4)[:, None]
        found = search.race(problem, data, starts, 1, Silent())
        sd = compiled(problem.moments)(jnp.asarray(found.z[0]), data).sd
        ends.append((float(found.z[0, 0]), float(sd[0])))
        assert (len(TRACED) > before) == (seed == 1)
    fresh = Epochs.of(small.curve(8, seed=2))
    alone = search.race(Problem(one.bind({}), fresh), fresh, starts, 1, Silent())
    assert ends[1][0] == float(alone.z[0, 0]) != ends[0][0]
