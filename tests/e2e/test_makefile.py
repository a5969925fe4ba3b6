"""What `make` says where there is no Python that will do."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAKE = shutil.which("make")

pytestmark = pytest.mark.skipif(MAKE is None, reason="make is not installed")


@pytest.fixture
def make(tmp_path):
    """Run make in a copy of the Makefile, with nothing on the path but what a test puts there."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "bin").mkdir()

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        env = {"PATH": str(tmp_path / "bin"), "HOME": str(tmp_path), "LC_ALL": "C"}
        command = [str(MAKE), *words]
        return subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True)

    return run


def _script(path: Path, body: str) -> None:
    path.write_text(f"#!/bin/bash\n{body}\n", encoding="utf-8")
    os.chmod(path, 0o755)


def test_no_python_at_all(make, tmp_path):
    """A version manager's shim that names no version does not count."""
    _script(tmp_path / "bin" / "python3.12", 'echo "no such version" >&2; exit 127')
    answer = make("demo")
    assert answer.returncode == 2
    first, *rest = answer.stderr.splitlines()
    assert first.startswith("no Python 3.12 or newer was found; install one, then give its path")
    assert all(line.startswith("make") for line in rest)
    assert not (tmp_path / ".venv").exists()


def test_python_too_old(make, tmp_path):
    _script(tmp_path / "bin" / "old", "exit 1")
    answer = make("test", "PYTHON=old")
    assert answer.returncode == 2
    assert answer.stderr.startswith("PYTHON=old is not Python 3.12 or newer; install one")
    assert not (tmp_path / ".venv").exists()


def test_the_first_python_that_will_do_makes_the_environment(make, tmp_path):
    _script(tmp_path / "bin" / "python3.12", "exit 127")
    _script(tmp_path / "bin" / "python3.13", 'if [ "$1" = -m ]; then echo "made: $*"; fi')
    answer = make(".venv/bin/python")
    assert answer.returncode == 0, answer.stderr
    assert answer.stdout.strip() == "made: -m venv --clear .venv"


def test_xla_optimises_less_in_the_runs_of_ci_alone(make, tmp_path):
    python = tmp_path / ".venv" / "bin" / "python"
    python.parent.mkdir(parents=True)
    _script(python, 'echo "$JAX_DISABLE_MOST_OPTIMIZATIONS, $XLA_FLAGS"')
    (tmp_path / ".venv" / ".installed-dev").touch()
    quick, whole = [make("test"), make("test-more")], make("test-all")
    for run in quick:
        assert run.stdout.split() == ["1,", "--xla_cpu_parallel_codegen_split_count=1"], run.stderr
    assert whole.stdout.strip() == ",", whole.stderr
