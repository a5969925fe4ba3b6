"""The report in a real browser, with texts in it that would be code; and what the tester sees.

The other pages are looked at where they are made: tests that take the fixture ``look``.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import lcbayes
from tests.helpers import browser_pages, results_folders

KINDS = {
    "not trusted": lambda to: results_folders.faceted(
        to, kind="mag", bad=True, title=browser_pages.EVIL_FILE
    ),
    "asteroid": lambda to: results_folders.asteroid(to, n_facets=60, n_curves=4),
}


@pytest.mark.parametrize("kind", ["not trusted", pytest.param("asteroid", marks=pytest.mark.slow)])
def test_the_report(kind, tmp_path, look):
    folder = KINDS[kind](tmp_path / "results")
    numbers = folder / "summary.json"
    content = json.loads(numbers.read_text())
    evil = {"code": "x", "text": browser_pages.EVIL_TEXT}
    content["reasons"] = [*content["reasons"], evil] if content["reasons"] else []
    numbers.write_text(json.dumps(content))
    lcbayes.report(folder)
    page = folder / "report.html"
    assert browser_pages.EVIL_FILE not in page.read_text()
    assert browser_pages.EVIL_TEXT not in page.read_text()
    look(page, turning=4)  # light curve, its body, and the shapes of two solutions


FAULTY = """<!doctype html><html><head><title>t</title></head><body><h1>one</h1><h1>two</h1>
<p style="color:#999;background:#fff">pale</p><p style="width:2000px;height:1px">wide</p>
<img src="data:image/png;base64,AAAA" alt="broken"><img src="missing.png"><canvas></canvas>
<script>window.bad = 1; console.error("oh"); undefined.x;</script>
<script src="http://127.0.0.1:9/x.js"></script></body></html>"""


def test_the_tester_sees_what_is_wrong(tmp_path, browser):
    page = tmp_path / "faulty.html"
    page.write_text(FAULTY, encoding="utf-8")
    content = "\n".join(
        browser_pages.look(browser, page, widths=(browser_pages.NARROW,), turn=False).faults
    )
    for fault in (
        "contrast 2.85",
        "px stick out at 390",
        "without alt",
        "broken image",
        "without a name",
        "not one h1",
        "no language",
        "text of a file was run",
        "oh",
        "undefined",
        "asks for http://127.0.0.1:9/x.js",
        "missing.png",
    ):
        assert fault in content, (fault, content)


def test_nothing_is_put_into_a_page_as_it_is():
    """One environment escapes for all pages; no template and no code opts out."""
    root = Path(__file__).parents[2]
    for file in [*root.glob("analysis/**/*"), *root.glob("lcbayes/**/*.py")]:
        if file.suffix in (".py", ".j2") and file.is_file():
            text = file.read_text(encoding="utf-8")
            assert "|safe" not in text.replace(" ", ""), file
            assert "Markup(" not in text, file
            assert "jinja2.Environment" not in text or file.name == "pages.py", file


SITE = Path(__file__).parents[2] / "docs" / "_build" / "html"


@pytest.mark.skipif(not (SITE / "index.html").is_file(), reason="no site; `make docs` builds it")
@pytest.mark.slow
def test_the_site(browser):
    pages = sorted(p for p in SITE.rglob("*.html") if p.name != "search.html")
    assert len(pages) > 40
    wrong = {}
    for page in pages:
        if faults := browser_pages.look(browser, page, within=SITE).faults:
            wrong[str(page.relative_to(SITE))] = faults
    assert not wrong
