"""Zero points of sites and nights, which act linearly and are integrated out."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpyro
import numpyro.distributions as dist
from numpy.typing import NDArray

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import pass_effects
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.pass_effects import Passes

SD = 0.03  # mag; between sites and nights of well-calibrated photometry
SPREAD = 0.7  # sd of its logarithm: 0.01 to 0.1 mag in 90 %
SHARED = 0.5  # of the variance of a zero point: what all nights of a series have in common


class Prior(NamedTuple):
    """Zero points are Normal(0, s²), with s ~ LogNormal(ln sd, spread²), mag.

    If there are several series, of which one has several nights, a zero point is the sum of a part
    of its series and a part of its night, which are independent. `SHARED` is the share of the
    variance of the former in the prior; each has an unknown width of its own, because zero points
    may differ from site to site and yet agree from night to night. With nutation, zero points are
    independent.

    An unknown s keeps the intervals right where zero points differ by more than expected, and
    narrow where they agree. With a spread of 0, s is known; with an sd of 0, there are none.
    """

    sd: float = 0.0
    spread: float = 0.0

    def width(self, name: str = "calibration_sd", share: float = 1.0) -> jax.Array | float:
        """s as part of a model, with a site of this name, for a share of the variance."""
        median = np.sqrt(share) * self.sd
        if not modelled("zero_point_spread", self.spread):
            return median
        unit = jnp.asarray(numpyro.sample(f"{name}_unit", dist.Normal(0.0, 1.0)))
        return jnp.asarray(numpyro.deterministic(name, median * jnp.exp(self.spread * unit)))


class _Part(NamedTuple):
    """A part of the zero points: that of nights or that of series.

    ``name`` is the beginning of the names of its sites; ``groups``, ``index`` (T,) and ``number``
    are the points that share it.
    """

    name: str
    groups: Passes
    index: jax.Array
    number: int


def given_earlier(
    data: Epochs,
    mean: jax.Array,
    sd: jax.Array,
    h: jax.Array,
    prior: Prior,
    columns: jax.Array | None = None,
) -> tuple[jax.Array, jax.Array, jax.Array | None]:
    """Mean and standard deviation (T,) of each point given the earlier ones of its calibration.

    The points of a calibration share a zero point z ~ Normal(0, s²), mag, positive if fainter. To
    first order y_k ~ N(m_k + h_k z, σ_k²), with h = 1 for magnitudes and −0.4 ln 10 m for fluxes.
    With z integrated out, the joint density of the points is N(m, diag σ² + s² h hᵀ), the product
    of

        y_k | y_1 … y_(k−1) ~ N(m_k + h_k v_k Σ_{j<k} h_j (y_j − m_j)/σ_j², σ_k² + h_k² v_k),
        1/v_k = 1/s² + Σ_{j<k} h_j²/σ_j².

    If the nights of a series share a part of z, that of the night is integrated out first. That of
    the series follows in the same way, with the h that is left given earlier points. The mean of
    all zero points is not fixed, so the size of the body is as uncertain as the calibration.

    Sites ``zero_point_mean`` and ``zero_point_sd`` (G,) are the moments of the part of the night
    given all points, and ``zero_point_series_mean`` and ``zero_point_series_sd`` (S,) those of the
    part of the series; `nuisances.drawn` draws z from them. The former mean is that for a part of
    the series of zero, and falls by ``zero_point_share`` (G,) times that of the series
    ``zero_point_series`` (G,).

    Parameters
    ----------
    mean, sd : (T,)
        Predicted brightness without zero points, and the standard deviation of its errors, both
        given earlier points if the errors are correlated.
    h : (T,)
        `response`, transformed in the same way.
    prior : Prior
    columns : (K, T), optional
        Further changes of the brightness by unit amounts n. They are returned given earlier points
        too. ``zero_point_mean`` is then that at n = 0, and falls by ``zero_point_slope`` (G, K)
        times the n of the night ``zero_point_night`` (G,). The nights of a series then share no
        part of z: n of one night would change the brightness expected in others.

    References
    ----------
    Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, sec. 2.7 (basis functions
    with Gaussian weights, integrated out).
    """
    if not modelled("zero_point_sd", prior.sd) or not data.n_calibrations:
        return mean, sd, columns
    shared = data.n_series > 0 and columns is None
    night = _Part("zero_point", data.calibrated_together, data.calibration, data.n_calibrations)
    width = prior.width(share=1.0 - SHARED if shared else 1.0)
    every = h[None] if columns is None else jnp.concatenate([h[None], columns])
    mean, variance, left, fall = _integrated(data, night, mean, sd**2, every, width)
    if shared:
        numpyro.deterministic("zero_point_share", fall[0])
        numpyro.deterministic("zero_point_series", _of_calibration(data, data.series))
        series = _Part("zero_point_series", data.series_together, data.series, data.n_series)
        width = prior.width("series_sd", SHARED)
        mean, variance, *_ = _integrated(data, series, mean, variance, left, width)
    if columns is not None:
        columns = left[1:]
        numpyro.deterministic("zero_point_slope", fall[1:].T)
        numpyro.deterministic("zero_point_night", _of_calibration(data, data.night))
    return mean, jnp.sqrt(variance), columns


def _integrated(
    data: Epochs,
    part: _Part,
    mean: jax.Array,
    variance: jax.Array,
    columns: jax.Array,
    width: jax.Array | float,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """`pass_effects.given_earlier` for a part of zero points, whose moments are recorded.

    The last result (1 + K, G) is by how much its mean falls for unit amounts of the columns.
    """
    mean, variance, left, terms = pass_effects.given_earlier(
        part.groups, data.brightness, mean, variance, columns, width
    )
    total = jnp.zeros((len(terms), part.number + 1)).at[:, part.index]
    information, weighted, *others = total.add(data.information * terms)[:, :-1]
    whole = 1.0 / (1.0 / width**2 + information)
    numpyro.deterministic(f"{part.name}_mean", whole * weighted)
    numpyro.deterministic(f"{part.name}_sd", jnp.sqrt(whole))
    return mean, variance, left, whole * jnp.stack([information, *others])


def _of_calibration(data: Epochs, index: jax.Array) -> jax.Array:
    """The index (G,) that the points (T,) of each calibration share."""
    none = jnp.zeros(data.n_calibrations + 1, int)
    return none.at[data.calibration].max(index)[:-1]


def root(data: Epochs) -> NDArray[np.float64]:
    """A root L (G, G) of the prior covariance L Lᵀ of the zero points, for a variance of one."""
    covariance = np.eye(data.n_calibrations)
    if data.n_series:
        series = np.asarray(_of_calibration(data, data.series))
        covariance = (1.0 - SHARED) * covariance + SHARED * (series[:, None] == series)
    return np.linalg.cholesky(covariance)


def response(data: Epochs, mean: jax.Array) -> jax.Array:
    """Change of the brightness (T,) per magnitude of its zero point; 0 if it has none."""
    each = jnp.ones_like(mean) if data.kind == "mag" else -0.4 * jnp.log(10.0) * mean
    return jnp.where(data.calibration < 0, 0.0, each)


def modelled(name: str, sd: float) -> bool:
    """Whether a fault of this prior standard deviation is modelled; negative ones are refused."""
    if not sd >= 0:
        raise InputError(f"{name} is {sd}; give a standard deviation > 0, or 0 for none")
    return sd > 0
