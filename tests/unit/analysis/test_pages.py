"""What every page of a result has."""

from pathlib import Path

import pytest

import lcbayes.analysis

TEMPLATES = Path(lcbayes.analysis.__file__).parent / "templates"
PAGES = sorted(p.name for p in TEMPLATES.glob("*.html.j2") if "<!doctype" in p.read_text())


def test_the_pages_are_found():
    assert {"report.html.j2", "scan.html.j2", "batch.html.j2", "compare.html.j2"} <= set(PAGES)


@pytest.mark.parametrize("name", PAGES)
def test_tables_sort_and_are_saved_and_the_page_can_be_dark(name):
    """The script is there, the policy allows it, and it finds the button and the tables."""
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    assert '{% include "theme.js" %}' in text.split("<script>", 1)[1]
    policy = text.split('Content-Security-Policy" content="', 1)[1].split('"', 1)[0]
    assert "script-src 'unsafe-inline'" in policy
    assert text.count("data-theme-button hidden") == 1
    assert text.count("<main>") == 1
