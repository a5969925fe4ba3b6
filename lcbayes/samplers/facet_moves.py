"""Moves of single facets across the sphere, where chains would keep each facet where it is.

Gradients lead a chain downhill. They do not lead it from one arrangement of facets to another: a
weak facet may lie wherever it is hardly seen, or share the place of a strong one, and between these
arrangements the density vanishes. The moves here cross such gaps. They use that brightness is
linear in the areas: with the motion and the other facets fixed, the density of one facet over all
directions and areas costs one matrix product.

Relocation draws a facet anew from a table of this density. A merger puts two facets i and j at one
place and draws the freed facet from the table; its inverse splits a facet j, for which a facet i
is taken from elsewhere. All are Metropolis-Hastings moves with the exact posterior density, so the
table only affects how many are accepted.

References
----------
Hastings 1970, Biometrika 57, 97; Green 1995, Biometrika 82, 711 (splits and mergers).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from jax.flatten_util import ravel_pytree

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import SOFTNESS
from lcbayes.modelling.problem import Problem
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel

NORMALS, AREAS = "normals_base", "log_albedo_area"
BANDS, SECTORS = 14, 28  # cells of equal area on the sphere, some 11 degrees wide
BINS = 16  # of ln(area) in each cell
REACH = 6.0  # sd of the area covered by the bins
PRIOR_REACH = 5.0  # sd of the prior of ln(area) covered
WIDTHS = np.radians([2.0, 5.0, 12.0, 30.0])  # of the angle between the parts of a split facet


class Facets(NamedTuple):
    """Facets of one draw.

    Attributes
    ----------
    normal : (N, 3)
    log_area : (N,)
    column : (N, T)
        Brightness of each facet at unit area.
    potential : scalar
    """

    normal: jax.Array
    log_area: jax.Array
    column: jax.Array
    potential: jax.Array


class Table(NamedTuple):
    """Density of one facet given the others, constant in each bin of each cell.

    Attributes
    ----------
    low, width : (cells,)
        Lower end of ln(area) and width of its bins.
    log_density : (cells, BINS)
        Per steradian and unit of ln(area).
    cumulated : (cells * BINS,)
        Probability up to and including each bin.
    """

    low: jax.Array
    width: jax.Array
    log_density: jax.Array
    cumulated: jax.Array


class Sky(NamedTuple):
    """Cells in axes that are drawn anew for each sweep, so that their edges do not matter.

    Attributes
    ----------
    axes : (3, 3)
        Orthogonal.
    column : (cells, T)
        Brightness of a facet of unit area at the centre of each cell.
    information : (cells,)
        Its sum of squares over the errors.
    log_seen : (cells,)
        ln of the prior that the facet is lit and seen.
    """

    axes: jax.Array
    column: jax.Array
    information: jax.Array
    log_seen: jax.Array

    def normal(self, cell: jax.Array, u: jax.Array, v: jax.Array) -> jax.Array:
        """Direction at the fractions u, v of a cell."""
        z = 2.0 * (cell // SECTORS + u) / BANDS - 1.0
        azimuth = 2.0 * jnp.pi * (cell % SECTORS + v) / SECTORS
        across = jnp.sqrt(jnp.maximum(1.0 - z**2, 0.0))
        return jnp.stack([across * jnp.cos(azimuth), across * jnp.sin(azimuth), z], -1) @ self.axes

    def cell(self, normal: jax.Array) -> jax.Array:
        """Cell of a direction (3,)."""
        x, y, z = self.axes @ normal
        band = jnp.clip(jnp.floor(0.5 * (z + 1.0) * BANDS), 0, BANDS - 1)
        turn = jnp.mod(jnp.arctan2(y, x) / (2.0 * jnp.pi), 1.0)
        return (band * SECTORS + jnp.clip(jnp.floor(turn * SECTORS), 0, SECTORS - 1)).astype(int)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FacetMoves:
    """Moves of the facets of one problem, as a function ``moves(key, z, data)``.

    The model has the sites ``normals_base`` (directions of any length, which are kept),
    ``log_albedo_area``, ``sun_body`` and ``obs_body``, and the prior of visibility.

    Attributes
    ----------
    flux, weight : (T,)
        Observed flux at unit distance in full sunlight, and one over its squared error.
    problem : Problem
    law : reflectance
    log_area_mean, log_area_sd : prior of ln(area)
    """

    flux: jax.Array
    weight: jax.Array
    problem: Problem = field(metadata={"static": True})
    law: DiffuseLaw = field(default="non-lambertian", metadata={"static": True})
    log_area_mean: float = field(default=0.0, metadata={"static": True})
    log_area_sd: float = field(default=1.0, metadata={"static": True})

    @classmethod
    def of(
        cls, problem: Problem, data: Epochs, law: DiffuseLaw, log_mean: float, log_sd: float
    ) -> FacetMoves | None:
        """The moves for a light curve; None if a part of it has an unknown scale."""
        if any(data.free_scale) or not data.has_error:
            return None
        flux, error = data.as_flux()
        weight = np.where(np.isfinite(error), data.information, 0.0) / error**2
        return cls(jnp.asarray(flux), jnp.asarray(weight), problem, law, log_mean, log_sd)

    def __call__(self, key: jax.Array, z: jax.Array, data: Epochs) -> jax.Array:
        """z (D,) after one relocation of each facet and as many splits or mergers."""
        free = self.problem.unravel(z)
        length = jnp.linalg.norm(free[NORMALS], axis=1, keepdims=True)
        sites = self.problem.constrain(z, data)
        sun, obs = sites["sun_body"], sites["obs_body"]

        def flat(normal: jax.Array, log_area: jax.Array) -> jax.Array:
            return ravel_pytree({**free, NORMALS: length * normal, AREAS: log_area})[0]

        def complete(normal: jax.Array, log_area: jax.Array) -> Facets:
            potential = self.problem.potential(flat(normal, log_area), data)
            return Facets(normal, log_area, self._columns(sun, obs, normal), potential)

        key_axes, key_one, key_two = jax.random.split(key, 3)
        sky = self._sky(key_axes, sun, obs)
        facets = complete(free[NORMALS] / length, free[AREAS])
        number = len(free[AREAS])

        def relocate(facets: Facets, move: tuple[jax.Array, jax.Array]):
            return self._relocated(*move, facets, sky, complete), None

        def rearrange(facets: Facets, key: jax.Array):
            return self._rearranged(key, facets, sky, complete), None

        keys = jax.random.split(key_one, number)
        facets, _ = jax.lax.scan(relocate, facets, (keys, jnp.arange(number)))
        if number > 1:
            facets, _ = jax.lax.scan(rearrange, facets, jax.random.split(key_two, number))
        return flat(facets.normal, facets.log_area)

    def _columns(self, sun: jax.Array, obs: jax.Array, normal: jax.Array) -> jax.Array:
        return diffuse_kernel(self.law, normal @ sun.T, normal @ obs.T, LAMBERT_C)[0]

    def _sky(self, key: jax.Array, sun: jax.Array, obs: jax.Array) -> Sky:
        axes = jax.random.orthogonal(key, 3)
        nothing = jnp.zeros(())
        empty = Sky(axes, nothing, nothing, nothing)
        normal = empty.normal(jnp.arange(BANDS * SECTORS), jnp.array(0.5), jnp.array(0.5))
        best = jnp.max(jnp.minimum(normal @ sun.T, normal @ obs.T), axis=1)
        column = self._columns(sun, obs, normal)
        log_seen = -((jnp.minimum(best, 0.0) / SOFTNESS) ** 2)
        return Sky(axes, column, column**2 @ self.weight, log_seen)

    def _table(self, sky: Sky, rest: jax.Array) -> Table:
        """Density of a facet that explains ``rest`` (T,), the flux without the other facets.

        It is the prior times exp(b α − a α²/2), with a and b the information and the projection of
        a column; the bins of each cell cover the areas of some probability.
        """
        information = sky.information + 1e-300
        along = sky.column @ (self.weight * rest)
        best, sd = along / information, information**-0.5
        least = np.exp(self.log_area_mean - PRIOR_REACH * self.log_area_sd)
        most = np.exp(self.log_area_mean + PRIOR_REACH * self.log_area_sd)
        low = jnp.log(jnp.clip(best - REACH * sd, least, 0.5 * most))
        high = jnp.log(jnp.clip(best + REACH * sd, 1.05 * jnp.exp(low), most))
        width = (high - low) / BINS
        x = low[:, None] + (jnp.arange(BINS) + 0.5) * width[:, None]
        area = jnp.exp(x)
        prior = -0.5 * ((x - self.log_area_mean) / self.log_area_sd) ** 2 + sky.log_seen[:, None]
        log_density = area * (along[:, None] - 0.5 * information[:, None] * area) + prior
        volume = jnp.log(4.0 * jnp.pi / (BANDS * SECTORS) * width)[:, None]
        cumulated = jnp.cumsum(jnp.exp(log_density + volume - jnp.max(log_density + volume)))
        log_total = jnp.max(log_density + volume) + jnp.log(cumulated[-1])
        return Table(low, width, log_density - log_total, cumulated / cumulated[-1])

    def _rest(self, facets: Facets, left_out: jax.Array) -> jax.Array:
        """Flux (T,) without the facets that are not left out (N,)."""
        return self.flux - jnp.where(left_out, 0.0, jnp.exp(facets.log_area)) @ facets.column

    def _relocated(
        self, key: jax.Array, i: jax.Array, facets: Facets, sky: Sky, complete: Callable
    ) -> Facets:
        """Facet i drawn anew."""
        key_draw, key_accept = jax.random.split(key)
        table = self._table(sky, self._rest(facets, jnp.arange(len(facets.log_area)) == i))
        normal, log_area, log_new = _drawn(key_draw, table, sky)
        log_old = _log_density(table, sky, facets.normal[i], facets.log_area[i])
        moved = complete(
            facets.normal.at[i].set(normal),
            facets.log_area.at[i].set(log_area),
        )
        return _accepted(key_accept, facets, moved, log_old - log_new)

    def _rearranged(self, key: jax.Array, facets: Facets, sky: Sky, complete: Callable) -> Facets:
        """Two facets merged and one drawn anew, or one facet split and another given up.

        A facet of area α and normal n becomes facets of areas uα and (1 − u)α at angles (1 − u)θ
        and uθ from n on opposite sides; u is uniform and the displacement θ has a normal density of
        one of `WIDTHS`. The volume dΩᵢ dΩⱼ dln αᵢ dln αⱼ is sin θ/(u(1 − u)) dθ dψ du dΩ dln α.
        """
        key_pair, key_which, key_split, key_draw, key_accept = jax.random.split(key, 5)
        number = len(facets.log_area)
        i, apart = jax.random.randint(key_pair, (2,), jnp.array([0, 1]), jnp.array([number] * 2))
        j = (i + apart) % number
        merging = jax.random.bernoulli(key_which)
        pair = facets.normal[jnp.stack([i, j])], facets.log_area[jnp.stack([i, j])]
        one, u, angle = _merged(*pair)
        parts, u_split, angle_split = _split(key_split, pair[0][1], pair[1][1])
        host = _where(merging, one, (pair[0][1], pair[1][1]))  # facet j while i is elsewhere
        u, angle = _where(merging, (u, angle), (u_split, angle_split))

        index = jnp.arange(number)
        sites = complete(facets.normal.at[j].set(host[0]), facets.log_area.at[j].set(host[1]))
        table = self._table(sky, self._rest(sites, index == i))
        normal, log_area, log_drawn = _drawn(key_draw, table, sky)
        log_given_up = _log_density(table, sky, pair[0][0], pair[1][0])
        after = _where(
            merging,
            (jnp.stack([normal, one[0]]), jnp.stack([log_area, one[1]])),
            parts,
        )
        volume = jnp.log(u * (1.0 - u)) - jnp.log(jnp.sin(angle)) + _log_angle(angle)
        moved = complete(
            facets.normal.at[i].set(after[0][0]).at[j].set(after[0][1]),
            facets.log_area.at[i].set(after[1][0]).at[j].set(after[1][1]),
        )
        log_ratio = jnp.where(merging, volume - log_drawn, log_given_up - volume)
        return _accepted(key_accept, facets, moved, log_ratio)


def _merged(normal: jax.Array, log_area: jax.Array):
    """The facet that two facets (2, 3), (2,) are merged into, the share u of the first in its area,
    and the angle θ between them."""
    u = jax.nn.sigmoid(log_area[0] - log_area[1])
    cosine = normal[0] @ normal[1]
    across = normal[0] - cosine * normal[1]
    sine = jnp.sqrt(jnp.sum(across**2) + 1e-30)
    angle = jnp.arctan2(sine, cosine)
    merged = _unit(jnp.cos(u * angle) * normal[1] + jnp.sin(u * angle) * across / sine)
    return (merged, jnp.logaddexp(log_area[0], log_area[1])), u, angle


def _split(key: jax.Array, normal: jax.Array, log_area: jax.Array):
    """The inverse of `_merged`, with random u, θ and direction ψ."""
    key_share, key_width, key_angle, key_turn = jax.random.split(key, 4)
    u = jax.random.uniform(key_share, minval=1e-9, maxval=1.0 - 1e-9)
    angle = jax.random.choice(key_width, jnp.asarray(WIDTHS)) * jax.random.rayleigh(key_angle, 1.0)
    angle = jnp.maximum(angle, 1e-9)
    axis = jnp.eye(3)[jnp.argmin(jnp.abs(normal))]
    first = _unit(jnp.cross(normal, axis))
    turn = 2.0 * jnp.pi * jax.random.uniform(key_turn)
    along = jnp.cos(turn) * first + jnp.sin(turn) * jnp.cross(normal, first)
    offset = jnp.stack([(1.0 - u) * angle, -u * angle])[:, None]
    normals = jnp.cos(offset) * normal + jnp.sin(offset) * along
    return (normals, log_area + jnp.log(jnp.stack([u, 1.0 - u]))), u, angle


def _log_angle(angle: jax.Array) -> jax.Array:
    """ln of the density of θ and ψ in `_split`; none for θ above π, which `_merged` cannot undo."""
    widths = jnp.asarray(WIDTHS)
    each = jnp.log(angle / widths**2) - 0.5 * (angle / widths) ** 2
    density = jax.nn.logsumexp(each) - np.log(len(WIDTHS) * 2.0 * np.pi)
    return jnp.where(angle < jnp.pi, density, jnp.inf)


def _drawn(key: jax.Array, table: Table, sky: Sky) -> tuple[jax.Array, jax.Array, jax.Array]:
    """A normal, ln(area) and their log density, from a table."""
    which, u, v, w = jax.random.uniform(key, (4,))
    flat = jnp.minimum(jnp.searchsorted(table.cumulated, which), table.cumulated.size - 1)
    cell, bin_ = flat // BINS, flat % BINS
    log_area = table.low[cell] + (bin_ + w) * table.width[cell]
    return sky.normal(cell, u, v), log_area, table.log_density[cell, bin_]


def _log_density(table: Table, sky: Sky, normal: jax.Array, log_area: jax.Array) -> jax.Array:
    """Log density of a facet in a table; −inf outside its bins."""
    cell = sky.cell(normal)
    place = (log_area - table.low[cell]) / table.width[cell]
    bin_ = jnp.clip(jnp.floor(place), 0, BINS - 1).astype(int)
    inside = (place >= 0.0) & (place <= BINS)
    return jnp.where(inside, table.log_density[cell, bin_], -jnp.inf)


def _accepted(key: jax.Array, old: Facets, new: Facets, log_ratio: jax.Array) -> Facets:
    """The new facets with probability min{1, exp(U − U′ + log_ratio)}, otherwise the old."""
    better = old.potential - new.potential + log_ratio
    return _where(jnp.log(jax.random.uniform(key)) < better, new, old)


def _where(condition: jax.Array, yes, no):
    return jax.tree.map(partial(jnp.where, condition), yes, no)


def _unit(vector: jax.Array) -> jax.Array:
    return vector / jnp.sqrt(jnp.sum(vector**2))
