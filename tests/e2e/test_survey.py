"""`lcbayes survey` from the command line, and with its processes killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import lcbayes
from lcbayes.cli.main import main
from lcbayes.core.errors import EXIT_NOT_TRUSTED
from lcbayes.tasks.survey import worker
from tests.helpers import slow_survey, sparse_surveys
from tests.helpers.survey_catalogues import asteroids_at_home, points, write_flat

ROOT = Path(__file__).parents[2]
NARROW = ("--period-range", "7.28,7.32")


def searched(folder: Path) -> Counter[str]:
    return Counter((folder / "searched").read_text().split())


@pytest.mark.slow
def test_a_killed_survey_loses_nothing_and_does_nothing_twice(tmp_path, monkeypatch):
    catalogue, out = write_flat(points(16), tmp_path / "survey.parquet"), tmp_path / "out"
    words = [sys.executable, "-m", "tests.helpers.slow_survey", str(catalogue), str(out)]
    running = subprocess.Popen(words, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)})
    journal, deadline = out / "objects.jsonl", time.monotonic() + 900  # of a busy machine
    while not journal.exists() or journal.read_bytes().count(b"\n") < 5:
        assert running.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    running.send_signal(signal.SIGKILL)
    running.wait()
    finished = [
        json.loads(line)["name"]
        for line in journal.read_text().splitlines(keepends=True)
        if line[-1] == "\n"
    ]
    assert 5 <= len(finished) < 16
    assert not (out / "summary.json").exists()
    (tmp_path / "searched").unlink()
    monkeypatch.setattr(worker, "search_object", slow_survey.search)
    result = slow_survey.main(str(catalogue), str(out))
    again = searched(tmp_path)
    assert not set(again) & set(finished)
    assert again == Counter([f"A{i}" for i in range(16) if f"A{i}" not in finished])
    assert list(result.summary()["object"]) == [f"A{i}" for i in range(16)]
    assert result.content["n_done_before"] == len(finished)
    whole = slow_survey.main(str(catalogue), str(tmp_path / "whole"))
    pd.testing.assert_frame_equal(result.summary(), whole.summary())


@pytest.mark.slow
def test_a_killed_worker_loses_nothing(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    names = ("a", "once", "b", "always", "c", "d")
    objects: dict[str, dict[str, np.ndarray]] = dict(zip(names, points(6).values(), strict=True))
    catalogue = write_flat(objects, tmp_path / "survey.parquet")
    monkeypatch.setattr(worker, "search_object", slow_survey.search)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))  # of the workers
    table = slow_survey.main(str(catalogue), str(tmp_path / "out"), "2").summary()
    assert list(table["object"]) == list(objects)
    assert [s == "failed" for s in table["status"]] == [name == "always" for name in objects]
    reasons = list(table["reasons"])
    assert reasons[3] == "4 workers died of it: too little memory, or a fault of a library"
    counts = searched(tmp_path)
    assert counts["once"] >= 2  # a result that its worker holds when it dies is found again
    # four workers died while they held it, of which it killed all but those that others killed
    assert 2 <= counts["always"] <= 4
    assert len((tmp_path / "out" / "objects.jsonl").read_text().splitlines()) == 6


@pytest.mark.slow
def test_a_folder_of_period_searches(tmp_path, capsys):
    """The search itself: the rows are those of `lcbayes scan`, with a full scan on request."""
    folder, out = tmp_path / "asteroids", tmp_path / "out"
    folder.mkdir()
    curve = sparse_surveys.observed()
    text = asteroids_at_home(curve)
    (folder / "period_search_in_17").write_text(text)
    (folder / "period_search_in_18").write_text(text.replace(" 0 0\n", " 0 0\n2455000.0 -1 ", 1))
    options = [*NARROW, "--keep", "2", "--refine", "--full", "17", "--workers", "1"]
    assert main(["survey", str(folder), "-o", str(out), *options]) == EXIT_NOT_TRUSTED
    table = lcbayes.load(out).summary()
    assert list(table["object"]) == ["17", "17", "18"]
    assert list(table["solution"].fillna(0)) == [1, 2, 0]
    rows: list[dict[str, Any]] = table.to_dict("records")
    scan = lcbayes.load(out / "objects" / "17")
    for row, solution in zip(rows, scan.content["solutions"], strict=False):
        assert row["period_h"] == pytest.approx(solution["period_h"], rel=1e-9)
        assert row["probability"] == pytest.approx(solution["probability"], rel=1e-9)
        assert row["chi2"] == pytest.approx(solution["chi2"], rel=1e-6)
    assert rows[0]["period_probability"] == pytest.approx(scan.content["period_probability"])
    assert abs(rows[0]["period_h"] - sparse_surveys.PERIOD_H) < rows[0]["period_resolution_h"]
    assert 'href="objects/17/report.html"' in (out / "report.html").read_text()
    assert "period_search_in_18, line" in rows[2]["reasons"]
    assert "1 failed" in capsys.readouterr().out
