"""Independent runs that are kept: stopped and gone on with, they are those of one go."""

from __future__ import annotations

import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.inference.replicates import independent_runs
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem
from lcbayes.samplers import smc
from tests.helpers import small_curves


def level(data):
    x = jnp.asarray(numpyro.sample("x", dist.Normal()))
    likelihood.observe(data, x * jnp.ones_like(data.t))


@pytest.mark.slow
def test_a_stopped_run_goes_on_to_the_same_numbers(tmp_path):
    data = Epochs.of(small_curves.curve(10, noise=0.5))
    problem, key = Problem(level, data), jax.random.key(3)
    calls = []

    def three(folder=None):
        checkpoint = Checkpoint(folder, {"seed": 3})
        return independent_runs(
            problem, data, key, 20, 3, name="level", checkpoint=checkpoint, workers=1
        )

    def second_fails(*args, **options):
        calls.append(args)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return smc_run(*args, **options)

    smc_run = smc.run
    whole = three()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(smc, "run", second_fails)
        with pytest.raises(KeyboardInterrupt):
            three(tmp_path)
        again = three(tmp_path)
    assert len(calls) == 4  # the first is not repeated
    plain = smc.replicate(problem, data, key, 20, 3, workers=1)
    for a, b, c in zip(whole, again, plain.runs, strict=True):
        np.testing.assert_array_equal(a.z, b.z)
        np.testing.assert_array_equal(a.z, c.z)
        np.testing.assert_array_equal(a.log_likelihood, b.log_likelihood)
        assert a.log_evidence == b.log_evidence == c.log_evidence
        assert a.reasons == b.reasons
        assert (a.gradients, a.points) == (b.gradients, b.points)
