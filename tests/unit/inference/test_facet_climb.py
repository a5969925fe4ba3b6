"""A facet in a wrong place, where the optimiser stays, is put into the right one."""

import numpy as np
import pytest

from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.inference import search, tumbling_search
from lcbayes.inference.facet_climb import CANDIDATES, _moves, climbed
from lcbayes.inference.spin_search.arcs import Points
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.inference.tumbling_search import Repeats
from lcbayes.physics.bodies import facets
from tests.helpers import small_curves, turning_facets

OMEGA = np.array([0.06, -0.05, 0.08])
NORMALS = turning_facets.unit(np.array([[0.2, 0.1, 1.0], [1.0, 0.1, -0.3], [-0.5, 0.9, 0.2]]))
PLACES = facets.grid(CANDIDATES)
NORMALS = PLACES[np.argmax(NORMALS @ PLACES.T, axis=1)]  # of those that are tried
AREAS = np.array([2.0, 1.0, 0.7])
ERROR = 0.002  # m²


@pytest.fixture(scope="module")
def posterior():
    t = np.linspace(0.0, 400.0, 80)
    rng = np.random.default_rng(1)
    sun = np.broadcast_to(turning_facets.unit(np.array([1.0, 0.3, 0.2])), (80, 3))
    obs = turning_facets.unit(np.array([0.8, -0.2, 0.5]) + t[:, None] * [-0.002, 0.003, 0.0])
    seen = [turning_facets.in_body_axes(v, t, OMEGA) for v in (sun, obs)]
    mu0, mu = turning_facets.cosines(seen[0], seen[1], NORMALS)
    flux = turning_facets.flux(mu0, mu, AREAS)
    noisy = flux + ERROR * rng.standard_normal(80)
    curve = small_curves.of_flux(t, noisy, ERROR, sun, obs)
    return small_curves.posterior(curve, n_facets=3, omega_sd=0.1, reflectance="lambertian")


def start(problem, data, normals):
    return starts(problem, data, Bodies(OMEGA[None], normals[None], AREAS[None]), 0.1)


@pytest.mark.usefixtures("full_optimisation")
def test_a_facet_in_a_wrong_place_is_moved(posterior):
    problem, data = posterior
    best = search.polish(problem, data, start(problem, data, NORMALS), 1)
    wrong = NORMALS.copy()
    wrong[2] = [0.77, 0.08, -0.63]
    stuck = search.polish(problem, data, start(problem, data, wrong), 1)
    assert stuck.potential[0] > best.potential[0] + 100.0  # an optimum of its own
    ends = climbed(problem, data, "lambertian", stuck, 1, Silent())
    assert ends.potential[0] < best.potential[0] + 0.1
    assert np.all(np.diff(ends.potential) >= 0.0)


def test_a_facet_is_put_where_it_explains_what_the_others_leave(posterior):
    """With the other facets right, it comes to its own place and area."""
    problem, data = posterior
    points = Points.of(data)
    for j in range(3):
        wrong = NORMALS.copy()
        wrong[j] = NORMALS[j - 1]
        (z,) = start(problem, data, wrong)
        moved = [problem.constrain(m, data) for m in _moves(problem, data, points, "lambertian", z)]
        sites = next(s for s in moved if not np.allclose(s["normals_base"][j], wrong[j]))
        np.testing.assert_allclose(sites["normals"][j], NORMALS[j], atol=1e-9)
        np.testing.assert_allclose(sites["log_albedo_area"][j], np.log(AREAS[j]), atol=0.02)


def test_searches_are_repeated_until_two_agree(posterior, monkeypatch):
    """The first search ends at a wrong motion, and so does the third; the rest are right."""
    problem, data = posterior
    right = start(problem, data, NORMALS)[0]
    wrong = right.copy()
    wrong[problem.rows(["omega_unit"])] *= 1.3
    order = iter([wrong, right, wrong, right, right, right])

    def ends(*args, **options):  # noqa: ARG001
        z = next(order)
        value = -10.0 if z is right else -5.0
        return search.SearchState(z[None], np.array([value]), np.ones(1), np.zeros(1, int))

    monkeypatch.setattr(tumbling_search, "grown", ends)
    monkeypatch.setattr(tumbling_search, "climbed", lambda *given: given[3])
    arguments = (problem, data, {"reflectance": "lambertian"}, 2, jax.random.key(0), 1)
    found, repeats = tumbling_search.repeated(*arguments, Silent(), Checkpoint(None, {}))
    assert repeats == Repeats(searches=4, agree=2, starts=12)  # 2, 2, 4 and 4
    np.testing.assert_array_equal(found.potential, [-10.0, -10.0, -5.0, -5.0])


def test_a_motion_that_does_not_explain_the_data_ends_no_search(posterior, monkeypatch):
    """Two searches agree on a wrong motion, and so do all others: none is left out."""
    problem, data = posterior
    wrong = start(problem, data, -NORMALS)

    def ends(*args, **options):  # noqa: ARG001
        return search.SearchState(wrong, np.array([-5.0]), np.ones(1), np.zeros(1, int))

    monkeypatch.setattr(tumbling_search, "grown", ends)
    monkeypatch.setattr(tumbling_search, "climbed", lambda *given: given[3])
    arguments = (problem, data, {"reflectance": "lambertian"}, 2, jax.random.key(0), 1)
    _, repeats = tumbling_search.repeated(*arguments, Silent(), Checkpoint(None, {}))
    assert repeats == Repeats(searches=6, agree=6, starts=28)


def test_it_applies_to_tumbling_bodies_of_facets_only():
    curve = small_curves.curve(20, spinning=True)
    for spin, expected in (("torque-free", True), ("free", False)):
        problem, _ = small_curves.posterior(curve, n_facets=1, spin=spin)
        assert tumbling_search.applies(problem, {"reflectance": "non-lambertian"}) == expected
        assert not tumbling_search.applies(problem, {"reflectance": "ashikhmin-shirley"})
