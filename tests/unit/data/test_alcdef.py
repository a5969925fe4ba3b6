"""ALCDEF files, written here by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

import lcbayes
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, InputError

HEAD = """\
STARTMETADATA
REVISEDDATA=FALSE
OBJECTNUMBER={number}
OBJECTNAME=Ariadne
OBJECTRA=12:34
OBJECTDEC=-05 12
PHASE=+11.3
SESSIONDATE=2020-03-0{night}
SESSIONTIME=04:00:00
FILTER=C
MAGBAND=V
LTCAPP={applied}
COMMENT=COMMENT may be repeated, and hold = signs
COMMENT=second
DELIMITER={delimiter}
ENDMETADATA
"""
PERIOD_H = 5.762


def block(rows, *, night=1, number=43, applied="NONE", delimiter="PIPE"):
    sign = {"PIPE": "|", "TAB": "\t"}[delimiter]
    head = HEAD.format(number=number, night=night, applied=applied, delimiter=delimiter)
    return head + "".join(f"DATA={sign.join(row)}\n" for row in rows) + "ENDDATA\n"


def saved(tmp_path, *blocks):
    path = tmp_path / "43.txt"
    path.write_text("# a remark\n" + "".join(blocks))
    return path


def test_blocks_are_curves_of_unknown_zero_point(tmp_path):
    first = block([("2458910.75", "+0.5", "0.02", "1.1"), ("2458910.5", "0.25", "0.01", "1.2")])
    second = block([("2458911.5", "14.0", "0.03")], night=2, applied="POINT", delimiter="TAB")
    curve = lcbayes.read(saved(tmp_path, first, second), geometry=False)
    assert curve.epoch_jd is not None
    np.testing.assert_array_equal(
        curve.epoch_jd + curve.t / 86400, [2458910.5, 2458910.75, 2458911.5]
    )
    np.testing.assert_array_equal(curve.brightness, [0.25, 0.5, 14.0])  # sorted within a block
    assert curve.error is not None
    np.testing.assert_array_equal(curve.error, [0.01, 0.02, 0.03])
    np.testing.assert_array_equal(curve.curve, [0, 0, 1])
    assert curve.free_scale.all()
    assert set(curve.band) == {"C"}
    assert curve.brightness_only
    assert "times of 1 of 2 blocks include the light time" in curve.source["notes"]


def test_errors_that_some_points_lack_are_left_out(tmp_path):
    rows = [("2458910.5", "1.0", "0.02"), ("2458910.6", "1.1"), ("2458910.7", "1.2", "0")]
    curve = lcbayes.read(saved(tmp_path, block(rows)), geometry=False)
    assert curve.error is None
    assert "2 of 3 points have no error" in curve.source["notes"]


def test_look_finds_the_period_and_other_commands_refuse(tmp_path, capsys):
    rng = np.random.default_rng(5)
    blocks = []
    for night in range(1, 7):
        jd = 2458910.6 + night + np.arange(0, 0.25, 0.006)
        mag = 0.2 * np.cos(4 * np.pi * 24 * (jd - 2458910.0) / PERIOD_H) + rng.normal(
            0, 0.01, jd.size
        )
        mag += 0.05 * np.cos(2 * np.pi * 24 * (jd - 2458910.0) / PERIOD_H) + rng.normal(0, 0.5)
        blocks.append(
            block(
                [(f"{a:.6f}", f"{b:+.3f}", "0.010") for a, b in zip(jd, mag, strict=True)],
                night=night,
            )
        )
    path = saved(tmp_path, *blocks)
    assert main.main(["look", str(path), "--json"]) == EXIT_DONE
    content = json.loads(capsys.readouterr().out)
    assert content["format"] == "alcdef"
    assert content["periods"]["listed"][0]["period_s"] / 3600 == pytest.approx(PERIOD_H, rel=2e-3)
    (advice,) = content["commands"]
    assert advice["command"].startswith("lcbayes.read(")
    assert "light time" in advice["why"]
    assert main.main(["spin", str(path), "-o", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    told = capsys.readouterr().err
    assert "43.txt is ALCDEF, which holds no directions" in told
    assert told.count("\n") == 1


def test_directions_added_in_python_make_it_a_light_curve(tmp_path):
    rows = [(f"{2458910.5 + 0.01 * i}", f"{0.1 * i}", "0.01") for i in range(5)]
    table = lcbayes.read(saved(tmp_path, block(rows)), geometry=False).to_pandas()
    for name, value in zip(("sun_x", "sun_y", "sun_z"), (1.0, 0.2, 0.0), strict=True):
        table[name] = value
    for name, value in zip(("obs_x", "obs_y", "obs_z"), (0.9, -0.3, 0.1), strict=True):
        table[name] = value
    curve = lcbayes.read(table)
    assert not curve.brightness_only
    assert curve.free_scale.all()
    np.testing.assert_allclose(curve.brightness, 0.1 * np.arange(5))


GOOD = block([("2458910.5", "1.0", "0.02")])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (GOOD + block([("2458911.5", "1.0")], number=44), r"several objects \(43, 44\)"),
        (GOOD.replace("ENDDATA\n", ""), "ends inside a block; the file is cut short"),
        (GOOD.replace("|1.0", "|one"), "line 18: 'one' is no number"),
        (GOOD.replace("|1.0|0.02", ""), "line 18: DATA needs a Julian date and a magnitude"),
        (GOOD.replace("PIPE", "COMMA"), "DELIMITER is COMMA; expected one of: PIPE, TAB"),
        (GOOD.replace("ENDMETADATA\n", ""), "line 17: 'DATA=2458910.5.* is out of place"),
        (GOOD + "ENDDATA\n", "line 20: ENDDATA is out of place"),
        (GOOD.replace("2458910.5", "58910.5"), "the Julian date has 1 value outside the years"),
        (GOOD.replace("DATA=2458910.5|1.0|0.02\n", ""), "line 18: the block has no DATA line"),
    ],
)  # fmt: skip
def test_what_is_refused(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        lcbayes.read(saved(tmp_path, text), geometry=False)


def test_elements_of_a_satellite_are_refused(tmp_path):
    with pytest.raises(InputError, match="is of an asteroid; leave out --tle and --site"):
        lcbayes.read(saved(tmp_path, GOOD), site="1,2,3", geometry=False)
