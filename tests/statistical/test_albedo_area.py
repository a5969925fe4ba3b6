"""The spread given for facets is the spread of what is found from data sets of the same body."""

from __future__ import annotations

import numpy as np
import pytest

from lcbayes.inversion.albedo_area import bootstrap
from lcbayes.inversion.albedo_area.distribution import grid, solve
from lcbayes.inversion.albedo_area.facets import refine, select_facets
from lcbayes.inversion.albedo_area.kernel import LAMBERTIAN, columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import Fixed
from lcbayes.physics.bodies import shapes
from tests.helpers.false_alarms import EACH, squares
from tests.helpers.known_bodies import curve_of

BRICK = shapes.box(2.0, 1.4, 0.8)
ONE = (LAMBERTIAN,)


@pytest.mark.statistical(false_alarm=EACH)
@pytest.mark.slow
def test_areas_directions_and_volume_scatter_as_they_say():
    area, across, volume = [], [], []
    for seed in range(10):
        seen = Observed.of(curve_of(BRICK, 250, 0.02, seed), Fixed())
        normals, which = grid(200)
        matrix = columns(seen, normals, which)
        coarse = solve(seen, normals, which, matrix)
        result = select_facets(seen, refine(seen, coarse, matrix, ONE), ONE)
        index = np.argmax(BRICK.normals @ result.normals.T, axis=1)
        area.append((result.areas[index] - BRICK.areas) / result.area_sd[index])
        sine = np.linalg.norm(np.cross(BRICK.normals, result.normals[index]), axis=1)
        across.append(sine / result.direction_sd[index])
        draws = bootstrap.facets(seen, result, ONE, bootstrap.weights(seen, 40, seed))
        volume.append((np.median(draws.volumes) - 2.24) / draws.volumes.std())
    low, high = squares(60, 3)
    assert low < np.sum(np.square(area)) < high
    low, high = squares(120, 3)  # two components each
    assert low < np.sum(np.square(across)) < high
    # of the volume, which the choice of facets moves as well
    assert np.sum(np.square(volume)) < squares(10, 3)[1]
