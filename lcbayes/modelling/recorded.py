"""What a recorded site of a NumPyro model says of the data: centre and width, weight, noise law."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpyro.distributions as dist

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.likelihood import Contaminated, Law
from lcbayes.modelling.nutation import RESPONSE
from lcbayes.modelling.priors import UniformDirection

Sites = dict[str, jax.Array]


class Moments(NamedTuple):
    """Centre and width (T,) of the likelihood at one point of parameter space."""

    mean: jax.Array
    sd: jax.Array


def base(fn: Any) -> Any:
    """The distribution of one element."""
    while isinstance(fn, dist.Independent | dist.ExpandedDistribution | dist.MaskedDistribution):
        fn = fn.base_dist
    return fn


def law_of(fn: Any) -> Law:
    """The noise law of a distribution."""
    if isinstance(fn, dist.StudentT):
        return "student-t"
    return "mixture" if isinstance(fn, Contaminated) else "gaussian"


def is_direction(site: dict[str, Any]) -> bool:
    """Whether the value is a vector whose direction alone counts."""
    return isinstance(base(site["fn"]), UniformDirection)


def response_of(trace: dict[str, Any]) -> Sites:
    """The response to small nutation, if it is in the model."""
    return {RESPONSE: trace[RESPONSE]["value"]} if RESPONSE in trace else {}


def is_condition(site: dict[str, Any]) -> bool:
    """Whether the model conditions on the value, with a centre and a width."""
    observed = site["type"] == "sample" and site["is_observed"]
    return observed and isinstance(base(site["fn"]), dist.Normal | dist.StudentT)


def moments_of(site: dict[str, Any]) -> Moments:
    """Centre and width of the distribution, in the shape of the value."""
    fn, shape = base(site["fn"]), jnp.shape(site["value"])
    return Moments(jnp.broadcast_to(fn.loc, shape), jnp.broadcast_to(fn.scale, shape))


def weights_of(site: dict[str, Any]) -> tuple[jax.Array, jax.Array]:
    """Weights w and v in `Problem.fisher` of one observed site, flattened."""
    fn, shape, power = base(site["fn"]), (jnp.asarray(site["value"]).size,), power_of(site)
    if isinstance(fn, dist.StudentT):
        df = jnp.ravel(jnp.asarray(fn.df))[0]
        w, v = (df + 1) / (df + 3), df / (df + 3)
        return jnp.full(shape, power * w), jnp.full(shape, power * v)
    return jnp.full(shape, power), jnp.full(shape, power)


def power_of(site: dict[str, Any]) -> jax.Array | float:
    """Power to which a site's probability is raised."""
    return 1.0 if site["scale"] is None else site["scale"]
