"""The page of a survey: few objects as marks, many as densities, failures with reasons."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lcbayes.analysis import survey_page
from lcbayes.results import survey_table
from lcbayes.results.reasons import reasons
from lcbayes.tasks.survey.result import Survey


def rows(number, failing=()):
    rng = np.random.default_rng(1)
    period, chance, amplitude = np.exp(rng.normal(2.0, 1.0, number)), *rng.uniform(size=(2, number))
    for i in range(number):
        known = dict.fromkeys(survey_table.COLUMNS) | {"object": f"<i>{i}", "seconds": 3.0}
        if i in failing:
            reason = f"survey.csv, line {i}: <i>{i} is damaged"
            yield [known | {"status": "failed", "reasons": reason}]
            continue
        known |= {"status": "not trusted", "reasons": "why", "frame": "icrs", "n_obs": 100}
        first = known | {
            "solution": 1,
            "period_h": period[i],
            "period_resolution_h": 1e-4,
            "pole_lon_deg": 360.0 * amplitude[i],
            "pole_lat_deg": 180.0 * chance[i] - 90.0,
            "period_probability": chance[i],
            "probability": 0.5 * chance[i],
            "amplitude_mag": amplitude[i],
            "rms": 0.1,
        }
        yield [first, first | {"solution": 2, "period_probability": 1.0}]


def made(number, failing=()):
    table = survey_table.SurveyTable(lambda: rows(number, failing))
    content, against = survey_table.summarise("survey.csv", table, number, 0, 60.0, "somebody")
    record = {"options": {"full": ["<i>4"]}, "catalogue": "survey.csv", "version": "0"}
    return Survey(content, reasons(against), record, table)


@pytest.mark.parametrize(
    ("number", "dense"), [(30, False), pytest.param(20_000, True, marks=pytest.mark.slow)]
)
def test_a_page(number, dense, tmp_path):
    result = made(number, failing=(3, 7))
    result.write_page(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert len(page) < 1_000_000
    content = result.content
    assert (content["n_failed"], content["n_not_trusted"]) == (2, number - 2)
    chance = np.array([r[0]["period_probability"] or 0.0 for r in rows(number, (3, 7))])
    assert content["n_unique"] == np.sum(chance >= 0.99)
    shown = [int(x) for x in re.findall(r"<tr><th scope=\"row\">(?:<a[^>]*>)?&lt;i&gt;(\d+)", page)]
    best = [i for i in np.argsort(-chance) if i not in (3, 7)][: survey_page.LISTED]
    assert shown[: len(best)] == best
    assert shown[len(best) :] == [3, 7]
    assert "<i>" not in page
    # the two failures differ in names and numbers alone
    assert [f["count"] for f in content["failures"]] == [2]
    assert "survey.csv, line 3: &lt;i&gt;3 is damaged" in page
    assert "Shades: number of objects" in page if dense else "One mark for each object" in page
    assert ('href="objects/i_4/report.html"' in page) == (4 in best)
    if dense:
        assert (tmp_path / "figures" / "survey.svg").read_text().count("<use") < 500


def test_without_a_result_there_is_no_figure(tmp_path):
    made(2, failing=(0, 1)).write_page(tmp_path)
    assert "<img" not in (tmp_path / "report.html").read_text()
    assert not (tmp_path / "figures").exists()


def test_the_page_says_what_the_benchmark_found():
    """The share of sure periods that are right, as measured last."""
    root = Path(survey_page.__file__).resolve().parents[1]
    results = (root / "benchmarks" / "RESULTS.md").read_text(encoding="utf-8")
    (right,) = re.findall(r"\| P ≥ 0\.99 \| \d+ of \d+ \| (\d+ of \d+) \|", results)
    page = (root / "analysis" / "templates" / "survey.html.j2").read_text(encoding="utf-8")
    assert f"{right} were right" in page
