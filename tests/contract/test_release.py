"""The files of a release agree: versions, requirements, citations and figures."""

from __future__ import annotations

import contextlib
import io
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.stats import binom

from lcbayes.cli import main
from paper import make_figures as figures

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
RECIPE = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text("utf-8"))
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
PAPER = (ROOT / "paper" / "paper.md").read_text("utf-8")
RESULTS = (ROOT / "benchmarks" / "RESULTS.md").read_text("utf-8")
CONDA_NAMES = {"matplotlib-base": "matplotlib", "astropy-base": "astropy"}


def test_versions_agree() -> None:
    version = PROJECT["version"]
    assert RECIPE["context"]["version"] == version
    assert CITATION["version"] == version
    least = PROJECT["requires-python"].removeprefix(">=")
    variants = yaml.safe_load((ROOT / "recipe" / "variants.yaml").read_text("utf-8"))
    assert variants["python_min"] == [least]


def test_the_recipe_has_the_requirements_of_the_package() -> None:
    _, *run = RECIPE["requirements"]["run"]
    pairs = (line.partition(" ") for line in run)
    given = {CONDA_NAMES.get(name, name) + bound for name, _, bound in pairs}
    assert given == set(PROJECT["dependencies"])
    script = PROJECT["scripts"]["lcbayes"]
    assert RECIPE["build"]["python"]["entry_points"] == [f"lcbayes = {script}"]
    assert RECIPE["source"] == {"path": ".."}  # builds without network


def test_the_paper_cites_what_its_bibliography_has() -> None:
    bibliography = (ROOT / "paper" / "paper.bib").read_text("utf-8")
    keys = set(re.findall(r"@\w+\{(\w+),", bibliography))
    assert set(re.findall(r"@([a-z]+\d{4})", PAPER)) == keys


@pytest.mark.parametrize("row", re.findall(r"(?m)^\| (.+) \| (.+\d.+) \|$", PAPER))
def test_numbers_of_the_paper_are_those_of_the_benchmarks(row: tuple[str, str]) -> None:
    title, text = row
    section = RESULTS.split(f"\n## {title}\n")[1].split("\n## ")[0].replace("−", "-")
    numbers = re.findall(r"-?\d+(?:\.\d+)?%?(?: of \d+)?", text.replace("−", "-"))
    assert numbers
    for number in numbers:
        assert re.search(rf"(?<![\d.]){re.escape(number)}(?!\.?\d)", section), number


TABLE = """
## Surveys: calibration

| P of the period | objects | mean P | right |
| --- | --- | --- | --- |
| 0 to 0.1 | 16 | 0.042 | 1 of 16 |
| 0.99 to 1 | 92 | 0.999 | 92 of 92 |

| P of pole and period | objects | mean P | right |
| --- | --- | --- | --- |
| 0.5 to 0.7 | 25 | 0.577 | 11 of 25 |

## Something else
"""


def test_the_figure_of_the_paper_shows_the_benchmarks() -> None:
    rows = figures.bins(TABLE, "P of the period")
    assert rows == [(16, 0.042, 1), (92, 0.999, 92)]
    low, high = rows[0].interval
    assert binom.sf(0, 16, low) == pytest.approx(0.05)
    assert binom.cdf(1, 16, high) == pytest.approx(0.05)
    assert rows[1].interval == (pytest.approx(0.05 ** (1 / 92)), 1.0)
    left, right = figures.draw(TABLE).axes
    assert [np.size(axes.lines[1].get_xdata()) for axes in (left, right)] == [2, 1]
    assert sum(row.count for row in figures.bins(RESULTS, "P of the period")) > 100


def test_the_figure_of_the_paper_is_up_to_date() -> None:
    assert f"({figures.FIGURE.relative_to(ROOT / 'paper')})" in PAPER
    with Image.open(figures.FIGURE) as picture:
        made_from = picture.info[figures.DIGEST]
    assert made_from == figures.digest(RESULTS), "run python paper/make_figures.py"


TEMPLATES = sorted((ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"))


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.stem)
def test_issue_templates_are_valid(path: Path) -> None:
    content = yaml.safe_load(path.read_text("utf-8"))
    if path.stem == "config":
        return
    assert {"name", "description", "body"} <= set(content)
    assert all(field["attributes"]["label"] for field in content["body"])


def completed(words: str) -> list[str]:
    """What bash offers after some words."""
    line = words.split(" ")
    program = (
        f"{completion('bash')}\nCOMP_WORDS=({' '.join(w or chr(34) * 2 for w in line)})\n"
        f"COMP_CWORD={len(line) - 1}\n_lcbayes\necho ${{COMPREPLY[*]}}"
    )
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, check=True)
    return done.stdout.split()


def completion(shell: str) -> str:
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        assert main.main(["--completion", shell]) == 0
    return out.getvalue()


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
def test_bash_completes_commands_options_and_values() -> None:
    assert completed("lcbayes sp") == ["spin"]
    assert completed("lcbayes fit --n-f") == ["--n-facets"]
    assert completed("lcbayes fit --sampler a") == ["auto", "ahmc"]
    assert set(main.COMMANDS) <= set(completed("lcbayes "))


def test_other_shells_have_completions(capsys: pytest.CaptureFixture[str]) -> None:
    assert completion("zsh").startswith("autoload")
    assert "__fish_seen_subcommand_from fit' -l n-facets" in completion("fish")
    assert main.main(["--completion", "tcsh"]) == 2
    assert "available: bash, zsh, fish" in capsys.readouterr().err
