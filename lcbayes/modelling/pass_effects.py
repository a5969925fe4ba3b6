"""Offsets and drifts that the points of one pass share."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.segments import pass_numbers


class Passes(NamedTuple):
    """Points in order of pass and time.

    Attributes
    ----------
    order : (T,) int
        Points, pass after pass, each in order of time.
    first, last : (T,) int
        Indices into ``order`` at which the pass of each point in it begins and ends.
    elapsed : (T,)
        Time of each point since the middle of its pass, in units of half the longest pass.
    """

    order: jax.Array
    first: jax.Array
    last: jax.Array
    elapsed: jax.Array

    @classmethod
    def of(cls, curve: LightCurve, fitted: LightCurve) -> Passes:
        """Passes of a curve; times are in units of half the longest pass of the fitted curve."""
        groups = cls.of_groups(pass_numbers(curve), curve.t)
        order, first, last = (np.asarray(x) for x in groups[:3])
        elapsed = np.empty(curve.n_obs)
        t = curve.t[order]
        elapsed[order] = (t - 0.5 * (t[first] + t[last])) / _longest(fitted)
        elapsed = np.clip(elapsed, -1.0, 1.0)  # a predicted pass may be longer
        return groups._replace(elapsed=jnp.asarray(elapsed))

    @classmethod
    def of_groups(cls, number: NDArray[np.int64], t: NDArray[np.float64]) -> Passes:
        """Groups by a number for each point, (T,), with ``elapsed`` zero."""
        order = np.lexsort((t, number))
        mine = number[order]
        first = np.searchsorted(mine, mine, "left")
        last = np.searchsorted(mine, mine, "right") - 1
        return cls(*map(jnp.asarray, (order, first, last, np.zeros(len(t)))))

    @classmethod
    def single(cls, n: int) -> Passes:
        """Passes of one point each."""
        each = jnp.arange(n)
        return cls(each, each, each, jnp.zeros(n))

    def without_passes(self) -> Passes:
        """Passes of one point each, with the same ``elapsed``."""
        return self.single(len(self.order))._replace(elapsed=self.elapsed)

    def before(self, values: jax.Array) -> jax.Array:
        """Sum of the values (..., T) at earlier points of the same pass, (..., T)."""
        mine = values[..., self.order]
        sums = jnp.cumsum(mine, axis=-1) - mine
        return jnp.zeros_like(mine).at[..., self.order].set(sums - sums[..., self.first])

    def total(self, values: jax.Array) -> jax.Array:
        """Sum of the values (T,) over the pass of each point, (T,)."""
        return self._spread(self.before(values) + values, self.last)

    def of_first(self, values: jax.Array) -> jax.Array:
        """The value (T,) at the first point of the pass of each point, (T,)."""
        return self._spread(values, self.first)

    def _spread(self, values: jax.Array, which: jax.Array) -> jax.Array:
        return jnp.zeros_like(values).at[self.order].set(values[self.order][which])


def _longest(curve: LightCurve) -> float:
    """Half of the longest pass, s."""
    number = pass_numbers(curve)
    first = np.full(number.max() + 1, np.inf)
    last = -first
    np.minimum.at(first, number, curve.t)
    np.maximum.at(last, number, curve.t)
    return float(0.5 * np.max(last - first)) or 1.0


def given_earlier(
    passes: Passes,
    value: jax.Array,
    mean: jax.Array,
    variance: jax.Array,
    columns: jax.Array,
    width: jax.Array | float,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Integrate out the amount z ~ Normal(0, width²) of one column that the points of a pass share.

    Parameters
    ----------
    value, mean, variance : (T,)
        Recorded and predicted brightness, and the variance of the independent errors.
    columns : (1 + K, T)
        Changes of the brightness by unit amounts; that of z is the first.
    width : scalar

    Returns
    -------
    mean, variance : (T,)
        Of each point given the earlier points of its pass; see `zero_points.given_earlier`.
    columns : (1 + K, T)
        The columns, given the earlier points too; the first is h v/width² with v given those.
    terms : (2 + K, T)
        h²/σ², h (y − m)/σ² and h c/σ² for the first column h and each other column c. With their
        sums over a pass, I, e and x_c, the variance of z is v = 1/(1/width² + I) given all points,
        and its mean v (e − Σ x_c n_c) given amounts n_c of the other columns.
    """
    h, *others = columns
    terms = h / variance * jnp.stack([h, value - mean, *others])
    information, weighted, *along = passes.before(terms)
    v = 1.0 / (1.0 / width**2 + information)
    left = [h * v / width**2, *(c - h * v * x for c, x in zip(others, along, strict=True))]
    return mean + h * v * weighted, variance + h**2 * v, jnp.stack(left), terms


def innovations(
    passes: Passes,
    value: jax.Array,
    mean: jax.Array,
    sd: jax.Array,
    spread: jax.Array,
    drift: jax.Array,
) -> tuple[jax.Array, jax.Array]:
    """Mean and standard deviation (T,) of each point given the earlier points of its pass.

    The points of a pass share an offset and a drift: yₖ ~ N(mₖ + hₖᵀ b, σₖ²) with hₖ = (1, xₖ),
    b ~ N(0, diag(τ², υ²)) and x the time since the middle of the pass. With b integrated out, the
    joint density of the points is N(m, diag σ² + τ² 1 1ᵀ + υ² x xᵀ). It is the product of

        yₖ | y₁ … yₖ₋₁ ~ N(mₖ + hₖᵀ Pₖ⁻¹ Σ_{j<k} hⱼ (yⱼ − mⱼ)/σⱼ², σₖ² + hₖᵀ Pₖ⁻¹ hₖ),
        Pₖ = diag(τ⁻², υ⁻²) + Σ_{j<k} hⱼ hⱼᵀ/σⱼ²,

    so that hundreds of passes add no dimensions and need no large matrices.

    Parameters
    ----------
    value, mean, sd : (T,)
        Recorded and predicted brightness, and the standard deviation of the independent errors.
    spread, drift : scalar
        τ of the offset and υ of the drift from the middle to the end of the longest pass.

    References
    ----------
    Rasmussen & Williams 2006, Gaussian Processes for Machine Learning, sec. 2.7 (basis functions
    with Gaussian weights, integrated out).
    """
    x, weight = passes.elapsed, 1.0 / sd**2
    miss = weight * (value - mean)
    one, two, three, level, slope = passes.before(
        jnp.stack([weight, weight * x, weight * x**2, miss, miss * x])
    )
    one, three = one + 1.0 / spread**2, three + 1.0 / drift**2
    det = one * three - two**2
    shift = ((three - x * two) * level + (x * one - two) * slope) / det
    return mean + shift, jnp.sqrt(sd**2 + (three - 2.0 * x * two + x**2 * one) / det)
