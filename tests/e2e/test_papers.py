"""The scripts that draw the paper's figures say what they do and write what they promise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ("figure2", "figure3", "figure4", "bias")


def script(name: str, *args: str) -> str:
    path = ROOT / "analysis" / "papers" / f"{name}.py"
    done = subprocess.run(
        [sys.executable, str(path), *args], capture_output=True, text=True, check=True, cwd=ROOT
    )
    return done.stdout


@pytest.mark.parametrize("name", SCRIPTS)
def test_help_has_an_example(name):
    told = script(name, "--help")
    assert f"example: python analysis/papers/{name}.py -o figures --seed 1" in told
    assert "--seed" in told


@pytest.mark.parametrize(
    ("name", "options"),
    [("figure2", ()), pytest.param("figure3", ("--draws", "80"), marks=pytest.mark.slow)],
)
def test_figures_are_written(name, options, tmp_path):
    told = script(name, "-o", str(tmp_path), "--seed", "2", *options)
    assert str(tmp_path / f"{name}.png") in told
    assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    assert (tmp_path / f"{name}.svg").read_text().startswith("<?xml")
