"""Sunlight past the Earth, the air to a satellite, and light that the ground sends up."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import integrate, optimize

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.constants import AU_KM, EARTH_FLATTENING, EARTH_RADIUS_KM, SUN_RADIUS_KM
from lcbayes.core.errors import EXIT_NOT_TRUSTED, InputError
from lcbayes.core.jax_setup import jnp
from lcbayes.data import earth_shadow
from lcbayes.data.lightcurve import LightCurve
from lcbayes.geometry.earth import airmass, sun_position
from lcbayes.geometry.times import Times
from lcbayes.modelling.epochs import Epochs
from lcbayes.physics.earthshine import RINGS, SECTORS, glow
from lcbayes.simulation import scenarios

SUN = np.array([1.0, 0.0, 0.0])
RADIUS = EARTH_RADIUS_KM + 550.0


def places(height_km: np.ndarray) -> np.ndarray:
    """On a circular orbit in the equator's plane, where the line to the Sun's centre passes over
    the ground at these heights, (T, 3)."""
    low = EARTH_RADIUS_KM + height_km
    return np.stack([-np.sqrt(RADIUS**2 - low**2), low, 0.0 * low], axis=1)


def overlap(place: np.ndarray) -> float:
    """Share of the Sun's disc seen past a bare spherical Earth: the area common to two discs."""
    to_sun = AU_KM * SUN
    a, b = np.arcsin(SUN_RADIUS_KM / AU_KM), np.arcsin(EARTH_RADIUS_KM / np.linalg.norm(place))
    c = np.arccos(-place @ to_sun / np.linalg.norm(place) / AU_KM)
    if c >= a + b:
        return 1.0
    if c <= b - a:
        return 0.0
    x = (c**2 + a**2 - b**2) / (2 * c)
    common = a**2 * np.arccos(x / a) + b**2 * np.arccos((c - x) / b) - c * np.sqrt(a**2 - x**2)
    return 1.0 - common / (np.pi * a**2)


def test_without_air_it_is_the_share_of_the_disc_that_is_seen():
    """The limb is taken for straight: the Earth is 250 times as wide as the Sun."""
    where = places(np.linspace(-15.0, 15.0, 13))
    result = earth_shadow.sunlight(where, np.tile(SUN, (13, 1)), air=False)
    np.testing.assert_allclose(result, [overlap(p) for p in where], atol=2e-3)
    assert result[0] == 0.0
    assert result[-1] == 1.0


def test_all_light_arrives_high_above_the_air_and_on_the_day_side():
    high = np.array(
        [[-3000.0, EARTH_RADIUS_KM + 300.0, 0.0], [7000.0, 0.0, 0.0], [0.0, 7000.0, 0.0]]
    )
    np.testing.assert_allclose(earth_shadow.sunlight(high, np.tile(SUN, (3, 1))), 1.0, atol=1e-9)
    assert earth_shadow.sunlight(np.array([[-7000.0, 0.0, 0.0]]), SUN[None])[0] == 0.0


@pytest.mark.parametrize("height", [25.0, 5.0, -20.0])
def test_with_air_by_rays_one_at_a_time(height):
    """The disc in strips of straight height g: each finds its bent ray, and the dilution dh/dg."""
    (place,) = places(np.array([height]))
    behind = -place @ SUN
    radius = SUN_RADIUS_KM / AU_KM * behind

    def bent(h):
        return h - behind * earth_shadow.BENDING * np.exp(-h / earth_shadow.SCALE_KM)

    def strip(g):
        h = optimize.root_scalar(lambda h: bent(h) - g, bracket=(0.0, 200.0)).root
        dilution = 1.0 + behind * earth_shadow.BENDING / earth_shadow.SCALE_KM * np.exp(
            -h / earth_shadow.SCALE_KM
        )
        chord = 2.0 * np.sqrt(max(radius**2 - (g - height) ** 2, 0.0)) / (np.pi * radius**2)
        return chord * np.exp(-earth_shadow.extinction(np.array([h]))[0]) / dilution

    low = max(height - radius, bent(0.0))
    want = integrate.quad(strip, low, height + radius, limit=200)[0]
    got = earth_shadow.sunlight(place[None], SUN[None])[0]
    assert got == pytest.approx(want, rel=1e-4)


def test_the_limb_is_that_of_the_ellipsoid():
    """Over a pole the ground is 21 km lower: as much light arrives from rays so much lower."""
    equator = places(np.array([20.0]))
    pole = equator[:, [0, 2, 1]]
    lower = pole * [1.0, 1.0, (EARTH_RADIUS_KM * (1 - EARTH_FLATTENING) + 20.0) / pole[0, 2]]
    result = earth_shadow.sunlight(np.concatenate([equator, pole, lower]), np.tile(SUN, (3, 1)))
    assert result[1] > result[0] + 0.3
    assert result[2] == pytest.approx(result[0], abs=2e-3)


def test_extinction_along_a_ray_by_quadrature():
    """Of the ozone alone, over the length of the ray; toward the zenith it is 0.03."""

    def density(r):
        z = (r - EARTH_RADIUS_KM - earth_shadow.OZONE_KM) / earth_shadow.OZONE_WIDTH_KM
        return (
            earth_shadow.OZONE
            / (np.sqrt(2 * np.pi) * earth_shadow.OZONE_WIDTH_KM)
            * np.exp(-(z**2) / 2)
        )

    for h in (5.0, 20.0, 30.0):
        along = lambda s, h=h: density(np.hypot(EARTH_RADIUS_KM + h, s))  # noqa: E731
        ozone = 2.0 * integrate.quad(along, 0.0, 1500.0, limit=200)[0]
        air = earth_shadow.RAYLEIGH * np.sqrt(2 * np.pi * EARTH_RADIUS_KM / earth_shadow.SCALE_KM)
        want = ozone + air * np.exp(-h / earth_shadow.SCALE_KM)
        assert earth_shadow.extinction(np.array([h]))[0] == pytest.approx(want, rel=2e-3)


def test_airmass_is_that_of_air_in_spherical_layers():
    """∫ n ds over ∫ n dh, n ∝ exp(−h/8 km), straight rays: within 1 % to 10°; 38 at the horizon
    (Kasten & Young 1989: 37.92, with refraction)."""
    for altitude in (90.0, 30.0, 10.0, 0.0):
        a = np.radians(altitude)
        site, toward = np.array([EARTH_RADIUS_KM, 0, 0]), np.array([np.sin(a), np.cos(a), 0.0])
        result = airmass((site + 800.0 * toward)[None], -toward[None], np.array([800.0]))[0]
        if altitude == 0.0:
            assert result == pytest.approx(37.92, rel=1e-3)
            continue

        def above(s, a=a):
            return (
                np.sqrt(EARTH_RADIUS_KM**2 + s**2 + 2 * EARTH_RADIUS_KM * s * np.sin(a))
                - EARTH_RADIUS_KM
            )

        slant = integrate.quad(lambda s: np.exp(-above(s) / 8.0), 0, 600, limit=200)[0]
        assert result == pytest.approx(slant / 8.0, rel=0.01)


def irradiance(radius: float, sun_angle: float, nodes: tuple[int, int]) -> float:
    """Of a plane that faces nadir, as a share of the Sun's, for an Earth of albedo 1."""
    place = jnp.array([[0.0, 0.0, radius]])
    sun = jnp.array([[np.sin(sun_angle), 0.0, np.cos(sun_angle)]])
    light = glow(place, sun, 1.0, *nodes)
    return float(jnp.sum(light.strength * -light.toward[..., 2]))


def test_earthshine_from_far_away_is_a_lambert_sphere():
    """Geometric albedo 2/3 seen full; a phase of 90° is 1/π of it (Russell 1916)."""
    far = 3e4  # beyond which the cap that is seen differs by 3e-5 from a hemisphere
    assert irradiance(far, 0.0, (12, 24)) * far**2 == pytest.approx(2 / 3, rel=1e-4)
    quarter = irradiance(far, np.pi / 2, (40, 80)) * far**2
    assert quarter == pytest.approx(2 / 3 / np.pi, rel=2e-3)


@pytest.mark.parametrize("angle", [0.0, 60.0, 80.0])
def test_earthshine_in_low_orbit_by_an_integral_over_the_ground(angle):
    """E = ∫ (a/π) μ₀ μ cos θ dA/d² over the cap that is seen and lit."""
    radius, s = 1.0862, np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    place = np.array([0.0, 0.0, radius])

    def patch(lon, g):
        m = np.array([np.sqrt(1 - g**2) * np.cos(lon), np.sqrt(1 - g**2) * np.sin(lon), g])
        line = place - m
        d = np.linalg.norm(line)
        return max(m @ s, 0.0) * max(m @ line / d, 0.0) * (line[2] / d) / np.pi / d**2

    want = 2.0 * integrate.dblquad(patch, 1.0 / radius, 1.0, 0.0, np.pi, epsabs=1e-5)[0]
    assert irradiance(radius, np.radians(angle), (30, 60)) == pytest.approx(want, rel=1e-3)
    assert irradiance(radius, np.radians(angle), (RINGS, SECTORS)) == pytest.approx(want, rel=0.03)


def test_methods_without_a_penumbra_leave_its_points_out_and_say_so(tmp_path, capsys):
    """The demo's satellite comes out of the shadow in its first points."""
    folder = Path(scenarios.__file__).parent
    whole = lcbayes.read(folder / "box-wing.csv", tle=folder / "box-wing.tle")
    lit = earth_shadow.fully_lit(whole)
    share = earth_shadow.share(whole)
    assert 0 < whole.n_obs - lit.n_obs == np.sum(share <= 0.99) < 20
    np.testing.assert_array_equal(lit.brightness, whole.brightness[share > 0.99])
    argv = ["glints", str(folder / "box-wing.csv"), "--tle", str(folder / "box-wing.tle")]
    assert main([*argv, "-o", str(tmp_path / "out"), "--json"]) == EXIT_NOT_TRUSTED
    printed = capsys.readouterr()
    assert f"note: {whole.n_obs - lit.n_obs} points" in printed.err
    content = json.loads(printed.out)
    assert content["points_in_penumbra_left_out"] == whole.n_obs - lit.n_obs
    assert content["n_obs"] == lit.n_obs
    assert earth_shadow.fully_lit(lit) is lit
    with pytest.raises(InputError, match="shadow at all points"):
        earth_shadow.fully_lit(whole.select(share < 0.9))


def test_sunlight_follows_the_seasons():
    """Beside the Astronomical Almanac's series for the Earth's distance, good to 1e-4 au."""
    days = np.arange(0.0, 366.0, 5.0)
    far = np.full(days.size, 700.0)
    curve = seen(days, far)
    g = np.radians(357.528 + 0.9856003 * (2461041.5 - 2451545.0 + days))
    earth = 1.00014 - 0.01671 * np.cos(g) - 0.00014 * np.cos(2 * g)
    result = earth_shadow.irradiance(curve)
    np.testing.assert_allclose(result, earth**-2, rtol=4e-4)  # 1e-4 and the Earth's centre, 5e-5
    assert (result.min(), result.max()) == pytest.approx((0.967, 1.034), abs=1e-3)
    # 1 au behind the observer as the Sun sees it, and where nothing is known
    beyond = earth_shadow.irradiance(seen(days, np.full(days.size, AU_KM)))
    np.testing.assert_allclose(beyond, (1 + earth) ** -2, rtol=4e-4)
    for unknown in ({"epoch_jd": None}, {"range_km": None}, {"frame": "inertial"}):
        assert np.all(earth_shadow.irradiance(replace(curve, **unknown)) == 1.0)


def seen(days: np.ndarray, range_km: np.ndarray) -> LightCurve:
    """Of 2026, a body opposite to the Sun."""
    epoch_jd, t = 2461041.5, 86400.0 * days
    sun = sun_position(Times.of(epoch_jd, t))
    sun /= np.linalg.norm(sun, axis=1, keepdims=True)
    return LightCurve(
        t=t,
        brightness=np.ones(days.size),
        error=None,
        sun=sun,
        obs=sun,
        range_km=range_km,
        epoch_jd=epoch_jd,
        frame="icrs",
    )


def test_brightness_follows_the_sunlight():
    """What is simulated and what a fit expects of it are as bright as the Sun is near."""
    days = np.array([0.0, 180.0])
    curve = seen(days, np.full(2, 700.0))
    ratio = earth_shadow.irradiance(curve)
    dilution = np.asarray(Epochs.of(curve).dilution)
    np.testing.assert_allclose(dilution, 455.0 * ratio / 7e5**2)
    mags = replace(curve, kind="mag")
    np.testing.assert_allclose(np.asarray(Epochs.of(mags).dilution), ratio / 7e5**2)
