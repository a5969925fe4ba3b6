"""`lcbayes attitude-test`, `single-facet` and `shape-match` from a file to their results."""

from __future__ import annotations

import json

import numpy as np
import pytest

import lcbayes
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.inversion.separated import ensemble
from lcbayes.physics.attitude import catalogue
from lcbayes.results.result import DO_NOT_TRUST
from tests.helpers.results_folders import figures
from tests.helpers.simulated_passes import measured, passes
from tests.helpers.single_facet_passes import crossing, flux_of, one_pass, with_noise

LVLH = catalogue.find("lvlh")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("curves")
    geometry = passes(550.0, 53.0, days=28, step=30.0)
    bodies = ensemble.draw(8, np.random.default_rng(0))
    lcbayes.write(measured(geometry, LVLH, bodies, 0.03, 0), folder / "weeks.csv")
    curve = one_pass(3, step=4.0)
    normal = crossing(curve, LVLH, 5)
    lcbayes.write(
        with_noise(curve, flux_of(curve, LVLH, normal, 1.0), 0.01, 1), folder / "pass.csv"
    )
    return folder


def test_attitude_test(files, tmp_path, capsys, look):
    out = tmp_path / "out"
    argv = [
        "attitude-test",
        str(files / "weeks.csv"),
        "-o",
        str(out),
        "--bodies",
        "199",
        "--law",
        "lvlh",
        "--law",
        "sun-north",
        "--law",
        "polar-spin:period_s=40",
    ]
    assert main.main(argv) == EXIT_DONE
    output = capsys.readouterr().out
    assert "lvlh" in output.splitlines()[1]
    assert "consistent" in output.splitlines()[1]
    result = json.loads((out / "summary.json").read_text())
    assert result["laws"][0]["name"] == "lvlh"
    assert figures(out) == {"laws", "pairs"}
    look(out / "report.html", turning=1)
    assert main.main(["attitude-test", "--list"]) == EXIT_DONE
    assert "yaw-steering" in capsys.readouterr().out
    assert main.main(["attitude-test", "x.csv", "-o", "y", "--law", "hover"]) == EXIT_BAD_INPUT
    assert "unknown attitude law 'hover'" in capsys.readouterr().err


def test_single_facet(files, tmp_path, capsys, look):
    out = tmp_path / "out"
    argv = ["single-facet", str(files / "pass.csv"), "-o", str(out), "--json"]
    assert main.main(argv) == EXIT_DONE
    result = json.loads(capsys.readouterr().out)
    assert result["trusted"]
    assert result["law"] == "lvlh"
    assert result["kind"]["visibility"] + result["kind"]["illumination"] > 0.0
    assert len(result["region"]["normals"]) >= 150
    assert figures(out) == {"edge", "normal"}
    look(out / "report.html", turning=1)


def test_shape_match_of_a_stabilised_object(files, tmp_path, capsys, look):
    out = tmp_path / "out"
    argv = ["shape-match", str(files / "weeks.csv"), "-o", str(out), "--shape", "cube"]
    assert main.main(argv) == EXIT_NOT_TRUSTED
    output = capsys.readouterr().out
    assert output.startswith(f"{DO_NOT_TRUST}\n  - ")
    assert "looks stabilised" in output or "independent" in output
    assert (out / "figures" / "distributions.svg").exists()
    look(out / "report.html", turning=1)
    assert main.main([*argv[:-1], "pyramid"]) == EXIT_BAD_INPUT
    assert "unknown shape 'pyramid'; available: cube, " in capsys.readouterr().err
