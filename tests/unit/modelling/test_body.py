"""A body of known shape with unknown motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inference import symmetry
from lcbayes.inference.label_switching import AttitudeOrder
from lcbayes.inference.problem_cache import build_problem
from lcbayes.modelling import registry
from lcbayes.modelling.body_motion import UniformRotation, brought, matrix, product
from lcbayes.modelling.epochs import Epochs
from lcbayes.modelling.nuisances import normal_of
from lcbayes.modelling.problem import Problem, compiled
from lcbayes.models import body
from lcbayes.physics.brightness import flux_brdf
from lcbayes.simulation.known_bodies import bundled
from lcbayes.simulation.known_bodies.reader import body_text, read_body_text
from tests.helpers import turning_bodies as turning

SIDES = (1.0, 2.0, 3.0)
BOX = """
[body]
[[body.parts]]
kind = "box"
x = 1.0
y = 2.0
z = 3.0
[materials.paint]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
"""
CYLINDER = """
[body]
tolerance = 1e-4
[[body.parts]]
kind = "cylinder"
radius = 0.7
length = 3.0
material = "paint"
end_material = "end"
[materials.paint]
law = "lambertian"
r_diff = { low = 0.1, high = 0.9 }
[materials.end]
law = "lambertian"
r_diff = 0.3
"""
T, SUN, OBS = turning.geometry((0.0, 900.0), 30, 200.0)
ATTITUDE = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
ALBEDO, SIZE = 0.4, 1.3


def curve(flux: np.ndarray, seed: int = 3, snr: float = 30.0) -> LightCurve:
    error = np.full(T.size, flux.mean() / snr)
    noisy = flux + error * np.random.default_rng(seed).standard_normal(T.size)
    return LightCurve(
        t=T,
        brightness=noisy,
        error=error,
        sun=SUN,
        obs=OBS,
        frame="icrs",
        kind="flux",
        free_scale=np.array([False]),
    )


def problem_of(light: LightCurve, **given) -> tuple[Problem, Epochs, dict]:
    entry, data = registry.find("body"), Epochs.of(light)
    options = entry.check({"clock_sd": 0.0, "rate_drift_sd": 0.0, **given})
    return Problem(entry.bind(options), data), data, options


def sites_of(omega: np.ndarray, body: str, spin: str) -> dict[str, np.ndarray]:
    """Sites of the model for `ATTITUDE` at t = 0 and ω."""
    middle = Rotation.from_rotvec(0.5 * T[-1] * omega).as_matrix() @ ATTITUDE
    rate = np.linalg.norm(omega)
    file = read_body_text(body)
    reflected = file.body.areas["paint"] * ALBEDO + 0.3 * file.body.areas.get("end", 0.0)
    sites = {"log_brightness": np.log(SIZE * reflected), "paint_r_diff": np.array(ALBEDO)}
    if spin == "flat":
        axis = read_body_text(body).body.flat_axis
        sites["rate_unit"] = rate / 0.1 * np.sign(omega @ ATTITUDE @ axis)
    else:
        sites["omega_unit"] = omega / 0.1
    if spin == "free" and body == CYLINDER:
        sites["axis_base"] = (middle @ [0.0, 0.0, 1.0])[None]
    else:
        sites["attitude_base"] = Rotation.from_matrix(middle).as_quat(scalar_first=True)
    return sites


@pytest.mark.parametrize(
    ("body", "spin"), [(BOX, "flat"), (BOX, "free"), (CYLINDER, "flat"), (CYLINDER, "free")]
)
def test_density_is_that_of_an_independent_simulator(body, spin):
    if spin == "free":
        omega = np.array([0.03, -0.05, 0.02])
    else:
        omega = -0.06 * ATTITUDE @ read_body_text(body).body.flat_axis
    sun, obs = turning.in_body(T, ATTITUDE, omega, SUN, OBS)
    if body == BOX:
        flux = SIZE * turning.box(sun, obs, SIDES, ALBEDO)
    else:
        flux = SIZE * turning.cylinder(sun, obs, 0.7, 3.0, ALBEDO, 0.3)
    light = curve(flux)
    problem, data, _ = problem_of(light, body=body, spin=spin)
    free = problem.ravel({k: jnp.asarray(v) for k, v in sites_of(omega, body, spin).items()})
    assert free.size == problem.dim
    result = compiled(problem.constrain)(free, data)
    tolerance = 1e-11 if body == BOX else 2e-4
    np.testing.assert_allclose(result["expected"], flux, atol=tolerance * flux.max())
    np.testing.assert_allclose(result["omega"], omega, rtol=1e-12)
    np.testing.assert_allclose(
        sum(compiled(problem.log_likelihood)(free, data)),
        norm.logpdf(light.brightness, flux, light.error).sum(),
        atol=0.2 if body != BOX else 1e-7,
    )
    if spin == "flat":
        np.testing.assert_allclose(result["attitude"], ATTITUDE, atol=1e-12)


def test_each_observer_sees_the_body_at_the_true_times_of_its_clock():
    omega, late = -0.06 * ATTITUDE @ read_body_text(BOX).body.flat_axis, np.array([0.4, -1.9])
    observer = np.arange(T.size) % 2
    sun, obs = turning.in_body(T + late[observer], ATTITUDE, omega, SUN, OBS)
    flux = SIZE * turning.box(sun, obs, SIDES, ALBEDO)
    light = replace(curve(flux), site=np.array(["A", "B"])[observer])
    problem, data, _ = problem_of(light, body=BOX, clock_sd=0.3, zero_point_sd=0.0)
    still = replace(data, sun_rate=0.0 * data.sun, obs_rate=0.0 * data.obs)
    sites = sites_of(omega, BOX, "flat")
    ahead = Rotation.from_rotvec(late[0] * omega).as_quat(scalar_first=True)
    sites["attitude_base"] = np.asarray(product(ahead, sites["attitude_base"]))
    sites["clock_offset_unit"] = np.asarray(normal_of(np.array([*late, 0.0]) / 0.3))
    free = problem.ravel({k: jnp.asarray(v) for k, v in sites.items()})
    result = compiled(problem.constrain)(free, still)
    np.testing.assert_allclose(result["expected"], flux, atol=1e-11 * flux.max())
    np.testing.assert_allclose(result["attitude"], ATTITUDE, atol=1e-12)


def test_sizes_may_be_unknown():
    body = CYLINDER.replace("length = 3.0", "length = { median = 2.5, factor = 1.5 }")
    file = read_body_text(body)
    omega = 0.05 * ATTITUDE @ file.body.flat_axis
    sun, obs = turning.in_body(T, ATTITUDE, omega, SUN, OBS)
    flux = SIZE * turning.cylinder(sun, obs, 0.7, 3.0, ALBEDO, 0.3)
    problem, data, _ = problem_of(curve(flux), body=body)
    sites = sites_of(omega, body, "flat") | {"log_cylinder_length": np.log(3.0)}
    free = problem.ravel({k: jnp.asarray(v) for k, v in sites.items()})
    result = compiled(problem.constrain)(free, data)
    np.testing.assert_allclose(result["expected"], flux, atol=1e-6 * flux.max())
    assert result["cylinder_length"] == pytest.approx(3.0)
    slope = compiled(problem.slope)(free, data)
    assert np.all(np.isfinite(slope))
    change = np.zeros(problem.dim)
    change[problem.rows(["log_cylinder_length"])] = 1e-5
    at = compiled(problem.potential)
    numeric = (at(free + change, data) - at(free - change, data)) / 2e-5
    assert slope @ change / 1e-5 == pytest.approx(float(numeric), rel=1e-5)


def test_largest_inertia_is_about_the_shortest_side():
    assert np.abs(read_body_text(BOX).body.flat_axis).tolist() == [1.0, 0.0, 0.0]
    axis = read_body_text(CYLINDER).body.flat_axis
    assert abs(axis[2]) < 1e-12
    other = BOX.replace("[body]", "[body]\nspin_axis = [0, 0, -2]")
    assert read_body_text(other).body.flat_axis.tolist() == [0.0, 0.0, -1.0]


def test_symmetry_of_bodies():
    box = read_body_text(BOX).body.symmetry
    assert box.axis is None
    assert len(box.rotations) == len(box.reflections) == 4
    np.testing.assert_array_equal(box.rotations[0], np.eye(3))
    cylinder = read_body_text(CYLINDER).body.symmetry
    assert cylinder.axis is not None
    assert abs(cylinder.axis[2]) == 1.0
    plate = read_body_text(body_text("plate")).body.symmetry
    assert plate.axis is not None  # of a flat face, only the normal matters
    wings = read_body_text(body_text("box-wing")).body.symmetry
    assert wings.axis is None
    assert len(wings.rotations) == 2  # half a turn about the normal of the wings


def test_shadows_break_a_symmetry():
    """Without shadows, only the normals of the wing matter, and not on which side it is."""
    one = body_text("box-wing")
    start = one.rindex("[[body.parts]]")
    lone = one[:start] + one[one.index("[materials.bus]") :]
    assert len(read_body_text(lone).body.symmetry.rotations) == 1
    apart = lone.replace("shadows = true", "shadows = false")
    assert len(read_body_text(apart).body.symmetry.rotations) == 2


@pytest.mark.parametrize(("body", "spin", "count"), [(BOX, "flat", 8), (CYLINDER, "free", 2)])
def test_equivalent_attitudes_have_the_same_density(body, spin, count):
    light = curve(1.0 + 0.3 * np.sin(0.1 * T))
    problem, data, options = problem_of(light, body=body, spin=spin)
    equivalents = registry.find("body").hook("equivalents")
    assert equivalents is not None
    order = AttitudeOrder(problem, equivalents(**options))
    assert order.log_orders == pytest.approx(np.log(count))
    z = np.asarray(problem.prior_draw(jax.random.key(1), data))
    at = compiled(problem.potential)
    images = order.images(z[None])[0]
    values = [float(at(jnp.asarray(image), data)) for image in images]
    np.testing.assert_allclose(values, values[0], rtol=3e-4 if body == CYLINDER else 1e-10)
    for image in images:
        np.testing.assert_allclose(order.like(image, z), z, atol=1e-12)
    assert np.linalg.norm(images[-1] - z) > 0.1


def one_pass() -> LightCurve:
    """The first quarter of a pass, in which the bisector moves by nine degrees."""
    t, sun, obs = (x[:30] for x in turning.geometry((0.0,), 120, 200.0))
    flux = 1.0 + 0.3 * np.sin(0.1 * t)
    return LightCurve(t=t, brightness=flux, error=0.05 + 0.0 * t, sun=sun, obs=obs)


def test_turn_about_the_bisector_is_a_coordinate_of_one_pass():
    light = one_pass()
    entry = registry.find("body")
    data = Epochs.of(light)
    plain, turned = build_problem(entry, entry.check({"body": BOX}), data)
    assert turned is not plain
    z = plain.prior_draw(jax.random.key(1), data)
    y = np.asarray(turned.ravel(plain.constrain(z, data)))
    both = np.asarray(data.sun + data.obs)
    bisector = (both / np.linalg.norm(both, axis=1, keepdims=True)).mean(axis=0)
    about = Rotation.from_rotvec(0.6 * bisector / np.linalg.norm(bisector))
    sites = {k: np.asarray(plain.constrain(z, data)[k]) for k in plain.names}
    q = about.as_quat(scalar_first=True)
    sites["attitude_base"] = np.asarray(product(q, sites["attitude_base"]))
    moved = np.asarray(turned.ravel({k: jnp.asarray(v) for k, v in sites.items()}))
    rows = turned.rows(["attitude_base"])
    np.testing.assert_allclose(moved[rows[:2]], y[rows[:2]], atol=1e-12)
    angle = [np.arctan2(x[rows[3]], x[rows[2]]) for x in (y, moved)]
    assert np.sin(angle[1] - angle[0] - 0.3) == pytest.approx(0.0, abs=1e-12)
    unturned = compiled(plain.potential)(z, data)
    density = compiled(turned.potential)(jnp.asarray(y), data)
    jacobian = jax.jacfwd(lambda y: plain.ravel(turned.constrain(y, data)))(jnp.asarray(y))
    assert float(density) == pytest.approx(
        float(unturned) - np.linalg.slogdet(jacobian)[1], rel=1e-10
    )


def test_turned_coordinates_keep_equivalent_attitudes():
    entry = registry.find("body")
    data = Epochs.of(one_pass())
    options = entry.check({"body": BOX})
    _, turned = build_problem(entry, options, data)
    hook = entry.hook("equivalents")
    assert hook is not None
    order = AttitudeOrder(turned, hook(**options))
    z = np.asarray(turned.prior_draw(jax.random.key(1), data))
    images = order.images(z[None])[0]
    assert len(images) == 8
    expected = [np.asarray(turned.constrain(x, data)["expected"]) for x in images]
    np.testing.assert_allclose(expected, np.tile(expected[0], (8, 1)), rtol=1e-9)
    for image in images:
        np.testing.assert_allclose(order.like(image, z), z, atol=1e-9)


def test_moving_bisector_keeps_the_quaternion():
    entry = registry.find("body")
    data = Epochs.of(curve(1.0 + 0.3 * np.sin(0.1 * T)))
    two = CYLINDER.replace("r_diff = 0.3", "r_diff = { low = 0.1, high = 0.9 }")
    own = body.coordinates(data, **entry.check({"body": two}))
    assert own is not None
    assert "attitude_base" not in own


@pytest.mark.parametrize(("body", "spin"), [(BOX, "flat"), (BOX, "free"), (CYLINDER, "free")])
def test_reflection_in_the_plane_of_sun_and_observer(body, spin):
    """It gives another motion of the same density, where all directions are in one plane."""
    light = curve(1.0 + 0.3 * np.sin(0.1 * T))
    assert symmetry.plane_normal(Epochs.of(light)) is None
    angle = 0.4 + T / 900.0
    flat = np.stack([np.cos(angle), 0.6 * np.sin(angle), 0.8 * np.sin(angle)], axis=1)
    light = replace(light, sun=np.tile([1.0, 0.0, 0.0], (T.size, 1)), obs=flat)
    problem, data, options = problem_of(light, body=body, spin=spin)
    hook = registry.find("body").hook("mirrored")
    move = symmetry.mirror_of(problem, data, hook, options)
    assert move is not None
    z = np.asarray(problem.prior_draw(jax.random.key(1), data))
    at = compiled(problem.potential)
    one, other = (float(at(jnp.asarray(v), data)) for v in (z, move @ z))
    assert other == pytest.approx(one, rel=3e-4 if body == CYLINDER else 1e-10)
    omega = [compiled(problem.constrain)(jnp.asarray(v), data)["omega"] for v in (z, move @ z)]
    assert np.linalg.norm(omega[0] - omega[1]) > 0.01
    np.testing.assert_allclose(move @ move @ z, np.sign((move @ move)[0, 0]) * z, atol=1e-12)


def test_shadows_are_those_of_the_assembly():
    known = read_body_text(body_text("box-wing")).body
    body = known.assembly.body
    rng = np.random.default_rng(5)
    sun, obs = rng.standard_normal((2, 20, 3))
    sun, obs = (
        jnp.asarray(v / np.linalg.norm(v, axis=1, keepdims=True)) for v in (sun, sun + 0.7 * obs)
    )

    @jax.jit
    def fluxes(sun, obs):
        whole = known.flux(sun, obs, shadows=False)
        return known.flux(sun, obs), whole, known.assembly.lit_and_seen(sun, obs)

    shaded, whole, visible = fluxes(sun, obs)
    expected = np.zeros(20)
    for i, label in enumerate(body.labels):
        material = known.materials[label]
        normal, area, u = (jnp.asarray(x[[i]]) for x in (body.normals, body.areas, body.u_axes))
        alone = flux_brdf(sun, obs, normal, area, material.law, material.parameters, u)
        expected += np.asarray(visible[:, i] * alone)
    np.testing.assert_allclose(shaded, expected, rtol=1e-10)
    assert np.max(np.asarray(whole - shaded)) > 0.05 * np.max(np.asarray(whole))


def test_rotations_are_uniform_and_quaternions_are_right():
    law = UniformRotation()
    draws = law.sample(jax.random.key(0), (20_000,))
    turned = jax.vmap(matrix)(draws)
    assert np.abs(np.asarray(turned).mean(axis=0)).max() < 5.0 / np.sqrt(3 * 20_000)
    q, p = draws[:2]
    expected = Rotation.from_quat(np.asarray(q), scalar_first=True)
    np.testing.assert_allclose(matrix(q), expected.as_matrix(), atol=1e-12)
    both = matrix(product(p, q))
    np.testing.assert_allclose(both, matrix(p) @ matrix(q), atol=1e-12)
    end = jnp.array([0.0, 0.6, -0.8])
    np.testing.assert_allclose(brought([1.0, 0.0, 0.0], end) @ jnp.array([1.0, 0, 0]), end)
    # the density is normalised: its mean over a Gaussian proposal is one
    unit = jax.random.normal(jax.random.key(1), (200_000, 4)) * 0.6
    log_q = norm.logpdf(np.asarray(unit), 0.0, 0.6).sum(axis=1)
    weights = np.exp(np.asarray(law.log_prob(unit)) - log_q)
    assert weights.mean() == pytest.approx(1.0, abs=5.0 * weights.std() / np.sqrt(200_000))


def test_bundled_bodies_can_be_read():
    assert {"box-wing", "cube-satellite", "plate", "rocket-stage", "sphere"} <= set(bundled())
    for name in bundled():
        file = read_body_text(body_text(name))
        assert file.title
        assert any(file.priors.values())


FAULTS = [
    ({"body": "no-such-body"}, "no file and no body"),
    ({"body": "sphere"}, "same in every attitude"),
    ({"body": "plate"}, "symmetric about the axis of its flat spin"),
    ({"body": BOX.replace("low = 0.1", "low = 1.1")}, "low"),
    ({"body": BOX.replace("low = 0.1, high = 0.9", "median = 0.4, factor = 2")}, "above 1"),
    ({"body": BOX.replace("{ low = 0.1, high = 0.9 }", "2.0")}, "r_diff"),
    ({"body": BOX.replace('kind = "box"', 'kind = "mesh"')}, "mesh"),
    (
        {"body": body_text("box-wing").replace("x = 1.5 ", "x = { low = 1.0, high = 2.0 } ")},
        "parts of known size",
    ),
    ({"body": BOX.replace("[body]", "[body]\nspin_axis = [0, 0, 0]")}, "spin_axis"),
    ({"body": "[materials.a]\nlaw = 'lambertian'\nr_diff = 0.1\n[body]\n"}, "parts"),
]


@pytest.mark.parametrize(("given", "text"), FAULTS)
def test_faults_are_named(given, text):
    with pytest.raises(InputError, match=text):
        problem_of(curve(np.ones(T.size)), **given)
