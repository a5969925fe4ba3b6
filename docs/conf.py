"""Sphinx: the site from these pages, the gallery and the docstrings; `make docs` builds it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

project = "lcbayes"
author = "The lcbayes developers"
version = release = re.search(  # type: ignore[union-attr]
    r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE
)[1]

extensions = [
    "myst_nb",  # and Markdown, by myst-parser
    "sphinx.ext.apidoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["_build", "**/.ipynb_checkpoints", "gallery/contents.md", "api/modules.rst"]
html_extra_path = ["_build/extra"]
(ROOT / "docs" / "_build" / "extra").mkdir(parents=True, exist_ok=True)

nb_execution_mode = "cache"  # notebooks are stored without outputs, and run if they change
nb_execution_cache_path = str(ROOT / "docs" / "_build" / "notebooks")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_output_stderr = "remove"

myst_heading_anchors = 3  # links such as models.md#a-facet-that-is-never-seen
myst_enable_extensions = ["attrs_inline"]  # widths of the gallery's pictures

apidoc_modules = [
    {
        "path": "../lcbayes",
        "destination": "api",
        "follow_links": True,  # lcbayes.models and lcbayes.analysis
        "separate_modules": True,
        "module_first": True,
        "exclude_patterns": ["**/papers", "**/commands", "**/__main__.py"],
    }
]
autodoc_default_options = {"members": True, "show-inheritance": True}
autodoc_inherit_docstrings = False  # NumPyro's have formulae for a script from the network
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
suppress_warnings = ["ref.python"]  # attributes of one name in several classes
python_use_unqualified_type_names = True
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"

html_theme = "furo"
html_title = "lcbayes"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False


# As `*`, `|` and `name_` stand in formulae, they are text; markup is only what is in backticks.
MARKUP = re.compile(r"(``.*?``|`[^`]*`)")


def plain(line: str) -> str:
    """A line of a docstring with its formulae kept from being read as markup."""
    parts = MARKUP.split(line)
    return "".join(
        part if i % 2 else re.sub(r"([*|]|(?<=\w)_(?!\w))", r"\\\1", part)
        for i, part in enumerate(parts)
    )


def escape(_app: Any, _what: str, _name: str, _obj: Any, _opt: Any, lines: list[str]) -> None:
    """Before napoleon reads a docstring: formulae are text, except in literal blocks."""
    literal: int | None = None  # indent of the line that began one
    for i, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if literal is not None and line.strip() and indent <= literal:
            literal = None
        if literal is None:
            lines[i] = plain(line)
            literal = indent if line.rstrip().endswith("::") else None


def skip(_app: Any, _what: str, _name: str, obj: Any, _skip: bool, _options: Any) -> bool | None:
    """Whether a member is left out: Matplotlib adds methods to each subclass of its own."""
    return True if str(getattr(obj, "__module__", "")).startswith("matplotlib.") else None


def options(commands: Iterable[str]) -> str:
    """What `lcbayes COMMAND --help` prints, a section each."""
    text = ""
    for name in commands:
        said = subprocess.run(
            [sys.executable, "-m", "lcbayes", name, "--help"],
            env=os.environ | {"COLUMNS": "96"},
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        text += f"\n## {name}\n\n```text\n{said.stdout.rstrip()}\n```\n"
    return text


def read(_app: Any, name: str, source: list[str]) -> None:
    """The links of the pages as they are on the site; the first page's tables are its contents."""
    source[0] = source[0].replace("](../benchmarks/RESULTS.md)", "](benchmarks.md)")
    if name == "options":
        from lcbayes.cli.main import COMMANDS

        source[0] += options(COMMANDS)
    if name == "index":
        for section in source[0].split("\n## ")[1:]:
            head, _, rest = section.partition("\n")
            pages = "\n".join(re.findall(r"\]\(([\w/-]+)\.(?:md|ipynb)\)", rest))
            source[0] += f"\n```{{toctree}}\n:hidden:\n:caption: {head}\n\n{pages}\n```\n"


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", escape, priority=400)
    app.connect("autodoc-skip-member", skip)
    app.connect("source-read", read)
