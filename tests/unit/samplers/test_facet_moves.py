"""Moves of facets leave the posterior unchanged: bodies from the prior stay a sample of the prior.

If a body is drawn from the prior, its light curve from the body, and the body is then moved by a
kernel that leaves the posterior of that light curve invariant, the result is a draw of the prior
(Geweke 2004, JASA 99, 799). Priors and light curves are written here in NumPy.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import ks_1samp, ks_2samp, norm, uniform

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.samplers import facet_moves, facet_pairs
from tests.helpers.false_alarms import EACH
from tests.helpers.turning_facets import cosines, flux, in_body_axes, unit

N_FACETS, N_EPOCHS, N_BODIES, SWEEPS = 3, 24, 1200, 2
ERROR = 0.02  # m², so small that the table of one facet is a coarse one
FALSE_ALARM = 1e-3  # of the whole test, shared by its statistics


def bodies(rng, number, sun, obs):
    """Facets uniform in direction with log-normal areas, each lit and seen at some epoch."""
    normals, areas = [], []
    while len(areas) < number:
        n = unit(rng.standard_normal((N_FACETS, 3)))
        if np.all(np.max(np.minimum(sun @ n.T, obs @ n.T), axis=0) > 0.0):
            normals.append(n)
            areas.append(np.exp(rng.standard_normal(N_FACETS)))
    return np.array(normals), np.array(areas)


def statistics(normals, areas):
    """Scalars of each body that do not depend on the order of its facets."""
    order = np.argsort(areas, axis=1)
    first, last = order[:, -1], order[:, 0]
    rows = np.arange(len(areas))
    angles = np.einsum("bik,bjk->bij", normals, normals)
    pairs = angles[:, *np.triu_indices(N_FACETS, 1)]
    return {
        "largest area": areas[rows, first],
        "smallest area": areas[rows, last],
        "sum of ln area": np.log(areas).sum(axis=1),
        "x of the largest": normals[rows, first, 0],
        "z of the largest": normals[rows, first, 2],
        "x of the smallest": normals[rows, last, 0],
        "closest pair": pairs.max(axis=1),
        "widest pair": pairs.min(axis=1),
    }


@pytest.fixture(scope="module")
def campaign():
    """Geometry of a turning body whose Sun and observer move a little."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 100.0, N_EPOCHS)
    sun = unit(np.array([1.0, 0.0, 0.2]) + 0.05 * rng.standard_normal((N_EPOCHS, 3)))
    obs = unit(np.array([0.4, 0.8, -0.3]) + 0.05 * rng.standard_normal((N_EPOCHS, 3)))
    omega = np.array([0.02, 0.05, 0.04])
    return t, sun, obs, omega


def moved(campaign, normals, areas, seed):
    """The bodies after the moves, each given its own simulated light curve."""
    t, sun, obs, omega = campaign
    s, o = in_body_axes(sun, t, omega), in_body_axes(obs, t, omega)
    rng = np.random.default_rng(seed)
    y = flux(*cosines(s, o, normals), areas)
    y += ERROR * rng.standard_normal(y.shape)
    error = np.full(N_EPOCHS, ERROR)
    curve = LightCurve(t=t, brightness=y[0], error=error, kind="flux", sun=sun, obs=obs)
    data = Epochs.of(curve)
    entry = registry.find("faceted")
    options = {"n_facets": N_FACETS, "omega_sd": 1.0, "reflectance": "lambertian"}
    _, problem = build_problem(entry, options, data)
    hook = entry.hook("moves")
    assert hook is not None
    moves = hook(problem, data, **options)

    def one(row):
        key, base, log_area, y = row
        here = replace(data, brightness=y)
        z = problem.ravel(
            {"omega_unit": jnp.asarray(omega), "normals_base": base, "log_albedo_area": log_area}
        )
        for k in jax.random.split(key, SWEEPS):
            z = replace(moves, flux=y * moves.scale)(k, z, here)
        free = problem.unravel(z)
        return free["normals_base"], free["log_albedo_area"]

    keys = jax.random.split(jax.random.key(seed), len(areas))
    rows = (keys, jnp.asarray(normals), jnp.log(areas), jnp.asarray(y))
    base, log_area = jax.jit(lambda rows: jax.lax.map(one, rows))(rows)
    return unit(np.asarray(base)), np.exp(np.asarray(log_area))


def test_bodies_of_the_prior_remain_a_sample_of_the_prior(campaign):
    t, sun, obs, omega = campaign
    s, o = in_body_axes(sun, t, omega), in_body_axes(obs, t, omega)
    rng = np.random.default_rng(1)
    start, reference = bodies(rng, N_BODIES, s, o), bodies(rng, 10 * N_BODIES, s, o)
    after = moved(campaign, *start, seed=2)
    distance = np.abs(after[0] - start[0]).max(axis=(1, 2))
    assert np.mean(distance > 1e-9) > 0.5  # most bodies have changed
    found, expected = statistics(*after), statistics(*reference)
    p = {name: np.asarray(ks_2samp(found[name], expected[name]))[1] for name in found}
    assert min(p.values()) > FALSE_ALARM / len(p), p


@pytest.mark.parametrize(
    "coordinate",
    [pytest.param("area of the facet", marks=pytest.mark.slow), "area of another facet"],
)
def test_areas_are_drawn_with_the_stated_density(campaign, coordinate):
    """The cumulative distribution of `log_q` along ln(area), at what `drawn` gives, is uniform."""
    t, sun, obs, omega = campaign
    s, o = (jnp.asarray(in_body_axes(v, t, omega)) for v in (sun, obs))
    rng = np.random.default_rng(5)
    normals, areas = bodies(rng, 1, np.asarray(s), np.asarray(o))
    error = 0.1 * areas[0].min()  # the areas are uncertain by their own size
    nothing: Any = None  # areas are drawn without the posterior
    moves = facet_moves.FacetMoves(
        flux=jnp.asarray(rng.normal(0.1, 1.0, N_EPOCHS)),
        scale=jnp.full(N_EPOCHS, 1.0 / error),
        zero=jnp.asarray(rng.normal(0.0, 0.3, (2, N_EPOCHS))),
        problem=nothing,
        law="lambertian",
    )
    place = moves.at(jax.random.key(6), s, o)
    facets = place.facets(jnp.asarray(normals[0]), jnp.log(areas[0]))
    moves = replace(moves, flux=moves.flux + areas[0] @ facets.column)
    place = replace(place, moves=moves, sky=moves._sky(jax.random.key(6), s, o))
    i, part = jnp.array(0), jnp.array([False, True, True])
    given = place.conditional(facets, i, part)
    along = 0 if coordinate == "area of the facet" else 1
    grid = jnp.linspace(-9.0, 6.0, 2001)

    def cumulative(key):
        drawn = place.drawn(key, given, i, facets)
        log_area = drawn.log_area[along]

        def log_q(x):
            moved = drawn._replace(log_area=drawn.log_area.at[along].set(x))
            return place.log_q(given, i, moved)

        density = jnp.exp(jax.vmap(log_q)(grid) - log_q(log_area))
        return jnp.sum(jnp.where(grid < log_area, density, 0.0)) / jnp.sum(density)

    keys = jax.random.split(jax.random.key(7), 20_000)
    share = np.asarray(jax.jit(lambda keys: jax.lax.map(cumulative, keys, batch_size=100))(keys))
    share = share[np.isfinite(share)]  # areas below zero have no logarithm
    assert len(share) > 10_000
    assert np.asarray(ks_1samp(share, uniform.cdf))[1] > FALSE_ALARM / 2


def pairs_of_facets(number):
    """Facets with the random numbers of a split, and the two facets that they become."""
    rng = np.random.default_rng(3)
    normals, log_areas = unit(rng.standard_normal((number, 3))), rng.standard_normal(number)
    keys = jax.random.split(jax.random.key(4), number)
    return normals, log_areas, keys


def test_a_merger_undoes_a_split():
    for normal, log_area, key in zip(*pairs_of_facets(20), strict=True):
        parts, u, angle = facet_pairs.drawn_split(key, jnp.asarray(normal), jnp.asarray(log_area))
        areas = np.exp(np.asarray(parts[1]))
        np.testing.assert_allclose(areas, np.exp(log_area) * np.array([u, 1.0 - u]), rtol=1e-12)
        cosine = np.clip(parts[0][0] @ parts[0][1], -1.0, 1.0)
        assert np.arccos(cosine) == pytest.approx(float(angle), abs=1e-6)
        one, share, between = facet_pairs.merged(*parts)
        np.testing.assert_allclose(one[0], normal, atol=1e-7)
        assert float(one[1]) == pytest.approx(log_area, abs=1e-12)
        assert (float(share), float(between)) == pytest.approx((float(u), float(angle)), abs=1e-7)


def test_an_exchange_keeps_the_sum_its_centre_and_its_second_moment():
    """At half the angle, moments of up to the second order change an eighth as much."""
    rng = np.random.default_rng(8)
    direction, apart = np.array([0.3, 0.5, 0.8]), rng.standard_normal((2, 3))
    areas, new = np.array([0.7, 2.0]), 0.6
    at = unit(rng.standard_normal((50, 3)))

    def changes(size):
        normals = unit(direction + size * apart)
        centre, along, u, angle = facet_pairs.between(jnp.asarray(normals), jnp.log(areas))
        wider = np.sqrt(u * (1.0 - u) / (new * (1.0 - new))) * angle
        log_area = jnp.log(areas.sum())
        after, log_areas = facet_pairs.divided(centre, along, log_area, jnp.array(new), wider)
        pairs = (np.asarray(after), np.exp(np.asarray(log_areas))), (normals, areas)
        assert np.abs(pairs[0][0] - normals).max() > 0.1 * size
        moments = [[(at @ n.T) ** k @ a for n, a in pairs] for k in range(3)]
        return [np.linalg.norm(new - old) for new, old in moments]

    whole, half = changes(0.02), changes(0.01)
    assert max(whole[0], half[0]) < 1e-12
    assert whole[1] > 6.0 * half[1]
    assert whole[2] > 6.0 * half[2]


def test_the_density_of_a_split_is_normalised_on_the_plane():
    angle = np.linspace(1e-6, np.pi - 1e-9, 20_001)
    density = np.exp(np.asarray(jax.vmap(facet_pairs.log_angle)(jnp.asarray(angle))))
    beyond = np.mean(np.exp(-0.5 * (np.pi / facet_pairs.WIDTHS) ** 2))
    total = np.trapezoid(2.0 * np.pi * density, angle)
    assert total == pytest.approx(1.0 - beyond, abs=1e-4)


def two_facets(x):
    """Longitude and sine of the latitude of two facets, and ln of their areas, (6,)."""
    lon, sine, log_area, u, angle, turn = x
    cosine = np.sqrt(1.0 - sine**2)
    n = np.array([cosine * np.cos(lon), cosine * np.sin(lon), sine])
    east = np.array([-np.sin(lon), np.cos(lon), 0.0])
    along = np.cos(turn) * east + np.sin(turn) * np.cross(n, east)
    i = np.cos((1.0 - u) * angle) * n + np.sin((1.0 - u) * angle) * along
    j = np.cos(u * angle) * n - np.sin(u * angle) * along
    merged, share, between = facet_pairs.merged(
        jnp.asarray(np.stack([i, j])), jnp.log(jnp.array([u, 1.0 - u])) + log_area
    )
    np.testing.assert_allclose(merged[0], n, atol=1e-9)
    np.testing.assert_allclose([share, between], [u, angle], atol=1e-9)
    angles = [f(v) for v in (i, j) for f in (lambda v: np.arctan2(v[1], v[0]), lambda v: v[2])]
    return np.array([*angles, log_area + np.log(u), log_area + np.log(1.0 - u)])


def volume(function, x, step=1e-5):
    """Determinant of the derivatives by central differences."""
    columns = [(function(x + e) - function(x - e)) / (2 * step) for e in step * np.eye(x.size)]
    return abs(np.linalg.det(np.stack(columns, axis=1)))


def test_the_volume_of_a_split_is_that_of_finite_differences():
    """dΩᵢ dΩⱼ dln αᵢ dln αⱼ = sin θ/(u(1 − u)) dθ dψ du dΩ dln α, with u, θ and the facet moved."""
    x = np.array([0.4, 0.3, -0.2, 0.35, 0.5, 1.1])
    u, angle = x[3], x[4]
    assert volume(two_facets, x) == pytest.approx(np.sin(angle) / (u * (1.0 - u)), rel=1e-6)


def test_the_volume_of_an_exchange_is_that_of_finite_differences():
    """The same with the second moment m = u(1 − u)θ² in place of θ."""

    def at_moment(x):
        lon, sine, log_area, u, m, turn = x
        return two_facets([lon, sine, log_area, u, np.sqrt(m / (u * (1.0 - u))), turn])

    values = []
    for u, m in ((0.35, 0.05), (0.7, 0.05), (0.1, 0.2)):
        angle = np.sqrt(m / (u * (1.0 - u)))
        found = volume(at_moment, np.array([0.4, 0.3, -0.2, u, m, 1.1]), 1e-6)
        values.append(np.log(found) - float(facet_pairs.log_exchange(jnp.array(u), angle)))
    np.testing.assert_allclose(values, -np.log(2.0), atol=1e-6)  # the constant that is left out


def test_pairs_too_wide_to_be_merged_again_are_not_reached():
    assert facet_pairs.log_exchange(jnp.array(0.01), jnp.array(3.2)) == -np.inf


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("kind", ["exchanged", "rescaled"])
def test_moves_without_the_light_curve_keep_a_sample_of_bodies(campaign, kind):
    """With the prior as the density: uniform normals and normal ln(areas)."""
    t, sun, obs, omega = campaign
    s, o = (jnp.asarray(in_body_axes(v, t, omega))[:2] for v in (sun, obs))
    nothing: Any = None
    ones, zero = jnp.ones(2), jnp.zeros((0, 2))
    moves = facet_moves.FacetMoves(ones, ones, zero, problem=nothing, law="lambertian")
    place = moves.at(jax.random.key(0), s, o)
    number = 40_000

    def after(row):
        key, normals, log_area = row
        for key_move in jax.random.split(key, 3):
            facets = place.facets(normals, log_area)
            key_one, key_accept = jax.random.split(key_move)
            moved, log_ratio = getattr(place, kind)(key_one, facets)
            log_ratio += 0.5 * (jnp.sum(log_area**2) - jnp.sum(moved.log_area**2))
            taken = jnp.log(jax.random.uniform(key_accept)) < log_ratio
            normals = jnp.where(taken, moved.normal, normals)
            log_area = jnp.where(taken, moved.log_area, log_area)
        return normals, log_area

    rng = np.random.default_rng(9)
    normals = unit(rng.standard_normal((number, 3, 3)))
    log_areas = rng.standard_normal((number, 3))
    rows = (jax.random.split(jax.random.key(1), number), normals, log_areas)
    moved, moved_areas = jax.jit(lambda rows: jax.lax.map(after, rows, batch_size=200))(rows)
    assert np.mean(np.asarray(moved_areas) != log_areas) > 0.3
    p = []
    for k in range(3):
        p.append(ks_1samp(np.asarray(moved_areas)[:, k], norm.cdf)[1])
        cosine = np.sum(np.asarray(moved)[:, k] * np.asarray(moved)[:, k - 1], axis=1)
        p.append(ks_1samp(cosine, uniform(-1.0, 2.0).cdf)[1])
    assert min(p) > EACH / len(p)
