"""From the predicted flux to the recorded brightness: scale, units and noise."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpyro
import numpyro.distributions as dist
from jax.scipy.stats import norm
from numpyro import handlers
from numpyro.distributions import constraints
from numpyro.distributions.util import validate_sample
from numpyro.util import is_prng_key

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import nutation, zero_points
from lcbayes.modelling.correlated_noise import ornstein_uhlenbeck
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.pass_effects import Passes, innovations

NO_ZERO_POINTS = zero_points.Prior()
OBSERVED = "brightness"
FLUX = "flux"
OUTLIER = "outlier"
Law = Literal["gaussian", "student-t", "mixture"]
STUDENT_T_DF = 4.0
OUTLIER_SHARE, OUTLIER_WIDTH = (0.03, 1.0), (4.0, 0.5)  # median, sd of the logarithm
PASS_SPREADS = ("pass_sd", "pass_drift_sd")
PASS_SD = 0.2  # mag, prior median of the sd of the effects that the points of a pass share
NOISE_SPREAD = 0.25  # sd of ln(noise of a curve / typical noise)


class Contaminated(dist.Normal):
    """Normal with a fraction ε of outliers, whose scatter about the same mean is κ times as wide.

    p(y) = (1 − ε) N(y; m, σ) + ε N(y; m, κσ). It replaces a `Normal` of the same ``loc`` and
    ``scale`` wherever only the width of the bulk matters. With ``passes``, either all points of a
    pass are outliers or none are: p(y₁ … yₙ) = (1 − ε) Π N(yₖ; mₖ, σₖ) + ε Π N(yₖ; mₖ, κσₖ).
    `log_prob` then gives the logarithms of its factors p(yₖ | y₁ … yₖ₋₁).
    """

    arg_constraints = {  # noqa: RUF012
        **dist.Normal.arg_constraints,
        "share": constraints.unit_interval,
        "width": constraints.positive,
    }
    pytree_data_fields = ("loc", "scale", "share", "width", "passes")
    reparametrized_params: list[str] = []  # noqa: RUF012

    def __init__(
        self,
        loc: Any,
        scale: Any,
        share: Any,
        width: Any,
        passes: Passes | None = None,
        *,
        validate_args: bool | None = None,
    ) -> None:
        self.share, self.width, self.passes = jnp.asarray(share), jnp.asarray(width), passes
        super().__init__(loc, scale, validate_args=validate_args)

    def sample(self, key: jax.Array | None, sample_shape: tuple[int, ...] = ()) -> jax.Array:
        assert key is not None
        assert is_prng_key(key)
        key_which, key_value = jax.random.split(key)
        shape = sample_shape + self.batch_shape
        far = jax.random.bernoulli(key_which, self.share, shape)
        if self.passes is not None:
            together = jnp.vectorize(self.passes.of_first, signature="(t)->(t)")
            far = together(far.astype(float)) > 0.5
        unit = jax.random.normal(key_value, shape) * jnp.where(far, self.width, 1.0)
        return jnp.asarray(self.loc) + jnp.asarray(self.scale) * unit

    @validate_sample
    def log_prob(self, value: Any) -> jax.Array:
        near, far = self._parts(value)
        return self._mixed(value, near, far)

    def log_cdf(self, value: Any) -> jax.Array:
        """ln of the cdf of each value given the earlier ones of its pass, as in `log_prob`."""
        r = (value - jnp.asarray(self.loc)) / jnp.asarray(self.scale)
        return self._mixed(value, norm.logcdf(r), norm.logcdf(r / self.width))

    def cdf(self, value: Any) -> jax.Array:
        return jnp.exp(self.log_cdf(value))

    def outlier(self, value: Any) -> jax.Array:
        """Probability that each value is an outlier."""
        near, far = self._parts(value)
        odds = far - near if self.passes is None else self.passes.total(far - near)
        return jax.nn.sigmoid(odds + jnp.log(self.share) - jnp.log1p(-self.share))

    def _mixed(self, value: Any, near: jax.Array, far: jax.Array) -> jax.Array:
        """ln of (1 − ε) eⁿᵉᵃʳ + ε eᶠᵃʳ, with ε given the earlier points of the pass."""
        apart = jnp.log(self.share) - jnp.log1p(-self.share)
        if self.passes is not None:
            before, there = self._parts(value)
            apart += self.passes.before(there - before)
        return jnp.logaddexp(near + jax.nn.log_sigmoid(-apart), far + jax.nn.log_sigmoid(apart))

    def _parts(self, value: Any) -> tuple[jax.Array, jax.Array]:
        """Log density of each value as a regular point and as an outlier."""
        loc, scale = jnp.asarray(self.loc), jnp.asarray(self.scale)
        r2 = ((value - loc) / scale) ** 2
        norm = -jnp.log(scale) - 0.5 * jnp.log(2.0 * jnp.pi)
        return norm - 0.5 * r2, norm - jnp.log(self.width) - 0.5 * r2 / self.width**2


def curve_scales(data: Epochs, flux: jax.Array, log_sd: float = 1.0) -> jax.Array:
    """The scale factor of each curve, (C,): log-normal if unknown, 1 if known.

    The sampled parameter, ``log_level``, is the logarithm of the curve's mean brightness over its
    observed mean. The scale follows from it and the predicted ``flux``. The logarithms of the two
    differ by a shift, so the posterior is that of a wide log-normal scale. The data constrain the
    level to σ/√n for any shape of the body, whereas a sampled scale would be strongly correlated
    with the body's size.
    """
    free = np.flatnonzero(data.free_scale)
    n_curves = len(data.free_scale)
    if not free.size:
        return jnp.ones(n_curves)
    log_level = numpyro.sample(
        "log_level", dist.Normal(0.0, log_sd).expand([free.size]).to_event(1)
    )
    total = jnp.zeros(n_curves).at[data.curve].add(flux)
    count = jnp.zeros(n_curves).at[data.curve].add(1.0)
    mean = jnp.maximum(total / count, 1e-12)[free]
    scale = jnp.ones(n_curves).at[free].set(jnp.exp(log_level) / mean)
    numpyro.deterministic("scale", scale)
    return scale


def expected(data: Epochs, flux: jax.Array, scale: jax.Array) -> jax.Array:
    """Noise-free brightness in the unit of the data, (T,).

    ``flux`` is at unit distance under unit irradiance. A magnitude is
    m = m_sun − 2.5 log₁₀(flux · scale / r²).
    """
    linear = flux * data.dilution * (scale * data.level)[data.curve]
    if data.kind == "flux":
        return linear
    # A floor 30 mag below the level of the curve keeps magnitude and gradient finite.
    floor = 1e-12 * (data.dilution * data.level[data.curve])
    return data.zero_point - 2.5 * jnp.log10(jnp.maximum(linear, 0.0) + floor)


def noise_levels(data: Epochs) -> jax.Array:
    """Noise of each curve, (C,), if the file gives no errors.

    ``sigma`` ~ LogNormal(ln 0.03, 1) is the typical level: relative to a curve's mean for fluxes,
    in magnitudes for magnitudes. Curves come from different nights and telescopes, so each of
    several curves has a separate level ``noise`` = sigma · LogNormal(0, 0.25). With a common level,
    the noisiest curve would set the weight of all.
    """
    n_curves = len(data.free_scale)
    sigma = jnp.exp(numpyro.sample("log_sigma", dist.Normal(np.log(0.03), 1.0)))
    numpyro.deterministic("sigma", sigma)
    if n_curves == 1:
        return sigma[None]
    spread = dist.Normal(0.0, 1.0).expand([n_curves]).to_event(1)
    noise = sigma * jnp.exp(NOISE_SPREAD * jnp.asarray(numpyro.sample("noise_unit", spread)))
    numpyro.deterministic("noise", noise)
    return noise


def scatter(data: Epochs, median: float, log_sd: float = 1.0) -> jax.Array:
    """Standard deviation (T,) with model errors added to those of the file.

    It is √(error² + sigma²) with ``sigma`` ~ LogNormal(ln median, log_sd), in magnitudes for
    magnitudes and relative to a curve's mean for fluxes. It is sigma if the file gives no errors.

    Raises
    ------
    InputError
        The median is negative.
    """
    if median < 0:
        raise InputError(f"scatter is {median:g}; give the median of its prior, or 0 for none")
    sigma = jnp.exp(numpyro.sample("log_sigma", dist.Normal(np.log(median), log_sd)))
    numpyro.deterministic("sigma", sigma)
    sd = (sigma * data.noise_unit)[data.curve]
    return jnp.sqrt(data.error**2 + sd**2) if data.has_error else sd


def observe(
    data: Epochs,
    flux: jax.Array,
    noise: Law = "gaussian",
    scatter_median: float = 0.0,
    passes: bool = False,
    zero_point: zero_points.Prior = NO_ZERO_POINTS,
    correlated: bool = False,
    wobble: nutation.Wobble | None = None,
) -> None:
    """Condition on the recorded brightness (site ``brightness``).

    Errors given in the file are used unchanged; if it gives no errors, they are inferred (see
    `noise_levels`). The likelihood is raised to the power ``data.information``. ``flux`` is that in
    full sunlight and is multiplied by ``data.sunlight``, which is below 1 in penumbra.

    Parameters
    ----------
    data : Epochs
    flux : (T,)
        Predicted flux at unit distance under unit irradiance.
    noise : "gaussian", "student-t" or "mixture"
        Student-t has 4 degrees of freedom: one point in fifty lies beyond 3.7 scales. In a mixture,
        `Contaminated`, the share and the width of the outliers are inferred; a priori they are
        about 3 % and 5 scales (1 + LogNormal(ln 4, 0.5)).
    scatter_median : float
        If not zero, the scatter beyond the errors is inferred, see `scatter`.
    passes : bool
        Whether the points of a pass share an offset and a drift, of standard deviations
        ``pass_sd`` and ``pass_drift_sd`` (to the end of the longest pass), each
        ~ LogNormal(ln `PASS_SD`, 1), in magnitudes for magnitudes and relative to a curve's mean
        for fluxes. Offset and drift are integrated out: the likelihood of each point is conditional
        on the earlier points of its pass, see `pass_effects.innovations`. ``expected`` excludes
        them. In a mixture, whole passes are outliers.
    zero_point : zero_points.Prior
        Of the zero point of each calibration, if there are several; see `zero_points`.
        They are integrated out. With ``passes``, whose offsets include them, they are not used.
    correlated : bool
        Whether the noise includes an Ornstein-Uhlenbeck process within each pass, see
        `correlated_noise`. It is integrated out too, and not used with ``passes``.
    wobble : nutation.Wobble, optional
        Response to small nutation, which is integrated out too, and not used with ``passes``.

    References
    ----------
    Linares & Crassidis, eqs. (1), (10), with the normalisation to the power m; Hogg, Bovy & Lang
    2010, arXiv:1008.4686, sec. 3 (mixture).
    """
    if wobble is not None:
        flux = nutation.shifted(data, flux, wobble)
    flux = jnp.asarray(numpyro.deterministic(FLUX, flux * data.sunlight))
    scale = curve_scales(data, flux)
    mean = expected(data, flux, scale)
    numpyro.deterministic("expected", mean)
    if scatter_median:
        sd = scatter(data, scatter_median)
    else:
        sd = data.error if data.has_error else (noise_levels(data) * data.noise_unit)[data.curve]
    together = data.passes if passes else None
    if together is not None:
        spreads = []
        for name in PASS_SPREADS:
            log_sd = numpyro.sample(f"log_{name}", dist.Normal(np.log(PASS_SD), 1.0))
            spreads.append(jnp.asarray(numpyro.deterministic(name, jnp.exp(log_sd))))
        unit = data.noise_unit[data.curve]  # the same for all points of a pass
        inner = (x / unit for x in (data.brightness, mean, sd))
        mean, sd = (unit * x for x in innovations(together, *inner, *spreads))
    else:
        columns = None if wobble is None else _brightness(data, flux, scale, wobble.columns)
        response = zero_points.response(data, mean)
        if correlated:
            miss = data.brightness - mean
            miss, response, columns, sd = ornstein_uhlenbeck(data, miss, response, sd, columns)
            mean = data.brightness - miss
        mean, sd, columns = zero_points.given_earlier(data, mean, sd, response, zero_point, columns)
        if wobble is not None and columns is not None:
            mean, sd = nutation.given_earlier(data, mean, sd, columns, wobble.sd)
    if noise == "gaussian":
        likelihood = dist.Normal(mean, sd)
    elif noise == "student-t":
        likelihood = dist.StudentT(STUDENT_T_DF, mean, sd)
    elif noise == "mixture":
        likelihood = _contaminated(mean, sd, together)
        numpyro.deterministic(OUTLIER, likelihood.outlier(data.brightness))
    else:
        raise ValueError(f"unknown noise {noise!r}; available: gaussian, student-t, mixture")
    with handlers.scale(scale=data.information):
        numpyro.sample(OBSERVED, likelihood, obs=data.brightness)


def _brightness(data: Epochs, flux: jax.Array, scale: jax.Array, columns: jax.Array) -> jax.Array:
    """Changes of the brightness (K, T) by changes of the flux in full sunlight, to first order."""
    _, push = jax.linearize(lambda x: expected(data, x, scale), flux)
    return jax.vmap(push)(columns * data.sunlight)


def _contaminated(mean: jax.Array, sd: jax.Array, passes: Passes | None) -> Contaminated:
    median, log_sd = OUTLIER_SHARE
    odds = dist.Normal(np.log(median / (1.0 - median)), log_sd)
    share = jax.nn.sigmoid(jnp.asarray(numpyro.sample("logit_outlier_share", odds)))
    width = 1.0 + jnp.exp(
        numpyro.sample(
            "log_outlier_excess", dist.Normal(np.log(OUTLIER_WIDTH[0]), OUTLIER_WIDTH[1])
        )
    )
    numpyro.deterministic("outlier_share", share)
    numpyro.deterministic("outlier_width", width)
    return Contaminated(mean, sd, share, width, passes)
