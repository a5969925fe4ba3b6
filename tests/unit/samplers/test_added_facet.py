"""The ratio of the evidences of numbers of facets, against means of the likelihood over the prior.

The reference shares no code with the package: brightness, prior and draws are written in NumPy. The
posteriors that are bridged are draws of the prior, resampled by their likelihood.
"""

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers import added_facet
from tests.helpers.false_alarms import EACH
from tests.helpers.turning_facets import cosines, flux, unit

N_EPOCHS, N_DRAWS, CHAINS = 30, 400_000, 4
LIMIT = 4.7  # standard errors: beyond them in 3 of a million cases, `EACH`
assert pytest.approx(3e-6) == EACH


def drawn(rng, number, sun, obs, y, error):
    """ln evidence with its standard error, and draws of the posterior: base (n, N, 3), ln α."""
    base = unit(rng.standard_normal((N_DRAWS, number, 3)))
    base *= rng.normal(1.0, 0.1, (N_DRAWS, number, 1))
    log_area = rng.standard_normal((N_DRAWS, number))
    log_likelihood = np.concatenate(
        [
            -0.5 * np.sum(((y - flux(*cosines(sun, obs, unit(b)), np.exp(a))) / error) ** 2, axis=1)
            for b, a in zip(np.array_split(base, 40), np.array_split(log_area, 40), strict=True)
        ]
    )
    weight = np.exp(log_likelihood - log_likelihood.max())
    se = np.std(weight) / np.mean(weight) / np.sqrt(N_DRAWS)
    value = np.log(np.mean(weight)) + log_likelihood.max()
    chosen = rng.choice(N_DRAWS, 8000, p=weight / weight.sum())
    value -= N_EPOCHS * np.log(error * np.sqrt(2.0 * np.pi))
    return value, se, base[chosen], log_area[chosen]


@pytest.mark.parametrize(
    ("fewer", "areas", "error"),
    [
        pytest.param(1, (3.0, 1.5), 0.3, id="the second facet is needed"),
        pytest.param(2, (4.0, 0.0), 0.3, id="the others are superfluous"),
        pytest.param(2, (1.0, 0.0), 1e3, id="nothing is known"),
    ],
)
def test_the_ratio_is_that_of_means_over_the_prior(fewer, areas, error):
    rng = np.random.default_rng(3)
    sun = unit(rng.standard_normal((N_EPOCHS, 3)))
    obs = unit(sun + 0.4 * rng.standard_normal((N_EPOCHS, 3)))
    normals = unit(np.array([[1.0, 0.2, 0.1], [-0.3, 0.9, -0.4]]))[None]
    y = flux(*cosines(sun, obs, normals), np.array([areas]))[0]
    y = y + min(error, 0.3) * rng.standard_normal(N_EPOCHS)
    curve = LightCurve(
        t=np.arange(float(N_EPOCHS)),
        brightness=y,
        error=np.full(N_EPOCHS, error),
        kind="flux",
        sun=sun,
        obs=obs,
    )
    data, entry = Epochs.of(curve), registry.find("faceted")
    options = {"spin": "none", "reflectance": "lambertian"}
    counts = fewer, fewer + 1
    one, two = (build_problem(entry, options | {"n_facets": n}, data)[0] for n in counts)
    assert (one.dim, two.dim) == (4 * fewer, 4 * fewer + 4)
    hook = entry.hook("moves")
    assert hook is not None
    moves = hook(two, data, n_facets=counts[1], superfluous=True, **options)
    first, second = (drawn(rng, n, sun, obs, y, error) for n in counts)
    fewer_z, more_z = (
        np.array_split(np.asarray(jax.vmap(problem.ravel)(_sites(sample))), CHAINS)
        for problem, sample in ((one, first), (two, second))
    )
    ratio = added_facet.log_ratio(one, moves, data, fewer_z, more_z, jax.random.key(1))
    se = np.hypot(ratio.whole.se, np.hypot(first[1], second[1]))
    assert se < 0.1
    assert ratio.whole.value == pytest.approx(second[0] - first[0], abs=LIMIT * se)
    assert np.std(ratio.each) < 0.3


def _sites(sample):
    return {"normals_base": jnp.asarray(sample[2]), "log_albedo_area": jnp.asarray(sample[3])}
