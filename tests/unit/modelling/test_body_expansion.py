"""The brightness of a known body near one solution, as a polynomial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import search
from lcbayes.modelling import body_expansion, registry
from lcbayes.modelling.body_expansion import BodyExpansion
from lcbayes.modelling.body_motion import Motion
from lcbayes.modelling.constrained import potentials
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import body
from lcbayes.samplers.chains import Whitening
from lcbayes.simulation.known_bodies import reflectances
from lcbayes.simulation.known_bodies.reader import read_body_text
from tests.helpers.shaded_bar import ALBEDO, ATTITUDE, OMEGA, T, bar, curve, shaded_flux

PART = """[[body.parts]]
kind = "box"
x = 1.0
y = {}
z = {}
position = [{}, 0.0, 0.0]
material = "{}"
"""
MATERIALS = ("glossy", "paint", "dust", "metal", "known")
LENGTHS = ("LENGTH", 0.7, 0.8, 0.9, 1.0)
PARTS = "".join(
    PART.format(1.5 - 0.2 * i, LENGTHS[i], 3.0 * i, name) for i, name in enumerate(MATERIALS)
)
LAWS = (
    f"[body]\nshadows = false\n{PARTS}"
    + """
[materials.glossy]
law = "ashikhmin-shirley"
r_diff = { low = 0.1, high = 0.9 }
r_spec = { low = 0.0, high = 0.5 }
nu = { median = 10.0, factor = 2.0 }
[materials.paint]
law = "blinn-phong"
r_diff = { low = 0.2, high = 0.8 }
r_spec = 0.1
n = 20.0
[materials.dust]
law = "lommel-seeliger-lambert"
w = { low = 0.1, high = 0.9 }
[materials.metal]
law = "cook-torrance"
r_diff = { low = 0.1, high = 0.4 }
r_spec = { low = 0.1, high = 0.5 }
m = 0.2
[materials.known]
law = "lambertian"
r_diff = 0.4
"""
)


def cubic(p: np.ndarray) -> np.ndarray:
    """Three light curves of five points, polynomials of third degree in p (n, 2), (n, 3, 5)."""
    x, y = (p.T / np.array([[1e-6], [2.0]]))[..., None, None]
    t = np.linspace(0.0, 1.0, 5)
    k = np.arange(1.0, 4.0)[:, None]
    return k + t * x - k * y**2 + t**2 * x * y / k + x**3 - t * k * x * y**2


def test_a_polynomial_of_third_degree_is_found() -> None:
    """Variables of very different widths, and strongly correlated ones."""
    rng = np.random.default_rng(1)
    first = rng.standard_normal((60, 2))
    p = np.stack([1e-6 * first[:, 0], 2.0 * (first[:, 0] + 0.01 * first[:, 1])], axis=1)
    w = rng.uniform(size=(60, 3))
    made = BodyExpansion.of(jnp.eye(3), *(jnp.asarray(x) for x in (p[:40], w[:40], cubic(p[:40]))))
    found = np.stack([made(jnp.asarray(a), jnp.asarray(b)) for a, b in zip(p, w, strict=True)])
    right = np.einsum("nk,nkt->nt", w, cubic(p))
    np.testing.assert_allclose(found, right, atol=1e-5 * np.abs(right).max())


def test_many_variables_have_a_polynomial_of_second_degree() -> None:
    assert body_expansion.number_of_monomials(4) == 35
    assert body_expansion.number_of_monomials(10) == 286
    assert body_expansion.number_of_monomials(11) == 78


@pytest.mark.parametrize("length", ["0.7", "{ median = 0.7, factor = 1.3 }"])
def test_brightness_is_a_sum_of_bright_and_dark_materials(length: str) -> None:
    file = read_body_text(LAWS.replace("LENGTH", length))
    rng = np.random.default_rng(2)
    n = 40
    sun, obs = rng.standard_normal((2, n, 3))
    obs += sun
    sun, obs = (jnp.asarray(v / np.linalg.norm(v, axis=1)[:, None]) for v in (sun, obs))
    values = {
        "glossy": {"r_diff": 0.3, "r_spec": 0.2, "nu": 7.0},
        "paint": {"r_diff": 0.6},
        "dust": {"w": 0.5},
        "metal": {"r_diff": 0.2, "r_spec": 0.4},
    }
    sizes = {(0, "z"): 0.9} if file.sizes else {}
    ends = reflectances.corners(file)

    def seen(i: int) -> np.ndarray:
        given = {
            name: {**own, **{k: v[i] for k, v in ends.get(name, {}).items()}}
            for name, own in values.items()
        }
        return np.asarray(file.body.flux(sun, obs, given, sizes=sizes))

    weights = np.asarray(reflectances.weights(file, values))
    assert len(weights) == 1 + 3 + 1 + 1
    total = sum(w * seen(i) for i, w in enumerate(weights))
    right = np.asarray(file.body.flux(sun, obs, values, sizes=sizes))
    np.testing.assert_allclose(total, right, rtol=1e-12, atol=1e-15)
    shape = reflectances.shape_of(file, values, sizes)
    assert list(shape) == [np.log(7.0), 0.2, 0.4, *([np.log(0.9)] if file.sizes else [])]


def test_coordinates_of_a_motion_are_small_turns_in_body_axes() -> None:
    turn = np.array([1e-4, -2e-4, 3e-4])
    attitude = ATTITUDE @ Rotation.from_rotvec(turn).as_matrix()
    axis = np.array([0.6, 0.0, 0.8])
    omega = 0.2 * attitude @ axis
    motion = Motion(*(jnp.asarray(x) for x in (attitude, omega, [1.0, 2.0, 9.0], 0.01)))
    middle = jnp.asarray(ATTITUDE)
    flat = np.asarray(motion.near(middle, axis, None))
    np.testing.assert_allclose(flat, [*turn, 0.2, 0.01, 1.0, 2.0 - 1.0], atol=1e-10)
    free = np.asarray(motion._replace(offsets=None, drift=None).near(middle, None, axis))
    assert free.shape == (5,)
    np.testing.assert_allclose(free[2:], omega)
    across = turn - (turn @ axis) * axis
    np.testing.assert_allclose(np.linalg.norm(free[:2]), np.linalg.norm(across), rtol=1e-6)


def solution(text: str, light: LightCurve, **given: object):
    """Problem, data, options and the optimum reached from the true motion of the bar."""
    entry, data = registry.find("body"), Epochs.of(light)
    options = entry.check({"body": text, **given})
    problem = Problem(entry.bind(options), data)
    z = np.asarray(problem.prior_draw(jax.random.key(0), data))
    sites = {k: np.asarray(v) for k, v in compiled(problem.constrain)(z, data).items()}
    middle = Rotation.from_rotvec(float(data.t_middle) * OMEGA) * Rotation.from_matrix(ATTITUDE)
    unit = 0.1
    known = {"attitude_base": middle.as_quat(scalar_first=True), "paint_r_diff": ALBEDO}
    known = {k: v for k, v in known.items() if k in sites}
    if "rate_unit" in sites:
        known["rate_unit"] = np.linalg.norm(OMEGA) / unit
    else:
        known["omega_unit"] = OMEGA / unit
    faults = {k: 0.0 * sites[k] for k in problem.names if k.endswith(("offset_unit", "drift_unit"))}
    start = {k: sites[k] for k in problem.names} | faults | known
    row = np.asarray(problem.ravel({k: jnp.asarray(v, float) for k, v in start.items()}))
    ends = search.polish(problem, data, row[None], 1)
    return problem, data, options, np.asarray(ends.z[0])


@pytest.mark.slow
def test_a_body_of_known_surface_has_an_expansion(monkeypatch) -> None:
    monkeypatch.setattr(body, "MANY", 0)
    text = bar(shadows=True).replace("{ low = 0.1, high = 0.9 }", str(ALBEDO))
    problem, data, options, z = solution(text, curve(shaded_flux(), 200.0))
    guide = body.guide(problem, data, **options)
    assert guide is not None
    at, about = jnp.asarray(z), guide(z)
    np.testing.assert_allclose(problem.flux_at(at, about), problem.flux_at(at, data), atol=1e-2)
    monkeypatch.setattr(body, "MOST_OBSERVERS", 0)
    assert body.guide(problem, data, **options) is None


def two_observers(light: LightCurve) -> LightCurve:
    names = np.where(np.arange(T.size) % 2 == 0, "north", "south")
    return replace(light, site=names, exposure_s=np.full(T.size, 0.5))


@pytest.mark.parametrize(
    ("spin", "observers"),
    [("flat", 2), *(pytest.param(spin, 1, marks=pytest.mark.slow) for spin in ("flat", "free"))],
)
def test_the_density_is_nearly_that_of_the_guide(monkeypatch, spin, observers) -> None:
    monkeypatch.setattr(body, "MANY", 0)
    light = curve(shaded_flux(), 200.0)
    if observers == 2:
        light = two_observers(light)
    problem, data, options, z = solution(bar(shadows=True), light, spin=spin)
    guide = body.guide(problem, data, **options)
    assert guide is not None
    about = guide(z)
    assert about.expansion is not None
    factor = Whitening.at(problem, z, data).factor
    rng = np.random.default_rng(3)
    rows = z + rng.standard_normal((100, problem.dim)) @ np.asarray(factor).T
    exact, expanded = (potentials(problem, rows, x) for x in (data, about))
    change = expanded - exact
    assert change.std() < 0.1
    assert exact.std() > 2.0
    held, right = (np.asarray(problem.flux_at(jnp.asarray(z), x)) for x in (about, data))
    np.testing.assert_allclose(held, right, atol=2e-3 * held.max())
