"""Outlines over chords: geometry against astropy, an ellipsoid in closed form, errors."""

from __future__ import annotations

from dataclasses import replace

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import BarycentricMeanEcliptic, CartesianRepresentation, SkyCoord

from lcbayes.data.formats.occultation import Occultation
from lcbayes.geometry.sky_plane import west_north
from lcbayes.inversion import occultations
from lcbayes.physics.attitude.spin_state import SpinState
from tests.helpers.false_alarms import EACH, limit, squares
from tests.helpers.occulting_ellipsoid import AXES, CENTRE, SPIN, TO_EARTH, ellipse, event
from tests.helpers.results_folders import fibonacci


def bodies(*axes: np.ndarray) -> list[np.ndarray]:
    """Ellipsoids of unit volume-equivalent diameter, as dense points."""
    points = fibonacci(20_000)
    return [points * a / (2.0 * np.cbrt(np.prod(a))) for a in axes]


def placed(events: list[Occultation], shapes: list[np.ndarray], spin: SpinState = SPIN):
    result = [[occultations.support(v, spin, e) for e in events] for v in shapes]
    outline = np.stack([np.concatenate([o for o, _ in one]) for one in result])
    across = np.stack([np.concatenate([a for _, a in one]) for one in result])
    return occultations.place(outline, across, occultations.Chords.of(events))


def test_axes_of_the_sky_plane_are_astropys():
    """A point beside the asteroid, seen from the Earth, is displaced as astropy displaces it."""
    frame = BarycentricMeanEcliptic(equinox="J2000")

    def seen(vector):
        where = CartesianRepresentation(*vector, unit=u.km)
        return SkyCoord(frame.realize_frame(where)).icrs

    step = np.array([300.0, -450.0, 700.0])
    asteroid, beside = seen(-TO_EARTH), seen(-TO_EARTH + step)
    assert asteroid is not None
    east, north = asteroid.spherical_offsets_to(beside)
    distance = np.linalg.norm(TO_EARTH)
    west, up = west_north(TO_EARTH) @ step
    assert west == pytest.approx(-east.to_value(u.rad) * distance, rel=2e-5, abs=0.02)
    assert up == pytest.approx(north.to_value(u.rad) * distance, rel=2e-5, abs=0.02)


def test_support_of_an_ellipsoid_is_its_closed_form():
    one = event(np.array([-20.0, 0.0, 15.0]))
    outline, across = occultations.support(bodies(AXES)[0], SPIN, one)
    unit = 2.0 * np.cbrt(np.prod(AXES))
    angle = 2 * np.pi * np.arange(360) / 360
    n = np.stack([np.cos(angle), np.sin(angle)], 1)
    for c, jd in enumerate(one.body_jd):
        q = ellipse(AXES, jd)
        np.testing.assert_allclose(unit * outline[c], np.sqrt(np.sum(n @ q * n, 1)), rtol=3e-4)
        left = np.array([-one.direction[c, 1], one.direction[c, 0]])
        np.testing.assert_allclose(unit * across[c], np.sqrt(left @ q @ left), rtol=3e-4)


def test_size_and_place_of_an_ellipsoid_are_found():
    one = event(np.array([-28.0, -15.0, -2.0, 9.0, 21.0, 30.0]))
    result = placed([one], bodies(AXES))
    assert result.size[0] == pytest.approx(2.0 * np.cbrt(np.prod(AXES)), rel=5e-4)
    np.testing.assert_allclose(result.centre[0, 0], CENTRE, atol=0.03)
    np.testing.assert_allclose(result.distance, 0.0, atol=0.03)
    assert result.relief[0] < 0.01
    assert result.depth.shape == (1, 0)


def test_distances_are_those_of_the_outline():
    """The signed distance to a circle is known: a sphere, seen from anywhere."""
    sphere = bodies(np.ones(3))
    one = event(np.array([-20.0, 0.0, 15.0]), axes=np.full(3, 40.0))
    outline, _ = occultations.support(sphere[0], SPIN, one)
    chords = occultations.Chords.of([one])
    size, centre = np.array([70.0]), CENTRE[None, None] + [3.0, -2.0]
    distance, normal, height = occultations.nearest(outline[None], chords, size, centre)
    offset = chords.ends - centre[0, 0]
    np.testing.assert_allclose(distance[0], np.linalg.norm(offset, axis=1) - 35.0, atol=0.02)
    unit = offset / np.linalg.norm(offset, axis=1)[:, None]
    np.testing.assert_allclose(normal[0], unit, atol=0.02)
    np.testing.assert_allclose(height, 0.5, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.statistical(false_alarm=EACH)
def test_errors_of_the_size_are_those_of_repeated_observations():
    """With timing errors alone, the stated sd is what the sizes of simulated events scatter by."""
    offsets = np.linspace(-28.0, 30.0, 9)
    shape = bodies(AXES)
    result = [
        placed([event(offsets, error_s=0.3, rng=np.random.default_rng(k))], shape)
        for k in range(60)
    ]
    sizes, sds = (np.array([getattr(p, name)[0] for p in result]) for name in ("size", "size_sd"))
    truth = 2.0 * np.cbrt(np.prod(AXES))
    scatter, dof = np.std(sizes, ddof=1), len(sizes) - 1
    error = scatter / np.sqrt(len(sizes))
    assert abs(sizes.mean() - truth) < limit(2, dof) * error + 3e-4 * truth
    # relief of unknown height may be there, so that the stated error is somewhat larger
    assert dof * (scatter / sds.mean()) ** 2 < squares(dof, 2)[1]
    assert sds.mean() < 2.5 * scatter


def test_negative_chords_bound_the_body():
    """Two chords near the middle leave the width free; a miss on each side bounds it."""
    flat = event(np.array([-2.0, 2.0]))
    bounded = event(np.array([-2.0, 2.0]), negative=(-37.0, 37.0))
    shapes = bodies(AXES, AXES * np.array([1.0, 1.0, 2.0]))
    free, held = placed([flat], shapes), placed([bounded], shapes)
    assert held.depth.shape == (2, 2)
    # the truth misses them; the wide body can do so only if it is too small for its chords
    assert held.depth[0].max() < 0.5
    assert held.size[1] < 0.97 * free.size[1]
    gain = held.log_likelihood - free.log_likelihood
    assert gain[0] > gain[1] + 1.0


def test_two_events_share_the_size():
    first = event(np.array([-28.0, 0.0, 25.0]))
    second = event(np.array([-18.0, 12.0]), centre=np.array([100.0, 50.0]), start=2454900.3)
    result = placed([first, second], bodies(AXES))
    assert result.size[0] == pytest.approx(2.0 * np.cbrt(np.prod(AXES)), rel=1e-3)
    np.testing.assert_allclose(result.centre[0], np.array([CENTRE, [100.0, 50.0]]), atol=0.1)


def test_a_wrong_shape_is_less_likely_than_the_right_one():
    one = event(np.linspace(-28.0, 30.0, 9))
    right, wrong = placed([one], bodies(AXES, AXES[[0, 2, 1]])).log_likelihood
    assert right > wrong + 5.0
    turned = replace(SPIN, phase0_deg=SPIN.phase0_deg + 90.0)
    assert right > placed([one], bodies(AXES), turned).log_likelihood[0] + 5.0


def test_effective_number_of_draws():
    assert occultations.effective_number(np.zeros(7)) == pytest.approx(7.0)
    assert occultations.effective_number(np.array([0.0, -900.0])) == pytest.approx(1.0)
