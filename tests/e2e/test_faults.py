"""The disk full, a folder that cannot be made or is in use: one line, and nothing lost."""

from __future__ import annotations

import ast
import errno
import fcntl
import hashlib
import os
import re
import resource
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from jax.experimental.compilation_cache import compilation_cache

from lcbayes.analysis import report
from lcbayes.cli import main
from lcbayes.core.checkpoint import Checkpoint
from lcbayes.core.errors import EXIT_BAD_INPUT
from lcbayes.core.jax_setup import jax
from lcbayes.data.write import write
from tests.helpers import results_folders, small_curves

ROOT = Path(__file__).parents[2]
FIT = [*small_curves.SHORT_FIT, "--no-report"]


@contextmanager
def room_for(n_bytes: int) -> Iterator[None]:
    """No file of this process may grow beyond so many bytes, as if the disk were full.

    JAX's cache of compiled programs is left alone: of a write that fails it warns, and goes on.
    Python does not: what it kept of a module would be cut off, and fail whoever imports it next.
    """
    bytecode, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, old[1]))
    jax.config.update("jax_enable_compilation_cache", False)
    compilation_cache.reset_cache()  # JAX asks once whether there is one
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
        compilation_cache.reset_cache()
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
        sys.dont_write_bytecode = bytecode


def contents(folder: Path) -> dict[str, str]:
    """Every file by its digest; the lock and what a stopped run keeps are left out."""
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file() and p.name != ".lock" and "checkpoint" not in p.parts
    }


def assert_printed(capsys, *words: str) -> None:
    """One line for the fault, whatever was said of the progress before."""
    lines = [x for x in capsys.readouterr().err.splitlines() if x.startswith("lcbayes ")]
    assert len(lines) == 1, lines
    assert all(word in lines[0] for word in words), lines[0]


@pytest.mark.slow
def test_a_disk_that_fills_while_fitting_loses_nothing(tmp_path, capsys):
    write(small_curves.curve(40), tmp_path / "curve.csv")
    out = tmp_path / "out"
    fit = ["fit", str(tmp_path / "curve.csv"), "-o", str(out), *FIT]
    assert main.main([*fit, "--seed", "1"]) in (0, 3)
    before = contents(out)
    assert {"posterior.nc", "summary.json", "run.toml"} <= set(before)
    # a checkpoint fits, the posterior does not
    largest = out / "posterior.nc"
    capsys.readouterr()
    with room_for(largest.stat().st_size // 2):
        assert main.main([*fit, "--seed", "2"]) == EXIT_BAD_INPUT
    assert_printed(capsys, "lcbayes fit: ", "same command again")
    assert contents(out) == before
    assert main.main([*fit, "--seed", "2"]) in (0, 3)
    assert "resuming" in capsys.readouterr().err
    assert set(contents(out)) == set(before)
    assert contents(out) != before
    with room_for(1000):  # not even a checkpoint
        assert main.main([*fit, "--seed", "3"]) == EXIT_BAD_INPUT
    assert_printed(capsys, "lcbayes fit: ")
    # another run is at work in the folder
    before = contents(out)
    with (out / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert main.main([*fit, "--seed", "4"]) == EXIT_BAD_INPUT
    assert_printed(capsys, "another run is writing into")
    assert contents(out) == before


def test_a_run_stopped_at_its_report_goes_on_to_it(tmp_path, capsys, monkeypatch):
    """The earlier result stays as it was meanwhile, and nothing is sampled again."""
    write(small_curves.curve(20), tmp_path / "curve.csv")
    out = tmp_path / "out"
    fit = ["fit", str(tmp_path / "curve.csv"), "-o", str(out), *FIT[:-1]]
    assert main.main([*fit, "--seed", "1"]) in (0, 3)
    before = contents(out)
    assert "report.html" in before
    with monkeypatch.context() as patch:
        patch.setattr(report, "_compose", no_room)
        assert main.main([*fit, "--seed", "2"]) == EXIT_BAD_INPUT
    assert_printed(capsys, "No space left on device", "same command again")
    assert contents(out) == before
    saved: list[str] = []
    monkeypatch.setattr(Checkpoint, "save", lambda _self, name, _arrays: saved.append(name))
    assert main.main([*fit, "--seed", "2"]) in (0, 3)
    assert "resuming" in capsys.readouterr().err
    assert not saved
    assert (out / "report.html").is_file()
    assert not list((out / "checkpoint").iterdir())
    assert "seed = 2" in (out / "run.toml").read_text()


def no_room(*_) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_disk_that_fills_while_a_report_is_written(tmp_path, capsys):
    folder = results_folders.faceted(tmp_path / "results")
    (folder / "figures").mkdir()
    for old in ("report.html", "shape.obj", "figures/facets.svg"):
        (folder / old).write_text("of an earlier run")
    before = contents(folder)
    with room_for(50_000):
        assert main.main(["report", str(folder)]) == EXIT_BAD_INPUT
    assert_printed(capsys, "lcbayes report: ")
    assert contents(folder) == before


@pytest.mark.parametrize(
    "command",
    ["simulate", "convert", "glints", pytest.param("observability", marks=pytest.mark.slow)],
)
def test_a_disk_that_fills_leaves_no_half_of_a_file(command, tmp_path, capsys):
    write(small_curves.curve(40), tmp_path / "curve.csv")
    out = tmp_path / ("new.csv" if command in ("simulate", "convert") else "new")
    words = {
        "simulate": ["one-facet", "-o", str(out)],
        "convert": [str(tmp_path / "curve.csv"), str(out)],
        "glints": [str(tmp_path / "curve.csv"), "-o", str(out)],
        "observability": ["one-facet", "-o", str(out)],
    }[command]
    with room_for(1500):
        assert main.main([command, *words]) == EXIT_BAD_INPUT
    assert_printed(capsys, f"lcbayes {command}: ", "File too large")
    left = {p.name for p in tmp_path.rglob("*") if p.is_file() and p.stat().st_size}
    assert left - {".lock"} == {"curve.csv"}  # the lock names the task whose folder it is


@pytest.mark.parametrize("command", ["simulate", "fit", "glints", "observability", "batch", "scan"])
def test_a_place_that_cannot_be_written(command, tmp_path, capsys):
    """Below a file, where no folder can be: also for who may write anywhere."""
    write(small_curves.curve(40), tmp_path / "curve.csv")
    (tmp_path / "file").write_text("mine")
    out = tmp_path / "file" / "out"
    words = {
        "simulate": ["one-facet"],
        "observability": ["one-facet"],
        "fit": [str(tmp_path / "curve.csv"), *FIT],
        "scan": [str(tmp_path / "curve.csv"), "--period", "0.01"],
    }.get(command, [str(tmp_path / "curve.csv")])
    if command == "batch":
        words = [str(tmp_path / "*.csv")]
    assert main.main([command, *words, "-o", str(out)]) == EXIT_BAD_INPUT
    assert_printed(capsys, f"lcbayes {command}: ", str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"


SOURCES = [
    p
    for top in ("lcbayes", "models", "analysis")
    for p in (ROOT / top).rglob("*.py")
    if not p.is_relative_to(ROOT / "lcbayes" / "models")
    and not p.is_relative_to(ROOT / "lcbayes" / "analysis")
]


def test_every_text_is_utf_8():
    """Whatever the machine's own encoding is."""
    for path in SOURCES:
        for call in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if (
                isinstance(call, ast.Call)
                and isinstance(call.func, ast.Attribute)
                and call.func.attr in ("read_text", "write_text")
                and path.name != "checkpoint.py"  # JSON in ASCII alone
            ):
                assert "encoding" in [k.arg for k in call.keywords], (path, call.lineno)


def test_nothing_reads_a_pickle_or_hangs_on_the_wall_clock():
    """A clock that is set back changes no duration and no number; a file of data runs nothing."""
    assert len(SOURCES) > 150
    for path in SOURCES:
        text = path.read_text(encoding="utf-8")
        said = re.sub(r'""".*?"""', "", text, flags=re.S).replace("allow_pickle=False", "")
        result = re.findall(
            r"pickle|\bdill\b|joblib|marshal|\btime\.time\(|st_mtime|\beval\(", said
        )
        assert not result, (path, result)
        if "datetime.now(" in text:  # the date of a result, which nothing reads again
            assert path.parts[-3:] == ("tasks", "fit", "run.py"), path
