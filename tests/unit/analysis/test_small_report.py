"""The folder of a small command: its page says first whether the method's conditions hold."""

from __future__ import annotations

import json

import pytest

from lcbayes.analysis import small_report
from lcbayes.core.errors import InputError
from tests.helpers import browser_pages


def draw(gallery) -> None:
    figure = gallery.figure(3.0, 2.0)
    figure.subplots().plot([0.0, 1.0])
    gallery.add(figure, "line", "A line.", "A line, and what it means.")


def made(folder, reasons: list[str], refused: str = small_report.UNTRUSTED) -> str:
    content = {"curve": "/far/<b>pass.csv", "n_obs": 40, "reasons": reasons, "rms": float("nan")}
    lines = [*(f"NOT to be trusted: {why}" for why in reasons), "axis at 3 & 4 deg"]
    small_report.write(folder, "single_facet", content, lines, draw, refused=refused)
    return (folder / "single_facet.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("reasons", [[], ["too few <points>", "no edge"]])
def test_the_page(tmp_path, reasons, look):
    page = made(tmp_path, reasons)
    assert {p.name for p in tmp_path.iterdir()} == {
        "single_facet.json",
        "single_facet.txt",
        "single_facet.html",
        "figures",
    }
    assert json.loads((tmp_path / "single_facet.json").read_text())["rms"] is None
    assert ("NOT to be trusted.</h2>" in page) is bool(reasons)
    assert ("The conditions of the method hold." in page) is not bool(reasons)
    for why in reasons:
        escaped = why.replace("<", "&lt;").replace(">", "&gt;")
        assert page.count(escaped) == 1
    assert "&lt;b&gt;pass.csv" in page
    assert "<b>" not in page
    assert "axis at 3 &amp; 4 deg" in page
    assert 'alt="A line."' in page
    assert "http" not in page.replace("http-equiv", "")
    made(tmp_path, [*reasons, browser_pages.EVIL_TEXT])
    look(tmp_path / "single_facet.html")


def test_what_heads_the_reasons_is_what_the_command_says(tmp_path):
    page = made(tmp_path, ["none stands out"], refused="no direction found")
    assert "No direction found.</h2>" in page
    assert "NOT to be trusted.</h2>" not in page


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        made(tmp_path / "file", [])
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
