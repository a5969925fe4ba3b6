"""Products of size and reflectance as coordinates of a body of known parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes.core.jax_setup import jax, jnp

LEAST = 1e-6  # of the upper end of a prior's range, in place of a lower end at zero
EDGE = 1e-12  # share of a span, that a point keeps from its ends


class Reflectance(NamedTuple):
    """A reflectance ρ of unknown value.

    Attributes
    ----------
    low, high : float
        Ends of its uniform prior; 0 and inf for a log-normal one, of which ln ρ is the site.
    area : m²
        Change of the body's albedo-area with ρ.
    above : int, optional
        The number, among those before, of the specular reflectance r of a layer above, so that the
        brightness is proportional to ρ (1 − r).
    """

    low: float
    high: float
    area: float
    above: int | None = None

    @property
    def bounded(self) -> bool:
        return bool(np.isfinite(self.high))

    @property
    def ends(self) -> tuple[float, float]:
        """ln of the least and of the largest value."""
        return float(np.log(max(self.low, LEAST * self.high))), float(np.log(self.high))


class _Span(NamedTuple):
    """An interval [start, start + width], whose points are start + width σ(u)."""

    start: jax.Array
    width: jax.Array

    def at(self, u: jax.Array) -> jax.Array:
        return self.start + self.width * jax.nn.sigmoid(u)

    def log_slope(self, u: jax.Array) -> jax.Array:
        return jnp.log(self.width) + jax.nn.log_sigmoid(u) + jax.nn.log_sigmoid(-u)

    def free(self, value: jax.Array) -> jax.Array:
        share = jnp.clip((value - self.start) / self.width, EDGE, 1.0 - EDGE)
        return jnp.log(share) - jnp.log1p(-share)


class ReflectanceProducts(Transform):
    """(u₀, u₁ … u_J) ↔ (ln κ A, ρ₁ … ρ_J), the brightness and the reflectances of a body.

    The light curve of a body of κ times its size fixes the products κ ρ_j, and κ only within the
    ranges of the reflectances: a ridge along which each ρ_j falls as 1/κ, curved in any functions
    of the ρ_j alone. Here w_j = ln κ ρ_j depends on u₁ … u_j only, and u₀ places ln κ in the span
    in which all ρ_j = exp(w_j)/κ are inside their ranges,

        ln κ = a + (b − a) σ(u₀),   a = max_j (w_j − ln high_j),   b = min_j (w_j − ln low_j),

    so that the ridge is a straight line along u₀. Each w_j is at the share σ(u_j) of the span that
    the earlier ones leave it. The same holds for a diffuse reflectance below a specular one r, with
    w_j = ln κ ρ_j (1 − r). A = A₀ + Σ area_j ρ_j is the total albedo-area.

    A relative light curve fixes the ratios of the reflectances. Then w₁ = 0 takes the place of u₁,
    and ln κ A is left out.

    Parameters
    ----------
    reflectances : sequence of J Reflectance
    constant : float or None
        A₀ in m²; None for a relative light curve.
    """

    domain = constraints.real_vector  # pyright: ignore[reportAssignmentType]
    codomain = constraints.real_vector  # pyright: ignore[reportAssignmentType]

    def __init__(self, reflectances: Sequence[Reflectance], constant: float | None) -> None:
        self.reflectances, self.constant = tuple(reflectances), constant

    def __call__(self, x: jax.Array) -> jax.Array:
        return self._values(x)[0]

    def log_abs_det_jacobian(self, x: jax.Array, y: jax.Array, intermediates=None) -> jax.Array:  # noqa: ARG002
        return self._values(x)[1]

    def _values(self, x: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The sites, and ln |∂ sites/∂x|."""
        free = x[1:] if self.constant is not None else jnp.concatenate([jnp.zeros(1), x[1:]])
        log_det, products, inside = jnp.zeros(()), [], None
        for u, one in zip(free, self.reflectances, strict=True):
            above = None if one.above is None else products[one.above]
            span = _left(inside, one, above)
            products.append(u if span is None else span.at(u))
            log_det += 0.0 if span is None else span.log_slope(u)
            inside = _narrowed(inside, one, products[-1], above)
        size = x[0] if inside is None else inside.at(x[0])
        log_det += 0.0 if inside is None else inside.log_slope(x[0])
        log_rho = jnp.stack(products) - size
        log_rho -= self._log_transmitted(log_rho)
        bounded = np.array([one.bounded for one in self.reflectances])
        sites = jnp.where(bounded, jnp.exp(log_rho), log_rho)
        log_det += jnp.sum(jnp.where(bounded, log_rho, 0.0))
        if self.constant is not None:
            sites = jnp.append(size + self._log_area(log_rho), sites)
        return sites, log_det

    def _inverse(self, y: jax.Array) -> jax.Array:
        sites = y if self.constant is None else y[1:]
        every = zip(sites, self.reflectances, strict=True)
        log_rho = jnp.stack([jnp.log(v) if one.bounded else v for v, one in every])
        size = -log_rho[0] if self.constant is None else y[0] - self._log_area(log_rho)
        products = log_rho + size + self._log_transmitted(log_rho)
        free, inside = [], None
        for w, one in zip(products, self.reflectances, strict=True):
            above = None if one.above is None else products[one.above]
            span = _left(inside, one, above)
            free.append(w if span is None else span.free(w))
            inside = _narrowed(inside, one, w, above)
        first = size if inside is None else inside.free(size)
        return jnp.stack([first, *free[self.constant is None :]])

    def _log_transmitted(self, log_rho: jax.Array) -> jax.Array:
        """ln (1 − r) of the layer above each reflectance, (J,)."""
        above = (one.above for one in self.reflectances)
        rho = [0.0 if k is None else jnp.exp(log_rho[k]) for k in above]
        return jnp.log1p(-jnp.stack(rho))

    def _log_area(self, log_rho: jax.Array) -> jax.Array:
        """ln A in m²."""
        area = jnp.array([one.area for one in self.reflectances])
        return jnp.log((self.constant or 0.0) + jnp.sum(area * jnp.exp(log_rho)))

    def tree_flatten(self):
        return (), ((), {"reflectances": self.reflectances, "constant": self.constant})

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ReflectanceProducts):
            return False
        mine, theirs = ((x.reflectances, x.constant) for x in (self, other))
        return mine == theirs

    def __hash__(self) -> int:
        return hash((self.reflectances, self.constant))


def _left(inside: _Span | None, one: Reflectance, above: jax.Array | None) -> _Span | None:
    """Where the product of a reflectance may lie if ln κ must be inside a span; None: anywhere.

    ``above`` is the product of the layer above, if there is one.
    """
    if inside is None or not one.bounded:
        return None
    ends = [inside.start, inside.start + inside.width]
    if above is not None:  # ln (κ − exp above)
        ends = [x + jnp.log1p(-jnp.minimum(jnp.exp(above - x), 1.0 - EDGE)) for x in ends]
    low, high = (x + end for x, end in zip(ends, one.ends, strict=True))
    return _Span(low, high - low)


def _narrowed(
    inside: _Span | None, one: Reflectance, product: jax.Array, above: jax.Array | None
) -> _Span | None:
    """The part of the span of ln κ in which one more reflectance is inside its range."""
    if not one.bounded:
        return inside
    low, high = (product - end for end in reversed(one.ends))
    if above is not None:
        low, high = jnp.logaddexp(low, above), jnp.logaddexp(high, above)
    if inside is not None:
        low = jnp.maximum(low, inside.start)
        high = jnp.minimum(high, inside.start + inside.width)
    return _Span(low, high - low)
