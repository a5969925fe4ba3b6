"""Longitudes, latitudes and circular means; lists in messages."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.text import join_words
from lcbayes.geometry.spherical import lon_lat_deg, unit_vector, unwrapped


def test_directions_and_back():
    lon, lat = np.array([0.0, 120.0, 359.0]), np.array([90.0, -30.0, 10.0])
    vectors = unit_vector(np.radians(lon), np.radians(lat))
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=-1), 1.0)
    np.testing.assert_allclose(vectors[1], [-0.25 * 3**0.5, 0.75, -0.5])
    result = lon_lat_deg(7.0 * vectors)
    np.testing.assert_allclose(result[0][1:], lon[1:])
    np.testing.assert_allclose(result[1], lat)


@pytest.mark.parametrize("turn", [2 * np.pi, 360.0])
def test_angles_are_cut_opposite_their_mean(turn):
    rng = np.random.default_rng(0)
    straight = 0.02 * turn * rng.standard_normal((4, 500, 2))
    straight += np.array([0.0, 0.4]) * turn  # the first at the seam
    result = unwrapped(np.mod(straight, turn), turn, axis=(0, 1))
    np.testing.assert_allclose(np.mod(result - straight + turn / 2, turn), turn / 2, atol=1e-9)
    np.testing.assert_allclose(result.std((0, 1)), straight.std((0, 1)), rtol=1e-9)
    assert np.all((result.mean((0, 1)) > -0.05 * turn) & (result.mean((0, 1)) < 1.05 * turn))


def test_unwrapped_angles_stay_together():
    draws = np.array([[359.0, 1.0, 3.0, 357.0]])
    moved = unwrapped(draws, 360.0)
    assert np.ptp(moved) == pytest.approx(6.0)
    assert np.cos(np.radians(moved)) == pytest.approx(np.cos(np.radians(draws)))


@pytest.mark.parametrize(("words", "text"), [("a", "a"), ("ab", "a and b"), ("abc", "a, b and c")])
def test_lists_in_prose(words, text):
    assert join_words(words) == text
