"""Ratio of the evidences of N + 1 and N facets, by a bridge through a facet that is added.

A Gaussian does not describe the posterior of more facets than the data show: the superfluous one
may lie anywhere where it is hardly seen, or be a part of another. Bodies of N facets and one more
do. Each draw of N facets gets one more in either of two ways: it is drawn from its density given
the others, or one of them is divided, both as in `samplers.facet_moves`. The density of such
bodies, over all facets that may be the added one, overlaps with the posterior of N + 1 facets, and
the bridge between the two gives the ratio of the evidences.

References
----------
Meng & Wong 1996, Statistica Sinica 6, 831; Bartolucci, Scaccia & Mira 2006, Biometrika 93, 41
(bridges between the models of a reversible jump).
"""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import UniformDirection
from lcbayes.modelling.problem import Problem
from lcbayes.modelling.recorded import Sites
from lcbayes.samplers import bridge, facet_pairs
from lcbayes.samplers.bridge import LogEvidence
from lcbayes.samplers.facet_moves import AREAS, CELL, NORMALS, FacetMoves, Facets, Place

Floats = NDArray[np.float64]

DRAWS = 500  # of each chain
EFFECTIVE = 100.0  # of these, in the error
NOWHERE = -30.0  # ln(area) of a facet that is about to be drawn
AXES = 0  # key of the axes of the cells, which are the same for all bodies


class Ratio(NamedTuple):
    """ln of the evidence of N + 1 facets over that of N, from all chains and from each (C,)."""

    whole: LogEvidence
    each: Floats


def log_ratio(
    smaller: Problem,
    moves: FacetMoves,
    data: Epochs,
    fewer: list[Floats],
    more: list[Floats],
    key: jax.Array,
) -> Ratio:
    """The ratio from draws (n, D) of each chain with ``fewer`` and with ``more`` facets.

    Parameters
    ----------
    smaller : Problem
        With one facet fewer than that of ``moves``; all other sites are the same.
    """
    chains = len(fewer)
    keys = jax.random.split(key, chains * DRAWS)
    bodies = _with_one_more(smaller, moves, data, keys, np.concatenate([_thin(z) for z in fewer]))
    at_p = _log_ratios(smaller, moves, data, np.concatenate([_thin(z) for z in more]))
    at_q = _log_ratios(smaller, moves, data, bodies)
    at_p, at_q = (np.asarray(at).reshape(chains, DRAWS) for at in (at_p, at_q))
    effective = chains * EFFECTIVE
    whole = bridge.log_ratio(at_p.ravel(), at_q.ravel(), effective, effective)
    each = [bridge.log_ratio(p, q, EFFECTIVE, EFFECTIVE) for p, q in zip(at_p, at_q, strict=True)]
    return Ratio(whole, np.array([one.value for one in each]))


def _thin(z: Floats) -> Floats:
    """`DRAWS` of the draws (n, D) of a chain at even intervals, some twice if there are too few."""
    return z[np.linspace(0, len(z) - 1, DRAWS).astype(int)]


@partial(jax.jit, static_argnums=0)
def _with_one_more(
    smaller: Problem, moves: FacetMoves, data: Epochs, keys: jax.Array, rows: jax.Array
) -> jax.Array:
    """A body with one facet more for each row z (n, D)."""

    def one(given: tuple[jax.Array, jax.Array]) -> jax.Array:
        key_which, key_drawn, key_split, key_length = jax.random.split(given[0], 4)
        free = smaller.unravel(given[1])
        length = jnp.linalg.norm(UniformDirection(1).sample(key_length))
        lengths = jnp.append(jnp.linalg.norm(free[NORMALS], axis=1), length)
        free = free | {
            NORMALS: jnp.vstack([free[NORMALS], jnp.array([0.0, 0.0, 1.0])]),
            AREAS: jnp.append(free[AREAS], NOWHERE),
        }
        place, facets = _facets(moves, data, free)
        new = jnp.array(len(facets.log_area) - 1)
        conditional = place.conditional(facets, new, _none(facets))
        drawn = place.drawn(key_drawn, conditional, new, facets)
        divided = _divided(key_split, facets)
        normal, log_area = jax.tree.map(
            partial(jnp.where, jax.random.bernoulli(key_which)),
            (drawn.normal, drawn.log_area),
            divided,
        )
        return ravel_pytree(free | {NORMALS: lengths[:, None] * normal, AREAS: log_area})[0]

    return jax.lax.map(one, (keys, rows))


def _divided(key: jax.Array, facets: Facets) -> tuple[jax.Array, jax.Array]:
    """Normals and ln(area) with one of the facets divided, its second part being the last."""
    key_which, key_split = jax.random.split(key)
    last = len(facets.log_area) - 1
    j = jax.random.randint(key_which, (), 0, last)
    parts, *_ = facet_pairs.drawn_split(key_split, facets.normal[j], facets.log_area[j])
    both = jnp.stack([j, jnp.array(last)])
    return facets.normal.at[both].set(parts[0]), facets.log_area.at[both].set(parts[1])


@partial(jax.jit, static_argnums=0)
def _log_ratios(smaller: Problem, moves: FacetMoves, data: Epochs, rows: jax.Array) -> jax.Array:
    """ln of the posterior of N + 1 facets over the density of bodies with an added facet, at rows
    (n, D), neither normalised by its evidence."""

    def one(z: jax.Array) -> jax.Array:
        free = moves.problem.unravel(z)
        place, facets = _facets(moves, data, free)
        added = jnp.logaddexp(
            _log_drawn(smaller, data, free, place, facets),
            _log_divided(smaller, data, free, facets),
        )
        return -moves.problem.potential(z, data) - (added - np.log(2.0))

    return jax.lax.map(one, rows)


def _log_drawn(
    smaller: Problem, data: Epochs, free: Sites, place: Place, facets: Facets
) -> jax.Array:
    """ln of the density of bodies of which one facet was drawn given the others."""
    number = len(facets.log_area)

    def without(i: jax.Array) -> jax.Array:
        conditional = place.conditional(facets, i, _none(facets))
        log_q = place.log_q(conditional, i, facets) - np.log(CELL) + _log_length(free[NORMALS][i])
        return log_q - smaller.potential(_left(free, i), data)

    each = jax.lax.map(without, jnp.arange(number))
    return jax.nn.logsumexp(each) - np.log(number)


def _log_divided(smaller: Problem, data: Epochs, free: Sites, facets: Facets) -> jax.Array:
    """ln of the density of bodies of which one facet was divided.

    It is the mean over unordered pairs: whichever part was added, the density is the same.
    """
    number = len(facets.log_area)

    def merged(pair: jax.Array) -> jax.Array:
        i, j = pair
        one, u, angle = facet_pairs.merged(facets.normal[pair], facets.log_area[pair])
        length = jnp.linalg.norm(free[NORMALS][j])
        host = free | {
            NORMALS: free[NORMALS].at[j].set(length * one[0]),
            AREAS: free[AREAS].at[j].set(one[1]),
        }
        log_q = facet_pairs.log_split(u, angle) + _log_length(free[NORMALS][i])
        return log_q - smaller.potential(_left(host, i), data)

    pairs = np.stack(np.triu_indices(number, 1), axis=1)
    each = jax.lax.map(merged, jnp.asarray(pairs))
    return jax.nn.logsumexp(each) - np.log(len(pairs))


def _facets(moves: FacetMoves, data: Epochs, free: Sites) -> tuple[Place, Facets]:
    """The facets of a body, and the moves for its motion."""
    sites = moves.problem.constrain(ravel_pytree(free)[0], data)
    place = moves.at(jax.random.key(AXES), sites["sun_body"], sites["obs_body"])
    length = jnp.linalg.norm(free[NORMALS], axis=1, keepdims=True)
    return place, place.facets(free[NORMALS] / length, free[AREAS])


def _left(free: Sites, i: jax.Array) -> jax.Array:
    """The flat vector without facet i."""
    number = len(free[AREAS]) - 1
    rows = jnp.arange(number) + (jnp.arange(number) >= i)
    return ravel_pytree(free | {NORMALS: free[NORMALS][rows], AREAS: free[AREAS][rows]})[0]


def _log_length(base: jax.Array) -> jax.Array:
    """ln of the prior of a vector (3,) over that of its direction, which is uniform."""
    return UniformDirection(1).log_prob(base[None])[0] + np.log(4.0 * np.pi)


def _none(facets: Facets) -> jax.Array:
    return jnp.zeros(len(facets.log_area), bool)
