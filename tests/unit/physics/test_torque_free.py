"""The free rotation of a rigid body against its own equations, an integrator, and closed forms."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from numpyro import handlers
from scipy.integrate import solve_ivp
from scipy.special import elliprf

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.modelling import priors, registry
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.physics.attitude import rotations
from lcbayes.physics.attitude.elliptic import carlson
from lcbayes.physics.attitude.laws import Ephemeris, TorqueFree
from lcbayes.physics.attitude.torque_free import polhode, torque_free, torque_free_to_body
from lcbayes.simulation.observability.parameters import Unknowns
from lcbayes.simulation.scenarios.scenario import load
from lcbayes.simulation.simulate import simulate

RUN = jax.jit(torque_free)
RATE = jax.jit(
    lambda t, w, j: jax.jvp(lambda t: torque_free(t, w, j), (t,), (jnp.ones_like(t),))[1]
)
SLOPE = jax.jit(jax.jacrev(torque_free, 1))
TIMES = np.linspace(0.0, 200.0, 40)  # s; one number of them, one compilation
FLIPS = 0.5 * np.arange(361)  # s, of flips at 1 rad/s; in the steps of `exact`
PRINCIPAL = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
PRINCIPAL *= np.linalg.det(PRINCIPAL)


def inertia(*sides: float) -> np.ndarray:
    """Of a box, about its principal axes."""
    square = np.square(sides)
    return np.diag(square.sum() - square)


def turned(tensor: np.ndarray, omega) -> tuple[np.ndarray, np.ndarray]:
    """Tensor and ω of principal axes, in axes at odds with them."""
    return PRINCIPAL @ np.asarray(omega, float), PRINCIPAL @ tensor @ PRINCIPAL.T


def integrated(t: np.ndarray, omega: np.ndarray, tensor: np.ndarray) -> np.ndarray:
    """Body to inertial by DOP853 at its tightest: Ȧ = A [ω×] and Euler's equations."""
    inverse = np.linalg.inv(tensor)

    def slope(_, y):
        a, w = y[:9].reshape(3, 3), y[9:]
        return np.concatenate([np.cross(a, w).ravel(), inverse @ np.cross(tensor @ w, w)])

    begin = np.concatenate([np.eye(3).ravel(), omega])
    result = solve_ivp(slope, (0.0, t[-1]), begin, "DOP853", t, rtol=1e-12, atol=1e-14)
    return result.y[:9].T.reshape(-1, 3, 3)


BITS = 140  # binary places of `exact`: 1e-42


def exact(t: np.ndarray, omega: np.ndarray, tensor: np.ndarray) -> np.ndarray:
    """Body to inertial, t in steps of ½ s, by Taylor series of these equations in whole numbers.

    Next to the separatrix every error grows as e^(λt), and DOP853's own reach 1 within a flip. The
    terms fall as (0.5 s/2.7 s)ⁿ for principal moments 1, 2, 3 and 1 rad/s about the second.
    """
    half, order = 1 << (BITS - 1), 34

    def fixed(x):
        whole = [int(Fraction(float(v)) * 2**BITS) for v in np.ravel(x)]
        return np.array(whole, dtype=object).reshape(np.shape(x))

    j = [[Fraction(float(v)) for v in row] for row in tensor]
    minors = [
        [j[b - 2][a - 2] * j[b - 1][a - 1] - j[b - 2][a - 1] * j[b - 1][a - 2] for b in range(3)]
        for a in range(3)
    ]  # transposed, indices modulo 3
    det = sum(j[0][k] * minors[k][0] for k in range(3))
    inverse = np.array([[int(v / det * 2**BITS) for v in row] for row in minors], dtype=object)
    momentum = (fixed(tensor) @ fixed(omega)) >> BITS
    rows = np.vstack([fixed(np.eye(3)), momentum])  # each turns as ẋ = x × ω
    result = []
    for _ in t:
        result.append([[v / (1 << BITS) for v in row] for row in rows[:3]])
        x, w = np.zeros((order + 1, 4, 3), dtype=object), np.zeros((order, 3), dtype=object)
        x[0] = rows
        for n in range(order):
            w[n] = (inverse @ x[n, 3]) >> BITS
            product = np.sum(np.cross(x[: n + 1], w[n::-1, None]), axis=0) >> BITS
            x[n + 1] = (product * half // (n + 1)) >> BITS
        rows = np.sum(x, axis=0)
    return np.array(result)


MOTIONS = {
    "about the largest": (inertia(3, 2, 1), (0.02, -0.05, -0.1)),
    "about the smallest": (inertia(3, 2, 1), (-0.1, -0.05, 0.02)),
    "prolate": (inertia(1, 1, 4), (0.03, 0.05, 0.1)),
    "oblate": (inertia(1, 4, 4), (0.03, 0.05, 0.1)),
    "flat spin": (inertia(1, 1, 4), (0.05, 0.1, 1e-6)),
    "nearly a sphere": (np.diag([1.0, 1.0 + 1e-9, 1.0 + 3e-9]), (0.1, 0.02, 0.03)),
    "nearly steady": (inertia(3, 2, 1), (1e-6, 1e-7, 0.1)),
    "steady": (inertia(3, 2, 1), (0.0, 0.0, 0.1)),
    "sphere": (np.eye(3), (0.1, 0.02, 0.03)),
    "near the separatrix": (inertia(3, 2, 1), (1e-4, 0.1, 1e-4)),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_as_an_integrator_finds_it(name):
    t = TIMES
    omega, tensor = turned(*MOTIONS[name])
    result = np.asarray(RUN(t, omega, tensor))
    np.testing.assert_allclose(result, integrated(t, omega, tensor), atol=3e-11)
    np.testing.assert_allclose(result[0], np.eye(3), atol=1e-13)


@pytest.mark.parametrize(
    "e",
    [1e-4, 1e-8, 1e-12, *(pytest.param(e, marks=pytest.mark.slow) for e in (1e-6, 1e-7, 1e-9))],
)
def test_flips_next_to_the_separatrix(e):
    """Spin but for e about the intermediate axis, for two to six flips.

    In principal axes rounding of ω and J, ε of each, moves no flip by more than some ε t. In axes
    at odds with them it leaves e uncertain by some 10 ε, hence a passage by 10 ε/e of 1/λ = 1.7 s:
    of six passages 100 ε/e, at 1 rad/s.
    """
    epsilon = np.finfo(float).eps
    omega, tensor = np.array([e, 1.0, 0.5 * e]), np.diag([1.0, 2.0, 3.0])
    result = RUN(FLIPS, omega, tensor)
    np.testing.assert_allclose(result, exact(FLIPS, omega, tensor), atol=20 * epsilon * FLIPS[-1])
    omega, tensor = turned(np.diag([3.0, 2.0, 1.0]), -omega)
    tensor = 0.5 * (tensor + tensor.T)
    result = RUN(FLIPS, omega, tensor)
    allowed = epsilon * (20 * FLIPS[-1] + 100 / e)
    np.testing.assert_allclose(result, exact(FLIPS, omega, tensor), atol=allowed)


def test_flat_spin_however_flat():
    for moments in ((1.0, 1.0, 2.0), (2.0, 2.0, 1.0)):
        for along in (1e-5, 1e-9, 1e-13):
            omega, tensor = np.array([0.0, 0.2, along]), np.diag(moments)
            result = RUN(FLIPS[:41], omega, tensor)
            np.testing.assert_allclose(result, exact(FLIPS[:41], omega, tensor), atol=1e-14)


@pytest.mark.parametrize("e", [1e-4, 1e-8])
def test_slopes_next_to_the_separatrix(e):
    """By ω, against differences, for as long as the attitude hangs on e; and finite at rest."""
    omega, tensor, t = np.array([e, 1.0, 0.5 * e]), np.diag([1.0, 2.0, 3.0]), FLIPS
    result = np.asarray(SLOPE(t, omega, tensor))
    for k, step in enumerate(np.diag([1e-5 * e, 1e-8, 1e-5 * e])):
        want = (RUN(t, omega + step, tensor) - RUN(t, omega - step, tensor)) / (2.0 * step[k])
        np.testing.assert_allclose(result[..., k], want, atol=2e-6 * np.abs(want).max())
    on_it = np.array([e, 1.0, e / np.sqrt(3.0)])  # to rounding
    assert np.all(np.isfinite(SLOPE(t, on_it, tensor)))
    assert np.all(np.isfinite(SLOPE(t, np.array([0.0, 1.0, 0.0]), tensor)))


def test_energy_and_angular_momentum_are_kept_for_ten_thousand_seconds():
    t = 50.0 * TIMES  # 10⁴ s
    for tensor, motion in MOTIONS.values():
        omega, tensor = turned(tensor, motion)
        result = np.asarray(RUN(t, omega, tensor))
        momentum = np.einsum("tji,j->ti", result, tensor @ omega)  # body
        rates = np.linalg.solve(tensor, momentum.T).T
        energy = np.sum(momentum * rates, axis=1)
        np.testing.assert_allclose(energy, energy[0], rtol=1e-12)
        product = result @ np.swapaxes(result, 1, 2)
        np.testing.assert_allclose(product - np.eye(3), 0.0, atol=1e-12)
        # ω of the body that the attitude itself has, from its derivative
        rate = RATE(t, omega, tensor)
        own = np.swapaxes(result, 1, 2) @ np.asarray(rate)
        np.testing.assert_allclose(own[:, [2, 0, 1], [1, 2, 0]], rates, atol=1e-11)


def test_symmetric_top_precesses_and_spins():
    t = 2.5 * TIMES
    for moments in ((2.0, 2.0, 0.7), (2.0, 2.0, 3.1)):
        omega, tensor = turned(np.diag(moments), (0.03, -0.04, 0.06))
        momentum, axis = tensor @ omega, PRINCIPAL[:, 2]
        along = momentum / moments[0]
        spin = 0.06 * (1.0 - moments[2] / moments[0]) * axis
        want = rotations.constant_rate(
            jnp.asarray(t), jnp.asarray(along)
        ) @ rotations.constant_rate(jnp.asarray(t), jnp.asarray(spin))
        np.testing.assert_allclose(RUN(t, omega, tensor), want, atol=1e-12)


def test_slopes_are_those_of_differences():
    """By ω and along symmetric changes of the tensor, in reverse mode."""
    omega, tensor = turned(*MOTIONS["about the largest"])
    rng = np.random.default_rng(2)
    weights = rng.standard_normal((TIMES.size, 3, 3))
    changes = rng.standard_normal((2, 3, 3))
    changes = changes + np.swapaxes(changes, 1, 2)
    t = TIMES * 0.5

    def total(p, run=torque_free):
        return jnp.sum(weights * run(t, omega + p[:3], tensor + jnp.tensordot(p[3:], changes, 1)))

    result = jax.jit(jax.grad(total))(np.zeros(5))
    for k, step in enumerate(1e-6 * np.eye(5)):
        want = (total(step, RUN) - total(-step, RUN)) / 2e-6
        assert result[k] == pytest.approx(float(want), abs=2e-5 * np.abs(result).max())


def weighted(p, motion, vectors, weights):
    """Σ w v² over the vectors v in the body, and v; ``p`` changes ω and then the tensor, and may be
    shorter than three and the changes of the tensor."""
    omega, tensor, changes = motion
    p = jnp.concatenate([p, jnp.zeros(3 + len(changes) - len(p))])
    spin, moments = omega + 0.01 * p[:3], tensor + 0.1 * jnp.tensordot(p[3:], changes, 1)
    body = torque_free_to_body(jnp.asarray(TIMES), spin, moments, vectors)[0]
    return jnp.sum(weights * jnp.square(body)), body


@jax.jit
def first_derivatives(p, *given):
    """In both modes: by p of the vectors, and of their weighted sum; and the vectors."""
    slopes = jax.jacfwd(lambda p: weighted(p, *given)[1])(p)
    gradient, body = jax.grad(weighted, has_aux=True)(p, *given)
    return body, slopes, gradient


SECOND = jax.jit(jax.jacfwd(lambda p, *given: jax.grad(weighted, has_aux=True)(p, *given)[0]))


def vectors_and_changes(name):
    """Arguments of `weighted` and the number of its free parameters. A prolate body has two equal
    moments, in which nothing can be differentiated: ω alone."""
    omega, tensor = turned(*MOTIONS[name])
    rng = np.random.default_rng(4)
    vectors, weights = rng.standard_normal((2, TIMES.size, 3))
    changes = rng.standard_normal((5, 3, 3))
    changes = (changes + np.swapaxes(changes, 1, 2)) * (name != "prolate")
    return ((omega, tensor, changes), vectors, weights), 3 if name == "prolate" else 8


DIFFERENTIATED = [
    "about the largest",
    "about the smallest",
    pytest.param("prolate", marks=pytest.mark.slow),
]


@pytest.mark.parametrize("name", DIFFERENTIATED)
def test_vectors_in_the_body_and_their_first_derivatives(name):
    """Those of the attitude; derivatives in both modes, by differences."""
    given, free = vectors_and_changes(name)
    (omega, tensor, _), vectors, weights = given
    p = np.zeros(free)
    attitudes = np.asarray(RUN(TIMES, omega, tensor))
    body, along, gradient = map(np.asarray, first_derivatives(p, *given))
    np.testing.assert_allclose(body, np.einsum("tji,tj->ti", attitudes, vectors), atol=1e-12)
    for k, step in enumerate(1e-6 * np.eye(free)):
        after, before = (first_derivatives(x, *given)[0] for x in (step, -step))
        np.testing.assert_allclose(
            along[..., k], (after - before) / 2e-6, atol=1e-7 * np.abs(along).max()
        )
    both = 2.0 * np.einsum("ti,ti,tik->k", weights, body, along)
    np.testing.assert_allclose(gradient, both, rtol=1e-9, atol=1e-9 * np.abs(both).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", DIFFERENTIATED)
def test_second_derivatives_of_vectors_in_the_body(name):
    given, free = vectors_and_changes(name)
    second = np.asarray(SECOND(np.zeros(free), *given))
    for k, step in enumerate(1e-5 * np.eye(free)):
        after, before = (first_derivatives(x, *given)[2] for x in (step, -step))
        np.testing.assert_allclose(
            second[k], (after - before) / 2e-5, atol=1e-6 * np.abs(second).max()
        )


def test_precession_is_the_mean_rate_about_the_momentum():
    """The azimuth of the intermediate axis, counted over whole periods of M in the body."""
    tensor, omega = inertia(3, 2, 1), np.array([0.02, -0.05, -0.1])
    path = jax.jit(polhode)(omega, tensor)
    span = 40 * np.pi / abs(float(path.speed))
    t = np.linspace(0.0, span, 150 * TIMES.size)
    middle = np.concatenate([RUN(x, omega, tensor) for x in t.reshape(150, -1)])[:, :, 1]
    along = tensor @ omega / np.linalg.norm(tensor @ omega)
    east = np.cross(along, [0.0, 0.0, 1.0])
    angle = np.unwrap(np.arctan2(middle @ np.cross(along, east), middle @ east))
    assert (angle[-1] - angle[0]) / span == pytest.approx(float(path.precession), rel=1e-10)
    assert abs(angle[-1] - angle[0]) > 100.0


def test_elliptic_integrals_are_carlson_s():
    rng = np.random.default_rng(3)
    x, y, z = 10.0 ** rng.uniform(-6, 3, (3, 200))
    x[:5] = 0.0
    np.testing.assert_allclose(jax.jit(carlson)(x, y, z), elliprf(x**2, y**2, z**2), rtol=2e-14)


def test_prior_of_inertia_holds_bodies_alone_and_prefers_no_axes():
    rng = np.random.default_rng(0)
    for free in rng.standard_normal((8, 5)):
        with handlers.substitute(data={"inertia_base": free}), handlers.seed(rng_seed=0):
            tensor = np.asarray(priors.inertia(1.3))
        moments = np.linalg.eigvalsh(tensor)
        assert moments[2] < moments[0] + moments[1]
        second = 0.5 * np.trace(tensor) * np.eye(3) - tensor
        values, axes = np.linalg.eigh(second)
        log = (axes * np.log(values)) @ axes.T
        # the length of S is that of the sampled vector, and no rotation changes it
        assert np.sum(log**2) == pytest.approx(1.3**2 * np.sum(free**2))
        assert np.trace(log) == pytest.approx(0.0, abs=1e-9)


SCENARIO = """
[body]
shape = "cube"
side = 2.0
material = "white"
[materials.white]
law = "non-lambertian"
r_diff = 0.5
[attitude]
law = "torque-free"
omega_rad_s = [0.02, -0.01, 0.05]
inertia = [1.0, 1.6, 2.1]
yaw_deg = 20.0
roll_deg = -40.0
[geometry]
kind = "planar"
stop = 60.0
step = 2.0
omega_obs = 0.02
lambda_obs = 0.0
omega_sun = 0.001
lambda_sun = 0.5
[noise]
sigma = 1e-9
"""


@pytest.mark.slow
def test_scenario_and_model_agree_on_what_is_seen(tmp_path):
    (tmp_path / "tumbler.toml").write_text(SCENARIO)
    what = load(tmp_path / "tumbler.toml")
    assert what.attitude == TorqueFree((0.02, -0.01, 0.05), (1.0, 1.6, 2.1), 20.0, 0.0, -40.0)
    curve, truth = simulate(what, 0)
    assert np.ptp(curve.brightness) > 0.1 * curve.brightness.mean()
    spin, data = truth["attitude"], Epochs.of(curve)
    entry = registry.find("faceted")
    options = entry.check({"n_facets": 6, "spin": "torque-free"})
    problem = Problem(entry.bind(options), data)
    # the unknowns of the model are those in the middle, in the inertial axes
    tensor, omega = (np.array(spin[k]) for k in ("inertia_at_t_ref", "omega_at_t_ref_rad_s"))
    turn = integrated(np.array([0.5 * np.ptp(curve.t)]), omega, tensor)[0]
    first, momentum = tensor, tensor @ omega
    tensor = turn @ first @ turn.T
    values, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
    log = (axes * np.log(values / np.prod(values) ** (1 / 3))) @ axes.T
    sites = {
        "normals_base": jnp.array([f["normal"] for f in truth["facets"]]) @ turn.T,
        "log_albedo_area": jnp.log(jnp.array([f["albedo_area_m2"] for f in truth["facets"]])),
        "omega_unit": jnp.linalg.solve(tensor, momentum) / 0.1,
        "inertia_base": jnp.einsum("kij,ij->k", priors.TRACELESS, log),
    }
    result = compiled(problem.constrain)(problem.ravel(sites), data)
    np.testing.assert_allclose(result["flux"], truth["flux"], atol=1e-8 * max(truth["flux"]))
    np.testing.assert_allclose(result["inertia_ratio"], [1.0 / 2.1, 1.6 / 2.1], rtol=1e-9)
    pole = np.radians([float(result["pole_lon_deg"]), float(result["pole_lat_deg"])])
    along = [np.cos(pole[1]) * np.cos(pole[0]), np.cos(pole[1]) * np.sin(pole[0]), np.sin(pole[1])]
    np.testing.assert_allclose(along, spin["angular_momentum"], atol=1e-9)
    # the results are those at the first point
    np.testing.assert_allclose(result["omega"], omega, atol=1e-10)
    np.testing.assert_allclose(result["inertia"], first / np.linalg.eigvalsh(first)[-1], atol=1e-8)
    normals = np.array([f["normal"] for f in truth["facets"]])
    np.testing.assert_allclose(result["normals"], normals, atol=1e-8)


def test_moments_of_no_body_are_refused(tmp_path):
    path = tmp_path / "tumbler.toml"
    for bad in ("[1.0, 1.0, 2.5]", "[1.0, -1.0, 1.0]"):
        path.write_text(SCENARIO.replace("[1.0, 1.6, 2.1]", bad))
        with pytest.raises(InputError, match=r"line 12: attitude\.inertia .* no body has these"):
            load(path)


def test_law_turns_its_first_axes():
    law = TorqueFree((0.02, -0.01, 0.05), (1.0, 1.6, 2.1), 20.0, 10.0, -40.0)
    t = jnp.asarray(0.3 * TIMES)
    body = np.asarray(jax.jit(law.frames)(Ephemeris(t, jnp.zeros((TIMES.size, 3)))).body)
    rates = np.swapaxes(body, 1, 2)[0] @ np.array(law.omega_rad_s)
    want = integrated(np.asarray(t), rates, np.diag(law.inertia))
    np.testing.assert_allclose(body, body[0] @ want, atol=1e-10)


def test_observability_does_not_promise_what_it_does_not_count(tmp_path):
    (tmp_path / "tumbler.toml").write_text(SCENARIO)
    with pytest.raises(InputError, match="does not count the unknowns of a torque-free body"):
        Unknowns.of(load(tmp_path / "tumbler.toml"))
