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


def light_curve(t, turned):
    """As seen at the times t, the body having turned at a constant rate for the times given."""
    rng = np.random.default_rng(1)
    sun = np.broadcast_to(turning_facets.unit(np.array([1.0, 0.3, 0.2])), (t.size, 3))
    obs = turning_facets.unit(np.array([0.8, -0.2, 0.5]) + t[:, None] * [-0.002, 0.003, 0.0])
    seen = [turning_facets.in_body_axes(v, turned, OMEGA) for v in (sun, obs)]
    mu0, mu = turning_facets.cosines(seen[0], seen[1], NORMALS)
    flux = turning_facets.flux(mu0, mu, AREAS)
    noisy = flux + ERROR * rng.standard_normal(t.size)
    return small_curves.of_flux(t, noisy, ERROR, sun, obs)


@pytest.fixture(scope="module")
def posterior():
    t = np.linspace(0.0, 400.0, 80)
    curve = light_curve(t, t)
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


@pytest.fixture
def repeated(posterior, monkeypatch):
    """`tumbling_search.repeated`, whose searches end as given: the factor by which the true rate is
    multiplied, and the potential."""

    def repeat(*ends, normals=NORMALS):
        problem, data = posterior
        order = iter(ends)

        def annealed(*given):  # noqa: ARG001
            factor, potential = next(order)
            z = np.array(start(problem, data, normals))
            z[:, problem.rows(["omega_unit"])] *= factor
            return search.SearchState(z, np.array([potential]), np.ones(1), np.zeros(1, int))

        monkeypatch.setattr(tumbling_search, "annealed", annealed)
        monkeypatch.setattr(tumbling_search, "climbed", lambda *given: given[3])
        arguments = (
            (problem, problem),
            data,
            {"reflectance": "lambertian"},
            2,
            jax.random.key(0),
            1,
        )
        return tumbling_search.repeated(*arguments, Silent(), Checkpoint(None, {}))

    return repeat


def test_searches_are_repeated_until_two_agree(repeated):
    """The first search ends at a wrong motion, and so does the third."""
    found, repeats = repeated((1.3, -5.0), (1.0, -20.0), (1.3, -5.0), (1.0, -20.0))
    assert repeats == Repeats(searches=4, agree=2, different=1, starts=12)  # 2, 2, 4 and 4
    np.testing.assert_array_equal(found.potential, [-20.0, -20.0, -5.0, -5.0])
    assert not repeats.undetermined


def test_a_motion_that_does_not_explain_the_data_ends_no_search(repeated):
    """Two searches agree on a wrong body, and so do all others: none is left out."""
    _, repeats = repeated(*[(1.0, -5.0)] * 6, normals=-NORMALS)
    assert repeats == Repeats(searches=6, agree=6, different=0, starts=28)


def test_three_motions_that_explain_the_data_end_the_search(repeated):
    """Each best but one is within 5 nats of the best, and all are different motions."""
    _, repeats = repeated((1.3, -17.0), (1.6, -12.0), (1.0, -20.0), (1.9, -18.0), (1.3, -17.0))
    assert repeats == Repeats(searches=4, agree=1, different=3, starts=12)
    assert repeats.undetermined


def test_a_motion_found_again_is_not_a_different_one(repeated):
    """Two motions, each found more than once, the best of them once: the searches go on."""
    ends = [(1.0, -20.0), *[(1.3, -17.0)] * 5]
    _, repeats = repeated(*ends)
    assert repeats == Repeats(searches=6, agree=1, different=2, starts=28)
    assert not repeats.undetermined


def test_a_body_that_slows_down_is_explained_by_the_model_itself(monkeypatch):
    """The search knows no change of the rate, which is 0.8 % here, and the fit does."""
    t = np.concatenate([np.linspace(0.0, 200.0, 40), np.linspace(2000.0, 2200.0, 40)])
    curve = light_curve(t, t - 0.004 * t * (t - 2200.0) / 2200.0)
    known = {"n_facets": 3, "omega_sd": 0.1, "reflectance": "lambertian"}
    problem, data = small_curves.posterior(curve, **known, rate_drift_sd=0.0)
    plain, _ = small_curves.posterior(curve, **known)
    ends = search.polish(problem, data, start(problem, data, NORMALS), 1)
    monkeypatch.setattr(tumbling_search, "annealed", lambda *given: ends)  # noqa: ARG005
    monkeypatch.setattr(tumbling_search, "climbed", lambda *given: given[3])
    arguments = (data, {"reflectance": "lambertian"}, 2, jax.random.key(0), 1)
    for model, searches in ((problem, 6), (plain, 2)):
        _, repeats = tumbling_search.repeated(
            (problem, model), *arguments, Silent(), Checkpoint(None, {})
        )
        assert repeats.searches == searches


def test_it_applies_to_tumbling_bodies_of_facets_only():
    curve = small_curves.curve(20, spinning=True)
    for spin, expected in (("torque-free", True), ("free", False)):
        problem, _ = small_curves.posterior(curve, n_facets=1, spin=spin)
        assert tumbling_search.applies(problem, {"reflectance": "non-lambertian"}) == expected
        assert not tumbling_search.applies(problem, {"reflectance": "ashikhmin-shirley"})
