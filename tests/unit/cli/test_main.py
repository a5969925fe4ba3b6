"""The command line's own words: its version, its refusals, and the commands that pages print."""

from __future__ import annotations

import importlib
import io
import os
import re
import shlex
import subprocess
import sys
from importlib.metadata import PackageNotFoundError

import pytest

from lcbayes.analysis.pages import command
from lcbayes.cli import main
from lcbayes.core.errors import EXIT_BAD_INPUT, EXIT_DONE
from lcbayes.core.version import installed_version
from lcbayes.tasks.scan.options import ScanOptions


def test_version_of_a_checkout_that_is_not_installed(monkeypatch, capsys):
    def absent(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr("lcbayes.core.version.version", absent)
    installed_version.cache_clear()
    assert main.main(["--version"]) == EXIT_DONE
    installed_version.cache_clear()
    assert capsys.readouterr().out == "lcbayes 0+checkout\n"


def test_names_that_a_terminal_cannot_show_are_escaped(monkeypatch):
    shown = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(shown, encoding="ascii"))
    assert main.main(["--version"]) == EXIT_DONE
    print("caf\udce9 é", flush=True)
    assert shown.getvalue().endswith(b"caf\\udce9 \\xe9\n")


@pytest.mark.parametrize(
    "words",
    [
        ["predict", "{0}", "geometry.csv", "-o", "{0}/b.csv", "--seed", "-1"],
        ["simulate", "box-wing", "-o", "{0}/b.csv", "--seed", "-1"],
    ],
)
def test_a_negative_seed_is_refused_first(words, tmp_path, capsys):
    assert main.main([word.format(tmp_path) for word in words]) == EXIT_BAD_INPUT
    assert "--seed is -1; expected a whole number >= 0" in capsys.readouterr().err


def test_examples_of_help_can_be_pasted():
    """Each by itself, as a shell would split it; nothing is run."""
    pasted = 0
    for name in main.COMMANDS:
        epilog = importlib.import_module(
            f"lcbayes.tasks.{name.replace('-', '_')}.options"
        ).TASK.details
        assert all(len(line) <= 100 for line in epilog.splitlines()), name
        joined = re.split("examples?:\n", epilog)[1].split("\n\n")[0].replace("\\\n", " ")
        for line in joined.splitlines():
            words = shlex.split(line, comments=True)
            assert words[0] == "lcbayes", line
            assert main._parser().parse_args(words[1:]).command == words[1]
            pasted += 1
    assert pasted >= 40


def test_standard_output_that_is_closed_is_no_fault():
    command = ["sh", "-c", 'exec "$@" >&-', "sh", sys.executable, "-m", "lcbayes"]
    done = subprocess.run([*command, "simulate", "--list"], stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (EXIT_DONE, b"")


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_standard_output_that_is_full_is_reported_in_a_line(unbuffered):
    with open("/dev/full", "w") as full:
        command = [sys.executable, "-m", "lcbayes", "simulate", "--list"]
        env = os.environ | {"PYTHONUNBUFFERED": unbuffered}
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, env=env)
    assert done.returncode == EXIT_BAD_INPUT
    assert done.stderr.count("\n") == 1


def test_a_page_prints_the_laws_that_were_scanned():
    given = ["lvlh:yaw_deg=4,pitch_deg=3", "sun-north", "all"]
    run = {"task": "scan", "curve": "a.csv", "options": {"law": given}, "reading": {}}
    words = shlex.split(command(run, ScanOptions))
    assert main._parser().parse_args(words[1:]).law == given
