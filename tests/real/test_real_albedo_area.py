"""The albedo-area distribution of an asteroid whose spin is known."""

import numpy as np
import pytest

from lcbayes.core.constants import HOUR_S
from lcbayes.data.read import read
from lcbayes.inversion.albedo_area.distribution import grid, solve
from lcbayes.inversion.albedo_area.kernel import Material, columns
from lcbayes.inversion.albedo_area.observed import Observed
from lcbayes.physics.attitude.laws import PrincipalAxis
from lcbayes.physics.bodies.closure import close, closure
from lcbayes.physics.bodies.minkowski import minkowski

pytestmark = pytest.mark.real


def test_ariadne_fits_as_well_as_least_squares_over_harmonics(data_dir):
    curve = read(data_dir / "damit" / "43_Ariadne_rel.lcs")
    materials = (Material.parse("lommel-seeliger-lambert"),)
    misfit = {}
    for pole in ((253.2, -17.2), (100.0, 40.0)):
        attitude = PrincipalAxis(*pole, 5.76198 * HOUR_S, t0_s=0.5 * float(np.ptp(curve.t)))
        seen = Observed.of(curve, attitude)
        normals, which = grid(300, materials)
        result = solve(seen, normals, which, columns(seen, normals, which, materials))
        # each curve is given with mean 1
        misfit[pole] = float(np.sum((seen.flux - result.flux) ** 2))
        if pole[0] == 253.2:
            assert closure(normals, result.areas) < 0.05
            extent = np.sort(minkowski(normals, close(normals, result.areas)).dimensions)
            assert 1.2 < extent[2] / extent[1] < 2.0
    # the published solution, with 300 facets of harmonics to degree 6, has 0.3533
    assert misfit[253.2, -17.2] < 0.3533
    assert misfit[100.0, 40.0] > 3.0
