"""Attitudes judged with free facets: the catalogue's laws, and tumbling satellites."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

import lcbayes
from lcbayes.analysis import scan_plots, style
from lcbayes.core.cluster import worker_pool
from lcbayes.core.errors import InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.core.progress import Silent
from lcbayes.data.lightcurve import LightCurve
from lcbayes.inversion.albedo_area.kernel import Material
from lcbayes.inversion.attitude_scan import engine, equivalence, faceted, stabilised
from lcbayes.inversion.attitude_scan.result import AttitudeScan, Solution, Table
from lcbayes.inversion.attitude_scan.spin import tilts
from lcbayes.inversion.attitude_scan.verdict import summarise
from lcbayes.modelling.ephemeris import ephemeris, frames
from lcbayes.physics import brightness
from lcbayes.physics.attitude import catalogue, rotations
from lcbayes.physics.attitude.laws import Ephemeris, Spinning
from lcbayes.physics.bodies import facets, shapes
from lcbayes.results.reasons import reasons
from tests.helpers.false_alarms import EACH, counts

LAW = "lambertian"
RADIUS_KM, GM = 7000.0, 398600.4418


def passes(n: int = 160, seed: int = 0) -> LightCurve:
    """A satellite on an inclined orbit, seen from anywhere below over some days."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, 3 * 86400.0, n))
    rate = np.sqrt(GM / RADIUS_KM**3)
    across = np.array([0.0, np.cos(1.2), np.sin(1.2)])
    u = rate * t[:, None]
    place = RADIUS_KM * (np.cos(u) * [1.0, 0.0, 0.0] + np.sin(u) * across)
    motion = RADIUS_KM * rate * (-np.sin(u) * [1.0, 0.0, 0.0] + np.cos(u) * across)
    down = -place / RADIUS_KM + 0.9 * rng.normal(size=(n, 3))
    turn = 2.0 * np.pi * t / (20 * 86400.0)
    sun = np.stack([np.cos(turn), 0.917 * np.sin(turn), 0.397 * np.sin(turn)], axis=1)
    return LightCurve(
        t=t,
        brightness=np.ones(n),
        error=None,
        sun=sun / np.linalg.norm(sun, axis=1, keepdims=True),
        obs=down / np.linalg.norm(down, axis=1, keepdims=True),
        frame="icrs",
        position_km=place,
        velocity_km_s=motion,
    )


def seen(curve: LightCurve, rotation, noise: float = 0.01, panel=None) -> LightCurve:
    """The flux of a box of unequal albedos under an attitude, and of a panel under another."""
    body = shapes.box(2.0, 1.4, 0.8)
    areas = body.areas * np.array([0.3, 0.5, 0.2, 0.4, 0.6, 0.3])

    def flux_of(turned, normals, areas):
        sun, obs = (rotations.to_body(turned, jnp.asarray(v)) for v in (curve.sun, curve.obs))
        return np.asarray(brightness.flux(sun, obs, jnp.asarray(normals), jnp.asarray(areas), LAW))

    flux = flux_of(rotation, body.normals, areas)
    if panel is not None:
        flux = flux + flux_of(panel, faceted.FRONT_AND_BACK, [3.0, 2.0])
    error = np.full(len(flux), noise * flux.mean())
    noisy = flux + error * np.random.default_rng(1).normal(size=len(flux))
    return replace(curve, brightness=noisy, error=error)


def verdict_of(curve: LightCurve):
    laws, left_out = stabilised.chosen(("all",), curve, None)
    with worker_pool() as run, Silent().stage("", 1, "") as track:
        result, dark = stabilised.fit_laws(curve, laws, LAW, run, track)
    return sorted(result, key=lambda s: s.chi2), left_out | dark


def test_the_law_that_was_flown_comes_first():
    curve = passes()
    flown = frames(catalogue.find("earth-north").set(roll_deg=20.0, yaw_deg=10.0), curve)
    result, left_out = verdict_of(seen(curve, flown.body))
    assert result[0].law == "earth-north"  # a constant turn is the body's
    assert result[0].chi2 < 1.5 * curve.n_obs
    assert result[1].chi2 > 5.0 * result[0].chi2
    assert "it spins, and no --period is given" in left_out["gravity-gradient"]


def test_an_array_tells_laws_apart_and_a_dark_one_does_not():
    curve = passes()
    flown = frames(catalogue.find("nadir-sun-array"), curve)
    result, left_out = verdict_of(seen(curve, flown.body, panel=flown.array))
    assert result[0].law == "nadir-sun-array"
    assert result[0].areas[-2] > 0.2  # the front; the back turns away from the Sun
    assert result[0].areas[-1] == 0.0
    assert result[1].chi2 > 5.0 * result[0].chi2
    bare, left_out = verdict_of(seen(curve, flown.body))
    # on this orbit, which is nearly circular, other laws are lvlh with another constant rotation
    assert "lvlh" in {s.law for s in bare if s.chi2 < bare[0].chi2 + 1.0}
    assert left_out["nadir-sun-array"] == "its array sends no light, and without it is lvlh"
    # nothing without an array is yawed like this: it is judged whatever its array sends
    assert "yaw-steering" in {s.law for s in bare}


def test_laws_are_chosen_by_what_the_curve_has():
    curve = replace(passes(20), position_km=None, velocity_km_s=None)
    laws, left_out = stabilised.chosen(("all",), curve, 1.0)
    assert {"inertial", "sun-north", "sun-spin"} <= set(laws)
    assert "needs the satellite's orbit" in left_out["lvlh"]
    with pytest.raises(InputError, match="needs the satellite's orbit"):
        stabilised.chosen(("lvlh",), curve, None)
    with pytest.raises(InputError, match="unknown attitude law 'hover'"):
        stabilised.chosen(("hover",), curve, None)


def test_one_law_with_several_settings_is_several_laws():
    names = ("sun-spin:period_s=100", "sun-spin:period_s=200")
    laws, _ = stabilised.chosen((*names, names[0], "sun-north"), passes(20), None)
    assert tuple(laws) == (*names, "sun-north")


def test_free_facets_polish_a_tumblers_spin():
    """From some degrees off: closer to the truth, and the fit that noise allows."""
    curve = replace(
        passes(200), t=np.linspace(0.0, 600.0, 200), position_km=None, velocity_km_s=None
    )
    pole, frequency = np.array([0.36, 0.48, 0.8]), 1.0 / 90.0
    truth = Spinning(tilts(pole[None])[0], frequency, 300.0)
    rotation = truth.frames(ephemeris(curve)).body
    given = seen(curve, rotation, noise=0.02)
    start = faceted.moved(truth, np.array([0.05, -0.04, 0.05]), 600.0)
    material = Material.parse(LAW)
    before = faceted.best_body(given, start, material, 200)
    result, body = faceted.polish(given, start, 600.0, material, 200)
    off = [np.degrees(np.arccos(s.tilt[:, 2] @ pole)) for s in (start, result)]
    assert off[0] > 3.0
    assert off[1] < 1.0
    assert abs(result.frequency - frequency) * 600.0 < 0.01
    assert body.chi2 < 0.2 * before.chi2


def test_a_spin_is_turned_as_it_says():
    spin = Spinning(tilts(np.array([[0.6, 0.0, 0.8]]))[0], 0.01, 300.0)
    times = Ephemeris(jnp.array([300.0, 325.0]), jnp.zeros((2, 3)))
    turned = np.asarray(spin.frames(times).body)
    np.testing.assert_allclose(turned[0], spin.tilt, atol=1e-12)
    np.testing.assert_allclose(turned[:, :, 2], np.tile([0.6, 0.0, 0.8], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(turned[1][:, 0], spin.tilt[:, 1], atol=1e-12)  # a quarter turn


LAWS = ("inertial", "lvlh", "sun-pointing", "yaw-steering", "sun-north")


def one_pass(n: int) -> LightCurve:
    """500 s over a site, from a sun-synchronous orbit."""
    t = np.linspace(0.0, 500.0, n)
    u = np.sqrt(GM / RADIUS_KM**3) * (t - 250.0) + np.radians(45.0)
    along, across = np.array([1.0, 0.0, 0.0]), np.array([0.0, np.cos(1.71), np.sin(1.71)])
    place = RADIUS_KM * (np.cos(u)[:, None] * along + np.sin(u)[:, None] * across)
    motion = np.sqrt(GM / RADIUS_KM) * (np.cos(u)[:, None] * across - np.sin(u)[:, None] * along)
    site = 0.707 * (along + across) + np.array([0.047, 0.031, -0.016])
    view = 6371.0 * site / np.linalg.norm(site) - place
    sun = np.array([0.3, -0.9, 0.3]) / np.linalg.norm([0.3, -0.9, 0.3])
    return LightCurve(
        t=t,
        brightness=np.ones(n),
        error=None,
        sun=np.tile(sun, (n, 1)),
        obs=view / np.linalg.norm(view, axis=1, keepdims=True),
        frame="icrs",
        position_km=place,
        velocity_km_s=motion,
    )


@pytest.mark.slow
@pytest.mark.statistical(false_alarm=EACH)
def test_of_a_sphere_no_law_is_named():
    """Every law explains it: one alone is left in 5 % of all data at most."""
    n, runs, named = 40, 40, 0
    curve = one_pass(n)
    normals = facets.grid(1000)
    sun, obs = jnp.asarray(curve.sun), jnp.asarray(curve.obs)
    flux = np.asarray(brightness.flux(sun, obs, jnp.asarray(normals), jnp.ones(1000)))
    error = np.full(n, 0.1 * flux.mean())
    for seed in range(runs):
        noisy = flux + error * np.random.default_rng(seed).normal(size=n)
        result = lcbayes.scan(replace(curve, brightness=noisy, error=error), law=LAWS)
        named += sum(s["near_equal"] for s in result.solutions) == 1
    assert named <= counts(runs, equivalence.MISSED)[1]


def scan_by_hand(chi2, used, n_obs, *, error_known=True):
    """Laws with these χ² and numbers of facets."""
    settings = engine.Settings(None, None, (), LAW, 12, 0.8, 500, 6, 12, 0, False)
    nothing = np.zeros(n_obs)
    laws = [
        Solution(str(i), c, 0.01, nothing, np.zeros((u + 1, 3)), np.ones(u + 1), relation="law")
        for i, (c, u) in enumerate(zip(chi2, used, strict=True))
    ]
    return AttitudeScan(
        settings,
        laws,
        n_obs,
        n_obs - used[0] - 1,
        error_known,
        "icrs",
        np.arange(1.0 * n_obs),
        nothing.astype(int),
        nothing,
        n_laws=len(laws),
    )


def test_what_noise_may_do_fits_as_well():
    """χ² of a few, with as many numbers as any solution uses, among so many hypotheses."""
    chi2, used = [150.0, 175.0, 195.0], [6, 15, 10]
    by_noise = stats.chi2.isf(0.05 / 3, 15)
    assert 25.0 < by_noise < 45.0
    assert equivalence.limit(scan_by_hand(chi2, used, 200)) == pytest.approx(150.0 + by_noise)
    # χ² of many: 5 % of the residuals are more
    assert equivalence.limit(scan_by_hand([2000.0], [6], 2000)) == pytest.approx(2205.0)
    # what the noise is, is known from the residuals alone
    free = equivalence.limit(scan_by_hand(chi2, used, 30, error_known=False))
    assert free == pytest.approx(150.0 * (1.0 + 15 / 23 * stats.f.isf(0.05 / 3, 15, 23)))
    assert list(_reasons(scan_by_hand(chi2, used, 200))) == [
        "the attitude is not unique: 1 fits as well"
    ]


def test_more_numbers_than_points_and_too_good_a_fit_are_said():
    (reason,) = _reasons(scan_by_hand([0.0], [24], 40))
    assert reason.startswith("25 numbers were fitted to 40 points")
    (reason,) = _reasons(scan_by_hand([50.0], [9], 210))
    assert reason.startswith("chi2 is 0.25 per degree of freedom: the errors are too large")
    assert not _reasons(scan_by_hand([4.0], [9], 20))  # chance


@pytest.mark.parametrize(
    ("period_s", "words"),
    [
        (110.0, ""),
        (114.0, "within a step of the search, 7.4 s, of the end of the range, 120.0 s"),
        (122.0, "beyond the end of the range, 120.0 s"),
    ],
)
def test_the_end_of_a_range_is_said_with_how_far_it_is(period_s, words):
    result = scan_by_hand([100.0], [9], 120)
    hours = 1.0 / 3600.0
    settings = replace(result.settings, period_range_h=(40.0 * hours, 120.0 * hours))
    law = result.solutions[0]
    spin = replace(law, pole=np.array([0.0, 0.0, 1.0]), frequency=1.0 / period_s, hits=2)
    spun = replace(result, settings=settings, solutions=[spin], t=np.linspace(0.0, 700.0, 120))
    assert _reasons(spun) == ([f"the best period lies {words}: widen it"] if words else [])


def _reasons(result):
    return [reason.text for reason in reasons(summarise(result, passes(result.n_obs))[1])]


def test_the_law_that_was_flown_is_named_alone():
    curve = passes(200)
    flown = frames(catalogue.find("lvlh"), curve)
    result = lcbayes.scan(
        seen(curve, flown.body, noise=0.02), law=(*LAWS, "earth-north"), reflectance=LAW
    )
    assert result.trusted
    assert [s["law"] for s in result.solutions if s["near_equal"]] == ["lvlh"]
    fit = result.content["fit"]
    assert fit["chi2_near_equal"] - fit["chi2"] > 10.0  # of noise, not 5 % of residuals alone


def test_periods_are_drawn_where_searches_ended_and_the_sky_has_its_lines(tmp_path, monkeypatch):
    result = scan_by_hand([100.0], [9], 120)
    hours = 1.0 / 3600.0
    tried, reached = 1.0 / np.linspace(120.0, 40.0, 9), np.full(9, 1.0 / 114.7)
    reached[-1] = 1.0 / 42.0
    poles = facets.grid(9)
    settings = replace(result.settings, period_range_h=(40.0 * hours, 120.0 * hours))
    spin = replace(result.solutions[0], pole=poles[0], frequency=reached[0], relation="best")
    table = Table(poles, tried, poles, reached, np.linspace(100.0, 900.0, 9), np.ones(9, int))
    drawn = replace(
        result,
        settings=settings,
        solutions=[spin],
        n_periods=9,
        screened=table,
        sky=(poles, np.append(200.0, np.full(8, 40000.0) + np.arange(8))),
    )
    with style.drawing():
        gallery = style.Gallery(tmp_path)
        kept = {}
        monkeypatch.setattr(gallery, "add", lambda figure, name, *_: kept.setdefault(name, figure))
        scan_plots.draw_periods(drawn, gallery)
        scan_plots.draw_sky(drawn, gallery)
        every, best = (
            line.get_xdata() for line in kept["periods"].axes[0].lines if len(line.get_label()) > 9
        )
        np.testing.assert_allclose(every, 1.0 / reached)
        np.testing.assert_allclose(np.sort(best), [42.0, 114.7])
        sky = kept["sky"].axes[0]
        assert sky.get_axisbelow() is False
        shades = np.unique(sky.collections[0].get_array())
        assert len(shades) == 9  # not all at the ceiling
