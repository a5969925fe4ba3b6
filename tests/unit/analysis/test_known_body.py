"""The tiles of a known body cover its faces, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from lcbayes.analysis.known_body import TILES, shape_of
from lcbayes.simulation.known_bodies.reader import body_text, with_shadows


def area(polygon: np.ndarray) -> float:
    """Of a convex polygon, by its convex hull in its own plane."""
    _, _, axes = np.linalg.svd(polygon - polygon.mean(axis=0))
    return float(ConvexHull((polygon - polygon.mean(axis=0)) @ axes[:2].T).volume)


@pytest.mark.parametrize("name", ["rocket-stage", "box-wing", "sphere"])
def test_tiles_cover_each_material(name):
    body = with_shadows(body_text(name), {}, 0.03)
    shape = shape_of(body, shaded=True)
    assert 0.8 * TILES < len(shape.tiles) < 2 * TILES
    longest = max(np.linalg.norm(t, axis=1).max() for t in shape.tiles)
    assert longest == pytest.approx(1.0)
    covered = np.zeros(len(shape.names))
    for tile, material in zip(shape.tiles, shape.material, strict=True):
        covered[material] += area(tile)
    labels, polygons = np.array(body.assembly.body.labels), body.assembly.polygons
    faces = [
        sum(area(p) for p, at in zip(polygons, labels, strict=True) if at == label)
        for label in shape.names
    ]
    np.testing.assert_allclose(covered / covered.sum(), np.divide(faces, sum(faces)), rtol=1e-9)
    assert bool(shape.blocking) == (name != "sphere")
    assert not shape_of(body, shaded=False).blocking
