"""Facets of a satellite of known attitude, as they are observed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpyro import handlers
from scipy import integrate, stats

from lcbayes.core.constants import EARTH_RADIUS_KM
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.modelling import likelihood, registry
from lcbayes.modelling.ephemeris import frames
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.facet_list import Facet, facet_list
from lcbayes.modelling.problem import Problem
from lcbayes.physics import photometry
from lcbayes.physics.attitude import catalogue, rotations
from lcbayes.physics.bodies.facets import across
from lcbayes.physics.earthshine import glow
from tests.helpers.false_alarms import EACH, limit, squares

N = 40


def sky(n: int = N, seed: int = 0, velocity: bool = True) -> LightCurve:
    """A satellite at 550 km over places from which it is seen at dusk, V magnitudes, no errors."""
    rng = np.random.default_rng(seed)
    unit = lambda v: v / np.linalg.norm(v, axis=-1, keepdims=True)  # noqa: E731
    site = unit(np.array([0.1, 0.95, 0.3]) + 0.1 * rng.standard_normal((n, 3)))
    up = unit(site + 0.06 * rng.standard_normal((n, 3)))
    position = (EARTH_RADIUS_KM + 550.0) * up
    line = EARTH_RADIUS_KM * site - position
    return LightCurve(
        t=np.linspace(0.0, 300.0, n),
        brightness=np.full(n, 6.0),
        error=None,
        kind="mag",
        sun=np.tile(unit(np.array([1.0, -0.45, 0.0])), (n, 1)),
        obs=unit(line),
        range_km=np.linalg.norm(line, axis=1),
        position_km=position,
        velocity_km_s=7.6 * unit(np.cross(up, [0.3, 0.2, 1.0])) if velocity else None,
        band=np.full(n, "V"),
        frame="icrs",
    )


def traced(curve: LightCurve, **options):
    """Values of every site at a draw from the prior."""
    entry = registry.find("stabilised")
    model = handlers.seed(entry.bind(entry.check(options)), 1)
    trace = handlers.trace(model).get_trace(Epochs.of(curve))
    return {k: v["value"] for k, v in trace.items()}


def lambert(sun, obs, normal, area):
    return area / np.pi * np.maximum(sun @ normal, 0.0) * np.maximum(obs @ normal, 0.0)


def test_a_list_of_facets():
    assert facet_list("+z, array:-X~5@22.7 , 0 3 4@1e1") == [
        Facet("", (0.0, 0.0, 1.0)),
        Facet("array", (-1.0, 0.0, 0.0), 5.0, 22.7),
        Facet("", (0.0, 0.6, 0.8), 0.0, 10.0),
    ]
    assert facet_list("") == []
    assert facet_list("sun-pointing:+x")[0].where == "sun-pointing"
    for normal in ((0.0, 0.0, 1.0), (0.6, 0.0, -0.8)):
        basis = np.array([normal, *across(normal)])
        np.testing.assert_allclose(basis @ basis.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("up", "'up' is none"),
        ("+z;+x", "is none"),
        ("+z~90", "give 0 to 60"),
        ("0 0 0", "points nowhere"),
        ("+z@0", "give one > 0"),
        ("+z~-1", "give 0 to 60"),
    ],
)
def test_lists_that_are_none(text, says):
    with pytest.raises(InputError, match=says) as fault:
        facet_list(text)
    assert "\n" not in str(fault.value)


def test_flux_is_the_sum_over_the_frames_of_its_facets():
    """Body, array and another law at once, by hand; the magnitude follows from range and band."""
    curve = sky()
    result = traced(
        curve,
        law="nadir-sun-array",
        reflectance="lambertian",
        facets="+z@3.0, array:+x@11, sun-pointing:+x@2",
        scatter=0.3,
    )
    made = frames(catalogue.find("nadir-sun-array"), curve)
    pointer = frames(catalogue.find("sun-pointing"), curve).body
    want = np.zeros(N)
    assert made.array is not None
    seen = (
        (made.body, [0, 0, 1.0], 3.0),
        (made.array, [1.0, 0, 0], 11.0),
        (pointer, [1.0, 0, 0], 2.0),
    )
    for (axes, normal, area), albedo in zip(seen, result["r_diff"], strict=True):
        sun, obs = (np.einsum("tji,tj->ti", axes, v) for v in (curve.sun, curve.obs))
        want += albedo * lambert(sun, obs, np.array(normal), area)
    assert np.all(want > 0)
    light = np.asarray(Epochs.of(curve).sunlight)
    np.testing.assert_allclose(result["flux"], want * light, rtol=1e-10)
    assert curve.range_km is not None
    m = photometry.magnitude(
        jnp.asarray(want * light), jnp.asarray(1e3 * curve.range_km), photometry.sun_magnitude("V")
    )
    np.testing.assert_allclose(result["expected"], m, atol=1e-6)


@pytest.mark.statistical(false_alarm=EACH)
def test_unlisted_facets_point_anywhere_and_partly_known_ones_about_where_they_are_said():
    data = Epochs.of(sky(8))
    options = {"facets": "+z@1, +x~5", "n_facets": 3, "reflectance": "lambertian"}
    problem = Problem(registry.find("stabilised").bind(options), data)

    @jax.jit
    def drawn(keys):
        draw = lambda key: problem.constrain(problem.prior_draw(key, data), data)  # noqa: E731
        return jax.lax.map(lambda key: {k: draw(key)[k] for k in ("normals", "area")}, keys)

    result = drawn(jax.random.split(jax.random.key(0), 200))
    normals = np.asarray(result["normals"])
    np.testing.assert_array_equal(normals[:, 0], [[0.0, 0.0, 1.0]] * 200)
    tilt = np.degrees(np.arctan2(normals[:, 1, 1:], normals[:, 1, :1]))
    low, high = squares(400, 4)  # and three means of directions, of variance 1/3
    assert low < np.sum((tilt / 5.0) ** 2) < high
    assert np.abs(normals[:, 2].mean(axis=0)).max() < limit(4) / np.sqrt(3 * 200)
    np.testing.assert_allclose(result["area"][:, 0], 1.0)


def test_surfaces_are_shared_or_separate():
    shared = traced(sky(8), n_facets=3, surface="shared")
    assert shared["r_diff"].shape == (1,)
    separate = traced(sky(8), n_facets=3, facets="+z", surface="separate")
    assert (separate["r_sum_held"].shape, separate["r_sum_free"].shape) == ((1,), (2,))
    assert separate["r_diff"].shape == (3,)


def test_areas_that_are_given_are_kept():
    result = traced(sky(8), n_facets=3, facets="+x@2.5, +z", surface="separate")
    assert result["area"][0] == pytest.approx(2.5, rel=1e-12)
    total = result["r_diff"] + result["r_spec"]
    np.testing.assert_allclose(result["albedo_area"], result["area"] * total, rtol=1e-12)


@pytest.mark.parametrize(
    ("reflectance", "name", "unit"),
    [("lambertian", "r_diff", 1.0), ("lommel-seeliger-lambert", "w", 4 * np.pi)],
)
def test_given_areas_of_diffuse_facets_leave_their_albedo_open(reflectance, name, unit):
    """A white facet of 2.5 m² was fitted whatever its albedo; with `w` one of 4 pi times white."""
    result = traced(sky(8), n_facets=3, facets="+x@2.5, +z", reflectance=reflectance)
    assert np.all((result[name] > 0) & (result[name] < 1))
    assert result["area"][0] == pytest.approx(2.5, rel=1e-12)
    np.testing.assert_allclose(
        result["albedo_area"], result["area"] * result[name] / unit, rtol=1e-12
    )
    unsaid = traced(sky(8), n_facets=3, facets="+x, +z", reflectance=reflectance)
    assert name not in unsaid
    np.testing.assert_allclose(unsaid["albedo_area"], unsaid["area"], rtol=1e-12)


def test_more_facets_listed_than_there_are_is_a_fault():
    with pytest.raises(InputError, match="n_facets is 2, but 3 facets are listed"):
        traced(sky(8), n_facets=2, facets="+x, +z, -y")


@pytest.mark.parametrize(
    ("curve", "options", "says"),
    [
        (sky(8, velocity=False), {"law": "lvlh"}, "no velocity; read it with --tle"),
        (replace(sky(8), position_km=None, velocity_km_s=None), {}, "needs the satellite's orbit"),
        (sky(8), {"facets": "array:+x"}, "has none"),
        (sky(8), {"law": "upside-down"}, "unknown attitude law"),
        (sky(8), {"facets": "+w"}, "is none"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(curve, options, says):
    if "array" in options.get("facets", ""):
        options = {**options, "law": "lvlh"}
    with pytest.raises(InputError, match=says) as fault:
        traced(curve, **options)
    assert "\n" not in str(fault.value)


def test_places_alone_do_for_laws_that_need_no_velocity():
    assert np.isfinite(traced(sky(8, velocity=False), law="yaw-steering")["expected"]).all()


def test_earthshine_adds_what_the_ground_sends():
    """On one Lambertian facet at nadir: Σ over the ground's directions of strength times flux."""
    curve = sky(6)
    options: dict = {"law": "lvlh", "reflectance": "lambertian", "facets": "+z@2"}
    dark, lit = traced(curve, **options), traced(curve, **options, earth_albedo=0.4)
    assert curve.position_km is not None
    light = glow(jnp.asarray(curve.position_km / EARTH_RADIUS_KM), jnp.asarray(curve.sun), 0.4)
    nadir = -curve.position_km / np.linalg.norm(curve.position_km, axis=1, keepdims=True)
    seen = 2.0 * lit["r_diff"] / np.pi * np.sum(curve.obs * nadir, axis=1)
    want = seen * np.sum(light.strength * np.einsum("qtk,tk->qt", light.toward, nadir), axis=0)
    np.testing.assert_allclose(lit["flux"] - dark["flux"], want, rtol=1e-9)


def several(n_each: int = 4) -> LightCurve:
    n = 3 * n_each
    return replace(
        sky(n),
        curve=np.repeat(np.arange(3), n_each),
        curve_names=("a", "b", "c"),
        free_scale=np.zeros(3, bool),
        site=np.array(["north", "south"] * (n // 2)),
    )


def test_members_and_sites_are_known_again_at_other_epochs():
    fitted = several()
    wanted = replace(several(), curve_names=("c", "new", "a"), site=np.array(["south", "west"] * 6))
    data = Epochs.of(wanted, fitted)
    assert data.member.tolist() == [2] * 4 + [3] * 4 + [0] * 4
    assert data.site.tolist() == [1, 2] * 6
    assert (data.n_members, data.n_sites) == (3, 2)


def test_members_and_sites_shift_magnitudes():
    result = traced(several(), reflectance="lambertian", facets="+z@3,+x@5")
    alone = traced(
        several(),
        reflectance="lambertian",
        facets="+z@3,+x@5",
        individuals=False,
        site_offsets=False,
    )
    data = Epochs.of(several())
    shift = result["member_offset"][data.member] + result["site_offset"][data.site]
    assert result["member_unit"].shape == (4,)  # and one for a member not seen yet
    np.testing.assert_allclose(result["expected"] - alone["expected"], shift, atol=1e-6)


def test_extinction_is_linear_in_airmass():
    result = traced(sky(), extinction=True, facets="+z@3,+x@5", reflectance="lambertian")
    plain = traced(sky(), facets="+z@3,+x@5", reflectance="lambertian")
    air = np.asarray(Epochs.of(sky()).airmass)
    assert air.min() >= 1.0 - 1e-3
    fainter = result["expected"] - plain["expected"]
    np.testing.assert_allclose(fainter, result["extinction"] * air, atol=1e-6)


@pytest.mark.statistical(false_alarm=EACH)
def test_the_mixture_is_a_density_whose_outliers_are_bayes():
    law = likelihood.Contaminated(1.0, 0.5, 0.1, 6.0)
    total = integrate.quad(lambda y: float(jnp.exp(law.log_prob(y))), -20, 20, points=[1.0])[0]
    assert total == pytest.approx(1.0, abs=1e-8)
    near = 0.9 * stats.norm.pdf(3.0, 1.0, 0.5)
    far = 0.1 * stats.norm.pdf(3.0, 1.0, 3.0)
    assert float(law.outlier(3.0)) == pytest.approx(far / (near + far), rel=1e-10)
    drawn = np.asarray(law.sample(jax.random.key(3), (200_000,)))
    # variance σ²(1 − ε + ε κ²) = 1.125; its standard error from the fourth moment
    fourth = 3 * 0.5**4 * (0.9 + 0.1 * 6.0**4)
    assert drawn.var() == pytest.approx(1.125, abs=limit() * np.sqrt((fourth - 1.125**2) / 2e5))
    sane = likelihood.Contaminated(1.0, 0.5, 1e-12, 6.0)
    assert float(sane.log_prob(1.2)) == pytest.approx(stats.norm.logpdf(1.2, 1.0, 0.5), abs=1e-9)


def test_scatter_adds_to_the_errors_of_the_file():
    curve = replace(sky(8), error=np.full(8, 0.2))
    data = Epochs.of(curve)
    problem = Problem(registry.find("stabilised").bind({"facets": "+z@3,+x@5"}), data)
    z = problem.prior_draw(jax.random.key(0), data)
    sigma = float(problem.constrain(z, data)["sigma"])
    np.testing.assert_allclose(problem.moments(z, data).sd, np.hypot(0.2, sigma), rtol=1e-12)


@pytest.mark.slow
def test_gradients_are_those_of_differences():
    """With everything switched on."""
    curve = several()
    options = {
        "n_facets": 2,
        "facets": "+x~5",
        "extinction": True,
        "noise_law": "mixture",
        "law": "lvlh",
    }
    data = Epochs.of(curve)
    problem = Problem(registry.find("stabilised").bind(options), data)
    z = problem.prior_draw(jax.random.key(4), data)
    potential = jax.jit(problem.potential)
    slope = jax.jit(jax.grad(problem.potential))(z, data)
    step = 1e-5
    along = np.asarray(jax.random.normal(jax.random.key(5), z.shape))
    change = (potential(z + step * along, data) - potential(z - step * along, data)) / (2 * step)
    assert float(change) == pytest.approx(float(slope @ along), rel=1e-5)


def test_directions_turn_with_the_body():
    """A facet at nadir under lvlh is one at −z under zenith, which is lvlh turned over."""
    one = traced(sky(), law="lvlh", facets="+z@2", reflectance="non-lambertian")
    other = traced(sky(), law="zenith", facets="-z@2", reflectance="non-lambertian")
    np.testing.assert_allclose(one["flux"], other["flux"], rtol=1e-12)
    axes = rotations.to_body(frames(catalogue.find("lvlh"), sky()).body, jnp.asarray(sky().sun))
    assert axes.shape == (N, 3)
