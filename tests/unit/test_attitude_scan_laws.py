"""Attitudes judged with free facets: the catalogue's laws, and tumbling satellites."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lcbayes._jax import jnp
from lcbayes.albedo_area.kernel import Material
from lcbayes.attitude_scan import faceted, stabilised
from lcbayes.attitude_scan.spin import tilts
from lcbayes.ephemeris import frames
from lcbayes.errors import InputError
from lcbayes.lightcurve import LightCurve
from lcbayes.physics import attitude, brightness, catalogue, shapes
from lcbayes.progress import Silent
from lcbayes.workers import crew

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
        t=t, brightness=np.ones(n), error=None,
        sun=sun / np.linalg.norm(sun, axis=1, keepdims=True),
        obs=down / np.linalg.norm(down, axis=1, keepdims=True), frame="icrs",
        position_km=place, velocity_km_s=motion,
    )  # fmt: skip


def seen(curve: LightCurve, rotation, noise: float = 0.01, panel=None) -> LightCurve:
    """The flux of a box of unequal albedos under an attitude, and of a panel under another."""
    body = shapes.box(2.0, 1.4, 0.8)
    areas = body.areas * np.array([0.3, 0.5, 0.2, 0.4, 0.6, 0.3])

    def flux_of(turned, normals, areas):
        sun, obs = (attitude.to_body(turned, jnp.asarray(v)) for v in (curve.sun, curve.obs))
        return np.asarray(brightness.flux(sun, obs, jnp.asarray(normals), jnp.asarray(areas), LAW))

    flux = flux_of(rotation, body.normals, areas)
    if panel is not None:
        flux = flux + flux_of(panel, faceted.FRONT_AND_BACK, [3.0, 2.0])
    error = np.full(len(flux), noise * flux.mean())
    noisy = flux + error * np.random.default_rng(1).normal(size=len(flux))
    return replace(curve, brightness=noisy, error=error)


def judged(curve: LightCurve):
    laws, left_out = stabilised.chosen(("all",), curve, None)
    with crew() as run, Silent().stage("", 1, "") as track:
        found, dark = stabilised.judge(curve, laws, LAW, run, track)
    return sorted(found, key=lambda s: s.chi2), left_out | dark


def test_the_law_that_was_flown_comes_first():
    curve = passes()
    flown = frames(catalogue.find("earth-north").set(roll_deg=20.0, yaw_deg=10.0), curve)
    found, left_out = judged(seen(curve, flown.body))
    assert found[0].law == "earth-north"  # a constant turn is the body's
    assert found[0].chi2 < 1.5 * curve.n_obs
    assert found[1].chi2 > 5.0 * found[0].chi2
    assert "it spins, and no --period is given" in left_out["gravity-gradient"]


def test_an_array_tells_laws_apart_and_a_dark_one_does_not():
    curve = passes()
    flown = frames(catalogue.find("nadir-sun-array"), curve)
    found, left_out = judged(seen(curve, flown.body, panel=flown.array))
    assert found[0].law == "nadir-sun-array"
    assert found[0].areas[-2] > 0.2  # the front; the back turns away from the Sun
    assert found[0].areas[-1] == 0.0
    assert found[1].chi2 > 5.0 * found[0].chi2
    bare, left_out = judged(seen(curve, flown.body))
    assert bare[0].law == "lvlh"
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
    curve = replace(passes(200), t=np.linspace(0.0, 600.0, 200), position_km=None,
                    velocity_km_s=None)  # fmt: skip
    pole, frequency = np.array([0.36, 0.48, 0.8]), 1.0 / 90.0
    truth = faceted.Spinning(tilts(pole[None])[0], frequency)
    rotation = truth.rotation(jnp.asarray(curve.t), jnp.asarray(300.0))
    given = seen(curve, rotation, noise=0.02)
    start = truth.moved(np.array([0.05, -0.04, 0.05]), 600.0)
    material = Material.parse(LAW)
    before = faceted.best_body(given, start, material, 200)
    found, body = faceted.polish(given, start, 600.0, material, 200)
    off = [np.degrees(np.arccos(s.tilt[:, 2] @ pole)) for s in (start, found)]
    assert off[0] > 3.0
    assert off[1] < 1.0
    assert abs(found.frequency - frequency) * 600.0 < 0.01
    assert body.chi2 < 0.2 * before.chi2


def test_a_spin_is_turned_as_it_says():
    spin = faceted.Spinning(tilts(np.array([[0.6, 0.0, 0.8]]))[0], 0.01)
    turned = np.asarray(spin.rotation(jnp.array([300.0, 325.0]), jnp.asarray(300.0)))
    np.testing.assert_allclose(turned[0], spin.tilt, atol=1e-12)
    np.testing.assert_allclose(turned[:, :, 2], np.tile([0.6, 0.0, 0.8], (2, 1)), atol=1e-12)
    np.testing.assert_allclose(turned[1][:, 0], spin.tilt[:, 1], atol=1e-12)  # a quarter turn
