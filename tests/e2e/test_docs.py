"""Every code block of README and docs runs, with fewer draws than a reader would take."""

from __future__ import annotations

import functools
import inspect
import re
import runpy
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import lcbayes
from lcbayes.cli import main
from lcbayes.simulation.known_bodies.reader import read_body_text
from lcbayes.simulation.scenarios.scenario import load
from tests.helpers import documentation_blocks, results_folders
from tests.helpers.documentation_blocks import PAGES, ROOT, Block

# Added to the commands of the pages, so that they end soon; the pages say what a user would give.
SHORT_RUN = {"num_warmup": 50, "num_samples": 50, "num_chains": 2, "num_starts": 4, "max_modes": 1}
SHORT_RUN_FLAGS = [f"--{k.replace('_', '-')}={v}" for k, v in SHORT_RUN.items()]
SMALL_ASTEROID = ["--set=degree=2", "--set=n_quadrature=120"]
SOONER = {
    "fit": SHORT_RUN_FLAGS,
    "batch": [*SHORT_RUN_FLAGS, "--workers=1"],
    "compare": [
        *("--evidence=particles", "--num-particles=12", "--num-runs=2", "--num-starts=4"),
        "--n-facets=1-2",
    ],
    "scan": ["--n-poles=4", "--n-sky=8", "--n-facets=60", "--degree=3", "--keep=2"],
    "albedo-area": ["--n-normals=100", "--nulls=19", "--bootstrap=10"],
    "attitude-test": ["--bodies=199"],
}
BLOCKS = [block for page in PAGES for block in documentation_blocks.blocks(page)]
SHELL = [block for block in BLOCKS if block.language == "sh"]
PYTHON = [block for block in BLOCKS if block.language == "python" and not block.needs]
NOT_RUN = {  # how many blocks of a page, and why
    ("docs/bodies.md", "takes as long as the fit above"): 3,
    ("docs/batch.md", "needs a Dask cluster at that address"): 1,
    ("docs/surveys.md", "needs catalogues, and a Dask cluster at that address"): 1,
}
OBSERVED = dict.fromkeys(block.page for block in BLOCKS if block.needs)
QUICKSTART, PASTED = "docs/quickstart.md", 5  # its commands that need no file of the reader


def label(block: Block) -> str:
    return f"{block.page}:{block.line}"


def commands(page: str) -> list[list[str]]:
    """The words after `lcbayes` of what a page runs without observations, in order."""
    run = [b for b in SHELL if b.page == page and not b.why_not and not b.needs]
    return [words[1:] for b in run for words in b.commands if words[0] == "lcbayes"]


def test_every_block_says_what_it_is_in():
    unknown = [label(b) for b in BLOCKS if b.language not in documentation_blocks.LANGUAGES]
    assert unknown == [label(b) for b in BLOCKS if b.language.startswith("{")]  # for Sphinx
    assert Counter((b.page, b.why_not) for b in BLOCKS if b.why_not) == NOT_RUN
    for page in PAGES:  # none is missed
        assert page.read_text("utf-8").count("```") == 2 * len(documentation_blocks.blocks(page)), (
            page
        )
        assert not re.search(r"(?m)^ {4}lcbayes ", page.read_text("utf-8")), page


def test_every_command_of_the_pages_and_of_help_is_understood():
    """Names, options and values are those of the parser; nothing is run."""
    parser = main._parser()
    makefile = (ROOT / "Makefile").read_text("utf-8")
    named = set()
    for block in SHELL:
        for words in block.commands:
            if words[0] == "make":
                assert re.search(rf"(?m)^{words[1]}:", makefile), label(block)
            elif words[0] == "lcbayes":
                args = parser.parse_args(words[1:])  # exits where it does not understand
                named.add(args.command)
            else:
                assert words[0] in ("python", "pip", "source"), label(block)
    assert {"fit", "predict", "simulate", "observability", "scan", "doctor"} <= named
    inline = {
        name
        for page in PAGES
        for name in re.findall(r"`lcbayes ([a-z]+(?:-[a-z]+)*)\b", page.read_text("utf-8"))
    }
    assert inline <= set(main.COMMANDS), inline - set(main.COMMANDS)
    assert set(main.COMMANDS) <= named | inline, "a command that no page shows"


def test_no_page_writes_two_kinds_of_result_into_one_folder():
    """Pasted one after the other, the second command would be refused."""
    kinds: dict[tuple[str, str], set[str]] = {}
    for block in SHELL:
        for words in [] if block.why_not else block.commands:
            if words[0] == "lcbayes" and "-o" in words:
                out = words[words.index("-o") + 1]
                kinds.setdefault((block.page, out), set()).add(words[1])
    assert [place for place, tasks in kinds.items() if len(tasks) > 1] == []


def run_command(page: str, words: list[str]) -> None:
    sooner = SOONER.get(words[0], []) if "--config" not in words else []
    small = SMALL_ASTEROID if words[0] == "fit" and "convex-grid" in words else []
    status = main.main([*words, *sooner, *small])
    assert status in (0, 3), f"{page}: lcbayes {' '.join(words)}"


def run_page(page: str, folder: Path, first: int | None = None) -> None:
    for words in commands(page)[:first]:
        documentation_blocks.provide(folder, words)
        run_command(page, words)


@pytest.mark.slow
def test_the_quickstart_can_be_pasted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_page(QUICKSTART, tmp_path, PASTED)
    assert (tmp_path / "out" / "report.html").is_file()
    assert len((tmp_path / "brightness.csv").read_text().splitlines()) > 50


@pytest.mark.slow
@pytest.mark.usefixtures("quick_compilation")
@pytest.mark.parametrize("page", dict.fromkeys(b.page for b in SHELL if commands(b.page)))
def test_commands_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run_page(page, tmp_path)


@pytest.fixture
def short_runs(monkeypatch):
    monkeypatch.setattr(lcbayes, "fit", functools.partial(lcbayes.fit, **SHORT_RUN), raising=False)
    few = {"evidence": "particles", "num_particles": 12, "num_runs": 2, "num_starts": 4}
    less = functools.partial(lcbayes.compare, **few)
    monkeypatch.setattr(lcbayes, "compare", less, raising=False)


def run_python(page: str, folder: Path) -> dict:
    """The names after all Python blocks of a page, run one after the other."""
    names: dict = {}
    for block in [b for b in PYTHON if b.page == page]:
        documentation_blocks.provide(folder, re.findall(r'"([^"]+)"', block.text))
        exec(compile(block.text, page, "exec"), names)
    return names


@pytest.mark.slow
def test_the_example_of_the_readme_is_trusted_and_right(tmp_path, monkeypatch, capsys):
    """It is `make demo` too, whose exit status is 0 where the fit is trusted."""
    monkeypatch.chdir(tmp_path)
    names = run_python("README.md", tmp_path)
    assert "<Fit: trusted>" in capsys.readouterr().out
    fit = names["fit"]
    assert fit.trusted, fit
    omega = lcbayes.weighted_draws(fit.posterior)["omega"]
    error = omega.mean(("chain", "draw")) - np.array([0.012, -0.020, 0.018])  # of its scenario
    assert np.all(np.abs(error) < 5.0 * omega.std(("chain", "draw")))
    assert (tmp_path / "out" / "report.html").is_file()


def test_the_example_of_the_readme_runs_on_a_stored_fit(tmp_path, monkeypatch, capsys):
    """Every line of it, with a results folder in place of the fit."""
    monkeypatch.chdir(tmp_path)
    task = lcbayes.fit

    def stored(*args, **options):
        given = inspect.signature(task).bind(*args, **options).arguments
        assert given["curve"].n_obs > 100
        return lcbayes.load(results_folders.faceted(tmp_path / given["out"]))

    monkeypatch.setattr(lcbayes, "fit", stored, raising=False)
    names = run_python("README.md", tmp_path)
    assert "<Fit: trusted>" in capsys.readouterr().out
    assert len(names["table"]) > 0
    assert names["draws"]["omega"].sizes["xyz"] == 3
    assert names["again"].trusted


@pytest.mark.usefixtures("short_runs")
def test_the_model_file_of_the_docs_fits(tmp_path):
    file = tmp_path / "mine.py"
    documentation_blocks.own_model(file)
    scenarios = documentation_blocks.SCENARIOS
    curve = lcbayes.read(scenarios / "box-wing.csv", tle=scenarios / "box-wing.tle")
    fit = lcbayes.fit(curve, model=str(file), log_mean=0.5)
    row = fit.content["parameters"]["size"]
    assert 1.0 < row["mean"] < 20.0  # the truth has albedo-areas of 9.4 m² in all
    assert not fit.trusted  # a sphere cannot explain a tumbling satellite, and the fit says so


TRIED_ABOVE = {"README.md", "docs/models.md"}
CHEAP = {"docs/attitude-laws.md"}


@pytest.mark.usefixtures("short_runs", "quick_compilation")
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, marks=[] if page in CHEAP else pytest.mark.slow)
        for page in dict.fromkeys(b.page for b in PYTHON)
        if page not in TRIED_ABOVE
    ],
)
def test_python_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run_python(page, tmp_path)


@pytest.mark.slow
@pytest.mark.real
@pytest.mark.usefixtures("short_runs", "quick_compilation")
@pytest.mark.parametrize("page", OBSERVED)
def test_a_page_about_real_observations_runs(page, data_dir, tmp_path, monkeypatch):
    """Commands and Python in the order of the page, in one folder."""
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in [b for b in BLOCKS if b.page == page and b.needs]:
        if block.language == "python":
            block.observations(data_dir, tmp_path)
            exec(compile(block.text, page, "exec"), names)
            continue
        for _, *words in block.commands:
            documentation_blocks.provide(tmp_path, words)
            block.observations(data_dir, tmp_path)  # in place of what was made
            run_command(page, words)


# A scenario to which each TOML block is a change.
SCENARIO = {
    "body": "[[body.facets]]\nnormal = [0, 0, 1]\narea_m2 = 1.0\n",
    "materials": '[materials.panel]\nlaw = "lambertian"\nr_diff = 0.3\n',
    "attitude": '[attitude]\nlaw = "fixed"\n',
    "geometry": (
        '[geometry]\nkind = "orbit"\ntle = "satellite.tle"\nstart = 2026-04-15T19:45:00Z\n'
        "stop = 2026-04-15T20:10:00Z\nstep = 60.0\n"
        'site = { name = "Calar Alto", lat_deg = 37.2236, lon_deg = -2.5463, height_m = 2168.0 }\n'
    ),
    "noise": "[noise]\nsnr = 30.0\n",
}


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language == "toml"], ids=label)
def test_tables_of_the_pages_are_scenarios(block, tmp_path):
    if block.page in ("docs/bodies.md", "docs/case-ariane.md"):
        assert read_body_text(block.text).priors
        return
    documentation_blocks.copy("box-wing.tle", tmp_path / "satellite.tle")
    given = {re.split(r"[.\]]", head)[0] for head in re.findall(r"(?m)^\[+([^\]]+)\]", block.text)}
    text = "".join(part for name, part in SCENARIO.items() if name not in given) + block.text
    file = tmp_path / "scenario.toml"
    file.write_text(text, encoding="utf-8")
    assert load(file)


def test_the_options_of_the_commands_are_a_page(monkeypatch):
    monkeypatch.setattr("sys.path", list(sys.path))
    text = runpy.run_path(str(ROOT / "docs" / "conf.py"))["options"](["glints", "spin"])
    sections = dict(re.findall(r"## (\S+)\n\n```text\n(.*?)\n```", text, re.DOTALL))
    assert list(sections) == ["glints", "spin"]
    assert "usage: lcbayes glints" in sections["glints"]
    assert "\n  --alarm P " in sections["glints"]
    assert max(map(len, text.splitlines())) <= 96


def test_links_of_the_pages_lead_somewhere():
    made = re.compile(r"gallery/contents\.md|api/.*")  # by `make docs`
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text("utf-8")):
            assert made.fullmatch(target) or (page.parent / target).exists(), (page.name, target)
