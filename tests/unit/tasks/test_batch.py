"""What a batch is asked, and what it tells."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from lcbayes.analysis import batch_page, style
from lcbayes.core.errors import InputError
from lcbayes.data.options import ReadOptions
from lcbayes.results import catalogue
from lcbayes.results.reasons import reason, reasons
from lcbayes.tasks.batch.objects import Object, objects
from lcbayes.tasks.batch.result import Batch
from lcbayes.tasks.batch.worker import failed, fit_object, identity
from lcbayes.tasks.fit.options import FitOptions
from tests.helpers import browser_pages


def test_a_csv_catalogue_names_curves_options_and_settings(tmp_path):
    (tmp_path / "c.csv").write_text(
        "# tonight\nname,curve,n_facets,tle,seed,error\na b/1,one.csv,3,x.tle,,\n\n"
        ',"two, again.csv",,,7,0.1\n'
    )
    first, second = objects(tmp_path / "c.csv", {"seed": 2, "n_facets": 1, "spin": "none"})
    assert first == Object(
        "a_b_1",
        str(tmp_path / "one.csv"),
        ReadOptions(tle=tmp_path / "x.tle"),
        FitOptions(seed=2, n_facets=3, spin="none"),
    )
    assert second == Object(
        "two_again",
        str(tmp_path / "two, again.csv"),
        ReadOptions(error=0.1),
        FitOptions(seed=7, n_facets=1, spin="none"),
    )


def test_a_toml_catalogue_a_folder_and_a_pattern(tmp_path):
    (tmp_path / "c.toml").write_text(
        '[defaults]\nmodel = "mine.py"\nn_facets = 2\n[[objects]]\ncurve = "b.csv"\n'
        '[[objects]]\ncurve = "a.lcs"\nmodel = "convex-grid"\n'
    )
    for name in ("b.csv", "a.lcs", "notes.md"):
        (tmp_path / name).touch()
    listed = objects(tmp_path / "c.toml")
    assert [one.options.model for one in listed] == [str(tmp_path / "mine.py"), "convex-grid"]
    assert [one.options.n_facets for one in listed] == [2, 2]
    assert [one.name for one in objects(tmp_path)] == ["a", "b"]
    assert [one.name for one in objects(f"{tmp_path}/*.lcs")] == ["a"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name,n_facets\na,2\n", r"line 1: there is no column 'curve' in name, n_facets"),
        ("curve\nx/a.csv\ny/a.csv\n", r"line 3: two objects have the name 'a'"),
        ("curve,seed\na.csv,one\n", r"line 2: --seed is 'one'; expected a whole number"),
        ("curve\n", "names no object"),
        ("curve\na.csv,b\n", r"line 2: 2 cells under 1 heads"),
        (f"curve,name\na.csv,{'a' * 140_000}\n", r"line 2: field larger than field limit"),
        ("curve,name\na.csv,'a'\nb.csv,\"x\ny\"\nc.csv,1,2\n", r"line 5: 3 cells under 2"),
    ],
)
def test_faults_of_a_catalogue_name_the_line(tmp_path, text, said):
    path = tmp_path / "c.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        objects(path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("seed = [1]", r"--seed is \[1\]; expected a whole number"),
        ("num_chains = 4.7", r"--num-chains is 4\.7; expected a whole number"),
    ],
)
def test_values_of_another_kind_are_no_settings(tmp_path, line, said):
    path = tmp_path / "c.toml"
    path.write_text(f'[[objects]]\ncurve = "a.csv"\n{line}\n')
    with pytest.raises(InputError, match=rf"objects\[1\]: {said}"):
        objects(path)


def test_an_object_is_another_when_the_scan_it_starts_from_is(tmp_path):
    (tmp_path / "a.csv").write_text("t,flux\n")
    (tmp_path / "scan").mkdir()
    (tmp_path / "scan" / "summary.json").write_text("{}")
    one = Object("a", str(tmp_path / "a.csv"), options=FitOptions(start_from=tmp_path / "scan"))
    before = identity(one)
    assert before == identity(one)
    (tmp_path / "scan" / "summary.json").write_text('{"again": 1}')
    assert before != identity(one)


def test_an_unforeseen_fault_is_reported_in_words(tmp_path, monkeypatch):
    monkeypatch.setattr("lcbayes.data.read.read", lambda *_, **__: 1 / 0)
    row = fit_object((str(tmp_path), False), Object("a", "a.csv"))
    (reason,) = row["reasons"]
    assert reason == {
        "code": "object-failed",
        "text": f"ZeroDivisionError: division by zero; see {tmp_path / 'a' / 'error.txt'}",
    }


def rows() -> list[dict]:
    good = {
        "name": "a",
        "curve": "a.csv",
        "status": "trusted",
        "reasons": [],
        "seconds": 2.0,
        "model": "faceted",
        "n_facets": 2,
        "n_obs": 60,
        "n_solutions": 1,
        "weight": 1.0,
        "chi2": 61.0,
        "dof": 51,
        "rms": 0.02,
        "max_rhat": 1.002,
        "min_ess_bulk": 900.0,
        "omega_x_rad_s": 0.01,
        "omega_y_rad_s": 0.0,
        "omega_z_rad_s": 0.02,
        "omega_x_rad_s_sd": 0.001,
        "albedo_area_m2": 5.0,
    }
    doubted = good | {
        "name": "b",
        "status": "not trusted",
        "reasons": [{"code": "x", "text": "one"}, {"code": "y", "text": "two"}],
        "chi2": 500.0,
    }
    return [good, doubted, failed(Object("c", "c.csv"), "c.csv, line 3: 'x' is no number", 0.1)]


def test_table_and_summary_count_and_name():
    said, against = catalogue.summarise("c.csv", rows(), 4, 1, 10.0, "2 processes")
    assert [reason(finding).text for finding in against] == [
        "1 of 4 objects failed: c",
        "1 of 4 results must not be trusted: b",
        "1 of 4 objects were not done",
    ]
    assert said["objects_per_hour"] == 720.0  # two were done now, one before
    result = Batch(said, [], {})
    text = result.tables()["objects"].to_csv(index=False)
    read = list(csv.DictReader(text.splitlines()))
    assert [r["status"] for r in read] == ["trusted", "not trusted", "failed"]
    assert read[1]["reasons"] == "one; two"
    assert float(read[0]["omega_x_rad_s_sd"]) == 0.001
    assert read[2]["chi2"] == ""


def test_page_and_figure_of_failed_and_of_good_objects(tmp_path, look):
    run = {"catalogue": "/somewhere/night.csv", "version": "0"}
    said, against = catalogue.summarise("night.csv", rows(), 3, 0, 10.0, "2 processes")
    said = Batch(said, reasons(against), run).content

    def written(content: Mapping[str, Any], run: dict) -> Path:
        batch_page.write_page(tmp_path, content, run)
        return tmp_path / "report.html"

    page = written(said, run).read_text()
    assert "1 of 3 objects have a trusted result" in page
    assert "Right: total albedo-area against rotation rate" in page
    still = [{k: v for k, v in row.items() if not k.startswith("omega")} for row in rows()]
    other = written({**said, "objects": still}, run).read_text()
    assert "Right: total albedo-area against place in the catalogue" in other
    assert "c.csv, line 3: &#39;x&#39; is no number" in page
    assert (tmp_path / "figures" / "batch.pdf").stat().st_size > 5000
    evil = failed(
        Object(browser_pages.EVIL_TEXT, browser_pages.EVIL_FILE), browser_pages.EVIL_TEXT, 0.1
    )
    said["objects"] = [*said["objects"], evil]
    look(written(said, run | {"catalogue": browser_pages.EVIL_FILE}))
    gallery = style.Gallery(tmp_path)
    only = batch_page.draw(rows()[2:], gallery)  # nothing but a failure can be drawn too
    right = only.axes[1]
    assert not right.get_lines()
    shown = batch_page.draw(rows(), gallery).axes[1].get_lines()
    assert shown[0].get_xdata()[0] == pytest.approx(0.0005**0.5 * 3600 / 6.283185, rel=1e-4)
