"""A scan's folder, read again as the start of a fit."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from lcbayes.core.errors import InputError
from lcbayes.modelling.variables import SPIN
from lcbayes.results.scan_start import read_scan
from tests.helpers import small_curves

SOLUTION = dict.fromkeys(SPIN, 1.0) | {"near_equal": True}
HEAD = 'schema = 2\ntask = "scan"\n'
INPUT = HEAD + '[input.curve]\npath = "a.csv"\nsha256 = "0"\n'


@pytest.mark.parametrize(
    ("summary", "toml", "says"),
    [
        ([1, 2], INPUT, "is no JSON object"),
        ({}, INPUT.replace("scan", "fit"), "holds no scan"),
        ({"model": "attitude-scan"}, INPUT, "found no constant spin"),
        ({"model": "attitude-scan", "solutions": [3, {}]}, INPUT, "found no constant spin"),
        ({"model": "attitude-scan"}, HEAD + "input = 3\n", "input is 3; expected a table"),
        ({"model": "attitude-scan"}, INPUT.replace('"0"', '"1"'), "is of another light curve"),
    ],
)
def test_a_damaged_scan_is_named_in_a_line(tmp_path, summary, toml, says):
    curve = replace(small_curves.curve(20), source={"sha256": "0"})
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    (tmp_path / "run.toml").write_text(toml)
    with pytest.raises(InputError, match=says):
        read_scan(tmp_path, curve)
    whole = {"model": "attitude-scan", "solutions": [SOLUTION]}
    (tmp_path / "summary.json").write_text(json.dumps(whole))
    (tmp_path / "run.toml").write_text(INPUT)
    assert read_scan(tmp_path, curve) == [SOLUTION]
