"""A newcomer's file, from columns as they are to period, pole and report, by the documentation.

The light curve is that of `tests.helpers.newcomer`, which shares no code with the package.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_DONE, EXIT_NOT_TRUSTED
from lcbayes.geometry.spherical import unit_vector
from tests.helpers import newcomer

READING = ["--tle", "object.tle", "--site", ",".join(map(str, newcomer.SITE))]
FEW = ["--max-modes", "1", "--num-warmup", "100", "--num-samples", "100", "--num-chains", "2"]


def from_truth(pole: np.ndarray) -> float:
    """Angle of a vector to the true pole, deg."""
    cosine = pole @ unit_vector(*np.radians(newcomer.POLE_DEG)) / np.linalg.norm(pole)
    return float(np.degrees(np.arccos(cosine)))


@pytest.mark.slow
def test_from_a_file_to_period_pole_and_report(tmp_path: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    newcomer.write(tmp_path)
    assert main(["look", "tumbler.csv", *READING, "-o", "look"]) == EXIT_DONE
    assert "the rotation may take twice as long" in capsys.readouterr().out
    # one geometry more would be needed: the region is large, and its parts are listed
    assert main(["spin", "tumbler.csv", *READING, "-o", "spin"]) == EXIT_NOT_TRUSTED
    assert "--model body --body rocket-stage --start-from spin" in capsys.readouterr().out
    content = json.loads((tmp_path / "spin" / "summary.json").read_text())
    assert [reason["code"] for reason in content["reasons"]] == ["pole-undetermined"]
    best = content["region"][0]
    assert abs(best["period_s"] - newcomer.PERIOD_S) < 2 * best["period_sd_s"]
    pole = unit_vector(*np.radians([best["pole_lon_deg"], best["pole_lat_deg"]]))
    assert from_truth(pole) < best["radius_deg"]
    assert (tmp_path / "spin" / "report.html").is_file()

    # a body by its drawing, without its shadows: the fit says that they are missing
    argv = ["fit", "tumbler.csv", *READING, "--model", "body", "--body", "stage.toml", "-o", "out"]
    options = ["--set", "shadows=false", "--start-from", "spin", "--average", "2", "--seed", "1"]
    assert main([*argv, *options, *FEW]) == EXIT_NOT_TRUSTED
    check_fit(tmp_path / "out")


def check_fit(folder: Path) -> None:
    """Period and pole are near, and the refusal names the shadows."""
    content = json.loads((folder / "summary.json").read_text())
    texts = {reason["code"]: reason["text"] for reason in content["reasons"]}
    assert "the parts of the body shade one another (amount" in texts["data-not-explained"]
    assert "set shadows = true" in texts["shadows-left-out"]
    (mode,) = content["modes"]
    found = {name: value["mean"] for name, value in mode["parameters"].items()}
    omega = np.array([found[f"omega_{axis}_rad_s"] for axis in "xyz"])
    assert 2 * np.pi / np.linalg.norm(omega) == pytest.approx(newcomer.PERIOD_S, rel=1e-4)
    assert from_truth(omega) < 5.0
    assert (folder / "report.html").is_file()
