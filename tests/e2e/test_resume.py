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
import xarray as xr

from lcbayes.data.write import write
from tests.helpers import small_curves

# Many blocks of a little work each, so that kills fall between and within them.
FIT = (
    "--n-facets",
    "1",
    "--spin",
    "none",
    "--seed",
    "3",
    "--num-chains",
    "2",
    "--num-warmup",
    "300",
    "--num-samples",
    "900",
    "--num-starts",
    "64",
    "--no-report",
)
STORED = 1 + (300 + 900) // 50  # the search, then block by block


@pytest.fixture(scope="module")
def place(tmp_path_factory) -> Path:
    """A light curve, and in ``whole`` its fit by a run that nothing interrupted."""
    folder = tmp_path_factory.mktemp("resume")
    write(small_curves.curve(40), folder / "curve.csv")
    end(begin(folder, "whole"))
    return folder


def begin(place: Path, out: str) -> subprocess.Popen:
    root = Path(__file__).parents[2]
    env = os.environ | {"LCBAYES_CACHE": str(place / "cache"), "PYTHONPATH": str(root)}
    command = [sys.executable, "-m", "lcbayes", "fit", "curve.csv", "-o", out, *FIT]
    return subprocess.Popen(
        command, cwd=place, env=env, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )


def end(process: subprocess.Popen) -> str:
    """What a run that may end says on standard error."""
    _, said = process.communicate()
    assert process.returncode in (0, 3), said
    return said


def stored(place: Path, out: str) -> int:
    return len(list((place / out / "checkpoint").glob("[!.]*.npz")))


def kill_after(place: Path, out: str, n_stored: int, delay: float) -> None:
    """SIGKILL ``delay`` seconds after the checkpoint holds ``n_stored`` pieces."""
    process = begin(place, out)
    while stored(place, out) < n_stored and process.poll() is None:
        time.sleep(0.001)
    time.sleep(delay)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL, "it ended before it was killed"
    assert not (place / out / "posterior.nc").exists()


def assert_same_numbers(a: Path, b: Path) -> None:
    with xr.open_datatree(a / "posterior.nc") as one, xr.open_datatree(b / "posterior.nc") as two:
        assert [n.path for n in one.subtree] == [n.path for n in two.subtree]
        compared = 0
        for node in one.subtree:
            for name, values in node.data_vars.items():
                other = two[node.path].data_vars[name]
                np.testing.assert_array_equal(values.values, other.values, f"{node.path}/{name}")
                compared += 1
    assert compared > 20


def kill_and_resume(place: Path, n_kills: int, seed: int) -> None:
    rng = random.Random(seed)
    out = f"killed-{n_kills}"
    # After so many pieces, and a random time into the next; 0 is before the search has ended.
    for after in sorted(rng.sample(range(STORED - 4), n_kills)):
        kill_after(place, out, after, rng.uniform(0.0, 0.02) if after else rng.uniform(0.5, 4.0))
    assert stored(place, out) > 0
    assert "resuming" in end(begin(place, out))
    assert_same_numbers(place / "whole", place / out)
    assert stored(place, out) == 0


@pytest.mark.slow
def test_killed_twice(place):
    kill_and_resume(place, 2, seed=1)


@pytest.mark.slow
def test_killed_ten_times(place):
    kill_and_resume(place, 10, seed=2)
