"""Names of the elements of reported variables."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from lcbayes.modelling.variables import named

DRAWS = xr.Dataset(
    {
        "clock_offset": (("chain", "draw", "observer"), np.zeros((1, 3, 2))),
        "zero_point": (("chain", "draw", "calibration"), np.zeros((1, 3, 2))),
        "phi": (("chain", "draw", "facet"), np.zeros((1, 3, 2))),
        "inertia": (("chain", "draw", "axis", "other_axis"), np.zeros((1, 3, 3, 3))),
    },
    {"observer": ["A", "B"], "facet": [0, 1], "axis": ["x", "y", "z"], "calibration": [0, 1]},
)


@pytest.mark.parametrize(
    ("element", "shown"),
    [
        ("clock_offset[1]", "clock_offset[B]"),
        ("zero_point[1]", "zero_point[1]"),  # of a file without names
        ("phi[1]", "phi[1]"),
        ("inertia[0,1]", "inertia[0,1]"),
        ("omega_x_rad_s", "omega_x_rad_s"),
        ("size", "size"),
    ],
)
def test_an_element_has_the_name_of_its_observer(element, shown):
    assert named(element, DRAWS) == shown
