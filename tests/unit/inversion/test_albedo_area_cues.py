"""Shape cues: false alarms on bodies without them, power on bodies that have them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest

from lcbayes.core.progress import Silent
from lcbayes.inversion.albedo_area import cues, nulls
from lcbayes.inversion.albedo_area.cues import Cue
from lcbayes.inversion.albedo_area.distribution import Distribution, grid, solve
from lcbayes.inversion.albedo_area.facets import refine, select_facets
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, columns
from lcbayes.inversion.albedo_area.maps import Maps
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import Fixed
from lcbayes.physics.bodies import facets, shapes
from lcbayes.physics.bodies.closure import close
from tests.helpers.false_alarms import EACH, counts
from tests.helpers.known_bodies import curve_of, directions

ONE = (LAMBERTIAN,)
NO_ARC = Cue("arc", 0.0, 1.0, "", "")
FINE = facets.grid(1500)


def ellipsoid(axes: tuple[float, float, float]) -> shapes.Body:
    raw = np.linalg.norm(FINE * np.array(axes), axis=1) ** -4.0
    return shapes.body(FINE, close(FINE, raw / raw.sum()))


def on_grid(seen: Observed, n: int = 120) -> tuple[Distribution, np.ndarray]:
    normals, which = grid(n)
    matrix = columns(seen, normals, which)
    return solve(seen, normals, which, matrix), matrix


def test_null_is_the_ellipsoid_itself_where_the_body_is_one():
    seen = Observed.of(curve_of(ellipsoid((2.0, 1.2, 0.8)), 200, noise=0.01), Fixed())
    result, matrix = on_grid(seen, 800)
    areas = nulls.ellipsoid(seen, result, matrix)
    expected = np.linalg.norm(result.normals * [2.0, 1.2, 0.8], axis=1) ** -4.0
    assert areas / areas.sum() == pytest.approx(expected / expected.sum(), rel=0.1)
    assert np.sum(((matrix @ areas - seen.flux) / seen.error) ** 2) < 1.5 * len(seen.flux)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.parametrize("axes", [(1.0, 1.0, 1.0), (1.6, 1.1, 0.8)])
def test_clusters_raise_false_alarms_as_often_as_they_say(axes):
    maps, body, p = Maps(facets.grid(100)), ellipsoid(axes), []
    for seed in range(80):
        seen = Observed.of(curve_of(body, 120, 0.03, seed), Fixed())
        result, matrix = on_grid(seen, 100)
        with Silent().stage("", 1, "") as track:
            null = nulls.smooth_bodies(seen, result, matrix, 19, seed, track)
        p.append(cues._clusters(maps, result.areas, null, NO_ARC).p_value)
    assert np.sum(np.array(p) <= 0.05) <= counts(80, 0.05)[1]  # 4 expected
    # at every level no more often than said: the estimated null makes the test conservative
    jittered = np.array(p) - 0.05 * np.random.default_rng(0).uniform(size=80)
    assert kstest(jittered, "uniform", alternative="greater").pvalue > EACH / 2


@pytest.mark.statistical(false_alarm=EACH)
def test_arcs_and_even_regions_raise_few_false_alarms_on_facets_at_random():
    maps, rng = Maps(facets.grid(100)), np.random.default_rng(0)
    arc, even = [], []
    for seed in range(60):
        truth = shapes.body(directions(rng, 9), rng.exponential(size=9))
        seen = Observed.of(curve_of(truth, 120, 0.03, seed), Fixed())
        result, matrix = on_grid(seen, 100)
        known = Distribution(
            truth.normals, np.zeros(9, int), truth.areas, np.ones(1), result.flux, 0.0
        )
        with Silent().stage("", 1, "") as track:
            null = nulls.scattered_facets(seen, result, matrix, known, ONE, 19, seed, track)
        arc.append(cues._p(maps.arc(result.areas)[0], [maps.arc(a)[0] for a in null]))
        even.append(cues._p(maps.uniform(result.areas), [maps.uniform(a) for a in null]))
    most = counts(60, 0.05)[1]  # 3 expected; one side of two alike
    assert np.sum(np.array(arc) <= 0.05) <= most
    assert np.sum(np.array(even) <= 0.05) <= most


@pytest.mark.statistical(false_alarm=EACH)
def test_angles_raise_false_alarms_as_often_as_they_say():
    rng = np.random.default_rng(0)
    p = np.array(
        [
            [c.p_value for c in cues.angles(directions(rng, 5), rng.dirichlet(np.full(5, 5.0)), i)]
            for i in range(150)
        ]
    )
    assert (np.sum(p <= 0.05, axis=0) <= counts(150, 0.05, 3)[1]).all()  # 7.5 expected
    assert all(kstest(column, "uniform").pvalue > EACH / 6 for column in p.T)


def test_angles_of_prisms():
    for sides, name in ((6, "angle-60"), (8, "angle-45")):
        prism = shapes.cylinder(1.0, 1.0, sides)
        share = prism.areas / prism.areas.sum()
        result = {c.name: c for c in cues.angles(prism.normals, share, 0)}
        assert result[name].significant
        assert result["angle-90"].significant
    brick = shapes.box(2.0, 1.4, 0.8)
    result = {c.name: c for c in cues.angles(brick.normals, brick.areas / brick.areas.sum(), 0)}
    assert result["angle-90"].p_value < 0.002
    assert result["angle-90"].statistic == pytest.approx(1.0)
    assert not result["angle-60"].significant
    assert not result["angle-45"].significant


def test_nothing_to_measure_is_no_alarm():
    for n in (0, 1):
        result = cues.angles(np.eye(3)[:n], np.ones(n), 0)
        assert [c.p_value for c in result] == [1.0, 1.0, 1.0]


def test_statistics_of_ideal_maps():
    normals = facets.grid(600)
    maps = Maps(normals)
    sphere = np.ones(600)
    assert maps.uniform(sphere) == 1.0
    share = maps.cap @ sphere / 600
    assert share == pytest.approx((1 - np.cos(np.radians(15))) / 2, rel=0.3)
    assert maps.excess(sphere, share) == pytest.approx(0.0)
    assert maps.arc(sphere)[0] == pytest.approx(np.sin(np.radians(12)), rel=0.1)
    belt = (np.abs(normals[:, 2]) < 0.1).astype(float)
    statistic, pole = maps.arc(belt)
    assert statistic > 0.85
    assert abs(pole[2]) > 0.97
    ends = np.where(np.abs(normals[:, 2]) > 0.99, 5.0, 0.0) + belt
    assert maps.arc(ends)[0] > 0.8  # heavy ends do not hide the side
    faces = np.zeros(600)
    faces[np.argmax(normals @ np.vstack([np.eye(3), -np.eye(3)]).T, axis=0)] = [3, 2, 1, 3, 2, 1]
    shares = [c["share"] for c in maps.clusters(faces)]
    assert shares == pytest.approx([0.25, 0.25, 1 / 6, 1 / 6, 1 / 12, 1 / 12])
    assert maps.uniform(faces) == 0.0


def cues_of(body: shapes.Body, noise: float = 0.02, seed: int = 5) -> dict[str, Cue]:
    seen = Observed.of(curve_of(body, 250, noise, seed=seed), Fixed())
    result, matrix = on_grid(seen, 250)
    fewer = select_facets(seen, refine(seen, result, matrix, ONE), ONE)
    return {c.name: c for c in cues.find(seen, result, matrix, fewer, ONE, n_null=19, seed=1)}


def test_a_brick_shows_six_facets_at_right_angles():
    result = cues_of(shapes.box(2.0, 1.4, 0.8))
    assert result["clusters"].details["n_flat"] == 6
    assert result["angle-90"].p_value < 0.005
    for name in ("angle-60", "angle-45", "arc", "uniform"):
        assert not result[name].significant, name


def test_a_cylinder_shows_two_facets_and_an_arc():
    result = cues_of(shapes.cylinder(0.5, 2.0, 100))
    assert result["arc"].significant
    assert np.abs(result["arc"].details["pole"][2]) > 0.99
    assert result["clusters"].details["n_flat"] == 2
    assert not result["uniform"].significant


def test_a_sphere_shows_an_even_region_alone():
    result = cues_of(shapes.sphere(0.5, 1000))
    assert result["uniform"].significant
    assert result["uniform"].statistic > 0.8
    for name in ("clusters", "arc", "angle-90", "angle-60", "angle-45"):
        assert not result[name].significant, name
    assert result["clusters"].details["n_flat"] == 0
