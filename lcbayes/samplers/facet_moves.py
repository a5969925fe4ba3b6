"""Moves of single facets across the sphere, where chains would keep each facet where it is.

Gradients lead a chain downhill. They do not lead it from one arrangement of facets to another: a
weak facet may lie wherever it is hardly seen, or share the place of a strong one, and between these
arrangements the density vanishes. The moves here cross such gaps. They use that brightness is
linear in the areas: with the motion and the other facets fixed, the density of one facet over all
directions and areas costs one matrix product.

Relocation draws the direction of a facet anew, and its area together with those of a random part
of the others, whose Gaussian density is integrated out when the direction is drawn. A merger puts
two facets i and j at one place and draws the freed facet anew; its inverse splits a facet j, for
which a facet i is taken from elsewhere. An exchange passes area between two close facets and moves
them such that their sum, its centre and its width remain. A rescaling multiplies all areas by one
factor, which zero points leave open. All are Metropolis-Hastings moves with the exact posterior
density, so that approximations only affect how many are accepted. Zero points that the model
integrates out are integrated out here too.

References
----------
Hastings 1970, Biometrika 57, 97; Green 1995, Biometrika 82, 711 (splits and mergers).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from jax.flatten_util import ravel_pytree
from jax.scipy.linalg import solve_triangular

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import zero_points
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.priors import SOFTNESS
from lcbayes.modelling.problem import Problem
from lcbayes.physics.brightness import LAMBERT_C, DiffuseLaw, diffuse_kernel
from lcbayes.samplers import facet_pairs

NORMALS, AREAS = "normals_base", "log_albedo_area"
BANDS, SECTORS = 20, 40  # cells of equal area on the sphere, some 7 degrees wide
CELL = 4.0 * np.pi / (BANDS * SECTORS)  # sr
NODES = 6  # of ln(area), by which a cell is weighed
BINS = 32  # of ln(area) of the facet that is drawn
REACH = 6.0  # sd of the area covered by the bins
PRIOR_REACH = 5.0  # sd of the prior of ln(area) covered
SHARES = (0.0, 0.5, 1.0)  # of the other facets whose areas are drawn with a relocated facet
MOVES = 4  # of each kind in a sweep
SIGNAL = 3.0  # signal-to-noise ratio below which facets are weak
CLOSE, FAR = 0.5, 0.05  # angle (rad) of close facets, and weight of others
FACTORS = (0.001, 0.003, 0.01, 0.03, 0.1)  # sd of ln of a common factor
TINY = 1e-12


class Facets(NamedTuple):
    """Facets of one draw.

    Attributes
    ----------
    normal : (N, 3)
    log_area : (N,)
    column : (N, T)
        Brightness of each facet at unit area, over its errors.
    product : (N, cells)
        Products of these columns with those of the cells of a `Sky`.
    """

    normal: jax.Array
    log_area: jax.Array
    column: jax.Array
    product: jax.Array

    def replaced(self, i: jax.Array, other: Facets) -> Facets:
        """The facets with another facet i, or other facets i (n,)."""
        return jax.tree.map(lambda mine, its: mine.at[i].set(its), self, other)

    @property
    def log_weakness(self) -> jax.Array:
        """ln of the probability (N,) that a facet is chosen: weak ones can be elsewhere."""
        signal = jnp.exp(self.log_area) * jnp.sqrt(jnp.sum(self.column**2, axis=1))
        return jax.nn.log_softmax(-jnp.log(SIGNAL + signal))

    @property
    def log_weak_pair(self) -> jax.Array:
        """ln of the probability (N, N) that a facet i is given up to split a facet j."""
        other = ~jnp.eye(len(self.log_area), dtype=bool)
        each = self.log_weakness[:, None] - jnp.log(len(self.log_area) - 1.0)
        return jnp.where(other, each, -jnp.inf)

    @property
    def log_close(self) -> jax.Array:
        """ln of the probability (N, N) that two facets i and j are merged: mostly close ones."""
        square = jnp.sum((self.normal[:, None] - self.normal) ** 2, axis=-1)  # of the chord
        log_weight = jnp.logaddexp(-0.5 * square / CLOSE**2, np.log(FAR))
        other = ~jnp.eye(len(self.log_area), dtype=bool)
        log_weight = jnp.where(other, log_weight, -jnp.inf)
        return log_weight - jax.nn.logsumexp(log_weight)


_State = tuple[Facets, jax.Array]  # with the potential
_Proposal = tuple[Facets, jax.Array]  # with ln of the ratio of the densities of proposal


class Sky(NamedTuple):
    """Cells in axes that are drawn anew for each sweep, so that their edges do not matter.

    Attributes
    ----------
    axes : (3, 3)
        Orthogonal.
    column : (cells, T)
        Brightness of a facet of unit area at the centre of each cell, over the errors.
    square, flux : (cells,)
        Its products with itself and with the observed flux.
    zero : (G, cells)
        Its products with the zero points.
    log_seen : (cells,)
        ln of the prior that the facet is lit and seen.
    """

    axes: jax.Array
    column: jax.Array
    square: jax.Array
    flux: jax.Array
    zero: jax.Array
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


class Conditional(NamedTuple):
    """Density from which a facet is drawn, with the areas of a part of the others.

    Attributes
    ----------
    part : (N,) bool
        The other facets whose areas are drawn too.
    columns : (G + N, T)
        Zero points, then the facets of that part; other rows vanish.
    rest : (T,)
        Flux without the facets that are fixed, over its errors.
    root : (G + N, G + N)
        Cholesky factor of the information of the coefficients of the columns.
    target : (G + N,)
        ``root``⁻¹ times the products of the columns and ``rest``.
    log_cell : (cells,)
        ln of the probability of each cell.
    """

    part: jax.Array
    columns: jax.Array
    rest: jax.Array
    root: jax.Array
    target: jax.Array
    log_cell: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class FacetMoves:
    """Moves of the facets of one problem, as a function ``moves(key, z, data)``.

    The model has the sites ``normals_base`` (directions of any length, which are kept),
    ``log_albedo_area``, ``sun_body`` and ``obs_body``, and the prior of visibility.

    Attributes
    ----------
    flux : (T,)
        Observed flux at unit distance in full sunlight, over its errors.
    scale : (T,)
        One over these errors; 0 for a point without information.
    zero : (G, T)
        Change of ``flux`` by zero points, for independent numbers of unit prior sd.
    problem : Problem
    law : reflectance
    log_area_mean, log_area_sd : prior of ln(area)
    """

    flux: jax.Array
    scale: jax.Array
    zero: jax.Array
    problem: Problem = field(metadata={"static": True})
    law: DiffuseLaw = field(default="non-lambertian", metadata={"static": True})
    log_area_mean: float = field(default=0.0, metadata={"static": True})
    log_area_sd: float = field(default=1.0, metadata={"static": True})

    @classmethod
    def of(
        cls,
        problem: Problem,
        data: Epochs,
        law: DiffuseLaw,
        log_mean: float,
        log_sd: float,
        zero_point_sd: float = 0.0,
    ) -> FacetMoves | None:
        """The moves for a light curve; None if a part of it has an unknown scale."""
        if any(data.free_scale) or not data.has_error:
            return None
        flux, error = data.as_flux()
        scale = np.where(np.isfinite(error), np.sqrt(data.information), 0.0) / error
        number = data.n_calibrations if zero_point_sd > 0 else 0
        root = zero_points.root(data)[:number, :number]
        zero = (np.asarray(data.calibration) == np.arange(number)[:, None]) * scale * flux
        zero = 0.4 * np.log(10.0) * zero_point_sd * root.T @ zero
        flux, scale, zero = (jnp.asarray(x) for x in (scale * flux, scale, zero))
        return cls(flux, scale, zero, problem, law, log_mean, log_sd)

    def __call__(self, key: jax.Array, z: jax.Array, data: Epochs) -> jax.Array:
        """z (D,) after `MOVES` relocations, splits or mergers, exchanges and rescalings each."""
        free = self.problem.unravel(z)
        length = jnp.linalg.norm(free[NORMALS], axis=1, keepdims=True)
        sites = self.problem.constrain(z, data)
        sun, obs = sites["sun_body"], sites["obs_body"]

        def flat(facets: Facets) -> jax.Array:
            sites = {**free, NORMALS: length * facets.normal, AREAS: facets.log_area}
            return ravel_pytree(sites)[0]

        def potential(facets: Facets) -> jax.Array:
            return self.problem.potential(flat(facets), data)

        key_axes, key_moves = jax.random.split(key)
        at = self.at(key_axes, sun, obs)
        start = at.facets(free[NORMALS] / length, free[AREAS])
        kinds = jnp.asarray(np.repeat(range(5), [1] + 4 * [MOVES]))

        def step(state: _State, given: tuple[jax.Array, jax.Array]) -> tuple[_State, None]:
            kind, (key_move, key_accept) = given[0], jax.random.split(given[1])
            moved, log_ratio = jax.lax.switch(
                kind,
                (at.unchanged, at.relocated, at.rearranged, at.exchanged, at.rescaled),
                key_move,
                state[0],
            )
            new = potential(moved)  # once, because it takes long to compile
            taken = jnp.log(jax.random.uniform(key_accept)) < state[1] - new + log_ratio
            return _where(taken, (moved, new), state), None

        state, _ = jax.lax.scan(
            step, (start, jnp.array(jnp.inf)), (kinds, jax.random.split(key_moves, kinds.size))
        )
        return flat(state[0])

    def at(self, key: jax.Array, sun: jax.Array, obs: jax.Array) -> Place:
        """The moves for directions to Sun and observer (T, 3), with random axes of the cells."""
        return Place(self, self._sky(key, sun, obs), sun, obs)

    def columns(self, sun: jax.Array, obs: jax.Array, normal: jax.Array) -> jax.Array:
        """Brightness (..., T) of facets of unit area, over the errors."""
        return self.scale * diffuse_kernel(self.law, normal @ sun.T, normal @ obs.T, LAMBERT_C)[0]

    def _sky(self, key: jax.Array, sun: jax.Array, obs: jax.Array) -> Sky:
        axes = jax.random.orthogonal(key, 3)
        nothing = jnp.zeros(())
        empty = Sky(axes, nothing, nothing, nothing, nothing, log_seen=nothing)
        normal = empty.normal(jnp.arange(BANDS * SECTORS), jnp.array(0.5), jnp.array(0.5))
        best = jnp.max(jnp.minimum(normal @ sun.T, normal @ obs.T), axis=1)
        log_seen = -((jnp.minimum(best, 0.0) / SOFTNESS) ** 2)
        column = self.columns(sun, obs, normal).astype(jnp.float32)
        flux, zero = (column @ x.T.astype(jnp.float32) for x in (self.flux, self.zero))
        return Sky(axes, column, jnp.sum(column**2, axis=1), flux, zero.T, log_seen)

    def range(self, square: jax.Array, along: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Lower end and width of the range of ln(area) given products of a column."""
        information = jnp.maximum(square, 0.0) + 1e-30
        best, sd = along / information, jax.lax.rsqrt(information)
        least = np.exp(self.log_area_mean - PRIOR_REACH * self.log_area_sd)
        most = np.exp(self.log_area_mean + PRIOR_REACH * self.log_area_sd)
        low = jnp.log(jnp.clip(best - REACH * sd, least, 0.5 * most))
        high = jnp.log(jnp.clip(best + REACH * sd, 1.05 * jnp.exp(low), most))
        return low, high - low

    def log_density(self, x: jax.Array, square: jax.Array, along: jax.Array) -> jax.Array:
        """ln of the density of x = ln α: the prior times exp(b α − a α²/2)."""
        area = jnp.exp(x)
        prior = -0.5 * ((x - self.log_area_mean) / self.log_area_sd) ** 2
        return area * (along - 0.5 * square * area) + prior


@dataclass(frozen=True)
class Place:
    """The moves for one motion of the body.

    Attributes
    ----------
    moves : FacetMoves
    sky : Sky
    sun, obs : (T, 3), body axes
    """

    moves: FacetMoves
    sky: Sky
    sun: jax.Array
    obs: jax.Array

    def facets(self, normal: jax.Array, log_area: jax.Array) -> Facets:
        """Facets of given normals (..., 3) and ln(area) (...)."""
        column = self.moves.columns(self.sun, self.obs, normal)
        column = jax.lax.optimization_barrier(column)  # else it is computed for every cell
        product = jnp.einsum("ct,...t->...c", self.sky.column, column.astype(jnp.float32))
        return Facets(normal, log_area, column, product)

    def conditional(self, facets: Facets, i: jax.Array, part: jax.Array) -> Conditional:
        """Density of facet i, and of the areas of a ``part`` (N,) of the others, given the rest."""
        moves, sky = self.moves, self.sky
        area = jnp.exp(facets.log_area)
        fixed = jnp.where(part | (jnp.arange(len(part)) == i), 0.0, area)
        rest = moves.flux - fixed @ facets.column
        columns = jnp.concatenate([moves.zero, jnp.where(part[:, None], facets.column, 0.0)])
        products = jnp.concatenate([sky.zero, jnp.where(part[:, None], facets.product, 0.0)])
        precision = jnp.concatenate([jnp.ones(len(moves.zero)), 1.0 - part]) + TINY  # of the prior
        root = jnp.linalg.cholesky(columns @ columns.T + jnp.diag(precision))
        target = solve_triangular(root, columns @ rest, lower=True)
        inverse = solve_triangular(root, jnp.eye(len(root)), lower=True).astype(jnp.float32)
        across = inverse @ products
        square = sky.square - jnp.sum(across**2, axis=0)
        along = sky.flux - fixed.astype(jnp.float32) @ facets.product
        along -= target.astype(jnp.float32) @ across
        low, width = moves.range(square, along)
        x = low + (jnp.arange(NODES, dtype=jnp.float32)[:, None] + 0.5) * width / NODES
        log_density = moves.log_density(x, square, along)
        log_cell = jax.nn.logsumexp(log_density, axis=0) + jnp.log(width)
        log_cell = log_cell.astype(float) + sky.log_seen
        log_cell -= jax.nn.logsumexp(log_cell)
        return Conditional(part, columns, rest, root, target, log_cell)

    def areas(self, given: Conditional, column: jax.Array) -> tuple[jax.Array, ...]:
        """Density of ln(area) of a facet with a column (T,): low end, width of a bin, ln of the
        density in each bin; and the column's products with those of the other areas."""
        across = solve_triangular(given.root, given.columns @ column, lower=True)
        square = column @ column - across @ across
        along = column @ given.rest - across @ given.target
        low, width = self.moves.range(square, along)
        width = width / BINS
        x = low + (jnp.arange(BINS) + 0.5) * width
        log_density = self.moves.log_density(x, square, along)
        return low, width, log_density - jax.nn.logsumexp(log_density) - jnp.log(width), across

    def drawn(self, key: jax.Array, given: Conditional, i: jax.Array, facets: Facets) -> Facets:
        """The facets with facet i and the areas of the part drawn anew."""
        key_band, key_sector, key_place, key_bin, key_in, key_rest = jax.random.split(key, 6)
        log_cell = given.log_cell.reshape(BANDS, SECTORS)
        band = jax.random.categorical(key_band, jax.nn.logsumexp(log_cell, axis=1))
        cell = band * SECTORS + jax.random.categorical(key_sector, log_cell[band])
        one = self.facets(
            self.sky.normal(cell, *jax.random.uniform(key_place, (2,))), jnp.zeros(())
        )
        low, width, log_density, across = self.areas(given, one.column)
        place = jax.random.categorical(key_bin, log_density) + jax.random.uniform(key_in)
        log_area = low + place * width
        shift = given.target - jnp.exp(log_area) * across
        shift += jax.random.normal(key_rest, shift.shape)
        others = solve_triangular(given.root, shift, lower=True, trans=1)[-len(given.part) :]
        # Areas below zero have no logarithm, so that such a draw is refused.
        logs = jnp.where(given.part, jnp.log(others), facets.log_area)
        return facets._replace(log_area=logs).replaced(i, one._replace(log_area=log_area))

    def log_q(self, given: Conditional, i: jax.Array, facets: Facets) -> jax.Array:
        """ln of the density with which `drawn` gives these facets, to a constant."""
        low, width, log_density, across = self.areas(given, facets.column[i])
        place = (facets.log_area[i] - low) / width
        bin_ = jnp.clip(jnp.floor(place), 0, BINS - 1).astype(int)
        inside = (place >= 0.0) & (place <= BINS)
        log_q = jnp.where(inside, log_density[bin_], -jnp.inf)
        log_q += given.log_cell[self.sky.cell(facets.normal[i])]
        # The areas are the last coefficients: the last block of the root is that of their marginal.
        first = len(self.moves.zero)
        shift = given.target - jnp.exp(facets.log_area[i]) * across
        mean = solve_triangular(given.root, shift, lower=True, trans=1)[first:]
        away = jnp.where(given.part, jnp.exp(facets.log_area) - mean, 0.0)
        log_q -= 0.5 * jnp.sum((given.root[first:, first:].T @ away) ** 2)
        return log_q + jnp.sum(jnp.where(given.part, facets.log_area, 0.0))

    def unchanged(self, _: jax.Array, facets: Facets) -> _Proposal:
        """The facets as they are, so that the first step of a sweep finds their potential."""
        return facets, jnp.zeros(())

    def relocated(self, key: jax.Array, facets: Facets) -> _Proposal:
        """A facet drawn anew, with the areas of a random part of the others."""
        key_which, key_share, key_part, key_draw = jax.random.split(key, 4)
        number = len(facets.log_area)
        i = jax.random.categorical(key_which, facets.log_weakness)
        share = jax.random.choice(key_share, jnp.array(SHARES))
        part = jax.random.bernoulli(key_part, share, (number,)) & (jnp.arange(number) != i)
        given = self.conditional(facets, i, part)
        moved = self.drawn(key_draw, given, i, facets)
        log_ratio = self.log_q(given, i, facets) - self.log_q(given, i, moved)
        return moved, log_ratio + moved.log_weakness[i] - facets.log_weakness[i]

    def rearranged(self, key: jax.Array, facets: Facets) -> _Proposal:
        """Two facets merged and one drawn anew, or one facet split and another given up.

        A facet of area α and normal n becomes facets of areas uα and (1 − u)α at angles (1 − u)θ
        and uθ from n on opposite sides; u is uniform and the displacement θ has a normal density of
        one of `facet_pairs.WIDTHS`.
        """
        key_pair, key_which, key_split, key_draw = jax.random.split(key, 4)
        number = len(facets.log_area)
        merging = jax.random.bernoulli(key_which)
        log_pair = jnp.where(merging, facets.log_close, facets.log_weak_pair)
        i, j = jnp.divmod(jax.random.categorical(key_pair, log_pair.ravel()), number)
        both = jnp.stack([i, j])
        pair = facets.normal[both], facets.log_area[both]
        one, u, angle = facet_pairs.merged(*pair)
        parts, u_split, angle_split = facet_pairs.drawn_split(key_split, pair[0][1], pair[1][1])
        host = _where(merging, one, (pair[0][1], pair[1][1]))  # facet j while i is elsewhere
        u, angle = _where(merging, (u, angle), (u_split, angle_split))

        hosted = facets.replaced(j, self.facets(*host))
        given = self.conditional(hosted, i, jnp.zeros(number, bool))
        merged = self.drawn(key_draw, given, i, hosted)
        moved = _where(merging, merged, facets.replaced(both, self.facets(*parts)))
        # The facet elsewhere is drawn by a merger, and given up by a split.
        log_q = self.log_q(given, i, _where(merging, merged, facets)) - np.log(CELL)
        log_split = facet_pairs.log_split(u, angle)
        log_ratio = jnp.where(merging, log_split - log_q, log_q - log_split)
        log_back = jnp.where(merging, moved.log_weak_pair, moved.log_close)
        return moved, log_ratio + log_back[i, j] - log_pair[i, j]

    def exchanged(self, key: jax.Array, facets: Facets) -> _Proposal:
        """Two facets with another share u of their area in the first.

        The sum of their areas, its centre and the second moment m = u(1 − u)θ² about it remain, so
        that the brightness hardly changes. The volume of `log_split` is sin θ/[2θ u²(1 − u)²]
        dm dψ du dΩ dln α, and u is uniform.
        """
        key_pair, key_share = jax.random.split(key)
        i, j = jnp.divmod(
            jax.random.categorical(key_pair, facets.log_close.ravel()), len(facets.log_area)
        )
        both = jnp.stack([i, j])
        pair = facets.normal[both], facets.log_area[both]
        centre, along, u, angle = facet_pairs.between(*pair)
        new = jax.random.uniform(key_share, minval=1e-9, maxval=1.0 - 1e-9)
        wider = jnp.sqrt(u * (1.0 - u) / (new * (1.0 - new))) * angle
        parts = facet_pairs.divided(centre, along, jnp.logaddexp(*pair[1]), new, wider)
        moved = facets.replaced(both, self.facets(*parts))
        log_ratio = facet_pairs.log_exchange(new, wider) - facet_pairs.log_exchange(u, angle)
        return moved, log_ratio + moved.log_close[i, j] - facets.log_close[i, j]

    def rescaled(self, key: jax.Array, facets: Facets) -> _Proposal:
        """All areas multiplied by one factor, whose logarithm has a normal density."""
        key_sd, key_factor = jax.random.split(key)
        sd = jax.random.choice(key_sd, jnp.array(FACTORS))
        log_factor = sd * jax.random.normal(key_factor)
        return facets._replace(log_area=facets.log_area + log_factor), jnp.zeros(())


def _where(condition: jax.Array, yes, no):
    return jax.tree.map(partial(jnp.where, condition), yes, no)
