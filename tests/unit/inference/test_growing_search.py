"""Motions are found while the data grow, with facets that are chosen anew."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import growing_search, search
from lcbayes.inference.growing_search import Stage, _Growing, grown
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.modelling.problem import compiled, prior_draws
from lcbayes.physics.bodies import facets
from tests.helpers import small_curves, turning_facets

OMEGA = np.array([0.02, -0.016, 0.025])
PLACES = facets.grid(growing_search.PLACES)
NORMALS = turning_facets.unit(np.array([[0.2, 0.1, 1.0], [1.0, 0.1, -0.3], [-0.5, 0.9, 0.2]]))
NORMALS = PLACES[np.argmax(NORMALS @ PLACES.T, axis=1)]  # of those that are tried
AREAS = np.array([2.0, 1.0, 0.7])
ERROR = 0.002  # m²


def geometry(n: int, length: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, the Sun at rest, and an observer who goes by."""
    t = np.linspace(0.0, length, n)
    sun = np.broadcast_to(turning_facets.unit(np.array([1.0, 0.3, 0.2])), (n, 3))
    obs = turning_facets.unit(np.array([0.8, -0.2, 0.5]) + t[:, None] / length * [-0.8, 1.2, 0.1])
    return t, sun, obs


def light(t, sun, obs, flux: np.ndarray) -> LightCurve:
    noise = ERROR * np.random.default_rng(1).standard_normal(t.size)
    return small_curves.of_flux(t, flux + noise, ERROR, sun, obs)


def turning(t, sun, obs, normals=NORMALS, areas=AREAS) -> np.ndarray:
    inside = [turning_facets.in_body_axes(v, t, OMEGA) for v in (sun, obs)]
    mu0, mu = turning_facets.cosines(inside[0], inside[1], normals)
    return turning_facets.flux(mu0, mu, areas)


@pytest.fixture(scope="module")
def posterior():
    seen = geometry(80, 400.0)
    curve = light(*seen, turning(*seen))
    return small_curves.posterior(curve, n_facets=3, omega_sd=0.03, reflectance="lambertian")


def test_the_facets_of_a_motion_are_chosen(posterior):
    """The motion stays, and χ² is that of the flux written down once more, and small."""
    problem, data = posterior
    wrong = starts(problem, data, Bodies(OMEGA[None], -NORMALS[None], AREAS[None]), 0.03)
    growing = _Growing.of(problem, data, "lambertian")
    for share in (0.5, 1.0):
        z, left = growing.chosen(wrong, Stage(share, 0.0, 0, 1.0), 1)
        sites = compiled(problem.constrain)(z[0], data)
        np.testing.assert_allclose(sites["omega"], OMEGA, rtol=1e-12)
        normals, areas = np.asarray(sites["normals"]), np.exp(sites["log_albedo_area"])
        missed = np.asarray(data.brightness) - turning(*geometry(80, 400.0), normals, areas)
        middle = slice(40 - round(40 * share), 40 + round(40 * share))
        kept = missed[middle] / ERROR
        assert left[0] == pytest.approx(kept @ kept, rel=1e-6)
        # some arrangement of facets on the grid explains nearly all of the light
        light = np.asarray(data.brightness)[middle] / ERROR
        assert left[0] < 0.02 * light @ light


def test_points_away_from_the_middle_have_no_power(posterior):
    problem, data = posterior
    growing = _Growing.of(problem, data, "lambertian")
    part = growing.part(Stage(0.25, 0.05, 0, 1.0))
    soft = ERROR**2 + (0.05 * float(np.mean(data.brightness))) ** 2
    np.testing.assert_allclose(part.information[30:50], ERROR**2 / soft, rtol=1e-6)
    np.testing.assert_array_equal(np.delete(part.information, np.arange(30, 50)), 0.0)


@pytest.mark.usefixtures("full_optimisation")
def test_a_motion_is_found_from_draws_of_the_prior(posterior, monkeypatch):
    """As good as the optimum reached from the truth, with other facets than it began with."""
    problem, data = posterior
    monkeypatch.setattr(growing_search, "MOTIONS", 10)
    truth = starts(problem, data, Bodies(OMEGA[None], NORMALS[None], AREAS[None]), 0.03)
    best = search.polish(problem, data, truth, 1)
    ends = grown(problem, data, "lambertian", 150, jax.random.key(2), 1, Silent())
    assert ends.potential[0] < best.potential[0] + 0.1
    assert np.all(np.diff(ends.potential) >= 0.0)


def test_the_best_motions_of_the_draws_are_followed(posterior, monkeypatch):
    """The first stage begins with motions whose χ² few draws of the prior reach."""
    problem, data = posterior
    monkeypatch.setattr(growing_search, "MOTIONS", 10)
    begun = []

    def advanced(problem, data, z, n_steps, workers, report):  # noqa: ARG001
        begun.append(z)
        return search.init(z)._replace(potential=np.arange(len(z)))

    monkeypatch.setattr(search, "advanced", advanced)
    grown(problem, data, "lambertian", 60, jax.random.key(2), 1, Silent())
    growing, stage = _Growing.of(problem, data, "lambertian"), growing_search.STAGES[0]
    draws = np.asarray(prior_draws(problem, jax.random.split(jax.random.key(9), 500), data))
    _, kept = growing.chosen(np.asarray(begun[0]), stage, 1)
    _, every = growing.chosen(draws, stage, 1)
    assert len(kept) == 60
    assert kept.max() < np.quantile(every, 0.2)  # a tenth is kept


@pytest.mark.usefixtures("full_optimisation")
def test_facets_that_the_optimiser_has_spoilt_are_chosen_anew(posterior, monkeypatch):
    """The right motion is kept although the first optimisation of each stage merges all facets."""
    problem, data = posterior
    truth = starts(problem, data, Bodies(OMEGA[None], NORMALS[None], AREAS[None]), 0.03)
    best = search.polish(problem, data, truth, 1)
    calls = []

    def advanced(problem, data, z, n_steps, workers, report):  # noqa: ARG001
        calls.append(len(z))
        spoilt = np.array(z)
        if len(calls) % 2:
            spoilt[:, problem.rows(["normals_base"])] = np.tile([0.6, 0.0, 0.8], 3)
        potential = compiled(problem.potential)
        return search.init(spoilt)._replace(
            potential=np.array([float(potential(row, data)) for row in spoilt])
        )

    monkeypatch.setattr(search, "advanced", advanced)
    monkeypatch.setattr(growing_search, "MOTIONS", 1)
    monkeypatch.setattr(growing_search, "prior_draws", lambda *given: np.repeat(truth, 12, 0))  # noqa: ARG005
    ends = grown(problem, data, "lambertian", 12, jax.random.key(2), 1, Silent())
    assert ends.potential[0] < best.potential[0] + 0.1


def tumbling(t: np.ndarray, inertia: np.ndarray, spin: np.ndarray) -> Rotation:
    """Attitudes, body to inertial, by integration of Euler's equations; spin in body axes."""

    def rates(_, state):
        q, w = state[:4], state[4:]
        x, y, z, s = q
        dq = 0.5 * np.array(
            [
                s * w[0] + y * w[2] - z * w[1],
                s * w[1] + z * w[0] - x * w[2],
                s * w[2] + x * w[1] - y * w[0],
                -(x * w[0] + y * w[1] + z * w[2]),
            ]
        )
        return np.concatenate([dq, np.cross(inertia * w, w) / inertia])

    start = np.concatenate([Rotation.from_rotvec([0.4, -0.9, 0.3]).as_quat(), spin])
    path = solve_ivp(rates, (0.0, t[-1]), start, t_eval=t, rtol=1e-10, atol=1e-12)
    return Rotation.from_quat(path.y[:4].T)


@pytest.mark.slow
def test_a_tumbling_body_is_found():
    """Momentum, rate and moments of inertia are those of a body that Euler's equations turn."""
    t, sun, obs = geometry(120, 900.0)
    inertia, spin = np.array([0.5, 0.8, 1.0]), np.array([0.010, 0.006, 0.012])
    turn = tumbling(t, inertia, spin)
    inside = [turn.apply(v, inverse=True) for v in (sun, obs)]
    mu0, mu = turning_facets.cosines(inside[0], inside[1], NORMALS)
    flux = turning_facets.flux(mu0, mu, AREAS)
    problem, data = small_curves.posterior(
        light(t, sun, obs, flux),
        n_facets=3,
        spin="torque-free",
        omega_sd=0.01,
        reflectance="lambertian",
    )
    ends = grown(problem, data, "lambertian", 1000, jax.random.key(1), 2, Silent())
    sites = compiled(problem.constrain)(ends.z[0], data)
    missed = (np.asarray(data.brightness) - np.asarray(sites["expected"])) / ERROR
    assert np.mean(missed**2) < 1.3
    omega = turn[0].apply(spin)
    assert np.linalg.norm(sites["omega"] - omega) < 0.03 * np.linalg.norm(omega)
    np.testing.assert_allclose(sites["inertia_ratio"], [0.5, 0.8], atol=0.03)
