"""The result of `lcbayes.simulate`."""

from __future__ import annotations

import json

import numpy as np
import pytest

import lcbayes
from lcbayes.core.errors import InputError


def test_a_simulation_is_a_table_and_two_files(tmp_path):
    result = lcbayes.simulate("one-facet", seed=1)
    table = result.summary()
    np.testing.assert_array_equal(table["flux"], result.data.brightness)
    np.testing.assert_array_equal(table["flux_err"], result.data.error)
    points = f"{result.data.n_obs} points of {result.truth['scenario']}"
    assert result.lines()[0].startswith(points)
    path = result.save(tmp_path / "one.csv")
    (line,) = result.lines()
    assert line.startswith(f"{path}: {points}")
    truth = json.loads((tmp_path / line.rpartition("truth: ")[2]).read_text())
    assert truth["seed"] == 1
    with pytest.raises(InputError, match="a simulation has no report"):
        result.report(tmp_path)
