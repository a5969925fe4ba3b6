"""The notebooks of the documentation run, and are stored without outputs."""

from __future__ import annotations

import ast
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pytest

from lcbayes.core.figures import Picture, Pictures

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "notebooks"
SHOWN = {"first-fit": 2, "period": 2}  # pictures
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def cells(path: Path) -> list[dict[str, Any]]:
    content = json.loads(path.read_text("utf-8"))
    assert content["nbformat"] == 4
    return content["cells"]


def test_there_are_three() -> None:
    assert len(NOTEBOOKS) >= 3


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs(path: Path) -> None:
    assert cells(path)[0]["cell_type"] == "markdown"
    for cell in cells(path):
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cell by cell, with the value of the last expression shown as a notebook shows it."""
    monkeypatch.chdir(tmp_path)
    mpl.use("agg")
    names: dict[str, Any] = {}
    pictures = 0
    for cell in cells(path):
        if cell["cell_type"] != "code":
            continue
        body = ast.parse("".join(cell["source"])).body
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), path.stem, "exec"), names)
        if isinstance(last, ast.Expr):
            shown = eval(compile(ast.Expression(last.value), path.stem, "eval"), names)
            picture, html = is_picture(shown), getattr(shown, "_repr_html_", None)
            assert picture or (html() if html is not None else repr(shown))
            pictures += picture
    assert pictures >= SHOWN.get(path.stem, 0)


def is_picture(shown: Any) -> bool:
    if isinstance(shown, Pictures):
        return shown._repr_html_().count('<img src="data:image/png;base64,') == len(shown) > 0
    return isinstance(shown, Picture) and shown._repr_png_()[0].startswith(b"\x89PNG")
