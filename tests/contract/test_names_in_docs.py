"""Every module, function, test and path that the documentation mentions exists."""

from __future__ import annotations

import ast
import pkgutil
import re
from pathlib import Path

import pytest

from tests.helpers import documentation_blocks

ROOT = documentation_blocks.ROOT
PAGES = [*documentation_blocks.PAGES, ROOT / "CONTRIBUTING.md"]
ROOMS = sorted(p.parent.name for p in (ROOT / "lcbayes").glob("*/__init__.py"))
FOLDERS = ("lcbayes", "models", "analysis", "tests", "benchmarks", "docs")

DOTTED = re.compile(r"(?<![\w./@-])lcbayes(?:\.[A-Za-z_]\w*)+")
IN_A_ROOM = re.compile(rf"`((?:{'|'.join(ROOMS)})(?:\.[A-Za-z_]\w*)+)`")
PATH = re.compile(rf"(?<![\w./-])(?:{'|'.join(FOLDERS)})/[\w./-]*\w")
TEST = re.compile(r"`(test_\w+)`")


def _lines(page: Path, pattern: re.Pattern[str]) -> list[tuple[str, str]]:
    """(place, match) of every match of a pattern in a page."""
    return [
        (f"{page.name}:{i}", match[match.lastindex or 0])
        for i, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1)
        for match in pattern.finditer(line)
    ]


def _missing(names: list[tuple[str, str]]) -> list[str]:
    wrong = []
    for place, name in names:
        try:
            pkgutil.resolve_name(name.removesuffix(".rst"))
        except (ImportError, AttributeError) as e:
            wrong.append(f"{place}: {name} ({e})")
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_dotted_names_resolve(page):
    names = _lines(page, DOTTED)
    names += [(place, f"lcbayes.{name}") for place, name in _lines(page, IN_A_ROOM)]
    assert not (wrong := _missing(names)), "\n".join(wrong)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_imports_of_code_blocks_resolve(page):
    names = [
        (f"{block.page}:{block.line}", f"{node.module}:{alias.name}")
        for block in documentation_blocks.blocks(page)
        if block.language == "python"
        for node in ast.walk(ast.parse(block.text))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lcbayes")
        for alias in node.names
    ]
    wrong = []
    for place, name in names:
        module, _, attribute = name.partition(":")
        as_module, as_attribute = f"{module}.{attribute}", name
        if _missing([(place, as_module)]) and (result := _missing([(place, as_attribute)])):
            wrong += result
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.name)
def test_paths_exist(page):
    paths = [(at, path) for at, path in _lines(page, PATH) if "NAME" not in path]
    wrong = [f"{at}: {path}" for at, path in paths if not (ROOT / path).exists()]
    assert not wrong, "\n".join(wrong)


def test_tests_exist():
    sources = [p.read_text(encoding="utf-8") for p in (ROOT / "tests").rglob("test_*.py")]
    defined = {name for text in sources for name in re.findall(r"(?m)^def (test_\w+)\(", text)}
    modules = {p.stem for p in (ROOT / "tests").rglob("test_*.py")}
    named = [x for page in PAGES for x in _lines(page, TEST)]
    assert named
    wrong = [f"{at}: {name}" for at, name in named if name not in defined | modules]
    assert not wrong, "\n".join(wrong)


def test_ruff_of_the_hooks_is_ruff_of_the_environment():
    """An editor, a commit and `make lint` format alike only where they run the same version."""
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    project = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    of_hooks = re.search(r"ruff-pre-commit\n\s+rev: v([\d.]+)", hooks)
    of_environment = re.search(r'"ruff==([\d.]+)"', project)
    assert of_hooks
    assert of_environment
    assert of_hooks[1] == of_environment[1]
