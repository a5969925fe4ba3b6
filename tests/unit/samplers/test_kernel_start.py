"""Where chains begin if no starting point is given, and that they then agree."""

from __future__ import annotations

import numpy as np
from arviz_stats.base import array_stats  # pyright: ignore[reportPrivateImportUsage]

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers.kernels import AHMC, scoring
from lcbayes.simulation.simulate import simulate
from tests.helpers import one_facet_posterior


def test_scoring_reaches_the_optimum_of_least_squares():
    """Rosenbrock's residuals, from his own start: the optimum is (1, 1), with U = 0."""

    def residuals(z):
        return jnp.stack([10.0 * (z[1] - z[0] ** 2), 1.0 - z[0]])

    def potential(z):
        return 0.5 * jnp.sum(residuals(z) ** 2)

    def information(z):
        jacobian = jax.jacfwd(residuals)(z)
        return jacobian.T @ jacobian

    result = jax.jit(lambda z: scoring.ascend(potential, information, z))(jnp.array([-1.2, 1.0]))
    np.testing.assert_allclose(result, 1.0, atol=0.05)


def test_scoring_stays_where_no_step_helps():
    """A singular information matrix gives no step, and the start is returned."""
    start = jnp.array([0.5, -2.0])

    def potential(z):
        return jnp.sum(jnp.abs(z - start))

    result = scoring.ascend(potential, lambda _: jnp.full((2, 2), jnp.nan), start)
    np.testing.assert_array_equal(result, start)


def test_chains_from_prior_draws_agree():
    """Twelve chains of AHMC in the model's raw coordinates, misfits of 10⁴ nats at the prior draws.

    Chains that spent the warm-up on their way to the posterior kept a covariance and step sizes of
    that way: R-hat of the log area was 1.3 and above.
    """
    curve, _ = simulate(one_facet_posterior.experiment(2), 1)
    data = Epochs.of(curve)
    kernel = AHMC(one_facet_posterior.MODEL)
    num_warmup, num_samples = 300, 400

    @jax.jit
    def run(keys, data):
        state = kernel.init(keys, num_warmup, None, (data,), {})

        def step(state, _):
            state = kernel.sample(state, (data,), {})
            return state, (state.z, state.potential_energy)

        return jax.lax.scan(step, state, length=num_warmup + num_samples)[1]

    z, potential = run(jax.random.split(jax.random.key(2), 12), data)
    draws = np.concatenate(
        [np.asarray(x)[num_warmup:].reshape(num_samples, 12, -1) for x in z.values()], axis=2
    )
    rhat = array_stats.rhat(draws, chain_axis=1, draw_axis=0)
    assert np.max(rhat) < 1.03
    # χ²/2 of four parameters about the mean of the draws: 30 nats are out of the question
    level = np.asarray(potential)
    assert np.all(level[20:num_warmup] < level[num_warmup:].mean() + 30.0)
