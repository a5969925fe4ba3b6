"""Simulated light curves, against numbers got another way."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpyro import handlers
from scipy.spatial.transform import Rotation

from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.data import earth_shadow
from lcbayes.data.read import read
from lcbayes.modelling import nuisances
from lcbayes.modelling.epochs import Epochs
from lcbayes.models import faceted
from lcbayes.physics.bodies import shapes
from lcbayes.simulation import simulate as module
from lcbayes.simulation.scenarios.body import Material
from lcbayes.simulation.scenarios.epochs import epochs
from lcbayes.simulation.scenarios.scenario import (
    ConstantRate,
    Fixed,
    Noise,
    PrincipalAxis,
    Scenario,
    load,
)
from lcbayes.simulation.scenarios.viewing import Orbit, Planar, PlanarPass, Vectors
from lcbayes.simulation.simulate import flux_at, simulate

PASS = PlanarPass(0.0, 60.0, 0.5, 0.02, 0.1, 0.001, 0.6, "xy")
WHITE = {"body": Material("lambertian", {"r_diff": 0.8})}


def scenario(**changes) -> Scenario:
    """A white cube of 2 m that tumbles, seen in a plane."""
    base = Scenario(
        name="cube",
        body=shapes.cube(2.0),
        materials=WHITE,
        attitude=ConstantRate((0.1, -0.05, 0.2)),
        geometry=Planar((PASS,), "inertial", None),
        noise=Noise("sigma", 0.01),
        kind="flux",
        band="",
        exposure_s=0.0,
    )
    return replace(base, **changes)


def by_hand(case: Scenario, rotations: Rotation, sun, obs) -> np.ndarray:
    """Lambertian facets in plain NumPy."""
    s, o = rotations.inv().apply(sun), rotations.inv().apply(obs)
    lit = np.clip(s @ case.body.normals.T, 0, None) * np.clip(o @ case.body.normals.T, 0, None)
    return lit @ (case.body.areas * 0.8 / np.pi)


def test_planar_directions():
    """Linares & Crassidis, eq. (31), and the same turned into the yz plane."""
    curve = epochs(Planar((PASS, replace(PASS, start=100.0, stop=101.0, plane="yz")), "icrs", None))
    assert curve.frame == "icrs"
    assert curve.t[[0, 1, 120, 121, -1]].tolist() == [0.0, 0.5, 60.0, 100.0, 101.0]
    angle = 0.02 * 0.5 + 0.1
    np.testing.assert_allclose(curve.obs[1], [np.cos(angle), np.sin(angle), 0])
    np.testing.assert_allclose(curve.sun[1], [np.cos(0.6005), np.sin(0.6005), 0])
    angle = 0.02 * 101 + 0.1
    np.testing.assert_allclose(curve.obs[-1], [0, np.cos(angle), np.sin(angle)])
    assert curve.sun[-1, 2] == 0


@pytest.mark.parametrize("law", ["constant-rate", "principal-axis", "fixed"])
def test_flux_by_hand(law):
    curve = epochs(scenario().geometry)
    if law == "constant-rate":
        attitude = ConstantRate((0.1, -0.05, 0.2))
        rotations = Rotation.from_rotvec(curve.t[:, None] * np.array(attitude.omega_rad_s))
    elif law == "principal-axis":
        attitude = PrincipalAxis(30.0, 50.0, 25.0, 15.0)
        spin = 15.0 + 360.0 * curve.t / 25.0
        tilt = Rotation.from_euler("ZY", [30.0, 40.0], degrees=True)
        rotations = tilt * Rotation.from_euler("Z", spin[:, None], degrees=True)
    else:
        attitude, rotations = Fixed(), Rotation.identity(curve.n_obs)
    case = scenario(attitude=attitude)
    flux = flux_at(case, curve.t, curve.sun, curve.obs)
    expected = by_hand(case, rotations, curve.sun, curve.obs)
    assert expected.max() > 0.3
    np.testing.assert_allclose(flux, expected, rtol=1e-12, atol=1e-14)


def test_laws_mix():
    """Each facet follows its own material: the flux is that of the parts."""
    shiny = Material("ashikhmin-shirley", {"r_diff": 0.2, "r_spec": 0.4, "nu": 50.0, "nv": 9.0})
    curve = epochs(scenario().geometry)

    def flux(body: shapes.Body) -> np.ndarray:
        case = scenario(body=body, materials=WHITE | {"shiny": shiny})
        return flux_at(case, curve.t, curve.sun, curve.obs)

    cube = shapes.cube(2.0)._replace(labels=("body",) * 3 + ("shiny",) * 3)
    dull, bright = (
        shapes.Body(cube.normals[i], cube.areas[i], cube.u_axes[i], cube.labels[i])
        for i in (slice(0, 3), slice(3, 6))
    )
    np.testing.assert_allclose(flux(cube), flux(dull) + flux(bright), rtol=1e-13)
    assert flux(bright).max() > 0.01


def test_chunks_change_nothing(monkeypatch):
    curve = epochs(scenario().geometry)
    whole = flux_at(scenario(), curve.t, curve.sun, curve.obs)
    monkeypatch.setattr(module, "CHUNK", 6 * 50)
    np.testing.assert_array_equal(flux_at(scenario(), curve.t, curve.sun, curve.obs), whole)


def test_exposure_averages_the_flux():
    curve = epochs(scenario().geometry)
    case = scenario(exposure_s=0.4)
    mean = flux_at(case, curve.t, curve.sun, curve.obs)
    instants = np.linspace(-0.2, 0.2, 51)
    t = (curve.t + instants[:, None]).ravel()
    sun, obs = (np.tile(v, (instants.size, 1)) for v in (curve.sun, curve.obs))
    dense = flux_at(scenario(), t, sun, obs).reshape(instants.size, -1)
    np.testing.assert_allclose(mean, np.trapezoid(dense, axis=0) / (len(dense) - 1), atol=2e-3)
    assert np.max(np.abs(mean - flux_at(scenario(), curve.t, curve.sun, curve.obs))) > 1e-4


def test_noise_is_what_was_asked_and_repeats():
    first, truth = simulate(scenario(), 3)
    again, _ = simulate(scenario(), 3)
    other, _ = simulate(scenario(), 4)
    np.testing.assert_array_equal(first.brightness, again.brightness)
    assert np.all(first.brightness != other.brightness)
    pulls = (first.brightness - truth["flux"]) / 0.01
    assert abs(pulls.mean()) < 4 / np.sqrt(pulls.size)
    assert abs(pulls.std() - 1) < 0.25
    snr, truth = simulate(scenario(noise=Noise("snr", 50.0)), 3)
    assert snr.error == pytest.approx(np.mean(truth["flux"]) / 50.0)


def test_magnitudes_and_irradiance():
    """m = m_sun - 2.5 log10(f/r²) and Φ f/r², r = 800 km."""
    geometry = Planar((PASS,), "inertial", 800.0)
    unit, truth = simulate(scenario(), 0)
    f = np.array(truth["flux"])
    assert unit.range_km is None
    mag, truth = simulate(
        scenario(geometry=geometry, kind="mag", band="V", noise=Noise("mag_err", 0.02)), 0
    )
    np.testing.assert_allclose(truth["mag"], -26.76 - 2.5 * np.log10(f) + 5 * np.log10(8e5))
    assert mag.error == pytest.approx(0.02)
    watts, truth = simulate(scenario(geometry=geometry, noise=Noise("mag_err", 0.02)), 0)
    np.testing.assert_allclose(truth["flux"], 455 * f / 8e5**2)
    assert watts.error == pytest.approx(0.02 * np.log(10) / 2.5 * np.array(truth["flux"]))


def test_magnitudes_need_distances_of_any_geometry(tmp_path):
    """Fluxes had been written out as magnitudes where a geometry file had no ranges."""
    rows = "t,sun_x,sun_y,sun_z,obs_x,obs_y,obs_z\n0,1,0,0,1,0,0\n1,1,0,0,1,0,0\n"
    (tmp_path / "far.csv").write_text(rows)
    case = scenario(geometry=Vectors(tmp_path / "far.csv"))
    assert simulate(case, 0)[0].kind == "flux"
    for noise in (Noise("mag_err", 0.02), Noise("snr", 50.0)):
        with pytest.raises(InputError, match="no range_km, and a magnitude needs a distance"):
            simulate(replace(case, kind="mag", noise=noise), 0)


def test_dark_epochs_have_no_magnitude_and_the_truth_is_of_the_first_point():
    """One facet that looks away at first: from the truth alone the brightness follows."""
    body = shapes.body([[-1.0, 0.2, 0.1]], [3.0])
    case = scenario(
        body=body,
        geometry=Planar((PASS,), "inertial", 800.0),
        kind="mag",
        band="V",
        noise=Noise("mag_err", 0.02),
    )
    curve, truth = simulate(case, 0)
    assert truth["n_dark_left_out"] == 121 - curve.n_obs > 10
    assert truth["t_ref_s"] == curve.t[0] > 0
    (facet,) = truth["facets"]
    assert facet["albedo_area_m2"] == pytest.approx(2.4)
    later = (curve.t - truth["t_ref_s"])[:, None] * np.array(truth["attitude"]["omega_rad_s"])
    turned = case.body._replace(normals=np.array([facet["normal"]]))
    flux = by_hand(replace(case, body=turned), Rotation.from_rotvec(later), curve.sun, curve.obs)
    np.testing.assert_allclose(truth["mag"], -26.76 - 2.5 * np.log10(flux) + 5 * np.log10(8e5))
    away = case.body._replace(normals=np.array([[0.0, 0.0, 1.0]]))
    with pytest.raises(InputError, match="no facet is lit and seen at any of 121 epochs"):
        simulate(replace(case, body=away, attitude=Fixed()), 0)
    with pytest.raises(InputError, match=r"noise\.snr has no meaning"):
        simulate(scenario(body=away, attitude=Fixed(), noise=Noise("snr", 9.0)), 0)


def test_only_what_can_be_observed_is():
    """Elevation, darkness of the site and sunlight, checked with astropy."""
    from astropy.coordinates import AltAz, EarthLocation, get_sun
    from astropy.time import Time
    from astropy.utils import iers

    geometry = load("box-wing").geometry
    assert isinstance(geometry, Orbit)
    curve = epochs(geometry)
    assert curve.frame == "icrs"
    assert curve.range_km is not None
    assert curve.epoch_jd is not None
    assert 690 < curve.range_km.min() < curve.range_km.max() < 2000
    site = geometry.passes[0].site
    here = curve.site == site.name
    with iers.conf.set_temp("auto_download", False):
        time = Time(curve.epoch_jd, curve.t[here] / 86400.0, format="jd", scale="utc")
        place = EarthLocation.from_geodetic(site.lon_deg, site.lat_deg, site.height_m)
        sun = get_sun(time).transform_to(AltAz(obstime=time, location=place))
    assert sun.alt.deg.max() < -8.0  # pyright: ignore[reportCallIssue, reportOptionalCall, reportOptionalMemberAccess]
    all_day = replace(geometry.passes[0], min_elevation_deg=89.0)
    with pytest.raises(InputError, match=r"can be observed: of 376, 376 are below 89 deg, \d+ in"):
        epochs(replace(geometry, passes=(all_day,)))


def test_command_writes_the_curve_and_the_truth(tmp_path, capsys):
    out = tmp_path / "c.csv"
    assert main(["simulate", "one-facet", "-o", str(out), "--seed", "5"]) == EXIT_DONE
    made, truth = simulate(load("one-facet"), 5)
    back = read(out)
    np.testing.assert_array_equal(back.brightness, made.brightness)
    np.testing.assert_array_equal(back.obs, made.obs)
    assert json.loads((tmp_path / "c.truth.json").read_text()) == truth
    assert "102 points of one-facet" in capsys.readouterr().out
    assert main(["simulate", "--list"]) == EXIT_DONE
    assert "box-wing" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "give a scenario, and with -o where the result goes; or --list"),
        (["one-facet"], "give a scenario, and with -o where the result goes; or --list"),
        (["one-facet", "-o", "x.csv", "--seed", "-1"], "--seed is -1"),
        (["one-facet", "-o", "no/such/folder/x.csv"], "cannot be written"),
    ],
)
def test_command_faults(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", *words]) == EXIT_BAD_INPUT
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_doctor(capsys, monkeypatch, tmp_path):
    monkeypatch.delenv("LCBAYES_DATA", raising=False)
    assert main(["doctor"]) in (EXIT_DONE, EXIT_BAD_INPUT)
    assert "double precision" in capsys.readouterr().out
    monkeypatch.setenv("LCBAYES_DATA", str(tmp_path / "none"))
    assert main(["doctor", "--json"]) == EXIT_BAD_INPUT
    answer = json.loads(capsys.readouterr().out)
    wrong = {check["name"] for check in answer["checks"] if check["remedy"]}
    assert not answer["ok"]
    assert "observations for tests" in wrong
    names = {check["name"] for check in answer["checks"]}
    assert {"python", "jax devices", "compilation cache", "cores", "memory"} <= names


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("box-wing", marks=pytest.mark.slow),
        "one-facet",
        pytest.param("two-facet-spin", marks=pytest.mark.slow),
    ],
)
def test_a_model_given_the_truth_explains_the_curve(name):
    """Simulation and model are two paths to one brightness: ranges, spin, penumbra and all."""
    curve, made = simulate(load(name), 1)
    omega = np.array(made["attitude"].get("omega_rad_s", [0.0, 0.0, 0.0]))
    given = {
        "normals_base": jnp.array([facet["normal"] for facet in made["facets"]]),
        "log_albedo_area": jnp.log(jnp.array([f["albedo_area_m2"] for f in made["facets"]])),
        "omega_unit": jnp.asarray(omega),
    }
    options = {"n_facets": len(made["facets"]), "omega_sd": 1.0} | nuisances.UNMODELLED
    model = partial(faceted.model, **options)
    seeded = handlers.seed(handlers.substitute(model, given), 0)
    result = handlers.trace(seeded).get_trace(Epochs.of(curve))["expected"]["value"]
    np.testing.assert_allclose(result, made["flux"], rtol=1e-9, atol=1e-12 * max(made["flux"]))
    if name == "box-wing":
        assert earth_shadow.share(curve).min() < 0.6  # it comes out of the Earth's shadow
