"""The page of a result without a posterior says first whether the method's conditions hold."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import lcbayes
from lcbayes.analysis.small_report import Listing
from lcbayes.analysis.style import Gallery
from lcbayes.core.errors import InputError
from lcbayes.core.reasons import Reason
from lcbayes.tasks.deterministic import DeterministicResult, about, figure_of
from tests.helpers import browser_pages
from tests.helpers.low_earth_orbit import steady


def line(gallery: Gallery) -> None:
    figure = gallery.figure(3.0, 2.0)
    figure.subplots().plot([0.0, 1.0])
    gallery.add(figure, "line", "A line.", "A line, and what it means.")


class Axis(DeterministicResult):
    """A result with one figure."""

    task = "spin"

    def summary(self):
        import pandas as pd

        return pd.DataFrame({"axis_deg": [3.0]})

    def lines(self):
        return ["axis at 3 & 4 deg"]

    def tables(self):
        return {"axis": self.summary()}

    def draw(self, gallery):
        line(gallery)


def made(reasons: list[str]) -> Axis:
    curve = steady(1, 50.0, spinning=False)
    curve = replace(curve, source={"file": "/far/<b>pass.csv"})
    content = about(curve) | {"n_obs": 40, "rms": float("nan")}
    axis = Axis(None, content)
    axis.reasons = tuple(Reason("some-code", text) for text in reasons)
    return axis


@pytest.mark.parametrize("reasons", [[], ["too few <points>", "no edge"]])
def test_the_folder_and_its_page(tmp_path, reasons, look):
    page = made(reasons).report(tmp_path).read_text(encoding="utf-8")
    assert {p.name for p in tmp_path.iterdir() if p.name != ".lock"} == {
        "summary.json",
        "run.toml",
        "report.html",
        "figures",
        "tables",
    }
    content = json.loads((tmp_path / "summary.json").read_text())
    assert content["rms"] is None
    assert content["reasons"] == [{"code": "some-code", "text": text} for text in reasons]
    assert (tmp_path / "tables" / "axis.csv").read_text() == "axis_deg\n3.0\n"
    assert ("NOT to be trusted.</h2>" in page) is bool(reasons)
    assert ("The conditions of the method hold." in page) is not bool(reasons)
    for why in reasons:
        escaped = why.replace("<", "&lt;").replace(">", "&gt;")
        assert page.count(escaped) == 1
    assert "&lt;b&gt;pass.csv" in page
    assert "<b>" not in page
    assert "axis at 3 &amp; 4 deg" in page
    assert 'alt="A line."' in page
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org", "")
    look(made([*reasons, browser_pages.EVIL_TEXT]).report(tmp_path))


def test_what_heads_the_reasons_is_what_the_method_says(tmp_path, monkeypatch):
    monkeypatch.setattr(Axis, "refused", "no direction found")
    page = made(["none stands out"]).report(tmp_path).read_text(encoding="utf-8")
    assert "No direction found.</h2>" in page
    assert "NOT to be trusted.</h2>" not in page


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be made"):
        made([]).report(tmp_path / "file")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_figure_is_returned_as_it_is_drawn():
    (axes,) = figure_of(line).axes
    assert np.array_equal(axes.lines[0].get_ydata(), [0.0, 1.0])


def test_a_report_is_shown_in_a_notebook(browser):
    """In a frame that contains the whole page and runs its scripts."""
    curve = steady(3, 50.0, spinning=True)
    result = lcbayes.look(curve)
    shown = result.view(height=700)._repr_html_()
    assert result.folder is None
    tab = browser.new_page()
    faults: list[str] = []
    tab.on("console", lambda m: faults.append(m.text))
    tab.on("pageerror", lambda e: faults.append(str(e)))
    tab.set_content(f"<!doctype html><title>notebook</title>{shown}")
    frame = tab.query_selector("iframe").content_frame()
    frame.wait_for_selector("#explore canvas")
    assert frame.is_visible("text=What could be asked of it")
    assert tab.query_selector("iframe").bounding_box()["height"] == pytest.approx(702, abs=2)
    assert not faults
    tab.close()


class Listed(Axis):
    """A result whose page has a table."""

    def listing(self):
        rows = [("a<b>", "0.2"), ("c", "0.1")]
        return Listing("axes", ("axis", "p-value"), rows), ["2 axes", "neither is rejected"]


def test_a_table_takes_the_place_of_the_text(tmp_path, look):
    axis = made([])
    listed = Listed(None, axis.content)
    page = listed.report(tmp_path).read_text(encoding="utf-8")
    assert '<table data-name="axes">' in page
    assert "<td>a&lt;b&gt;</td><td>0.2</td>" in page
    assert page.index("<p>2 axes.</p>") < page.index("<table") < page.index("neither is rejected")
    assert "axis at 3" not in page
    look(tmp_path / "report.html")
