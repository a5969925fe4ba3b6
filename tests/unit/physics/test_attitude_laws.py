"""Attitude laws against what defines them, published angles, and brute force."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from lcbayes.core.constants import EARTH_RATE, OBLIQUITY
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jax, jnp
from lcbayes.data import earth_shadow
from lcbayes.data.lightcurve import LightCurve
from lcbayes.data.read import read
from lcbayes.data.write import write
from lcbayes.geometry.times import Times
from lcbayes.geometry.tle import parse_tle
from lcbayes.modelling.ephemeris import (
    _fitted,
    ephemeris,
    frames,
    velocity_direction_sd_deg,
    velocity_from_places,
)
from lcbayes.physics.attitude import catalogue, laws
from lcbayes.physics.attitude.laws import (
    TARGETS,
    ConstantRate,
    Ephemeris,
    Fixed,
    PrincipalAxis,
)
from lcbayes.simulation.scenarios.scenario import load
from lcbayes.simulation.simulate import simulate

RATE = 0.00105  # rad/s, of a low orbit
INCLINED = Rotation.from_euler("ZXZ", [40.0, 63.0, 15.0], degrees=True).as_matrix()
NAMES = tuple(catalogue.LAWS)
TLE = """1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927
2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537
"""


def orbit(t: jax.Array, eccentricity: float = 0.0, season: float = 0.0) -> Ephemeris:
    """A body whose place turns in an inclined plane, and a Sun that moves by ``season`` rad/s."""
    turn = jnp.asarray(INCLINED)

    def place(t):
        r = 7000.0 * (1.0 - eccentricity * jnp.cos(RATE * t))
        return r * turn @ jnp.array([jnp.cos(RATE * t), jnp.sin(RATE * t), 0.0])

    position, velocity = jax.vmap(lambda t: jax.jvp(place, (t,), (jnp.ones(()),)))(t)
    lon = 5.5 + season * t
    sun = jnp.stack([0.6 * jnp.cos(lon), 0.6 * jnp.sin(lon), jnp.full(t.shape, 0.8)], axis=1)
    north = jnp.array([0.0, 0.0, 1.0])
    ecliptic = jnp.array([0.0, -np.sin(OBLIQUITY), np.cos(OBLIQUITY)])
    return Ephemeris(t, sun, position, velocity, north, ecliptic)


T = jnp.linspace(0.0, 5000.0, 41)
ORBIT = orbit(T, 0.1, 1e-4)


def ready(name: str) -> laws.Law:
    law = catalogue.find(name)
    return law.set(period_s=61.0) if law.spins else law


def unit(v):
    return np.asarray(v) / np.linalg.norm(v, axis=-1, keepdims=True)


@pytest.mark.parametrize("name", NAMES)
def test_axes_are_held_as_described(name):
    """A rotation; the first axis on its target, the second as near to its own as a turn allows."""
    law = ready(name)
    made = law.frames(ORBIT)
    for turn in (np.asarray(x) for x in made if x is not None):
        unity = np.broadcast_to(np.eye(3), turn.shape)
        np.testing.assert_allclose(turn.swapaxes(1, 2) @ turn, unity, atol=1e-12)
        np.testing.assert_allclose(np.linalg.det(turn), 1.0, atol=1e-12)
    body = np.asarray(made.body)
    first, second = (unit(TARGETS[target].at(ORBIT)) for _, target in (law.point, law.clock))
    sign = {"+": 1.0, "-": -1.0}
    point = sign[law.point[0][0]] * body[:, :, "xyz".index(law.point[0][1])]
    np.testing.assert_allclose(point, first, atol=1e-12)
    if law.spins:
        return
    clock = sign[law.clock[0][0]] * body[:, :, "xyz".index(law.clock[0][1])]
    best = np.full(len(T), -1.0)
    across = np.cross(point, clock)
    for angle in np.linspace(0.0, 2 * np.pi, 361):
        turned = np.cos(angle) * clock + np.sin(angle) * across
        best = np.maximum(best, np.sum(turned * second, axis=1))
    assert np.all(np.sum(clock * second, axis=1) >= best - 1e-12)


def test_lvlh_turns_once_an_orbit():
    """ω of a circular orbit is n about the orbit's normal; z is at nadir, x along the flight."""
    law = catalogue.find("lvlh")
    turn = lambda t: law.frames(orbit(t[None])).body[0]  # noqa: E731
    a, rate = jax.jvp(turn, (jnp.array(700.0),), (jnp.array(1.0),))
    spin = np.asarray(rate @ a.T)
    np.testing.assert_allclose(spin, -spin.T, atol=1e-12)
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    np.testing.assert_allclose(omega, RATE * INCLINED[:, 2], atol=1e-12)
    seen = orbit(jnp.array([700.0]))
    np.testing.assert_allclose(a[:, 0], unit(seen.velocity_km_s)[0], atol=1e-12)
    np.testing.assert_allclose(a[:, 2], -unit(seen.position_km)[0], atol=1e-12)


def test_yaw_steering_has_the_published_yaw():
    """Bar-Sever 1996, eq. (2): ψ = atan2(−tan β, sin μ), μ from orbital midnight."""
    along = orbit(T)
    sun = np.asarray(along.sun)
    beta = np.arcsin(sun[0] @ INCLINED[:, 2])
    place, flight = unit(along.position_km), unit(along.velocity_km_s)
    mu = np.arctan2(np.sum(sun * flight, 1), -np.sum(sun * place, 1))
    x = np.asarray(catalogue.find("gnss").frames(along).body)[:, :, 0]
    right = np.cross(-place, flight)  # yaw is right-handed about nadir
    yaw = np.arctan2(np.sum(x * right, 1), np.sum(x * flight, 1))
    expected = np.arctan2(-np.tan(beta), np.sin(mu))
    np.testing.assert_allclose(np.exp(1j * yaw), np.exp(1j * expected), atol=1e-12)


@pytest.mark.parametrize("name", [n for n in NAMES if catalogue.LAWS[n].array])
def test_the_array_meets_the_sun_as_squarely_as_it_can(name):
    law = catalogue.find(name)
    made = law.frames(ORBIT)
    front, hinge = (np.asarray(made.array)[:, :, i] for i in (0, 1))
    got = np.sum(front * np.asarray(ORBIT.sun), axis=1)
    axis = np.asarray(made.body)[:, :, "xyz".index(law.hinge[1])]
    if law.array == "two-axis" or name == "yaw-steering":
        np.testing.assert_allclose(got, 1.0, atol=1e-12)
    if law.array == "one-axis":
        np.testing.assert_allclose(hinge, axis, atol=1e-12)
        for angle in np.linspace(0.0, 2 * np.pi, 181):
            turned = Rotation.from_rotvec(angle * hinge).apply(front)
            assert np.all(np.sum(turned * np.asarray(ORBIT.sun), axis=1) <= got + 1e-12)
    turned = np.asarray(law.set(array_offset_deg=30.0).frames(ORBIT).array)[:, :, 0]
    expected = Rotation.from_rotvec(np.deg2rad(30.0) * hinge).apply(front)
    np.testing.assert_allclose(turned, expected, atol=1e-12)


def test_quasi_inertial_is_at_nadir_at_noon():
    along = orbit(jnp.linspace(0.0, 2 * np.pi / RATE, 2001))
    place = unit(along.position_km)
    noon = int(np.argmax(np.sum(place * np.asarray(along.sun), axis=1)))
    z = np.asarray(catalogue.find("XPOP").frames(along).body)[:, :, 2]
    assert np.degrees(np.arccos(-z[noon] @ place[noon])) < 0.2
    np.testing.assert_allclose(z, np.broadcast_to(z[0], z.shape), atol=1e-9)


def test_offsets_and_spins_against_scipy():
    settings = {"yaw_deg": 20.0, "pitch_deg": -35.0, "roll_deg": 50.0}
    offset = Rotation.from_euler("ZYX", list(settings.values()), degrees=True).as_matrix()
    plain = np.asarray(catalogue.find("lvlh").frames(ORBIT).body)
    turned = np.asarray(catalogue.find("lvlh").set(**settings).frames(ORBIT).body)
    np.testing.assert_allclose(turned, plain @ offset, atol=1e-12)
    spin = catalogue.find("gravity-gradient").set(period_s=-70.0, phase_deg=10.0, **settings)
    angle = 2 * np.pi * np.asarray(T) / -70.0 + np.deg2rad(10.0)
    about = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    body = np.asarray(spin.frames(ORBIT).body)
    np.testing.assert_allclose(body, plain @ about @ offset, atol=1e-9)


def test_classes_are_what_a_constant_turn_makes_equal():
    body = {n: np.asarray(ready(n).frames(ORBIT).body) for n in NAMES}

    def equal(a, b):
        between = body[a].swapaxes(1, 2) @ body[b]
        return np.max(np.abs(between - between[0])) < 1e-9

    for name, law in catalogue.LAWS.items():
        if law.same_as:
            assert equal(name, law.same_as), name
    rigid = [law.name for law in catalogue.distinct() if not law.array]
    assert len(rigid) >= 18
    for i, a in enumerate(rigid):
        assert not any(equal(a, b) for b in rigid[i + 1 :]), a


@pytest.mark.parametrize(
    "name", ["yaw-steering", "sun-nadir", "nadir-gimbal-array", "velocity-spin"]
)
def test_derivatives_are_finite_where_targets_meet(name):
    """Also with the Sun at the zenith, at the pole and in the flight direction."""
    law = ready(name)

    @jax.jit
    @jax.grad
    def slope(place, sun):
        made = law.frames(ORBIT._replace(position_km=place, sun=sun))
        return sum(jnp.sum(jnp.sin(x)) for x in made if x is not None)

    for sun in (ORBIT.position_km, ORBIT.velocity_km_s, 0 * ORBIT.sun + jnp.array([0.0, 0.0, 1.0])):
        assert sun is not None
        sun = sun / jnp.linalg.norm(sun, axis=1, keepdims=True)
        assert np.isfinite(np.asarray(slope(ORBIT.position_km, sun))).all()


def test_names_and_settings():
    assert catalogue.find("+XVV  +ZLV").name == "lvlh"
    names = [n for law in catalogue.LAWS.values() for n in (law.name, *law.aliases)]
    assert len(names) == len(set(names))
    law = catalogue.parse("lvlh: yaw_deg=90, roll_deg=-3")
    assert law.settings() == {"yaw_deg": 90.0, "pitch_deg": 0.0, "roll_deg": -3.0}
    assert catalogue.parse("constant-rate:x=0,y=1,z=2") == ConstantRate((0.0, 1.0, 2.0))
    spin = catalogue.parse("principal-axis:pole_lon_deg=3,pole_lat_deg=4,period_s=5")
    assert spin == PrincipalAxis(3.0, 4.0, 5.0)
    assert catalogue.parse("fixed") == Fixed()


@pytest.mark.parametrize(
    "text",
    [
        "fixed",
        "lvlh",
        "lvlh:yaw_deg=4.5,roll_deg=-0.1",
        "sun-spin:period_s=300,phase_deg=1e-07",
        "constant-rate:x=0,y=0.1,z=-2",
        "principal-axis:pole_lon_deg=1,pole_lat_deg=0,period_s=9,phase0_deg=2",
    ],
)
def test_laws_are_spelled_as_they_are_read(text):
    law = catalogue.parse(text)
    assert catalogue.spelled(law) == text
    assert catalogue.by_unique_name([law, catalogue.find("lvlh-backward"), law])[law.name] == law


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hover", r"unknown attitude law 'hover'; available: inertial, lvlh, "),
        ("lvlh:yaw=3", r"law 'lvlh' has no 'yaw'; it has yaw_deg, pitch_deg, roll_deg"),
        ("lvlh:yaw_deg", r"'yaw_deg' is not NAME=NUMBER"),
        ("sun-spin", r"spins; give its period as sun-spin:period_s=SECONDS"),
        ("sun-spin:period_s=0", r"period_s is 0"),
        ("constant-rate:x=1", r"constant-rate takes x, y, z"),
        ("fixed:x=1", r"fixed takes no settings"),
        ("principal-axis:period_s=1", r"takes .*period_s, and may take phase0_deg"),
        ("lvlh:yaw_deg=nan", r"'yaw_deg=nan' is not NAME=NUMBER"),
        ("constant-rate:x=0,y=inf,z=0", r"'y=inf' is not NAME=NUMBER"),
    ],
)
def test_faults(text, said):
    with pytest.raises(InputError, match=said) as caught:
        catalogue.parse(text)
    assert "\n" not in str(caught.value)


def seen(**changes) -> LightCurve:
    given = {
        "t": np.asarray(T),
        "brightness": np.ones(41),
        "error": None,
        "frame": "icrs",
        "sun": np.asarray(ORBIT.sun),
        "obs": np.asarray(ORBIT.sun),
    }
    return LightCurve(**(given | changes))


def test_a_curve_without_an_orbit_is_reported():
    with pytest.raises(InputError, match=r"'lvlh' needs the satellite's orbit.* has none; .*--tle"):
        frames(catalogue.find("lvlh"), seen())
    with pytest.raises(InputError, match=r"'sun-flight' needs the satellite's orbit.* has none; "):
        frames(catalogue.find("sun-flight"), seen())  # asks for no place
    with pytest.raises(InputError, match=r"'sun-north' needs to know north.*# frame: icrs"):
        frames(catalogue.find("sun-north"), seen(frame="inertial"))
    place = np.asarray(ORBIT.position_km)
    with pytest.raises(InputError, match=r"has its places but no velocity; read it with --tle"):
        frames(catalogue.find("lvlh"), seen(position_km=place))  # 125 s apart
    assert frames(catalogue.find("yaw-steering"), seen(position_km=place)).array is not None
    with pytest.raises(InputError, match=r"both must be in icrs"):
        seen(position_km=place, frame="inertial")
    with pytest.raises(InputError, match=r"velocity_km_s is given without position_km"):
        seen(velocity_km_s=place)


def iss(t) -> tuple[np.ndarray, np.ndarray]:
    return parse_tle(TLE, "iss").states(Times.of(2454730.0, t))


def coarse(t, place, degrees, km) -> np.ndarray:
    """Places as seen from a site under the middle of the pass, angles and ranges rounded."""
    site = 6371.0 * unit(place[len(t) // 2]) + np.array([100.0, 300.0, -200.0])
    turn = Rotation.from_rotvec(np.outer(t, [0.0, 0.0, EARTH_RATE]))
    line = place - turn.apply(site)
    far = np.linalg.norm(line, axis=1)
    up, right = np.arcsin(line[:, 2] / far), np.arctan2(line[:, 1], line[:, 0])
    up, right = (np.radians(np.round(np.degrees(x) / degrees) * degrees) for x in (up, right))
    line = np.stack([np.cos(up) * np.cos(right), np.cos(up) * np.sin(right), np.sin(up)], 1)
    return turn.apply(site) + (np.round(far / km) * km)[:, None] * line


def angles(a, b) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(np.sum(unit(a) * unit(b), axis=1), -1.0, 1.0)))


def velocities(t, place, curve=None) -> np.ndarray:
    result = velocity_from_places(t, place, np.zeros(len(t), int) if curve is None else curve)
    assert result is not None
    return result


@pytest.mark.parametrize("step", [0.1, 1.0, 10.0, 60.0])
def test_velocities_from_places_are_those_of_the_elements(step):
    t = np.arange(0.0, 300.1, step)
    place, motion = iss(t)
    np.testing.assert_allclose(velocities(t, place), motion, atol=4e-5)  # SGP4's own leave 2e-5


@pytest.mark.parametrize("anomaly", [0.0, 0.3, -0.3, 1.5])
def test_velocities_from_places_of_an_eccentric_orbit(anomaly):
    """Against the integrated orbit, about perigee and away from it, e = 0.7."""

    def motion(_, y):
        r = np.linalg.norm(y[:3])
        flat = np.array([1.0, 1.0, 3.0]) - 5 * (y[2] / r) ** 2
        bent = 1.5 * 1.08262668e-3 * 398600.4418 * 6378.137**2 / r**5 * y[:3] * flat
        return [*y[3:], *(-398600.4418 * y[:3] / r**3 - bent)]

    r = 6700.0 * 1.7 / (1 + 0.7 * np.cos(anomaly))
    speed = np.sqrt(398600.4418 / (6700.0 * 1.7))
    start = [
        r * np.cos(anomaly),
        r * np.sin(anomaly),
        0.0,
        -speed * np.sin(anomaly),
        speed * (0.7 + np.cos(anomaly)),
        0.0,
    ]
    start = np.concatenate([INCLINED @ start[:3], INCLINED @ start[3:]])
    t = np.arange(0.0, 200.0, 3.0)
    y = solve_ivp(motion, (0.0, 200.0), start, "DOP853", t, rtol=1e-12, atol=1e-9).y.T
    np.testing.assert_allclose(velocities(t, y[:, :3]), y[:, 3:], atol=4e-5)


@pytest.mark.parametrize(
    ("span", "step", "km", "typical", "worst"),
    [  # deg; from neighbouring points 0.18 and 0.7, 1.8 and 6.1, 1.8 and 7.2, none, none
        (300.0, 1.0, 0.1, 0.002, 0.01),
        (300.0, 1.0, 1.0, 0.02, 0.1),
        (300.0, 0.1, 0.1, 0.002, 0.01),
        (300.0, 0.1, 1.0, 0.02, 0.1),
        (10.0, 0.1, 1.0, 0.4, 0.4),
    ],
)
def test_places_that_are_rounded_give_steady_directions(span, step, km, typical, worst):
    t = np.arange(0.0, span + step / 2, step)
    place, motion = iss(t)
    seen = coarse(t, place, 1e-4, km)
    result = velocities(t, seen)
    for off in (angles(result, motion), angles(np.cross(seen, result), np.cross(place, motion))):
        assert np.median(off) < typical
        assert np.max(off) < worst


def test_how_unsure_directions_are_is_known():
    """Noise of many draws: the sd that is told is the one of the components across."""
    t = np.concatenate([np.arange(0.0, 20.0, 0.5), 9000.0 + np.arange(2)])  # a pass of two points
    place, motion = iss(t)
    errors, stated_sd = [], []
    for seed in range(60):
        noisy = place + 0.1 * np.random.default_rng(seed).standard_normal(place.shape)
        velocity, sd = _fitted(t, noisy, np.zeros(t.size, int))
        errors.append(angles(velocity, motion) / np.sqrt(2.0))
        stated_sd.append(np.degrees(sd))
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    ratio = rms / np.sqrt(np.mean(np.square(stated_sd), axis=0))
    assert np.all((ratio > 0.7) & (ratio < 1.4))
    one = seen(position_km=place[:1].repeat(41, 0), t=np.arange(41.0))
    assert velocity_direction_sd_deg(one) is None
    known = seen(position_km=place[:41], t=t[:41], velocity_km_s=motion[:41])
    assert velocity_direction_sd_deg(known) is None


def test_velocities_of_several_passes_and_curves():
    """Passes hours apart, of points in any number, rows of two objects mixed, times repeated."""
    pieces = [np.arange(0.0, 90.0, 3.0), [5400.0, 5410.0], 30000.0 + np.arange(0.0, 20.0, 7.0)]
    t = np.repeat(np.concatenate(pieces), 2)
    place, motion = iss(t)
    np.testing.assert_allclose(velocities(t, place), motion, atol=1e-4)
    other = np.arange(t.size) % 3 == 0
    place, motion = (np.where(other[:, None], v @ INCLINED.T, v) for v in iss(t))
    np.testing.assert_allclose(velocities(t, place, other * 1), motion, atol=2e-3)  # other poles
    mixed = velocity_from_places(t, place, np.zeros(t.size, int))
    assert mixed is None  # no orbit goes through both


def test_places_that_give_no_velocity():
    t = np.arange(0.0, 300.0, 10.0)
    place, _ = iss(t)
    none = np.zeros(t.size, int)
    for part in (1.05, 1.005):  # two satellites in turn
        two = place * np.where(np.arange(30) % 2, part, 1.0)[:, None]
        assert velocity_from_places(t, two, none) is None
    assert velocity_from_places(t, place, np.arange(30)) is None  # a point of each
    assert (
        velocity_from_places(np.append(t, 4000.0), iss(np.append(t, 4000.0))[0], np.zeros(31, int))
        is None
    )
    assert velocity_from_places(np.zeros(30), place, none) is None
    assert velocity_from_places(np.zeros(30), place[:1].repeat(30, 0), none) is None
    assert velocity_from_places(np.full(1, 5.0), place[:1], none[:1]) is None
    short = np.arange(0.0, 0.35, 0.1)  # 3 km of flight, ranges to 5 km
    assert velocity_from_places(short, coarse(short, iss(short)[0], 0.1, 5.0), none[:4]) is None


SCENARIO = """
[[body.facets]]
normal = [1, 0, 0]
area_m2 = 2.0
on_array = true
[[body.facets]]
normal = [0, 0, 1]
area_m2 = 3.0
on_array = false
[materials.white]
law = "lambertian"
r_diff = 0.3
[attitude]
law = "nadir-gimbal-array"
[geometry]
kind = "orbit"
tle = "box-wing.tle"
start = 2026-04-15T19:45:00Z
stop = 2026-04-15T20:10:00Z
step = 20.0
site = { lat_deg = 37.2236, lon_deg = -2.5463, height_m = 2168.0 }
max_sun_elevation_deg = -8.0
[noise]
snr = 1e9
"""


def test_a_scenario_with_an_articulated_array(tmp_path):
    """A panel that faces the Sun and a plate that faces the Earth, by hand; through a file too."""
    elements = files("lcbayes.simulation.scenarios") / "box-wing.tle"
    (tmp_path / "box-wing.tle").write_text(elements.read_text())
    path = tmp_path / "s.toml"
    path.write_text(SCENARIO)
    curve, truth = simulate(load(path))
    assert curve.position_km is not None
    nadir = -unit(curve.position_km)
    panel = np.maximum(np.sum(curve.sun * curve.obs, 1), 0.0)
    mu0, mu = (np.maximum(np.sum(v * nadir, 1), 0.0) for v in (curve.sun, curve.obs))
    intensity = 455.0 * 0.3 / np.pi * (2.0 * panel + 3.0 * mu0 * mu)
    lit = earth_shadow.share(curve)  # the first points are past the Earth's edge
    flux = (
        lit * earth_shadow.irradiance(curve) * intensity / (1e3 * np.asarray(curve.range_km)) ** 2
    )
    np.testing.assert_allclose(curve.brightness, flux, rtol=1e-6)
    assert truth["attitude"]["law"] == "nadir-gimbal-array"
    assert [f["on_array"] for f in truth["facets"]] == [True, False]
    for name in ("c.csv", "c.ecsv"):
        write(curve, tmp_path / name)
        again = read(tmp_path / name)
        np.testing.assert_array_equal(again.position_km, curve.position_km)
        np.testing.assert_array_equal(again.velocity_km_s, curve.velocity_km_s)
    path.write_text(SCENARIO.replace("on_array = true", "on_array = false"))
    with pytest.raises(InputError, match=r"no facet on the solar array .* on_array = true"):
        load(path)
    path.write_text(SCENARIO.replace("nadir-gimbal-array", "hover"))
    with pytest.raises(InputError, match=r"law is 'hover'; expected one of: constant-rate, "):
        load(path)


def test_elements_give_an_orbit():
    """Read from a file with elements, the velocity is the derivative of the place."""
    bundled = files("lcbayes.simulation.scenarios")
    curve = read(str(bundled / "box-wing.csv"), tle=str(bundled / "box-wing.tle"))
    assert curve.velocity_km_s is not None
    turned = velocity_from_places(curve.t, np.asarray(curve.position_km), curve.curve)
    assert turned is None or np.max(np.abs(turned - curve.velocity_km_s)) < 1e-3
    kept = curve.select(np.arange(5))
    np.testing.assert_array_equal(kept.velocity_km_s, curve.velocity_km_s[:5])
    assert ephemeris(replace(curve, position_km=None, velocity_km_s=None)).position_km is None
