"""Coordinates of the size and the reflectances of a body of known parts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpyro.distributions import constraints
from numpyro.distributions.transforms import Transform

from lcbayes.core.jax_setup import jax, jnp

LEAST = 1e-6  # of the upper end of a prior's range, in place of a lower end at zero
EDGE = 1e-9  # share of a range, that a value keeps from its ends
SOFT = 0.1  # share of a range over which a coordinate bends at each end
STEPS = 12  # of Newton's method, which is then exact to rounding
LEAST_ROOM = 1e-12  # below the upper end of a range, in units of its bend


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


class _Range(NamedTuple):
    """An interval [a, b] whose points are smooth functions of real numbers.

    y = a + s [softplus((v − a)/s) − softplus((v − b)/s)], s = `SOFT` (b − a), is v but near the
    ends.
    """

    a: float
    b: float

    @property
    def soft(self) -> float:
        return SOFT * (self.b - self.a)

    def at(self, v: jax.Array) -> tuple[jax.Array, jax.Array]:
        """y, and ln dy/dv."""
        p, q = (v - self.a) / self.soft, (v - self.b) / self.soft
        y = self.a + self.soft * (jax.nn.softplus(p) - jax.nn.softplus(q))
        constant = np.log(-np.expm1(-1.0 / SOFT))
        slope = jax.nn.log_sigmoid(p) + jax.nn.log_sigmoid(-q) + constant
        return jnp.clip(y, self.a, self.b), slope

    def excess(self, v: jax.Array) -> jax.Array:
        """s softplus((v − b)/s), by which v lies beyond the upper end."""
        return self.soft * jax.nn.softplus((v - self.b) / self.soft)

    def free(self, y: jax.Array) -> jax.Array:
        """v of y."""
        whole = 1.0 / SOFT
        p = jnp.clip((y - self.a) / self.soft, EDGE * whole, (1.0 - EDGE) * whole)
        return self.a + self.soft * (jnp.log(jnp.expm1(p)) - jnp.log(-jnp.expm1(p - whole)))


class ReflectanceCoordinates(Transform):
    """(x₀, x₁ … x_J) ↔ (ln κ A, ρ₁ … ρ_J), the brightness and the reflectances of a body.

    The light curve of a body of κ times its size fixes the products κ ρ_j of the surfaces that are
    seen, and κ only within the ranges of the reflectances: a ridge along which each ρ_j falls as
    1/κ. In ln κ and v_j, where v_j is ln ρ_j but near the ends of the range of ρ_j, it is a
    straight line, and the reflectance of a surface that is not seen is independent of the others.
    The same holds for a diffuse reflectance below a specular one r, where v_j is ln ρ_j (1 − r).

    The line would turn a corner where a bright surface reaches the upper end of its range: its v
    grows on, by an excess U, and κ and the other reflectances do not change. With the sum S of all
    U_j, x₀ = ln κ − S and x_j = v_j + S − U_j, it goes straight on, since x₀ + x_j = ln κ ρ_j. To
    compute S from x takes a root of one variable. S is zero if there are surfaces in layers.
    A = A₀ + Σ area_j ρ_j is the total albedo-area. For a relative light curve x₀ and ln κ A are
    left out.

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
        layered = any(one.above is not None for one in self.reflectances)
        bounded = {j: one for j, one in enumerate(self.reflectances) if one.bounded}
        self._ranges = {} if layered else {j: _Range(*one.ends) for j, one in bounded.items()}

    def __call__(self, x: jax.Array) -> jax.Array:
        return self._values(x)[0]

    def log_abs_det_jacobian(self, x: jax.Array, y: jax.Array, intermediates=None) -> jax.Array:  # noqa: ARG002
        return self._values(x)[1]

    def _values(self, x: jax.Array) -> tuple[jax.Array, jax.Array]:
        """The sites, and ln |∂ sites/∂x|."""
        free = x if self.constant is None else x[1:]
        free, excess, log_det = self._without_excess(free)
        log_rho, sites = [], []
        for u, one in zip(free, self.reflectances, strict=True):
            value = u - _log_transmitted(one, log_rho)
            if one.bounded:
                value, slope = _Range(*one.ends).at(value)
                log_det += slope + value
            log_rho.append(value)
            sites.append(jnp.exp(value) if one.bounded else value)
        if self.constant is not None:
            sites.insert(0, x[0] + excess + self._log_area(log_rho))
        return jnp.stack(sites), log_det

    def _without_excess(self, x: jax.Array) -> tuple[list[jax.Array], jax.Array, jax.Array]:
        """v_j, S and ln |∂v/∂x| of x_1 … x_J.

        With room w_j = (b_j − x_j + S)/s_j > 0, U_j = −s_j ln (1 − exp(−w_j)), so that S is the
        root of S − Σ U_j, which rises and is concave. Newton's method from below never passes it.
        """
        if not self._ranges:
            return list(x), jnp.zeros(()), jnp.zeros(())

        def room(total: jax.Array, x: jax.Array) -> dict[int, jax.Array]:
            each = {j: (r.b - x[j] + total) / r.soft for j, r in self._ranges.items()}
            return {j: jnp.maximum(w, LEAST_ROOM) for j, w in each.items()}

        def stepped(total: jax.Array, x: jax.Array) -> jax.Array:
            each = room(total, x)
            excess = -sum(self._ranges[j].soft * jnp.log(-jnp.expm1(-w)) for j, w in each.items())
            slope = 1.0 + sum(1.0 / jnp.expm1(w) for w in each.values())
            return total - (total - excess) / slope

        known = jax.lax.stop_gradient(x)
        total = jnp.max(jnp.stack([r.excess(known[j]) for j, r in self._ranges.items()]))
        total = jax.lax.fori_loop(1, STEPS, lambda _, s: stepped(s, known), total)
        total = stepped(total, x)  # the derivative of the root is that of a step from it
        v = [u - total for u in x]
        log_det, slope = jnp.zeros(()), jnp.ones(())
        for j, w in room(total, x).items():
            v[j] = self._ranges[j].b - self._ranges[j].soft * jnp.log(jnp.expm1(w))
            log_det -= jnp.log(-jnp.expm1(-w))
            slope += 1.0 / jnp.expm1(w)
        return v, total, log_det - jnp.log(slope)

    def _inverse(self, y: jax.Array) -> jax.Array:
        sites = y if self.constant is None else y[1:]
        every = zip(sites, self.reflectances, strict=True)
        log_rho = [jnp.log(v) if one.bounded else v for v, one in every]
        free = []
        for value, one in zip(log_rho, self.reflectances, strict=True):
            inside = _Range(*one.ends).free(value) if one.bounded else value
            free.append(inside + _log_transmitted(one, log_rho))
        excess = {j: r.excess(free[j]) for j, r in self._ranges.items()}
        total = sum(excess.values())
        free = [v + total - excess.get(j, 0.0) for j, v in enumerate(free)]
        if self.constant is not None:
            free.insert(0, y[0] - self._log_area(log_rho) - total)
        return jnp.stack(free)

    def precision(self, value: jax.Array) -> jax.Array:  # noqa: ARG002
        """Of x (D,) by the uniform priors, (D, D): 12 over the square of each range."""
        widths = [one.ends[1] - one.ends[0] for one in self.reflectances]
        each = [0.0] * (self.constant is not None)
        bounded = (one.bounded for one in self.reflectances)
        each += [12.0 / w**2 if b else 0.0 for w, b in zip(widths, bounded, strict=True)]
        return jnp.diag(jnp.array(each))

    def _log_area(self, log_rho: Sequence[jax.Array]) -> jax.Array:
        """ln A in m²."""
        area = jnp.array([one.area for one in self.reflectances])
        return jnp.log((self.constant or 0.0) + jnp.sum(area * jnp.exp(jnp.stack(log_rho))))

    def tree_flatten(self):
        return (), ((), {"reflectances": self.reflectances, "constant": self.constant})

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ReflectanceCoordinates):
            return False
        mine, theirs = ((x.reflectances, x.constant) for x in (self, other))
        return mine == theirs

    def __hash__(self) -> int:
        return hash((self.reflectances, self.constant))


def _log_transmitted(one: Reflectance, log_rho: Sequence[jax.Array]) -> jax.Array | float:
    """ln (1 − r) of the layer above a reflectance, 0 if there is none."""
    return 0.0 if one.above is None else jnp.log1p(-jnp.exp(log_rho[one.above]))
