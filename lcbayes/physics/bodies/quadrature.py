"""Gauss-Legendre quadrature of the light that a curved surface reflects.

The integrand is smooth in the part that is lit and visible. Where a law has a kink, at μ₀ = μ, the
interval is divided, and so it is at `REACH` standard deviations of a glossy surface's lobe on
either side of the highlight, where the normal is the bisector. The error therefore does not depend
on the width of the lobe.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from jax.custom_derivatives import SymbolicZero

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.physics.reflectance import GRAZING, Geometry, Parameters, get_law

BLOCK = 1 << 18  # epochs x nodes at once
REACH = 4.5
WIDEST = 2.0  # rad: a lobe's reach
TINY = 1e-15


def length(v: jax.Array) -> jax.Array:
    """|v| along the last axis, at least 1e-15, with finite derivatives."""
    square = jnp.sum(v**2, axis=-1)
    small = square < TINY**2
    return jnp.where(small, TINY, jnp.sqrt(jnp.where(small, 1.0, square)))


class Rule(NamedTuple):
    """Points of a quadrature: (T, K, 2 or 3) coordinates and (T, K) weights."""

    points: jax.Array
    weights: jax.Array


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def integral(integrand: Callable[..., jax.Array], values: Any, rule: Rule) -> jax.Array:
    """Σ w f(values, x), (T,), of an integrand that vanishes at the limits.

    A change of the limits therefore does not change the integral to first order, and its derivative
    is the integral of ∂f/∂values. Second derivatives follow the limits.
    """
    return jnp.sum(rule.weights * integrand(values, rule.points), axis=1)


@partial(integral.defjvp, symbolic_zeros=True)
def _integral_jvp(integrand, primals, tangents):
    (values, rule), (changes, _) = primals, tangents
    leaves, tree = jax.tree.flatten(values)
    steps = jax.tree.leaves(changes, is_leaf=lambda x: isinstance(x, SymbolicZero))
    live = [i for i, step in enumerate(steps) if not isinstance(step, SymbolicZero)]

    def of(*moved: jax.Array) -> jax.Array:
        own = list(leaves)
        for i, leaf in zip(live, moved, strict=True):
            own[i] = leaf
        return jnp.sum(rule.weights * integrand(jax.tree.unflatten(tree, own), rule.points), axis=1)

    if not live:
        value = of()
        return value, jnp.zeros_like(value)
    return jax.jvp(of, [leaves[i] for i in live], [steps[i] for i in live])


def reflected(
    law: str,
    parameters: Parameters,
    mu0: jax.Array,
    mu: jax.Array,
    halves: tuple[jax.Array, jax.Array],
    bisector_uv: tuple[jax.Array, jax.Array],
) -> jax.Array:
    """f_r μ₀ μ at the nodes (T, K), zero where dark; ``halves`` are c and the phase angle, (T,)."""
    c, phase = (x[:, None] for x in halves)
    lit = (mu0 > GRAZING) & (mu > GRAZING)
    geom = Geometry(
        mu0=jnp.where(lit, mu0, 1.0),
        mu=jnp.where(lit, mu, 1.0),
        mu_h=jnp.where(lit, (mu0 + mu) / (2.0 * c), 1.0),
        h_u=jnp.where(lit, bisector_uv[0], 0.0),
        h_v=jnp.where(lit, bisector_uv[1], 0.0),
        c=c,
        phase=phase,
    )
    return jnp.where(lit, get_law(law).brdf(geom, parameters) * geom.mu0 * geom.mu, 0.0)


def lobe_exponent(law: str, p: Parameters) -> jax.Array | None:
    """z of the lobe (n·h)^z that is as narrow as that of a law; None for a law without a lobe."""
    if get_law(law).diffuse:
        return None
    if "m" in p:
        return 2.0 / jnp.square(jnp.asarray(p["m"]))
    exponents = [jnp.asarray(p[name]) for name in ("n", "nu", "nv") if name in p]
    return jnp.max(jnp.stack(exponents))


def reach(curvature: jax.Array) -> jax.Array:
    """How far a lobe exp(−curvature x²/2) extends."""
    return REACH * jax.lax.rsqrt(curvature + (REACH / WIDEST) ** 2)


KINKED = ("ashikhmin-shirley", "cook-torrance")  # by max(μ₀, μ) or min(μ₀, μ)


class Nodes(NamedTuple):
    """Nodes between two limits, (T, K) each.

    Attributes
    ----------
    at, weight
        Of the quadrature.
    cell
        Middle of the interval, as wide as the weight, that a node stands for. The intervals of all
        nodes together cover that between the limits.
    """

    at: jax.Array
    weight: jax.Array
    cell: jax.Array


def nodes_between(low: jax.Array, high: jax.Array, inner: Sequence[jax.Array], count: int) -> Nodes:
    """Nodes from low to high (T,), which are divided at ``inner`` points, in any order."""
    x, w = np.polynomial.legendre.leggauss(count)
    x, w = 0.5 * (1.0 + x), 0.5 * w
    middle = np.cumsum(w) - 0.5 * w
    between = jnp.sort(jnp.stack([jnp.clip(cut, low, high) for cut in inner] or [low]), axis=0)
    cuts = [low, *(between if inner else []), high]
    starts, steps = jnp.stack(cuts[:-1], axis=1), jnp.diff(jnp.stack(cuts, axis=1), axis=1)

    def joined(share: np.ndarray, start: jax.Array | float) -> jax.Array:
        return (start + steps[:, :, None] * share).reshape(len(low), -1)

    start = starts[:, :, None]
    return Nodes(joined(x, start), joined(w, 0.0), joined(middle, start))


def in_blocks(
    of: Callable[[jax.Array, jax.Array], jax.Array], sun: jax.Array, obs: jax.Array, count: int
) -> jax.Array:
    """``of(sun, obs)`` in blocks of epochs that are computed again in the backward pass, where
    ``count`` nodes an epoch would need much memory."""
    epochs, block = sun.shape[0], max(1, BLOCK // count)
    if epochs <= block:
        return of(sun, obs)
    blocks = -(-epochs // block)
    padded = [jnp.pad(x, ((0, blocks * block - epochs), (0, 0)), mode="edge") for x in (sun, obs)]
    cut = tuple(x.reshape(blocks, block, 3) for x in padded)
    return jax.lax.map(lambda both: jax.checkpoint(of)(*both), cut).reshape(-1)[:epochs]
