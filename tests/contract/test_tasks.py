"""Every task has one shape: a declaration, a public function, a command, and a guarded folder."""

from __future__ import annotations

import argparse
import doctest
import fcntl
import importlib
import inspect
import re
import resource
import shlex
import subprocess
import sys
import tomllib
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest

import lcbayes
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_NOT_TRUSTED, InputError
from lcbayes.core.options import declared_options
from lcbayes.data.options import ReadOptions
from lcbayes.results.store import LOCK, results_folder
from lcbayes.simulation.scenarios import bundled
from lcbayes.tasks.task import CURVE, FILE, FOLDER, SOURCE, TEXT, Task
from tests.helpers.low_earth_orbit import steady

TASKS: dict[str, Task] = {
    name: importlib.import_module(f"lcbayes.tasks.{name.replace('-', '_')}.options").TASK
    for name in main.COMMANDS
}
PUBLIC = [name for name, task in TASKS.items() if task.out != TEXT]
IN_FOLDERS = [n for n, task in TASKS.items() if task.out == FOLDER and n != "fit"]
SECTIONS = ("Parameters", "Returns", "Raises", "Examples")
# Of the run, not of the task: where the result goes, and what is printed.
RUN_FLAGS = {"--help", "--out", "--no-report", "--json", "--list", "--config", "--set"}
# Words that name a quantity with a dimension; its help must then give a unit.
DIMENSIONS = re.compile(r"\b(angle|velocity|period|length|longest|age|distance|pole of)\b")
UNITS = re.compile(r"\((?:[^()]*; )?(s|deg|hours|days|rad/s|km)(?:;[^()]*)?\)")
LEAST = {  # options that a task cannot do without, or that make it quick
    "albedo-area": {"attitude": "none", "bootstrap": 0, "nulls": 0},
    "attitude-test": {"bodies": 199},
    "spin": {"shuffles": 99},
}


def parser_of(name: str) -> argparse.ArgumentParser:
    choices: list[Any] = [a.choices for a in main._parser()._actions if isinstance(a.choices, dict)]
    return choices[0][name]


@pytest.mark.parametrize("name", PUBLIC)
def test_a_task_is_a_function_with_the_options_of_the_command(name):
    task = TASKS[name]
    function = getattr(lcbayes, task.function)
    assert task.function in lcbayes.__all__
    options = declared_options(task.options)
    first, *rest = inspect.signature(function).parameters.values()
    assert first.name == task.source
    writing = {FILE: ["out", "progress"], SOURCE: ["progress"]}
    names = [*options, *writing.get(task.out, ["out", "report", "progress"])]
    names += ["model_options"] if task.has_model_options else []
    assert [p.name for p in rest] == names
    for parameter in rest[: len(options)]:
        declared = options[parameter.name]
        assert parameter.default == (
            inspect.Parameter.empty if declared.required else declared.default
        )


FUNCTIONS = [n for n in lcbayes.__all__ if inspect.isfunction(getattr(lcbayes, n))]
# Their examples sample, as that of `fit`, which is run; or differentiate.
LONG = (
    *("compare", "predict", "batch", "survey", "report", "observability"),
    *("load", "load_light_curve"),
)


@pytest.mark.parametrize("name", PUBLIC)
def test_a_function_is_documented(name):
    task = TASKS[name]
    doc = inspect.getdoc(getattr(lcbayes, task.function))
    assert doc is not None
    places = [doc.index(f"\n{title}\n{'-' * len(title)}\n") for title in SECTIONS]
    assert places == sorted(places)
    for option in declared_options(task.options):
        assert f"\n{option} : " in doc


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in FUNCTIONS],
)
def test_the_example_of_a_function_runs(name):
    function = getattr(lcbayes, name)
    module = inspect.getmodule(function)
    (test,) = doctest.DocTestFinder(recurse=False).find(function, name, module, globs={})
    assert test.examples
    assert "SKIP" not in (test.docstring or "")
    said: list[str] = []
    doctest.DocTestRunner(verbose=False).run(test, out=said.append)
    assert not said, "".join(said)


@pytest.mark.parametrize("name", TASKS)
def test_every_flag_is_an_option(name):
    task = TASKS[name]
    options = list(declared_options(task.options).values())
    if task.source == CURVE:
        options += declared_options(ReadOptions).values()
    flags = {flag for a in parser_of(name)._actions for flag in a.option_strings if flag[1] == "-"}
    options = [option for option in options if not option.declared.positional]
    known = {flag for option in options for flag in (option.flag, *option.declared.aliases)}
    assert flags - RUN_FLAGS == known - RUN_FLAGS
    for option in options:
        assert option.declared.help.strip(" .") == option.declared.help, option.name


@pytest.mark.parametrize("name", TASKS)
def test_help_gives_a_unit_where_there_is_a_dimension(name):
    options = [*declared_options(TASKS[name].options).values()]
    options += declared_options(ReadOptions).values()
    for option in options:
        if option.kind is float and DIMENSIONS.search(option.declared.help):
            assert UNITS.search(option.description), f"{option.flag}: {option.description}"


@pytest.mark.parametrize("name", TASKS)
def test_examples_of_help_are_understood(name):
    examples = re.split("examples?:\n", TASKS[name].details)[1].split("\n\n")[0]
    lines = examples.replace("\\\n", " ").splitlines()
    assert lines
    for line in lines:
        words = shlex.split(line, comments=True)
        assert words[:2] == ["lcbayes", name]
        assert main._parser().parse_args(words[1:]).command == name


def test_help_is_quick():
    """User time of the process and what it waits for, the best of five."""
    took = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        subprocess.run([sys.executable, "-m", "lcbayes", "--help"], check=True, capture_output=True)
        took.append(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before)
    assert min(took) <= 0.2


@pytest.fixture(scope="module")
def noise(tmp_path_factory):
    """A light curve without a period or a glint, as a file."""
    path = tmp_path_factory.mktemp("noise") / "noise.csv"
    lcbayes.write(steady(1, 50.0, spinning=False), path)
    return path


def command(name: str, source: Path | str, out: Path) -> list[str]:
    given = LEAST.get(name, {})
    words = [f"--{key.replace('_', '-')}={value}" for key, value in given.items()]
    return [name, str(source), "-o", str(out), *words]


def source_of(name: str, noise: Path) -> Path | str:
    return noise if TASKS[name].source == CURVE else "one-facet"


def files_of(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*")
        if p.is_file()
    }


def finished_fit(folder: Path) -> None:
    (folder / "figures").mkdir(parents=True)
    (folder / "run.toml").write_text('schema = 4\ntask = "fit"\n')
    for name in ("posterior.nc", "summary.json", "report.html", "figures/fit.svg", "shape.obj"):
        (folder / name).write_text(name)


def fit_of_an_older_version(folder: Path) -> None:
    folder.mkdir()
    (folder / "run.toml").write_text('curve = "pass.csv"\nmodel = "faceted"\n')
    (folder / "posterior.nc").write_text("draws")


def interrupted_fit(folder: Path) -> None:
    (folder / "checkpoint").mkdir(parents=True)
    (folder / "checkpoint" / "chain-0.npz").write_text("state")
    (folder / LOCK).write_text("fit")


@pytest.mark.parametrize("held", [finished_fit, fit_of_an_older_version, interrupted_fit])
@pytest.mark.parametrize("name", IN_FOLDERS)
def test_a_fit_is_left_untouched(name, held, noise, tmp_path, capsys):
    out = tmp_path / "out"
    held(out)
    before = files_of(out)
    assert main.main(command(name, source_of(name, noise), out)) == EXIT_BAD_INPUT
    assert "already holds results of lcbayes" in capsys.readouterr().err
    assert files_of(out) == before


@pytest.mark.parametrize("name", IN_FOLDERS)
def test_two_runs_in_one_folder_are_refused(name, noise, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    with open(out / LOCK, "w", encoding="utf-8") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert main.main(command(name, source_of(name, noise), out)) == EXIT_BAD_INPUT
    assert "another run is writing into" in capsys.readouterr().err
    assert [p.name for p in out.iterdir()] == [LOCK]


class Killed(BaseException):
    """As a signal would end the process while it writes."""


def test_a_run_that_is_killed_while_staging_leaves_the_earlier_result(noise, tmp_path, monkeypatch):
    out = tmp_path / "out"
    assert main.main(command("glints", noise, out)) == EXIT_NOT_TRUSTED
    before = files_of(out)
    with monkeypatch.context() as patched:

        def killed(*_: object) -> None:
            raise Killed

        patched.setattr("lcbayes.tasks.glints.result.GlintsResult.write_page", killed)
        patched.setattr("shutil.rmtree", lambda *_, **__: None)  # nobody tidies up
        with pytest.raises(Killed):
            main.main([*command("glints", noise, out), "--alarm=0.1"])
    after = files_of(out)
    assert {name: after[name] for name in before} == before
    assert any(name.startswith(".new-") for name in after)
    assert main.main(command("glints", noise, out)) == EXIT_NOT_TRUSTED
    assert {p.split("/")[0] for p in files_of(out)} == {p.split("/")[0] for p in before}


def test_every_input_file_is_recorded_with_its_hash(tmp_path):
    folder = bundled()["box-wing"].parent
    shape = tmp_path / "wedge.obj"
    shape.write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n", encoding="utf-8"
    )
    curve = lcbayes.read(folder / "box-wing.csv", tle=folder / "box-wing.tle")
    lcbayes.shape_match(curve, shape=["cube", str(shape)], out=tmp_path / "match", report=False)
    lcbayes.observability("box-wing", out=tmp_path / "campaign", report=False)
    expected = {
        "match": {
            "curve": folder / "box-wing.csv",
            "tle": folder / "box-wing.tle",
            "shape-1": shape,
        },
        "campaign": {"scenario": folder / "box-wing.toml", "tle": folder / "box-wing.tle"},
    }
    for out, files in expected.items():
        record = tomllib.loads((tmp_path / out / "run.toml").read_text(encoding="utf-8"))
        result = {name: (one["path"], one["sha256"]) for name, one in record["input"].items()}
        assert result == {
            name: (str(path.resolve()), sha256(path.read_bytes()).hexdigest())
            for name, path in files.items()
        }


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("spin", {"curve": 3}, "the light curve is of type int"),
        ("glints", {"alarm": "often"}, "--alarm is 'often'; expected a number between 0 and 1"),
        ("glints", {"omega": (0.0, 1.0)}, "--omega is (0.0, 1.0); expected 3 numbers in rad/s"),
        ("glints", {"omega": 1.0}, "--omega is 1.0; expected 3 numbers in rad/s"),
        ("glints", {"pole": (1.0, 2.0)}, "a spin needs both"),
        ("albedo-area", {}, "one attitude is needed"),
        ("albedo-area", {"attitude": "none", "bootstrap": True}, "--bootstrap is True; expected"),
        ("attitude-test", {"law": "hover"}, "unknown attitude law 'hover'"),
        ("shape-match", {"shape": "pyramid"}, "unknown shape 'pyramid'; available: cube"),
        ("observability", {"scenario": 3}, "the scenario is of type int; give a path or a name"),
        ("observability", {"plan": "many"}, "--plan is 'many'; expected a whole number >= 1"),
        ("spin", {"out": 3}, "out is of type int; give a path"),
        ("spin", {"progress": 3}, "progress is 3; give True, False or a Console"),
        ("simulate", {"scenario": "nowhere"}, "no file and no scenario is called 'nowhere'"),
    ],
)
def test_a_fault_in_python_is_one_line(name, given, message, noise):
    task = TASKS[name]
    source = given.pop(task.source, source_of(name, noise))
    with pytest.raises(InputError, match=re.escape(message)) as caught:
        getattr(lcbayes, task.function)(source, **given)
    assert "\n" not in str(caught.value)


def test_a_file_or_folder_of_the_wrong_type_is_one_line(noise):
    wrong: Any = 5
    with pytest.raises(InputError, match="the folder is of type int; give a path"):
        lcbayes.load(wrong)
    with pytest.raises(InputError, match="the path is of type int; give a path"):
        lcbayes.write(lcbayes.read(noise), wrong)
    with pytest.raises(InputError, match="the light curve is of type int; give a LightCurve"):
        lcbayes.write(wrong, "two.csv")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"site": 5}, "--site is 5; expected text"),
        ({"error": "small"}, "--error is 'small'; expected a number"),
        ({"tle": 3.0}, "--tle is 3.0; expected a path"),
    ],
)
def test_a_fault_in_reading_is_one_line(given, message, noise):
    with pytest.raises(InputError, match=re.escape(message)):
        lcbayes.read(noise, **given)


def test_negative_numbers_are_values(noise, tmp_path, capsys):
    out = tmp_path / "out"
    argv = ["glints", str(noise), "-o", str(out), "--omega", "-1,0,0", "--json"]
    assert main.main(argv) == EXIT_NOT_TRUSTED
    assert '"omega": [\n   -1.0,' in capsys.readouterr().out
    record = tomllib.loads((out / "run.toml").read_text(encoding="utf-8"))
    assert record["options"]["omega"] == [-1.0, 0.0, 0.0]


def test_a_task_of_one_file_writes_it(tmp_path):
    made = lcbayes.simulate("one-facet", seed=2, out=tmp_path / "one.csv")
    assert {p.name for p in tmp_path.iterdir()} == {"one.csv", "one.truth.json"}
    assert lcbayes.read(tmp_path / "one.csv").brightness.tolist() == made.data.brightness.tolist()


def test_the_folder_is_unlocked_when_the_run_ends(noise, tmp_path):
    lcbayes.glints(noise, out=tmp_path / "out", report=False)
    with results_folder(tmp_path / "out", "glints"):
        pass
