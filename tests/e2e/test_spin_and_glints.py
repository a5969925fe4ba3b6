"""`lcbayes spin` and `lcbayes glints` from a file to their results, and their refusals."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

import lcbayes
from lcbayes.analysis import glints_report
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.inversion.glints import analyse
from lcbayes.modelling.known_spin import Period
from lcbayes.physics.attitude.laws import ConstantRate
from lcbayes.results.result import DO_NOT_TRUST
from lcbayes.results.start import read_start
from tests.helpers.low_earth_orbit import spinner, steady
from tests.helpers.refused_input import assert_refused
from tests.helpers.results_folders import figures
from tests.helpers.simulated_glints import no_flashes, wire_flashes

RESULTS = {"summary.json", "report.html", "run.toml", "figures", "tables", ".lock"}


def test_a_spin_from_file_to_pole(tmp_path, capsys, look):
    curve, truth = spinner(2013, 4, 50.0, "cylinder")
    lcbayes.write(curve, tmp_path / "passes.csv")
    out = tmp_path / "out"
    argv = ["spin", str(tmp_path / "passes.csv"), "-o", str(out)]
    assert main.main(argv) == EXIT_DONE
    output = capsys.readouterr().out
    assert "sidereal period" in output
    curve_file, onward = str(tmp_path / "passes.csv"), f"{out}-fit"
    assert f"lcbayes fit {curve_file} --n-facets 3 --start-from {out} -o {onward}" in output
    body = f"--model body --body rocket-stage --start-from {out}"
    assert f"lcbayes fit {curve_file} {body} -o {out}-body" in output
    start = read_start(out, lcbayes.read(tmp_path / "passes.csv"))
    ranges = [Period.of(text) for text in start.periods.split(",")]
    assert any(p.low < truth["period"] < p.high for p in ranges)
    result = json.loads((out / "summary.json").read_text())
    assert (result["schema"], result["task"], result["trusted"]) == (4, "spin", True)
    best = result["solutions"][0]
    assert best["period_s"] == pytest.approx(truth["period"], rel=1e-3)
    assert best["period_h"] == pytest.approx(best["period_s"] / 3600)
    lon, lat = np.radians([best["pole_lon_deg"], best["pole_lat_deg"]])
    pole = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    assert np.degrees(np.arccos(truth["pole"] @ pole)) < 10
    assert figures(out) == {"periodogram", "synodic", "pole"}
    assert {p.name for p in out.iterdir()} == RESULTS
    rows = list(csv.DictReader((out / "tables" / "solutions.csv").read_text().splitlines()))
    assert float(rows[0]["sidereal_period_s"]) == best["period_s"]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert '<table data-name="solutions">' in page
    assert "sidereal period (s)</th>" in page
    look(out / "report.html", turning=1)


def test_the_light_curve_is_printed_where_no_figure_shows_it(tmp_path, browser):
    """`lcbayes spin` has figures of periods and poles, and its light curve on the page alone."""
    lcbayes.spin(steady(3, 50.0, spinning=True), out=tmp_path / "out")
    tab = browser.new_page()
    tab.goto((tmp_path / "out" / "report.html").as_uri())
    assert tab.is_visible("#explore .controls >> nth=0")
    tab.emulate_media(media="print")
    assert tab.is_visible("[data-is=chart] canvas")
    assert not tab.is_visible("#explore .controls >> nth=0")
    tab.close()


def test_no_pole_where_there_is_none(tmp_path, capsys):
    lcbayes.write(steady(1, 50.0, spinning=False), tmp_path / "noise.csv")
    argv = ["spin", str(tmp_path / "noise.csv"), "-o", str(tmp_path / "out"), "--json"]
    assert main.main(argv) == EXIT_NOT_TRUSTED
    result = json.loads(capsys.readouterr().out)
    assert not result["trusted"]
    assert result["solutions"] == []
    assert result["photometric_period_s"] is None
    assert result["reasons"][0]["code"] == "no-period"
    assert "no period is seen" in result["reasons"][0]["text"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "No pole and no sidereal period.</h2>" in page


def test_glints_from_file_to_directions(tmp_path, capsys, look):
    curve, attitude, axis = wire_flashes(3, 50.0)
    lcbayes.write(curve, tmp_path / "wire.csv")
    out = tmp_path / "out"
    assert isinstance(attitude, ConstantRate)
    omega = ["--omega", ",".join(map(str, attitude.omega_rad_s))]
    assert main.main(["glints", str(tmp_path / "wire.csv"), *omega, "-o", str(out)]) == EXIT_DONE
    output = capsys.readouterr().out
    assert "cylinder: axis" in output
    assert max(map(len, output.splitlines()[:-2])) <= 100
    result = json.loads((out / "summary.json").read_text())
    assert abs(np.dot(result["cylinder"]["vector"], axis)) > np.cos(np.radians(0.5))
    assert result["glints"][0]["sharp_and_small"] in (True, False)
    assert figures(out) == {"glints", "directions"}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.split('<table data-name="glints">')[1].count("<tr>") == 1 + len(result["glints"])
    look(out / "report.html", turning=1)
    lcbayes.write(no_flashes(3, 50.0), tmp_path / "none.csv")
    argv = ["glints", str(tmp_path / "none.csv"), "-o", str(tmp_path / "none")]
    assert main.main(argv) == EXIT_NOT_TRUSTED
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == DO_NOT_TRUST
    assert lines[1].startswith("  - no glint stands out")
    assert "No direction found.</h2>" in (tmp_path / "none" / "report.html").read_text()


def test_glints_are_listed_by_utc_and_pass():
    curve, attitude, _ = wire_flashes(3, 50.0)
    result = analyse(curve, attitude)
    dated = replace(curve, epoch_jd=2456658.5)  # 2014-01-01
    row = glints_report.words(result, dated)[2]
    first = result.glints[0]
    moment = datetime(2014, 1, 1) + timedelta(seconds=first.t)
    assert row.startswith(f"  1: {moment:%Y-%m-%dT%H:%M}:")
    seconds, number = row.split()[1:3]
    assert abs(float(seconds[17:-1]) - moment.second - moment.microsecond / 1e6) < 2 * first.t_error
    assert int(number) == first.stretch + 1


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["spin", "--shuffles", "9"], "--shuffles is 9; expected a whole number >= 99"),
        (["glints", "--sun-tracking", "0,0"], "--sun-tracking is '0,0'; expected 3 numbers"),
        (["glints", "--sun-tracking", "0,0,0"], "expected an axis"),
        (["glints", "--alarm", "2"], "--alarm is 2; expected a number between 0 and 1"),
        (["glints", "--longest", "-1"], "--longest is -1; expected a number > 0 s"),
        (["glints", "--sun-tracking", "0,0,1", "--omega", "0,0,1"], "has no spin"),
    ],
)
def test_faults_are_one_line(tmp_path, capsys, argv, message):
    lcbayes.write(steady(1, 50.0, spinning=False), tmp_path / "noise.csv")
    out = tmp_path / "out"
    command = [argv[0], str(tmp_path / "noise.csv"), *argv[1:], "-o", str(out)]
    assert_refused(command, out, message, capsys)
