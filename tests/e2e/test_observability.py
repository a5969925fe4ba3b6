"""`lcbayes observability` from a scenario to its page, and its refusals."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest

from lcbayes import cli
from lcbayes.errors import EXIT_BAD_INPUT, EXIT_DONE


def test_a_scenario_is_judged_and_planned(tmp_path, capsys, look):
    out = tmp_path / "out"
    argv = ["observability", "two-facet-spin", "-o", str(out), "--plan", "5", "--visit", "20"]
    assert cli.main([*argv, "--json"]) == EXIT_DONE
    told = json.loads(capsys.readouterr().out)
    found = json.loads((out / "observability.json").read_text())
    assert told == found
    assert len(found["measurements"]) == found["n_measurements"] == 122
    one = next(row for row in found["measurements"] if row["rank"] == 1)
    gradient, null = np.array(one["mag_gradient"]), np.array(one["nullspace"])
    assert one["information"] == pytest.approx(np.sum(gradient**2) / one["mag_err"] ** 2)
    assert np.abs(null @ gradient).max() < 1e-9 * np.linalg.norm(gradient)
    campaign = found["campaign"]
    fisher = np.array(campaign["fisher"])
    assert fisher.shape == (9, 9) == (len(campaign["parameters"]),) * 2
    assert campaign["crlb_sd"] == pytest.approx(np.sqrt(np.diag(np.linalg.inv(fisher))), rel=1e-6)
    assert campaign["unobservable"] == []
    assert 0.05 > max(campaign["nonlinearity"]) > min(campaign["nonlinearity"]) >= 0.0
    rows = list(csv.DictReader((out / "schedule.csv").read_text().splitlines()))
    assert [row["rank"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert float(rows[-1]["sd_after_deg"]) == pytest.approx(found["plan"]["sd_after"], rel=1e-5)
    page = (out / "observability.html").read_text()
    assert "All of the 9 unknowns are seen." in page
    look(out / "observability.html", turning=1)
    assert not re.search(r"(?:src|href)=\"(?!data:)", page)
    names = {p.name for p in (out / "figures").iterdir()}
    assert names == {f"{n}.svg" for n in ("bounds", "hemisphere", "information", "plan", "seen")}
    assert {p.name for p in out.iterdir() if p.name != ".lock"} == {
        "observability.json", "observability.html", "schedule.csv", "figures",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["nowhere"], "no file and no scenario is called 'nowhere'"),
        (["one-facet", "--plan", "0"], "--plan is 0; expected a number of visits >= 1"),
        (["one-facet", "--visit", "-3"], "--visit is -3; expected seconds >= 0"),
        (["one-facet", "--posterior", "fit"], "say how many visits with --plan N"),
        (["one-facet", "--unknown", "shape"], "unknown group of parameters 'shape'"),
    ],
)
def test_faults_are_said_in_one_line(options, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert cli.main(["observability", *options, "-o", str(out)]) == EXIT_BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("lcbayes observability: ")
    assert message in said
    assert not out.exists()
