"""`lcbayes albedo-area` from a file to its results, and its refusals."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest

import lcbayes
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.physics.bodies import mesh, shapes
from lcbayes.results.result import DO_NOT_TRUST
from tests.helpers.known_bodies import curve_of
from tests.helpers.refused_input import assert_refused
from tests.helpers.results_folders import figures

BRICK = shapes.box(2.0, 1.4, 0.8)
QUICK = ["--n-normals", "250", "--nulls", "19", "--bootstrap", "20"]


@pytest.fixture
def brick(tmp_path):
    lcbayes.write(curve_of(BRICK), tmp_path / "brick.csv")
    return tmp_path / "brick.csv"


def test_a_brick_from_file_to_shape(brick, tmp_path, capsys, look):
    out = tmp_path / "out"
    argv = ["albedo-area", str(brick), "--attitude", "none", "-o", str(out), *QUICK]
    assert main.main(argv) == EXIT_DONE
    output = capsys.readouterr().out
    assert "6 flat facets at least" in output
    assert "of 3 angles between 3 axes of facets are 90 degrees" in output
    assert "shape: 6 faces" in output
    assert (
        len(re.findall(r"[\d.]+ ± [\d.]+ m² towards longitude .* deg, ± [\d.]+ deg", output)) == 6
    )
    result = json.loads((out / "summary.json").read_text())
    assert result["trusted"]
    assert result["n_obs"] == 300
    assert len(result["facets"]) == 6
    assert [f["albedo_area"] for f in result["facets"]] == pytest.approx(
        sorted(BRICK.areas, reverse=True), rel=0.02
    )
    assert result["shape"]["volume"] == pytest.approx(2.24, rel=0.02)
    assert result["shape"]["dimensions"] == pytest.approx([2.0, 1.4, 0.8], rel=0.02)
    assert len(result["distribution"]["albedo_area_sd"]) == 250
    assert {c["name"] for c in result["cues"]} == {
        "clusters",
        "angle-90",
        "angle-60",
        "angle-45",
        "arc",
        "uniform",
    }
    body = mesh.read_body(out / "shape.obj")
    assert np.sort(body.areas) == pytest.approx(np.sort(BRICK.areas), rel=0.02)
    assert (out / "shape.ply").read_text().startswith("ply\n")
    assert figures(out) == {"albedo-area", "fit", "shape"}
    with (out / "tables" / "facets.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["albedo_area_m2"]) for row in rows] == [
        f["albedo_area"] for f in result["facets"]
    ]
    look(out / "report.html", turning=1)
    (out / "figures" / "stale.svg").write_text("")
    # the same command gives the same numbers
    assert main.main([*argv[:-6], "--json", *QUICK]) == EXIT_DONE
    assert json.loads(capsys.readouterr().out) == result
    assert not (out / "figures" / "stale.svg").exists()


def test_relative_curves_have_proportions_alone(tmp_path, capsys):
    group = np.arange(300) // 30
    curve = curve_of(BRICK, curve=group, free_scale=np.ones(10, bool))
    lcbayes.write(curve, tmp_path / "relative.csv")
    out = tmp_path / "out"
    argv = ["albedo-area", str(tmp_path / "relative.csv"), "--attitude", "none", "-o", str(out)]
    assert main.main([*argv, *QUICK, "--nulls", "0"]) == EXIT_DONE
    output = capsys.readouterr().out
    assert "(size unknown)" in output
    assert len(re.findall(r"[\d.]+ ± [\d.]+ % towards", output)) == 6
    result = json.loads((out / "summary.json").read_text())
    assert not result["calibrated"]
    assert result["shape"]["volume"] is None
    assert result["shape"]["dimensions"] == pytest.approx([2.5, 1.75, 1.0], rel=0.05)
    assert len(result["scales"]) == 10


def test_smoothing_gives_the_shape_of_the_grid(brick, tmp_path, capsys):
    out = tmp_path / "out"
    argv = ["albedo-area", str(brick), "--attitude", "none", "-o", str(out), "--nulls", "0"]
    assert main.main([*argv, "--smoothness", "0.1", "--bootstrap", "0"]) in (
        EXIT_DONE,
        EXIT_NOT_TRUSTED,
    )
    assert "grid normals with area" in capsys.readouterr().out
    result = json.loads((out / "summary.json").read_text())
    assert result["facets"] == []
    assert result["shape"]["n_faces"] > 20


def test_a_wrong_attitude_says_so_first(brick, tmp_path, capsys):
    argv = ["albedo-area", str(brick), "--omega", "0.1,0.2,0.3", "-o", str(tmp_path / "out")]
    assert main.main([*argv, "--nulls", "0", "--bootstrap", "0"]) == EXIT_NOT_TRUSTED
    assert capsys.readouterr().out.startswith(f"{DO_NOT_TRUST}\n  - chi2 is")
    assert not json.loads((tmp_path / "out" / "summary.json").read_text())["trusted"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "one attitude is needed, and none is given; give --pole LON,LAT with --period"),
        (["--attitude", "none", "--omega", "0,0,1"], "--attitude and --omega are given"),
        (["--pole", "3,4"], "both --pole LON,LAT and --period HOURS"),
        (["--pole", "3", "--period", "4"], "--pole is '3'; expected 2 numbers in deg"),
        (["--omega", "0,0,fast"], "--omega is '0,0,fast'; expected 3 numbers in rad/s"),
        (["--attitude", "none", "--material", "chalk"], "unknown law 'chalk'; available:"),
        (["--attitude", "none", "--nulls", "-1"], "--nulls is -1; expected a whole number >= 0"),
        (
            ["--attitude", "none", "--n-normals", "3"],
            "--n-normals is 3; expected a whole number >= 50",
        ),
        (
            ["--attitude", "none", "--facet-cost", "nan"],
            "--facet-cost is nan; expected a number >= 0",
        ),
    ],
)
def test_faults_are_one_line(brick, tmp_path, capsys, options, message):
    out = tmp_path / "out"
    argv = ["albedo-area", str(brick), "-o", str(out), *options]
    assert_refused(argv, out, message, capsys)
