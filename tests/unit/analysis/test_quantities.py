"""Names of what is reported of a rotation."""

import numpy as np
import xarray as xr

from lcbayes.analysis.quantities import KNOWN, constant_axis, rotation
from lcbayes.modelling.variables import UNITS


def draws(**more) -> xr.Dataset:
    omega = np.array([0.001, 0.002, 0.03]) + np.zeros((2, 50, 3))
    given = {"omega": (("chain", "draw", "axis"), omega)}
    return xr.Dataset(given | more)


def test_a_constant_rotation_has_a_period():
    listed = {q.words: q.mean for q in rotation(draws(), "icrs")}
    rate = np.sqrt(0.001**2 + 0.002**2 + 0.03**2)
    np.testing.assert_allclose(listed["rotation rate"], np.degrees(rate))
    np.testing.assert_allclose(listed["rotation period"], 2.0 * np.pi / rate)
    assert {"spin axis, right ascension", "spin axis, declination"} <= set(listed)


def test_a_tumbling_body_has_an_initial_rate_and_axis_and_no_period():
    """Its angular velocity changes in time, and a turn at the first rate means nothing."""
    ratio = (("chain", "draw", "moment"), np.full((2, 50, 2), 0.5))
    tumbler = draws(inertia_ratio=ratio)
    listed = [q.words for q in rotation(tumbler, "inertial")]
    axis = ["initial spin axis, longitude", "initial spin axis, latitude"]
    assert listed == ["initial rotation rate", *axis]
    assert (constant_axis(tumbler), constant_axis(draws())) == ("angular momentum", "spin axis")


def test_the_report_describes_every_variable_with_a_unit():
    """In the unit that `posterior.nc` states."""
    stated = {name: unit for name, unit in UNITS.items() if name != "extinction"}  # per airmass
    assert {name: KNOWN[name][1] for name in stated if name in KNOWN} == stated
