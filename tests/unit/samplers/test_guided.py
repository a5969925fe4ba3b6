"""A chain along a guide that is wrong in place, width and form samples the exact density."""

from itertools import groupby

import jax
import jax.numpy as jnp
import numpy as np
import numpyro
import numpyro.distributions as dist
import pytest
from scipy.special import digamma, polygamma
from scipy.stats import norm

from lcbayes.core.errors import InputError
from lcbayes.samplers.convergence import rhat_and_ess
from lcbayes.samplers.kernels.guided import EVERY, Guided
from lcbayes.samplers.sampling import Sampler
from lcbayes.samplers.settings import AUTO, FACET_MOVES, GUIDED, WARMUP, Settings

SHAPE = np.array([2.0, 5.0])  # of two gamma variates, whose logarithms are sampled
FIRST, DRAWS, CHAINS = 100, 5000, 4
FALSE_ALARM = 1e-5  # of the whole test


def potential(z):
    return jnp.sum(jnp.exp(z) - SHAPE * z)


def guide(z):
    """A Gaussian, wider by 30 % and half a standard deviation away."""
    mean, sd = digamma(SHAPE), np.sqrt(polygamma(1, SHAPE))
    return jnp.sum(0.5 * ((z - mean - 0.5 * sd) / (1.3 * sd)) ** 2)


def kernel_of(followed, exact):
    def model(energy):
        def of():
            flat = dist.ImproperUniform(dist.constraints.real_vector, (), (2,))
            numpyro.factor("density", -energy(numpyro.sample("z", flat)))

        return of

    return Guided(model(followed), model(exact))


def chains(followed, exact):
    """Draws (C, S, 2), potential energies and acceptance (C, S)."""
    kernel = kernel_of(followed, exact)

    def chain(key):
        state = kernel.init(key, FIRST, {"z": jnp.zeros(2)})

        def step(state, _):
            state = kernel.sample(state, (), {})
            return state, (state.z["z"], state.potential_energy, state.accept_prob)

        _, out = jax.lax.scan(step, state, length=FIRST + DRAWS)
        return jax.tree.map(lambda x: x[FIRST:], out)

    keys = jax.random.split(jax.random.key(1), CHAINS)
    return jax.tree.map(np.asarray, jax.jit(lambda k: jax.lax.map(chain, k))(keys))


@pytest.mark.statistical(false_alarm=FALSE_ALARM)
def test_the_exact_density_is_sampled() -> None:
    z, energy, _ = chains(guide, potential)
    assert energy == pytest.approx(np.asarray(jax.vmap(jax.vmap(potential))(z)), abs=1e-9)
    mean, variance = digamma(SHAPE), polygamma(1, SHAPE)
    off = (z - mean) / np.sqrt(variance)
    checks = {"mean": (off, 0.0), "variance": (off**2, 1.0)}
    checks["skewness"] = (off**3, polygamma(2, SHAPE) / variance**1.5)
    limit = norm.isf(0.5 * FALSE_ALARM / (len(checks) * len(SHAPE)))
    for name, (values, expected) in checks.items():
        for i, right in enumerate(np.broadcast_to(expected, 2)):
            one = values[..., i]
            error = one.std() / np.sqrt(rhat_and_ess(one[..., None])[1])
            assert abs(one.mean() - right) < limit * error, (name, i)
            assert error < 0.15, name


def test_each_draw_begins_with_the_gradient_of_the_guide() -> None:
    """A walk leaves none in the state, and a trajectory with another would not be reversible."""
    kernel = kernel_of(guide, potential)
    sample = jax.jit(lambda state: kernel.sample(state, (), {}))
    state = kernel.init(jax.random.key(0), 5, {"z": jnp.zeros(2)})
    for _ in range(5 + 2 * EVERY):
        lost = state._replace(z_grad={"z": jnp.full(2, jnp.nan)})
        state, other = sample(state), sample(lost)
        assert np.array_equal(state.z["z"], other.z["z"])
        assert state.energy == other.energy


def test_a_guide_that_differs_by_a_constant_costs_no_draw() -> None:
    """Only differences of energies count, and trajectories are those of NUTS."""
    _, _, accepted = chains(lambda z: potential(z) + 3.0, potential)
    assert accepted.mean() > 0.7


def test_no_chain_stays_where_the_guide_is_far_too_low() -> None:
    """A hole in the guide, about the mean: proposals from there have no chance."""

    def holed(z):
        return potential(z) + jnp.where(jnp.linalg.norm(z - digamma(SHAPE)) < 0.4, 60.0, 0.0)

    z, *_ = chains(holed, potential)
    longest = max(len(list(same)) for chain in z for _, same in groupby(chain[:, 0]))
    assert 3 < longest <= 3 * EVERY
    inside = np.linalg.norm(z - digamma(SHAPE), axis=-1) < 0.4
    assert 0.05 < inside.mean() < 0.5


def test_no_draw_has_no_density() -> None:
    z, *_ = chains(guide, lambda z: jnp.where(z[0] > 0.0, potential(z), jnp.inf))
    assert z[..., 0].min() > 0.0


def test_kernels_of_other_models_are_refused() -> None:
    for name in (GUIDED, FACET_MOVES):
        with pytest.raises(InputError, match="made for other models"):
            Sampler(None, Settings(name), 1)  # pyright: ignore[reportArgumentType]


def test_a_kernel_has_its_own_warm_up_unless_one_is_given() -> None:
    assert Settings().with_sampler(GUIDED).num_warmup == WARMUP[GUIDED]
    assert Settings(num_warmup=WARMUP[AUTO]).with_sampler(GUIDED).num_warmup == WARMUP[AUTO]
