"""A model of a user's own, for the test of its posterior: a parabola seen through its height."""

import numpyro
import numpyro.distributions as dist

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import likelihood
from lcbayes.modelling.epochs import Epochs

SUMMARY = "flux of y + x²: a bent ridge"
Y_SD = 4.0


def model(data: Epochs):
    """f(t) = y + x², x ~ N(0, 1), y ~ N(0, 4²): the data hold y + x², the priors all else."""
    x = numpyro.sample("x", dist.Normal(0.0, 1.0))
    y = numpyro.sample("y", dist.Normal(0.0, Y_SD))
    likelihood.observe(data, jnp.asarray(y + x**2) * jnp.ones_like(data.t))
