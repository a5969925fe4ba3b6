"""Kill -9 at any moment: the same command goes on to the numbers it would have had."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import small
import xarray as xr

from lcbayes.io import write

# Many blocks of a little work each, so that kills fall between and within them.
FIT = ("--n-facets", "2", "--seed", "3", "--num-chains", "2", "--num-warmup", "300",
       "--num-samples", "600", "--num-starts", "64", "--max-modes", "2", "--no-report")  # fmt: skip


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("resume")
    write(small.curve(60, 2, spinning=True), folder / "curve.csv")
    return folder


def begin(place: Path, out: str) -> subprocess.Popen:
    root = Path(__file__).parents[2]
    env = os.environ | {"LCBAYES_CACHE": str(place / "cache"), "PYTHONPATH": str(root)}
    command = [sys.executable, "-m", "lcbayes", "fit", "curve.csv", "-o", out, *FIT]
    return subprocess.Popen(
        command, cwd=place, env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def whole(place: Path, out: str) -> float:
    """Seconds of an uninterrupted run."""
    begun = time.monotonic()
    process = begin(place, out)
    _, said = process.communicate()
    assert process.returncode in (0, 3), said
    return time.monotonic() - begun


def assert_same_numbers(a: Path, b: Path) -> None:
    with xr.open_datatree(a / "posterior.nc") as one, xr.open_datatree(b / "posterior.nc") as two:
        assert [n.path for n in one.subtree] == [n.path for n in two.subtree]
        compared = 0
        for node in one.subtree:
            for name, values in node.data_vars.items():
                other = two[node.path][name]
                np.testing.assert_array_equal(values.values, other.values, f"{node.path}/{name}")
                compared += 1
    assert compared > 20


def kill_and_resume(place: Path, n_kills: int, seed: int) -> list[int]:
    """Blocks on disk at each kill; the last run ends and agrees with the uninterrupted one."""
    whole(place, "first")  # compiles
    seconds = whole(place, "whole")
    rng = random.Random(seed)
    out, stored = f"killed-{n_kills}", []
    while len(stored) < n_kills:
        process = begin(place, out)
        try:
            process.wait(rng.uniform(0.2, 0.9) * seconds)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.communicate()
            assert not (place / out / "posterior.nc").exists()
            stored.append(len(list((place / out / "checkpoint").glob("[!.]*.npz"))))
        else:  # it was quicker than the run that was timed; a kill that came too late is none
            process.communicate()
            (place / out / "posterior.nc").unlink()
    process = begin(place, out)
    _, said = process.communicate()
    assert process.returncode in (0, 3), said
    assert_same_numbers(place / "whole", place / out)
    if stored[-1]:
        assert "resuming" in said
    return stored


def test_killed_twice(place):
    stored = kill_and_resume(place, 2, seed=1)
    assert stored == sorted(stored)


@pytest.mark.slow
def test_killed_ten_times(place):
    stored = kill_and_resume(place, 10, seed=2)
    assert stored == sorted(stored)
    assert stored[-1] > 0


def test_leftovers_of_a_kill_are_swept(place):
    """A kill while a file is being written leaves its scratch; the next run clears it away."""
    out = place / "swept"
    out.mkdir()
    (out / ".posterior.nc-abc123.nc").write_text("half")
    whole(place, "swept")
    assert not list(out.glob(".posterior*"))
    assert not list((out / "checkpoint").iterdir())
