"""`lcbayes observability` from a scenario to its page, and its refusals."""

from __future__ import annotations

import csv
import json
import re
from contextlib import redirect_stdout
from io import StringIO
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from lcbayes.analysis import style
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE
from tests.helpers.browser_pages import NARROW
from tests.helpers.results_folders import figures


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """The folder of a scenario judged and planned, and what was printed."""
    out = tmp_path_factory.mktemp("planned") / "out"
    argv = ["observability", "two-facet-spin", "-o", str(out), "--plan", "5", "--visit", "20"]
    with redirect_stdout(StringIO()) as said:
        assert main.main([*argv, "--json"]) == EXIT_DONE
    return out, json.loads(said.getvalue())


def test_a_scenario_is_assessed_and_planned(planned, look):
    out, printed = planned
    result = json.loads((out / "observability.json").read_text())
    assert printed == {"schema": 4, "task": "observability", "trusted": True, "reasons": []} | {
        name: value for name, value in result.items() if name != "measurements"
    }
    assert len(result["measurements"]) == result["n_measurements"] == 122
    one = next(row for row in result["measurements"] if row["rank"] == 1)
    gradient, null = np.array(one["mag_gradient"]), np.array(one["nullspace"])
    assert one["information"] == pytest.approx(np.sum(gradient**2) / one["mag_err"] ** 2)
    assert np.abs(null @ gradient).max() < 1e-9 * np.linalg.norm(gradient)
    campaign = result["campaign"]
    fisher = np.array(campaign["fisher"])
    assert fisher.shape == (9, 9) == (len(campaign["parameters"]),) * 2
    assert campaign["crlb_sd"] == pytest.approx(np.sqrt(np.diag(np.linalg.inv(fisher))), rel=1e-6)
    assert campaign["unobservable"] == []
    assert 0.05 > max(campaign["nonlinearity"]) > min(campaign["nonlinearity"]) >= 0.0
    rows = list(csv.DictReader((out / "tables" / "schedule.csv").read_text().splitlines()))
    assert [row["rank"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert float(rows[-1]["sd_after_deg"]) == pytest.approx(result["plan"]["sd_after"], rel=1e-5)
    text = (out / "report.html").read_text()
    assert "All of the 9 unknowns are seen." in text
    look(out / "report.html", turning=1)
    assert not re.search(r"(?:src|href)=\"(?!data:)", text)
    assert figures(out) == {"bounds", "hemisphere", "information", "plan", "seen"}
    assert {p.name for p in out.iterdir() if p.name != ".lock"} == {
        "observability.json",
        "report.html",
        "summary.json",
        "run.toml",
        "tables",
        "figures",
    }


def test_a_telephone_shows_figures_at_a_size_that_can_be_read(planned, browser):
    tab = browser.new_page(viewport=NARROW)
    tab.goto((planned[0] / "report.html").as_uri())
    shares = tab.evaluate(
        "[...document.querySelectorAll('figure img:not(.still)')]"
        ".map((i) => i.clientWidth / i.naturalWidth)"
    )
    beyond = tab.evaluate("document.documentElement.scrollWidth - innerWidth")
    tab.close()
    assert len(shares) == 5
    assert min(shares) > 0.7
    assert beyond <= 0


NAMED = """<figure class="shape"><div class="viewer" hidden><canvas></canvas></div>
<script type="application/json">{"polygons": [], "solid": true, "axis": null, "view": [0, 0],
"labels": [[1, 0, 0], [1, 0.03, 0.03], [1, 0.01, -0.02], [1, 0.9, 0]],
"names": ["Sun", "best", "facet 6", "far"]}</script></figure><script>"""


def test_names_on_the_sphere_do_not_overprint_each_other(browser):
    tab = browser.new_page()
    tab.set_content(
        "<canvas></canvas><script>window.said = {}; const pen ="
        " CanvasRenderingContext2D.prototype, old = pen.fillText; pen.fillText = function (s, x, y)"
        " { said[s] = [x, y, this.measureText(s).width]; old.call(this, s, x, y); }</script>"
        + NAMED
        + Path(style.__file__).with_name("templates").joinpath("viewer.js").read_text()
        + "</script>"
    )
    said = tab.evaluate("said")
    tab.close()
    assert set(said) == {"Sun", "best", "facet 6", "far"}
    for (x, y, wide), (u, v, across) in combinations(said.values(), 2):
        assert abs(y - v) >= 12.0 or abs(x - u) > (wide + across) / 2.0
    assert said["far"][1] == said["Sun"][1]  # where nothing is in the way it stands at its place


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["nowhere"], "no file and no scenario is called 'nowhere'"),
        (["one-facet", "--plan", "0"], "--plan is 0; expected a whole number >= 1"),
        (["one-facet", "--visit", "-3"], "--visit is -3; expected a number >= 0 s"),
        (["one-facet", "--posterior", "fit"], "say how many visits with --plan N"),
        (["one-facet", "--unknown", "shape"], "unknown group of parameters 'shape'"),
    ],
)
def test_faults_are_said_in_one_line(options, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert main.main(["observability", *options, "-o", str(out)]) == EXIT_BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("lcbayes observability: ")
    assert message in said
    assert not out.exists()
