"""Scenario files: what is read from them, and what is said of those that are at fault."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from lcbayes.core.errors import InputError
from lcbayes.simulation.scenarios.scenario import ConstantRate, Fixed, PrincipalAxis, load
from lcbayes.simulation.scenarios.viewing import Orbit, Planar, Vectors
from tests.helpers.file_readers import TLE

DESIGN = """\
[[body.facets]]
normal = [0, 0, 2]
area_m2 = 2.0
material = "panel"
[[body.facets]]
phi = 1.5707963267948966
g = 0.0
u = [0, 0, 3]
area_m2 = 1.0
[materials.panel]
law = "ashikhmin-shirley"
r_spec = 0.5
r_diff = 0.3
nu = 800.0
nv = 300.0
[attitude]
law = "constant-rate"
omega_rad_s = [0.1, 0.0, 0.02]
[geometry]
kind = "planar"
stop = 10
step = 0.5
omega_obs = 0.1
lambda_obs = 0.0
omega_sun = 0.0
lambda_sun = 0.2
[noise]
sigma = 0.1
"""
PLANAR = DESIGN[DESIGN.index("[geometry]") : DESIGN.index("[noise]")]


@pytest.fixture
def write(tmp_path):
    def save(text: str, name: str = "s.toml"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return save


def test_the_example_of_the_design(write):
    scenario = load(write(DESIGN))
    assert scenario.name == "s"
    np.testing.assert_allclose(scenario.body.normals, [[0, 0, 1], [0, 1, 0]], atol=1e-15)
    assert scenario.body.areas.tolist() == [2.0, 1.0]
    np.testing.assert_allclose(scenario.body.u_axes[1], [0, 0, 1])
    assert scenario.body.labels == ("panel", "panel")
    assert scenario.materials["panel"].law == "ashikhmin-shirley"
    assert scenario.materials["panel"].parameters["nv"] == 300.0
    assert scenario.attitude == ConstantRate((0.1, 0.0, 0.02))
    assert isinstance(scenario.geometry, Planar)
    assert scenario.geometry.passes[0].plane == "xy"
    assert (scenario.noise.kind, scenario.noise.value, scenario.kind) == ("sigma", 0.1, "flux")


def test_passes_take_from_the_geometry_what_they_leave_out(write):
    passes = PLANAR + '[[geometry.passes]]\n[[geometry.passes]]\nplane="yz"\nstart=5\nstep=1\n'
    geometry = load(write(DESIGN.replace(PLANAR, passes))).geometry
    assert isinstance(geometry, Planar)
    first, second = geometry.passes
    assert (first.plane, first.start, first.step) == ("xy", 0.0, 0.5)
    assert (second.plane, second.start, second.stop, second.step) == ("yz", 5.0, 10.0, 1.0)
    assert second.lambda_sun == 0.2


def test_attitude_laws(write):
    head, tail = DESIGN.split("[attitude]\n")[0], DESIGN[DESIGN.index("[geometry]") :]
    spin = "pole_lon_deg = 10\npole_lat_deg = -20\nperiod_h = 0.5\n"
    law = load(write(f'{head}[attitude]\nlaw = "principal-axis"\n{spin}{tail}')).attitude
    assert law == PrincipalAxis(10.0, -20.0, 1800.0, 0.0)
    assert load(write(f'{head}[attitude]\nlaw = "fixed"\n{tail}')).attitude == Fixed()


def test_shapes_take_materials_from_their_parts(write):
    body = '[body]\nshape = "box-wing"\nmaterial = "panel"\nwing = [4, 1]\n'
    bus = '[materials.bus]\nlaw = "lambertian"\nr_diff = 0.5\n'
    text = body + bus + DESIGN[DESIGN.index("[materials.panel]") :]
    result = load(write(text)).body
    assert result.labels == ("bus",) * 6 + ("panel", "panel")
    assert result.areas[6] == 4.0


def test_body_from_an_obj_file(write):
    write("v 0 0 0\nv 1 0 0\nv 0 2 0\nusemtl panel\nf 1 2 3\n", "body.obj")
    text = '[body]\nfile = "body.obj"\n' + DESIGN[DESIGN.index("[materials") :]
    result = load(write(text)).body
    assert result.areas.tolist() == [1.0]
    assert result.normals.tolist() == [[0.0, 0.0, 1.0]]


def test_orbit_and_vectors(write):
    orbit = """[geometry]
kind = "orbit"
tle = '''
1 99001U 26001A   26105.50000000  .00000120  00000-0  60000-4 0  9990
2 99001  98.1500 158.4316 0011000  90.0000  20.0000 14.60983543  1201
'''
site = { lat_deg = 37.2, lon_deg = -2.5 }
start = 2026-04-15T21:45:00+02:00
stop = "2026-04-15T20:00:00Z"
step = 4
"""
    geometry = load(write(DESIGN.replace(PLANAR, orbit))).geometry
    assert isinstance(geometry, Orbit)
    assert geometry.passes[0].start == datetime(2026, 4, 15, 19, 45, tzinfo=UTC)
    assert geometry.passes[0].site.height_m == 0.0
    vectors = '[geometry]\nkind = "vectors"\nfile = "g.csv"\n'
    path = write(DESIGN.replace(PLANAR, vectors))
    assert load(path).geometry == Vectors(path.parent / "g.csv")


def test_magnitudes_are_written_where_the_noise_is_one(write):
    text = DESIGN.replace("sigma = 0.1", "mag_err = 0.05").replace("step", "range_km = 700\nstep")
    scenario = load(write(text))
    assert (scenario.kind, scenario.band) == ("mag", "V")


FAULTS = {
    "syntax": ("area_m2 = 2.0", "area_m2 = ", r"s\.toml, line 3, column 11: not TOML"),
    "misspelt": ("nu = 800", "n_u = 800", r"line 10: materials\.panel has no 'nu' .*'n_u'"),
    "unknown key": ("sigma = 0.1", "sigma = 0.1\nseed = 1", r"noise\.seed is not a key .* known"),
    "unknown table": ("[noise]", "[noises]\n[noise]", r"line 27: noises is not .* 'noise'"),
    "text for number": ("= 800.0", '= "8"', r"line 14: materials\.panel\.nu is '8'; expected a nu"),
    "not finite": ("= 800.0", "= nan", r"materials\.panel\.nu is nan; expected a number >= 0"),
    "out of bounds": ("r_spec = 0.5", "r_spec = 1.5", r"line 12: .*r_spec is 1\.5; .* <= 1$"),
    "boolean": ("= 800.0", "= true", r"nu is True; expected a number"),
    "law": ("ashikhmin-shirley", "phong", r"law is 'phong'; expected one of: lambertian, "),
    "no material": ('material = "panel"', 'material = "x"', r"is 'x'; expected one of: panel"),
    "area": ("area_m2 = 2.0", "area_m2 = 0", r"line 3: body\.facets\[1\]\.area_m2 is 0; .* > 0"),
    "zero normal": ("[0, 0, 2]", "[0, 0, 0]", r"normal has length zero"),
    "two numbers": ("[0, 0, 2]", "[0, 2]", r"is \[0, 2\]; expected a list of 3 numbers"),
    "u out of plane": ("[0, 0, 3]", "[0, 1, 3]", r"line 8: body\.facets\[2\]\.u is .* plane"),
    "no facets": (DESIGN[: DESIGN.index("[mat")], "[body]\n", r"line 1: body needs one of"),
    "two bodies": ("[materials", '[body]\nshape="cube"\n[materials', r"'facets' and 'shape'"),
    "attitude": ('"constant-rate"', '"tumble"', r"attitude\.law is 'tumble'; expected one of: con"),
    "backwards": ("stop = 10", "stop = -1", r"line 21: geometry\.stop is before start"),
    "too many": (
        "step = 0.5",
        "step = 1e-9",
        r"line 22: geometry.step is 1e-09, more than 1,000,000",
    ),
    "plane": ("step = 0.5", 'step = 1\nplane = "xz"', r"is 'xz'; expected one of: xy, yz, zx"),
    "no noise": ("sigma = 0.1", "", r"line 27: noise needs one of .*; it has none of them"),
    "two noises": ("sigma = 0.1", "sigma = 1\nsnr = 2", r"it has 'sigma' and 'snr'"),
    "mag, sigma": ("[noise]", '[output]\nkind = "mag"\n[noise]', r"noise\.sigma is a flux, but"),
    "mag, no range": ("sigma = 0.1", "mag_err = 0.1", r"geometry has no 'range_km'; a magnitude"),
    "dates": ('"planar"', '"orbit"\ntle = "t.tle"', r"t\.tle does not exist"),
    "beyond the floats": ("step = 0.5", f"step = 1{'0' * 400}", r"line 22: geometry\.step is 1000"),
    "beyond int()": ("step = 0.5", f"step = 1{'0' * 5000}", r"line 22: a number of over 4300 dig"),
    "beyond repr()": ("step = 0.5", f"step = 0x{'f' * 5000}", r"step is a number too long to show"),
    "huge sigma": (
        "sigma = 0.1",
        "sigma = 1e308",
        r"line 28: noise\.sigma is 1e\+308; .* <= 1e\+30",
    ),
    "huge rate": ("omega_obs = 0.1", "omega_obs = 1e308", r"omega_obs is 1e\+308; .* <= 1000"),
    "huge turn": ("[0.1, 0.0, 0.02]", "[1e308, 0, 0]", r"omega_rad_s is .* from -1000 to 1000"),
    "huge normal": ("[0, 0, 2]", "[0, 1e308, 1e308]", r"normal is .* from -1e\+06 to 1e\+06"),
    "null byte": ('"panel"', '"a\\u0000b"', r"material is 'a\\x00b'; expected one of: panel"),
    "null byte in a name": (
        '"planar"',
        '"vectors"\nfile = "a\\u0000b"',
        r"geometry.file is 'a\\x00b'; .* without null bytes",
    ),
    "pass key": ("[noise]", '[[geometry.passes]]\nkind = "planar"\n[noise]', r"kind is not a key"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_named(write, fault):
    """One line: file, line where it can be told, table and key, what is expected."""
    old, new, message = FAULTS[fault]
    assert old in DESIGN
    with pytest.raises(InputError, match=message) as caught:
        load(write(DESIGN.replace(old, new, 1)))
    assert "s.toml" in str(caught.value) or "t.tle" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ('"sphere"\nradius = 1e300', r"line 3: body\.radius is 1e\+300; .* <= 1e\+06"),
        ('"box-wing"\nwing = [1e300, 1]', r"line 3: body\.wing is .* from -1e\+06 to 1e\+06"),
        ('"box-wing"\nwing = [1e-300, 1]', r"line 3: body\.wing is .* expected lengths >= 1e-06"),
    ],
)
def test_sizes_are_those_of_bodies(write, shape, message):
    text = DESIGN[DESIGN.index("[materials") :]
    with pytest.raises(InputError, match=message):
        load(write(f"[body]\nshape = {shape}\n{text}"))


def test_instants_outside_the_calendar_are_named(write):
    dates = 'tle = "t.tle"\nstart = 0001-01-01T00:00:00+10:00\nstop = 2024-01-01\n'
    site = "site = {lat_deg = 1, lon_deg = 1}\n"
    path = write(DESIGN.replace(PLANAR, f'[geometry]\nkind = "orbit"\n{dates}step = 1\n{site}'))
    (path.parent / "t.tle").write_text(TLE)
    with pytest.raises(
        InputError, match=r"geometry\.start is 0001-01-01 .*an instant in UTC, 1900"
    ):
        load(path)


def test_energy_is_conserved(write):
    mine = 'law = "blinn-phong"\nr_spec = 0.6\nr_diff = 0.5\nn = 10\n'
    text = DESIGN[: DESIGN.index("law = ")] + mine + DESIGN[DESIGN.index("[attitude]") :]
    with pytest.raises(InputError, match=r"reflects r_diff \+ r_spec = 1\.1 of the light"):
        load(write(text))


def test_missing_scenarios(tmp_path):
    with pytest.raises(InputError, match=r"no file and no scenario is called 'bx'; available: box"):
        load("bx")
    with pytest.raises(InputError, match=r"none\.toml does not exist"):
        load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"byte 0 is not UTF-8"):
        load(tmp_path / "binary.toml")
