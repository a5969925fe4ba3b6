"""Make the gallery: a page per model and per script of `analysis/papers`, figures and all.

python docs/make_gallery.py [--workers 2]

Pages and figures go to `docs/gallery`, where Sphinx takes them up. A page is made anew when a file
that it was made from has changed: which these are is seen while its commands run (modules that they
load, files of the repository that they read), and kept beside it with their digests.
"""

from __future__ import annotations

import argparse
import ast
import hashlib
import html
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parents[1]
PAPERS = ROOT / "analysis" / "papers"
OUT = ROOT / "docs" / "gallery"
REPORTS = ROOT / "docs" / "_build" / "extra" / "reports"

# Runs a script or module with what follows, and writes the files of the repository it read.
WATCH = """
import json, pathlib, runpy, sys
noted, what, *sys.argv = sys.argv[1:]
root, read = pathlib.Path.cwd(), set()
def hook(event, given):
    if event == "open" and isinstance(given[0], str) and not set(str(given[1])) & set("wax+"):
        read.add(given[0])
sys.addaudithook(hook)
try:
    if what == "script":
        sys.path.insert(0, str(pathlib.Path(sys.argv[0]).parent))
        runpy.run_path(sys.argv[0], run_name="__main__")
    else:
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
finally:
    read |= {getattr(m, "__file__", None) or "" for m in list(sys.modules.values())}
    paths = {pathlib.Path(name).resolve() for name in read if name}
    paths = {p for p in paths if p.is_relative_to(root) and p.is_file()}
    kept = [p for p in paths if "__pycache__" not in p.parts]
    pathlib.Path(noted).write_text(json.dumps(sorted(str(p.relative_to(root)) for p in kept)))
"""
NOT_SOURCES = (".venv/", "docs/gallery/", "docs/_build/", ".git/")


@dataclass(frozen=True)
class Scenario:
    """A model's page: a light curve with a known truth, and the fit of it."""

    model: str
    scenario: str
    fit: tuple[str, ...]


MODELS = (
    Scenario("faceted", "two-facet-spin", ("--n-facets", "2")),
    Scenario(
        "faceted-brdf", "docs/gallery/faceted-brdf.toml", ("--n-facets", "1", "--spin", "none")
    ),
    Scenario("convex-grid", "docs/gallery/convex-grid.toml", ("--period", "5.76")),
    Scenario(
        "stabilised",
        "docs/gallery/stabilised.toml",
        (
            "--law",
            "lvlh",
            "--facets",
            "+z,+x",
            "--reflectance",
            "lambertian",
            "--num-samples",
            "1500",
        ),
    ),
)

# Fewer draws than the scripts take by themselves, so that the site is made in minutes.
SMALLER: dict[str, tuple[str, ...]] = {
    "bias": ("--draws", "60"),
    "figure3": ("--draws", "2000"),
    "figure4": ("--draws", "2000"),
    "figure5": ("--chains", "2", "--transitions", "150"),
    "figure6": ("--particles", "50"),
    "figure7": ("--particles", "50"),
    "figure8": ("--chains", "1", "--transitions", "100", "--particles", "40"),
}


def digests(files: Sequence[str]) -> dict[str, str]:
    """SHA-256 of each file; one that is gone has none."""
    found = {}
    for name in files:
        path = ROOT / name
        found[name] = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    return found


def is_fresh(folder: Path) -> bool:
    """Whether a page's folder was made from the files as they are now."""
    stored = folder / "made-from.json"
    if not stored.is_file():
        return False
    made = json.loads(stored.read_text(encoding="utf-8"))
    return digests(list(made["files"])) == made["files"]


def run(kind: str, words: Sequence[str], files: set[str]) -> tuple[str, int]:
    """What a command prints, its exit status; the files that it read are added to ``files``."""
    with tempfile.TemporaryDirectory() as scratch:
        noted = Path(scratch) / "read.json"
        done = subprocess.run(
            [sys.executable, "-c", WATCH, str(noted), kind, *words],
            cwd=ROOT,
            text=True,
            capture_output=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )
        if done.returncode not in (0, 3):
            raise SystemExit(f"{shlex.join(words)} failed:\n{done.stderr[-3000:]}")
        read = json.loads(noted.read_text())
    files |= {name for name in read if not name.startswith(NOT_SOURCES)}
    return done.stdout, done.returncode


def shown(text: str, folder: Path) -> str:
    """Printed text, without the place where the figures went."""
    return text.replace(f"{folder}{os.sep}", "").replace(str(folder), "").strip()


def sentences(doc: str) -> tuple[str, str]:
    """The first line of a docstring without its full stop, and the rest."""
    first, _, rest = doc.strip().partition("\n")
    return first.rstrip("."), rest.strip()


FEWER = """
For this page the script took fewer draws. Without the options behind the seed it takes as many as
for [the papers' experiments](../papers.md).
"""


def paper_page(script: Path, folder: Path, files: set[str]) -> str:
    """Run one script of `analysis/papers` and write its page."""
    name = script.stem
    path = str(script.relative_to(ROOT))
    fewer = SMALLER.get(name, ())
    printed, _ = run("script", [path, "-o", str(folder), "--seed", "1", *fewer], files)
    title, rest = sentences(ast.get_docstring(ast.parse(script.read_text("utf-8"))) or name)
    return f"""# {title}

![{title}]({folder.name}/{name}.png)

{rest}

[As vectors]({folder.name}/{name}.svg)

## What it prints

```text
$ {shlex.join(["python", path, "-o", "figures", "--seed", "1", *fewer])}
{shown(printed, folder)}
```
{FEWER * bool(fewer)}

## The script

```{{literalinclude}} ../../{path}
:language: python
```
"""


def pictures(report: Path, folder: Path) -> str:
    """The figures of a report down to its diagnostics, as files and as Markdown."""
    page = report.read_text(encoding="utf-8").partition("<h2>Can it be trusted?</h2>")[0]
    texts = []
    for i, (code, alt) in enumerate(
        re.findall(r'<img src="data:image/svg\+xml,([^"]+)" alt="([^"]*)"', page)
    ):
        (folder / f"{i}.svg").write_text(unquote(html.unescape(code)), encoding="utf-8")
        texts.append(f"![{html.unescape(alt)}]({folder.name}/{i}.svg)")
    return "\n\n".join(texts)


def model_page(made: Scenario, folder: Path, files: set[str]) -> str:
    """Simulate, fit, and write a model's page with the figures of the report."""
    curve, out = folder / "curve.csv", folder / "out"
    texts = []
    for words in (
        ("lcbayes", "simulate", made.scenario, "-o", str(curve), "--seed", "1"),
        (
            "lcbayes",
            "fit",
            str(curve),
            "-o",
            str(out),
            "--model",
            made.model,
            *made.fit,
            "--seed",
            "1",
        ),
    ):
        printed, status = run("module", words, files)
        line = shown(f"$ {shlex.join(words)}\n{printed}", folder)
        texts.append(line + (f"\n(exit status {status})" if status else ""))
    options, _ = run("module", ("lcbayes", "models", made.model), files)
    source = ROOT / "models" / f"{made.model.replace('-', '_')}.py"
    shown_pictures = pictures(out / "report.html", folder)
    REPORTS.mkdir(parents=True, exist_ok=True)
    shutil.copy(out / "report.html", REPORTS / f"{made.model}.html")
    shutil.rmtree(out)
    bundled = ROOT / "lcbayes" / "simulation" / "scenarios" / f"{made.scenario}.toml"
    scenario = bundled if bundled.is_file() else ROOT / made.scenario
    files |= {str(scenario.relative_to(ROOT)), str(source.relative_to(ROOT))}
    return f"""# {made.model}

{options.partition(": ")[2].partition(chr(10))[0].capitalize()}.

## A light curve of known truth, and its fit

```text
{chr(10).join(texts)}
```

<a href="../reports/{made.model}.html">The whole report</a>, as `lcbayes fit` writes it.

{shown_pictures}

## Its parameters and options

```text
$ lcbayes models {made.model}
{options.strip()}
```

## The scenario

```{{literalinclude}} ../../{scenario.relative_to(ROOT)}
:language: toml
```

## The model

```{{literalinclude}} ../../{source.relative_to(ROOT)}
:language: python
```
"""


def page(name: str, make: Callable[[Path, set[str]], str]) -> None:
    """One page and its folder of figures, unless it is there and fresh; put in place together."""
    folder = OUT / name
    if is_fresh(folder) and (OUT / f"{name}.md").is_file():
        print(f"{name}: as it was", flush=True)
        return
    print(f"{name} ...", flush=True)
    begun = time.monotonic()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    files = {"docs/make_gallery.py"}
    text = make(folder, files)
    took = round(time.monotonic() - begun)
    (OUT / f"{name}.md").write_text(text, encoding="utf-8")
    record = {"seconds": took, "files": digests(sorted(files))}
    (folder / "made-from.json").write_text(json.dumps(record, indent=1), encoding="utf-8")
    print(f"{name}: {took} s", flush=True)


def index(names: Sequence[str]) -> str:
    """What `docs/gallery.md` includes: every page with its first picture."""
    lines = []
    cells = []
    for name in names:
        text = (OUT / f"{name}.md").read_text(encoding="utf-8")
        title = text.partition("\n")[0].removeprefix("# ")
        picture = re.search(r"!\[([^\]]*)\]\(([^)]+)\)", text)
        assert picture, f"{name} shows nothing"
        cells.append((name, title, picture[2]))
    for head, rows in (
        ("Models", cells[: len(MODELS)]),
        ("The papers' figures", cells[len(MODELS) :]),
    ):
        lines += [f"## {head}", "", "| | |", "|---|---|"]
        lines += [
            f"| ![{title}](gallery/{image}){{width=260px}} | [{title}](gallery/{name}.md) |"
            for name, title, image in rows
        ]
        lines.append("")
    listed = "\n".join(f"gallery/{name}" for name in names)
    return "\n".join(lines) + f"\n```{{toctree}}\n:hidden:\n\n{listed}\n```\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="only these pages, and no list of them")
    parser.add_argument("--workers", type=int, default=1, help="pages at once")
    args = parser.parse_args()
    makers: dict[str, Callable[[Path, set[str]], str]] = {
        made.model: partial(model_page, made) for made in MODELS
    }
    scripts = [p for p in sorted(PAPERS.glob("*.py")) if "    args = " in p.read_text("utf-8")]
    makers |= {script.stem: partial(paper_page, script) for script in scripts}
    names = args.names or list(makers)
    with ThreadPoolExecutor(args.workers) as pool:  # each page is made by processes of its own
        for done in [pool.submit(page, name, makers[name]) for name in names]:
            done.result()
    if not args.names:
        (OUT / "contents.md").write_text(index(list(makers)), encoding="utf-8")


if __name__ == "__main__":
    main()
