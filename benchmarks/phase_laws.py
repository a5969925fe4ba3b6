"""A model without attitude or shape: one brightness and a phase law."""

from typing import Literal

import numpyro
import numpyro.distributions as dist

from lcbayes.core.jax_setup import jnp
from lcbayes.modelling import likelihood, priors
from lcbayes.modelling.epochs import Epochs

SUMMARY = "constant brightness and a phase law, with the noise of the stabilised model"
NUM_STARTS = 8
POOLED = {"individuals": False}


def model(
    data: Epochs,
    *,
    law: Literal["linear", "quadratic", "cubic", "lambert"] = "quadratic",
    individuals: bool = True,
    noise_law: likelihood.Law = "mixture",
    scatter: float = 0.3,
):
    """f = exp(s) Φ(α), s ~ Normal(1, 1.5): −2.5 log₁₀ Φ a polynomial in α, or a Lambert sphere.

    Slopes and curvatures ~ Normal(0, 5) mag per power of a radian. Distance, penumbra, individuals
    and noise are those of `stabilised`.
    """
    alpha = data.phase_angle
    size = jnp.exp(numpyro.sample("log_size", dist.Normal(1.0, 1.5)))
    if law == "lambert":
        share = 2.0 / (3.0 * jnp.pi) * (jnp.sin(alpha) + (jnp.pi - alpha) * jnp.cos(alpha))
    else:
        n = {"linear": 1, "quadratic": 2, "cubic": 3}[law]
        slope = numpyro.sample("slope", dist.Normal(0.0, 5.0).expand([n]).to_event(1))
        powers = jnp.stack([(alpha - 0.5 * jnp.pi) ** (k + 1) for k in range(n)])
        share = 10.0 ** (-0.4 * jnp.asarray(slope) @ powers)
    fainter = jnp.zeros(data.t.shape)
    if individuals:
        fainter += priors.deviations("member", data.n_members, 0.2)[data.member]
    dimmed = size * share * 10.0 ** (-0.4 * fainter)
    likelihood.observe(data, dimmed, noise_law, scatter, data.has_passes)
