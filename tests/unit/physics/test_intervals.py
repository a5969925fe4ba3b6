"""Edges in convex polygons, where rounding alone tells the direction of two edges apart."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.core.jax_setup import jnp
from lcbayes.physics.bodies.intervals import Ends, in_polygons

TURNS = np.random.default_rng(11).uniform(0.0, 2.0 * np.pi, 40)


def turned(points: np.ndarray, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s], [-s, c]])


def ends(start: np.ndarray, end: np.ndarray, *shape: int) -> Ends:
    """Ends (N, 2) in arrays of a shape."""
    ax, ay, bx, by = (jnp.asarray(x[:, k]).reshape(shape) for x in (start, end) for k in (0, 1))
    return (ax, ay), (bx, by)


def lengths(angle: float, start: np.ndarray, end: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Share of edges (N, 2) that lies in a polygon (K, 2), all turned."""
    start, end, corners = (turned(x, angle) for x in (start, end, polygon))
    edges = ends(start, end, 1, len(start), 1)
    sides = ends(corners, np.roll(corners, -1, axis=0), 1, 1, len(corners), 1)
    into, out = in_polygons(edges, sides)
    return np.clip(np.asarray(out - into).ravel(), 0.0, 1.0)


SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@pytest.mark.parametrize("angle", TURNS[:10])
@pytest.mark.parametrize("aside", [1e-9, -1e-9, 0.3, -0.3])
def test_an_edge_along_a_side_lies_on_the_side_of_its_middle(angle, aside):
    start, end = np.array([[0.2, aside], [0.9, aside]]), np.array([[0.7, aside], [0.1, aside]])
    np.testing.assert_array_equal(lengths(angle, start, end, SQUARE), float(aside > 0.0))


@pytest.mark.parametrize("angle", TURNS[:10])
def test_a_side_without_length_but_for_rounding_cuts_nothing(angle):
    rng = np.random.default_rng(int(1e6 * angle))
    doubled = np.insert(SQUARE + 1.0, 2, SQUARE[1] + 1.0 + 4e-16 * rng.choice([-1, 1], 2), axis=0)
    start, end = np.array([[1.1, 1.2]]), np.array([[1.8, 1.9]])
    np.testing.assert_array_equal(lengths(angle, start, end, doubled), 1.0)


def test_edges_across_are_cut_where_they_cross():
    start, end = np.array([[-1.0, 0.5], [0.5, 0.5]]), np.array([[1.0, 0.5], [0.5, 3.0]])
    for angle in TURNS:
        np.testing.assert_allclose(lengths(angle, start, end, SQUARE), [0.5, 0.2], atol=1e-14)


@pytest.mark.parametrize("height", [1e-3, 1e-6, 1e-9])
def test_an_edge_that_crosses_a_side_at_a_small_angle_is_cut_there(height):
    start = np.array([[0.2, -height], [0.3, 2 * height]])
    end = np.array([[0.8, height], [0.8, -height]])
    for angle in TURNS[:10]:
        right = [0.5, 2.0 / 3.0]
        np.testing.assert_allclose(lengths(angle, start, end, SQUARE), right, atol=1e-15 / height)
