"""Limits of size: lines of a file, and lines, parameters and nesting of a function."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("lcbayes", "models", "analysis", "tests", "benchmarks", "docs")
PRODUCT = ("lcbayes", "models", "analysis")
MAX_FILE_LINES = 500
MAX_LINES = 60  # of code: without docstrings, comments and blank lines
MAX_PARAMETERS = 8
MAX_DEPTH = 5  # blocks in one another

Function = ast.FunctionDef | ast.AsyncFunctionDef
COMPOUND = (
    *(ast.If, ast.For, ast.AsyncFor, ast.While, ast.With, ast.AsyncWith),
    *(ast.Try, ast.TryStar, ast.Match, ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef),
)
NO_CODE = {
    *(tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT),
    *(tokenize.ENCODING, tokenize.ENDMARKER),
}


def _files(folders: tuple[str, ...]) -> list[Path]:
    """The Python files of folders, each once: `lcbayes/models` and `lcbayes/analysis` are links."""
    return [
        path
        for folder in folders
        for path in sorted((ROOT / folder).rglob("*.py"))
        if not any(place.is_symlink() for place in (path, *path.parents))
    ]


def _lines_of_code(text: str, tree: ast.Module) -> set[int]:
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in NO_CODE:
            lines.update(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | Function) and ast.get_docstring(node):
            docstring = node.body[0]
            lines -= set(range(docstring.lineno, (docstring.end_lineno or 0) + 1))
    return lines


def _parameters(function: Function, options: bool) -> int:
    """Number of parameters; keyword-only ones do not count if they are ``options``."""
    args = function.args
    names = [a.arg for a in (*args.posonlyargs, *args.args) if a.arg not in ("self", "cls")]
    if options:
        return len(names)
    return len(names) + len(args.kwonlyargs) + bool(args.vararg) + bool(args.kwarg)


def _has_options(path: Path, function: Function) -> bool:
    """Whether keyword-only parameters are options, which a user gives by name.

    Those of a model are declared by its signature, and `lcbayes.read` has those of the shell.
    """
    where = path.relative_to(ROOT).as_posix()
    return where.startswith("models/") or (where, function.name) == ("lcbayes/data/read.py", "read")


def _depth(block: list[ast.stmt], depth: int = 0) -> int:
    """Number of blocks in one another; `elif` does not begin a deeper one."""
    deepest = depth
    for statement in block:
        if isinstance(statement, COMPOUND):
            for inner, step in _blocks(statement):
                deepest = max(deepest, _depth(inner, depth + step))
    return deepest


def _blocks(statement: ast.stmt) -> Iterator[tuple[list[ast.stmt], int]]:
    """The blocks of a statement, and by how much they are deeper than it."""
    yield getattr(statement, "body", []), 1
    other = getattr(statement, "orelse", [])
    is_elif = isinstance(statement, ast.If) and len(other) == 1 and isinstance(other[0], ast.If)
    yield other, int(not is_elif)
    yield getattr(statement, "finalbody", []), 1
    yield from ((handler.body, 1) for handler in getattr(statement, "handlers", []))
    yield from ((case.body, 2) for case in getattr(statement, "cases", []))


def _too_large(text: str, path: Path) -> Iterator[str]:
    tree = ast.parse(text)
    code = _lines_of_code(text, tree)
    for node in ast.walk(tree):
        if not isinstance(node, Function):
            continue
        lines = len(code & set(range(node.lineno, (node.end_lineno or 0) + 1)))
        parameters = _parameters(node, _has_options(path, node))
        depth = _depth(node.body)
        where = f"{path.relative_to(ROOT)}:{node.lineno} {node.name}:"
        if lines > MAX_LINES:
            yield f"{where} {lines} lines of code"
        if parameters > MAX_PARAMETERS:
            yield f"{where} {parameters} parameters"
        if depth > MAX_DEPTH:
            yield f"{where} {depth} blocks in one another"


def test_files_stay_small():
    long = []
    for path in _files(FOLDERS):
        lines = path.read_text(encoding="utf-8").count("\n")
        if lines > MAX_FILE_LINES:
            long.append(f"{path.relative_to(ROOT)}: {lines} lines; split it by job")
    assert not long, "\n".join(long)


def test_functions_stay_small():
    large = [
        fault
        for path in _files(PRODUCT)
        for fault in _too_large(path.read_text(encoding="utf-8"), path)
    ]
    assert not large, "\n".join(large)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("def f():\n" + "    x = 1\n" * 59, ""),
        ("def f():\n" + "    x = 1\n" * 60, "61 lines of code"),
        ('def f():\n    """A.\n\n    B.\n    """\n\n    # C\n' + "    x = 1\n" * 59, ""),
        ("def f():\n    x = (\n" + "        1,\n" * 57 + "    )\n", ""),
        ("def f():\n    x = (\n" + "        1,\n" * 58 + "    )\n", "61 lines of code"),
        ("class A:\n    def f(self, a, b, c, d, e, f, g, h): ...\n", ""),
        ("def f(a, b, c, d, e, f, *, g, h, i): ...\n", "9 parameters"),
        ("def f(a, b, c, d, e, f, g, *h, **i): ...\n", "9 parameters"),
        ("def f():\n if a:\n  for b in c:\n   with d:\n    while e:\n     if f:\n      g\n", ""),
        (
            "def f():\n if a:\n  for b in c:\n   with d:\n    while e:\n     try:\n      g\n"
            "     except E:\n      if h:\n       i\n",
            "6 blocks in one another",
        ),
        ("def f():\n if a:\n  b\n" + "".join(f" elif c{i}:\n  d\n" for i in range(9)), ""),
    ],
)
def test_limits(text, fault):
    faults = list(_too_large(text, ROOT / "lcbayes" / "some_file.py"))
    assert [f.split(": ")[1] for f in faults] == ([fault] if fault else [])


def test_options_of_a_model_are_not_counted():
    text = "def model(data, *, a, b, c, d, e, f, g, h, i): ...\n"
    assert not list(_too_large(text, ROOT / "models" / "some_model.py"))
    assert list(_too_large(text, ROOT / "lcbayes" / "some_file.py"))
    assert list(_too_large(text.replace("*, ", ""), ROOT / "models" / "some_model.py"))
