"""The longest outline of a solid, against outlines along many directions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lcbayes.physics.bodies.outlines import longest_outline
from lcbayes.physics.bodies.solids import Solid, edges, flat_solid


def prism(n: int, top: float = 1.0) -> Solid:
    """A prism of n sides about z, or a frustum."""
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    vertices = np.concatenate([ring, top * ring + [0.0, 0.0, 3.0]])
    sides = [np.array([i, (i + 1) % n, n + (i + 1) % n, n + i]) for i in range(n)]
    return Solid(vertices, [*sides, np.arange(n)[::-1], n + np.arange(n)])


def projected(solid: Solid, directions: np.ndarray) -> int:
    """The largest number of corners of the projection along a direction."""
    most = 0
    for d in directions:
        u = np.linalg.svd(d[None])[2][1:]
        most = max(most, len(ConvexHull(solid.vertices @ u.T).vertices))
    return most


@pytest.mark.parametrize(
    ("solid", "expected"),
    [
        (prism(4), 6),
        (prism(24), 26),
        (prism(5), 7),
        (flat_solid(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])), 3),
    ],
)
def test_a_prism_of_n_sides_has_an_outline_of_two_more(solid, expected):
    assert longest_outline(edges(solid)) == expected


@pytest.mark.parametrize("solid", [prism(7), prism(8, top=0.4), prism(12, top=0.7)])
def test_no_direction_has_a_longer_outline(solid):
    """Projections in NumPy and SciPy, along random directions and some that lie along faces."""
    rng = np.random.default_rng(3)
    some = rng.normal(size=(3000, 3))
    bound = longest_outline(edges(solid))
    most = projected(solid, np.concatenate([some, [[0.0, 0.0, 1.0], [1.0, 1e-7, 0.0]]]))
    assert most <= bound < len(edges(solid).first)
    assert bound <= most + 1
