"""Motions are found with errors that shrink, from bodies of which one facet is left to chance."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import annealed_search, search
from lcbayes.inference.annealed_search import GROWING, WHOLE, Stage, _Annealed, _distinct, annealed
from lcbayes.inference.spin_search.facets import Bodies, starts
from lcbayes.modelling.problem import compiled, prior_draws
from lcbayes.physics.bodies import facets
from tests.helpers import small_curves, turning_facets

OMEGA = np.array([0.02, -0.016, 0.025])
PLACES = facets.grid(annealed_search.PLACES)
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
    light = _Annealed.of(problem, data, "lambertian")
    first = np.array([int(np.argmax(NORMALS[0] @ PLACES.T))])
    for share in (0.5, 1.0):
        z, left = light.chosen(wrong, first, Stage(share, 0.0, 0, 1.0), 1)
        sites = compiled(problem.constrain)(z[0], data)
        np.testing.assert_allclose(sites["omega"], OMEGA, rtol=1e-12)
        normals, areas = np.asarray(sites["normals"]), np.exp(sites["log_albedo_area"])
        missed = np.asarray(data.brightness) - turning(*geometry(80, 400.0), normals, areas)
        middle = slice(40 - round(40 * share), 40 + round(40 * share))
        kept = missed[middle] / ERROR
        assert left[0] == pytest.approx(kept @ kept, rel=1e-6)
        # some arrangement of facets on the grid explains nearly all of the light
        white = np.asarray(data.brightness)[middle] / ERROR
        assert left[0] < 0.02 * white @ white
        np.testing.assert_allclose(normals[0], PLACES[first[0]], atol=1e-9)


def test_points_away_from_the_middle_have_no_power(posterior):
    problem, data = posterior
    light = _Annealed.of(problem, data, "lambertian")
    part = light.part(Stage(0.25, 0.05, 0, 1.0))
    soft = ERROR**2 + (0.05 * float(np.mean(data.brightness))) ** 2
    np.testing.assert_allclose(part.information[30:50], ERROR**2 / soft, rtol=1e-6)
    np.testing.assert_array_equal(np.delete(part.information, np.arange(30, 50)), 0.0)


@pytest.mark.usefixtures("full_optimisation")
@pytest.mark.parametrize("stages", [WHOLE, GROWING])
def test_a_motion_is_found_from_draws_of_the_prior(posterior, stages):
    """As good as the optimum reached from the truth."""
    problem, data = posterior
    truth = starts(problem, data, Bodies(OMEGA[None], NORMALS[None], AREAS[None]), 0.03)
    best = search.polish(problem, data, truth, 1)
    ends = annealed(problem, data, "lambertian", stages, 600, jax.random.key(2), 1, Silent())
    assert ends.potential[0] < best.potential[0] + 0.1
    assert np.all(np.diff(ends.potential) >= 0.0)


def test_the_best_motions_of_the_draws_are_followed(posterior, monkeypatch):
    """The first stage begins with the best quarter of the draws, whose first facets differ."""
    problem, data = posterior
    begun = []

    def advanced(problem, data, z, n_steps, workers, report):  # noqa: ARG001
        begun.append(z)
        return search.init(z)._replace(potential=np.arange(len(z)))

    monkeypatch.setattr(search, "advanced", advanced)
    annealed(problem, data, "lambertian", WHOLE, 60, jax.random.key(2), 1, Silent())
    light = _Annealed.of(problem, data, "lambertian")
    draws = np.asarray(prior_draws(problem, jax.random.split(jax.random.key(9), 500), data))
    facet = np.random.default_rng(1).integers(0, len(PLACES), 500)
    _, every = light.chosen(draws, facet, WHOLE[0], 1)
    normals = [compiled(problem.constrain)(z, data)["normals"][0] for z in begun[0]]
    own = np.argmax(np.asarray(normals) @ PLACES.T, axis=1)
    _, kept = light.chosen(np.asarray(begun[0]), own, WHOLE[0], 1)
    assert len(kept) == 60
    assert len(set(own)) > 20
    assert kept.max() < np.quantile(every, 0.4)  # a quarter is kept


def test_equal_optima_are_kept_once_and_others_of_equal_potential_stay():
    """By hand: the second is the first again, the third differs in motion, the fourth is higher."""
    motion = np.array([[0.0, 1.0], [0.001, 1.0], [0.5, 1.0], [0.0, 1.0], [0.0, 1.0]])
    potential = np.array([1.0, 1.001, 1.002, 1.5, np.inf])
    assert _distinct(potential, motion) == [0, 2, 3]
    assert _distinct(np.array([np.inf]), motion[:1]) == []


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
@pytest.mark.parametrize("stages", [WHOLE, GROWING])
def test_a_tumbling_body_is_found(stages):
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
    ends = annealed(problem, data, "lambertian", stages, 4000, jax.random.key(1), 2, Silent())
    sites = compiled(problem.constrain)(ends.z[0], data)
    missed = (np.asarray(data.brightness) - np.asarray(sites["expected"])) / ERROR
    assert np.mean(missed**2) < 1.3
    omega = turn[0].apply(spin)
    assert np.linalg.norm(sites["omega"] - omega) < 0.03 * np.linalg.norm(omega)
    np.testing.assert_allclose(sites["inertia_ratio"], [0.5, 0.8], atol=0.03)


def test_on_an_accelerator_motions_are_computed_side_by_side(posterior, monkeypatch):
    """Facets and steps are those of a CPU, where they are computed one after the other."""
    problem, data = posterior
    light = _Annealed.of(problem, data, "lambertian")
    keys = jax.random.split(jax.random.key(1), 5)
    draws, first = np.asarray(prior_draws(problem, keys, data)), np.arange(5)
    monkeypatch.setattr(annealed_search, "CHUNK", (3, 4))

    def ends() -> tuple[np.ndarray, ...]:
        z, left = light.chosen(draws, first, WHOLE[-1], 1)
        done = search.advanced(problem, data, draws, 3, 1, lambda _: None)
        return z, left, np.asarray(done.z), np.asarray(done.potential)

    alone = ends()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    monkeypatch.delattr(jax.lax, "map")  # the loop of a CPU
    monkeypatch.setattr(search, "ACCELERATOR_SIZE", 3 * problem.dim * data.t.size)
    assert search.chunk_size(problem, data) == 3
    for one, other in zip(alone, ends(), strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-8)
