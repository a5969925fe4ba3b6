"""Chains begin as far from an optimum as draws do, where widths are strongly correlated too."""

import numpy as np
import pytest

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.samplers import chains
from lcbayes.samplers.chains import SPREAD, Whitening


class Kernel:
    """A kernel whose state is its initial parameters."""

    def init(self, key, num_warmup, params, args, options):  # noqa: ARG002
        return params["y"]


KERNEL = Kernel()


@pytest.mark.statistical(false_alarm=1e-6)
def test_starts_have_the_correlations_of_the_posterior():
    rng = np.random.default_rng(5)
    sd = np.array([1e-3, 1.0, 5.0])
    mixing = np.array([[1.0, 0.9999, 0.0], [0.9999, 1.0, 0.3], [0.0, 0.3, 1.0]])
    covariance = (mixing @ mixing.T) * sd * sd[:, None]
    optimum, centre = rng.standard_normal(3), rng.standard_normal(3)
    near = Whitening(jnp.asarray(optimum), jnp.linalg.cholesky(jnp.asarray(covariance)))
    coordinates = Whitening(jnp.asarray(centre), jnp.diag(jnp.asarray(sd)))
    keys = jax.random.split(jax.random.key(0), 400)
    y = np.stack([chains.start(KERNEL, k, 10, near, (coordinates,)) for k in keys])
    away = (centre + y * sd - optimum) / SPREAD
    squared = np.einsum("ni,ij,nj->n", away, np.linalg.inv(covariance), away)
    # The mean of χ² of 3 over 400 draws has a standard deviation of √6/20 = 0.12.
    assert abs(squared.mean() - 3.0) < 5 * 0.1225
